//! What a process got of what real time needs: part of `report` and `status`.

use bytemuck::{Pod, Zeroable};
use std::fmt;

/// Something that the system may refuse.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u32)]
pub enum Privilege {
    /// A real-time priority.
    Scheduling = 1,
    /// Memory that is never paged out.
    MemoryLock = 2,
    /// Memory that is there before it is used.
    Prefault = 4,
    /// A core of its own choice.
    Pinning = 8,
}

impl Privilege {
    /// All of them.
    pub const ALL: [Self; 4] = [Self::Scheduling, Self::MemoryLock, Self::Prefault, Self::Pinning];

    /// The key of the configuration that asks for it.
    pub fn name(self) -> &'static str {
        match self {
            Self::Scheduling => "scheduling",
            Self::MemoryLock => "memory_lock",
            Self::Prefault => "prefault",
            Self::Pinning => "pinning",
        }
    }
}

/// What a process got, as it reads it back.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
pub struct RealtimeRecord {
    /// SCHED_FIFO priority; 0 = the usual time-sharing.
    pub priority: u32,
    /// [`Privilege`]s that it has, each a bit.
    pub granted: u32,
    /// Those that were preferred and refused.
    pub refused: u32,
    /// Padding; 0.
    pub reserved: u32,
    /// Lines of its log that were dropped because nobody read them fast enough.
    pub log_dropped: u64,
}

impl RealtimeRecord {
    /// Notes that something was granted.
    pub fn grant(&mut self, privilege: Privilege) {
        self.granted |= privilege as u32;
    }

    /// Notes that something was refused.
    pub fn refuse(&mut self, privilege: Privilege) {
        self.refused |= privilege as u32;
    }

    /// Whether it was granted.
    pub fn has(&self, privilege: Privilege) -> bool {
        self.granted & privilege as u32 != 0
    }

    /// Names of what was preferred and refused.
    pub fn refusals(&self) -> impl Iterator<Item = &'static str> {
        let refused = self.refused;
        Privilege::ALL.into_iter().filter(move |p| refused & *p as u32 != 0).map(Privilege::name)
    }
}

/// As in "FIFO 40, locked; refused: pinning".
impl fmt::Display for RealtimeRecord {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.priority {
            0 => f.write_str("shared time")?,
            priority => write!(f, "FIFO {priority}")?,
        }
        for (privilege, word) in [(Privilege::MemoryLock, "locked"), (Privilege::Prefault, "prefaulted")] {
            if self.has(privilege) {
                write!(f, ", {word}")?;
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
    fn it_is_told_in_words() {
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
