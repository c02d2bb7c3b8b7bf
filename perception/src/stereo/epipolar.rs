//! Monitors epipolar alignment: estimates the vertical offset between matching points of a rectified pair and
//! its gradients over the image, what they cost, and corrects them.
//!
//! The paper estimates this epipolar line distortion from its matches as a convex problem and feeds it
//! back online. Here, in every cell of a grid, the strongest corner among the pixels with a confident disparity
//! is searched in the right image in both directions and refined to sub-pixel precision (`patch.rs`). A plane (offset +
//! gradients, [`field`]) is fitted to the vertical offsets of the last frames with Huber's loss, which is convex and so
//! has a single solution for any start value.
//!
//! The offset corresponds to pitch (or one shifted principal point), the gradient along x to roll, the
//! gradient along y to different focal lengths. The baseline is not observable this way, and yaw hardly.
//!
//! Offsets are judged by their cost over the area that is matched ([`harm`]), corrected by shifting rows
//! ([`correction`], [`shift`]). The estimate is that of the cameras, not of the corrected pair, so a correction changes
//! nothing about it. What is no pair of views at all is found by [`pairing`].

pub mod coarse;
pub mod correction;
pub mod field;
pub mod harm;
pub mod pairing;
mod patch;
pub mod shift;
pub mod single_pair;

use super::disparity::DisparityView;
use crate::image::GreyView;
use field::{RowField, place};
use harm::{CELLS, MatchedArea, lost_share};
use nalgebra::{Matrix3, Vector3};
use patch::{ASIDE, HALF, Patch, corner};

/// Parameters of the monitor.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EpipolarParameters {
    /// Maximum vertical offset that is searched, in pixels.
    pub reach_px: usize,
    /// Minimum confidence of a disparity, 0 to 255.
    pub confidence: u8,
    /// Half-life of a point's weight, in seconds.
    pub half_life_s: f64,
    /// Offset whose cost in matches makes the calibration degraded, in pixels.
    pub bound_px: f64,
    /// Threshold of Huber's loss, in pixels.
    pub huber_px: f64,
}

impl Default for EpipolarParameters {
    /// The bound: 1 px loses a tenth of the matches, about as many as a matcher misses on aligned pairs (kitti2015).
    fn default() -> Self {
        Self { reach_px: 5, confidence: 64, half_life_s: 1.5, bound_px: 1.0, huber_px: 0.3 }
    }
}

/// Epipolar alignment of the pair.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum EpipolarState {
    /// Too few points were found.
    #[default]
    Unknown,
    /// The offset costs no more than the bound.
    Good,
    /// The offset costs more than the bound permits.
    Degraded,
}

/// The estimate from the last frames.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct EpipolarHealth {
    /// Epipolar alignment of the pair.
    pub state: EpipolarState,
    /// Offset of the cameras, without any correction.
    pub total: RowField,
    /// What remains of it after the correction that was applied.
    pub remaining: RowField,
    /// Standard deviation of the offset in the middle of the image, in pixels.
    pub sigma_px: f64,
    /// Typical (root mean square) deviation of points from the field beyond that of the measurement, in pixels: what no
    /// correction by a field removes.
    pub scatter_px: f64,
    /// Typical remaining offset over the area that is matched, in pixels.
    pub typical_px: f64,
    /// Share of matches that the remaining offset and the scatter lose, 0 to 1, as [`harm`] expects it.
    pub lost: f64,
    /// Number of points of the last frame.
    pub points: usize,
}

/// A rectified pair with its disparities and confidences.
#[derive(Clone, Copy, Debug)]
pub struct MatchedPair<'a> {
    /// Left image.
    pub left: GreyView<'a>,
    /// Right image as it was matched, after any correction.
    pub right: GreyView<'a>,
    /// Disparities of the left image.
    pub disparity: DisparityView<'a>,
    /// Their confidences, 0 to 255, row by row.
    pub confidence: &'a [u8],
}

