//! The writer: writes results to files, and records the run on request. It joins the messages of a frame in its own
//! memory, outside the real-time path.

mod inline_recorder;

use crate::frame_record::frame_record;
use crate::host::{Host, HostError};
use inline_recorder::{InlineRecorder, WRONG_SIZE};
use messages::clock::monotonic_ns;
use messages::header::Header;
use messages::obstacles::Obstacles;
use messages::port::{Sample, Subscriber};
use messages::report::Health;
use messages::wait::{self, Next};
use messages::{depth, obstacles, regions, service};
use tools::reporting::output::FrameWriter;
use tools::reporting::overlay::{EdgePoints, OverlayInput};

/// Number of frames whose images are kept until their obstacles arrive.
const KEPT: usize = 4;

/// Images and road of one frame.
#[derive(Default)]
struct Kept {
    /// Sequence of the frame of `left` and `disparity`.
    depth_of: Option<u64>,
    left: Vec<u8>,
    disparity: Vec<u16>,
    /// Sequence of the frame of `profile_px` and `edges`.
    profile_of: Option<u64>,
    profile_px: Vec<f32>,
    edges: EdgePoints,
}

/// Outputs of the writer, and the frames that wait for their obstacles.
struct Writer {
    files: Option<FrameWriter>,
    recorder: Option<InlineRecorder>,
    kept: [Kept; KEPT],
}

/// Runs the stage.
///
/// # Errors
/// If shared memory cannot be used, or results cannot be written.
pub fn run(mut host: Host) -> Result<(), HostError> {
    let files = host.launch.out.as_deref().map(FrameWriter::open).transpose()?;
    let path = host.launch.record.clone();
    let recorder = path.map(|path| InlineRecorder::start(&host, &path)).transpose()?;
    let depths = host.bus.subscriber(&service::DEPTH)?;
    let roads = host.bus.subscriber(&service::REGIONS)?;
    let results = host.bus.subscriber(&service::OBSTACLES)?;
    let mut sources = vec![&depths, &roads, &results];
    let pairs = recorder.is_some().then(|| host.bus.subscriber(&service::PAIR)).transpose()?;
    sources.extend(&pairs);
    let mut writer = Writer { files, recorder, kept: std::array::from_fn(|_| Kept::default()) };
    host.ready()?;
    wait::run::<HostError>(&sources, || {
        if host.should_stop() {
            return Ok(Next::Stop);
        }
        // The obstacles are received first: the messages from which they were computed have then arrived.
        let result = next_result(&results)?;
        keep_depth(&mut host, &depths, &mut writer.kept)?;
        keep_profile(&mut host, &roads, &mut writer.kept)?;
        let missed = results.take_missed();
        host.skipped(missed);
        if let (Some(recorder), Some(pairs)) = (&mut writer.recorder, &pairs) {
            recorder.follow(&mut host, pairs)?;
            if recorder.is_over() {
                return Ok(Next::Stop);
            }
        }
        if let Some(sample) = result {
            writer.take(&mut host, &sample, missed)?;
        }
        Ok(Next::Wait(host.heartbeat()?))
    })?;
    let Some(Err(error)) = writer.recorder.map(InlineRecorder::finish) else { return Ok(()) };
    // The recording is incomplete, and a restart would not help.
    host.set_health(Health::Unusable, &error.to_string())?;
    wait::run(&[], || Ok(if host.should_stop() { Next::Stop } else { Next::Wait(host.heartbeat()?) }))
}

/// The next result. Withdrawals by the scheduler are not results and are ignored.
fn next_result(results: &Subscriber) -> Result<Option<Sample>, HostError> {
    let mut result = results.receive()?;
    while result.as_ref().is_some_and(|sample| sample.header().withdraws == 1) {
        // A message has to be dropped before the next is received.
        drop(result);
        result = results.receive()?;
    }
    Ok(result)
}

