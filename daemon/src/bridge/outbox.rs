//! What waits to be sent: bounded, the oldest gives way and is counted.

use std::collections::{BTreeMap, VecDeque};
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

/// How the payload is encoded.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Form {
    /// JSON text.
    Json,
    /// CDR, a message of ROS 2.
    Cdr,
}

/// A message.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Item {
    /// Topic, for the counts.
    pub topic: &'static str,
    /// Its key.
    pub key: String,
    /// The message.
    pub payload: Vec<u8>,
    /// Its encoding.
    pub form: Form,
    /// What goes with it.
    pub attachment: Option<Vec<u8>>,
    /// Whether it waits while there is no network.
    pub keeps: bool,
}

/// Counts of a topic.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
pub struct Counts {
    /// Messages handed to the network.
    pub sent: u64,
    /// Messages that gave way, or could not be sent.
    pub dropped: u64,
}

#[derive(Debug, Default)]
struct State {
    queue: VecDeque<Item>,
    bytes: usize,
    counts: BTreeMap<&'static str, Counts>,
    is_connected: bool,
}

/// The messages that wait, shared between threads.
#[derive(Debug)]
pub struct Outbox {
    state: Mutex<State>,
    changed: Condvar,
    max_bytes: usize,
}

impl Outbox {
    /// An empty one that holds at most `max_bytes`.
    pub fn new(max_bytes: usize) -> Self {
        Self { state: Mutex::default(), changed: Condvar::new(), max_bytes }
    }

    fn state(&self) -> MutexGuard<'_, State> {
        // A poisoned lock is usable: every update leaves the state consistent.
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Adds a message.
    pub fn push(&self, item: Item) {
        let mut state = self.state();
        let size = item.payload.len();
        if size > self.max_bytes || !(item.keeps || state.is_connected) {
            state.counts.entry(item.topic).or_default().dropped += 1;
            return;
        }
        while state.bytes + size > self.max_bytes {
            let Some(oldest) = state.queue.pop_front() else { break };
            state.bytes -= oldest.payload.len();
            state.counts.entry(oldest.topic).or_default().dropped += 1;
        }
        state.bytes += size;
        state.queue.push_back(item);
        drop(state);
        self.changed.notify_one();
    }

    /// The oldest message; waits for one at most `timeout`.
    pub fn pop(&self, timeout: Duration) -> Option<Item> {
        let mut state = self.state();
        if state.queue.is_empty() {
            state = self.changed.wait_timeout(state, timeout).unwrap_or_else(PoisonError::into_inner).0;
        }
        let item = state.queue.pop_front()?;
        state.bytes -= item.payload.len();
        Some(item)
    }

    /// Wakes who waits for a message, for another reason.
    pub fn wake(&self) {
        self.changed.notify_one();
    }

    /// Counts what became of a message.
    pub fn count(&self, topic: &'static str, is_sent: bool) {
        let mut state = self.state();
        let counts = state.counts.entry(topic).or_default();
        if is_sent {
            counts.sent += 1;
        } else {
            counts.dropped += 1;
        }
    }

    /// Whether there is a network.
    pub fn connected(&self, is_connected: bool) {
        self.state().is_connected = is_connected;
    }

    /// Counts of all topics, and the bytes that wait.
    pub fn counts(&self) -> (BTreeMap<&'static str, Counts>, usize) {
        let state = self.state();
        (state.counts.clone(), state.bytes)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn item(topic: &'static str, size: usize, keeps: bool) -> Item {
        let payload = vec![0; size];
        Item { topic, key: topic.into(), payload, form: Form::Json, attachment: None, keeps }
    }

    #[test]
    fn the_oldest_gives_way_and_is_counted() {
        let outbox = Outbox::new(100);
        for size in [40, 50, 60, 101] {
            outbox.push(item("a", size, true));
        }
        let (counts, bytes) = outbox.counts();
        assert_eq!((counts["a"].dropped, bytes), (3, 60));
        assert_eq!(outbox.pop(Duration::ZERO).map(|i| i.payload.len()), Some(60));
        assert_eq!(outbox.pop(Duration::ZERO), None);
        // Images do not wait for a network.
        outbox.push(item("b", 1, false));
        outbox.connected(true);
        outbox.push(item("b", 2, false));
        outbox.count("b", true);
        assert_eq!(outbox.counts().0["b"], Counts { sent: 1, dropped: 1 });
        assert_eq!(outbox.counts().1, 2);
    }
}
