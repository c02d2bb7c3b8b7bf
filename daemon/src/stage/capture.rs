//! Brings pairs from the source into shared memory, at a rate or by credit.

use super::{Stage, StageError};
use crate::input;
use ipc::clock::monotonic_ns;
use ipc::command::{self, CommandRecord};
use ipc::header::{Header, Kind, Stamp};
use ipc::pair;
use ipc::port::{Publisher, Subscriber};
use ipc::report::Health;
use ipc::service;
use ipc::wait::{self, Next};
use sources::{PairSource, Readiness};
use std::time::Duration;

/// How long a live source is waited for at a time: commands and signals are heard in between.
const LIVE_PATIENCE: Duration = Duration::from_millis(20);

/// Before it is waited for again.
const SOON: Duration = Duration::from_micros(50);

/// Runs the stage.
///
/// # Errors
/// When shared memory cannot be used.
pub fn run(mut stage: Stage) -> Result<(), StageError> {
    let format = stage.launch.frames;
    let commands = stage.bus.subscriber(&service::COMMAND)?;
    let pairs = stage.bus.publisher(&service::PAIR, format.width, format.height)?;
    // Opened again by this process: the scheduler has only looked at it.
    let source = match input::open(&stage.launch.config) {
        Ok(source) => source,
        Err(error) => return idle(stage, &commands, &error.to_string()),
    };
    let mut capture = Capture {
        next: stage.launch.first_sequence,
        published: None,
        due_ns: 0,
        captured_ns: None,
        command: None,
        source,
        pairs,
        state: State::Flowing,
    };
    // In this order: the scheduler answers the first report with a command.
    stage.ready()?;
    wait::run(&[&commands], || {
        if stage.should_stop() {
            return Ok(Next::Stop);
        }
        while let Some(sample) = commands.receive()? {
            match command::view(sample.header(), sample.payload()) {
                Ok(command) => capture.command = Some(command),
                Err(error) => stage.refused("command", &error),
            }
        }
        let until_frame = capture.step(&mut stage)?;
        let until_beat = stage.heartbeat()?;
        Ok(Next::Wait(until_frame.map_or(until_beat, |t| t.min(until_beat))))
    })
}

