//! Corners of the reduced left image, searched in the reduced right one to both sides and in both directions, without any
//! disparity map: how a pair is arranged when nothing is known of it.

use super::field::place;
use super::patch::{HALF, Patch, corner};
use crate::image::GreyView;

/// Width to which images are reduced, in px: a disparity of 4 px at 1242 px of width is still told from none.
const REDUCED_WIDTH: usize = 240;
/// Grid cells in which a corner is taken.
const GRID: (usize, usize) = (12, 6);
/// Search range, as a share of the reduced width to both sides.
const ASIDE_SHARE: f64 = 0.2;
/// Search range up and down, in reduced pixels: 25 rows at 1242 px of width.
const REACH: usize = 6;
/// Minimum corner response in squared grey levels; the reduction has averaged noise away.
const MIN_CORNER: f32 = 8.0;
/// A match is taken if its difference is at most this share of the patch's contrast …
const MAX_DIFFERENCE: f32 = 0.15;
/// … and of the second best, more than 2 px away. Repeated structures fail this.
const MAX_RATIO: f32 = 0.6;

/// Largest number of matches.
pub const MAX_MATCHES: usize = GRID.0 * GRID.1;

/// A corner that was found in both images.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct CoarseMatch {
    /// Place in the right image, each coordinate from −1 to 1.
    pub at: [f64; 2],
    /// Column and row in the right image minus those in the left one, in px of the whole image: multiples of the scale.
    pub moved_px: [f64; 2],
}

/// Finds corners of one image in the other. Nothing is allocated after its creation.
#[derive(Clone, Debug)]
pub struct CoarseMatcher {
    reduced: [Vec<u8>; 2],
    size: (usize, usize),
    scale: usize,
    found: Vec<CoarseMatch>,
}

impl CoarseMatcher {
    /// For images of `width` × `height` pixels.
    pub fn new(width: usize, height: usize) -> Self {
        let scale = (width / REDUCED_WIDTH).max(1);
        let size = (width / scale, height / scale);
        let reduced = [vec![0; size.0 * size.1], vec![0; size.0 * size.1]];
        Self { reduced, size, scale, found: Vec::with_capacity(MAX_MATCHES) }
    }

    /// Pixels of the whole image in one of the reduced one.
    pub fn scale(&self) -> usize {
        self.scale
    }

    /// The corners that are found in both images; none in images of another size, or too small ones.
    pub fn matches(&mut self, left: GreyView<'_>, right: GreyView<'_>) -> &[CoarseMatch] {
        self.found.clear();
        let (width, height) = self.size;
        let side = HALF + 1;
        let aside = (width as f64 * ASIDE_SHARE) as usize;
        let fits =
            |view: GreyView<'_>| view.width() / self.scale == width && view.height() / self.scale == height;
        if !fits(left) || !fits(right) || width < 4 * aside + 8 * side || height < 2 * (REACH + side) + GRID.1
        {
            return &self.found;
        }
        for (image, out) in [left, right].into_iter().zip(&mut self.reduced) {
            reduce(image, self.scale, width, out);
        }
        let [left, right] = [0, 1].map(|i| GreyView::new(&self.reduced[i], width, height, width));
        let (Ok(left), Ok(right)) = (left, right) else { return &self.found };
        for cell in 0..GRID.0 * GRID.1 {
            let span = |k: usize, n: usize, margin: usize, length: usize| {
                let inner = length - 2 * margin;
                margin + k * inner / n..margin + (k + 1) * inner / n
            };
            let columns = span(cell % GRID.0, GRID.0, aside + side, width);
            let lines = span(cell / GRID.0, GRID.1, REACH + side, height);
            let Some((x, y)) = strongest(left, columns, lines) else { continue };
            let Some(moved) = displacement(left, right, (x, y), aside) else { continue };
            let (moved, scale) = ([moved.0, moved.1].map(f64::from), self.scale as f64);
            self.found.push(CoarseMatch {
                at: [place(x as f64 + moved[0], width), place(y as f64 + moved[1], height)],
                moved_px: moved.map(|v| v * scale),
            });
        }
        &self.found
    }
}

/// Means of blocks of `scale` × `scale` pixels.
fn reduce(image: GreyView<'_>, scale: usize, width: usize, out: &mut [u8]) {
    let count = (scale * scale) as u32;
    for (y, row) in out.chunks_exact_mut(width).enumerate() {
        for (x, out) in row.iter_mut().enumerate() {
            let lines = (y * scale..(y + 1) * scale).map(|v| &image.row(v)[x * scale..(x + 1) * scale]);
            let sum: u32 = lines.flatten().map(|v| u32::from(*v)).sum();
            *out = ((sum + count / 2) / count) as u8;
        }
    }
}

/// The strongest corner of a cell.
fn strongest(
    image: GreyView<'_>,
    columns: std::ops::Range<usize>,
    lines: std::ops::Range<usize>,
) -> Option<(usize, usize)> {
    let mut best = (MIN_CORNER, None);
    for y in lines.step_by(2) {
        for x in columns.clone().step_by(2) {
            let corner = corner(image, x, y);
            if corner > best.0 {
                best = (corner, Some((x, y)));
            }
        }
    }
    best.1
}

/// Column and row of the only good match minus those of the corner, in reduced pixels.
fn displacement(
    left: GreyView<'_>,
    right: GreyView<'_>,
    (x, y): (usize, usize),
    aside: usize,
) -> Option<(i32, i32)> {
    let patch = Patch::new(left, x, y);
    let mut best = (f32::INFINITY, (0, 0));
    let mut second = f32::INFINITY;
    for v in y - REACH..=y + REACH {
        for u in x - aside..=x + aside {
            let difference = patch.difference(right, u, v);
            let is_near = |at: (usize, usize)| u.abs_diff(at.0) <= 2 && v.abs_diff(at.1) <= 2;
            if difference < best.0 {
                if !is_near(best.1) {
                    second = best.0;
                }
                best = (difference, (u, v));
            } else if difference < second && !is_near(best.1) {
                second = difference;
            }
        }
    }
    let (difference, (u, v)) = best;
    let is_inside = u.abs_diff(x) < aside && v.abs_diff(y) < REACH;
    let is_good = difference <= MAX_DIFFERENCE * patch.contrast() && difference <= MAX_RATIO * second;
    (is_inside && is_good).then_some((u as i32 - x as i32, v as i32 - y as i32))
}
