//! Calibration from driving alone: by how much the right camera is turned against what the calibration says, from what
//! both cameras see of a street.
//!
//! Rows tell pitch and roll ([`EpipolarCheck`], the estimator of the running correction). They hardly tell yaw, which
//! makes all disparities too large or too small by nearly the same amount. That shows in the vehicle's motion: with wrong
//! disparities, far points move more, or less, against near ones than any motion of the camera explains ([`Odometry`],
//! that of the running system, too). The baseline cannot be told, nor can the scale of all distances: a street twice as large,
//! driven through twice as fast, looks the same.
//!
//! Frames are divided into blocks one after the other. Errors of neighbouring frames are alike, because they show the same
//! things, so the standard errors are those of the blocks' mean.

use super::right_turn::RightTurn;
use crate::motion::odometry::{Odometry, OdometryResult};
use crate::rig::Rig;
use crate::stereo::DisparityView;
use crate::stereo::epipolar::field::RowField;
use crate::stereo::epipolar::{EpipolarCheck, EpipolarParameters, MatchedPair};

/// Number of blocks.
const BLOCKS: usize = 8;
/// Fewest blocks with which there is a result.
const MIN_BLOCKS: usize = 4;
/// Fewest points of a block whose rows count.
const MIN_POINTS: f64 = 60.0;
/// Share of the frames whose motion must be known. In dense traffic, where it is less, a wrong yaw may fit as well as the right
/// one.
const MIN_KNOWN_SHARE: f64 = 0.9;
/// Least way that the vehicle drives in a block whose disparities count, in metres: without motion there is no parallax.
const MIN_WAY_M: f64 = 1.0;

/// What a drive tells about the right camera.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct DriveEstimate {
    /// Pitch and roll, with their standard errors; `None` with too few points.
    pub rows: Option<(RightTurn, RightTurn)>,
    /// Yaw, with its standard error in radians; `None` if the vehicle hardly moved, or its motion was not found in nearly
    /// all frames.
    pub yaw: Option<(f64, f64)>,
    /// Mean row offset, in px.
    pub field: RowField,
    /// Way that the vehicle drove while its motion was known, in metres.
    pub way_m: f64,
    /// Frames whose motion was known, and all frames.
    pub known: usize,
    /// Number of frames.
    pub frames: usize,
}

impl DriveEstimate {
    /// The turn as far as it is known; what is not known is zero.
    pub fn turn(&self) -> RightTurn {
        let rows = self.rows.map_or(RightTurn::default(), |(turn, _)| turn);
        RightTurn { yaw_rad: self.yaw.map_or(0.0, |(yaw, _)| yaw), ..rows }
    }
}

/// Sums over the frames of a block.
#[derive(Clone, Copy, Debug, Default)]
struct Motion {
    /// Sum of information, of information × disparity offset, in px.
    information: f64,
    offset: f64,
    way_m: f64,
    known: usize,
}

/// Estimates the turn of the right camera from successive pairs.
#[derive(Debug)]
pub struct DriveEstimator {
    rig: Rig,
    size: (usize, usize),
    odometry: Odometry,
    rows: Vec<EpipolarCheck>,
    motion: [Motion; BLOCKS],
    expected: usize,
    frames: usize,
}

impl DriveEstimator {
    /// An estimator for about `frames` pairs of `size`.
    pub fn new(rig: Rig, size: (usize, usize), frames: usize) -> Self {
        Self {
            rig,
            size,
            odometry: Odometry::new(rig, size.0, size.1),
            rows: vec![lasting_rows(); BLOCKS],
            motion: [Motion::default(); BLOCKS],
            expected: frames.max(1),
            frames: 0,
        }
    }

    /// Adds a pair that was taken `elapsed_s` after the one before; `None` where that is another part of the drive.
    /// Returns the way that the vehicle drove since, in metres, if it is known.
    pub fn update(&mut self, pair: MatchedPair<'_>, elapsed_s: Option<f64>) -> Option<f64> {
        let block = (self.frames * BLOCKS / self.expected).min(BLOCKS - 1);
        self.frames += 1;
        self.rows[block].update(pair, &RowField::ZERO, 0.0);
        let elapsed_s = elapsed_s.unwrap_or_else(|| {
            self.odometry.reset();
            0.0
        });
        let OdometryResult::Known(estimate) = self.odometry.update(pair.left, pair.disparity, elapsed_s)
        else {
            return None;
        };
        let way_m = estimate.motion.translation_m.iter().map(|v| v * v).sum::<f64>().sqrt();
        let (offset_px, information) = estimate.disparity_offset_px;
        let sums = &mut self.motion[block];
        sums.information += information;
        sums.offset += information * offset_px;
        sums.way_m += way_m;
        sums.known += 1;
        Some(way_m)
    }

