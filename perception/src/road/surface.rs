//! Road surface of one frame: profile, lateral tilt and disparity noise. Heights are measured relative to it.

use super::heights::{self, BATCH, HeightReference, PixelBatch};
use super::profile::RoadProfile;
use super::samples::{ResidualBins, Samples};
use super::tilt::Tilt;
use crate::depth::DepthView;
use crate::rig::Rig;
use crate::simd::{Level, Simd, kernel};
use nalgebra::{Matrix2, Vector2};

/// Table entries per px of disparity.
const ENTRIES_PER_PX: usize = 16;
/// Rows between those that are used for tilt and noise.
const ROW_STEP: usize = 4;
/// Inlier limits of the tilt fit in successive iterations, in px.
const TILT_INLIERS_PX: [f64; 3] = [2.0, 1.0, 0.6];
/// Smallest and largest disparity noise, in px.
const NOISE_PX: (f64, f64) = (0.06, 1.0);
/// Histogram bins of absolute residuals for the noise estimate; they cover 2 px.
const NOISE_BINS: u8 = 128;

/// Largest difference between a row's own disparity and the profile, in px.
const MAX_ROW_OFFSET_PX: f64 = 0.5;
/// Histogram bins of residuals in a row, and the half-width of the window around the mode.
const ROW_BINS: u8 = 40;
const ROW_WINDOW_BINS: usize = 3;
/// Fewest pixels for a row's own disparity, and the share of them that must lie in the window.
const MIN_ROW_PIXELS: u32 = 12;
const MIN_ROW_SHARE: f64 = 0.35;

/// The road surface; memory is allocated once.
#[derive(Clone, Debug)]
pub struct RoadSurface {
    /// Disparity that each image row of the road actually shows at the principal column, in px.
    row_disparity_px: Vec<f32>,
    /// Row of the road for each disparity.
    rows: Vec<f32>,
    /// Rows per px of disparity, around each disparity.
    rows_per_px: Vec<f64>,
    /// A line (row at 0 px, rows per px of disparity) that lies above all rows of the road.
    upper_line: [f64; 2],
    tilt: Tilt,
    rig: Rig,
    noise_px: f64,
    samples: Samples,
    level: Level,
}

impl RoadSurface {
    /// A surface without a road, for maps of `width` × `height` with disparities below `disparities` px.
    pub fn new(rig: Rig, width: usize, height: usize, disparities: usize) -> Self {
        Self {
            row_disparity_px: vec![0.0; height],
            rows: vec![f32::NAN; disparities * ENTRIES_PER_PX + 2],
            rows_per_px: vec![f64::NAN; disparities * ENTRIES_PER_PX + 2],
            upper_line: [f64::NAN; 2],
            tilt: Tilt::default(),
            rig,
            noise_px: NOISE_PX.0,
            samples: Samples::new(width, height),
            level: Level::best(),
        }
    }

    /// Lateral tilt of the road.
    pub fn tilt(&self) -> Tilt {
        self.tilt
    }

    /// Standard deviation of the road's disparity in this frame, in px.
    pub fn noise_px(&self) -> f64 {
        self.noise_px
    }

    /// Updates the surface from the profile of a frame. Tilt and noise are measured from pixels with at least
    /// `min_confidence`.
    ///
    /// # Panics
    /// When the size of the map differs from that of the surface.
    pub fn update(&mut self, profile: &RoadProfile, depth: DepthView<'_>, min_confidence: u8) {
        for (i, row) in self.rows.iter_mut().enumerate() {
            *row = profile.row_at(i as f32 / ENTRIES_PER_PX as f32).unwrap_or(f32::NAN);
        }
        self.update_row_slopes();
        self.samples.update(depth, profile.top(), min_confidence);
        self.tilt = self.measure_tilt(profile);
        self.measure_noise(profile);
        self.measure_row_disparities(profile);
    }

    /// Computes the values that depend on `rows` only.
    fn update_row_slopes(&mut self) {
        let (reach, last) = (ENTRIES_PER_PX / 2, self.rows.len() - 1);
        for (entry, out) in self.rows_per_px.iter_mut().enumerate() {
            let (below, above) = (entry.saturating_sub(reach), (entry + reach).min(last));
            let rows = f64::from(self.rows[above] - self.rows[below]);
            *out = rows * ENTRIES_PER_PX as f64 / (above - below).max(1) as f64;
        }
        let per_place = f64::from(self.rows[last] - self.rows[0]) / last as f64;
        let at_0 = self.rows.iter().enumerate().map(|(i, &row)| f64::from(row) - per_place * i as f64);
        self.upper_line = [at_0.fold(f64::INFINITY, f64::min), per_place * ENTRIES_PER_PX as f64];
    }

