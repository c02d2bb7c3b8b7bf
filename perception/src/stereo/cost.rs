//! The matching cost: exact structural similarity (SSIM) combined with a truncated gradient difference
//! (paper, section 3.2).
//!
//! The paper's SSIM has three factors (luminance, contrast, structure). We use the separable form
//! of contrast × structure over windows of 5 × 5 pixels,
//!
//! ```text
//! s(p, d) = (cov + C) / √((varL + C)·(varR + C)),   C = (K₂·255)²/2,   |s| ≤ 1
//! ```
//!
//! because its denominator is a product of one factor per image, so the loop over disparities needs no
//! division. The luminance factor is omitted on purpose: two cameras differ in gain.
//! The cost is `38·(1 − s) + 2·min(|∂L − ∂R|, limit)`, rounded: 0 to 92 for a limit of 8.
//!
//! With N = 25 pixels, sums S over the window and 128 subtracted from the right image (which does not change
//! the covariance and keeps sums small), `N²·cov = N·ΣLR − S_L·S_R`, so that
//!
//! ```text
//! 38·s = (ΣLR + N·C)·g_L·g_R − m_L·m_R,   g = √(38·N)/√(N²·var + N²·C),   m = S·√38/√(N²·var + N²·C)
//! ```
//!
//! ΣLR is an exact integer. The rest is three products and a difference in single precision, in one
//! fixed order, so that all levels round identically. In a flat window both terms reach about 38/K₂² and
//! nearly cancel, so the error of the cost before rounding is at most 3·10⁻⁵/K₂² of a unit: 0.13 with the
//! default K₂. For every K₂ from 0.01 on the cost stays above −1, below which levels would differ.

use crate::image::GreyView;
use crate::simd::{CostConstants, CostRow, LANES, Lanes, Level, Packing, Simd, kernel};

/// Radius of the window: 5 × 5 pixels.
pub const RADIUS: usize = 2;
/// Rows of a strip, which are prepared together: one vector holds one column of a strip.
pub const STRIP: usize = LANES;

const SIZE: usize = 2 * RADIUS + 1;
const AREA: f32 = (SIZE * SIZE) as f32;
/// Half the range of the structure term.
const STRUCTURE: f32 = 38.0;
/// Rows of words for a strip, with the rows of the window above and below it.
const WORD_ROWS: usize = STRIP + 2 * RADIUS;
/// Columns beyond the last window that vector loads may touch.
const OVERRUN: usize = 16;

/// Subtracted from the grey values of the right image: they are then bytes with a sign.
const RIGHT_OFFSET: i32 = 128;

/// Default of [`CostParameters::k2`]: half of what SSIM has for judging images (Wang et al., 2004). Things that differ little from what is
/// behind them keep their edges, and near, textured scenes have fewer errors (docs/experiments.md).
pub const DEFAULT_K2: f64 = 0.015;

/// Parameters of the matching cost.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CostParameters {
    /// K₂ of SSIM: the contrast below which a window has little effect, as a share of 255; at least 0.01.
    pub k2: f32,
    /// Truncation of the gradient difference (Sobel/4: grey levels over two pixels); each level costs two
    /// units. 0 disables the gradient term.
    pub gradient_limit: u8,
}

impl Default for CostParameters {
    fn default() -> Self {
        Self { k2: DEFAULT_K2 as f32, gradient_limit: 8 }
    }
}

impl CostParameters {
    /// N·C, rounded to the integer that the kernels add.
    pub(super) fn bias(&self) -> i32 {
        (AREA * (self.k2.clamp(0.01, 1.0) * 255.0).powi(2) / 2.0).round() as i32
    }

    fn constants(&self) -> CostConstants {
        CostConstants {
            bias: self.bias(),
            middle: STRUCTURE + 0.5,
            right_offset: RIGHT_OFFSET,
            gradient_limit: self.gradient_limit,
        }
    }
}

