//! The stages with one input and one output: stereo, road, recognition.

use super::{Stage, StageError};
use crate::rooms::FrameError;
use crate::rooms::recognition::RecognitionRoom;
use crate::rooms::road::RoadRoom;
use crate::rooms::stereo::StereoRoom;
use ipc::clock::monotonic_ns;
use ipc::header::{Header, Stamp};
use ipc::obstacles;
use ipc::port::{Publisher, Sample};
use ipc::service::{self, ServiceSpec};
use ipc::wait::{self, Next};

/// What the work on one frame came to.
enum Done {
    Sent,
    Refused(FrameError),
}

/// Runs the stereo stage.
///
/// # Errors
/// When shared memory cannot be used, or the run's frames cannot be matched.
pub fn stereo(stage: Stage) -> Result<(), StageError> {
    let mut room = StereoRoom::new(&stage.launch.config, &stage.launch.frames)?;
    run(stage, &service::PAIR, &service::DEPTH, 1, |sample, header, output| {
        let mut loan = output.loan(room.output_bytes())?;
        if let Err(error) = room.process(sample.header(), sample.payload(), loan.payload_mut()) {
            return Ok(Done::Refused(error));
        }
        header.stamps[1].end_ns = monotonic_ns();
        *loan.header_mut() = *header;
        output.send(loan)?;
        Ok(Done::Sent)
    })
}

/// Runs the road stage.
///
/// # Errors
/// When shared memory cannot be used.
pub fn road(stage: Stage) -> Result<(), StageError> {
    let mut room = RoadRoom::new(&stage.launch.config, &stage.launch.frames);
    run(stage, &service::DEPTH, &service::REGIONS, 2, |sample, header, output| {
        let mut loan = output.loan(room.output_bytes())?;
        if let Err(error) = room.process(sample.header(), sample.payload(), loan.payload_mut()) {
            return Ok(Done::Refused(error));
        }
        header.stamps[2].end_ns = monotonic_ns();
        *loan.header_mut() = *header;
        output.send(loan)?;
        Ok(Done::Sent)
    })
}

/// Runs the recognition stage.
///
/// # Errors
/// When shared memory or the cascade cannot be used.
pub fn recognition(stage: Stage) -> Result<(), StageError> {
    let mut room = RecognitionRoom::new(&stage.launch.config, &stage.launch.frames)?;
    run(stage, &service::REGIONS, &service::OBSTACLES, 3, |sample, header, output| {
        let (alarm, records) = match room.process(sample.header(), sample.payload()) {
            Ok(result) => result,
            Err(error) => return Ok(Done::Refused(error)),
        };
        let mut loan = output.loan(obstacles::payload_bytes(records.len()))?;
        if let Err(error) = obstacles::write(loan.payload_mut(), alarm, records) {
            return Ok(Done::Refused(error.into()));
        }
        header.stamps[3].end_ns = monotonic_ns();
        *loan.header_mut() = *header;
        output.send(loan)?;
        Ok(Done::Sent)
    })
}

/// Takes the newest message of `input`, works on it, reports, and sleeps until the next.
fn run(
    mut stage: Stage,
    input: &ServiceSpec,
    output: &ServiceSpec,
    place: usize,
    mut work: impl FnMut(&Sample, &mut Header, &Publisher) -> Result<Done, StageError>,
) -> Result<(), StageError> {
    let format = stage.launch.frames;
    let messages = stage.bus.subscriber(input)?;
    let publisher = stage.bus.publisher(output, format.width, format.height)?;
    stage.ready()?;
    wait::run(&[&messages], || {
        // One frame at a time, so that a request to stop is heard between two.
        if stage.should_stop() {
            return Ok(Next::Stop);
        }
        while let Some(sample) = messages.receive()? {
            let begin_ns = monotonic_ns();
            stage.skipped(messages.take_missed());
            let mut header = sample.header().forward(output.kind);
            header.stamps[place] = Stamp { begin_ns, end_ns: 0 };
            // The capture time comes from another process: it may be anything.
            let age_ns = begin_ns.saturating_sub(header.capture_ns);
            match work(&sample, &mut header, &publisher)? {
                Done::Sent => {
                    let end_ns = header.stamps[place].end_ns;
                    stage.frame_done(&header, age_ns, end_ns.saturating_sub(begin_ns))?;
                }
                Done::Refused(error) => stage.refused(input.name, &error),
            }
            if stage.should_stop() {
                return Ok(Next::Stop);
            }
        }
        Ok(Next::Wait(stage.heartbeat()?))
    })
}
