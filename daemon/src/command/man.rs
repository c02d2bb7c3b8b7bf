//! `lookout man`: manual pages, one for each subcommand that is not hidden.

use crate::command::error::CommandError;
use clap::Args;
use std::path::PathBuf;

/// Text below the options of `--help`.
pub const HELP: &str = "Examples:
  lookout man man1                             writes lookout.1 and a page for each subcommand
  man ./man1/lookout-replay.1
  lookout man ~/.local/share/man/man1          then: man lookout-replay";

#[derive(Args, Debug)]
pub struct Man {
    /// Output folder
    #[arg(value_name = "DIR")]
    pub folder: PathBuf,
}

pub fn run(args: &Man, command_line: clap::Command) -> Result<(), CommandError> {
    let wrong = |error| CommandError::Other(format!("{}: {error}", args.folder.display()));
    std::fs::create_dir_all(&args.folder).map_err(wrong)?;
    clap_mangen::generate_to(command_line, &args.folder).map_err(wrong)
}
