//! Photometric residual of the road: difference of the right image from the left one where both should show
//! the road.
//!
//! The right image is warped onto the left one by the disparity of the road. Whatever lies on the road, such
//! as markings, then agrees. An obstacle is offset by δ px, its disparity minus that of the road. With the
//! horizontal gradient g and the difference r of both images, r ≈ δ·g, and over a window δ = Σ g·r / Σ g².
//! This resolves finer detail than a disparity map, whose windows and paths blur objects of a few pixels into
//! the road.

use crate::image::GreyView;
use crate::rig::Rig;
use crate::road::tilt::Tilt;
use crate::simd::rounding::nearest;
use crate::simd::{Level, Simd, kernel};

/// Limit of gradients and differences, in half grey levels; keeps window sums within 32 bits.
const MAX_VALUE: f32 = 254.0;
/// Columns left out at either border of a row, for interpolation and gradient.
const BORDER_COLUMNS: f32 = 3.0;
/// Sampling step of the gain estimate: rows, columns.
const GAIN_STEP: (usize, usize) = (4, 8);
/// Largest ratio of brightness between both images.
const MAX_GAIN: f32 = 2.0;

/// Geometry of the road in both images.
#[derive(Clone, Copy, Debug)]
pub struct RoadGeometry<'a> {
    /// Disparity of the road in each row, in px.
    pub profile_px: &'a [f32],
    /// Lateral tilt of the road.
    pub tilt: Tilt,
    /// The cameras.
    pub rig: Rig,
}

impl RoadGeometry<'_> {
    /// Disparity of the road at a pixel, in px.
    pub fn disparity_px(&self, x: f64, y: usize) -> f64 {
        f64::from(self.profile_px[y]) + self.tilt.roll * (x - self.tilt.cx_px) + self.tilt.offset_px
    }

    /// Lateral position of a pixel on the road, in metres right of the camera.
    pub fn lateral_m(&self, x: f64, y: usize) -> f64 {
        (x - self.rig.cx_px) * self.rig.baseline_m / f64::from(self.profile_px[y]).max(1e-3)
    }

    /// Change of the disparity per row downwards, in px.
    pub fn slope(&self, y: usize) -> f64 {
        let (above, below) = (y.saturating_sub(2), (y + 2).min(self.profile_px.len() - 1));
        f64::from(self.profile_px[below] - self.profile_px[above]) / (below - above).max(1) as f64
    }

    /// Columns of a row within `half_m` metres of the camera axis that are visible in both images.
    fn columns(&self, y: usize, half_m: f64, width: usize) -> std::ops::Range<usize> {
        let profile_px = f64::from(self.profile_px[y]);
        let half = half_m * profile_px / self.rig.baseline_m;
        let hidden = self.disparity_px(0.0, y).max(0.0) / (1.0 - self.tilt.roll) + f64::from(BORDER_COLUMNS);
        let from = (self.rig.cx_px - half).max(hidden).ceil().max(f64::from(BORDER_COLUMNS)) as usize;
        let from = from.min(width);
        let to = (self.rig.cx_px + half).min(width as f64 - f64::from(BORDER_COLUMNS)).max(0.0) as usize;
        from..to.max(from)
    }
}

/// Sums over a window, in squared grey levels.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Sums {
    /// Σ g².
    pub gradient: f64,
    /// Σ g·r.
    pub product: f64,
    /// Σ r².
    pub difference: f64,
    /// Number of pixels.
    pub count: f64,
}

impl Sums {
    /// Sums of this window without those of another window inside it.
    pub fn minus(self, other: Sums) -> Sums {
        Sums {
            gradient: self.gradient - other.gradient,
            product: self.product - other.product,
            difference: self.difference - other.difference,
            count: self.count - other.count,
        }
    }

    /// Sums for a road whose disparity is larger by `offset_px`.
    pub fn with_offset(self, offset_px: f64) -> Sums {
        Sums { product: self.product - offset_px * self.gradient, ..self }
    }

