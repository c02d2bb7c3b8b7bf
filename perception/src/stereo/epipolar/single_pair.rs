//! Row correction of a single pair, by what its own matches tell of its rows.
//!
//! The daemon corrects rows while it runs ([`super::correction`]), by the few corners of each of many pairs. Here one pair
//! must do: its grid of corners is finer.

use super::field::RowField;
use super::shift::shift_rows;
use super::{EpipolarCheck, EpipolarParameters, MatchedPair};
use crate::image::{GreyImage, GreyView};
use crate::simd::Level;
use crate::stereo::{DisparityView, MatchError, MatchOutput, Matcher};

/// Width and height of a cell, of which the clearest corner is taken, in px: as far apart as patches do not overlap much.
const CELL_PX: usize = 12;

/// Minimum number of points that agree on the offset. With a deviation of 0.25 px, 60 determine the middle within 0.03 px.
const MIN_AGREEING: usize = 60;

/// Matches a pair and measures its vertical offset; the right image without it, and the offset. `None` where too few points tell
/// of it.
///
/// # Errors
/// As [`Matcher::compute`].
pub fn corrected(
    level: Level,
    matcher: &mut dyn Matcher,
    left: GreyView<'_>,
    right: GreyView<'_>,
) -> Result<Option<(RowField, GreyImage)>, MatchError> {
    let (width, height) = (left.width(), left.height());
    let (mut disparity, mut confidence) = (vec![0; width * height], vec![0; width * height]);
    matcher.compute(left, right, MatchOutput { disparity: &mut disparity, confidence: &mut confidence })?;
    let Some(map) = DisparityView::new(&disparity, width, height) else { return Ok(None) };
    let pair = MatchedPair { left, right, disparity: map, confidence: &confidence };
    Ok(measured(pair).map(|field| {
        let mut image = GreyImage::new(width, height);
        shift_rows(level, right, &field, image.as_mut_slice());
        (field, image)
    }))
}

/// The vertical offset of a pair; `None` where too few points agree on one.
fn measured(pair: MatchedPair<'_>) -> Option<RowField> {
    let parameters = EpipolarParameters::default();
    let check = EpipolarCheck::new(parameters);
    if !check.can_measure(&pair) {
        return None;
    }
    let grid = (pair.left.width().div_ceil(CELL_PX), pair.left.height().div_ceil(CELL_PX));
    let points: Vec<[f64; 3]> = (0..grid.0 * grid.1)
        .filter_map(|cell| check.point_of_cell(&pair, grid, cell, &RowField::ZERO).0)
        .collect();
    let field = RowField::fitted(&points, parameters.huber_px)?;
    let agreeing =
        points.iter().filter(|[x, y, offset]| (offset - field.at(*x, *y)).abs() < parameters.huber_px);
    (agreeing.count() >= MIN_AGREEING).then_some(field)
}

#[cfg(test)]
mod tests {
    use super::super::tests::{SIZE, pair};
    use super::*;
    use crate::stereo::{Mpv, MpvParameters, Search};

    fn matcher() -> Mpv {
        Mpv::new(MpvParameters::default(), Search::Windows, SIZE.0, SIZE.1, 32).unwrap()
    }

    #[test]
    fn the_rows_of_one_pair_are_corrected_by_its_own_matches() {
        let field = RowField { offset_px: 0.6, across_px: -0.4, down_px: 0.2 };
        let (left, right, _) = pair(
            |x, y| field.at(2.0 * x / (SIZE.0 - 1) as f64 - 1.0, 2.0 * y / (SIZE.1 - 1) as f64 - 1.0),
            5,
        );
        let mut matcher = matcher();
        let (found, image) = corrected(Level::best(), &mut matcher, left.view(), right.view())
            .unwrap()
            .expect("texture everywhere");
        assert!((found - field).largest_px() < 0.15, "{found:?}");
        let (rest, _) = corrected(Level::best(), &mut matcher, left.view(), image.view()).unwrap().unwrap();
        assert!(rest.largest_px() < 0.1, "{rest:?}");
    }

    #[test]
    fn where_nothing_matches_nothing_is_corrected() {
        let flat = GreyImage::new(SIZE.0, SIZE.1);
        assert_eq!(corrected(Level::best(), &mut matcher(), flat.view(), flat.view()), Ok(None));
        let small = GreyImage::new(SIZE.0, SIZE.1 / 2);
        assert!(corrected(Level::best(), &mut matcher(), small.view(), small.view()).is_err());
    }
}
