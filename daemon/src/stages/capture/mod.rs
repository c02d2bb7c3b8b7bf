//! Brings pairs from the source into shared memory, at a rate or by credit.
//!
//! A source that fails or brings nothing does not end the stage: it says so, goes on reporting, and
//! tries again.

mod reader;

use crate::host::{Host, HostError};
use crate::input;
use messages::clock::monotonic_ns;
use messages::command::{self, CommandRecord};
use messages::header::{Header, Kind, Stamp};
use messages::pair;
use messages::port::{Loan, Publisher};
use messages::report::Health;
use messages::service;
use messages::wait::{self, Next};
use reader::Reader;
use sources::{PairSource, Readiness};
use std::time::Duration;

/// How long a live source is waited for at a time: commands and signals are heard in between.
const LIVE_PATIENCE: Duration = Duration::from_millis(20);

/// Before it is waited for again.
const SOON: Duration = Duration::from_micros(50);

/// Wait before a pair that could not be read is tried again; it doubles with each try.
const RETRY_FIRST_NS: u64 = 1_000_000_000;
/// The longest wait.
const RETRY_LONGEST_NS: u64 = 30_000_000_000;

/// Runs the stage.
///
/// # Errors
/// When shared memory cannot be used.
pub fn run(mut host: Host) -> Result<(), HostError> {
    let format = host.launch.frames;
    let commands = host.bus.subscriber(&service::COMMAND)?;
    let pairs = host.bus.publisher(&service::PAIR, format.width, format.height)?;
    let is_live = host.launch.config.source.kind == "camera";
    let reader = (!is_live)
        .then(|| Reader::start(&host.launch))
        .transpose()
        .map_err(|source| HostError::System { what: "starting the reader", source })?;
    let mut capture = Capture {
        next: host.launch.first_sequence,
        published: None,
        due_ns: 0,
        stall_ns: (host.launch.config.pacing.stall_ms * 1e6) as u64,
        command: None,
        input: reader.as_ref().map_or(Input::Live(None), Input::Recorded),
        pairs,
        state: State::Flowing,
    };
    // In this order: the scheduler answers the first report with a command.
    host.ready()?;
    wait::run_with(&[&commands], reader.as_ref().map(Reader::descriptor), || {
        if host.should_stop() {
            return Ok(Next::Stop);
        }
        while let Some(sample) = commands.receive()? {
            match command::view(sample.header(), sample.payload()) {
                Ok(command) => capture.command = Some(command),
                Err(error) => host.refused("command", &error),
            }
        }
        if let Some(reader) = &reader {
            reader.take_notifications();
        }
        let until_frame = capture.step(&mut host)?;
        let until_beat = host.heartbeat()?;
        Ok(Next::Wait(until_frame.map_or(until_beat, |t| t.min(until_beat))))
    })
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum State {
    Flowing,
    /// The next pair is wanted, and not there since then.
    Missing {
        since_ns: u64,
        is_said: bool,
    },
    /// The next pair could not be read.
    Failed {
        /// When it is tried again.
        retry_ns: u64,
        /// The wait after that.
        wait_ns: u64,
        /// The reader is at it.
        trying: bool,
    },
    /// Finished: nothing more is published.
    Over,
}

/// Where pairs come from.
enum Input<'a> {
    /// Read ahead; the next pair is there or not.
    Recorded(&'a Reader),
    /// Cameras; `None` until they are open.
    Live(Option<Box<dyn PairSource>>),
}

impl Input<'_> {
    /// Pair `sequence` of a recorded source is not needed any more.
    fn release(&self, sequence: u64) {
        if let Self::Recorded(reader) = self {
            reader.release(sequence);
        }
    }
}

struct Capture<'a> {
    input: Input<'a>,
    pairs: Publisher,
    command: Option<CommandRecord>,
    /// The next pair.
    next: u64,
    /// Sequence and attempt that were published last; the reader keeps that pair.
    published: Option<(u64, u32)>,
    /// When the next pair is due, at live rate.
    due_ns: u64,
    /// A pair that is this late makes the source a stalled one.
    stall_ns: u64,
    state: State,
}

