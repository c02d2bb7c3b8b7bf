//! The main loop of a stage with one input and one output.

use super::stage::FrameStage;
use crate::host::{Host, HostError};
use messages::alarm::Faults;
use messages::clock::monotonic_ns;
use messages::header::Stamp;
use messages::wait::{self, Next};

/// Receives the newest message of the stage's input, calls the stage, which writes its output in shared memory, sends
/// the output, reports, and sleeps until the next message.
///
/// # Errors
/// If shared memory cannot be used.
pub fn run(mut host: Host, mut stage: Box<dyn FrameStage>) -> Result<(), HostError> {
    let (input, output) = (stage.input().service(), stage.output().service());
    let format = host.launch.frames;
    let max_bytes = output.max_payload_bytes(format.width, format.height);
    // In lock-step the source waits for the slowest stage, so a frame may have any age.
    let max_ms = host.launch.config.alarm.frame_age_max_ms.unsigned_abs();
    let max_age_ns = if host.launch.lockstep || max_ms == 0 { u64::MAX } else { max_ms * 1_000_000 };
    let messages = host.bus.subscriber(input)?;
    let publisher = host.bus.publisher(output, format.width, format.height)?;
    host.ready()?;
    wait::run(&[&messages], || {
        // A request to stop takes effect between two frames.
        while !host.should_stop()
            && let Some(sample) = messages.receive()?
        {
            let begin_ns = monotonic_ns();
            let missed = messages.take_missed();
            host.skipped(missed);
            // Another process has written the capture time, so it may have any value.
            let age_ns = begin_ns.saturating_sub(sample.header().capture_ns);
            let mut header = *sample.header();
            header.faults |= Faults::OLD.when(age_ns > max_age_ns).0;
            let mut loan = publisher.loan(max_bytes)?;
            match stage.work(&header, missed, sample.payload(), loan.payload_mut()) {
                Ok(bytes) => {
                    let end_ns = monotonic_ns();
                    let mut header = header.forward(output.kind);
                    header.faults |= stage.faults().0;
                    header.motion = stage.motion().unwrap_or(header.motion);
                    header.set_stamp(host.role(), Stamp { begin_ns, end_ns });
                    loan.truncate(bytes);
                    *loan.header_mut() = header;
                    publisher.send(loan)?;
                    host.set_calibration(stage.calibration());
                    host.set_device(stage.device());
                    host.set_source_time(stage.source_time());
                    host.frame_done(&header, age_ns, end_ns - begin_ns)?;
                }
                Err(error) => {
                    host.refused(input.name, &error);
                    // Invalid messages must not delay the heartbeat.
                    host.heartbeat()?;
                }
            }
        }
        if host.should_stop() {
            return Ok(Next::Stop);
        }
        Ok(Next::Wait(host.heartbeat()?))
    })
}
