//! What a soak is to do, how far it is, and what came of it.

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::time::Duration;
use tools::reporting::svg::Plot;
use tools::soak::budget::Kind;
use tools::soak::director::DirectorParameters;
use tools::soak::paper::RateRun;
use tools::soak::report::{Setting, SoakReport};

/// What is asked of one run.
#[derive(Clone, Debug)]
pub struct Plan {
    /// Steady, with faults, or overload.
    pub kind: Kind,
    /// How long it is measured; `None` = until the kills are made.
    pub time: Option<Duration>,
    /// How faults are made.
    pub faults: Option<DirectorParameters>,
    /// What the soak has set in the configuration.
    pub settings: Vec<Setting>,
    /// What the pairs are, in words.
    pub source: String,
    /// Where configuration, log and report go.
    pub out: PathBuf,
}

/// What a run has brought so far.
#[derive(Clone, Debug)]
pub struct Progress {
    /// Seconds since the warm-up; below zero during it.
    pub measured_s: f64,
    /// Seconds that it will take; `None` when the kills decide.
    pub planned_s: Option<f64>,
    /// Results.
    pub frames: u64,
    /// Frames overtaken.
    pub dropped: u64,
    /// Medians and 99th percentiles of the latency.
    pub latency_ms: [f64; 2],
    /// Resident memory of all.
    pub memory_bytes: u64,
    /// Faults, and those that failed.
    pub faults: [u64; 2],
    /// The longest time to the next result.
    pub next_result_s: f64,
}

/// What came of a run.
#[derive(Debug)]
pub struct Soaked {
    /// The report.
    pub report: SoakReport,
    /// Its plots, each with the name of its file and what it shows.
    pub plots: Vec<(String, String, Plot)>,
    /// Its row in the paper's tables.
    pub rate: RateRun,
    /// The device that matched, in words; empty for the CPU.
    pub device: String,
    /// The device's own time for a pair, median in ms; `None` where it tells none.
    pub device_p50_ms: Option<f64>,
    /// The least and the greatest reading of each clock that the daemon has set, in MHz.
    pub clocks_mhz: BTreeMap<String, [f64; 2]>,
}
