//! Sends frames without ever waiting for the bus: what it does not take until the next cycle is dropped and counted. A
//! bus that fails is tried again. Time is passed in.
//!
//! The kernel gives each frame back when it was sent, on a real bus when another node has acknowledged it. A cycle is
//! therefore sent only when the one before is through: a bus that takes nothing (bus-off, no other node, no room) holds at
//! most one cycle, not a queue of old ones that would be sent when it recovers.

use super::encoder::OutFrame;
use serde::{Deserialize, Serialize};
use std::collections::VecDeque;
use std::io;

/// Time before an interface that failed is opened again, in nanoseconds.
const RETRY_NS: u64 = 1_000_000_000;

/// Time after which a cycle that the bus has not taken is given up and the next one is tried, in nanoseconds.
const PATIENCE_NS: u64 = 1_000_000_000;

/// Number of last frames of cycles by which one that comes back is recognised as our own.
const REMEMBERED: usize = 8;

/// A frame or notice that came from the interface.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Received {
    /// A frame with the identifier that the port was told to watch: our own, or another node's.
    Watched([u8; 8]),
    /// The controller has gone off the bus after too many errors.
    BusOff,
    /// The controller was restarted.
    Restarted,
    /// Anything else.
    Other,
}

/// An interface to a bus. No call may wait.
pub trait Port {
    /// Opens it. From then on it receives the frames with the identifier of `watch`, its own, too.
    ///
    /// # Errors
    /// If there is no such interface, or the system refuses.
    fn open(&mut self, watch: &OutFrame) -> io::Result<()>;
    /// Closes it.
    fn close(&mut self);
    /// Sends a frame.
    ///
    /// # Errors
    /// `WouldBlock` if there is no room; any other if the interface has failed.
    fn send(&mut self, frame: &OutFrame) -> io::Result<()>;
    /// The next frame or notice, if one has come.
    ///
    /// # Errors
    /// If the interface has failed.
    fn receive(&mut self) -> io::Result<Option<Received>>;
}

/// State of the bus.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum LinkState {
    /// Not opened yet.
    #[default]
    Starting,
    /// Frames are sent.
    Sending,
    /// The interface is not there, or down.
    Down,
    /// The interface does not take all frames of a cycle within its period.
    Full,
    /// The bus does not take frames: no other node acknowledges, or it is overloaded.
    Unacknowledged,
    /// The controller is off the bus after too many errors.
    BusOff,
    /// Another node sends frames with our identifiers.
    Conflict,
}

/// What is told of a link.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct LinkReport {
    /// Its state.
    pub state: LinkState,
    /// Why it is in this state, and what helps; empty while it sends.
    pub reason: String,
    /// Cycles of frames that were given to the interface.
    pub cycles: u64,
    /// Cycles that the bus has taken.
    pub confirmed: u64,
    /// Frames for which the interface had no room.
    pub dropped: u64,
    /// Cycles that were left out because the one before was not through, or the interface was not open.
    pub withheld: u64,
    /// Times that the interface could not be opened or failed.
    pub failures: u64,
    /// Times that the controller went off the bus.
    pub bus_offs: u64,
    /// Frames of other nodes with our identifier.
    pub conflicts: u64,
}

/// Sends the frames of cycles to a port.
#[derive(Debug)]
pub struct Link<P> {
    port: P,
    watch: OutFrame,
    is_open: bool,
    /// When to open it.
    retry_ns: u64,
    /// When the last cycle was sent, if the bus has not taken it yet.
    waiting_since_ns: Option<u64>,
    /// The last frames of the last cycles.
    sent: VecDeque<[u8; 8]>,
    /// Frames of this cycle for which there was no room yet.
    rest: VecDeque<OutFrame>,
    /// The port had no room for all frames of the last cycle.
    is_full: bool,
    is_bus_off: bool,
    /// No cycle came through within the time for it.
    is_unacknowledged: bool,
    /// When another node last sent our identifier.
    conflict_ns: Option<u64>,
    report: LinkReport,
}

