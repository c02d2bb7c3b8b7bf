//! `lookout soak`: the daemon as a child process, watched from outside while it is broken on purpose.
//!
//! What is concluded from it is `tools::soak`; here are the processes, the clocks and the signals.

mod child;
mod figures;
pub mod hot_board;
mod observer;
pub mod pairs;
mod probe;
mod processes;

use child::DaemonChild;
use config::Config;
pub use figures::processor;
use messages::bus::IpcError;
use observer::{Ended, Observer};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::ExitStatus;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::time::Duration;
use thiserror::Error;
use tools::reporting::svg::Plot;
use tools::soak::budget::Kind;
use tools::soak::director::DirectorParameters;
use tools::soak::paper::RateRun;
use tools::soak::report::{Setting, SoakReport};

/// Why there is no report.
#[derive(Debug, Error)]
pub enum SoakError {
    /// The configuration of the daemon cannot be written.
    #[error("the configuration of the daemon cannot be written: {0}")]
    Config(String),
    /// A file or process.
    #[error("{}: {source}", path.display())]
    Io {
        /// Which.
        path: PathBuf,
        /// Why it failed.
        source: std::io::Error,
    },
    /// Shared memory.
    #[error(transparent)]
    Ipc(#[from] IpcError),
    /// The daemon has ended by itself.
    #[error("the daemon has ended by itself ({0}); {1}")]
    Ended(ExitStatus, String),
    /// The daemon does not open its shared memory, or no result comes.
    #[error("the daemon brings nothing; {0}")]
    Silent(String),
    /// The daemon does not stop.
    #[error("the daemon did not stop within {0:?} of SIGTERM and was killed")]
    Endless(Duration),
    /// A signal came before there was anything to report.
    #[error("stopped by a signal before the first result")]
    Stopped,
}

impl SoakError {
    fn io(path: &Path) -> impl FnOnce(std::io::Error) -> Self {
        let path = path.to_owned();
        move |source| Self::Io { path, source }
    }
}

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

/// Soaks the daemon with a configuration; `progress` is told now and then how far it is.
///
/// # Errors
/// When there is nothing to report on. What failed later is in the report.
pub fn run(
    config: &Config,
    plan: &Plan,
    stop: &Arc<AtomicBool>,
    progress: &mut dyn FnMut(&Progress),
) -> Result<Soaked, SoakError> {
    std::fs::create_dir_all(&plan.out).map_err(SoakError::io(&plan.out))?;
    let entries_before = messages::instance::shared_entries("lookout.").len() as u64;
    let mut daemon = DaemonChild::start(config, &plan.out)?;
    let (bus, prefix) = daemon.join(stop)?;
    let mut observer = Observer::new(config, plan, &daemon);
    let ended = observer.watch(&bus, &mut daemon, stop, progress)?;
    // Before the daemon removes what they live in.
    drop(bus);
    observer.stopped_probes();
    let folder = daemon.instance.directory().to_owned();
    let mut reasons = match ended {
        Ended::InTime => Vec::new(),
        Ended::Because(reason) => vec![reason],
    };
    match daemon.stop() {
        Ok(status) if status.success() => {}
        Ok(status) => reasons.push(format!("the daemon ended with {status} when it was asked to stop")),
        Err(error) => reasons.push(error.to_string()),
    }
    let left = messages::instance::shared_entries(&prefix).len() + entries_below(&folder);
    Ok(observer.conclude(plan, config, entries_before, left as u64, reasons))
}

/// Files and folders that an instance has left.
fn entries_below(folder: &Path) -> usize {
    let Ok(entries) = std::fs::read_dir(folder) else { return 0 };
    1 + entries.flatten().map(|e| if e.path().is_dir() { entries_below(&e.path()) } else { 1 }).sum::<usize>()
}

/// Roles of the stages, as `tools::soak` numbers them.
fn stage_index(role: messages::pipeline::Role) -> Option<usize> {
    messages::pipeline::Role::STAGES.iter().position(|&stage| stage == role)
}
