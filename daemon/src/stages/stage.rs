//! The trait [`Stage`]: one message in, one message out, independent of processes and shared memory.

use crate::launch::{FrameFormat, Launch};
use crate::stages::recognition::detectors::DetectorError;
use crate::stages::stereo::matcher::BackendError;
use config::Config;
use messages::alarm::Faults;
use messages::calibration::CalibrationRecord;
use messages::device::DeviceRecord;
use messages::header::{Header, Kind, MessageError};
use messages::motion::{MotionRecord, VehicleRecord};
use messages::source_time::SourceTimeRecord;
use messages::typed::{Message, Output, Written};
use perception::stereo::MatchError;
use thiserror::Error;

/// The work of one stage on one frame: configured once, then called with each message.
pub trait Stage: Sized {
    /// The message that it reads.
    type In: Message;

    /// The message that it writes.
    type Out: Message;

    /// Configures the stage for the frames of a run and allocates its memory.
    ///
    /// # Errors
    /// If the configuration or a file that it names cannot be used.
    fn new(config: &Config, format: &FrameFormat) -> Result<Self, SetupError>;

    /// Starts what the stage has in a process of its own, before [`Self::new`] in the same thread.
    ///
    /// # Errors
    /// If the system refuses it.
    fn enter(_launch: &Launch) -> Result<(), SetupError> {
        Ok(())
    }

    /// Checks cheaply, in the scheduler and before the start, whether [`Self::new`] would fail.
    ///
    /// # Errors
    /// As [`Self::new`].
    fn check(_config: &Config, _format: &FrameFormat) -> Result<(), SetupError> {
        Ok(())
    }

    /// Processes one message and writes the output in place.
    ///
    /// # Errors
    /// If the content of the message cannot be used. The message is then refused and counted.
    fn process(
        &mut self,
        frame: &FrameContext,
        input: <Self::In as Message>::View<'_>,
        output: Output<'_, Self::Out>,
    ) -> Result<Written, FrameError>;

    /// Epipolar alignment after the last frame; all zeros if it is not monitored.
    fn calibration(&self) -> CalibrationRecord {
        CalibrationRecord::default()
    }

    /// Self-checks that failed for the last frame; its header carries them to the following stages.
    fn faults(&self) -> Faults {
        Faults::NONE
    }

    /// The vehicle's own motion after the last frame, if the stage determines it; its header carries it to the following
    /// stages.
    fn motion(&self) -> Option<MotionRecord> {
        None
    }

    /// The device that the stage computes on; all zeros for the CPU.
    fn device(&self) -> DeviceRecord {
        DeviceRecord::default()
    }

    /// What was wrong with the time of the source so far; all zeros if the stage does not count it.
    fn source_time(&self) -> SourceTimeRecord {
        SourceTimeRecord::default()
    }
}

/// Properties of a frame apart from the content of its message.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct FrameContext {
    /// Number of the frame in its source, from 0.
    pub sequence: u64,
    /// When the pair was captured, in nanoseconds of CLOCK_MONOTONIC.
    pub capture_ns: u64,
    /// Source time: time in the recording, the scene or of the camera, in nanoseconds. Filters use it.
    pub source_ns: u64,
    /// Number of messages directly before this one that the stage has not received, because newer ones overtook them.
    pub missed: u64,
    /// How stages treat the frame: bits of [`messages::header::modes`].
    pub modes: u32,
    /// Self-checks that failed in earlier stages.
    pub faults: Faults,
    /// What the vehicle reported.
    pub vehicle: VehicleRecord,
    /// The vehicle's own motion, behind the stage that determines it.
    pub motion: MotionRecord,
}

impl FrameContext {
    /// The context of a message with this header.
    pub fn of(header: &Header, missed: u64) -> Self {
        Self {
            sequence: header.sequence,
            capture_ns: header.capture_ns,
            source_ns: header.source_ns,
            missed,
            modes: header.modes,
            faults: Faults(header.faults),
            vehicle: header.vehicle,
            motion: header.motion,
        }
    }
}

