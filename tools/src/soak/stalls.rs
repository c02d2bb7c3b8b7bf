//! Stalls of the machine itself, measured by probes at the stages' priority.
//!
//! A probe on each core wakes every 2 ms. A wake-up late by more than [`MIN_NS`] is a stall of that core from
//! the due time to the actual wake-up: nothing at this priority ran there on time, whatever the cause.

use crate::reporting::summary::Latency;
use std::collections::VecDeque;

/// Shorter delays are normal for the scheduler.
pub const MIN_NS: u64 = 1_000_000;

/// Maximum number of stalls per core kept for frames not yet evaluated.
const MAX_STALLS: usize = 8192;

/// Stalls of one core.
#[derive(Clone, Debug)]
struct Core {
    /// `None` for a probe that was not pinned.
    core: Option<u32>,
    recent: VecDeque<(u64, u64)>,
    lateness: Latency,
    stalls: u64,
    total_ns: u64,
    longest_ns: u64,
}

/// Statistics of one core.
#[derive(Clone, Debug, PartialEq)]
pub struct CoreFigures {
    /// Core number; `None` for a probe that was not pinned.
    pub core: Option<u32>,
    /// Number of wake-ups.
    pub wakes: u64,
    /// Number of wake-ups late by more than [`MIN_NS`].
    pub stalls: u64,
    /// Total duration of the stalls.
    pub total_ns: u64,
    /// Duration of the longest stall.
    pub longest_ns: u64,
    /// 99.9th percentile of the wake-up latency, in milliseconds.
    pub p999_ms: f64,
}

/// Stalls of all cores.
#[derive(Clone, Debug, Default)]
pub struct Stalls {
    cores: Vec<Core>,
}

impl Stalls {
    /// Adds a wake-up: its due and its actual time, on the monotonic clock.
    pub fn add(&mut self, core: Option<u32>, due_ns: u64, woke_ns: u64) {
        let late_ns = woke_ns.saturating_sub(due_ns);
        let place = self.cores.iter().position(|c| c.core == core).unwrap_or_else(|| {
            self.cores.push(Core {
                core,
                recent: VecDeque::with_capacity(64),
                lateness: Latency::new(),
                stalls: 0,
                total_ns: 0,
                longest_ns: 0,
            });
            self.cores.len() - 1
        });
        let core = &mut self.cores[place];
        core.lateness.add_ns(late_ns);
        if late_ns > MIN_NS {
            core.stalls += 1;
            core.total_ns += late_ns;
            core.longest_ns = core.longest_ns.max(late_ns);
            if core.recent.len() >= MAX_STALLS {
                core.recent.pop_front();
            }
            core.recent.push_back((due_ns, woke_ns));
        }
    }

    /// Drops stalls that ended before a time; the statistics remain.
    pub fn forget_before(&mut self, ns: u64) {
        for core in &mut self.cores {
            while core.recent.front().is_some_and(|&(_, end)| end < ns) {
                core.recent.pop_front();
            }
        }
    }

    /// Time a core was stalled between two times; 0 for a core without a probe.
    pub fn overlap_ns(&self, core: Option<u32>, from_ns: u64, to_ns: u64) -> u64 {
        let Some(core) = self.cores.iter().find(|c| c.core == core) else { return 0 };
        let overlap = |&(begin, end): &(u64, u64)| end.min(to_ns).saturating_sub(begin.max(from_ns));
        // The newest stalls are last, and those of one core do not overlap.
        core.recent.iter().rev().take_while(|&&(_, end)| end > from_ns).map(overlap).sum()
    }

    /// Statistics by core.
    pub fn figures(&self) -> Vec<CoreFigures> {
        let figures = |c: &Core| CoreFigures {
            core: c.core,
            wakes: c.lateness.count(),
            stalls: c.stalls,
            total_ns: c.total_ns,
            longest_ns: c.longest_ns,
            p999_ms: c.lateness.percentile_ms(99.9),
        };
        let mut all: Vec<CoreFigures> = self.cores.iter().map(figures).collect();
        all.sort_by_key(|c| c.core);
        all
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: u64 = 1_000_000;

    #[test]
    fn stalls_are_told_from_ordinary_delays_and_overlap_is_exact() {
        let mut stalls = Stalls::default();
        stalls.add(Some(1), 10 * MS, 10 * MS + MS / 2);
        stalls.add(Some(1), 20 * MS, 30 * MS);
        stalls.add(Some(1), 40 * MS, 45 * MS);
        stalls.add(Some(0), 20 * MS, 60 * MS);
        assert_eq!(stalls.overlap_ns(Some(1), 0, 100 * MS), 15 * MS);
        assert_eq!(stalls.overlap_ns(Some(1), 25 * MS, 42 * MS), 7 * MS);
        assert_eq!(stalls.overlap_ns(Some(1), 31 * MS, 39 * MS), 0);
        assert_eq!(stalls.overlap_ns(Some(7), 0, 100 * MS), 0, "no probe, no excuse");
        let figures = stalls.figures();
        assert_eq!((figures[1].core, figures[1].stalls, figures[1].wakes), (Some(1), 2, 3));
        assert_eq!((figures[1].total_ns, figures[1].longest_ns), (15 * MS, 10 * MS));
        stalls.forget_before(50 * MS);
        assert_eq!(stalls.overlap_ns(Some(1), 0, 100 * MS), 0);
        assert_eq!(stalls.overlap_ns(Some(0), 0, 100 * MS), 40 * MS);
        assert_eq!(stalls.figures()[1].total_ns, 15 * MS, "figures stay");
    }

    #[test]
    fn memory_is_bounded() {
        let mut stalls = Stalls::default();
        for i in 0..100_000 {
            stalls.add(None, i * 10 * MS, i * 10 * MS + 2 * MS);
        }
        assert_eq!(stalls.cores[0].recent.len(), MAX_STALLS);
        assert_eq!(stalls.figures()[0].stalls, 100_000);
    }
}