/// Factors by which the norm of a window is multiplied: for the scale of the covariance and for the mean.
pub(super) fn factors() -> (f32, f32) {
    ((AREA * STRUCTURE).sqrt(), STRUCTURE.sqrt())
}

/// One image of a strip: its packed rows with replicated borders, and the window statistics.
#[derive(Debug)]
pub(crate) struct Plane {
    /// Border columns before pixel 0, not counting the radius of the window.
    lead: usize,
    /// Subtracted from each grey value in `words`.
    offset: i32,
    /// Columns of a row of words; statistics use the first `columns − 2·RADIUS − OVERRUN`.
    columns: usize,
    /// The strip's rows with borders: [`WORD_ROWS`] + 3 rows of `columns`.
    grey: Vec<u8>,
    words: Vec<u32>,
    /// One row in each word: the last row of a window.
    single: Vec<u32>,
    scale: Vec<f32>,
    mean: Vec<f32>,
    gradient: Vec<u8>,
    /// Column sums of the window's rows, and of their squares.
    sums: [Vec<i32>; 2],
}

impl Plane {
    fn new(lead: usize, offset: i32, width: usize) -> Self {
        let columns = lead + width.next_multiple_of(LANES) + 2 * RADIUS + OVERRUN;
        Self {
            lead,
            offset,
            columns,
            grey: vec![0; columns * (WORD_ROWS + 3)],
            words: vec![0; columns * WORD_ROWS],
            single: if offset == 0 { vec![0; columns * WORD_ROWS] } else { Vec::new() },
            scale: vec![0.0; columns * STRIP],
            mean: vec![0.0; columns * STRIP],
            gradient: vec![0; columns * STRIP],
            sums: [vec![0; columns], vec![0; columns]],
        }
    }

    fn bytes(&self) -> usize {
        self.grey.len()
            + self.gradient.len()
            + 4 * (self.words.len() + self.single.len() + self.scale.len() + self.mean.len())
            + 8 * self.columns
    }

    /// Copies the rows around the strip that starts at row `top` and replicates the borders.
    fn take(&mut self, image: GreyView<'_>, top: usize) {
        let last = image.height() - 1;
        for (i, row) in self.grey.chunks_exact_mut(self.columns).enumerate() {
            let source = image.row((top + i).saturating_sub(RADIUS).min(last));
            let before = (self.lead + RADIUS).min(row.len());
            row[..before].fill(source[0]);
            row[before..before + source.len()].copy_from_slice(source);
            row[before + source.len()..].fill(source[source.len() - 1]);
        }
    }

    fn row(&self, index: usize) -> CostRow<'_> {
        let words = |row: usize| &self.words[row * self.columns..(row + 1) * self.columns];
        let at = index * self.columns;
        let last = if self.single.is_empty() { &self.words } else { &self.single };
        let last = &last[(index + 4) * self.columns..(index + 5) * self.columns];
        CostRow {
            words: [words(index), words(index + 2), last],
            scale: &self.scale[at..at + self.columns],
            mean: &self.mean[at..at + self.columns],
            gradient: &self.gradient[at..at + self.columns],
        }
    }
}

/// Packs the rows of a plane into words.
#[inline(always)]
fn pack<S: Simd>(s: S, plane: &mut Plane) {
    let columns = plane.columns;
    let offset = plane.offset;
    let rows = |i: usize| &plane.grey[i * columns..(i + 1) * columns];
    for (i, words) in plane.words.chunks_exact_mut(columns).enumerate() {
        match S::PACKING {
            Packing::Pairs => {
                for ((word, &a), &b) in words.iter_mut().zip(rows(i)).zip(rows(i + 1)) {
                    let value = |v: u8| (i32::from(v) - offset) as u32 & 0xffff;
                    *word = value(a) | value(b) << 16;
                }
            }
            Packing::Quads | Packing::PlainQuads => {
                let offset = if S::PACKING == Packing::Quads { offset as u8 } else { 0 };
                s.interleave([rows(i), rows(i + 1), rows(i + 2), rows(i + 3)], offset, words);
            }
        }
    }
    if !plane.single.is_empty() {
        for (word, &v) in plane.single.iter_mut().zip(&plane.grey) {
            *word = u32::from(v);
        }
    }
}

