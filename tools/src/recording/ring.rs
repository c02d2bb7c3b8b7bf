//! Ring buffer of the last seconds of messages, written when an alarm is raised.

use super::topic::Message;
use std::collections::VecDeque;

/// Memory of a message besides its data, in bytes.
const MESSAGE_BYTES: usize = 64;

/// The latest messages, bounded in time and in bytes.
#[derive(Debug)]
pub struct Ring {
    messages: VecDeque<Message>,
    bytes: usize,
    longest_ns: u64,
    max_bytes: usize,
}

impl Ring {
    /// A ring buffer of `longest_ns` nanoseconds and at most `max_bytes` bytes.
    pub fn new(longest_ns: u64, max_bytes: usize) -> Self {
        Self { messages: VecDeque::new(), bytes: 0, longest_ns, max_bytes }
    }

    /// Adds a message and drops the oldest ones beyond the bounds. Returns whether the limit of bytes dropped a
    /// message within the time bound.
    pub fn push(&mut self, message: Message) -> bool {
        let oldest_ns = message.time_ns.saturating_sub(self.longest_ns);
        self.bytes += message.data.len() + MESSAGE_BYTES;
        self.messages.push_back(message);
        let mut is_short = false;
        while let Some(first) = self.messages.front()
            && (first.time_ns < oldest_ns || self.bytes > self.max_bytes)
        {
            is_short |= first.time_ns >= oldest_ns;
            self.bytes -= first.data.len() + MESSAGE_BYTES;
            self.messages.pop_front();
        }
        is_short
    }

    /// Removes all messages, oldest first.
    pub fn drain(&mut self) -> impl Iterator<Item = Message> {
        self.bytes = 0;
        self.messages.drain(..)
    }

    /// Memory in use, in bytes.
    #[cfg(test)]
    pub fn bytes(&self) -> usize {
        self.bytes
    }
}

#[cfg(test)]
mod tests {
    use super::super::topic::Topic;
    use super::*;

    fn message(second: u64, bytes: usize) -> Message {
        Message {
            topic: Topic::Pair,
            sequence: second as u32,
            time_ns: second * 1_000_000_000,
            data: vec![0; bytes],
        }
    }

    #[test]
    fn it_holds_the_last_seconds() {
        let mut ring = Ring::new(20_000_000_000, 1 << 20);
        for second in 0..100 {
            assert!(!ring.push(message(second, 100)));
        }
        let kept: Vec<u32> = ring.drain().map(|m| m.sequence).collect();
        assert_eq!(kept, (79..100).collect::<Vec<_>>());
        assert_eq!((ring.bytes(), ring.drain().count()), (0, 0));
    }

    #[test]
    fn its_memory_is_bounded() {
        let mut ring = Ring::new(20_000_000_000, 10_000);
        let mut was_short = false;
        for second in 0..1000 {
            was_short |= ring.push(message(second, 900));
            assert!(ring.bytes() <= 10_000);
        }
        assert!(was_short, "the limit of bytes must be reported");
        assert_eq!(ring.drain().count(), 10);
        // A message that is larger than the ring buffer is dropped.
        assert!(ring.push(message(2000, 20_000)));
        assert_eq!(ring.drain().count(), 0);
    }
}
