//! `lookout completions`: completion scripts for shells.

use crate::command::error::CommandError;
use clap::Args;
use std::io::Write;

pub const HELP: &str = "Examples:
  lookout completions bash > /usr/share/bash-completion/completions/lookout
  lookout completions zsh > ~/.zfunc/_lookout
  lookout completions fish > ~/.config/fish/completions/lookout.fish";

#[derive(Args, Debug)]
pub struct Completions {
    /// The shell
    #[arg(value_enum)]
    pub shell: clap_complete::Shell,
}

pub fn run(args: &Completions, mut command_line: clap::Command) -> Result<(), CommandError> {
    let mut text = Vec::new();
    clap_complete::generate(args.shell, &mut command_line, "lookout", &mut text);
    match std::io::stdout().lock().write_all(&text) {
        Err(error) if error.kind() != std::io::ErrorKind::BrokenPipe => {
            Err(CommandError::Other(format!("standard output: {error}")))
        }
        _ => Ok(()),
    }
}
