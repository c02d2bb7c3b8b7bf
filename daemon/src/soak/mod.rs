//! `lookout soak`: runs the daemon as a child process, injects faults and measures it from outside.
//!
//! Processes, clocks and signals are here; statistics, budgets and the report are in `tools::soak`.

mod child;
pub mod error;
mod figures;
pub mod hot_board;
mod observer;
pub mod pairs;
pub mod plan;
pub mod power;
mod probe;
mod processes;

use child::DaemonChild;
use config::Config;
pub use error::SoakError;
pub use figures::processor;
use observer::{Ended, Observer};
pub use plan::{Plan, Progress, Soaked};
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

/// Runs the daemon with a configuration and measures it; `progress` is called periodically.
///
/// # Errors
/// If the run failed before there was anything to report. Later failures are in the report.
pub fn run(
    config: &Config,
    plan: &Plan,
    stop: &Arc<AtomicBool>,
    progress: &mut dyn FnMut(&Progress),
) -> Result<Soaked, SoakError> {
    std::fs::create_dir_all(&plan.out).map_err(SoakError::io(&plan.out))?;
    let entries_before = messages::run_files::files_of_all_runs().len() as u64;
    let mut daemon = DaemonChild::start(config, &plan.out)?;
    let (bus, prefix) = daemon.join(stop)?;
    let mut observer = Observer::new(config, plan, &daemon);
    let ended = observer.watch(&bus, &mut daemon, stop, progress)?;
    // Disconnect before the daemon removes its shared memory.
    drop(bus);
    observer.stop_probes();
    let folder = daemon.instance.directory().to_owned();
    let mut reasons = match ended {
        Ended::InTime => Vec::new(),
        Ended::Because(reason) => vec![reason],
    };
    match daemon.stop() {
        Ok(status) if status.success() => {}
        Ok(status) => reasons.push(format!("the daemon ended with {status} after SIGTERM")),
        Err(error) => reasons.push(error.to_string()),
    }
    let left = prefix.files().len() + entries_below(&folder);
    Ok(observer.conclude(plan, config, entries_before, left as u64, reasons))
}

/// Number of files and folders that an instance has left behind, including its own folder.
fn entries_below(folder: &Path) -> usize {
    let Ok(entries) = std::fs::read_dir(folder) else { return 0 };
    1 + entries.flatten().map(|e| if e.path().is_dir() { entries_below(&e.path()) } else { 1 }).sum::<usize>()
}
