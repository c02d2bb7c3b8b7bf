//! Weighted gradients of eight rows of an image, summed vertically over the cells of the blocks that they belong to.

use super::{BINS, CELL};
use crate::image::GreyView;
use crate::simd::{Simd, kernel};

/// Columns that a kernel computes at once.
const LANE: usize = CELL;

/// OpenCV's polynomial of the arc tangent of a ratio from 0 to 1, in degrees; its error is below 0.02°.
const ARC_TANGENT: [f32; 4] = [57.283_627, -18.667_446, 8.914_001, -2.539_724_3];

/// Added to the divisor of the arc tangent, as OpenCV does: where nothing changes the orientation is 0.
const NOT_ZERO: f32 = f64::EPSILON as f32;

/// Bins in a degree: a half turn has [`BINS`].
const BINS_PER_DEGREE: f32 = BINS as f32 / 180.0;

/// Standard deviation of the Gaussian that weights the pixels of a block, in pixels: OpenCV's default.
const SIGMA_PX: f64 = 4.0;

/// Weights of the 16 rows (or columns) of a block for each of its two cells: bilinear interpolation between the cells'
/// centres, times the Gaussian around the block's centre. OpenCV's centre is pixel 8, not 7.5.
pub fn cell_weights() -> [[f32; 2 * CELL]; 2] {
    let weight = |cell: usize, i: usize| {
        let place = (i as f64 + 0.5) / CELL as f64 - 0.5;
        let away = i as f64 - CELL as f64;
        (1.0 - (place - cell as f64).abs()).max(0.0) * (-away * away / (2.0 * SIGMA_PX * SIGMA_PX)).exp()
    };
    [0, 1].map(|cell| std::array::from_fn(|i| weight(cell, i) as f32))
}

/// Index in an image of `len` pixels of a place that may lie outside: mirrored at the outermost pixels, which are not
/// repeated.
pub fn reflected(at: isize, len: usize) -> usize {
    if len < 2 {
        return 0;
    }
    let period = 2 * (len as isize - 1);
    let inside = at.rem_euclid(period);
    if inside < len as isize { inside as usize } else { (period - inside) as usize }
}

/// The square roots of the grey levels of the ten rows around a row of cells, and what follows from them.
#[derive(Debug, Default)]
pub struct CellRow {
    /// Ten rows of the cells' columns, with one column more on either side.
    roots: Vec<f32>,
    magnitude: Vec<f32>,
    orientation: Vec<f32>,
    weights: [[f32; 2 * CELL]; 2],
    columns: usize,
}

impl CellRow {
    /// Memory for rows of up to `columns` pixels.
    pub fn new(columns: usize) -> Self {
        Self {
            roots: vec![0.0; (CELL + 2) * (columns + 2)],
            magnitude: vec![0.0; CELL * columns],
            orientation: vec![0.0; CELL * columns],
            weights: cell_weights(),
            columns,
        }
    }

    /// Reads the rows around the cells that start at row `top`; `columns` is a multiple of the side of a cell. Place (0, 0)
    /// lies `padding` pixels to the left of the image and above it.
    ///
    /// # Panics
    /// If there are more columns than there is memory for.
    pub fn read(&mut self, image: GreyView<'_>, top: usize, columns: usize, padding: (usize, usize)) {
        self.columns = columns;
        let stride = columns + 2;
        for (i, roots) in self.roots[..(CELL + 2) * stride].chunks_exact_mut(stride).enumerate() {
            let y = (top + i) as isize - 1 - padding.1 as isize;
            let row = image.row(reflected(y, image.height()));
            let inner = padding.0 + 1;
            for (root, &value) in roots.iter_mut().skip(inner).zip(row) {
                *root = f32::from(value);
            }
            for x in (0..inner.min(stride)).chain(inner + row.len()..stride) {
                roots[x] = f32::from(row[reflected(x as isize - inner as isize, row.len())]);
            }
        }
    }

    /// Adds the rows to the sums of the blocks: `upper` are the sums of the blocks whose second cells these are and
    /// `lower`, which is overwritten, those of the blocks whose first cells these are. Sums of a row of blocks are, for
    /// each of the two cells one above the other, [`BINS`] rows of `columns` values.
    pub fn add(&mut self, level: crate::simd::Level, upper: &mut [f32], lower: &mut [f32]) {
        let columns = self.columns;
        gradients(level, &mut self.roots, columns, &mut self.magnitude, &mut self.orientation);
        sums(level, (&self.magnitude, &self.orientation), columns, &self.weights, upper, lower);
    }
}

