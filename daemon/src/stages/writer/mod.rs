//! Writes results to files, and records the run where asked to. It joins the streams of a frame in memory of its own, so that no
//! stage has to.

mod inline_recorder;

use crate::frame_record::frame_record;
use crate::host::{Host, HostError};
use inline_recorder::InlineRecorder;
use messages::clock::monotonic_ns;
use messages::port::Subscriber;
use messages::report::Health;
use messages::wait::{self, Next};
use messages::{depth, obstacles, regions, service};
use tools::reporting::output::FrameWriter;
use tools::reporting::overlay::{EdgePoints, OverlayInput};

/// Frames whose images are kept until their obstacles come.
const KEPT: usize = 4;

/// Images of one frame.
#[derive(Default)]
struct Kept {
    depth_of: Option<u64>,
    left: Vec<u8>,
    disparity: Vec<u16>,
    profile_of: Option<u64>,
    profile_px: Vec<f32>,
    edges: EdgePoints,
}

/// Runs the stage.
///
/// # Errors
/// When shared memory cannot be used, or results cannot be written.
pub fn run(mut host: Host) -> Result<(), HostError> {
    let format = host.launch.frames;
    let mut writer = host.launch.out.as_deref().map(FrameWriter::open).transpose()?;
    let path = host.launch.record.clone();
    let mut recorder = path.map(|path| InlineRecorder::start(&host, &path)).transpose()?;
    let depths = host.bus.subscriber(&service::DEPTH)?;
    let roads = host.bus.subscriber(&service::REGIONS)?;
    let results = host.bus.subscriber(&service::OBSTACLES)?;
    let mut sources = vec![&depths, &roads, &results];
    let pairs = recorder.is_some().then(|| host.bus.subscriber(&service::PAIR)).transpose()?;
    sources.extend(&pairs);
    let mut kept: [Kept; KEPT] = std::array::from_fn(|_| Kept::default());
    host.ready()?;
    wait::run::<HostError>(&sources, || {
        if host.should_stop() {
            return Ok(Next::Stop);
        }
        // Obstacles first: whatever they were made from was sent before, and is there by now.
        let mut result = results.receive()?;
        while result.as_ref().is_some_and(|sample| sample.header().withdraws == 1) {
            // That a stage died is no result to be written. It goes before the next is received.
            drop(result);
            result = results.receive()?;
        }
        keep_depth(&mut host, &depths, &mut kept)?;
        keep_profile(&mut host, &roads, &mut kept)?;
        let missed = results.take_missed();
        host.skipped(missed);
        if let (Some(recorder), Some(pairs)) = (&mut recorder, &pairs) {
            recorder.follow(&mut host, pairs)?;
            if recorder.is_over() {
                return Ok(Next::Stop);
            }
        }
        if let Some(sample) = result {
            let begin_ns = monotonic_ns();
            let header = *sample.header();
            match obstacles::view(&header, sample.payload()) {
                Err(error) => host.refused("obstacles", &error),
                Ok(_) if !format.has_size(&header) => {
                    host.refused("obstacles", &"another size than the run's");
                }
                // A frame that came again after a stage died is written once.
                Ok(_) if writer.as_ref().and_then(FrameWriter::last) == Some(header.sequence) => {
                    host.frame_done(&header, 0, 0)?;
                }
                Ok(message) => {
                    let of = Some(header.sequence);
                    let images = kept.iter().find(|k| k.depth_of == of && k.profile_of == of);
                    let input = images.map(|k| OverlayInput {
                        left: &k.left,
                        disparity: &k.disparity,
                        profile_px: &k.profile_px,
                        edges: k.edges,
                        width: format.width,
                        height: format.height,
                    });
                    let is_whole = writer.is_none() || input.is_some();
                    let has_pair = recorder.as_ref().is_none_or(|t| t.has_pair(header.sequence));
                    if !is_whole || (host.launch.lockstep && !has_pair) {
                        if host.launch.lockstep {
                            // Its parts came before this writer did; the frame comes again.
                            return Ok(Next::Wait(host.heartbeat()?));
                        }
                        // At live rate the line is written all the same.
                        host.skipped(1);
                    }
                    if let Some(recorder) = &mut recorder {
                        recorder.result(&header, &message, missed);
                    }
                    if let Some(writer) = &mut writer {
                        writer.write(&frame_record(&header, &message), input)?;
                    }
                    let age_ns = begin_ns.saturating_sub(header.capture_ns);
                    host.frame_done(&header, age_ns, monotonic_ns() - begin_ns)?;
                }
            }
        }
        Ok(Next::Wait(host.heartbeat()?))
    })?;
    let Some(Err(error)) = recorder.map(InlineRecorder::finish) else { return Ok(()) };
    // The run cannot become what was asked for.
    host.set_health(Health::Unusable, &error.to_string())?;
    wait::run(&[], || Ok(if host.should_stop() { Next::Stop } else { Next::Wait(host.heartbeat()?) }))
}

fn keep_depth(host: &mut Host, depths: &Subscriber, kept: &mut [Kept; KEPT]) -> Result<(), HostError> {
    while let Some(sample) = depths.receive()? {
        let header = sample.header();
        let format = host.launch.frames;
        match depth::view(header, sample.payload()) {
            Err(error) => host.refused("depth", &error),
            Ok(_) if !format.has_size(header) => host.refused("depth", &"another size than the run's"),
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

fn keep_profile(host: &mut Host, roads: &Subscriber, kept: &mut [Kept; KEPT]) -> Result<(), HostError> {
    while let Some(sample) = roads.receive()? {
        let header = sample.header();
        let format = host.launch.frames;
        match regions::view(header, sample.payload()) {
            Err(error) => host.refused("regions", &error),
            Ok(_) if !format.has_size(header) => host.refused("regions", &"another size than the run's"),
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