/// Computes means, scales and gradients of a plane.
#[inline(always)]
fn statistics<S: Simd>(_: S, plane: &mut Plane, bias: i32) {
    let columns = plane.columns;
    let used = columns - 2 * RADIUS - OVERRUN;
    let [sums, squares] = &mut plane.sums;
    sums.fill(0);
    squares.fill(0);
    // The rows of the first window; later one row enters and one leaves.
    for row in plane.grey.chunks_exact(columns).take(SIZE) {
        slide(sums, squares, row, &[]);
    }
    let constant = SIZE as i32 * SIZE as i32 * bias;
    let (scale_factor, mean_factor) = factors();
    let shift = (SIZE * SIZE) as i32 * plane.offset;
    for y in 0..STRIP {
        if y > 0 {
            let row = |i: usize| &plane.grey[i * columns..(i + 1) * columns];
            slide(sums, squares, row(y + SIZE - 1), row(y - 1));
        }
        let scale = &mut plane.scale[y * columns..y * columns + used];
        let mean = &mut plane.mean[y * columns..y * columns + used];
        let (columns_1, columns_2) = (&sums[..used + SIZE - 1], &squares[..used + SIZE - 1]);
        for x in 0..used {
            let [mut total, mut squares] = [0; 2];
            for i in 0..SIZE {
                total += columns_1[x + i];
                squares += columns_2[x + i];
            }
            // N²·variance, exact: at most 25²·255²/4.
            let variance = (SIZE * SIZE) as i32 * squares - total * total;
            let norm = 1.0 / ((variance + constant) as f32).sqrt();
            scale[x] = norm * scale_factor;
            mean[x] = (total - shift) as f32 * (norm * mean_factor);
        }
        let row = |i: usize| &plane.grey[i * columns..(i + 1) * columns];
        let (above, here, below) = (row(y + RADIUS - 1), row(y + RADIUS), row(y + RADIUS + 1));
        let gradient = &mut plane.gradient[y * columns..y * columns + used];
        let (left, right) = (RADIUS - 1, RADIUS + 1);
        for x in 0..used {
            let d = |r: &[u8]| i32::from(r[x + right]) - i32::from(r[x + left]);
            gradient[x] = ((d(above) + 2 * d(here) + d(below)) / 4 + 128).clamp(0, 255) as u8;
        }
    }
}

/// Adds a row to the column sums and subtracts another; an empty row counts as zeros.
#[inline(always)]
fn slide(sums: &mut [i32], squares: &mut [i32], added: &[u8], removed: &[u8]) {
    if removed.is_empty() {
        for ((sum, square), &v) in sums.iter_mut().zip(squares).zip(added) {
            let v = i32::from(v);
            *sum += v;
            *square += v * v;
        }
        return;
    }
    for (((sum, square), &a), &r) in sums.iter_mut().zip(squares).zip(added).zip(removed) {
        let (a, r) = (i32::from(a), i32::from(r));
        *sum += a - r;
        *square += a * a - r * r;
    }
}

#[inline(always)]
fn prepare<S: Simd>(s: S, plane: &mut Plane, bias: i32) {
    pack(s, plane);
    statistics(s, plane, bias);
}

#[inline(always)]
fn score_tile<S: Simd>(
    s: S,
    strip: &CostStrip,
    x: usize,
    low: usize,
    n: usize,
    pitch: usize,
    out: &mut [Lanes],
) {
    let constants = strip.parameters.constants();
    for (y, out) in out.chunks_exact_mut(pitch).enumerate() {
        let (left, right) = (strip.left.row(y), strip.right.row(y));
        let left = CostRow {
            words: left.words.map(|w| &w[x..]),
            scale: &left.scale[x..],
            mean: &left.mean[x..],
            gradient: &left.gradient[x..],
        };
        s.score(&constants, &left, &right, x + strip.right.lead, low, &mut out[..n]);
    }
}

