//! Hands the newest frame and status from the watcher to all clients.

use super::frame::Frame;
use super::history::{History, Sample};
use messages::header::Header;
use messages::status::StatusRecord;
use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// Counters of the viewer itself.
#[derive(Debug, Default)]
pub struct Counters {
    /// Complete frames.
    pub frames: AtomicU64,
    /// Results whose images were replaced by newer ones before they were read.
    pub incomplete: AtomicU64,
    /// Messages that failed their check.
    pub refused: AtomicU64,
    /// Responses sent to clients.
    pub sent: AtomicU64,
    /// Bytes of these responses.
    pub sent_bytes: AtomicU64,
    /// Requests that were rejected: not authorised, or too many connections.
    pub turned_away: AtomicU64,
    /// Clients that were disconnected because they did not read.
    pub too_slow: AtomicU64,
}

/// The newest items that a client has received.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Seen {
    /// Number of the last frame.
    frame: u64,
    /// Number of the next sample of the history.
    second: u64,
    /// Number of the last change between present and absent.
    presence: u64,
}

/// Items that a client has not received yet.
#[derive(Debug)]
pub struct News {
    /// The newest frame.
    pub frame: Option<Arc<Frame>>,
    /// The newest status, with the samples of the history since the last one.
    pub status: Option<(StatusRecord, Vec<Sample>)>,
    /// Why there is no daemon; `None` while there is one.
    pub absent: Option<String>,
}

#[derive(Debug, Default)]
struct State {
    frame: Option<Arc<Frame>>,
    frames: u64,
    status: Option<StatusRecord>,
    history: History,
    absent: Option<String>,
    presence: u64,
}

/// The newest frame and status, shared between threads.
#[derive(Debug, Default)]
pub struct Hub {
    state: Mutex<State>,
    changed: Condvar,
    clients: AtomicUsize,
    /// Counters of the viewer.
    pub counters: Counters,
}

/// Counts one client until it is dropped.
#[derive(Debug)]
pub struct Place<'a>(&'a Hub);

impl Hub {
    /// A hub without a daemon.
    pub fn new() -> Self {
        let hub = Self::default();
        hub.absent("no daemon yet");
        hub
    }

    fn state(&self) -> MutexGuard<'_, State> {
        // A poisoned lock is usable: every update leaves the state consistent.
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Publishes a complete frame.
    pub fn frame(&self, frame: Frame) {
        self.counters.frames.fetch_add(1, Ordering::Relaxed);
        let mut state = self.state();
        state.frame = Some(Arc::new(frame));
        state.frames += 1;
        drop(state);
        self.changed.notify_all();
    }

    /// Adds a result to the history, whether its frame is shown or not.
    pub fn result(&self, header: &Header) {
        self.state().history.frame(header);
    }

    /// Publishes a status.
    pub fn status(&self, status: StatusRecord, board: super::board::Readings, time_s: f64) {
        let mut state = self.state();
        state.status = Some(status);
        state.history.second(&status, board, time_s);
        if state.absent.take().is_some() {
            state.presence += 1;
        }
        drop(state);
        self.changed.notify_all();
    }

    /// Reports that there is no daemon, and why; discards its last frame and status.
    pub fn absent(&self, reason: &str) {
        let mut state = self.state();
        if state.absent.as_deref() == Some(reason) {
            return;
        }
        state.absent = Some(reason.to_owned());
        (state.frame, state.status) = (None, None);
        state.history.daemon_gone();
        state.presence += 1;
        drop(state);
        self.changed.notify_all();
    }

    /// The newest status with the last sample of the history, if there is a daemon.
    pub fn now(&self) -> (Option<StatusRecord>, Option<Sample>) {
        let state = self.state();
        (state.status, state.history.last().filter(|_| state.status.is_some()).cloned())
    }

    /// Admits a client, unless there are `limit` already.
    pub fn enter(&self, limit: usize) -> Option<Place<'_>> {
        let more = |count: usize| (count < limit).then_some(count + 1);
        self.clients.fetch_update(Ordering::Relaxed, Ordering::Relaxed, more).ok().map(|_| Place(self))
    }

    /// Number of connected clients.
    pub fn clients(&self) -> usize {
        self.clients.load(Ordering::Relaxed)
    }

    /// Waits until something is new to a client, at most `timeout`, and updates `seen`. A client that
    /// `wants_frame` is woken by a frame, not by a status; the status comes with the next frame or timeout.
    pub fn wait(&self, seen: &mut Seen, wants_frame: bool, timeout: Duration) -> News {
        let until = Instant::now() + timeout;
        let mut state = self.state();
        loop {
            let left = until.saturating_duration_since(Instant::now());
            let is_new = state.presence != seen.presence
                || (wants_frame && state.frame.is_some() && state.frames != seen.frame)
                || (!wants_frame && state.history.next() != seen.second);
            if is_new || left.is_zero() {
                break;
            }
            state = self.changed.wait_timeout(state, left).unwrap_or_else(PoisonError::into_inner).0;
        }
        let frame = state.frame.clone().filter(|_| wants_frame && state.frames != seen.frame);
        let has_second = state.history.next() != seen.second;
        let status = state.status.filter(|_| has_second).map(|s| (s, state.history.since(seen.second)));
        let absent = state.absent.clone();
        if frame.is_some() {
            seen.frame = state.frames;
        }
        if status.is_some() {
            seen.second = state.history.next();
        }
        seen.presence = state.presence;
        News { frame, status, absent }
    }
}

impl Drop for Place<'_> {
    fn drop(&mut self) {
        self.0.clients.fetch_sub(1, Ordering::Relaxed);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::view::board::Readings;

    #[test]
    fn a_client_gets_each_item_once() {
        let hub = Hub::new();
        let mut seen = Seen::default();
        let none = Duration::ZERO;
        assert!(hub.wait(&mut seen, true, none).absent.is_some());
        hub.status(StatusRecord::empty(), Readings::default(), 1.0);
        hub.status(StatusRecord::empty(), Readings::default(), 2.0);
        let news = hub.wait(&mut seen, true, none);
        assert_eq!((news.absent, news.status.map(|(_, s)| s.len())), (None, Some(2)));
        assert!(hub.wait(&mut seen, true, none).status.is_none());
        hub.absent("stopped");
        let news = hub.wait(&mut seen, true, none);
        assert_eq!((news.absent.as_deref(), news.status.is_none()), (Some("stopped"), true));
        assert_eq!(hub.now(), (None, None));
    }

    #[test]
    fn a_waiting_client_is_woken() {
        let hub = Hub::new();
        let mut seen = Seen::default();
        hub.wait(&mut seen, false, Duration::ZERO);
        std::thread::scope(|scope| {
            let waiting = scope.spawn(|| hub.wait(&mut seen, false, Duration::from_secs(120)));
            hub.status(StatusRecord::empty(), Readings::default(), 1.0);
            assert!(waiting.join().unwrap().status.is_some());
        });
    }

    #[test]
    fn places_are_limited_and_released() {
        let hub = Hub::new();
        let first = hub.enter(1);
        assert!(first.is_some() && hub.enter(1).is_none());
        drop(first);
        assert!(hub.enter(1).is_some());
    }
}
