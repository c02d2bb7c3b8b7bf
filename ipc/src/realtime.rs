//! Real-time privileges of a process: part of `report` and `status`.

use crate::range::{COUNT, PADDING, ranges, within};
use bytemuck::{Pod, Zeroable};
use std::fmt;

/// A privilege that the system may refuse.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u32)]
pub enum Privilege {
    /// A real-time priority (SCHED_FIFO).
    Scheduling = 1,
    /// Locked memory, which is never paged out.
    MemoryLock = 2,
    /// Prefaulted shared memory: its pages are allocated before they are used.
    Prefault = 4,
    /// Pinning to a core.
    Pinning = 8,
}

impl Privilege {
    /// All privileges.
    pub const ALL: [Self; 4] = [Self::Scheduling, Self::MemoryLock, Self::Prefault, Self::Pinning];

    /// The key in the table `[realtime]` that requests it.
    pub fn name(self) -> &'static str {
        match self {
            Self::Scheduling => "scheduling",
            Self::MemoryLock => "memory_lock",
            Self::Prefault => "prefault",
            Self::Pinning => "pinning",
        }
    }
}

/// Privileges of a process.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
pub struct RealtimeRecord {
    /// SCHED_FIFO priority, read back from the kernel; 0 = another policy.
    pub priority: u32,
    /// [`Privilege`]s that were granted, one bit each.
    pub granted: u32,
    /// [`Privilege`]s that were requested with `prefer` and refused, one bit each.
    pub refused: u32,
    /// Padding; 0.
    pub reserved: u32,
    /// Number of log lines that were dropped because the queue to standard error was full.
    pub log_dropped: u64,
}

/// Maximum priority of SCHED_FIFO.
const MAX_PRIORITY: u32 = 99;

/// All bits of [`Privilege`].
const ALL_PRIVILEGES: u32 = (1 << Privilege::ALL.len()) - 1;

ranges! {
    RealtimeRecord as "realtime" {
        priority: within(0, MAX_PRIORITY),
        granted: within(0, ALL_PRIVILEGES),
        refused: within(0, ALL_PRIVILEGES),
        reserved: PADDING,
        log_dropped: COUNT,
    }
}

impl RealtimeRecord {
    /// Records that a privilege was granted.
    pub fn grant(&mut self, privilege: Privilege) {
        self.granted |= privilege as u32;
    }

    /// Records that a privilege was refused.
    pub fn refuse(&mut self, privilege: Privilege) {
        self.refused |= privilege as u32;
    }

    /// Whether a privilege was granted.
    pub fn has(&self, privilege: Privilege) -> bool {
        self.granted & privilege as u32 != 0
    }

    /// Names of the refused privileges.
    pub fn refusals(&self) -> impl Iterator<Item = &'static str> {
        let refused = self.refused;
        Privilege::ALL.into_iter().filter(move |p| refused & *p as u32 != 0).map(Privilege::name)
    }
}

/// For example "FIFO 40, locked; refused: pinning".
impl fmt::Display for RealtimeRecord {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.priority {
            0 => f.write_str("shared time")?,
            priority => write!(f, "FIFO {priority}")?,
        }
        for (privilege, name) in [(Privilege::MemoryLock, "locked"), (Privilege::Prefault, "prefaulted")] {
            if self.has(privilege) {
                write!(f, ", {name}")?;
            }
        }
        for (i, name) in self.refusals().enumerate() {
            write!(f, "{}{name}", if i == 0 { "; refused: " } else { ", " })?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_text_lists_what_was_granted_and_refused() {
        let mut record = RealtimeRecord::default();
        assert_eq!(record.to_string(), "shared time");
        record.priority = 40;
        record.grant(Privilege::Scheduling);
        record.grant(Privilege::MemoryLock);
        record.refuse(Privilege::Prefault);
        record.refuse(Privilege::Pinning);
        assert_eq!(record.to_string(), "FIFO 40, locked; refused: prefault, pinning");
        assert!(record.has(Privilege::MemoryLock) && !record.has(Privilege::Pinning));
    }
}
