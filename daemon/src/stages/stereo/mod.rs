//! The stage stereo: `pair` to `depth`.

mod calibration;
pub mod matcher;
pub mod parameters;
mod threads;

use super::stage::{FrameContext, FrameError, SetupError, Stage};
use crate::launch::{FrameFormat, Launch};
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
use perception::stereo::epipolar::MatchedPair;
use perception::stereo::{DisparityView, MatchOutput, Matcher};
use std::time::{Duration, Instant};

/// Adapter of the matcher, with the self-checks of images and calibration.
pub struct StereoStage {
    matcher: Box<dyn Matcher>,
    calibration: Option<CalibrationMonitor>,
    /// Self-check of the image quality; `None` without `alarm.self_check`.
    image_monitor: Option<ImageMonitor>,
    image_faults: ImageFaults,
    /// Maximum time for matching a frame; `None` = unlimited.
    budget: Option<Duration>,
    /// Number of frames whose map has a coarser scale because the time ran out.
    coarse: u64,
    width: usize,
    height: usize,
    /// Whether the loss of the device has been logged.
    loss_logged: bool,
}

impl StereoStage {
    /// Matches a pair into the maps of a message.
    fn matched(&mut self, frame: &FrameContext, pair: Pair<'_>, out: DepthMut<'_>) -> Result<(), FrameError> {
        out.left.copy_from_slice(pair.left);
        let view = |data| GreyView::new(data, self.width, self.height, self.width);
        let (left, right) = (view(pair.left)?, view(pair.right)?);
        if let Some(monitor) = &mut self.image_monitor {
            self.image_faults = monitor.update(left, right);
        }
        match &mut self.calibration {
            Some(calibration) => calibration.correct(right, frame.source_ns, out.right),
            None => out.right.copy_from_slice(pair.right),
        }
        let right = view(out.right)?;
        let output = MatchOutput { disparity: &mut *out.disparity, confidence: &mut *out.confidence };
        let started = Instant::now();
        let budget = self.budget;
        let mut has_time = || budget.is_none_or(|budget| started.elapsed() < budget);
        let halved = self.matcher.compute_within(left, right, output, &mut has_time)?;
        if !self.loss_logged
            && let Some(device) = self.matcher.device()
            && let Some(loss) = device.loss
        {
            self.loss_logged = true;
            tracing::error!(adapter = device.adapter, %loss, sequence = frame.sequence, "the CPU matches from this frame on");
        }
        if halved > 0 {
            self.coarse += 1;
            // Logged at counts 1, 2, 4, 8, …: the log must not grow with every frame.
            if self.coarse.is_power_of_two() {
                tracing::warn!(
                    scale = format_args!("1/{}", 1 << halved),
                    frames = self.coarse,
                    "out of time: the map has a coarser scale; raise stereo.budget_ms or lower stereo.disparities"
                );
            }
        }
        // A map of a coarser scale is too inaccurate for the epipolar check.
        if let (Some(calibration), 0) = (&mut self.calibration, halved)
            && let Some(disparity) = DisparityView::new(out.disparity, self.width, self.height)
        {
            let pair = MatchedPair { left, right, disparity, confidence: out.confidence };
            calibration.update(pair, frame.source_ns);
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
            tracing::info!(adapter = device.adapter, driver = device.driver, "matching on a GPU");
        }
        let budget =
            (config.stereo.budget_ms > 0.0).then(|| Duration::from_secs_f64(config.stereo.budget_ms * 1e-3));
        let calibration = CalibrationMonitor::new(config, format);
        Ok(Self {
            matcher,
            calibration,
            image_monitor: config.alarm.self_check.then(ImageMonitor::default),
            image_faults: ImageFaults::default(),
            budget,
            coarse: 0,
            width,
            height,
            loss_logged: false,
        })
    }

    fn enter(launch: &Launch) -> Result<(), SetupError> {
        threads::start(launch)
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
        // Called for every frame, so a text is only formatted if there is a loss.
        let loss = device.loss.map(|loss| loss.to_string());
        let mut record = DeviceRecord::new(device.adapter, device.driver, loss.as_deref());
        record.set_times_ns(device.stages.iter().map(|stage| stage.ns));
        record
    }

    fn calibration(&self) -> CalibrationRecord {
        self.calibration.as_ref().map(CalibrationMonitor::record).unwrap_or_default()
    }

    fn faults(&self) -> Faults {
        let ImageFaults { dark, bright, blocked, contrast_mismatch } = self.image_faults;
        let calibration = self.calibration();
        let is_degraded = calibration.state() == CalibrationState::Degraded;
        let is_pairing = calibration.cause().is_pairing();
        Faults::DARK
            .when(dark)
            .and(Faults::BRIGHT.when(bright))
            .and(Faults::BLOCKED.when(blocked))
            .and(Faults::UNLIKE.when(contrast_mismatch))
            .and(Faults::CALIBRATION.when(is_degraded && !is_pairing))
            .and(Faults::PAIRING.when(is_degraded && is_pairing))
    }
}
