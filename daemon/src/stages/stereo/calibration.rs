//! Monitoring of the epipolar alignment, and correction of small vertical offsets by shifting the rows of the right
//! image.

use crate::launch::FrameFormat;
use config::Config;
use messages::calibration::{
    CalibrationCause, CalibrationRecord, CalibrationState, ERROR_DISTANCE_M, MAX_DISTANCE_ERROR,
};
use perception::image::GreyView;
use perception::simd::Level;
use perception::stereo::epipolar::correction::RowCorrection;
use perception::stereo::epipolar::harm::DISPARITY_PX_PER_PX;
use perception::stereo::epipolar::pairing::{Pairing, PairingCheck};
use perception::stereo::epipolar::shift::shift_rows;
use perception::stereo::epipolar::{EpipolarCheck, EpipolarParameters, EpipolarState, MatchedPair};

/// Number of checks from one look at the pairing to the next once the pictures are known to be a pair: cameras are
/// exchanged while nothing runs, so this only finds a source that changes.
const PAIRING_EVERY: u64 = 10;

/// Frames from the start in which the pairing is looked at, until it is known: a recording may be short.
const FIRST_LOOKS: u64 = 6;

/// Longest time between two frames by which a correction moves, in seconds; a source may pause.
const MAX_STEP_S: f64 = 0.2;

/// Epipolar check and correction of a run.
pub struct CalibrationMonitor {
    level: Level,
    check: EpipolarCheck,
    pairing: PairingCheck,
    correction: RowCorrection,
    /// Number of frames from one check to the next.
    every: u64,
    frames: u64,
    /// Number of times at which the pairing could have been looked at.
    looks: u64,
    /// Source time of the last frame, and of the last check, in ns.
    frame_ns: Option<u64>,
    check_ns: Option<u64>,
    /// Maximum offset that is corrected, in px; 0 = no correction.
    correct_px: f64,
    /// Relative error of a distance of [`ERROR_DISTANCE_M`] for an error of the disparity of 1 px.
    error_per_px: f64,
    record: CalibrationRecord,
}

impl CalibrationMonitor {
    /// The configured monitor for frames of a format; `None` without `calibration.check`.
    pub fn new(config: &Config, format: &FrameFormat) -> Option<Self> {
        let c = &config.calibration;
        let parameters = EpipolarParameters { bound_px: c.bound_px, ..EpipolarParameters::default() };
        let check = EpipolarCheck::new(parameters);
        // What the check searches, less its border.
        let measured_px = parameters.reach_px as f64 - 1.0;
        c.check.then(|| Self {
            level: Level::best(),
            pairing: PairingCheck::new(format.width, format.height, measured_px),
            correction: RowCorrection::new(c.correct_px),
            every: c.every_frames.unsigned_abs().max(1),
            frames: 0,
            looks: 0,
            frame_ns: None,
            check_ns: None,
            correct_px: c.correct_px,
            error_per_px: ERROR_DISTANCE_M / (format.focal_px * format.baseline_m),
            record: CalibrationRecord {
                state: CalibrationState::Unknown as u32,
                lost_max: check.max_lost() as f32,
                ..CalibrationRecord::default()
            },
            check,
        })
    }

    /// State and offsets after the frames so far.
    pub fn record(&self) -> CalibrationRecord {
        self.record
    }

    /// Writes the right image of a frame, with its rows shifted by the correction, row by row into `out`.
    pub fn correct(&mut self, right: GreyView<'_>, source_ns: u64, out: &mut [u8]) {
        let seconds = seconds_since(self.frame_ns.replace(source_ns), source_ns);
        self.correction.advance(seconds.min(MAX_STEP_S));
        shift_rows(self.level, right, &self.correction.applied(), out);
        self.record.corrected_px = self.correction.applied().offset_px as f32;
    }

    /// Checks a pair after matching, at every `calibration.every_frames`-th call. `pair.right` is the image that
    /// [`Self::correct`] has written.
    pub fn update(&mut self, pair: MatchedPair<'_>, source_ns: u64) {
        let phase = self.frames % self.every;
        self.frames += 1;
        let is_first = self.frames <= FIRST_LOOKS && self.pairing.result() == Pairing::Unknown;
        // Not in the frame that bears the other check, but for the first ones: a recording may have no others.
        if is_first || phase == self.every / 2 {
            if self.pairing.result() != Pairing::Pair || self.looks.is_multiple_of(PAIRING_EVERY) {
                self.pairing.update(pair.left, pair.right);
                self.judge();
            }
            self.looks += 1;
        }
        if phase != 0 {
            return;
        }
        let seconds = seconds_since(self.check_ns.replace(source_ns), source_ns);
        let health = self.check.update(pair, &self.correction.applied(), seconds);
        if health.state != EpipolarState::Unknown {
            self.correction.update(&self.check);
        }
        self.judge();
    }

    /// The record after a check.
    fn judge(&mut self) {
        let health = self.check.health();
        let total_px = self.check.typical_px(&health.total);
        let is_beyond = self.correct_px > 0.0 && total_px > self.correct_px;
        let record = &mut self.record;
        record.total_px = total_px as f32;
        let cause = match self.pairing.result() {
            Pairing::Swapped => CalibrationCause::Swapped,
            Pairing::Identical => CalibrationCause::Identical,
            // Points that agree on a small offset measure better than the reduced images.
            Pairing::RowsApart(px) if health.state != EpipolarState::Good => {
                record.total_px = px.abs() as f32;
                CalibrationCause::Apart
            }
            // While nothing can be measured, the last result stands.
            _ if health.state == EpipolarState::Unknown => match record.cause() {
                cause if cause.is_pairing() => CalibrationCause::None,
                cause => cause,
            },
            _ if is_beyond => CalibrationCause::Limit,
            _ if health.state == EpipolarState::Degraded => CalibrationCause::Rows,
            _ => CalibrationCause::None,
        };
        let state = match health.state {
            _ if cause != CalibrationCause::None => CalibrationState::Degraded,
            EpipolarState::Unknown => CalibrationState::Unknown,
            EpipolarState::Good | EpipolarState::Degraded => CalibrationState::Good,
        };
        let moved_px = self.correction.moved_px();
        let disparity_px = DISPARITY_PX_PER_PX * health.typical_px
            // A mount that turned up or down may have turned aside as much, which no row shows.
            + if self.correction.has_moved() { moved_px } else { 0.0 };
        let error = (disparity_px * self.error_per_px).min(f64::from(MAX_DISTANCE_ERROR));
        record.state = state as u32;
        record.cause = cause as u32;
        record.offset_px = health.remaining.offset_px as f32;
        record.across_px = health.remaining.across_px as f32;
        record.down_px = health.remaining.down_px as f32;
        record.typical_px = health.typical_px as f32;
        record.sigma_px = health.sigma_px as f32;
        record.lost = health.lost as f32;
        record.distance_error = error as f32;
        record.moved_px = moved_px as f32;
        record.moved = u32::from(self.correction.has_moved());
    }
}

/// Time since an earlier frame, in seconds; 0 without one, or if the source's time went back.
fn seconds_since(before: Option<u64>, now_ns: u64) -> f64 {
    before.map_or(0.0, |before| now_ns.saturating_sub(before) as f64 * 1e-9)
}