impl Capture<'_> {
    /// Publishes what may be published now; gives the time until something is due, if that is known.
    fn step(&mut self, host: &mut Host) -> Result<Option<Duration>, HostError> {
        let Some(command) = self.command else { return Ok(None) };
        if command.lockstep == 1 && command.hold == 0 {
            // Even when it is over: a stage may have died with the last frame.
            self.repeat(host, &command)?;
        }
        if self.state == State::Over {
            return Ok(None);
        }
        if command.drain == 1 {
            return self.finish(host, "drained").map(|()| None);
        }
        if command.hold == 1 {
            return self.hold(host).map(|()| None);
        }
        if matches!(self.input, Input::Live(_)) {
            return self.step_live(host, &command);
        }
        if command.lockstep == 1 {
            while self.next <= command.credit && self.state != State::Over {
                if !self.publish_next(host, command.attempt)? {
                    return Ok(self.patience());
                }
            }
            return Ok(None);
        }
        let now = monotonic_ns();
        if self.due_ns == 0 {
            self.due_ns = now;
        }
        if now < self.due_ns {
            return Ok(Some(Duration::from_nanos(self.due_ns - now)));
        }
        if !self.publish_next(host, 0)? {
            return Ok(self.patience());
        }
        // A source that cannot keep up is not hurried afterwards.
        let after = monotonic_ns();
        self.due_ns =
            self.due_ns.saturating_add(command.period_ns).max(after.saturating_sub(command.period_ns));
        Ok(Some(Duration::from_nanos(self.due_ns.saturating_sub(after)).max(Duration::from_micros(50))))
    }

    /// Takes what the cameras bring; they run by themselves.
    fn step_live(&mut self, host: &mut Host, command: &CommandRecord) -> Result<Option<Duration>, HostError> {
        if command.lockstep == 1 {
            self.state = State::Over;
            let text =
                "cameras run by themselves and know no lock-step: record them, and replay the recording";
            return host.set_health(Health::Unusable, text).map(|()| None);
        }
        if self.is_at_end(host)? {
            return Ok(None);
        }
        if !self.open_live(host)? {
            return Ok(self.patience());
        }
        let Input::Live(Some(source)) = &mut self.input else { return Ok(None) };
        match source.live().map_or(Readiness::Nothing, |live| live.wait(LIVE_PATIENCE)) {
            Readiness::Pair { capture_ns } => self.publish_live(host, capture_ns, command.period_ns)?,
            Readiness::Trouble(text) => {
                tracing::warn!("{text}");
                host.set_health(Health::Stalled, &text)?;
            }
            Readiness::Recovered => {
                tracing::info!("pairs come again");
                host.set_health(Health::Ready, "")?;
            }
            Readiness::Nothing => {}
        }
        Ok(Some(SOON))
    }

    /// Opens the cameras unless they are open. Gives false when they cannot be, and says why.
    fn open_live(&mut self, host: &mut Host) -> Result<bool, HostError> {
        let Input::Live(source @ None) = &mut self.input else { return Ok(true) };
        if matches!(self.state, State::Failed { retry_ns, .. } if monotonic_ns() < retry_ns) {
            return Ok(false);
        }
        match input::open(&host.launch.config) {
            Ok(opened) => {
                *source = Some(opened);
                self.state = State::Flowing;
                host.set_health(Health::Ready, "").map(|()| true)
            }
            Err(error) => self.fail(host, &error.to_string()).map(|()| false),
        }
    }

    /// Publishes the pair that has come, unless the cameras are faster than pairs are wanted.
    fn publish_live(&mut self, host: &mut Host, capture_ns: u64, period_ns: u64) -> Result<(), HostError> {
        // Half a period early is in time: cameras keep their own.
        if capture_ns.saturating_add(period_ns / 2) < self.due_ns {
            return Ok(());
        }
        // What was late is not made up for.
        let is_late = capture_ns > self.due_ns.saturating_add(period_ns);
        self.due_ns = if is_late { capture_ns } else { self.due_ns }.saturating_add(period_ns);
        let Input::Live(Some(source)) = &mut self.input else { return Ok(()) };
        let format = host.launch.frames;
        let begin_ns = monotonic_ns();
        let mut loan = self.pairs.loan(pair::payload_bytes(format.width, format.height))?;
        let (left, right) = pair::split_mut(loan.payload_mut());
        if let Err(error) = source.read(self.next, left, right) {
            // Opened anew for the next try.
            self.input = Input::Live(None);
            return self.fail(host, &error.to_string());
        }
        let source_ns = source.time_ns(self.next);
        let stamp = Stamp { begin_ns, end_ns: monotonic_ns() };
        // A camera's pair is captured when it was exposed.
        let mut header = Header::new(Kind::Pair);
        header.sequence = self.next;
        header.source_ns = source_ns;
        header.capture_ns = capture_ns;
        self.send(host, loan, header, stamp, 0)
    }

    /// How long to wait for a pair that is not there before something has to be done about it; the
    /// reader wakes the stage when it comes.
    fn patience(&self) -> Option<Duration> {
        let at_ns = match self.state {
            State::Missing { since_ns, is_said: false } => since_ns.saturating_add(self.stall_ns),
            State::Failed { retry_ns, trying: false, .. } => retry_ns,
            _ => return None,
        };
        Some(Duration::from_nanos(at_ns.saturating_sub(monotonic_ns())).max(Duration::from_micros(50)))
    }

    /// Publishes the frame of the credit once more when the scheduler asks for another attempt.
    fn repeat(&mut self, host: &mut Host, command: &CommandRecord) -> Result<(), HostError> {
        match self.published {
            Some((sequence, attempt)) if sequence == command.credit && attempt < command.attempt => {
                self.publish(host, sequence, command.attempt).map(|_| ())
            }
            _ => Ok(()),
        }
    }

    fn finish(&mut self, host: &mut Host, text: &str) -> Result<(), HostError> {
        self.state = State::Over;
        host.set_health(Health::Finished, text)
    }

    /// Nothing is wanted: what is not there is not missing.
    fn hold(&mut self, host: &mut Host) -> Result<(), HostError> {
        let State::Missing { is_said, .. } = self.state else { return Ok(()) };
        self.state = State::Flowing;
        if is_said { host.set_health(Health::Ready, "") } else { Ok(()) }
    }

    /// Whether all pairs that are wanted have been published; then it says so.
    fn is_at_end(&mut self, host: &mut Host) -> Result<bool, HostError> {
        let is_over = host.launch.end_sequence.is_some_and(|end| self.next >= end);
        if is_over {
            self.finish(host, "the source has no more pairs")?;
        }
        Ok(is_over)
    }

    /// Publishes the next pair. Gives false when it is not there, and says so in time.
    fn publish_next(&mut self, host: &mut Host, attempt: u32) -> Result<bool, HostError> {
        if self.is_at_end(host)? {
            return Ok(false);
        }
        if let State::Failed { retry_ns, wait_ns, trying: false } = self.state
            && monotonic_ns() >= retry_ns
        {
            self.state = State::Failed { retry_ns, wait_ns, trying: true };
            self.input.release(self.next);
        }
        if matches!(self.state, State::Failed { trying: false, .. }) {
            return Ok(false);
        }
        if !self.publish(host, self.next, attempt)? {
            return Ok(false);
        }
        if !matches!(self.state, State::Flowing | State::Missing { is_said: false, .. }) {
            host.set_health(Health::Ready, "")?;
        }
        self.state = State::Flowing;
        Ok(true)
    }

    /// The next pair is not there yet.
    fn miss(&mut self, host: &mut Host) -> Result<(), HostError> {
        let now = monotonic_ns();
        match self.state {
            State::Flowing => self.state = State::Missing { since_ns: now, is_said: false },
            State::Missing { since_ns, is_said: false } if now.saturating_sub(since_ns) >= self.stall_ns => {
                self.state = State::Missing { since_ns, is_said: true };
                let seconds = self.stall_ns as f64 * 1e-9;
                let text = format!("the source has stalled: pair {} is late by {seconds} s", self.next);
                host.set_health(Health::Stalled, &text)?;
            }
            _ => {}
        }
        Ok(())
    }

    /// The next pair cannot be read: says why, and when it is tried again.
    fn fail(&mut self, host: &mut Host, reason: &str) -> Result<(), HostError> {
        let wait_ns = match self.state {
            State::Failed { wait_ns, .. } => wait_ns,
            _ => RETRY_FIRST_NS,
        };
        self.state = State::Failed {
            retry_ns: monotonic_ns() + wait_ns,
            wait_ns: (2 * wait_ns).min(RETRY_LONGEST_NS),
            trying: false,
        };
        host.set_health(Health::Unusable, reason)
    }

    /// Copies a pair into shared memory. Gives false when it is not there, or cannot be read.
    fn publish(&mut self, host: &mut Host, sequence: u64, attempt: u32) -> Result<bool, HostError> {
        let Input::Recorded(reader) = self.input else { return Ok(false) };
        let Some(pair) = reader.pair(sequence) else {
            return self.miss(host).map(|()| false);
        };
        if let Err(reason) = &pair.result {
            let reason = reason.clone();
            drop(pair);
            return self.fail(host, &reason).map(|()| false);
        }
        let format = host.launch.frames;
        let begin_ns = monotonic_ns();
        let mut loan = self.pairs.loan(pair::payload_bytes(format.width, format.height))?;
        let (left, right) = pair::split_mut(loan.payload_mut());
        left.copy_from_slice(&pair.left);
        right.copy_from_slice(&pair.right);
        let (source_ns, read_ns) = (pair.source_ns, pair.read_ns);
        drop(pair);
        let end_ns = monotonic_ns();
        // A recorded pair is "captured" when it is whole in shared memory.
        let mut header = Header::new(Kind::Pair);
        header.sequence = sequence;
        header.attempt = attempt;
        header.source_ns = source_ns;
        header.capture_ns = end_ns;
        self.send(host, loan, header, Stamp { begin_ns, end_ns }, read_ns).map(|()| true)
    }

    /// Hands a pair over and reports it. To have read it ahead was this stage's work, too: `read_ns`.
    fn send(
        &mut self,
        host: &mut Host,
        mut loan: Loan,
        mut header: Header,
        stamp: Stamp,
        read_ns: u64,
    ) -> Result<(), HostError> {
        let (sequence, attempt) = (header.sequence, header.attempt);
        header.modes = self.command.map_or(0, |command| command.modes);
        header.width = host.launch.frames.width as u32;
        header.height = host.launch.frames.height as u32;
        header.set_stamp(host.role(), stamp);
        *loan.header_mut() = header;
        self.pairs.send(loan)?;
        if let Some((before, _)) = self.published.replace((sequence, attempt))
            && before != sequence
        {
            self.input.release(before);
        }
        self.next = self.next.max(sequence.saturating_add(1));
        if attempt > 0 {
            // The same frame once more is no new one.
            return Ok(());
        }
        host.frame_done(&header, 0, stamp.end_ns - stamp.begin_ns + read_ns)
    }
}