/// Minimum corner response: smaller eigenvalue of a patch's structure tensor per pixel, in squared grey levels.
const MIN_CORNER: f32 = 12.0;
/// Minimum weight of points for a state other than unknown.
const MIN_POINTS: f64 = 60.0;
/// Factor on the weight of past frames when the current frame contradicts them.
const FORGET: f64 = 0.3;
/// Share of the bound on lost matches below which a degraded state becomes good again (hysteresis).
const RECOVERY: f64 = 0.7;
/// Typical deviation of points from the field in well rectified pairs, in px: noise of the measurement, and what the
/// true field has beside a plane. The pairs of kitti2015 have 0.10 to 0.23 px.
const SCATTER_PX: f64 = 0.25;
/// Time between two checks, in seconds: what a source says is limited to this, because it may stand still or jump.
const STEP_S: (f64, f64) = (0.005, 1.0);

/// Monitor of one camera pair, updated frame by frame. Updates do not allocate.
#[derive(Clone, Debug)]
pub struct EpipolarCheck {
    parameters: EpipolarParameters,
    /// Points of the last frame: position from −1 to 1, offset in pixels.
    points: Vec<[f64; 3]>,
    area: MatchedArea,
    information: Matrix3<f64>,
    right: Vector3<f64>,
    weight: f64,
    squares: f64,
    /// Sum of the weights times the squared typical deviation of each frame's points.
    spread: f64,
    estimate: Vector3<f64>,
    health: EpipolarHealth,
}

impl EpipolarCheck {
    /// A monitor without any observation.
    pub fn new(parameters: EpipolarParameters) -> Self {
        Self {
            parameters,
            points: Vec::with_capacity(CELLS.0 * CELLS.1),
            area: MatchedArea::default(),
            information: Matrix3::zeros(),
            right: Vector3::zeros(),
            weight: 0.0,
            squares: 0.0,
            spread: 0.0,
            estimate: Vector3::zeros(),
            health: EpipolarHealth::default(),
        }
    }

    /// The current estimate.
    pub fn health(&self) -> EpipolarHealth {
        self.health
    }

    /// Weight of all points so far: how many agree with the estimate, where those of past frames fade.
    pub fn weight(&self) -> f64 {
        self.weight
    }

    /// Typical (root mean square) magnitude of a field over the area that is matched, in pixels.
    pub fn typical_px(&self, field: &RowField) -> f64 {
        self.area.typical_px(field)
    }

    /// Share of matches above which the calibration is degraded, 0 to 1.
    pub fn max_lost(&self) -> f64 {
        lost_share(self.parameters.bound_px)
    }

    /// Updates the estimate with a pair whose right image was corrected by `applied`, `seconds` after the previous one.
    /// Images that are smaller than a few patches or whose size differs from the map's are ignored.
    pub fn update(&mut self, pair: MatchedPair<'_>, applied: &RowField, seconds: f64) -> EpipolarHealth {
        if !self.can_measure(&pair) {
            return self.health;
        }
        let mut keep = 0.5_f64.powf(seconds.clamp(STEP_S.0, STEP_S.1) / self.parameters.half_life_s);
        self.points.clear();
        self.area.fade(keep);
        for cell in 0..CELLS.0 * CELLS.1 {
            let (point, share) = self.point_of_cell(&pair, CELLS, cell, applied);
            self.area.add(cell, share);
            self.points.extend(point);
        }
        // If most points contradict the past, the cameras may have moved: past frames lose weight faster.
        let expected = |p: &[f64; 3]| Vector3::new(1.0, p[0], p[1]).dot(&self.estimate);
        let far = self.points.iter().filter(|p| (p[2] - expected(p)).abs() > 2.0 * self.parameters.huber_px);
        if self.points.len() >= 15 && 2 * far.count() > self.points.len() {
            keep *= FORGET;
        }
        self.fit(keep, applied);
        self.health
    }

    /// Pixels at the border in which no corner is searched.
    fn margin(&self) -> usize {
        HALF + self.parameters.reach_px.max(ASIDE) + 3
    }

    /// Whether the images and the map have the same size, of more than a few patches.
    fn can_measure(&self, pair: &MatchedPair<'_>) -> bool {
        let (width, height) = (pair.left.width(), pair.left.height());
        (pair.right.width(), pair.right.height()) == (width, height)
            && (pair.disparity.width(), pair.disparity.height()) == (width, height)
            && pair.confidence.len() == width * height
            && width.min(height) >= 4 * self.margin()
    }