impl<P: Port> Link<P> {
    /// A link that is opened at the first cycle. `watch` is the last frame of each cycle, whose data do not matter.
    pub fn new(port: P, watch: OutFrame) -> Self {
        Self {
            port,
            watch,
            is_open: false,
            retry_ns: 0,
            waiting_since_ns: None,
            sent: VecDeque::with_capacity(REMEMBERED),
            rest: VecDeque::new(),
            is_full: false,
            is_bus_off: false,
            is_unacknowledged: false,
            conflict_ns: None,
            report: LinkReport::default(),
        }
    }

    /// What is told of it.
    pub fn report(&self) -> &LinkReport {
        &self.report
    }

    /// Sends the cycle that `frames` makes, if the bus can take one; otherwise `frames` is not called, and the alive
    /// counter does not advance.
    pub fn cycle(&mut self, now_ns: u64, frames: impl FnOnce() -> Vec<OutFrame>) {
        self.open(now_ns);
        self.receive(now_ns);
        self.is_full = !self.rest.is_empty();
        self.report.dropped += self.rest.len() as u64;
        self.rest.clear();
        if !self.is_open || self.is_waiting(now_ns) {
            self.report.withheld += 1;
        } else {
            self.report.cycles += 1;
            self.rest.extend(frames());
            self.resume(now_ns);
        }
        self.describe(now_ns);
    }

    /// Whether frames of the last cycle wait for room: the queue of an interface is short (10 frames as a rule).
    /// [`Self::resume`] sends them; those that still wait at the next cycle are dropped.
    pub fn has_rest(&self) -> bool {
        !self.rest.is_empty()
    }

    /// Sends what waits for room.
    pub fn resume(&mut self, now_ns: u64) {
        while let Some(frame) = self.rest.front() {
            match self.port.send(frame) {
                Ok(()) if self.rest.len() == 1 => {
                    if self.sent.len() == REMEMBERED {
                        self.sent.pop_front();
                    }
                    self.sent.push_back(frame.data);
                    self.waiting_since_ns = Some(now_ns);
                }
                Ok(()) => {}
                Err(error) if error.kind() == io::ErrorKind::WouldBlock => return,
                Err(error) => return self.failed(&error, now_ns),
            }
            self.rest.pop_front();
        }
    }

    fn open(&mut self, now_ns: u64) {
        if self.is_open || now_ns < self.retry_ns {
            return;
        }
        match self.port.open(&self.watch) {
            Ok(()) => {
                self.is_open = true;
                (self.waiting_since_ns, self.is_full, self.is_bus_off) = (None, false, false);
                self.is_unacknowledged = false;
            }
            Err(error) => self.failed(&error, now_ns),
        }
    }

    fn failed(&mut self, error: &io::Error, now_ns: u64) {
        self.port.close();
        self.is_open = false;
        self.report.dropped += self.rest.len() as u64;
        self.rest.clear();
        self.retry_ns = now_ns + RETRY_NS;
        self.report.failures += 1;
        self.report.state = LinkState::Down;
        self.report.reason = format!(
            "the interface cannot be used: {error}: check can_out.interface and that it is up; it is tried again"
        );
    }

    fn receive(&mut self, now_ns: u64) {
        while self.is_open {
            match self.port.receive() {
                Ok(None) => return,
                Ok(Some(received)) => self.take(received, now_ns),
                Err(error) => self.failed(&error, now_ns),
            }
        }
    }

    fn take(&mut self, received: Received, now_ns: u64) {
        match received {
            Received::Watched(data) if self.sent.contains(&data) => {
                if self.sent.back() == Some(&data) && self.waiting_since_ns.take().is_some() {
                    self.report.confirmed += 1;
                }
                (self.is_bus_off, self.is_unacknowledged) = (false, false);
            }
            Received::Watched(_) => {
                self.report.conflicts += 1;
                self.conflict_ns = Some(now_ns);
            }
            Received::BusOff => {
                self.report.bus_offs += u64::from(!self.is_bus_off);
                self.is_bus_off = true;
            }
            // What was sent before was lost with the restart.
            Received::Restarted => (self.is_bus_off, self.waiting_since_ns) = (false, None),
            Received::Other => {}
        }
    }

