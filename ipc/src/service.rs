//! Payload and pool sizes of the services.

use crate::header::{Header, LINE_BYTES};
use crate::message;
pub use crate::pipeline::{COMMAND, DEPTH, OBSTACLES, PAIR, REGIONS, REPORT, SERVICES, STATUS, ServiceSpec};
use crate::pipeline::{Kind, PROCESSES};

/// Maximum number of messages that a publisher writes at a time.
pub const LOANED: usize = 1;

impl ServiceSpec {
    /// Maximum length of the payload for images of `width` × `height` pixels, in bytes.
    pub fn max_payload_bytes(&self, width: usize, height: usize) -> usize {
        message::max_payload_bytes(self.kind, width, height)
    }

    /// Number of samples in the pool of one publisher: subscribers × (buffer + borrowed) + history + loaned.
    pub const fn pool_samples(&self) -> usize {
        self.subscribers * (self.buffer + self.borrowed) + self.history + LOANED
    }

    /// Size of the pool of one publisher, with headers and alignment, in bytes.
    pub fn pool_bytes(&self, width: usize, height: usize) -> usize {
        // The header of iceoryx2 takes less than 128 bytes.
        let sample = self.max_payload_bytes(width, height) + size_of::<Header>() + 128 + LINE_BYTES;
        self.pool_samples() * sample.next_multiple_of(LINE_BYTES)
    }
}

/// Total size of the pools of a daemon with `stages` reporting processes, for images of `width` × `height` pixels, in
/// bytes.
pub fn total_pool_bytes(width: usize, height: usize, stages: usize) -> usize {
    SERVICES
        .iter()
        .map(|s| {
            let publishing = PROCESSES.iter().filter(|p| p.output == Some(s)).count();
            let publishers = match s.kind {
                Kind::Report => stages,
                // The scheduler publishes here, too, to withdraw results.
                Kind::Obstacles => publishing + 1,
                _ => publishing.max(1),
            };
            s.pool_bytes(width, height) * publishers
        })
        .sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pools_follow_the_formula() {
        assert_eq!(PAIR.pool_samples(), 3 * (1 + 1) + 1);
        assert_eq!(OBSTACLES.pool_samples(), 11 * 2 + 1 + 1);
        assert_eq!(REPORT.pool_samples(), 2 * 65 + 1);
        assert_eq!(PAIR.max_payload_bytes(640, 480), 614_400);
        let total = total_pool_bytes(640, 480, 5);
        assert!((26 << 20..31 << 20).contains(&total), "{total}");
    }
}
