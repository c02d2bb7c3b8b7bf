//! The stage capture: publishes the pairs of the source in shared memory, at a rate or by credit.
//!
//! If the source fails or gives no pairs, the stage reports that, keeps sending heartbeats, and retries.

mod bus;
mod reader;

use super::vehicle_record::record;
use crate::host::{Host, HostError};
use crate::input;
use crate::stages::stage::SetupError;
use bus::Bus;
use messages::clock::monotonic_ns;
use messages::command::{self, CommandRecord};
use messages::header::{Header, Kind, Stamp};
use messages::pair;
use messages::port::{Loan, Publisher};
use messages::report::Health;
use messages::service;
use messages::wait::{self, Next};
use reader::{Reader, Unread};
use sources::{PairSource, Readiness};
use std::time::Duration;

/// Maximum time of one wait for a live source; commands and signals are handled in between.
const LIVE_TIMEOUT: Duration = Duration::from_millis(20);

/// Minimum pause of the loop.
const MIN_PAUSE: Duration = Duration::from_micros(50);

/// Time before the first retry of a pair that could not be read; it doubles with each retry.
const RETRY_FIRST_NS: u64 = 1_000_000_000;
/// Maximum time before a retry.
const RETRY_MAX_NS: u64 = 30_000_000_000;

/// Pairs in a row that are left out because they cannot be read, before the source counts as failed: 3 s at 10 Hz. More
/// is no damage of a file, but a lost disk.
const MAX_LEFT_OUT_IN_A_ROW: u32 = 30;

/// Runs the stage.
///
/// # Errors
/// If shared memory cannot be used.
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
        left_out_in_a_row: 0,
        is_next_left_out: false,
        due_ns: 0,
        stall_ns: (host.launch.config.pacing.stall_ms * 1e6) as u64,
        command: None,
        input: reader.as_ref().map_or(Input::Live(None), Input::Recorded),
        bus: Bus::start(&host.launch).map_err(SetupError::from)?,
        pairs,
        state: State::Flowing,
    };
    // The subscriber has to exist before the first report, which the scheduler answers with a command.
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

/// State of the source.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum State {
    Flowing,
    /// The next pair is due and has not been read yet.
    Missing {
        since_ns: u64,
        is_reported: bool,
    },
    /// The next pair could not be read.
    Failed {
        /// Time of the next retry.
        retry_ns: u64,
        /// Time from that retry to the one after it.
        wait_ns: u64,
        /// Whether the reader is retrying now.
        trying: bool,
    },
    /// Finished: nothing more is published.
    Over,
}

/// Input of the stage.
enum Input<'a> {
    /// A recorded or synthetic source, whose pairs a thread reads ahead.
    Recorded(&'a Reader),
    /// Cameras; `None` until they are opened.
    Live(Option<Box<dyn PairSource>>),
}

impl Input<'_> {
    /// Releases pair `sequence` of a recorded source.
    fn release(&self, sequence: u64) {
        if let Self::Recorded(reader) = self {
            reader.release(sequence);
        }
    }
}

struct Capture<'a> {
    input: Input<'a>,
    /// The vehicle's bus, if one is configured.
    bus: Option<Bus>,
    pairs: Publisher,
    command: Option<CommandRecord>,
    /// Sequence of the next pair.
    next: u64,
    /// Sequence and attempt of the last published pair; the reader keeps this pair.
    published: Option<(u64, u32)>,
    /// Pairs that cannot be read since the last that could.
    left_out_in_a_row: u32,
    /// The reader goes on behind pair [`Self::next`], which failed.
    is_next_left_out: bool,
    /// When the next pair is due at live rate, in ns of CLOCK_MONOTONIC; 0 before the first.
    due_ns: u64,
    /// Lateness of a pair from which the source counts as stalled, in nanoseconds.
    stall_ns: u64,
    state: State,
}

