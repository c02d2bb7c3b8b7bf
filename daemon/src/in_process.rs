//! The same rooms in one process, one after the other: the reference for the daemon's results,
//! and the quickest way through a recording.

use crate::frame_record::frame_record;
use crate::input::{self, InputError};
use crate::launch::FrameFormat;
use crate::rooms::recognition::RecognitionRoom;
use crate::rooms::road::RoadRoom;
use crate::rooms::stereo::StereoRoom;
use crate::rooms::{FrameError, Room, RoomError};
use config::Config;
use messages::header::{Header, Kind, MessageError};
use messages::{depth, obstacles, pair, regions};
use sources::{PairSource, SourceError};
use thiserror::Error;
use tools::reporting::overlay::OverlayInput;
use tools::reporting::record::FrameRecord;

/// Why a frame cannot be worked on.
#[derive(Debug, Error)]
pub enum PipelineError {
    /// No input.
    #[error(transparent)]
    Input(#[from] InputError),
    /// A pair.
    #[error(transparent)]
    Source(#[from] SourceError),
    /// A room.
    #[error(transparent)]
    Room(#[from] RoomError),
    /// A frame.
    #[error(transparent)]
    Frame(#[from] FrameError),
    /// A message between two rooms.
    #[error(transparent)]
    Message(#[from] MessageError),
}

/// Memory of one message, aligned like shared memory.
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

/// All rooms and the messages between them.
pub struct Pipeline {
    source: Box<dyn PairSource>,
    format: FrameFormat,
    source_period_ns: u64,
    stereo: StereoRoom,
    road: RoadRoom,
    recognition: RecognitionRoom,
    pair: Buffer,
    depth: Buffer,
    regions: Buffer,
    obstacles: Buffer,
}

/// What came out of one frame.
pub struct FrameResult<'a> {
    /// The record.
    pub record: FrameRecord,
    /// The images for an overlay.
    pub images: OverlayInput<'a>,
    /// The regions, before they were tracked.
    pub regions: &'a [regions::RegionRecord],
    /// Whether a road was seen.
    pub road_seen: bool,
}

impl Pipeline {
    /// Opens the source that the configuration names and furnishes the rooms.
    ///
    /// # Errors
    /// When the source, its calibration or a room cannot be used.
    pub fn open(config: &Config) -> Result<Self, PipelineError> {
        let source = input::open(config)?;
        let rig = input::rig(config, source.as_ref())?;
        Self::new(config, source, rig)
    }

    /// Furnishes the rooms for a source that is already open.
    ///
    /// # Errors
    /// When a room cannot be used.
    pub fn new(
        config: &Config,
        source: Box<dyn PairSource>,
        rig: perception::rig::Rig,
    ) -> Result<Self, PipelineError> {
        let format = FrameFormat::new(source.size(), rig);
        let stereo = StereoRoom::new(config, &format)?;
        let road = RoadRoom::new(config, &format);
        let recognition = RecognitionRoom::new(config, &format)?;
        Ok(Self {
            source_period_ns: source.period_ns(),
            pair: Buffer::new(pair::payload_bytes(format.width, format.height)),
            depth: Buffer::new(stereo.output_bytes()),
            regions: Buffer::new(road.output_bytes()),
            obstacles: Buffer::new(recognition.output_bytes()),
            recognition,
            stereo,
            road,
            source,
            format,
        })
    }

    /// Pairs of the source.
    pub fn count(&self) -> Option<u64> {
        self.source.count()
    }

    /// Takes pair `index` of the source through all rooms, as frame `sequence`.
    ///
    /// # Errors
    /// When the pair cannot be read.
    pub fn frame(&mut self, sequence: u64, index: u64) -> Result<FrameResult<'_>, PipelineError> {
        let mut header = Header::new(Kind::Pair);
        header.sequence = sequence;
        let rounds = sequence.saturating_sub(index).saturating_mul(self.source_period_ns);
        header.source_ns = rounds.saturating_add(self.source.time_ns(index));
        header.width = self.format.width as u32;
        header.height = self.format.height as u32;
        let (left, right) = pair::split_mut(self.pair.get_mut());
        self.source.read(index, left, right)?;
        self.stereo.process(&header, self.pair.get(), self.depth.get_mut())?;
        let mut header = header.forward(Kind::Depth);
        header.faults |= self.stereo.faults().0;
        self.road.process(&header, self.depth.get(), self.regions.get_mut())?;
        let mut header = header.forward(Kind::Regions);
        header.faults |= self.road.faults().0;
        let bytes = self.recognition.process(&header, self.regions.get(), self.obstacles.get_mut())?;
        let obstacles_header = header.forward(Kind::Obstacles);
        let message = obstacles::view(&obstacles_header, &self.obstacles.get()[..bytes])?;
        let record = frame_record(&obstacles_header, &message);
        let depth = depth::view(&header.forward(Kind::Depth), self.depth.get())?;
        let regions = regions::view(&header, self.regions.get())?;
        let images = OverlayInput {
            left: depth.left,
            disparity: depth.disparity,
            profile_px: regions.profile_px,
            edges: regions.edge_points(),
            width: self.format.width,
            height: self.format.height,
        };
        Ok(FrameResult { record, images, regions: regions.regions, road_seen: regions.road.seen == 1 })
    }
}
