//! The stages in one process, called one after the other: the reference for the daemon's results, and the fastest way
//! to process a recording.

use crate::frame_record::frame_record;
use crate::input::first_pairs::FirstPairs;
use crate::input::{self, InputError};
use crate::launch::FrameFormat;
use crate::stages;
use crate::stages::stage::{FrameError, FrameStage, SetupError};
use crate::stages::vehicle_record::record;
use config::Config;
use messages::header::{Header, Kind, MessageError};
use messages::motion::MotionRecord;
use messages::obstacles::AlarmRecord;
use messages::pipeline::SERVICES;
use messages::source_time::SourceTimeRecord;
use messages::track::{MAX_TRACKS, TrackRecord};
use messages::{Records, depth, obstacles, pair, regions};
use sources::{PairSource, SourceError};
use thiserror::Error;
use tools::reporting::overlay::OverlayInput;
use tools::reporting::record::FrameRecord;

/// Why a frame cannot be processed.
#[derive(Debug, Error)]
pub enum PipelineError {
    /// The source cannot be opened.
    #[error(transparent)]
    Input(#[from] InputError),
    /// A pair cannot be read.
    #[error(transparent)]
    Source(#[from] SourceError),
    /// A stage cannot be configured.
    #[error(transparent)]
    Setup(#[from] SetupError),
    /// A stage cannot use a frame.
    #[error(transparent)]
    Frame(#[from] FrameError),
    /// A message between two stages is invalid.
    #[error(transparent)]
    Message(#[from] MessageError),
}

/// Memory of one message, aligned to eight bytes as the stages require.
struct Buffer {
    memory: Vec<u64>,
    bytes: usize,
}

impl Buffer {
    fn new(bytes: usize) -> Self {
        Self { memory: vec![0; bytes.div_ceil(8)], bytes }
    }

    fn get(&self) -> &[u8] {
        &bytemuck::cast_slice(&self.memory)[..self.bytes]
    }

    fn get_mut(&mut self) -> &mut [u8] {
        &mut bytemuck::cast_slice_mut(&mut self.memory)[..self.bytes]
    }
}

/// The last message on a service.
struct Slot {
    kind: Kind,
    header: Header,
    buffer: Buffer,
    /// Length of its payload in bytes.
    bytes: usize,
}

/// All stages and the messages between them.
pub struct Pipeline {
    source: Box<dyn PairSource>,
    format: FrameFormat,
    source_period_ns: u64,
    first_pairs: FirstPairs,
    stages: Vec<Box<dyn FrameStage>>,
    /// One for each service that carries frames.
    slots: Vec<Slot>,
}

/// Result of one frame.
pub struct FrameResult<'a> {
    /// Alarm, road and obstacles.
    pub record: FrameRecord,
    /// Images and road for an overlay.
    pub images: OverlayInput<'a>,
    /// The tracks, with the places of their crops.
    pub tracks: Records<TrackRecord, MAX_TRACKS>,
    /// Whether a road was detected.
    pub road_seen: bool,
    /// The vehicle's own motion.
    pub motion: MotionRecord,
    /// The alarm.
    pub alarm: AlarmRecord,
    /// Source time, in ns.
    pub source_ns: u64,
}

impl Pipeline {
    /// Opens the source that the configuration names and configures the stages.
    ///
    /// # Errors
    /// If the source, its calibration or a stage cannot be used.
    pub fn open(config: &Config) -> Result<Self, PipelineError> {
        let source = input::open(config)?;
        input::tell_notes(source.as_ref());
        let rig = input::rig(config, source.as_ref())?;
        Self::new(config, source, rig)
    }

    /// Configures the stages for a source that is already open.
    ///
    /// # Errors
    /// If a stage cannot be configured.
    pub fn new(
        config: &Config,
        source: Box<dyn PairSource>,
        rig: perception::rig::Rig,
    ) -> Result<Self, PipelineError> {
        let format = FrameFormat::new(source.size(), rig);
        let stages = stages::configure_all(config, &format)?.into_iter().map(|(_, stage)| stage).collect();
        let slot = |kind: Kind| Slot {
            kind,
            header: Header::new(kind),
            buffer: Buffer::new(kind.service().max_payload_bytes(format.width, format.height)),
            bytes: 0,
        };
        let slots = SERVICES.iter().filter(|s| s.carries_frame).map(|s| slot(s.kind)).collect();
        let first_pairs = FirstPairs::new(source.size(), source.count(), config.calibration.check);
        Ok(Self { source_period_ns: source.period_ns(), first_pairs, stages, slots, source, format })
    }

    /// What was wrong with the source time so far.
    pub fn source_time(&self) -> SourceTimeRecord {
        let counts = self.stages.iter().map(|stage| stage.source_time());
        counts.fold(SourceTimeRecord::default(), |sum, one| sum.plus(&one))
    }

    /// Number of pairs of the source; `None` = unlimited or unknown.
    pub fn count(&self) -> Option<u64> {
        self.source.count()
    }

    /// Source time of pair `index`, in ns.
    pub fn time_ns(&self, index: u64) -> u64 {
        self.source.time_ns(index)
    }

    /// Processes pair `index` of the source with all stages, as frame `sequence`.
    ///
    /// # Errors
    /// If the pair cannot be read, or a stage cannot use it.
    pub fn frame(&mut self, sequence: u64, index: u64) -> Result<FrameResult<'_>, PipelineError> {
        let rounds = sequence.saturating_sub(index).saturating_mul(self.source_period_ns);
        let source_ns = rounds.saturating_add(self.source.time_ns(index));
        self.frame_at(sequence, index, source_ns)
    }

    /// The same, with another source time, in ns.
    ///
    /// # Errors
    /// See [`Self::frame`].
    pub fn frame_at(
        &mut self,
        sequence: u64,
        index: u64,
        source_ns: u64,
    ) -> Result<FrameResult<'_>, PipelineError> {
        self.run_stages(sequence, index, source_ns, Kind::Obstacles)?;
        let [depth, regions, obstacles] = [Kind::Depth, Kind::Regions, Kind::Obstacles].map(|kind| {
            let slot = &self.slots[place(&self.slots, kind)];
            (&slot.header, &slot.buffer.get()[..slot.bytes])
        });
        let message = obstacles::view(obstacles.0, obstacles.1)?;
        let record = frame_record(obstacles.0, &message);
        let (motion, source_ns, alarm) = (obstacles.0.motion, obstacles.0.source_ns, message.alarm);
        let depth = depth::view(depth.0, depth.1)?;
        let regions = regions::view(regions.0, regions.1)?;
        let images = OverlayInput {
            left: depth.left,
            disparity: depth.disparity,
            profile_px: regions.profile_px,
            edges: regions.edge_points(),
            width: self.format.width,
            height: self.format.height,
            rig: self.format.rig(),
        };
        let (road_seen, tracks) = (regions.road.seen == 1, regions.tracks);
        Ok(FrameResult { record, images, tracks, road_seen, motion, alarm, source_ns })
    }

    /// The left image of pair `index`, row-major, without processing it.
    ///
    /// # Errors
    /// If the pair cannot be read.
    pub fn left(&mut self, index: u64) -> Result<&[u8], PipelineError> {
        let pair = place(&self.slots, Kind::Pair);
        let (left, right) = pair::split_mut(self.slots[pair].buffer.get_mut());
        self.source.read(index, left, right)?;
        Ok(left)
    }

    /// The vehicle's own motion at pair `index` of the source, and its source time in ns. Stages after the road do not
    /// run; frames have to be processed in order.
    ///
    /// # Errors
    /// See [`Self::frame`].
    pub fn motion(&mut self, index: u64) -> Result<(u64, MotionRecord), PipelineError> {
        self.run_stages(index, index, self.source.time_ns(index), Kind::Regions)?;
        let header = &self.slots[place(&self.slots, Kind::Regions)].header;
        header.check(Kind::Regions)?;
        Ok((header.source_ns, header.motion))
    }

    /// Reads a pair and runs the stages up to the one that gives `last`.
    fn run_stages(
        &mut self,
        sequence: u64,
        index: u64,
        source_ns: u64,
        last: Kind,
    ) -> Result<(), PipelineError> {
        let mut header = Header::new(Kind::Pair);
        header.sequence = sequence;
        header.set_source_time(source_ns);
        header.width = self.format.width as u32;
        header.height = self.format.height as u32;
        let pair = place(&self.slots, Kind::Pair);
        let slot = &mut self.slots[pair];
        let (left, right) = pair::split_mut(slot.buffer.get_mut());
        self.source.read(index, left, right)?;
        self.first_pairs.look(left, right);
        header.vehicle = record(&self.source.vehicle(index));
        (slot.header, slot.bytes) = (header, slot.buffer.bytes);
        for stage in &mut self.stages {
            let from = place(&self.slots, stage.input());
            let to = place(&self.slots, stage.output());
            let Ok([input, output]) = self.slots.get_disjoint_mut([from, to]) else { continue };
            let payload = &input.buffer.get()[..input.bytes];
            output.bytes = stage.work(&input.header, 0, payload, output.buffer.get_mut())?;
            output.header = input.header.forward(output.kind);
            output.header.faults |= stage.faults().0;
            output.header.motion = stage.motion().unwrap_or(output.header.motion);
            if stage.output() == last {
                break;
            }
        }
        Ok(())
    }
}

/// Index of the slot of a kind of message. There is one for each kind that carries a frame.
fn place(slots: &[Slot], kind: Kind) -> usize {
    slots.iter().position(|slot| slot.kind == kind).unwrap_or(0)
}