kernel! {
    /// Magnitude and orientation, in bins, of the gradients of eight rows.
    fn gradients(roots: &mut [f32], columns: usize, magnitude: &mut [f32], orientation: &mut [f32]) = gradients_of
}

kernel! {
    /// Sums the gradients of eight rows by bin.
    fn sums(
        gradients: (&[f32], &[f32]),
        columns: usize,
        weights: &[[f32; 2 * CELL]; 2],
        upper: &mut [f32],
        lower: &mut [f32],
    ) = sums_of
}

#[inline(always)]
fn gradients_of<S: Simd>(
    _: S,
    roots: &mut [f32],
    columns: usize,
    magnitude: &mut [f32],
    orientation: &mut [f32],
) {
    let stride = columns + 2;
    let roots = &mut roots[..(CELL + 2) * stride];
    roots.iter_mut().for_each(|root| *root = root.sqrt());
    for row in 0..CELL {
        let above = &roots[row * stride + 1..][..columns];
        let left = &roots[(row + 1) * stride..][..columns];
        let right = &roots[(row + 1) * stride + 2..][..columns];
        let below = &roots[(row + 2) * stride + 1..][..columns];
        let magnitude = &mut magnitude[row * columns..][..columns];
        let orientation = &mut orientation[row * columns..][..columns];
        for x in 0..columns {
            let (dx, dy) = (right[x] - left[x], below[x] - above[x]);
            magnitude[x] = (dx * dx + dy * dy).sqrt();
            orientation[x] = bin_of(dx, dy);
        }
    }
}

/// Orientation of a gradient without its sign, in bins from −0.5 to 8.5.
#[inline(always)]
fn bin_of(dx: f32, dy: f32) -> f32 {
    let (across, down) = (dx.abs(), dy.abs());
    let is_steep = across < down;
    let (small, large) = if is_steep { (across, down) } else { (down, across) };
    let ratio = small / (large + NOT_ZERO);
    let square = ratio * ratio;
    let [p1, p3, p5, p7] = ARC_TANGENT;
    let angle = (((p7 * square + p5) * square + p3) * square + p1) * ratio;
    let angle = if is_steep { 90.0 - angle } else { angle };
    // A half turn is the same orientation.
    let angle = if (dx < 0.0) == (dy < 0.0) { angle } else { 180.0 - angle };
    angle * BINS_PER_DEGREE - 0.5
}

/// The values of a lane.
#[inline(always)]
fn lane(values: &[f32], at: usize) -> [f32; LANE] {
    let values = &values[at..at + LANE];
    std::array::from_fn(|i| values[i])
}

#[inline(always)]
fn sums_of<S: Simd>(
    _: S,
    (magnitude, orientation): (&[f32], &[f32]),
    columns: usize,
    weights: &[[f32; 2 * CELL]; 2],
    upper: &mut [f32],
    lower: &mut [f32],
) {
    for x in (0..columns).step_by(LANE) {
        let rows: [([f32; LANE], [f32; LANE]); CELL] = std::array::from_fn(|row| {
            let at = row * columns + x;
            (lane(magnitude, at), lane(orientation, at))
        });
        for bin in 0..BINS {
            // Of the upper blocks both cells, then of the lower ones.
            let mut parts = [[0.0_f32; LANE]; 4];
            for (row, (magnitude, orientation)) in rows.iter().enumerate() {
                let factors =
                    [weights[0][CELL + row], weights[1][CELL + row], weights[0][row], weights[1][row]];
                let mut share = [0.0_f32; LANE];
                for i in 0..LANE {
                    let away = (orientation[i] - bin as f32).abs();
                    // The bins are a circle.
                    let away = if away > BINS as f32 - away { BINS as f32 - away } else { away };
                    let part = 1.0 - away;
                    share[i] = if part > 0.0 { part * magnitude[i] } else { 0.0 };
                }
                for (part, factor) in parts.iter_mut().zip(factors) {
                    for i in 0..LANE {
                        part[i] += share[i] * factor;
                    }
                }
            }
            for cell in 0..2 {
                let at = (cell * BINS + bin) * columns + x;
                for (sum, part) in upper[at..at + LANE].iter_mut().zip(&parts[cell]) {
                    *sum += part;
                }
                lower[at..at + LANE].copy_from_slice(&parts[2 + cell]);
            }
        }
    }
}
