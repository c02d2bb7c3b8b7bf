//! The road's surface as heights are measured from it: profile, tilt and noise of one frame.

use super::heights::{self, BATCH, HeightReference, PixelBatch};
use super::profile::RoadProfile;
use super::samples::{ResidualBins, Samples};
use super::tilt::Tilt;
use crate::depth::DepthView;
use crate::rig::Rig;
use crate::simd::{Level, Simd, kernel};
use nalgebra::{Matrix2, Vector2};

/// Places of the table in a pixel of disparity.
const ENTRIES_PER_PX: usize = 16;
/// Rows between those that tell of tilt and noise.
const ROW_STEP: usize = 4;
/// What is so near the road, in px, tells its tilt: nearer from round to round.
const TILT_INLIERS_PX: [f64; 3] = [2.0, 1.0, 0.6];
/// Least and greatest noise of a disparity that is believed, in px.
const NOISE_PX: (f64, f64) = (0.06, 1.0);
/// Residuals that are told apart for the noise, in two px.
const NOISE_BINS: u8 = 128;

/// A row's own disparity may differ from the profile's by so many px.
const MAX_ROW_OFFSET_PX: f64 = 0.5;
/// Residuals of a row that are told apart, and how many of these belong together on either side.
const ROW_BINS: u8 = 40;
const ROW_WINDOW_BINS: usize = 3;
/// PixelBatch of a row that tell its own disparity, and the share of them that must agree.
const MIN_ROW_PIXELS: u32 = 12;
const MIN_ROW_SHARE: f64 = 0.35;

/// The surface, with memory allocated once.
#[derive(Clone, Debug)]
pub struct Surface {
    /// Disparity that each image row of the road really shows at the principal column, in px.
    row_disparity_px: Vec<f32>,
    /// Row where the road has each disparity.
    rows: Vec<f32>,
    /// Rows by which a pixel of disparity moves the road, around each disparity.
    rows_per_px: Vec<f64>,
    /// A line of rows by disparity that the road's rows are nowhere above: at 0 px, and per px.
    upper_line: [f64; 2],
    tilt: Tilt,
    rig: Rig,
    noise_px: f64,
    samples: Samples,
    level: Level,
}

impl Surface {
    /// No road yet, for maps of `width` × `height` and disparities below `disparities` px.
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

    /// How the road lies across.
    pub fn tilt(&self) -> Tilt {
        self.tilt
    }

    /// One standard deviation of a disparity on this frame's road, in px.
    pub fn noise_px(&self) -> f64 {
        self.noise_px
    }

    /// Takes the road of a frame: its profile, with the tilt and the noise that pixels of some
    /// confidence show around it.
    ///
    /// # Panics
    /// When the map has another size than the surface was made for.
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

    /// What is derived from the rows alone.
    fn update_row_slopes(&mut self) {
        let (reach, last) = (ENTRIES_PER_PX / 2, self.rows.len() - 1);
        for (place, out) in self.rows_per_px.iter_mut().enumerate() {
            let (below, above) = (place.saturating_sub(reach), (place + reach).min(last));
            let rows = f64::from(self.rows[above] - self.rows[below]);
            *out = rows * ENTRIES_PER_PX as f64 / (above - below).max(1) as f64;
        }
        let per_place = f64::from(self.rows[last] - self.rows[0]) / last as f64;
        let at_0 = self.rows.iter().enumerate().map(|(i, &row)| f64::from(row) - per_place * i as f64);
        self.upper_line = [at_0.fold(f64::INFINITY, f64::min), per_place * ENTRIES_PER_PX as f64];
    }

    /// Fits the sideways tilt of the road to what is left after the profile.
    fn measure_tilt(&self, profile: &RoadProfile) -> Tilt {
        let level = Tilt { cx_px: self.rig.cx_px, ..Tilt::default() };
        let road_px = profile.disparity_px();
        let mut tilt = level;
        for tolerance_px in TILT_INLIERS_PX {
            let rows = (profile.top()..road_px.len()).step_by(ROW_STEP);
            let sums = self.samples.moments(rows, road_px, tilt, tolerance_px);
            let normal = Matrix2::new(sums.square, sums.across, sums.across, sums.count);
            // Too little road to tell: level.
            tilt = match normal.cholesky() {
                Some(solver) if sums.count > 50.0 => {
                    let fit = solver.solve(&Vector2::new(sums.product, sums.residual));
                    Tilt { roll: fit[0], offset_px: fit[1], ..level }
                }
                _ => level,
            };
        }
        // More than this (about 10 degrees on a car) is a wall, not a roll.
        if tilt.roll.abs() <= 0.06 && tilt.offset_px.abs() <= 3.0 { tilt } else { level }
    }

    /// The median distance of road pixels from the surface, as a standard deviation.
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

    /// What most of a row's road shows: a matcher draws a road that is seen at a flat angle as stairs, whose
    /// steps lie in the same rows everywhere. What is as near as the rest of its row is no thing.
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
            // Counts of all bins before each.
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