    /// The point of a cell of a grid, see [`Self::point`], and the share of the cell's pixels with a confident disparity.
    fn point_of_cell(
        &self,
        pair: &MatchedPair<'_>,
        grid: (usize, usize),
        cell: usize,
        applied: &RowField,
    ) -> (Option<[f64; 3]>, f64) {
        let margin = self.margin();
        let span = |k: usize, n: usize, length: usize| {
            let inner = length - 2 * margin;
            margin + k * inner / n..margin + (k + 1) * inner / n
        };
        let columns = span(cell % grid.0, grid.0, pair.left.width());
        let rows = span(cell / grid.0, grid.1, pair.left.height());
        let (corner, share) = self.corner_of_cell(pair, columns, rows);
        (corner.and_then(|at| self.point(pair, at, applied)), share)
    }

    /// The strongest corner of a cell, and the share of its pixels with a confident disparity.
    fn corner_of_cell(
        &self,
        pair: &MatchedPair<'_>,
        columns: std::ops::Range<usize>,
        rows: std::ops::Range<usize>,
    ) -> (Option<(usize, usize)>, f64) {
        let width = pair.left.width();
        let margin = self.margin();
        let mut best: Option<(f32, usize, usize)> = None;
        let (mut all, mut matched) = (0_u32, 0_u32);
        for y in rows.step_by(3) {
            let (disparities, grey, next) = (pair.disparity.row(y), pair.left.row(y), pair.left.row(y + 1));
            for x in columns.clone().step_by(3) {
                all += 1;
                let d = usize::from(disparities[x]) / 256;
                if disparities[x] == 0 || pair.confidence[y * width + x] < self.parameters.confidence {
                    continue;
                }
                matched += 1;
                if x < d + margin
                    // Most pixels are flat: a cheap test before the whole patch.
                    || grey[x].abs_diff(grey[x + 1]).max(grey[x].abs_diff(next[x])) < 4
                {
                    continue;
                }
                let corner = corner(pair.left, x, y);
                if corner > MIN_CORNER && best.is_none_or(|b| corner > b.0) {
                    best = Some((corner, x, y));
                }
            }
        }
        (best.map(|(_, x, y)| (x, y)), f64::from(matched) / f64::from(all.max(1)))
    }

    /// A corner's position in the right image, from −1 to 1, and the vertical offset without correction, in pixels.
    fn point(&self, pair: &MatchedPair<'_>, (x, y): (usize, usize), applied: &RowField) -> Option<[f64; 3]> {
        let (width, height) = (pair.left.width(), pair.left.height());
        let disparity = f32::from(pair.disparity.row(y)[x]) / 256.0;
        let patch = Patch::new(pair.left, x, y);
        let (u, v) = patch.found(pair.right, (x, y), disparity, self.parameters.reach_px)?;
        let (u, v) = (place(f64::from(u), width), f64::from(v));
        let row = place(v, height);
        Some([u, row, v + applied.at(u, row) - y as f64])
    }

    /// Fits the plane to the points of this frame and those of past frames, which count `keep` times as much as before.
    fn fit(&mut self, keep: f64, applied: &RowField) {
        let (old, old_right) = (self.information * keep, self.right * keep);
        let mut estimate = self.estimate;
        if self.weight * keep < 10.0 {
            // No previous estimate: start from the median.
            let mut offsets = [0.0; CELLS.0 * CELLS.1];
            let count = self.points.len();
            for (o, p) in offsets.iter_mut().zip(&self.points) {
                *o = p[2];
            }
            offsets[..count].sort_unstable_by(f64::total_cmp);
            estimate = Vector3::new(if count > 0 { offsets[count / 2] } else { 0.0 }, 0.0, 0.0);
        }
        // A weak prior on the gradients, because all points may lie in one corner of the image.
        let pull = Matrix3::from_diagonal(&Vector3::new(0.0, 2.0, 2.0));
        let (mut information, mut right) = (old, old_right);
        let (mut weight, mut squares) = (0.0, 0.0);
        for _ in 0..8 {
            (information, right, weight, squares) = (old, old_right, 0.0, 0.0);
            for [x, y, offset] in &self.points {
                let row = Vector3::new(1.0, *x, *y);
                let r = offset - row.dot(&estimate);
                let w =
                    if r.abs() > self.parameters.huber_px { self.parameters.huber_px / r.abs() } else { 1.0 };
                information += row * row.transpose() * w;
                right += row * (w * offset);
                weight += w;
                squares += w * r * r;
            }
            let Some(inverse) = (information + pull).try_inverse() else { return };
            let next = inverse * right;
            let step = (next - estimate).norm();
            estimate = next;
            if step < 1e-4 {
                break;
            }
        }
        (self.information, self.right, self.estimate) = (information, right, estimate);
        self.weight = self.weight * keep + weight;
        self.squares = self.squares * keep + squares;
        self.spread = self.spread * keep + weight * self.deviation_px().powi(2);
        let inverse = (information + pull).try_inverse().unwrap_or_default();
        self.judge(inverse[(0, 0)], applied);
    }

