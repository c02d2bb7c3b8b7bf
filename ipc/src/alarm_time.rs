//! For how many frames, and for how long, the alarm was in each level, and why it was off: part of `status`.

use crate::alarm::{Faults, LEVELS};
use crate::range::{CLOCK_NS, COUNT, Each, ranges};
use bytemuck::{Pod, Zeroable};

/// Number of self-checks that there is space for: bits of [`Faults`].
pub const MAX_FAULTS: usize = 16;
const _: () = assert!(Faults::ALL.0 < 1 << MAX_FAULTS);

/// Frames and source time by level and by self-check, since the daemon started.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
pub struct AlarmTimeRecord {
    /// Frames in each of [`LEVELS`].
    pub frames: [u64; LEVELS.len()],
    /// Source time in each of them, in ns.
    pub ns: [u64; LEVELS.len()],
    /// Frames with the alarm off in which a self-check failed, by its bit; a frame may have several.
    pub off_frames: [u64; MAX_FAULTS],
    /// Source time with the alarm off while it failed, in ns.
    pub off_ns: [u64; MAX_FAULTS],
}

ranges! {
    AlarmTimeRecord as "status: time by level" {
        frames: Each(COUNT),
        ns: Each(CLOCK_NS),
        off_frames: Each(COUNT),
        off_ns: Each(CLOCK_NS),
    }
}

impl AlarmTimeRecord {
    /// The self-checks that ever switched the alarm off: description, frames, ns. In the order of display.
    pub fn reasons(&self) -> impl Iterator<Item = (&'static str, u64, u64)> {
        Faults::each().filter_map(|(fault, description)| {
            let bit = fault.0.trailing_zeros() as usize;
            let (frames, ns) = (*self.off_frames.get(bit)?, *self.off_ns.get(bit)?);
            (frames > 0 || ns > 0).then_some((description, frames, ns))
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::range::Ranged;

    #[test]
    fn reasons_are_those_that_occurred() {
        let mut record = AlarmTimeRecord::default();
        assert_eq!(record.reasons().count(), 0);
        record.off_frames[Faults::NO_ROAD.0.trailing_zeros() as usize] = 3;
        record.off_ns[Faults::STALE.0.trailing_zeros() as usize] = 7;
        let all: Vec<_> = record.reasons().collect();
        assert_eq!(all, [("no result for too long", 0, 7), ("no road seen", 3, 0)]);
        assert!(record.check().is_ok());
        for (field, wrong) in record.invalid() {
            assert!(wrong.check().unwrap_err().to_string().contains(field));
        }
    }
}