    /// Estimate of δ in px, for pixel noise `sigma`; shrunk towards 0 by a Gaussian prior with standard
    /// deviation `prior_px`.
    pub fn offset_px(&self, sigma: f64, prior_px: f64) -> f64 {
        self.product / (self.gradient + (sigma / prior_px).powi(2))
    }

    /// δ in standard deviations, for pixel noise `sigma`.
    pub fn prominence(&self, sigma: f64) -> f64 {
        self.product / (self.gradient.sqrt() + 1e-3) / sigma
    }
}

/// A window: left, top, right, bottom; right and bottom are exclusive. It may extend beyond the image.
pub type Window = [i32; 4];

/// Residual of an image pair as a summed-area table; memory is allocated once.
#[derive(Debug)]
pub struct Residual {
    width: usize,
    height: usize,
    /// First row with data.
    first_row: usize,
    /// Summed-area table of g², g·r, r² and pixel counts, modulo 2³².
    sums: Vec<[u32; 4]>,
    /// Range of valid columns of each row of `sums`; all data up to that row lies within it.
    valid_columns: Vec<[u32; 2]>,
    /// A row of the right image, warped.
    warped: Vec<f32>,
    gain: f32,
    level: Level,
}

impl Residual {
    /// A workspace for images of `width` × `height`.
    pub fn new(width: usize, height: usize) -> Self {
        Self {
            width,
            height,
            first_row: height,
            sums: vec![[0; 4]; (width + 1) * (height + 1)],
            valid_columns: vec![[0; 2]; height + 1],
            warped: vec![0.0; width],
            gain: 1.0,
            level: Level::best(),
        }
    }

    /// Gain that adapts the brightness of the right image to the left one.
    pub fn gain(&self) -> f32 {
        self.gain
    }

    /// Computes the residual of a pair from row `first` on, within `half_m` metres on each side of the
    /// camera.
    ///
    /// # Panics
    /// When the size of the images differs from that of the workspace.
    pub fn fill(
        &mut self,
        [left, right]: [GreyView<'_>; 2],
        road: &RoadGeometry<'_>,
        first: usize,
        half_m: f64,
    ) {
        let size = (self.width, self.height);
        assert!((left.width(), left.height()) == size && (right.width(), right.height()) == size);
        self.first_row = first.min(self.height);
        let rows = self.first_row..self.height;
        let mut brightness = [1_u64; 2];
        for y in rows.clone().step_by(GAIN_STEP.0) {
            for x in road.columns(y, half_m, self.width).step_by(GAIN_STEP.1) {
                let right_x = (x as f64 - road.disparity_px(x as f64, y)).clamp(0.0, (self.width - 1) as f64);
                brightness[0] += u64::from(left.row(y)[x]);
                brightness[1] += u64::from(right.row(y)[right_x as usize]);
            }
        }
        let gain = brightness[0] as f32 / brightness[1] as f32;
        self.gain = gain.clamp(1.0 / MAX_GAIN, MAX_GAIN);
        let pitch = self.width + 1;
        // There is no data above the first row: one column of its corridor is enough.
        let [mut from, mut to] =
            [road.columns(self.first_row.min(self.height - 1), half_m, self.width).start; 2];
        self.sums[self.first_row * pitch + from] = [0; 4];
        self.valid_columns[self.first_row] = [from as u32; 2];
        for y in rows {
            let columns = road.columns(y, half_m, self.width);
            let (above, here) = self.sums[y * pitch..].split_at_mut(pitch);
            if columns.is_empty() {
                here[from..=to].copy_from_slice(&above[from..=to]);
                self.valid_columns[y + 1] = self.valid_columns[y];
                continue;
            }
            let (first, last) = (columns.start, columns.end);
            // Extend the valid range of the row above; there is no data in the new columns.
            if first < from {
                above[first..from].fill([0; 4]);
            }
            if last > to {
                let whole = above[to];
                above[to + 1..=last].fill(whole);
            }
            (from, to) = (from.min(first), to.max(last));
            self.valid_columns[y + 1] = [from as u32, to as u32];
            let start = first as f64;
            let mapping = RowMapping {
                at: (start - road.disparity_px(start, y)) as f32,
                step: (1.0 - road.tilt.roll) as f32,
                gain: self.gain,
            };
            here[from..=first].copy_from_slice(&above[from..=first]);
            let warped = &mut self.warped[columns.clone()];
            let row = &left.row(y)[columns];
            let sums = (&above[first..=last], &mut here[first..=last]);
            accumulate_row(self.level, right.row(y), mapping, row, warped, sums.0, sums.1);
            let sum = subtract(here[last], above[last]);
            for (here, above) in here[last + 1..=to].iter_mut().zip(&above[last + 1..=to]) {
                *here = add(*above, sum);
            }
        }
    }

    /// Sums over a window.
    pub fn sums(&self, [left, top, right, bottom]: Window) -> Sums {
        self.band(top, bottom).sums(left, right)
    }

    /// Rows from `top` to before `bottom`, for queries of many windows.
    pub fn band(&self, top: i32, bottom: i32) -> Band<'_> {
        let edge = |y: i32| {
            let y = y.clamp(self.first_row as i32, self.height as i32) as usize;
            let [from, to] = self.valid_columns[y];
            Edge {
                from: from as i32,
                to: to as i32,
                sums: &self.sums[y * (self.width + 1)..][..self.width + 1],
            }
        };
        Band { top: edge(top), bottom: edge(bottom) }
    }
}