    /// Fits the lateral tilt to the residuals of the profile.
    fn measure_tilt(&self, profile: &RoadProfile) -> Tilt {
        let level = Tilt { cx_px: self.rig.cx_px, ..Tilt::default() };
        let road_px = profile.disparity_px();
        let mut tilt = level;
        for tolerance_px in TILT_INLIERS_PX {
            let rows = (profile.top()..road_px.len()).step_by(ROW_STEP);
            let sums = self.samples.moments(rows, road_px, tilt, tolerance_px);
            let normal = Matrix2::new(sums.square, sums.across, sums.across, sums.count);
            // Too few samples for a fit: no tilt.
            tilt = match normal.cholesky() {
                Some(solver) if sums.count > 50.0 => {
                    let fit = solver.solve(&Vector2::new(sums.product, sums.residual));
                    Tilt { roll: fit[0], offset_px: fit[1], ..level }
                }
                _ => level,
            };
        }
        // A larger tilt (about 10 degrees on a car) is a wall, not camera roll.
        if tilt.roll.abs() <= 0.06 && tilt.offset_px.abs() <= 3.0 { tilt } else { level }
    }

    /// Standard deviation of the road's disparity, from the median absolute residual.
    fn measure_noise(&mut self, profile: &RoadProfile) {
        let per_px = 0.5 * f64::from(NOISE_BINS);
        let bins = ResidualBins { start_px: 0.0, absolute: true, bins_per_px: per_px, count: NOISE_BINS };
        let mut counts = [0; NOISE_BINS as usize];
        for y in (profile.top()..profile.disparity_px().len()).step_by(ROW_STEP) {
            let road = f64::from(profile.disparity_px()[y]);
            self.samples.count_residuals(y, road, self.tilt, bins, &mut counts);
        }
        let half = counts.iter().sum::<u32>() / 2;
        let mut seen = 0;
        let median = counts.iter().position(|&n| {
            seen += n;
            seen > half
        });
        let median = (median.unwrap_or(0) as f64 + 0.5) / per_px;
        self.noise_px = (1.4826 * median).clamp(NOISE_PX.0, NOISE_PX.1);
    }

    /// Measures the disparity that most of the road in a row shows. A matcher renders a road that is seen at
    /// a shallow angle as steps, which lie in the same rows across the image. A pixel at the disparity of its
    /// row is therefore no obstacle.
    fn measure_row_disparities(&mut self, profile: &RoadProfile) {
        const COUNT: usize = ROW_BINS as usize;
        let scale = f64::from(ROW_BINS) / (2.0 * MAX_ROW_OFFSET_PX);
        let bins = ResidualBins {
            start_px: -MAX_ROW_OFFSET_PX,
            absolute: false,
            bins_per_px: scale,
            count: ROW_BINS,
        };
        self.row_disparity_px.copy_from_slice(profile.disparity_px());
        for y in profile.top()..self.row_disparity_px.len() {
            let road = f64::from(profile.disparity_px()[y]);
            let mut counts = [0_u32; COUNT];
            self.samples.count_residuals(y, road, self.tilt, bins, &mut counts);
            // Cumulative counts.
            let mut before = [0; COUNT + 1];
            for (i, count) in counts.iter().enumerate() {
                before[i + 1] = before[i] + count;
            }
            let all = before[COUNT];
            let window = |i: usize| i.saturating_sub(ROW_WINDOW_BINS)..(i + ROW_WINDOW_BINS + 1).min(COUNT);
            let sum = |i: usize| before[window(i).end] - before[window(i).start];
            let most = (0..COUNT).max_by_key(|&i| sum(i)).unwrap_or(0);
            if all < MIN_ROW_PIXELS || f64::from(sum(most)) < MIN_ROW_SHARE * f64::from(all) {
                continue;
            }
            let moment: f64 = window(most).map(|i| (i as f64 + 0.5) * f64::from(counts[i])).sum();
            self.row_disparity_px[y] =
                (road + moment / f64::from(sum(most)) / scale - MAX_ROW_OFFSET_PX) as f32;
        }
    }