    /// Where column `x` of each row, of which `disparity` says how near it is in 1/256 px, may show what stands
    /// (1, else 0), at first filter.
    ///
    /// # Panics
    /// When there is not one of each a row.
    pub fn find_candidates(&self, x_px: f64, disparity: &[u16], filter: CandidateFilter, out: &mut [u8]) {
        assert_eq!((disparity.len(), out.len()), (self.row_disparity_px.len(), self.row_disparity_px.len()));
        let test = ColumnTest {
            filter,
            x_px,
            tilt: self.tilt,
            // Room for what rounds.
            upper_line: [self.upper_line[0] - 1.0, self.upper_line[1]],
            end_px: (self.rows.len() - 1) as f64 / ENTRIES_PER_PX as f64,
            max_height_baselines: filter.max_height_m / self.rig.baseline_m,
        };
        test_column(self.level, disparity, &self.row_disparity_px, test, out);
    }

    /// The row where the road has disparity `disparity_px` in column `x`; NaN without a road.
    #[inline]
    pub fn row_at(&self, x_px: f64, disparity_px: f64) -> f32 {
        let place = (self.tilt.levelled_px(x_px, disparity_px).max(0.0) * ENTRIES_PER_PX as f64) as f32;
        let index = (place as usize).min(self.rows.len() - 2);
        let share = (place - index as f32).min(1.0);
        self.rows[index] + share * (self.rows[index + 1] - self.rows[index])
    }

    /// Height above the road, in metres, of what row `y` and column `x` show at a disparity (above 0):
    /// baseline·(row of the road there − y)/disparity. NaN without a road.
    #[inline]
    pub fn height_m(&self, x_px: f64, y_px: f64, disparity_px: f64) -> f64 {
        self.rig.baseline_m * (f64::from(self.row_at(x_px, disparity_px)) - y_px) / disparity_px
    }

    /// The same of some pixels.
    pub fn heights_m(&self, pixels: &PixelBatch, out: &mut [f64; BATCH]) {
        let (entries_per_px, baseline_m) = (ENTRIES_PER_PX as f64, self.rig.baseline_m);
        let reference = HeightReference { rows: &self.rows, entries_per_px, tilt: self.tilt, baseline_m };
        heights::measure_heights(self.level, reference, pixels, out);
    }

    /// One standard deviation of such a height, in metres: what the frame's noise comes to where the road
    /// lies as it does there.
    #[inline]
    pub fn height_noise_m(&self, disparity_px: f64) -> f64 {
        let place =
            (self.tilt.levelled_px(self.rig.cx_px, disparity_px).max(0.0) * ENTRIES_PER_PX as f64) as usize;
        let rows_per_px = self.rows_per_px[place.min(self.rows_per_px.len() - 1)];
        self.rig.baseline_m * self.noise_px * rows_per_px / disparity_px
    }
}

/// What something that stands must have, at first filter.
#[derive(Clone, Copy, Debug)]
pub struct CandidateFilter {
    /// The least disparity, in 1/256 px.
    pub min_disparity: u16,
    /// By how much it is nearer than the row's road, in px.
    pub min_rise_px: f64,
    /// The greatest height above the road, in metres: what is plainly higher is left out, but not all of it.
    pub max_height_m: f64,
}

/// The road as one column is glanced at.
#[derive(Clone, Copy, Debug)]
struct ColumnTest {
    filter: CandidateFilter,
    x_px: f64,
    tilt: Tilt,
    /// A line of rows that the road's rows are nowhere above: at 0 px, and per px.
    upper_line: [f64; 2],
    /// Nearer than this the road is where it is there, in px.
    end_px: f64,
    /// The greatest height over the baseline.
    max_height_baselines: f64,
}

kernel! {
    /// One column's rows, see [`Surface::find_candidates`].
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

    /// A crest, by 0.2 px a row, on which columns to the left look beyond the table's end.
    fn crest() -> Surface {
        let mut surface = Surface::new(RIG, 80, 240, 64);
        for (i, row) in surface.rows.iter_mut().enumerate() {
            *row = 100.0 + 5.0 * i as f32 / ENTRIES_PER_PX as f32 + 3.0 * (i as f32 / 100.0).sin();
        }
        surface.tilt = Tilt { roll: 0.05, offset_px: -1.0, cx_px: 140.0 };
        surface.update_row_slopes();
        surface.row_disparity_px = (0..240).map(|y| 0.2 * (y as f32 - 100.0).max(0.0)).collect();
        surface
    }

    #[test]
    fn all_levels_glance_at_what_may_stand_and_miss_nothing_that_does() {
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
            let mut standing = 0;
            for (y, &d) in disparity.iter().enumerate() {
                let px = f64::from(d) / 256.0;
                let rises = surface.tilt.levelled_px(31.0, px) - f64::from(surface.row_disparity_px[y])
                    >= filter.min_rise_px;
                let height_m = surface.height_m(31.0, y as f64, px.max(0.01));
                let does = d >= filter.min_disparity && rises && height_m <= filter.max_height_m;
                assert!(stands[y] == 1 || !does, "row {y}, {height_m} m");
                assert!(stands[y] == 0 || (d >= filter.min_disparity && rises));
                standing += usize::from(does);
            }
            let glanced = stands.iter().filter(|s| **s == 1).count();
            assert!(standing > 20 && glanced < standing + 40, "{standing} of {glanced}");
        }
    }

    #[test]
    fn all_levels_measure_the_heights_that_one_by_one_gives() {
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