/// One row of the summed-area table.
#[derive(Clone, Copy, Debug)]
struct Edge<'a> {
    from: i32,
    to: i32,
    sums: &'a [[u32; 4]],
}

impl Edge<'_> {
    #[inline(always)]
    fn at(&self, x: i32) -> [u32; 4] {
        self.sums[x.clamp(self.from, self.to) as usize]
    }
}

/// A range of rows of the residual.
#[derive(Clone, Copy, Debug)]
pub struct Band<'a> {
    top: Edge<'a>,
    bottom: Edge<'a>,
}

impl Band<'_> {
    /// Sums over the columns from `left` to before `right`.
    #[inline]
    pub fn sums(&self, left: i32, right: i32) -> Sums {
        let [gradient, product, difference, count] = self.window_sum(left, right);
        Sums {
            gradient: 0.25 * f64::from(gradient),
            product: 0.25 * f64::from(product as i32),
            difference: 0.25 * f64::from(difference),
            count: f64::from(count),
        }
    }

    /// Fast test whether the prominence at a noise of 1 may reach `min_prominence`.
    #[inline]
    pub fn may_be_prominent(&self, left: i32, right: i32, min_prominence: f64) -> bool {
        let [gradient, product, ..] = self.window_sum(left, right);
        let product = f64::from(product as i32);
        // Both are in quarter units.
        product * product > 4.0 * min_prominence * min_prominence * f64::from(gradient)
    }

    #[inline(always)]
    fn window_sum(&self, left: i32, right: i32) -> [u32; 4] {
        subtract(
            subtract(self.bottom.at(right), self.top.at(right)),
            subtract(self.bottom.at(left), self.top.at(left)),
        )
    }
}

fn add(a: [u32; 4], b: [u32; 4]) -> [u32; 4] {
    std::array::from_fn(|k| a[k].wrapping_add(b[k]))
}

fn subtract(a: [u32; 4], b: [u32; 4]) -> [u32; 4] {
    std::array::from_fn(|k| a[k].wrapping_sub(b[k]))
}

/// Position of the pixels of a row in the right image: first column, step per pixel, gain.
#[derive(Clone, Copy, Debug)]
struct RowMapping {
    at: f32,
    step: f32,
    gain: f32,
}

kernel! {
    /// Warps a row of the right image to the left one (`row`) by the road's disparity and adds g², g·r, r²
    /// and pixel counts to the summed-area table; `above` and `here` start one column before the row.
    fn accumulate_row(
        right: &[u8],
        mapping: RowMapping,
        row: &[u8],
        warped: &mut [f32],
        above: &[[u32; 4]],
        here: &mut [[u32; 4]],
    ) = accumulate_row_each
}