impl Capture<'_> {
    /// Publishes all pairs that may be published now. Returns the time until the next action is due, if it is known.
    fn step(&mut self, host: &mut Host) -> Result<Option<Duration>, HostError> {
        let Some(command) = self.command else { return Ok(None) };
        if command.lockstep == 1 && command.hold == 0 {
            // Also after the end of the source: a stage may have died with the last frame.
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
        // After a delay the lost time is not made up: the next pair is due at most one period early.
        let after = monotonic_ns();
        self.due_ns =
            self.due_ns.saturating_add(command.period_ns).max(after.saturating_sub(command.period_ns));
        Ok(Some(Duration::from_nanos(self.due_ns.saturating_sub(after)).max(MIN_PAUSE)))
    }

    /// Waits for a pair of the cameras, which run at their own rate, and publishes it.
    fn step_live(&mut self, host: &mut Host, command: &CommandRecord) -> Result<Option<Duration>, HostError> {
        if command.lockstep == 1 {
            self.state = State::Over;
            let text = "cameras do not support lock-step: record them, and replay the recording";
            return host.set_health(Health::Unusable, text).map(|()| None);
        }
        if self.is_at_end(host)? {
            return Ok(None);
        }
        if !self.open_live(host)? {
            return Ok(self.patience());
        }
        let Input::Live(Some(source)) = &mut self.input else { return Ok(None) };
        match source.live().map_or(Readiness::Nothing, |live| live.wait(LIVE_TIMEOUT)) {
            Readiness::Pair { capture_ns } => self.publish_live(host, capture_ns, command.period_ns)?,
            Readiness::Trouble(text) => {
                tracing::warn!("{text}");
                host.set_health(Health::Stalled, &text)?;
            }
            Readiness::Recovered => {
                tracing::info!("the cameras give pairs again");
                host.set_health(Health::Ready, "")?;
            }
            Readiness::Nothing => {}
        }
        Ok(Some(MIN_PAUSE))
    }

    /// Opens the cameras unless they are open. If that fails, reports the reason and returns false.
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

    /// Publishes the pair that has arrived, unless it is too early for the current rate.
    fn publish_live(&mut self, host: &mut Host, capture_ns: u64, period_ns: u64) -> Result<(), HostError> {
        // Cameras have their own clock, so a pair may be up to half a period early.
        if capture_ns.saturating_add(period_ns / 2) < self.due_ns {
            return Ok(());
        }
        // A delay of more than a period is not made up for.
        let is_late = capture_ns > self.due_ns.saturating_add(period_ns);
        self.due_ns = if is_late { capture_ns } else { self.due_ns }.saturating_add(period_ns);
        let Input::Live(Some(source)) = &mut self.input else { return Ok(()) };
        let format = host.launch.frames;
        let begin_ns = monotonic_ns();
        let mut loan = self.pairs.loan(pair::payload_bytes(format.width, format.height))?;
        let (left, right) = pair::split_mut(loan.payload_mut());
        if let Err(error) = source.read(self.next, left, right) {
            // The retry opens the cameras again.
            self.input = Input::Live(None);
            return self.fail(host, &error.to_string());
        }
        let (source_ns, vehicle) = (source.time_ns(self.next), record(&source.vehicle(self.next)));
        let stamp = Stamp { begin_ns, end_ns: monotonic_ns() };
        // The capture time of a camera's pair is the time of its exposure.
        let mut header = Header::new(Kind::Pair);
        header.sequence = self.next;
        header.set_source_time(source_ns);
        header.capture_ns = capture_ns;
        header.vehicle = vehicle;
        self.send(host, loan, header, stamp, 0)
    }

    /// Time until a missing pair has to be reported or retried. The reader wakes the stage when a pair arrives.
    fn patience(&self) -> Option<Duration> {
        let at_ns = match self.state {
            State::Missing { since_ns, is_reported: false } => since_ns.saturating_add(self.stall_ns),
            State::Failed { retry_ns, trying: false, .. } => retry_ns,
            _ => return None,
        };
        Some(Duration::from_nanos(at_ns.saturating_sub(monotonic_ns())).max(MIN_PAUSE))
    }

    /// Publishes the pair `credit` again if the scheduler requests another attempt.
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

    /// No pairs are due: a pair that was missing is not missing any more.
    fn hold(&mut self, host: &mut Host) -> Result<(), HostError> {
        let State::Missing { is_reported, .. } = self.state else { return Ok(()) };
        self.state = State::Flowing;
        if is_reported { host.set_health(Health::Ready, "") } else { Ok(()) }
    }

    /// Whether all pairs of the run have been published; then it is reported.
    fn is_at_end(&mut self, host: &mut Host) -> Result<bool, HostError> {
        let is_over = host.launch.end_sequence.is_some_and(|end| self.next >= end);
        if is_over {
            self.finish(host, "the source has no more pairs")?;
        }
        Ok(is_over)
    }

    /// Publishes the next pair. Returns false if it is not available.
    fn publish_next(&mut self, host: &mut Host, attempt: u32) -> Result<bool, HostError> {
        if self.is_at_end(host)? {
            return Ok(false);
        }
        if let State::Failed { retry_ns, wait_ns, trying: false } = self.state
            && monotonic_ns() >= retry_ns
        {
            self.state = State::Failed { retry_ns, wait_ns, trying: true };
            self.input.release(self.next);
            if std::mem::take(&mut self.is_next_left_out) {
                self.advance_past(self.next);
            }
        }
        if matches!(self.state, State::Failed { trying: false, .. }) {
            return Ok(false);
        }
        if !self.publish(host, self.next, attempt)? {
            return Ok(false);
        }
        if !matches!(self.state, State::Flowing | State::Missing { is_reported: false, .. }) {
            host.set_health(Health::Ready, "")?;
        }
        self.state = State::Flowing;
        Ok(true)
    }

    /// The next pair is not available yet. Reports a stall once `stall_ns` have passed.
    fn miss(&mut self, host: &mut Host) -> Result<(), HostError> {
        let now = monotonic_ns();
        match self.state {
            State::Flowing => self.state = State::Missing { since_ns: now, is_reported: false },
            State::Missing { since_ns, is_reported: false }
                if now.saturating_sub(since_ns) >= self.stall_ns =>
            {
                self.state = State::Missing { since_ns, is_reported: true };
                let seconds = self.stall_ns as f64 * 1e-9;
                let text = format!("the source has stalled: pair {} is late by {seconds} s", self.next);
                host.set_health(Health::Stalled, &text)?;
            }
            _ => {}
        }
        Ok(())
    }

    /// The next pair cannot be read: reports the reason and schedules a retry.
    fn fail(&mut self, host: &mut Host, reason: &str) -> Result<(), HostError> {
        let wait_ns = match self.state {
            State::Failed { wait_ns, .. } => wait_ns,
            _ => RETRY_FIRST_NS,
        };
        self.state = State::Failed {
            retry_ns: monotonic_ns() + wait_ns,
            wait_ns: (2 * wait_ns).min(RETRY_MAX_NS),
            trying: false,
        };
        host.set_health(Health::Unusable, reason)
    }

    /// Goes on with the pair after `sequence`, which cannot be read.
    fn leave_out(&mut self, host: &mut Host, sequence: u64, reason: &str) -> Result<(), HostError> {
        self.left_out_in_a_row += 1;
        self.input.release(sequence);
        self.advance_past(sequence);
        host.left_out(sequence, reason)
    }

    /// Goes on behind a pair that is not published.
    fn advance_past(&mut self, sequence: u64) {
        // No older pair is requested again, and the reader needs its slot.
        if let Some((before, _)) = self.published.take() {
            self.input.release(before);
        }
        self.next = self.next.max(sequence.saturating_add(1));
    }

    /// Copies a pair to shared memory and sends it. Returns false if it is not available or cannot be read.
    fn publish(&mut self, host: &mut Host, sequence: u64, attempt: u32) -> Result<bool, HostError> {
        let Input::Recorded(reader) = self.input else { return Ok(false) };
        let Some(pair) = reader.pair(sequence) else {
            return self.miss(host).map(|()| false);
        };
        if let Err(unread) = &pair.result {
            let Unread { reason, is_left_out } = unread.clone();
            drop(pair);
            return if is_left_out && self.left_out_in_a_row < MAX_LEFT_OUT_IN_A_ROW {
                self.leave_out(host, sequence, &reason).map(|()| false)
            } else {
                self.is_next_left_out = is_left_out;
                self.fail(host, &reason).map(|()| false)
            };
        }
        let format = host.launch.frames;
        let begin_ns = monotonic_ns();
        let mut loan = self.pairs.loan(pair::payload_bytes(format.width, format.height))?;
        let (left, right) = pair::split_mut(loan.payload_mut());
        left.copy_from_slice(&pair.left);
        right.copy_from_slice(&pair.right);
        let (source_ns, read_ns, vehicle) = (pair.source_ns, pair.read_ns, pair.vehicle);
        drop(pair);
        let end_ns = monotonic_ns();
        // The capture time of a recorded pair is the time when it is complete in shared memory.
        let mut header = Header::new(Kind::Pair);
        header.sequence = sequence;
        header.attempt = attempt;
        header.set_source_time(source_ns);
        header.capture_ns = end_ns;
        header.vehicle = vehicle;
        self.send(host, loan, header, Stamp { begin_ns, end_ns }, read_ns).map(|()| true)
    }

    /// Sends a pair and reports it. `read_ns` is the time of reading it ahead, which counts as work of this stage.
    fn send(
        &mut self,
        host: &mut Host,
        mut loan: Loan,
        mut header: Header,
        stamp: Stamp,
        read_ns: u64,
    ) -> Result<(), HostError> {
        let (sequence, attempt) = (header.sequence, header.attempt);
        if let Some(bus) = &mut self.bus {
            header.vehicle = bus.at(header.capture_ns);
        }
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
        self.left_out_in_a_row = 0;
        if attempt > 0 {
            // A repeated frame is not counted again.
            return Ok(());
        }
        host.frame_done(&header, 0, stamp.end_ns - stamp.begin_ns + read_ns)
    }
}