/// The source cannot be used: says so until the scheduler ends the stage.
fn idle(mut stage: Stage, commands: &Subscriber, reason: &str) -> Result<(), StageError> {
    stage.set_health(Health::Unusable, reason)?;
    wait::run(&[commands], || {
        if stage.should_stop() {
            return Ok(Next::Stop);
        }
        while commands.receive()?.is_some() {}
        Ok(Next::Wait(stage.heartbeat()?))
    })
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum State {
    Flowing,
    /// Finished, or failed: nothing more is published.
    Over,
}

struct Capture {
    source: Box<dyn PairSource>,
    pairs: Publisher,
    command: Option<CommandRecord>,
    /// The next pair.
    next: u64,
    /// Sequence and attempt that were published last.
    published: Option<(u64, u32)>,
    /// When the next pair is due, at live rate.
    due_ns: u64,
    /// When the pair that is about to be published was exposed, where the source knows.
    captured_ns: Option<u64>,
    state: State,
}

impl Capture {
    /// Publishes what may be published now; gives the time until the next pair is due.
    fn step(&mut self, stage: &mut Stage) -> Result<Option<Duration>, StageError> {
        let Some(command) = self.command else { return Ok(None) };
        if self.state == State::Over {
            // A stage may have died with the last frame.
            if command.lockstep == 1 {
                self.repeat(stage, &command)?;
            }
            return Ok(None);
        }
        if command.drain == 1 {
            return self.finish(stage, "drained").map(|()| None);
        }
        if command.hold == 1 {
            return Ok(None);
        }
        if command.lockstep == 1 {
            self.repeat(stage, &command)?;
            while self.state == State::Flowing && self.next <= command.credit {
                self.publish(stage, self.next, command.attempt)?;
            }
            return Ok(None);
        }
        if let Some(live) = self.source.live() {
            return match live.wait(LIVE_PATIENCE) {
                Readiness::Pair { capture_ns } => self.publish_live(stage, capture_ns, command.period_ns),
                Readiness::Trouble(text) => {
                    tracing::warn!("{text}");
                    stage.set_health(Health::Ready, &text)?;
                    Ok(Some(SOON))
                }
                Readiness::Recovered => {
                    tracing::info!("pairs come again");
                    stage.set_health(Health::Ready, "")?;
                    Ok(Some(SOON))
                }
                Readiness::Nothing => Ok(Some(SOON)),
            };
        }
        let now = monotonic_ns();
        if self.due_ns == 0 {
            self.due_ns = now;
        }
        if now < self.due_ns {
            return Ok(Some(Duration::from_nanos(self.due_ns - now)));
        }
        self.publish(stage, self.next, 0)?;
        // A source that cannot keep up is not hurried afterwards.
        let after = monotonic_ns();
        self.due_ns =
            self.due_ns.saturating_add(command.period_ns).max(after.saturating_sub(command.period_ns));
        Ok(Some(Duration::from_nanos(self.due_ns.saturating_sub(after)).max(Duration::from_micros(50))))
    }

    /// Publishes the pair that has come, unless the cameras are faster than pairs are wanted.
    fn publish_live(
        &mut self,
        stage: &mut Stage,
        capture_ns: u64,
        period_ns: u64,
    ) -> Result<Option<Duration>, StageError> {
        // Half a period early is in time: cameras keep their own.
        if capture_ns.saturating_add(period_ns / 2) < self.due_ns {
            return Ok(Some(SOON));
        }
        // What was late is not made up for.
        let is_late = capture_ns > self.due_ns.saturating_add(period_ns);
        self.due_ns = if is_late { capture_ns } else { self.due_ns }.saturating_add(period_ns);
        self.captured_ns = Some(capture_ns);
        self.publish(stage, self.next, 0)?;
        Ok(Some(SOON))
    }

    /// Publishes the frame of the credit once more when the scheduler asks for another attempt.
    fn repeat(&mut self, stage: &mut Stage, command: &CommandRecord) -> Result<(), StageError> {
        match self.published {
            Some((sequence, attempt)) if sequence == command.credit && attempt < command.attempt => {
                self.publish(stage, sequence, command.attempt)
            }
            _ => Ok(()),
        }
    }

    fn finish(&mut self, stage: &mut Stage, text: &str) -> Result<(), StageError> {
        self.state = State::Over;
        stage.set_health(Health::Finished, text)
    }

    fn publish(&mut self, stage: &mut Stage, sequence: u64, attempt: u32) -> Result<(), StageError> {
        if stage.launch.end_sequence.is_some_and(|end| sequence >= end) {
            return self.finish(stage, "the source has no more pairs");
        }
        let index = match self.source.count() {
            Some(count) if stage.launch.config.source.repeat => sequence % count.max(1),
            _ => sequence,
        };
        let format = stage.launch.frames;
        let begin_ns = monotonic_ns();
        let mut loan = self.pairs.loan(pair::payload_bytes(format.width, format.height))?;
        let (left, right) = pair::split_mut(loan.payload_mut());
        if let Err(error) = self.source.read(index, left, right) {
            self.state = State::Over;
            return stage.set_health(Health::Unusable, &error.to_string());
        }
        let end_ns = monotonic_ns();
        let mut header = Header::new(Kind::Pair);
        header.sequence = sequence;
        header.attempt = attempt;
        header.modes = self.command.map_or(0, |command| command.modes);
        let rounds = (sequence - index).saturating_mul(stage.launch.source_period_ns);
        header.source_ns = rounds.saturating_add(self.source.time_ns(index));
        // A recorded pair is "captured" when it is whole in shared memory, a camera's when it was exposed.
        header.capture_ns = self.captured_ns.take().unwrap_or(end_ns);
        header.width = format.width as u32;
        header.height = format.height as u32;
        header.stamps[0] = Stamp { begin_ns, end_ns };
        *loan.header_mut() = header;
        self.pairs.send(loan)?;
        self.published = Some((sequence, attempt));
        self.next = self.next.max(sequence.saturating_add(1));
        if attempt > 0 {
            // The same frame once more is no new one.
            return Ok(());
        }
        stage.frame_done(&header, 0, end_ns - begin_ns)
    }
}
