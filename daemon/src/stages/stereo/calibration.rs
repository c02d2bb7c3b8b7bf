//! Monitoring of the epipolar alignment, and correction of small vertical offsets by shifting the rows of the right
//! image.

use config::Config;
use messages::calibration::{CalibrationRecord, CalibrationState};
use perception::image::GreyView;
use perception::rectify::{Remap, RemapError};
use perception::simd::Level;
use perception::stereo::DisparityView;
use perception::stereo::epipolar::{EpipolarCheck, EpipolarHealth, EpipolarParameters, EpipolarState};

/// Number of checks in a row with a degraded calibration before it is corrected, so that the estimate has settled.
const SETTLED: u32 = 4;

/// Epipolar check and correction of a run.
pub struct CalibrationMonitor {
    check: EpipolarCheck,
    size: (usize, usize),
    every: u64,
    frames: u64,
    /// Maximum offset that is corrected, in px; 0 = no correction.
    correct_px: f64,
    /// Number of checks in a row with a degraded calibration.
    degraded: u32,
    /// The total correction of the rows.
    correction: EpipolarHealth,
    /// Its remap table, computed when the correction changes.
    table: Option<Remap>,
    /// The right image after the correction.
    shifted: Vec<u8>,
    record: CalibrationRecord,
}

impl CalibrationMonitor {
    /// The configured monitor for frames of `width` × `height` pixels; `None` without `calibration.check`.
    pub fn new(config: &Config, width: usize, height: usize) -> Option<Self> {
        let c = &config.calibration;
        let parameters = EpipolarParameters { bound_px: c.bound_px, ..EpipolarParameters::default() };
        let correct_px = c.correct_px;
        c.check.then(|| Self {
            check: EpipolarCheck::new(parameters),
            size: (width, height),
            every: c.every_frames.unsigned_abs().max(1),
            frames: 0,
            correct_px,
            degraded: 0,
            correction: EpipolarHealth::default(),
            table: None,
            shifted: if correct_px > 0.0 { vec![0; width * height] } else { Vec::new() },
            record: CalibrationRecord {
                state: CalibrationState::Unknown as u32,
                bound_px: parameters.bound_px as f32,
                ..CalibrationRecord::default()
            },
        })
    }

    /// State and offsets after the frames so far.
    pub fn record(&self) -> CalibrationRecord {
        self.record
    }

    /// The right image for the matcher, with its rows shifted if a correction is active.
    ///
    /// # Errors
    /// If it has another size than the run.
    pub fn right<'a>(&'a mut self, right: GreyView<'a>) -> Result<GreyView<'a>, RemapError> {
        let Some(table) = &self.table else { return Ok(right) };
        table.apply(right, &mut self.shifted)?;
        let (width, height) = self.size;
        Ok(GreyView::new(&self.shifted, width, height, width).unwrap_or(right))
    }

    /// Checks a pair after matching, at every `calibration.every_frames`-th call. `right` is the image of the source,
    /// before any correction.
    pub fn update(
        &mut self,
        left: GreyView<'_>,
        right: GreyView<'_>,
        disparity: DisparityView<'_>,
        confidence: &[u8],
    ) {
        let is_due = self.frames.is_multiple_of(self.every);
        self.frames += 1;
        if !is_due {
            return;
        }
        let (width, height) = self.size;
        let matched = match &self.table {
            // Computed by `right` before the matching.
            Some(_) => GreyView::new(&self.shifted, width, height, width).unwrap_or(right),
            None => right,
        };
        let health = self.check.update(left, matched, disparity, confidence);
        self.record.offset_px = health.offset_px as f32;
        self.record.across_px = health.across_px as f32;
        self.record.down_px = health.down_px as f32;
        self.record.worst_px = health.worst_px as f32;
        self.record.sigma_px = health.sigma_px as f32;
        let state = match health.state {
            EpipolarState::Good => CalibrationState::Good,
            EpipolarState::Degraded => CalibrationState::Degraded,
            // After a correction it stays degraded until a check finds it good.
            EpipolarState::Unknown if self.record.state() == CalibrationState::Degraded => {
                CalibrationState::Degraded
            }
            EpipolarState::Unknown => CalibrationState::Unknown,
        };
        self.record.state = state as u32;
        self.degraded = if health.state == EpipolarState::Degraded { self.degraded + 1 } else { 0 };
        if self.correct_px > 0.0 && self.degraded >= SETTLED {
            self.degraded = 0;
            self.correct(health);
        }
    }

    /// Adds the remaining offset to the correction, unless the total would exceed `correct_px`.
    fn correct(&mut self, rest: EpipolarHealth) {
        let correction = EpipolarHealth {
            offset_px: self.correction.offset_px + rest.offset_px,
            across_px: self.correction.across_px + rest.across_px,
            down_px: self.correction.down_px + rest.down_px,
            ..EpipolarHealth::default()
        };
        let worst_px = correction.offset_px.abs() + correction.across_px.abs() + correction.down_px.abs();
        if worst_px > self.correct_px {
            return;
        }
        tracing::info!(offset_px = correction.offset_px, "rows of the right image are shifted");
        let (width, height) = self.size;
        let source = |x, y| Some(correction.corrected((width, height), x, y));
        self.table = Some(Remap::new(Level::best(), width, height, source));
        self.correction = correction;
        self.record.corrected_px = correction.offset_px as f32;
        self.check.reset();
    }
}