/// Columns that are warped as one block.
const BLOCK: usize = 32;

#[inline(always)]
fn accumulate_row_each<S: Simd>(
    _: S,
    right: &[u8],
    mapping: RowMapping,
    row: &[u8],
    warped: &mut [f32],
    above: &[[u32; 4]],
    here: &mut [[u32; 4]],
) {
    // Converted to i32 first: not every level can vectorise the conversion from usize to float.
    let position = |k: usize| mapping.at + mapping.step * (k as i32) as f32;
    for (block, warped) in warped.chunks_mut(BLOCK).enumerate() {
        let (from, to) = (block * BLOCK, block * BLOCK + warped.len());
        let whole = position(from).floor();
        let last = position(to - 1) - (to - 1 - from) as f32 - whole;
        let taps = usize::try_from(whole as isize - 1).ok().and_then(|i| right.get(i..i + warped.len() + 3));
        match taps {
            // All pixels of the block lie between the same neighbours.
            Some(taps) if (0.0..1.0).contains(&last) => {
                for (k, (warped, taps)) in warped.iter_mut().zip(taps.windows(4)).enumerate() {
                    let t = position(from + k) - (whole + (k as i32) as f32);
                    *warped = mapping.gain * cubic([0, 1, 2, 3].map(|i| f32::from(taps[i])), t);
                }
            }
            _ => {
                for (k, warped) in warped.iter_mut().enumerate() {
                    *warped = mapping.gain * sample(right, position(from + k));
                }
            }
        }
    }
    let mut sum = [0_u32; 4];
    let (above, here) = (&above[1..], &mut here[1..]);
    if let (Some(first), Some(above)) = (here.first_mut(), above.first()) {
        *first = *above;
    }
    let inner = row.len().saturating_sub(2);
    let blocks = above[1..][..inner].chunks(BLOCK).zip(here[1..][..inner].chunks_mut(BLOCK));
    for (block, (above, here)) in blocks.enumerate() {
        // Products are vectorised; the prefix sum is sequential.
        let mut terms = [[0_i32; 4]; BLOCK];
        let from = block * BLOCK;
        let (row, warped) = (&row[from..][..above.len() + 2], &warped[from..][..above.len() + 2]);
        for ((row, warped), term) in row.windows(3).zip(warped.windows(3)).zip(&mut terms) {
            let grey = |i: usize| f32::from(row[i]);
            let gradient = 0.5 * (grey(2) - grey(0) + warped[2] - warped[0]);
            let difference = 2.0 * (warped[1] - grey(1));
            // This form of the comparison maps NaN to the lower limit.
            let whole = |v: f32| {
                let v = if v > -MAX_VALUE { v } else { -MAX_VALUE };
                nearest(if v < MAX_VALUE { v } else { MAX_VALUE })
            };
            let (g, r) = (whole(gradient), whole(difference));
            *term = [g * g, g * r, r * r, 1];
        }
        for ((term, above), here) in terms.iter().zip(above).zip(here) {
            sum = add(sum, term.map(|v| v as u32));
            *here = add(*above, sum);
        }
    }
    if row.len() > 1 {
        here[row.len() - 1] = add(above[row.len() - 1], sum);
    }
}

/// Grey value between the pixels of a row by Catmull-Rom interpolation; linear interpolation would blur and
/// thereby add to r. Values beyond the ends of the row repeat the border pixel.
pub fn sample(row: &[u8], at: f32) -> f32 {
    let last = row.len() as isize - 1;
    let whole = at.floor();
    let t = at - whole;
    let i = whole as isize;
    let [a, b, c, d] = match usize::try_from(i - 1).ok().and_then(|i| row.get(i..i + 4)) {
        Some(&[a, b, c, d]) => [a, b, c, d],
        _ => [-1, 0, 1, 2].map(|k| row[(i + k).clamp(0, last) as usize]),
    }
    .map(f32::from);
    cubic([a, b, c, d], t)
}

