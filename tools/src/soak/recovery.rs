//! What came of the faults.

use super::fault::{Fault, FaultKind};
use super::trend::Trend;
use crate::reporting::summary::Latency;
use serde::Serialize;
use std::collections::BTreeMap;

/// The longest waits that are told one by one.
const WORST: usize = 10;

/// Faults of one kind to one stage.
#[derive(Clone, Debug, Default)]
struct Entry {
    count: u64,
    failed: u64,
    waits: Latency,
}

/// One recovery.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Recovery {
    /// What was done.
    pub fault: String,
    /// When, in seconds from the start of the run.
    pub at_s: f64,
    /// Time to the next result.
    pub next_result_s: f64,
}

/// Faults of one kind to one stage, summed up.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct FaultRow {
    /// What was done.
    pub kind: FaultKind,
    /// To which stage.
    pub stage: &'static str,
    /// How often.
    pub count: u64,
    /// How often no result came within the patience of the soak.
    pub failed: u64,
    /// Time to the next result: median.
    pub next_result_s_p50: f64,
    /// The longest.
    pub next_result_s_max: f64,
}

/// All recoveries of a run.
#[derive(Clone, Debug)]
pub struct Recoveries {
    /// By kind and number of the stage.
    entries: BTreeMap<(FaultKind, usize), (&'static str, Entry)>,
    worst: Vec<Recovery>,
    /// Time to the next result over the run, in seconds.
    pub trend: Trend,
}

impl Default for Recoveries {
    fn default() -> Self {
        Self { entries: BTreeMap::new(), worst: Vec::new(), trend: Trend::new(0.1) }
    }
}

impl Recoveries {
    fn entry(&mut self, fault: &Fault) -> &mut Entry {
        let entry = || (fault.place(), Entry::default());
        &mut self.entries.entry((fault.kind, fault.stage)).or_insert_with(entry).1
    }

    /// A fault was made.
    pub fn made(&mut self, fault: &Fault) {
        self.entry(fault).count += 1;
    }

    /// No result came in time.
    pub fn failed(&mut self, fault: &Fault) {
        self.entry(fault).failed += 1;
    }

    /// Results flow again.
    pub fn recovered(&mut self, fault: &Fault, at_s: f64, wait_ns: u64) {
        self.entry(fault).waits.add_ns(wait_ns);
        let next_result_s = wait_ns as f64 * 1e-9;
        self.trend.add(at_s, next_result_s);
        self.worst.push(Recovery { fault: fault.to_string(), at_s, next_result_s });
        self.worst.sort_by(|a, b| b.next_result_s.total_cmp(&a.next_result_s));
        self.worst.truncate(WORST);
    }

    /// Faults that were made.
    pub fn count(&self) -> u64 {
        self.entries.values().map(|(_, e)| e.count).sum()
    }

    /// SIGKILLs that were sent.
    pub fn kills(&self) -> u64 {
        let kills = self.entries.iter().filter(|((kind, _), _)| *kind == FaultKind::Kill);
        kills.map(|(_, (_, e))| e.count).sum()
    }

    /// Faults after which no result came in time.
    pub fn failures(&self) -> u64 {
        self.entries.values().map(|(_, e)| e.failed).sum()
    }

    /// Restarts that the faults so far call for.
    pub fn expected_restarts(&self) -> u64 {
        let restarts = self.entries.iter().filter(|((kind, _), _)| kind.restarts());
        restarts.map(|(_, (_, e))| e.count).sum()
    }

    /// The longest time to the next result, in seconds; 0 without faults.
    pub fn longest_s(&self) -> f64 {
        self.worst.first().map_or(0.0, |w| w.next_result_s)
    }

    /// The longest waits, longest first.
    pub fn worst(&self) -> &[Recovery] {
        &self.worst
    }

    /// The kinds that were made, by stage.
    pub fn rows(&self) -> Vec<FaultRow> {
        let row = |((kind, _), (place, e)): (&(FaultKind, usize), &(&'static str, Entry))| FaultRow {
            kind: *kind,
            stage: place,
            count: e.count,
            failed: e.failed,
            next_result_s_p50: e.waits.percentile_ms(50.0) * 1e-3,
            next_result_s_max: e.waits.percentile_ms(100.0) * 1e-3,
        };
        self.entries.iter().filter(|(_, (_, e))| e.count > 0).map(row).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn recoveries_are_summed_up_by_kind_and_stage() {
        let mut all = Recoveries::default();
        let names = ["capture", "stereo", "road", "recognition"];
        let fault = |kind, stage: usize| Fault { kind, stage, stage_name: names[stage], stall_ns: 1 };
        assert_eq!((all.longest_s(), all.rows().len()), (0.0, 0));
        for i in 1..=30 {
            let fault = fault(FaultKind::Kill, 1);
            all.made(&fault);
            all.recovered(&fault, i as f64, i * 100_000_000);
        }
        for (kind, stage) in [(FaultKind::Stall, 0), (FaultKind::Hang, 3)] {
            all.made(&fault(kind, stage));
        }
        all.failed(&fault(FaultKind::Hang, 3));
        assert_eq!((all.count(), all.kills(), all.failures(), all.expected_restarts()), (32, 30, 1, 31));
        assert_eq!(all.longest_s(), 3.0);
        assert_eq!(all.worst().len(), WORST);
        let rows = all.rows();
        assert_eq!(
            rows.iter().map(|r| (r.kind, r.stage, r.count, r.failed)).collect::<Vec<_>>(),
            [
                (FaultKind::Kill, "stereo", 30, 0),
                (FaultKind::Hang, "recognition", 1, 1),
                (FaultKind::Stall, "capture", 1, 0),
            ]
        );
        assert!(
            (rows[0].next_result_s_p50 - 1.5).abs() < 0.01 && (rows[0].next_result_s_max - 3.0).abs() < 0.01
        );
    }
}
