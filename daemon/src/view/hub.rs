//! Where the watcher leaves the newest, and clients take it.

use super::frame::Frame;
use super::history::{History, Sample};
use messages::header::Header;
use messages::status::StatusRecord;
use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// What the viewer counts of itself.
#[derive(Debug, Default)]
pub struct Counters {
    /// Whole frames that could be shown.
    pub frames: AtomicU64,
    /// Results whose images were overtaken before they were read.
    pub incomplete: AtomicU64,
    /// Messages that failed their check.
    pub refused: AtomicU64,
    /// Messages sent to clients.
    pub sent: AtomicU64,
    /// Bytes of these.
    pub sent_bytes: AtomicU64,
    /// Clients that were turned away, because they had no right or there were too many.
    pub turned_away: AtomicU64,
    /// Clients that were let go because they took nothing for too long.
    pub too_slow: AtomicU64,
}

/// How far a client has come.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Seen {
    /// Number of the last frame.
    frame: u64,
    /// Number of the next second.
    second: u64,
    /// Number of the last change of the daemon's presence.
    presence: u64,
}

/// What is new to a client.
#[derive(Debug)]
pub struct News {
    /// The newest frame, when it is new.
    pub frame: Option<Arc<Frame>>,
    /// The newest status with the seconds since the last.
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

/// See the module.
#[derive(Debug, Default)]
pub struct Hub {
    state: Mutex<State>,
    changed: Condvar,
    clients: AtomicUsize,
    /// See [`Counters`].
    pub counters: Counters,
}

/// One client, as long as this lives.
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
        // Whatever a thread did before it died, the state is whole between two statements here.
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// A whole frame is there.
    pub fn frame(&self, frame: Frame) {
        self.counters.frames.fetch_add(1, Ordering::Relaxed);
        let mut state = self.state();
        state.frame = Some(Arc::new(frame));
        state.frames += 1;
        drop(state);
        self.changed.notify_all();
    }

    /// A frame has come out at the end, shown or not.
    pub fn result(&self, header: &Header) {
        self.state().history.frame(header);
    }

    /// The daemon tells its state.
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

    /// There is no daemon, for a reason. What it said before is forgotten.
    pub fn absent(&self, why: &str) {
        let mut state = self.state();
        if state.absent.as_deref() == Some(why) {
            return;
        }
        state.absent = Some(why.to_owned());
        (state.frame, state.status) = (None, None);
        state.history.daemon_gone();
        state.presence += 1;
        drop(state);
        self.changed.notify_all();
    }

    /// The newest status with the last second, if there is a daemon.
    pub fn now(&self) -> (Option<StatusRecord>, Option<Sample>) {
        let state = self.state();
        (state.status, state.history.last().filter(|_| state.status.is_some()).cloned())
    }

    /// Takes a client in, unless there are `most` already.
    pub fn enter(&self, most: usize) -> Option<Place<'_>> {
        let more = |count: usize| (count < most).then_some(count + 1);
        self.clients.fetch_update(Ordering::Relaxed, Ordering::Relaxed, more).ok().map(|_| Place(self))
    }

    /// Clients that look at this moment.
    pub fn clients(&self) -> usize {
        self.clients.load(Ordering::Relaxed)
    }

    /// Waits for something that is new to a client, at most `patience`, and says that it has seen it.
    /// A client that `wants_frame` is not woken by less, but told once a second.
    pub fn wait(&self, seen: &mut Seen, wants_frame: bool, patience: Duration) -> News {
        let until = Instant::now() + patience;
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
    fn a_client_is_told_what_is_new_once() {
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
    fn places_are_limited_and_given_back() {
        let hub = Hub::new();
        let first = hub.enter(1);
        assert!(first.is_some() && hub.enter(1).is_none());
        drop(first);
        assert!(hub.enter(1).is_some());
    }
}