    /// Whether the last cycle is not through, and is still waited for.
    fn is_waiting(&mut self, now_ns: u64) -> bool {
        let Some(since_ns) = self.waiting_since_ns else { return false };
        let is_waiting = now_ns.saturating_sub(since_ns) < PATIENCE_NS;
        self.is_unacknowledged |= !is_waiting;
        is_waiting
    }

    fn describe(&mut self, now_ns: u64) {
        if !self.is_open {
            return;
        }
        let is_disturbed =
            self.conflict_ns.is_some_and(|at_ns| now_ns.saturating_sub(at_ns) < 2 * PATIENCE_NS);
        let (state, reason) = if self.is_bus_off {
            (
                LinkState::BusOff,
                "the controller is off the bus after too many errors: check bit rate, wiring and termination; it comes \
                 back by itself if the interface has restart-ms",
            )
        } else if is_disturbed {
            (
                LinkState::Conflict,
                "another node, or another program here, sends our identifier: choose another can_out.base_id",
            )
        } else if self.is_full {
            (
                LinkState::Full,
                "the interface does not take the frames of a cycle within its period: no other node acknowledges, or the \
                 bus is too slow or too busy: check it, or raise can_out.period_ms",
            )
        } else if self.is_unacknowledged {
            (
                LinkState::Unacknowledged,
                "the bus takes no frame: no other node acknowledges, it is overloaded, or off after errors",
            )
        } else {
            (LinkState::Sending, "")
        };
        if self.report.state != state {
            self.report.state = state;
            self.report.reason = reason.into();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: u64 = 1_000_000;
    const PERIOD_NS: u64 = 50 * MS;

    /// A bus whose faults a test switches.
    #[derive(Debug, Default)]
    struct Bench {
        is_absent: bool,
        is_deaf: bool,
        room: usize,
        queued: VecDeque<OutFrame>,
        notices: VecDeque<Received>,
        on_the_bus: Vec<OutFrame>,
        opened: u32,
    }

    impl Port for Bench {
        fn open(&mut self, _: &OutFrame) -> io::Result<()> {
            if self.is_absent {
                return Err(io::Error::from_raw_os_error(19));
            }
            self.opened += 1;
            Ok(())
        }

        fn close(&mut self) {
            self.queued.clear();
        }

        fn send(&mut self, frame: &OutFrame) -> io::Result<()> {
            if self.is_absent {
                return Err(io::Error::from_raw_os_error(100));
            }
            if self.queued.len() >= self.room {
                return Err(io::ErrorKind::WouldBlock.into());
            }
            self.queued.push_back(*frame);
            Ok(())
        }

        fn receive(&mut self) -> io::Result<Option<Received>> {
            if let Some(notice) = self.notices.pop_front() {
                return Ok(Some(notice));
            }
            while !self.is_deaf
                && let Some(frame) = self.queued.pop_front()
            {
                self.on_the_bus.push(frame);
                if frame.id == 2 {
                    return Ok(Some(Received::Watched(frame.data)));
                }
            }
            Ok(None)
        }
    }

    fn frame(id: u32, number: u8) -> OutFrame {
        OutFrame { id, is_extended: false, data: [number; 8], data_id: 0 }
    }

    /// A link and the number of cycles that were made.
    struct Run {
        link: Link<Bench>,
        now_ns: u64,
        made: u8,
    }

    impl Run {
        fn new() -> Self {
            let bench = Bench { room: 100, ..Bench::default() };
            Self { link: Link::new(bench, frame(2, 0)), now_ns: 0, made: 0 }
        }

        /// Cycles of two frames for a time.
        fn cycles(&mut self, count: u64) {
            for _ in 0..count {
                let made = &mut self.made;
                self.link.cycle(self.now_ns, || {
                    *made = made.wrapping_add(1);
                    vec![frame(1, *made), frame(2, *made)]
                });
                self.now_ns += PERIOD_NS;
            }
        }

        fn state(&self) -> LinkState {
            self.link.report().state
        }
    }

    #[test]
    fn every_cycle_is_sent_and_confirmed_on_a_sound_bus() {
        let mut run = Run::new();
        run.cycles(20);
        let report = run.link.report().clone();
        assert_eq!((report.state, report.cycles, report.confirmed), (LinkState::Sending, 20, 19));
        assert_eq!((report.dropped, report.withheld, report.failures), (0, 0, 0));
        assert_eq!(run.link.port.on_the_bus.len(), 38);
    }

    #[test]
    fn an_interface_that_is_missing_or_goes_down_is_tried_again() {
        let mut run = Run::new();
        run.link.port.is_absent = true;
        run.cycles(60);
        assert_eq!((run.state(), run.made), (LinkState::Down, 0));
        assert_eq!(run.link.report().failures, 3, "once a second");
        assert!(run.link.report().reason.contains("can_out.interface"));
        run.link.port.is_absent = false;
        run.cycles(21);
        assert_eq!((run.state(), run.link.port.opened), (LinkState::Sending, 1));
        assert!(run.link.report().reason.is_empty());
        run.link.port.is_absent = true;
        run.cycles(2);
        assert_eq!(run.state(), LinkState::Down);
        run.link.port.is_absent = false;
        run.cycles(30);
        assert_eq!((run.state(), run.link.port.opened), (LinkState::Sending, 2));
    }

    #[test]
    fn a_bus_that_takes_nothing_holds_one_cycle_and_no_queue_of_old_ones() {
        let mut run = Run::new();
        run.cycles(5);
        run.link.port.is_deaf = true;
        run.cycles(200);
        // Ten seconds: one cycle a second was tried, the others were not even made.
        assert_eq!(run.state(), LinkState::Unacknowledged);
        assert!((14..=16).contains(&run.made), "{}", run.made);
        run.link.port.is_deaf = false;
        run.cycles(10);
        assert_eq!(run.state(), LinkState::Sending);
    }

    #[test]
    fn a_short_queue_takes_the_rest_later() {
        let mut run = Run::new();
        run.link.port.room = 1;
        for _ in 0..5 {
            run.cycles(1);
            assert!(run.link.has_rest());
            // The bus has taken the first frame meanwhile.
            run.link.receive(run.now_ns);
            run.link.resume(run.now_ns);
            assert!(!run.link.has_rest());
        }
        let report = run.link.report();
        assert_eq!((report.state, report.cycles, report.dropped), (LinkState::Sending, 5, 0));
        assert_eq!(report.confirmed, 4);
    }

    #[test]
    fn what_has_no_room_until_the_next_cycle_is_dropped_and_told() {
        let mut run = Run::new();
        run.link.port.room = 1;
        run.cycles(4);
        let report = run.link.report();
        assert_eq!((report.state, report.cycles, report.dropped), (LinkState::Full, 4, 3));
        run.link.port.room = 10;
        run.cycles(2);
        assert_eq!(run.state(), LinkState::Sending);
    }

    #[test]
    fn bus_off_is_told_until_frames_pass_again() {
        let mut run = Run::new();
        run.cycles(3);
        run.link.port.is_deaf = true;
        run.link.port.notices.extend([Received::BusOff, Received::Other, Received::BusOff]);
        run.cycles(3);
        assert_eq!((run.state(), run.link.report().bus_offs), (LinkState::BusOff, 1));
        run.link.port.is_deaf = false;
        run.link.port.queued.clear();
        run.link.port.notices.push_back(Received::Restarted);
        run.cycles(2);
        assert_eq!(run.state(), LinkState::Sending);
    }

    #[test]
    fn a_second_sender_of_the_identifier_is_told() {
        let mut run = Run::new();
        run.cycles(3);
        run.link.port.notices.push_back(Received::Watched([0xee; 8]));
        run.cycles(3);
        assert_eq!((run.state(), run.link.report().conflicts), (LinkState::Conflict, 1));
        run.cycles(60);
        assert_eq!(run.state(), LinkState::Sending);
    }
}