kernel! { fn prepare_plane(plane: &mut Plane, bias: i32) = prepare }
kernel! {
    /// Computes the costs of one tile.
    fn score_tile_at(strip: &CostStrip, x: usize, low: usize, n: usize, pitch: usize, out: &mut [Lanes])
        = score_tile
}

/// The costs of a strip of [`STRIP`] rows, with memory allocated once.
#[derive(Debug)]
pub struct CostStrip {
    parameters: CostParameters,
    level: Level,
    width: usize,
    left: Plane,
    right: Plane,
}

impl CostStrip {
    /// A workspace for images of `width` pixels and disparities below `disparities`.
    pub fn new(parameters: CostParameters, level: Level, width: usize, disparities: usize) -> Self {
        Self {
            parameters,
            level,
            width,
            left: Plane::new(0, 0, width),
            // A multiple of the vector length: remaining columns would be prepared one by one.
            right: Plane::new(disparities.next_multiple_of(LANES), RIGHT_OFFSET, width),
        }
    }

    /// Bytes of memory held.
    pub fn bytes(&self) -> usize {
        self.left.bytes() + self.right.bytes()
    }

    /// Prepares the strip of a pair that starts at row `top`. Rows below the image replicate its last row.
    ///
    /// # Panics
    /// If the images have another width than the workspace.
    pub fn start(&mut self, left: GreyView<'_>, right: GreyView<'_>, top: usize) {
        assert_eq!((left.width(), right.width()), (self.width, self.width));
        let bias = self.parameters.bias();
        self.left.take(left, top);
        self.right.take(right, top);
        prepare_plane(self.level, &mut self.left, bias);
        prepare_plane(self.level, &mut self.right, bias);
    }

    /// Writes the costs of the [`LANES`] columns from `x` on for `disparities` disparities from `low` on:
    /// row by row, `pitch` vectors apart, one vector for each disparity. Pixels that would lie left of the
    /// right image (x < d) are compared with its replicated border.
    ///
    /// # Panics
    /// If `out` does not have [`STRIP`] rows, or a disparity is outside the workspace's range.
    pub fn tile(&self, x: usize, low: usize, disparities: usize, pitch: usize, out: &mut [Lanes]) {
        assert!(disparities <= pitch);
        assert_eq!(out.len(), STRIP * pitch);
        assert!(low.checked_add(disparities).is_some_and(|end| end <= self.right.lead + 1));
        score_tile_at(self.level, self, x, low, disparities, pitch, out);
    }
}

