//! `lookout man`: manual pages, one for each subcommand that is not hidden.

use crate::command::error::CommandError;
use clap::Args;
use std::path::PathBuf;

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
