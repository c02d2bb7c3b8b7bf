//! Statistics of recoveries from faults.

use super::fault::{Fault, FaultKind};
use super::trend::Trend;
use crate::reporting::summary::Latency;
use serde::Serialize;
use std::collections::BTreeMap;

/// Number of longest recoveries listed individually.
const MAX_WORST: usize = 10;

/// Faults of one kind in one stage.
#[derive(Clone, Debug, Default)]
struct Entry {
    count: u64,
    failed: u64,
    waits: Latency,
}

/// A recovery.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Recovery {
    /// Description of the fault.
    pub fault: String,
    /// Time of the fault, in seconds from the start of the run.
    pub at_s: f64,
    /// Time to the next result, in seconds.
    pub next_result_s: f64,
}

/// Summary of the faults of one kind in one stage.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct FaultRow {
    /// Kind of the fault.
    pub kind: FaultKind,
    /// Affected stage.
    pub stage: &'static str,
    /// Number of faults.
    pub count: u64,
    /// Number of faults without a result within the time limit.
    pub failed: u64,
    /// Median time to the next result.
    pub next_result_s_p50: f64,
    /// Maximum time to the next result.
    pub next_result_s_max: f64,
}

/// Recovery statistics of a run.
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

    /// A fault was injected.
    pub fn made(&mut self, fault: &Fault) {
        self.entry(fault).count += 1;
    }

    /// No result arrived within the time limit.
    pub fn failed(&mut self, fault: &Fault) {
        self.entry(fault).failed += 1;
    }

    /// The first result after the fault arrived.
    pub fn recovered(&mut self, fault: &Fault, at_s: f64, wait_ns: u64) {
        self.entry(fault).waits.add_ns(wait_ns);
        let next_result_s = wait_ns as f64 * 1e-9;
        self.trend.add(at_s, next_result_s);
        self.worst.push(Recovery { fault: fault.to_string(), at_s, next_result_s });
        self.worst.sort_by(|a, b| b.next_result_s.total_cmp(&a.next_result_s));
        self.worst.truncate(MAX_WORST);
    }

    /// Number of injected faults.
    pub fn count(&self) -> u64 {
        self.entries.values().map(|(_, e)| e.count).sum()
    }

    /// Number of SIGKILLs sent.
    pub fn kills(&self) -> u64 {
        let kills = self.entries.iter().filter(|((kind, _), _)| *kind == FaultKind::Kill);
        kills.map(|(_, (_, e))| e.count).sum()
    }

    /// Number of faults without a result within the time limit.
    pub fn failures(&self) -> u64 {
        self.entries.values().map(|(_, e)| e.failed).sum()
    }

    /// Number of restarts that the faults require.
    pub fn expected_restarts(&self) -> u64 {
        let restarts = self.entries.iter().filter(|((kind, _), _)| kind.restarts());
        restarts.map(|(_, (_, e))| e.count).sum()
    }

    /// The longest time to the next result, in seconds; 0 without faults.
    pub fn longest_s(&self) -> f64 {
        self.worst.first().map_or(0.0, |w| w.next_result_s)
    }

    /// The longest recoveries, longest first.
    pub fn worst(&self) -> &[Recovery] {
        &self.worst
    }

    /// Summary by kind and stage.
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
        assert_eq!(all.worst().len(), MAX_WORST);
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