    /// Typical deviation of the points of the last frame from the estimate, in pixels. The median, because some points
    /// are wrong matches.
    fn deviation_px(&self) -> f64 {
        let mut deviations = [0.0; CELLS.0 * CELLS.1];
        let deviations = &mut deviations[..self.points.len()];
        for (deviation, [x, y, offset]) in deviations.iter_mut().zip(&self.points) {
            *deviation = (offset - Vector3::new(1.0, *x, *y).dot(&self.estimate)).abs();
        }
        deviations.sort_unstable_by(f64::total_cmp);
        // The median magnitude of a normal distribution is 0.6745 standard deviations.
        deviations.get(deviations.len() / 2).map_or(0.0, |median| median / 0.6745)
    }

    /// The health by the current estimate; `inverse` is its variance in units of that of a point.
    fn judge(&mut self, inverse: f64, applied: &RowField) {
        let variance = self.squares / self.weight.max(1.0);
        let total =
            RowField { offset_px: self.estimate[0], across_px: self.estimate[1], down_px: self.estimate[2] };
        let remaining = total - *applied;
        let spread = self.spread / self.weight.max(1.0);
        let scatter_px = (spread - SCATTER_PX * SCATTER_PX).max(0.0).sqrt();
        let lost = self.area.lost(&remaining, scatter_px);
        let (max_lost, was) = (self.max_lost(), self.health.state);
        let state = if self.weight < MIN_POINTS {
            EpipolarState::Unknown
        } else if lost > max_lost || (was == EpipolarState::Degraded && lost > RECOVERY * max_lost) {
            // Hysteresis: a degraded state recovers only clearly below the bound.
            EpipolarState::Degraded
        } else {
            EpipolarState::Good
        };
        self.health = EpipolarHealth {
            state,
            total,
            remaining,
            sigma_px: (variance * inverse).max(0.0).sqrt(),
            scatter_px,
            typical_px: self.area.typical_px(&remaining),
            lost,
            points: self.points.len(),
        };
    }
}

#[cfg(test)]
mod tests {
    use super::correction::RowCorrection;
    use super::shift::shift_rows;
    use super::*;
    use crate::image::GreyImage;
    use crate::simd::Level;

    pub(super) const SIZE: (usize, usize) = (320, 240);

    /// A textured pair with disparities from 6 to 20 px; `field` is the vertical offset of the right image at a
    /// position.
    pub(super) fn pair(field: impl Fn(f64, f64) -> f64, seed: u64) -> (GreyImage, GreyImage, Vec<u16>) {
        let (width, height) = SIZE;
        let mut random = fastrand::Rng::with_seed(seed);
        let coarse: Vec<f64> = (0..200 * 100).map(|_| random.f64() * 255.0).collect();
        let texture = |x: f64, y: f64| {
            let (x, y) = (x / 3.1 + 10.0, y / 3.1 + 5.0);
            let (i, j) = (x as usize, y as usize);
            let (fx, fy) = (x.fract(), y.fract());
            let (sx, sy) = (fx * fx * (3.0 - 2.0 * fx), fy * fy * (3.0 - 2.0 * fy));
            let at = |di: usize, dj: usize| coarse[(j + dj) * 200 + i + di];
            let (a, b) = (at(0, 0) + sx * (at(1, 0) - at(0, 0)), at(0, 1) + sx * (at(1, 1) - at(0, 1)));
            a + sy * (b - a)
        };
        let truth = |y: f64| 6.0 + 14.0 * y / height as f64;
        let (mut left, mut right) = (GreyImage::new(width, height), GreyImage::new(width, height));
        let mut disparity = vec![0; width * height];
        for y in 0..height {
            for x in 0..width {
                let (px, py) = (x as f64, y as f64);
                left.as_mut_slice()[y * width + x] = texture(px + 30.0, py + 10.0).round() as u8;
                disparity[y * width + x] = (truth(py) * 256.0) as u16;
                // Row y of the right image shows the content of row y − field.
                let row = py - field(px, py);
                right.as_mut_slice()[y * width + x] =
                    texture(px + 30.0 + truth(row), row + 10.0).round() as u8;
            }
        }
        (left, right, disparity)
    }

