//! The newest line, handed from the feed to all senders. It holds one frame and one state, whatever readers do.

use super::line::{close_object, status_alone, status_field};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// The state gets a line of its own when no frame has come for this long; otherwise it is in the line of the next frame.
const ALONE: Duration = Duration::from_secs(1);

/// What a reader has got.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Seen {
    frame: u64,
    status: u64,
}

/// The daemon's state as a field of a line, and the run that it belongs to.
#[derive(Debug)]
struct Status {
    run: String,
    field: String,
}

#[derive(Debug, Default)]
struct State {
    /// The line without its closing brace.
    frame: Option<Arc<str>>,
    /// Number of frames so far.
    frames: u64,
    frame_at: Option<Instant>,
    status: Option<Arc<Status>>,
    statuses: u64,
}

/// The newest frame and state, shared between threads.
#[derive(Debug, Default)]
pub struct Latest {
    state: Mutex<State>,
    changed: Condvar,
    readers: AtomicUsize,
}

/// Counts a reader until it is dropped.
#[derive(Debug)]
pub struct Reader<'a>(&'a Latest);

impl Latest {
    fn state(&self) -> MutexGuard<'_, State> {
        // A poisoned lock is usable: every update leaves the state consistent.
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Counts a reader.
    pub fn reader(&self) -> Reader<'_> {
        self.readers.fetch_add(1, Ordering::Relaxed);
        Reader(self)
    }

    /// Whether anybody reads.
    pub fn is_read(&self) -> bool {
        self.readers.load(Ordering::Relaxed) > 0
    }

    /// Publishes a frame: its line without the closing brace.
    pub fn frame(&self, open_object: String) {
        let mut state = self.state();
        state.frame = Some(open_object.into());
        state.frames += 1;
        state.frame_at = Some(Instant::now());
        drop(state);
        self.changed.notify_all();
    }

    /// Removes a frame that is no longer the newest.
    pub fn clear_frame(&self) {
        self.state().frame = None;
    }

    /// Publishes the daemon's state, a JSON object.
    pub fn status(&self, run: &str, json: &str) {
        let mut state = self.state();
        state.status = Some(Arc::new(Status { run: run.into(), field: status_field(json) }));
        state.statuses += 1;
        drop(state);
        self.changed.notify_all();
    }

    /// Removes a state that is out of date.
    pub fn clear_status(&self) {
        self.state().status = None;
    }

    /// The next line for a reader, with all that is new to it; waits for it at most `timeout`.
    pub fn next(&self, seen: &mut Seen, timeout: Duration) -> Option<String> {
        let until = Instant::now() + timeout;
        let mut state = self.state();
        loop {
            let frame = state.frame.clone().filter(|_| state.frames != seen.frame);
            let status = state.status.clone().filter(|_| state.statuses != seen.status);
            let is_alone = state.frame_at.is_none_or(|at| at.elapsed() >= ALONE);
            if frame.is_some() || (status.is_some() && is_alone) {
                seen.frame = state.frames;
                if status.is_some() {
                    seen.status = state.statuses;
                }
                drop(state);
                let field = status.as_deref();
                return match (frame, field) {
                    (Some(open), field) => Some(close_object(&open, field.map(|s| s.field.as_str()))),
                    (None, Some(status)) => Some(status_alone(&status.run, &status.field)),
                    (None, None) => None,
                };
            }
            let left = until.saturating_duration_since(Instant::now());
            if left.is_zero() {
                return None;
            }
            state = self.changed.wait_timeout(state, left).unwrap_or_else(PoisonError::into_inner).0;
        }
    }
}

impl Drop for Reader<'_> {
    fn drop(&mut self) {
        self.0.readers.fetch_sub(1, Ordering::Relaxed);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_newest_frame_wins_and_comes_once() {
        let latest = Latest::default();
        let (mut seen, none) = (Seen::default(), Duration::ZERO);
        assert_eq!(latest.next(&mut seen, none), None);
        for i in 0..3 {
            latest.frame(format!("{{\"sequence\":{i}"));
        }
        assert_eq!(latest.next(&mut seen, none).unwrap(), "{\"sequence\":2}\n");
        assert_eq!(latest.next(&mut seen, none), None);
        let mut other = Seen::default();
        assert!(latest.next(&mut other, none).is_some(), "each reader has its own");
    }

    #[test]
    fn the_state_is_in_the_next_frame_or_alone_where_none_comes() {
        let latest = Latest::default();
        let (mut seen, none) = (Seen::default(), Duration::ZERO);
        latest.status("r", "{}");
        assert_eq!(latest.next(&mut seen, none).unwrap(), "{\"run\":\"r\",\"status\":{}}\n");
        latest.frame("{\"sequence\":1".into());
        latest.next(&mut seen, none);
        latest.status("r", "{\"a\":1}");
        assert_eq!(latest.next(&mut seen, none), None, "frames come: it waits for the next");
        latest.frame("{\"sequence\":2".into());
        let line = latest.next(&mut seen, none).unwrap();
        assert_eq!(line, "{\"sequence\":2,\"status\":{\"a\":1}}\n");
        latest.status("r", "{}");
        latest.clear_status();
        assert_eq!(latest.next(&mut seen, none), None);
    }

    #[test]
    fn a_waiting_reader_is_woken() {
        let latest = Latest::default();
        assert!(!latest.is_read());
        std::thread::scope(|scope| {
            let waiting = scope.spawn(|| {
                let _reader = latest.reader();
                latest.next(&mut Seen::default(), Duration::from_secs(120))
            });
            while !latest.is_read() {
                std::thread::yield_now();
            }
            latest.frame("{\"a\":1".into());
            assert!(waiting.join().unwrap().is_some());
        });
        assert!(!latest.is_read());
    }
}
