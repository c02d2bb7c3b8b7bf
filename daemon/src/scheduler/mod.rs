//! The scheduler: starts, paces, supervises and stops the stages, and collects their reports.

pub mod board;
pub mod children;
pub mod clocks;
pub mod collector;
pub mod cores;
pub mod credit;
pub mod deadline_monitor;
pub mod diagnostics;
mod figures;
pub mod heat;
mod notify;
mod options;
pub mod pacer;
mod reload;
mod run;
pub mod supervisor;
pub mod sysfs;
mod systemd;

use config::Config;
use messages::clock::monotonic_ns;
use messages::service;
use messages::status::StatusRecord;
use messages::wait;
pub use options::{Ends, RunError, RunOptions, RunOutcome};
use run::{Process, Run};
use std::time::Duration;

/// How long a service waits before it starts anew, so that a program that removes its files again and again does not
/// keep a core busy.
const ANEW_DELAY: Duration = Duration::from_secs(1);

/// Runs the daemon until it ends. `watch` is called with every status.
///
/// # Errors
/// If it cannot start. Later failures are in the outcome.
pub fn run(
    config: &Config,
    options: &RunOptions,
    watch: &mut dyn FnMut(&StatusRecord),
) -> Result<RunOutcome, RunError> {
    run_service(config, options, &mut || Err("this run does not reload its configuration".into()), watch)
}

/// As [`run()`]. With [`Ends::Never`], SIGHUP applies the configuration that `reload` reads.
///
/// # Errors
/// If it cannot start. Later failures are in the outcome.
pub fn run_service(
    config: &Config,
    options: &RunOptions,
    reload: &mut dyn FnMut() -> Result<Config, String>,
    watch: &mut dyn FnMut(&StatusRecord),
) -> Result<RunOutcome, RunError> {
    let mut process = Process::new();
    let mut run = Run::start(config, options, &mut process)?;
    loop {
        let reports = run.bus.subscriber(&service::REPORT)?;
        let results = run.bus.subscriber(&service::OBSTACLES)?;
        let ended = wait::run(&[&reports, &results], || {
            if run.takes_reload() {
                run.reload(&mut *reload, monotonic_ns());
            }
            run.step(&reports, &results, watch)
        });
        drop((reports, results));
        if let (Ends::Never, Some(path)) = (options.ends, run.look_for_loss()) {
            // An error of shared memory may be a consequence.
            tracing::error!(path = %path.display(), "another program has removed a file of this run: starting anew");
            let config = run.abandon();
            std::thread::sleep(ANEW_DELAY);
            run = Run::start(&config, options, &mut process)?;
            continue;
        }
        ended?;
        return Ok(run.finish());
    }
}
