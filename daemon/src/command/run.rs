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

Stop it with SIGTERM or Ctrl-C: frames in flight come out first. SIGHUP reads the configuration
again; what may change then, and what it tells systemd, is in docs/operations.md.";

#[derive(Args, Debug)]
pub struct Run {
    #[command(flatten)]
    pub config: ConfigArgs,
    /// Ends when the process that started it does
    #[arg(long, hide = true)]
    pub with_parent: bool,
}

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
