//! Writes results to files. It joins the streams of a frame in memory of its own, so that no
//! stage has to.

use super::{Stage, StageError};
use crate::frame_record::frame_record;
use ipc::clock::monotonic_ns;
use ipc::port::Subscriber;
use ipc::wait::{self, Next};
use ipc::{depth, obstacles, regions, service};
use tools::output::FrameWriter;
use tools::overlay::OverlayInput;

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
}

/// Runs the stage.
///
/// # Errors
/// When shared memory cannot be used, or results cannot be written.
pub fn run(mut stage: Stage) -> Result<(), StageError> {
    let format = stage.launch.frames;
    let Some(folder) = stage.launch.out.clone() else {
        return Err(StageError::Launch("the writer needs a folder".into()));
    };
    let mut writer = FrameWriter::open(&folder)?;
    let depths = stage.bus.subscriber(&service::DEPTH)?;
    let roads = stage.bus.subscriber(&service::REGIONS)?;
    let results = stage.bus.subscriber(&service::OBSTACLES)?;
    let mut kept: [Kept; KEPT] = std::array::from_fn(|_| Kept::default());
    stage.ready()?;
    wait::run(&[&depths, &roads, &results], || {
        if stage.should_stop() {
            return Ok(Next::Stop);
        }
        // Obstacles first: whatever they were made from was sent before, and is there by now.
        let mut result = results.receive()?;
        while result.as_ref().is_some_and(|sample| sample.header().withdraws == 1) {
            // That a stage died is no result to be written. It goes before the next is received.
            drop(result);
            result = results.receive()?;
        }
        keep_depth(&mut stage, &depths, &mut kept)?;
        keep_profile(&mut stage, &roads, &mut kept)?;
        stage.skipped(results.take_missed());
        if let Some(sample) = result {
            let begin_ns = monotonic_ns();
            let header = *sample.header();
            match obstacles::view(&header, sample.payload()) {
                Err(error) => stage.refused("obstacles", &error),
                Ok(_) if !format.has_size(&header) => {
                    stage.refused("obstacles", &"another size than the run's");
                }
                // A frame that came again after a stage died is written once.
                Ok(_) if writer.last() == Some(header.sequence) => {
                    stage.frame_done(&header, 0, 0)?;
                }
                Ok(message) => {
                    let of = Some(header.sequence);
                    let images = kept.iter().find(|k| k.depth_of == of && k.profile_of == of);
                    let input = images.map(|k| OverlayInput {
                        left: &k.left,
                        disparity: &k.disparity,
                        profile_px: &k.profile_px,
                        width: format.width,
                        height: format.height,
                    });
                    if input.is_none() {
                        if stage.launch.lockstep {
                            // Its depth came before this writer did; the frame comes again.
                            return Ok(Next::Wait(stage.heartbeat()?));
                        }
                        // At live rate the line is written all the same.
                        stage.skipped(1);
                    }
                    writer.write(&frame_record(&header, &message), input)?;
                    let age_ns = begin_ns.saturating_sub(header.capture_ns);
                    stage.frame_done(&header, age_ns, monotonic_ns() - begin_ns)?;
                }
            }
        }
        Ok(Next::Wait(stage.heartbeat()?))
    })
}

fn keep_depth(stage: &mut Stage, depths: &Subscriber, kept: &mut [Kept; KEPT]) -> Result<(), StageError> {
    while let Some(sample) = depths.receive()? {
        let header = sample.header();
        let format = stage.launch.frames;
        match depth::view(header, sample.payload()) {
            Err(error) => stage.refused("depth", &error),
            Ok(_) if !format.has_size(header) => stage.refused("depth", &"another size than the run's"),
            Ok(message) => {
                let slot = &mut kept[(header.sequence % KEPT as u64) as usize];
                slot.depth_of = Some(header.sequence);
                slot.left.clear();
                slot.left.extend_from_slice(message.left);
                slot.disparity.clear();
                slot.disparity.extend_from_slice(message.disparity);
            }
        }
        stage.heartbeat()?;
    }
    Ok(())
}

fn keep_profile(stage: &mut Stage, roads: &Subscriber, kept: &mut [Kept; KEPT]) -> Result<(), StageError> {
    while let Some(sample) = roads.receive()? {
        let header = sample.header();
        let format = stage.launch.frames;
        match regions::view(header, sample.payload()) {
            Err(error) => stage.refused("regions", &error),
            Ok(_) if !format.has_size(header) => stage.refused("regions", &"another size than the run's"),
            Ok(message) => {
                let slot = &mut kept[(header.sequence % KEPT as u64) as usize];
                slot.profile_of = Some(header.sequence);
                slot.profile_px.clear();
                slot.profile_px.extend_from_slice(message.profile_px);
            }
        }
        stage.heartbeat()?;
    }
    Ok(())
}