    /// Preselects obstacle candidates in column `x_px`: writes 1 for each row whose `disparity` (1/256 px)
    /// may belong to an obstacle, else 0. It never rejects a pixel that meets `filter`.
    ///
    /// # Panics
    /// When `disparity` or `out` does not have one entry per row.
    pub fn find_candidates(&self, x_px: f64, disparity: &[u16], filter: CandidateFilter, out: &mut [u8]) {
        assert_eq!((disparity.len(), out.len()), (self.row_disparity_px.len(), self.row_disparity_px.len()));
        let test = ColumnTest {
            filter,
            x_px,
            tilt: self.tilt,
            // Margin for rounding.
            upper_line: [self.upper_line[0] - 1.0, self.upper_line[1]],
            end_px: (self.rows.len() - 1) as f64 / ENTRIES_PER_PX as f64,
            max_height_baselines: filter.max_height_m / self.rig.baseline_m,
        };
        test_column(self.level, disparity, &self.row_disparity_px, test, out);
    }

    /// Distance of a disparity in px, in metres.
    pub fn distance_m(&self, disparity_px: f64) -> f64 {
        self.rig.distance_m(disparity_px)
    }

    /// Row in which the road has disparity `disparity_px` in column `x_px`; NaN without a road.
    #[inline]
    pub fn row_at(&self, x_px: f64, disparity_px: f64) -> f32 {
        let entry = (self.tilt.levelled_px(x_px, disparity_px).max(0.0) * ENTRIES_PER_PX as f64) as f32;
        let index = (entry as usize).min(self.rows.len() - 2);
        let share = (entry - index as f32).min(1.0);
        self.rows[index] + share * (self.rows[index + 1] - self.rows[index])
    }

    /// Height above the road, in metres, of a pixel with a disparity above 0: baseline · (row of the road at
    /// the disparity − y) / disparity. NaN without a road.
    #[inline]
    pub fn height_m(&self, x_px: f64, y_px: f64, disparity_px: f64) -> f64 {
        self.rig.baseline_m * (f64::from(self.row_at(x_px, disparity_px)) - y_px) / disparity_px
    }

    /// Heights of a batch of pixels, see [`RoadSurface::height_m`].
    pub fn heights_m(&self, pixels: &PixelBatch, out: &mut [f64; BATCH]) {
        let (entries_per_px, baseline_m) = (ENTRIES_PER_PX as f64, self.rig.baseline_m);
        let reference = HeightReference { rows: &self.rows, entries_per_px, tilt: self.tilt, baseline_m };
        heights::measure_heights(self.level, reference, pixels, out);
    }

    /// Standard deviation of a height, in metres: the disparity noise of the frame propagated with the local
    /// slope of the road.
    #[inline]
    pub fn height_noise_m(&self, disparity_px: f64) -> f64 {
        let entry =
            (self.tilt.levelled_px(self.rig.cx_px, disparity_px).max(0.0) * ENTRIES_PER_PX as f64) as usize;
        let rows_per_px = self.rows_per_px[entry.min(self.rows_per_px.len() - 1)];
        self.rig.baseline_m * self.noise_px * rows_per_px / disparity_px
    }
}

/// Criteria of the preselection of obstacle candidates.
#[derive(Clone, Copy, Debug)]
pub struct CandidateFilter {
    /// Smallest disparity, in 1/256 px.
    pub min_disparity: u16,
    /// Smallest difference to the disparity of the road in the row, in px.
    pub min_rise_px: f64,
    /// Largest height above the road, in metres. Only part of the pixels above it are rejected.
    pub max_height_m: f64,
}

/// Constants of the preselection in one column.
#[derive(Clone, Copy, Debug)]
struct ColumnTest {
    filter: CandidateFilter,
    x_px: f64,
    tilt: Tilt,
    /// A line (row at 0 px, rows per px of disparity) that lies above all rows of the road.
    upper_line: [f64; 2],
    /// Disparity of the end of the table, in px; larger ones use its last entry.
    end_px: f64,
    /// Largest height divided by the baseline.
    max_height_baselines: f64,
}

kernel! {
    /// Tests one column, see [`RoadSurface::find_candidates`].
    fn test_column(disparity: &[u16], row_disparity_px: &[f32], test: ColumnTest, out: &mut [u8]) = test_column_each
}

