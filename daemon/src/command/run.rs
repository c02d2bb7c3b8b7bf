//! `lookout run`.

use super::{CommandError, load, read};
use crate::cli::Run;
use crate::scheduler::{self, Ends, RunOptions};
use rustix::process::{Signal, set_parent_process_death_signal};

pub fn run(args: &Run, log: Option<&str>) -> Result<(), CommandError> {
    let config = load(&args.config, log, "scheduler", None)?;
    if args.with_parent {
        set_parent_process_death_signal(Some(Signal::TERM))
            .map_err(|e| CommandError::Other(format!("asking to end with the parent: {e}")))?;
    }
    if config.source.kind == "scene" {
        tracing::warn!("source.kind is scene: this watches the built-in synthetic street, not a camera");
    }
    let options = RunOptions { lockstep: false, limit: None, out: None, record: None, ends: Ends::Never };
    let mut last = String::new();
    let mut reload = || read(&args.config, log, None).map_err(|error| error.to_string());
    let outcome = scheduler::run_service(&config, &options, &mut reload, &mut |status| {
        // Each change of state is said once.
        let state = format!("{} {}", status.state_name(), status.reason());
        if state != last {
            tracing::info!(state = status.state_name(), reason = status.reason(), "state");
            last = state;
        }
    })?;
    match outcome.failure {
        Some(failure) => Err(CommandError::Other(failure)),
        None => Ok(()),
    }
}