    /// Time between two checks of these tests, in seconds.
    const STEP: f64 = 0.2;

    fn run_corrected(
        check: &mut EpipolarCheck,
        pair: &(GreyImage, GreyImage, Vec<u16>),
        applied: &RowField,
    ) -> EpipolarHealth {
        let disparity = DisparityView::new(&pair.2, SIZE.0, SIZE.1).unwrap();
        let mut shifted = GreyImage::new(SIZE.0, SIZE.1);
        shift_rows(Level::best(), pair.1.view(), applied, shifted.as_mut_slice());
        let confidence = &vec![200; SIZE.0 * SIZE.1];
        let pair = MatchedPair { left: pair.0.view(), right: shifted.view(), disparity, confidence };
        check.update(pair, applied, STEP)
    }

    fn run(check: &mut EpipolarCheck, pair: &(GreyImage, GreyImage, Vec<u16>)) -> EpipolarHealth {
        run_corrected(check, pair, &RowField::ZERO)
    }

    #[test]
    fn offsets_and_gradients_are_recovered() {
        for (offset, across, down) in [
            (0.0, 0.0, 0.0),
            (0.3, 0.0, 0.0),
            (-1.4, 0.0, 0.0),
            (0.2, 0.6, 0.0),
            (0.0, 0.0, -0.4),
            (2.6, -0.3, 0.2),
        ] {
            let pair =
                pair(|x, y| offset + across * (2.0 * x / 319.0 - 1.0) + down * (2.0 * y / 239.0 - 1.0), 3);
            let mut check = EpipolarCheck::new(EpipolarParameters::default());
            let health = (0..3).map(|_| run(&mut check, &pair)).last().unwrap();
            assert!(health.points > 100, "{health:?}");
            let RowField { offset_px, across_px, down_px } = health.total;
            for (found, truth) in [(offset_px, offset), (across_px, across), (down_px, down)] {
                assert!((found - truth).abs() < 0.06, "{offset} {across} {down}: {health:?}");
            }
            assert_eq!(health.remaining, health.total);
            assert_eq!(health.state == EpipolarState::Degraded, f64::abs(offset) > 1.0, "{health:?}");
            let expected = lost_share(health.typical_px);
            assert!((health.lost - expected).abs() < 0.03, "{expected}, {health:?}");
            assert!(health.sigma_px < 0.05);
        }
    }

    #[test]
    fn wrong_disparities_do_not_move_the_estimate() {
        let mut pair = pair(|_, _| 0.4, 5);
        let mut random = fastrand::Rng::with_seed(5);
        for block in pair.2.chunks_mut(16) {
            if random.f64() < 0.3 {
                block.fill(random.u16(256..40 * 256));
            }
        }
        let mut check = EpipolarCheck::new(EpipolarParameters::default());
        let health = (0..5).map(|_| run(&mut check, &pair)).last().unwrap();
        assert!((health.total.offset_px - 0.4).abs() < 0.06, "{health:?}");
    }

    /// Checks a pair `checks` times and corrects it between them, 4 frames a check; returns the largest step of the
    /// correction from frame to frame.
    fn follow(
        check: &mut EpipolarCheck,
        correction: &mut RowCorrection,
        pair: &(GreyImage, GreyImage, Vec<u16>),
        checks: usize,
    ) -> f64 {
        let mut largest: f64 = 0.0;
        for _ in 0..checks {
            let applied = correction.applied();
            run_corrected(check, pair, &applied);
            correction.update(check);
            for _ in 0..4 {
                let before = correction.applied();
                correction.advance(STEP / 4.0);
                largest = largest.max((correction.applied() - before).largest_px());
            }
        }
        largest
    }

