//! Plan, progress and result of a soak.

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::time::Duration;
use tools::reporting::svg::Plot;
use tools::soak::budget::Kind;
use tools::soak::director::DirectorParameters;
use tools::soak::paper::RateRun;
use tools::soak::report::{Setting, SoakReport};

/// Parameters of one run.
#[derive(Clone, Debug)]
pub struct Plan {
    /// Steady, with faults, or overload.
    pub kind: Kind,
    /// Time to measure; `None` = until all kills are done.
    pub time: Option<Duration>,
    /// Faults to inject.
    pub faults: Option<DirectorParameters>,
    /// Settings that the soak changed in the configuration.
    pub settings: Vec<Setting>,
    /// Description of the source.
    pub source: String,
    /// Folder for configuration, log and report.
    pub out: PathBuf,
}

/// State of a run.
#[derive(Clone, Debug)]
pub struct Progress {
    /// Seconds since the end of the warm-up; negative during it.
    pub measured_s: f64,
    /// Planned seconds; `None` if the number of kills decides.
    pub planned_s: Option<f64>,
    /// Frames with results.
    pub frames: u64,
    /// Dropped frames.
    pub dropped: u64,
    /// Median and 99th percentile of the latency.
    pub latency_ms: [f64; 2],
    /// Resident memory of all processes.
    pub memory_bytes: u64,
    /// Number of faults, and of failed recoveries.
    pub faults: [u64; 2],
    /// Longest time from a fault to the next result.
    pub next_result_s: f64,
}

/// Result of a run.
#[derive(Debug)]
pub struct Soaked {
    /// The report.
    pub report: SoakReport,
    /// Plots: file name, title, plot.
    pub plots: Vec<(String, String, Plot)>,
    /// Row in the paper's tables.
    pub rate: RateRun,
    /// Description of the device that matched; empty for the CPU.
    pub device: String,
    /// Median time per pair from the device's timestamps, in ms; `None` without timestamps.
    pub device_p50_ms: Option<f64>,
    /// Minimum and maximum reading of each clock that the daemon has set, in MHz.
    pub clocks_mhz: BTreeMap<String, [f64; 2]>,
}
