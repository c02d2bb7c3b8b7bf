//! The table of services: who may publish and subscribe, and how much memory that takes.

use crate::header::{Header, Kind, LINE_BYTES};
use crate::{command, depth, obstacles, pair, regions, report, status};

/// One service. Newest wins everywhere: a full buffer drops its oldest message.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ServiceSpec {
    /// What it carries.
    pub kind: Kind,
    /// Its name.
    pub name: &'static str,
    /// Publishers at once; one more than there are, for the moment in which a dead one's place is
    /// not yet cleaned up.
    pub publishers: usize,
    /// Subscribers at once: our own stages, and places for readers from outside.
    pub subscribers: usize,
    /// Messages that wait for one subscriber.
    pub buffer: usize,
    /// Messages that one subscriber may hold.
    pub borrowed: usize,
    /// Messages that a late subscriber still gets.
    pub history: usize,
}

/// A publisher writes one message at a time.
pub const LOANED: usize = 1;

/// All services.
pub const SERVICES: [ServiceSpec; 7] = [PAIR, DEPTH, REGIONS, OBSTACLES, REPORT, COMMAND, STATUS];

/// Places for readers from outside: two viewers and a recorder. They cost nothing while nobody takes
/// them: pages of a pool that are never used stay untouched.
const READERS: usize = 3;

/// capture → stereo, recorder.
pub const PAIR: ServiceSpec = frames(Kind::Pair, "pair", 3);
/// stereo → road, writer, readers.
pub const DEPTH: ServiceSpec = frames(Kind::Depth, "depth", 3 + READERS);
/// road → recognition, writer, readers.
pub const REGIONS: ServiceSpec = frames(Kind::Regions, "regions", 3 + READERS);
/// recognition → scheduler, writer, vehicle, readers; and scheduler → all but itself, to take back what a
/// dead or silent stage has said last. So a late comer may get two messages of the history: the one that
/// was issued later holds ([`obstacles::Newest`]).
pub const OBSTACLES: ServiceSpec =
    ServiceSpec { publishers: 3, history: 1, ..frames(Kind::Obstacles, "obstacles", 8 + READERS) };
/// every stage → scheduler.
pub const REPORT: ServiceSpec = ServiceSpec {
    kind: Kind::Report,
    name: "report",
    publishers: 12,
    subscribers: 2,
    buffer: 64,
    borrowed: 1,
    history: 0,
};
/// scheduler → capture.
pub const COMMAND: ServiceSpec = ServiceSpec { history: 1, ..frames(Kind::Command, "command", 2) };
/// scheduler → anyone.
pub const STATUS: ServiceSpec = ServiceSpec { history: 1, ..frames(Kind::Status, "status", 8 + READERS) };

const fn frames(kind: Kind, name: &'static str, subscribers: usize) -> ServiceSpec {
    ServiceSpec { kind, name, publishers: 2, subscribers, buffer: 1, borrowed: 1, history: 0 }
}

impl ServiceSpec {
    /// The longest payload for images of `width` × `height`, in bytes.
    pub fn max_payload_bytes(&self, width: usize, height: usize) -> usize {
        match self.kind {
            Kind::Pair => pair::payload_bytes(width, height),
            Kind::Depth => depth::payload_bytes(width, height),
            Kind::Regions => regions::max_payload_bytes(width, height),
            Kind::Obstacles => obstacles::payload_bytes(obstacles::MAX_COUNT),
            Kind::Report => report::PAYLOAD_BYTES,
            Kind::Command => command::PAYLOAD_BYTES,
            Kind::Status => status::PAYLOAD_BYTES,
        }
    }

    /// Samples in the pool of one publisher: subscribers × (buffer + borrowed) + history + loaned.
    pub const fn pool_samples(&self) -> usize {
        self.subscribers * (self.buffer + self.borrowed) + self.history + LOANED
    }

    /// Bytes of the pool of one publisher, with headers and alignment.
    pub fn pool_bytes(&self, width: usize, height: usize) -> usize {
        // The library's own header is below 128 bytes.
        let sample = self.max_payload_bytes(width, height) + size_of::<Header>() + 128 + LINE_BYTES;
        self.pool_samples() * sample.next_multiple_of(LINE_BYTES)
    }
}

/// Bytes of all pools of a daemon with `stages` reporting processes, for images of
/// `width` × `height`.
pub fn total_pool_bytes(width: usize, height: usize, stages: usize) -> usize {
    SERVICES
        .iter()
        .map(|s| {
            let publishers = match s.kind {
                Kind::Report => stages,
                Kind::Obstacles => 2,
                _ => 1,
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

    #[test]
    fn names_and_kinds_are_unique() {
        for (i, a) in SERVICES.iter().enumerate() {
            for b in &SERVICES[..i] {
                assert!(a.name != b.name && a.kind != b.kind);
            }
        }
    }
}