    #[test]
    fn a_camera_that_turns_is_found_corrected_and_told_from_one_that_was_off_from_the_start() {
        let (good, turned) = (pair(|_, _| 0.0, 7), pair(|x, _| 1.5 + 0.3 * (x / 160.0 - 1.0), 7));
        let mut check = EpipolarCheck::new(EpipolarParameters::default());
        let mut correction = RowCorrection::new(2.0);
        follow(&mut check, &mut correction, &good, 20);
        assert_eq!((check.health().state, correction.applied()), (EpipolarState::Good, RowField::ZERO));
        // Without correction it is degraded; the estimate is that of the cameras.
        let mut alone = check.clone();
        let found = (1..100).find(|_| run(&mut alone, &turned).state == EpipolarState::Degraded).unwrap();
        assert!(found <= 10, "{found} checks");
        let largest = follow(&mut check, &mut correction, &turned, 40);
        let health = check.health();
        assert!(largest <= 0.1 + 1e-9, "a step of {largest} px within {STEP} / 4 s");
        assert!((correction.applied().offset_px - 1.5).abs() < 0.1, "{correction:?}");
        assert!((correction.applied().across_px - 0.3).abs() < 0.1, "{correction:?}");
        assert!(health.state == EpipolarState::Good && health.lost < 0.011, "{health:?}");
        for _ in 0..30 {
            run(&mut alone, &turned);
        }
        assert!((health.total - alone.health().total).largest_px() < 0.1, "{health:?}");
        assert!(correction.has_moved() && (correction.moved_px() - 1.5).abs() < 0.15, "{correction:?}");
        // The same pair from the start on: corrected, but nothing has moved.
        let mut check = EpipolarCheck::new(EpipolarParameters::default());
        let mut correction = RowCorrection::new(2.0);
        follow(&mut check, &mut correction, &turned, 40);
        assert!((correction.applied().offset_px - 1.5).abs() < 0.1, "{correction:?}");
        assert!(!correction.has_moved() && correction.moved_px() < 0.2, "{correction:?}");
    }

    #[test]
    fn a_correction_stays_within_its_limit_and_follows_no_noise() {
        let far = pair(|_, _| 2.6, 11);
        for (limit_px, applied_px) in [(2.0, 2.0), (0.0, 0.0)] {
            let mut check = EpipolarCheck::new(EpipolarParameters::default());
            let mut correction = RowCorrection::new(limit_px);
            follow(&mut check, &mut correction, &far, 30);
            assert!((correction.applied().largest_px() - applied_px).abs() < 0.05, "{correction:?}");
            assert!((check.health().total.offset_px - 2.6).abs() < 0.1, "{:?}", check.health());
        }
        let little = pair(|_, _| 0.15, 11);
        let mut check = EpipolarCheck::new(EpipolarParameters::default());
        let mut correction = RowCorrection::new(2.0);
        follow(&mut check, &mut correction, &little, 30);
        assert_eq!(correction.applied(), RowField::ZERO);
    }

    #[test]
    fn offsets_that_no_plane_describes_are_harm_too() {
        // As lens distortion leaves them: alternating between −1.6 and 1.6 px.
        let wavy = pair(|x, _| 1.6 * (x / 40.0).sin(), 13);
        let mut check = EpipolarCheck::new(EpipolarParameters::default());
        let health = (0..10).map(|_| run(&mut check, &wavy)).last().unwrap();
        assert!(health.typical_px < 0.8, "{health:?}");
        assert!(health.scatter_px > 1.0 && health.state == EpipolarState::Degraded, "{health:?}");
    }

    #[test]
    fn without_texture_the_state_is_unknown() {
        let flat = (GreyImage::new(320, 240), GreyImage::new(320, 240), vec![2560; 320 * 240]);
        let mut check = EpipolarCheck::new(EpipolarParameters::default());
        assert_eq!(run(&mut check, &flat).state, EpipolarState::Unknown);
        let unknown = pair(|_, _| 1.0, 9);
        let unknown = (unknown.0, unknown.1, vec![0; 320 * 240]);
        assert_eq!(run(&mut check, &unknown).state, EpipolarState::Unknown);
        // Images of other sizes are ignored.
        let small = GreyImage::new(20, 20);
        let map = vec![300; 400];
        let disparity = DisparityView::new(&map, 20, 20).unwrap();
        for left in [small.view(), flat.0.view()] {
            let pair = MatchedPair { left, right: small.view(), disparity, confidence: &[200; 400] };
            check.update(pair, &RowField::ZERO, STEP);
        }
    }
}
