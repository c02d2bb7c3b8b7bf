//! The stages with one input and one output: stereo, road, recognition.

use super::{Stage, StageError};
use crate::rooms::Room;
use crate::rooms::recognition::RecognitionRoom;
use crate::rooms::road::RoadRoom;
use crate::rooms::stereo::StereoRoom;
use messages::alarm::Faults;
use messages::clock::monotonic_ns;
use messages::header::Stamp;
use messages::service::{self, ServiceSpec};
use messages::wait::{self, Next};

/// Runs the stereo stage.
///
/// # Errors
/// When shared memory cannot be used, or the run's frames cannot be matched.
pub fn stereo(stage: Stage) -> Result<(), StageError> {
    let room = StereoRoom::new(&stage.launch.config, &stage.launch.frames)?;
    run(stage, &service::PAIR, &service::DEPTH, 1, room)
}

/// Runs the road stage.
///
/// # Errors
/// When shared memory cannot be used.
pub fn road(stage: Stage) -> Result<(), StageError> {
    let room = RoadRoom::new(&stage.launch.config, &stage.launch.frames);
    run(stage, &service::DEPTH, &service::REGIONS, 2, room)
}

/// Runs the recognition stage.
///
/// # Errors
/// When shared memory or the cascade cannot be used.
pub fn recognition(stage: Stage) -> Result<(), StageError> {
    let room = RecognitionRoom::new(&stage.launch.config, &stage.launch.frames)?;
    run(stage, &service::REGIONS, &service::OBSTACLES, 3, room)
}

/// Takes the newest message of `input`, lets the room work on it in shared memory, sends the
/// result, reports, and sleeps until the next. `place` is the stage's stamp in the header.
fn run(
    mut stage: Stage,
    input: &ServiceSpec,
    output: &ServiceSpec,
    place: usize,
    mut room: impl Room,
) -> Result<(), StageError> {
    let format = stage.launch.frames;
    // In lock-step a frame may be as old as it likes: it waits for whoever is slow.
    let max_ms = stage.launch.config.alarm.frame_age_max_ms.unsigned_abs();
    let oldest_ns = if stage.launch.lockstep || max_ms == 0 { u64::MAX } else { max_ms * 1_000_000 };
    let messages = stage.bus.subscriber(input)?;
    let publisher = stage.bus.publisher(output, format.width, format.height)?;
    stage.ready()?;
    wait::run(&[&messages], || {
        // One frame at a time, so that a request to stop is heard between two.
        while !stage.should_stop()
            && let Some(sample) = messages.receive()?
        {
            let begin_ns = monotonic_ns();
            stage.skipped(messages.take_missed());
            // The capture time comes from another process: it may be anything.
            let age_ns = begin_ns.saturating_sub(sample.header().capture_ns);
            let mut header = *sample.header();
            header.faults |= Faults::OLD.when(age_ns > oldest_ns).0;
            let mut loan = publisher.loan(room.output_bytes())?;
            match room.process(&header, sample.payload(), loan.payload_mut()) {
                Ok(bytes) => {
                    let end_ns = monotonic_ns();
                    let mut header = header.forward(output.kind);
                    header.faults |= room.faults().0;
                    header.stamps[place] = Stamp { begin_ns, end_ns };
                    loan.truncate(bytes);
                    *loan.header_mut() = header;
                    publisher.send(loan)?;
                    stage.set_calibration(room.calibration());
                    stage.set_device(room.device());
                    stage.frame_done(&header, age_ns, end_ns - begin_ns)?;
                }
                Err(error) => {
                    stage.refused(input.name, &error);
                    // However many of them come: the stage is alive.
                    stage.heartbeat()?;
                }
            }
        }
        if stage.should_stop() {
            return Ok(Next::Stop);
        }
        Ok(Next::Wait(stage.heartbeat()?))
    })
}