impl Writer {
    /// Checks a result, and writes it unless that was done before.
    fn take(&mut self, host: &mut Host, sample: &Sample, missed: u64) -> Result<(), HostError> {
        let begin_ns = monotonic_ns();
        let header = *sample.header();
        match obstacles::view(&header, sample.payload()) {
            Err(error) => host.refused("obstacles", &error),
            Ok(_) if !host.launch.frames.has_size(&header) => host.refused("obstacles", &WRONG_SIZE),
            // A frame that was repeated after a stage died is written once.
            Ok(_) if self.files.as_ref().and_then(FrameWriter::last) == Some(header.sequence) => {
                host.frame_done(&header, 0, 0)?;
            }
            Ok(message) => {
                if self.write(host, &header, &message, missed)? {
                    let age_ns = begin_ns.saturating_sub(header.capture_ns);
                    host.frame_done(&header, age_ns, monotonic_ns() - begin_ns)?;
                }
            }
        }
        Ok(())
    }

    /// Writes and records a result with the images of its frame. Returns false if it has to wait for the repetition of
    /// the frame.
    fn write(
        &mut self,
        host: &mut Host,
        header: &Header,
        message: &Obstacles,
        missed: u64,
    ) -> Result<bool, HostError> {
        let (format, of) = (host.launch.frames, Some(header.sequence));
        let images = self.kept.iter().find(|k| k.depth_of == of && k.profile_of == of);
        let input = images.map(|k| OverlayInput {
            left: &k.left,
            disparity: &k.disparity,
            profile_px: &k.profile_px,
            edges: k.edges,
            width: format.width,
            height: format.height,
            rig: format.rig(),
        });
        let is_whole = self.files.is_none() || input.is_some();
        let has_pair = self.recorder.as_ref().is_none_or(|r| r.has_pair(header.sequence));
        if !is_whole || (host.launch.lockstep && !has_pair) {
            if host.launch.lockstep {
                // Its images were sent before this writer started; the scheduler requests the frame again.
                return Ok(false);
            }
            // At live rate the result is written without images.
            host.skipped(1);
        }
        if let Some(recorder) = &mut self.recorder {
            recorder.result(header, message, missed);
        }
        if let Some(files) = &mut self.files {
            files.write(&frame_record(header, message), input)?;
        }
        Ok(true)
    }
}

/// Keeps the images of all depth messages that have arrived.
fn keep_depth(host: &mut Host, depths: &Subscriber, kept: &mut [Kept; KEPT]) -> Result<(), HostError> {
    while let Some(sample) = depths.receive()? {
        let header = sample.header();
        let format = host.launch.frames;
        match depth::view(header, sample.payload()) {
            Err(error) => host.refused("depth", &error),
            Ok(_) if !format.has_size(header) => host.refused("depth", &WRONG_SIZE),
            Ok(message) => {
                let slot = &mut kept[(header.sequence % KEPT as u64) as usize];
                slot.depth_of = Some(header.sequence);
                slot.left.clear();
                slot.left.extend_from_slice(message.left);
                slot.disparity.clear();
                slot.disparity.extend_from_slice(message.disparity);
            }
        }
        host.heartbeat()?;
    }
    Ok(())
}

/// Keeps the road of all regions messages that have arrived.
fn keep_profile(host: &mut Host, roads: &Subscriber, kept: &mut [Kept; KEPT]) -> Result<(), HostError> {
    while let Some(sample) = roads.receive()? {
        let header = sample.header();
        let format = host.launch.frames;
        match regions::view(header, sample.payload()) {
            Err(error) => host.refused("regions", &error),
            Ok(_) if !format.has_size(header) => host.refused("regions", &WRONG_SIZE),
            Ok(message) => {
                let slot = &mut kept[(header.sequence % KEPT as u64) as usize];
                slot.profile_of = Some(header.sequence);
                slot.profile_px.clear();
                slot.profile_px.extend_from_slice(message.profile_px);
                slot.edges = message.edge_points();
            }
        }
        host.heartbeat()?;
    }
    Ok(())
}