#[inline(always)]
fn cubic([a, b, c, d]: [f32; 4], t: f32) -> f32 {
    b + 0.5 * t * (c - a + t * (2.0 * a - 5.0 * b + 4.0 * c - d + t * (3.0 * (b - c) + d - a)))
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIZE: (usize, usize) = (64, 40);
    const RIG: Rig = Rig { focal_px: 100.0, baseline_m: 0.2, cx_px: 30.0, cy_px: 0.0 };

    fn view(data: &[u8]) -> GreyView<'_> {
        GreyView::new(data, SIZE.0, SIZE.1, SIZE.0).unwrap()
    }

    fn noise(seed: u64) -> Vec<u8> {
        let mut random = fastrand::Rng::with_seed(seed);
        (0..SIZE.0 * SIZE.1).map(|_| random.u8(..)).collect()
    }

    #[test]
    fn interpolation_is_exact_for_parabolas_and_stays_in_the_row() {
        let row: Vec<u8> = (0..12).map(|x| (x * x + 3) as u8).collect();
        for at in [1.0, 1.5, 4.25, 8.9_f32] {
            assert!((sample(&row, at) - (at * at + 3.0)).abs() < 1e-4, "{at}");
        }
        for at in [-1e9, -0.5, 11.5, 1e9, f32::NAN] {
            let value = sample(&row, at);
            assert!(value.is_nan() || value.abs() < 1e30, "{at}: {value}");
        }
    }

    #[test]
    fn window_sums_equal_the_reference() {
        window_sum(|y| 0.2 * y as f32);
        // The corridor moves sideways to columns without data in earlier rows, and back.
        window_sum(|y| if (20..30).contains(&y) { 50.0 } else { 4.0 + (y / 30) as f32 });
    }

    fn window_sum(road_px: impl Fn(usize) -> f32) {
        let (left, right) = (noise(1), noise(2));
        let profile: Vec<f32> = (0..SIZE.1).map(road_px).collect();
        let tilt = Tilt { roll: 0.01, offset_px: 0.1, cx_px: 30.0 };
        let road = RoadGeometry { profile_px: &profile, tilt, rig: RIG };
        let mut residual = Residual::new(SIZE.0, SIZE.1);
        // Twice: no data of the previous pair may remain.
        residual.fill([view(&right), view(&left)], &road, 3, 5.0);
        residual.fill([view(&left), view(&right)], &road, 10, 0.9);
        let warped = |x: usize, y: usize| {
            let at = x as f64 - road.disparity_px(x as f64, y);
            residual.gain() * sample(view(&right).row(y), at as f32)
        };
        for window in [[20, 12, 40, 30], [0, 0, 64, 40], [-5, 25, 33, 60], [31, 33, 32, 34], [9, 9, 9, 9]] {
            let mut sums = Sums::default();
            for y in window[1].max(10)..window[3].min(SIZE.1 as i32) {
                let columns = road.columns(y as usize, 0.9, SIZE.0);
                for x in window[0].max(0) as usize..window[2].min(SIZE.0 as i32) as usize {
                    if x > columns.start && x + 1 < columns.end {
                        let row = view(&left).row(y as usize);
                        let grey = |x: usize| f32::from(row[x]);
                        let next = [x + 1, x - 1].map(|x| grey(x) + warped(x, y as usize));
                        let half = |v: f32| f64::from((2.0 * v).round_ties_even().clamp(-254.0, 254.0)) / 2.0;
                        let (g, r) = (half((next[0] - next[1]) / 4.0), half(warped(x, y as usize) - grey(x)));
                        sums.gradient += g * g;
                        sums.product += g * r;
                        sums.difference += r * r;
                        sums.count += 1.0;
                    }
                }
            }
            let given = residual.sums(window);
            assert_eq!(given.count, sums.count);
            // Rounding of an interpolated grey value may differ.
            let near = |a: f64, b: f64| (a - b).abs() <= 130.0 + 1e-3 * b.abs();
            assert!(near(given.gradient, sums.gradient), "{given:?} {sums:?}");
            assert!(near(given.product, sums.product), "{given:?} {sums:?}");
            assert!(near(given.difference, sums.difference), "{given:?} {sums:?}");
        }
        assert!(residual.sums([0, 0, 64, 40]).count > 500.0);
    }

    #[test]
    fn all_levels_give_the_same_sums() {
        let (left, right) = (noise(5), noise(6));
        let profile: Vec<f32> = (0..SIZE.1).map(|y| 0.2 * y as f32 - 1.0).collect();
        for roll in [0.0, 0.02, -0.05] {
            let tilt = Tilt { roll, offset_px: 0.3, cx_px: 30.0 };
            let road = RoadGeometry { profile_px: &profile, tilt, rig: RIG };
            let all: Vec<_> = Level::available()
                .into_iter()
                .map(|level| {
                    let mut residual = Residual { level, ..Residual::new(SIZE.0, SIZE.1) };
                    residual.fill([view(&left), view(&right)], &road, 2, 5.0);
                    residual.sums
                })
                .collect();
            assert!(all.iter().all(|sums| *sums == all[0]), "roll {roll}");
            assert!(all[0].iter().any(|sum| sum[0] > 0));
        }
    }

    #[test]
    fn an_offset_is_measured_to_a_fraction_of_a_pixel() {
        // Both images show a sine wave; the right one is darker, and the road is 0.25 px nearer than assumed.
        let wave = |x: f64| 120.0 + 60.0 * (0.7 * x).sin();
        let profile = [4.0_f32; SIZE.1];
        let images = [0.0, 4.25].map(|d| {
            let gain = if d > 0.0 { 0.9 } else { 1.0 };
            let grey = |i: usize| (gain * wave((i % SIZE.0) as f64 + d)).round() as u8;
            (0..SIZE.0 * SIZE.1).map(grey).collect::<Vec<u8>>()
        });
        let road = RoadGeometry { profile_px: &profile, tilt: Tilt::default(), rig: RIG };
        let mut residual = Residual::new(SIZE.0, SIZE.1);
        residual.fill([view(&images[0]), view(&images[1])], &road, 0, 10.0);
        let sums = residual.sums([10, 5, 50, 30]);
        assert!((sums.offset_px(1.0, 1.0) - 0.25).abs() < 0.03, "{sums:?}");
        assert!(sums.with_offset(0.25).offset_px(1.0, 1.0).abs() < 0.03);
        // The gain is estimated from different parts of the wave.
        assert!((residual.gain() - 1.0 / 0.9).abs() < 0.05, "{}", residual.gain());
    }

    #[test]
    fn the_fast_prominence_test_rejects_nothing_prominent() {
        let (left, right) = (noise(3), noise(4));
        let profile: Vec<f32> = (0..SIZE.1).map(|y| 0.2 * y as f32).collect();
        let road = RoadGeometry { profile_px: &profile, tilt: Tilt::default(), rig: RIG };
        let mut residual = Residual::new(SIZE.0, SIZE.1);
        residual.fill([view(&left), view(&right)], &road, 5, 5.0);
        let mut random = fastrand::Rng::with_seed(1);
        let (mut prominent, mut quickly) = (0, 0);
        for _ in 0..4000 {
            let [x, y] = [random.i32(-5..60), random.i32(0..38)];
            let (right, bottom) = (x + random.i32(1..12), y + random.i32(1..12));
            let is = residual.sums([x, y, right, bottom]).prominence(1.0).abs() >= 30.0;
            let may = residual.band(y, bottom).may_be_prominent(x, right, 30.0);
            assert!(may || !is, "{:?}", [x, y, right, bottom]);
            (prominent, quickly) = (prominent + usize::from(is), quickly + usize::from(!may));
        }
        assert!(prominent > 100 && quickly > 100, "{prominent} {quickly}");
    }
}
