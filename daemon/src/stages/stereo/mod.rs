//! Pair to depth.

mod calibration;
pub mod matcher;
pub mod parameters;

use super::stage::{FrameContext, FrameError, SetupError, Stage};
use crate::launch::FrameFormat;
use calibration::CalibrationMonitor;
use config::Config;
use matcher::{Backend, Method};
use messages::alarm::Faults;
use messages::calibration::{CalibrationRecord, CalibrationState};
use messages::depth::{DepthMessage, DepthMut};
use messages::device::DeviceRecord;
use messages::pair::{Pair, PairMessage};
use messages::typed::{Output, Written};
use perception::image::GreyView;
use perception::image_quality::{ImageFaults, ImageMonitor};
use perception::stereo::{DisparityView, MatchOutput, Matcher};
use std::time::{Duration, Instant};

/// The matcher between its messages.
pub struct StereoStage {
    matcher: Box<dyn Matcher>,
    calibration: Option<CalibrationMonitor>,
    /// Looks at the pictures themselves, if it is asked for.
    sight: Option<ImageMonitor>,
    seen: ImageFaults,
    /// A frame gets no more time than this; None is all that it takes.
    budget: Option<Duration>,
    /// Frames that were given at a coarser scale, for want of time.
    coarse: u64,
    width: usize,
    height: usize,
    /// Whether the loss of the device was logged.
    loss_told: bool,
}

impl StereoStage {
    /// Matches a pair into the maps of a message.
    fn matched(&mut self, frame: &FrameContext, pair: Pair<'_>, out: DepthMut<'_>) -> Result<(), FrameError> {
        out.left.copy_from_slice(pair.left);
        let view = |data| GreyView::new(data, self.width, self.height, self.width);
        let (left, right) = (view(pair.left)?, view(pair.right)?);
        if let Some(sight) = &mut self.sight {
            self.seen = sight.update(left, right);
        }
        let shifted = match &mut self.calibration {
            Some(calibration) => calibration.right(right)?,
            None => right,
        };
        for (y, row) in out.right.chunks_exact_mut(self.width).enumerate() {
            row.copy_from_slice(shifted.row(y));
        }
        let output = MatchOutput { disparity: &mut *out.disparity, confidence: &mut *out.confidence };
        let started = Instant::now();
        let budget = self.budget;
        let mut go_on = || budget.is_none_or(|budget| started.elapsed() < budget);
        let halved = self.matcher.compute_within(left, shifted, output, &mut go_on)?;
        if !self.loss_told
            && let Some(device) = self.matcher.device()
            && let Some(loss) = device.loss
        {
            self.loss_told = true;
            tracing::error!(adapter = device.adapter, %loss, sequence = frame.sequence, "the CPU matches from this frame on");
        }
        if halved > 0 {
            self.coarse += 1;
            // The first, then ever more rarely: a log must not grow with every frame.
            if self.coarse.is_power_of_two() {
                tracing::warn!(
                    scale = format_args!("1/{}", 1 << halved),
                    frames = self.coarse,
                    "out of time: a coarser map was given; raise stereo.budget_ms or lower stereo.disparities"
                );
            }
        }
        // A coarse map is too blunt to find points by.
        if let (Some(calibration), 0) = (&mut self.calibration, halved)
            && let Some(map) = DisparityView::new(out.disparity, self.width, self.height)
        {
            calibration.update(left, right, map, out.confidence);
        }
        Ok(())
    }
}

impl Stage for StereoStage {
    type In = PairMessage;
    type Out = DepthMessage;

    fn new(config: &Config, format: &FrameFormat) -> Result<Self, SetupError> {
        let (width, height) = (format.width, format.height);
        let disparities = usize::try_from(config.stereo.disparities).unwrap_or(0);
        let backend = Backend::configured(config);
        let matcher = Method::configured(config).matcher(backend, config, width, height, disparities)?;
        if let Some(device) = matcher.device() {
            tracing::info!(adapter = device.adapter, driver = device.driver, "matches on a GPU");
        }
        let budget =
            (config.stereo.budget_ms > 0.0).then(|| Duration::from_secs_f64(config.stereo.budget_ms * 1e-3));
        let calibration = CalibrationMonitor::new(config, width, height);
        let sight = config.alarm.self_check.then(ImageMonitor::default);
        let seen = ImageFaults::default();
        let (coarse, loss_told) = (0, false);
        Ok(Self { matcher, calibration, sight, seen, budget, coarse, width, height, loss_told })
    }

    fn check(config: &Config, format: &FrameFormat) -> Result<(), SetupError> {
        Ok(matcher::check(config, format.width, format.height)?)
    }

    fn process(
        &mut self,
        frame: &FrameContext,
        pair: Pair<'_>,
        output: Output<'_, DepthMessage>,
    ) -> Result<Written, FrameError> {
        output.write(self.width * self.height, |out| self.matched(frame, pair, out))
    }

    fn device(&self) -> DeviceRecord {
        let Some(device) = self.matcher.device() else { return DeviceRecord::default() };
        // No text is made of a loss before there is one: this is asked for every frame.
        let loss = device.loss.map(|loss| loss.to_string());
        let mut record = DeviceRecord::new(device.adapter, device.driver, loss.as_deref());
        record.set_times_ns(device.stages.iter().map(|stage| stage.ns));
        record
    }

    fn calibration(&self) -> CalibrationRecord {
        self.calibration.as_ref().map(CalibrationMonitor::record).unwrap_or_default()
    }

    fn faults(&self) -> Faults {
        let ImageFaults { dark, bright, blocked, contrast_mismatch } = self.seen;
        let is_degraded = self.calibration().state() == CalibrationState::Degraded;
        Faults::DARK
            .when(dark)
            .and(Faults::BRIGHT.when(bright))
            .and(Faults::BLOCKED.when(blocked))
            .and(Faults::UNLIKE.when(contrast_mismatch))
            .and(Faults::CALIBRATION.when(is_degraded))
    }
}