    /// What the pairs so far tell.
    pub fn estimate(&self) -> DriveEstimate {
        let rows: Vec<RowField> = (self.rows.iter())
            .filter(|check| check.weight() >= MIN_POINTS)
            .map(|check| check.health().total)
            .collect();
        let turns: Vec<RightTurn> =
            rows.iter().map(|field| RightTurn::of_rows(field, &self.rig, self.size)).collect();
        let of = |angle: fn(&RightTurn) -> f64| mean(turns.iter().map(angle));
        let rows_turn = of(|turn| turn.pitch_rad).zip(of(|turn| turn.roll_rad)).map(|(pitch, roll)| {
            let turn = |pitch_rad, roll_rad| RightTurn { pitch_rad, roll_rad, yaw_rad: 0.0 };
            (turn(pitch.0, roll.0), turn(pitch.1, roll.1))
        });
        let moving: Vec<(f64, f64)> = (self.motion.iter())
            .filter(|sums| sums.way_m >= MIN_WAY_M && sums.information > 0.0)
            .map(|sums| (sums.offset / sums.information, sums.information))
            .collect();
        let known = self.motion.iter().map(|sums| sums.known).sum::<usize>();
        let is_known = known as f64 >= MIN_KNOWN_SHARE * self.frames as f64;
        let offset = if is_known { weighted_mean(&moving) } else { None };
        let count = rows.len().max(1) as f64;
        DriveEstimate {
            rows: rows_turn,
            yaw: offset.map(|(px, error_px)| {
                (RightTurn::of_disparities(px, &self.rig).yaw_rad, error_px / self.rig.focal_px)
            }),
            field: rows.iter().fold(RowField::ZERO, |sum, field| sum + *field * (1.0 / count)),
            way_m: self.motion.iter().map(|sums| sums.way_m).sum(),
            known,
            frames: self.frames,
        }
    }
}

/// An estimator of rows that forgets nothing.
pub fn lasting_rows() -> EpipolarCheck {
    EpipolarCheck::new(EpipolarParameters { half_life_s: f64::INFINITY, ..EpipolarParameters::default() })
}

/// Mean and its standard error; `None` of too few values.
pub fn mean(values: impl Iterator<Item = f64>) -> Option<(f64, f64)> {
    let values: Vec<f64> = values.collect();
    let count = values.len() as f64;
    let mean = values.iter().sum::<f64>() / count;
    let variance = values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / (count - 1.0);
    (values.len() >= MIN_BLOCKS).then(|| (mean, (variance / count).sqrt()))
}

/// Mean of values with weights, and its standard error by their scatter; `None` of too few values.
fn weighted_mean(values: &[(f64, f64)]) -> Option<(f64, f64)> {
    let sum: f64 = values.iter().map(|(_, weight)| weight).sum();
    let mean = values.iter().map(|(value, weight)| weight * value).sum::<f64>() / sum;
    let squares: f64 = values.iter().map(|(value, weight)| (weight * (value - mean)).powi(2)).sum();
    let count = values.len() as f64;
    (values.len() >= MIN_BLOCKS).then(|| (mean, (squares * count / (count - 1.0)).sqrt() / sum))
}

/// Share of the largest information above which an angle counts.
const PEAK: f64 = 0.5;

/// Searches a yaw that is too large for [`DriveEstimator`]: of several, the one with which the points fit best to a motion. That is
/// told by the information about what remains of it, which counts points by the inverse of their squared errors; it falls to a
/// tenth within 0.1 degrees. The number of points that fit tells less: with disparities that are too small
/// it hardly falls.
#[derive(Debug)]
pub struct YawSearch {
    rig: Rig,
    size: (usize, usize),
    /// The yaw, its odometry, and the sum of the information about what remains of it.
    candidates: Vec<(f64, Odometry, f64)>,
    corrected: Vec<u16>,
}

impl YawSearch {
    /// A search among some angles in radians.
    pub fn new(rig: Rig, size: (usize, usize), yaws_rad: impl Iterator<Item = f64>) -> Self {
        let candidate = |yaw_rad| (yaw_rad, Odometry::new(rig, size.0, size.1), 0.0);
        Self { rig, size, candidates: yaws_rad.map(candidate).collect(), corrected: vec![0; size.0 * size.1] }
    }

    /// Adds a pair, as in [`DriveEstimator::update`].
    pub fn update(&mut self, pair: MatchedPair<'_>, elapsed_s: Option<f64>) {
        let (width, height) = self.size;
        for (yaw_rad, odometry, information) in &mut self.candidates {
            let turn = RightTurn { yaw_rad: *yaw_rad, ..RightTurn::default() };
            let errors: Vec<f64> =
                (0..width).map(|x| 256.0 * turn.disparity_error_px(x as f64, &self.rig)).collect();
            for (row, out) in pair.disparity.as_slice().chunks(width).zip(self.corrected.chunks_mut(width)) {
                for ((value, error), out) in row.iter().zip(&errors).zip(out) {
                    let corrected = f64::from(*value) - error;
                    *out = if *value == 0 || corrected < 1.0 { 0 } else { corrected.round() as u16 };
                }
            }
            let Some(map) = DisparityView::new(&self.corrected, width, height) else { return };
            if elapsed_s.is_none() {
                odometry.reset();
            }
            if let OdometryResult::Known(estimate) =
                odometry.update(pair.left, map, elapsed_s.unwrap_or_default())
            {
                *information += estimate.disparity_offset_px.1;
            }
        }
    }

    /// The angle with which the points fit best, in radians; `None` if no motion was found with any, or if the best is an
    /// outermost one.
    pub fn best_rad(&self) -> Option<f64> {
        let information = |at: usize| self.candidates[at].2;
        let best = (0..self.candidates.len()).max_by(|&a, &b| information(a).total_cmp(&information(b)))?;
        if information(best) <= 0.0 || best == 0 || best + 1 == self.candidates.len() {
            return None;
        }
        // The middle of the peak.
        let (mut sum, mut weights) = (0.0, 0.0);
        for (yaw_rad, _, information) in &self.candidates[best - 1..=best + 1] {
            let weight = (information - PEAK * self.candidates[best].2).max(0.0);
            sum += weight * yaw_rad;
            weights += weight;
        }
        Some(sum / weights)
    }
}