#[inline(always)]
fn test_column_each<S: Simd>(
    _: S,
    disparity: &[u16],
    row_disparity_px: &[f32],
    test: ColumnTest,
    out: &mut [u8],
) {
    let ColumnTest { filter, x_px, tilt, upper_line, end_px, max_height_baselines } = test;
    for (y, ((&d, &shown), out)) in disparity.iter().zip(row_disparity_px).zip(out).enumerate() {
        let px = f64::from(d) / 256.0;
        let level = tilt.levelled_px(x_px, px);
        let stands = level - f64::from(shown) >= filter.min_rise_px;
        let road = if level < end_px { level } else { end_px };
        let too_high = f64::from(y as i32) < upper_line[0] + upper_line[1] * road - max_height_baselines * px;
        *out = u8::from((d >= filter.min_disparity) & stands & !too_high);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const RIG: Rig = Rig { focal_px: 500.0, baseline_m: 0.3, cx_px: 40.0, cy_px: 100.0 };

    /// A crest with 0.2 px per row; its left columns reach beyond the end of the table.
    fn crest() -> RoadSurface {
        let mut surface = RoadSurface::new(RIG, 80, 240, 64);
        for (i, row) in surface.rows.iter_mut().enumerate() {
            *row = 100.0 + 5.0 * i as f32 / ENTRIES_PER_PX as f32 + 3.0 * (i as f32 / 100.0).sin();
        }
        surface.tilt = Tilt { roll: 0.05, offset_px: -1.0, cx_px: 140.0 };
        surface.update_row_slopes();
        surface.row_disparity_px = (0..240).map(|y| 0.2 * (y as f32 - 100.0).max(0.0)).collect();
        surface
    }

    #[test]
    fn all_levels_preselect_equally_and_miss_no_obstacle_pixel() {
        let mut surface = crest();
        let mut random = fastrand::Rng::with_seed(1);
        let disparity: Vec<u16> = (0..240).map(|_| random.u16(8000..16_383)).collect();
        let filter = CandidateFilter { min_disparity: 9000, min_rise_px: 0.2, max_height_m: 1.5 };
        let mut first: Option<Vec<u8>> = None;
        for level in Level::available() {
            let mut stands = vec![9; 240];
            surface.level = level;
            surface.find_candidates(31.0, &disparity, filter, &mut stands);
            assert_eq!(*first.get_or_insert(stands.clone()), stands, "{}", level.name());
            let mut obstacle_rows = 0;
            for (y, &d) in disparity.iter().enumerate() {
                let px = f64::from(d) / 256.0;
                let rises = surface.tilt.levelled_px(31.0, px) - f64::from(surface.row_disparity_px[y])
                    >= filter.min_rise_px;
                let height_m = surface.height_m(31.0, y as f64, px.max(0.01));
                let does = d >= filter.min_disparity && rises && height_m <= filter.max_height_m;
                assert!(stands[y] == 1 || !does, "row {y}, {height_m} m");
                assert!(stands[y] == 0 || (d >= filter.min_disparity && rises));
                obstacle_rows += usize::from(does);
            }
            let selected = stands.iter().filter(|s| **s == 1).count();
            assert!(obstacle_rows > 20 && selected < obstacle_rows + 40, "{obstacle_rows} of {selected}");
        }
    }

    #[test]
    fn all_levels_measure_heights_like_the_reference() {
        let mut surface = crest();
        let mut random = fastrand::Rng::with_seed(4);
        let mut pixels = PixelBatch::default();
        let mut seen = 0;
        while pixels.count() < BATCH {
            let (x, y, d) = (random.u8(..80), random.u8(..240), random.u16(1..));
            pixels.push(x.into(), y.into(), d, seen % 2 == 0);
            seen += 1;
        }
        for level in Level::available() {
            let mut out = [0.0; BATCH];
            surface.level = level;
            surface.heights_m(&pixels, &mut out);
            for (i, height_m) in out.iter().enumerate() {
                let [x, y] = [pixels.x_px[i], pixels.y_px[i]].map(f64::from);
                let expected = surface.height_m(x, y, f64::from(pixels.disparity[i]) / 256.0);
                assert_eq!(height_m.to_bits(), expected.to_bits(), "{} {i}", level.name());
            }
        }
        pixels.clear();
        assert_eq!(pixels.count(), 0);
    }
}
