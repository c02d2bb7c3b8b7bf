//! `lookout run`.

use crate::command::config_args::ConfigArgs;
use crate::command::config_args::load;
use crate::command::config_args::read;
use crate::command::error::CommandError;
use crate::scheduler::{self, Ends, RunOptions};
use clap::Args;
use rustix::process::{Signal, set_parent_process_death_signal};

/// Text below the options of `--help`.
pub const HELP: &str = "Examples:
  lookout run -c /etc/lookout/car.toml
  lookout run -c tk1

Stop it with SIGTERM or Ctrl-C: frames in flight are finished first. SIGHUP reloads the
configuration. Which keys may change then, and what is reported to systemd, is described in
docs/operations.md.";

#[derive(Args, Debug)]
pub struct Run {
    #[command(flatten)]
    pub config: ConfigArgs,
    /// End when the parent process ends
    #[arg(long, hide = true)]
    pub with_parent: bool,
}

pub fn run(args: &Run, log: Option<&str>) -> Result<(), CommandError> {
    let config = load(&args.config, log, "scheduler", None)?;
    if args.with_parent {
        set_parent_process_death_signal(Some(Signal::TERM))
            .map_err(|e| CommandError::Other(format!("cannot set the parent-death signal: {e}")))?;
    }
    if config.source.kind == "scene" {
        tracing::warn!("source.kind is scene: the input is a synthetic scene, not a camera");
    }
    let options = RunOptions { lockstep: false, limit: None, out: None, record: None, ends: Ends::Never };
    let mut last = String::new();
    let mut reload = || read(&args.config, log, None).map_err(|error| error.to_string());
    let outcome = scheduler::run_service(&config, &options, &mut reload, &mut |status| {
        // Logs changes of state only.
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
