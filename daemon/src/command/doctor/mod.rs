//! `lookout doctor`: what this machine has and lacks for the daemon, and what to do about it.

mod board;
mod cameras;
mod configuration;
mod finding;
mod processor;
mod rights;

use crate::command::config_args::{ConfigArgs, load};
use crate::command::console::say;
use crate::command::error::CommandError;
use clap::Args;
use finding::{Finding, Level};
use serde::Serialize;
use std::path::Path;

/// Text below the options of `--help`.
pub const HELP: &str = "Examples:
  lookout doctor
  lookout doctor -c /etc/lookout/lookout.toml     also the files and cameras that it names
  sudo -u lookout lookout doctor                  as the service's user, with its permissions
  lookout doctor --json | jq '.findings[] | select(.level == \"problem\")'

good: as it should be. note: works, but something is missing that some uses need. problem: the daemon, or
the configuration, cannot work so. Every note and problem says what to do. Nothing is changed.

Exit code: 1 if there is a problem.";

#[derive(Args, Debug)]
pub struct Doctor {
    #[command(flatten)]
    pub config: ConfigArgs,
    /// Print as JSON
    #[arg(long)]
    pub json: bool,
}

#[derive(Serialize)]
struct Report {
    version: &'static str,
    findings: Vec<Finding>,
    problems: usize,
    notes: usize,
}

pub fn run(args: &Doctor, log: Option<&str>) -> Result<(), CommandError> {
    let config = load(&args.config, log, "doctor", Some("error"))?;
    let root = Path::new("/");
    let findings: Vec<Finding> = [
        processor::findings(root),
        cameras::findings(root, &config),
        configuration::findings(&config),
        board::findings(root, &config),
        rights::findings(root, &config),
    ]
    .concat();
    let count = |level: Level| findings.iter().filter(|finding| finding.level == level).count();
    let (problems, notes) = (count(Level::Problem), count(Level::Note));
    if args.json {
        let report = Report { version: env!("CARGO_PKG_VERSION"), findings, problems, notes };
        say(serde_json::to_string_pretty(&report)?)?;
    } else {
        for finding in &findings {
            say(finding)?;
        }
        say(format_args!("{problems} problems, {notes} notes"))?;
    }
    match problems {
        0 => Ok(()),
        _ => Err(CommandError::Other(format!(
            "{problems} problems: the lines with \"problem\" say what to do"
        ))),
    }
}