/// A [`Stage`] with untyped messages, for the frame loop and the in-process run.
pub trait FrameStage {
    /// Kind of the message that it reads.
    fn input(&self) -> Kind;

    /// Kind of the message that it writes.
    fn output(&self) -> Kind;

    /// Checks a message, processes it, and writes the output to the start of `output`. Returns its length in bytes.
    ///
    /// # Errors
    /// If the message is invalid, or see [`Stage::process`].
    fn work(
        &mut self,
        header: &Header,
        missed: u64,
        payload: &[u8],
        output: &mut [u8],
    ) -> Result<usize, FrameError>;

    /// See [`Stage::calibration`].
    fn calibration(&self) -> CalibrationRecord;

    /// See [`Stage::faults`].
    fn faults(&self) -> Faults;

    /// See [`Stage::motion`].
    fn motion(&self) -> Option<MotionRecord>;

    /// See [`Stage::device`].
    fn device(&self) -> DeviceRecord;

    /// See [`Stage::source_time`].
    fn source_time(&self) -> SourceTimeRecord;
}

/// A stage and the frame format that it was configured for.
struct Configured<S> {
    stage: S,
    format: FrameFormat,
}

/// Configures a stage for the frames of a run.
///
/// # Errors
/// See [`Stage::new`].
pub fn configure<S: Stage + 'static>(
    config: &Config,
    format: &FrameFormat,
) -> Result<Box<dyn FrameStage>, SetupError> {
    Ok(Box::new(Configured { stage: S::new(config, format)?, format: *format }))
}

impl<S: Stage> FrameStage for Configured<S> {
    fn input(&self) -> Kind {
        S::In::KIND
    }

    fn output(&self) -> Kind {
        S::Out::KIND
    }

    fn work(
        &mut self,
        header: &Header,
        missed: u64,
        payload: &[u8],
        output: &mut [u8],
    ) -> Result<usize, FrameError> {
        let message = S::In::view(header, payload)?;
        if !self.format.has_size(header) {
            return Err(FrameError::Size {
                width: header.width,
                height: header.height,
                expected_width: self.format.width,
                expected_height: self.format.height,
            });
        }
        let context = FrameContext::of(header, missed);
        Ok(self.stage.process(&context, message, Output::new(output))?.bytes())
    }

    fn calibration(&self) -> CalibrationRecord {
        self.stage.calibration()
    }

    fn faults(&self) -> Faults {
        self.stage.faults()
    }

    fn motion(&self) -> Option<MotionRecord> {
        self.stage.motion()
    }

    fn device(&self) -> DeviceRecord {
        self.stage.device()
    }

    fn source_time(&self) -> SourceTimeRecord {
        self.stage.source_time()
    }
}

/// Why a stage cannot be configured. The text names the key or file and the remedy.
#[derive(Debug, Error)]
pub enum SetupError {
    /// The matcher does not support the size or the disparities, or its backend cannot be used.
    #[error(transparent)]
    Matcher(#[from] BackendError),
    /// The cascade cannot be used.
    #[error(transparent)]
    Detector(#[from] DetectorError),
    /// The signals of the vehicle's bus cannot be used.
    #[error(transparent)]
    Vehicle(#[from] sources::vehicle::VehicleError),
}

/// Why a frame cannot be used. Its message is refused and counted.
#[derive(Debug, Error)]
pub enum FrameError {
    /// The message is invalid.
    #[error(transparent)]
    Message(#[from] MessageError),
    /// The frame has another size than the run.
    #[error("the frame is {width}x{height}, this run has {expected_width}x{expected_height}")]
    Size {
        /// Width of the frame.
        width: u32,
        /// Height of the frame.
        height: u32,
        /// Width of the run.
        expected_width: usize,
        /// Height of the run.
        expected_height: usize,
    },
    /// The matcher refuses the images.
    #[error(transparent)]
    Match(#[from] MatchError),
    /// The row offsets of the right image cannot be corrected.
    #[error(transparent)]
    Remap(#[from] perception::rectify::RemapError),
    /// The bytes are not an image of the expected size.
    #[error(transparent)]
    Image(#[from] perception::image::ImageError),
}
