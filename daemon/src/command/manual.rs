//! `lookout completions` and `lookout man`: the command line for shells and for man(1).

use super::CommandError;
use crate::cli::Cli;
use crate::cli_board::{Completions, Man};
use clap::CommandFactory;
use std::io::Write;

pub fn completions(args: &Completions) -> Result<(), CommandError> {
    let mut text = Vec::new();
    clap_complete::generate(args.shell, &mut Cli::command(), "lookout", &mut text);
    match std::io::stdout().lock().write_all(&text) {
        Err(error) if error.kind() != std::io::ErrorKind::BrokenPipe => {
            Err(CommandError::Other(format!("standard output: {error}")))
        }
        _ => Ok(()),
    }
}

/// A page for each word that is not hidden.
pub fn pages(args: &Man) -> Result<(), CommandError> {
    let wrong = |error| CommandError::Other(format!("{}: {error}", args.folder.display()));
    std::fs::create_dir_all(&args.folder).map_err(wrong)?;
    clap_mangen::generate_to(Cli::command(), &args.folder).map_err(wrong)
}
