//! Whether rows of both pictures still match, looked at beside the matching, and the shift of rows
//! that makes small offsets good.

use config::Config;
use messages::calibration::{CalibrationRecord, CalibrationState};
use perception::image::GreyView;
use perception::rectify::{Remap, RemapError};
use perception::simd::Level;
use perception::stereo::DisparityView;
use perception::stereo::epipolar::{EpipolarCheck, EpipolarHealth, EpipolarParameters, EpipolarState};

/// Looks at a degraded calibration before it is corrected: until then the estimate has settled.
const SETTLED: u32 = 4;

/// The check of a run, and its correction.
pub struct CalibrationMonitor {
    check: EpipolarCheck,
    size: (usize, usize),
    every: u64,
    frames: u64,
    /// The greatest offset that is corrected; 0 corrects nothing.
    correct_px: f64,
    /// Looks in a row that found the calibration degraded.
    degraded: u32,
    /// The whole shift of rows, and its table; made anew when the shift changes, not by frames.
    correction: EpipolarHealth,
    table: Option<Remap>,
    shifted: Vec<u8>,
    record: CalibrationRecord,
}

impl CalibrationMonitor {
    /// The check that the configuration asks for, of frames of `width` × `height`; `None` when it asks
    /// for none.
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

    /// What the frames so far say.
    pub fn record(&self) -> CalibrationRecord {
        self.record
    }

    /// The right picture as it is to be matched: its rows shifted, if they are corrected.
    ///
    /// # Errors
    /// When it has another size than the run.
    pub fn right<'a>(&'a mut self, right: GreyView<'a>) -> Result<GreyView<'a>, RemapError> {
        let Some(table) = &self.table else { return Ok(right) };
        table.apply(right, &mut self.shifted)?;
        let (width, height) = self.size;
        Ok(GreyView::new(&self.shifted, width, height, width).unwrap_or(right))
    }

    /// Looks at a pair that was matched; `right` as the source gave it.
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
        let seen = match &self.table {
            // Still there from the matching.
            Some(_) => GreyView::new(&self.shifted, width, height, width).unwrap_or(right),
            None => right,
        };
        let health = self.check.update(left, seen, disparity, confidence);
        self.record.offset_px = health.offset_px as f32;
        self.record.across_px = health.across_px as f32;
        self.record.down_px = health.down_px as f32;
        self.record.worst_px = health.worst_px as f32;
        self.record.sigma_px = health.sigma_px as f32;
        let state = match health.state {
            EpipolarState::Good => CalibrationState::Good,
            EpipolarState::Degraded => CalibrationState::Degraded,
            // Freshly corrected: degraded until it is seen to be good.
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

    /// Shifts the rows by what is left of the offset, unless that makes too large a shift.
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
        tracing::info!(offset_px = correction.offset_px, "the right picture's rows are shifted");
        let (width, height) = self.size;
        let source = |x, y| Some(correction.corrected((width, height), x, y));
        self.table = Some(Remap::new(Level::best(), width, height, source));
        self.correction = correction;
        self.record.corrected_px = correction.offset_px as f32;
        self.check.reset();
    }
}
