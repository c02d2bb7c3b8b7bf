//! Row correction of a single pair, by what its own matches tell of its rows.
//!
//! The daemon corrects rows while it runs ([`super::correction`]), by the few corners of each of many pairs. Here one pair
//! must do: its grid of corners is finer, and however small the offset is, it is corrected.

use super::correction::DEFAULT_LIMIT_PX;
use super::field::RowField;
use super::shift::shift_rows;
use super::{EpipolarCheck, EpipolarParameters, MatchedPair, SCATTER_PX};
use crate::image::{GreyImage, GreyView};
use crate::simd::Level;
use crate::stereo::{DisparityView, MatchError, MatchOutput, Matcher};
use nalgebra::{Matrix3, Vector3};

/// Width and height of a cell, of which the clearest corner is taken, in px; patches are 9 px wide.
const CELL_PX: usize = 12;

/// Share of the points that must agree on the offset: a pair that does not match has points, too.
const MIN_AGREEING: f64 = 0.5;

/// Largest standard deviation of the offset at the corners of the image, in px. Points in one part of the image tell nothing
/// of the others.
const MAX_SIGMA_PX: f64 = 0.1;

/// Matches a pair and measures its vertical offset; the right image without it, and the offset. `None` where the points tell no
/// certain one, or one beyond [`DEFAULT_LIMIT_PX`], which more than the rows is wrong with.
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

/// The vertical offset of a pair.
fn measured(pair: MatchedPair<'_>) -> Option<RowField> {
    let parameters = EpipolarParameters::default();
    let check = EpipolarCheck::new(parameters);
    if !check.can_measure(&pair) {
        return None;
    }
    let cells = |side: usize| (side - 2 * check.margin()).div_ceil(CELL_PX);
    let grid = (cells(pair.left.width()), cells(pair.left.height()));
    let points: Vec<[f64; 3]> = (0..grid.0 * grid.1)
        .filter_map(|cell| check.point_of_cell(&pair, grid, cell, &RowField::ZERO).0)
        .collect();
    let field = RowField::fitted(&points, parameters.huber_px)?;
    let agrees = |[x, y, offset]: &&[f64; 3]| (offset - field.at(*x, *y)).abs() < parameters.huber_px;
    let agreeing: Vec<[f64; 2]> = points.iter().filter(agrees).map(|[x, y, _]| [*x, *y]).collect();
    let is_told = agreeing.len() as f64 >= MIN_AGREEING * points.len() as f64;
    let is_certain = corner_sigma_px(&agreeing).is_some_and(|sigma_px| sigma_px <= MAX_SIGMA_PX);
    (is_told && is_certain && field.largest_px() <= DEFAULT_LIMIT_PX).then_some(field)
}

/// Largest standard deviation of a field at the corners of the image, in px, that points at these places determine. `None` if they do not.
fn corner_sigma_px(places: &[[f64; 2]]) -> Option<f64> {
    let row = |x: f64, y: f64| Vector3::new(1.0, x, y);
    let information: Matrix3<f64> = places.iter().map(|[x, y]| row(*x, *y) * row(*x, *y).transpose()).sum();
    let covariance = information.try_inverse()? * SCATTER_PX.powi(2);
    let at = |(x, y): (f64, f64)| row(x, y).dot(&(covariance * row(x, y)));
    let variance =
        [(-1.0, -1.0), (1.0, -1.0), (-1.0, 1.0), (1.0, 1.0)].map(at).into_iter().fold(0.0, f64::max);
    Some(variance.sqrt())
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
        // Images that have nothing to do with each other, and one that is too flat for a grid of corners.
        let (left, right) = (pair(|_, _| 0.0, 1).0, pair(|_, _| 0.0, 2).1);
        assert_eq!(corrected(Level::best(), &mut matcher(), left.view(), right.view()), Ok(None));
        let (width, height) = (SIZE.0, 40);
        let strip = |image: &GreyImage| {
            GreyImage::from_vec(image.as_slice()[..width * height].to_vec(), width, height).unwrap()
        };
        let mut low = Mpv::new(MpvParameters::default(), Search::Windows, width, height, 32).unwrap();
        let (left, right, _) = pair(|_, _| 0.5, 3);
        assert_eq!(corrected(Level::best(), &mut low, strip(&left).view(), strip(&right).view()), Ok(None));
    }

    #[test]
    fn corners_in_one_part_of_the_image_tell_nothing_of_the_others() {
        let (left, right, _) = pair(|_, _| 0.5, 3);
        // Grey but for the upper left quarter.
        let covered = |mut image: GreyImage| {
            for (i, pixel) in image.as_mut_slice().iter_mut().enumerate() {
                if i % SIZE.0 >= SIZE.0 / 2 || i / SIZE.0 >= SIZE.1 / 2 {
                    *pixel = 128;
                }
            }
            image
        };
        let (left, right) = (covered(left), covered(right));
        assert_eq!(corrected(Level::best(), &mut matcher(), left.view(), right.view()), Ok(None));
    }

    #[test]
    fn what_more_than_rows_is_wrong_with_is_not_corrected() {
        let (left, right, _) = pair(|_, _| 3.0, 4);
        assert_eq!(corrected(Level::best(), &mut matcher(), left.view(), right.view()), Ok(None));
    }
}