/// Reference implementation of the cost of one node, computed directly from the images. Borders are
/// replicated; x − d may lie outside the image.
#[cfg(test)]
pub(super) fn reference_cost(
    parameters: CostParameters,
    left: GreyView<'_>,
    right: GreyView<'_>,
    x: usize,
    y: usize,
    d: usize,
) -> f64 {
    let at = |image: GreyView<'_>, x: i64, y: i64| {
        let x = x.clamp(0, image.width() as i64 - 1) as usize;
        f64::from(image.at(x, y.clamp(0, image.height() as i64 - 1) as usize))
    };
    let (x, y, d, r) = (x as i64, y as i64, d as i64, RADIUS as i64);
    let (mut n, mut sl, mut sr, mut sll, mut srr, mut slr) = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0);
    for dy in -r..=r {
        for dx in -r..=r {
            let (l, v) = (at(left, x + dx, y + dy), at(right, x + dx - d, y + dy));
            n += 1.0;
            sl += l;
            sr += v;
            sll += l * l;
            srr += v * v;
            slr += l * v;
        }
    }
    let constant = f64::from(parameters.bias()) / n;
    let (var_l, var_r) = (sll / n - (sl / n).powi(2), srr / n - (sr / n).powi(2));
    let covariance = slr / n - sl / n * (sr / n);
    let s = (covariance + constant) / ((var_l + constant) * (var_r + constant)).sqrt();
    let gradient = |image: GreyView<'_>, x: i64| {
        let d = |dy: i64| at(image, x + 1, y + dy) - at(image, x - 1, y + dy);
        (((d(-1) + 2.0 * d(0) + d(1)) / 4.0).trunc() + 128.0).clamp(0.0, 255.0)
    };
    let step = (gradient(left, x) - gradient(right, x - d)).abs();
    f64::from(STRUCTURE) * (1.0 - s) + 2.0 * step.min(f64::from(parameters.gradient_limit))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::GreyImage;

    fn ramps(width: usize, height: usize, random: &mut fastrand::Rng) -> GreyImage {
        // Smooth ramps with noise, so that similar and dissimilar windows both occur.
        let mut image = GreyImage::new(width, height);
        for (i, v) in image.as_mut_slice().iter_mut().enumerate() {
            *v = ((i % width * 3) as u8).wrapping_add(random.u8(..60));
        }
        image
    }

    #[test]
    fn costs_equal_the_reference_at_every_level() {
        for (width, height, disparities, seed) in
            [(1, 1, 1, 0), (40, 7, 16, 1), (33, 40, 40, 2), (64, 5, 200, 3), (20, 20, 5, 4)]
        {
            let mut random = fastrand::Rng::with_seed(seed);
            let (left, right) = (ramps(width, height, &mut random), ramps(width, height, &mut random));
            let parameters = CostParameters::default();
            let mut plain: Option<Vec<Lanes>> = None;
            for level in Level::available() {
                let mut strip = CostStrip::new(parameters, level, width, disparities);
                let mut all = Vec::new();
                for top in (0..height).step_by(STRIP) {
                    strip.start(left.view(), right.view(), top);
                    for x in (0..width).step_by(LANES) {
                        let low = disparities / 5;
                        let n = disparities - low;
                        let mut out = vec![Lanes::ZERO; STRIP * n];
                        strip.tile(x, low, n, n, &mut out);
                        for row in 0..STRIP.min(height - top) {
                            for lane in 0..LANES.min(width - x) {
                                for d in 0..n {
                                    let got = f64::from(out[row * n + d].0[lane]);
                                    let (y, x) = (top + row, x + lane);
                                    let expected =
                                        reference_cost(parameters, left.view(), right.view(), x, y, low + d);
                                    assert!(
                                        (got - expected).abs() <= 0.51,
                                        "({x}, {y}) d {}: {got}, expected {expected}, {}",
                                        low + d,
                                        level.name()
                                    );
                                }
                            }
                        }
                        all.extend(out);
                    }
                }
                match &plain {
                    None => plain = Some(all),
                    Some(plain) => assert!(*plain == all, "{} differs from plain", level.name()),
                }
            }
        }
    }

    #[test]
    fn saturated_flat_windows_stay_within_the_stated_error() {
        // The terms of the cost are largest here and nearly cancel.
        let mut left = GreyImage::new(40, 40);
        let mut right = GreyImage::new(40, 40);
        left.as_mut_slice().fill(255);
        right.as_mut_slice().fill(255);
        for image in [&mut left, &mut right] {
            image.as_mut_slice().iter_mut().step_by(7).for_each(|v| *v = 254);
        }
        let mut strip = CostStrip::new(CostParameters::default(), Level::best(), 40, 8);
        strip.start(left.view(), right.view(), 0);
        let mut out = vec![Lanes::ZERO; STRIP * 8];
        strip.tile(0, 0, 8, 8, &mut out);
        assert!(out.iter().flat_map(|l| l.0).all(|c| c <= 2), "flat windows look alike");
    }
}
