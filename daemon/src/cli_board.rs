//! Words of the command line about the board, and about the command line itself.

use crate::cli::ConfigArgs;
use clap::Args;
use std::path::PathBuf;

pub const RESTORE_CLOCKS_HELP: &str = "Examples:
  lookout restore-clocks -c /etc/lookout/lookout.toml

The daemon puts clocks back by itself when it ends. This is for one that was killed; the service
runs it after every stop. Without anything to put back it does nothing and succeeds.";

pub const COMPLETIONS_HELP: &str = "Examples:
  lookout completions bash > /usr/share/bash-completion/completions/lookout
  lookout completions zsh > ~/.zfunc/_lookout
  lookout completions fish > ~/.config/fish/completions/lookout.fish";

#[derive(Args, Debug)]
pub struct RestoreClocks {
    #[command(flatten)]
    pub config: ConfigArgs,
}

#[derive(Args, Debug)]
pub struct Completions {
    /// The shell
    #[arg(value_enum)]
    pub shell: clap_complete::Shell,
}

#[derive(Args, Debug)]
pub struct Man {
    /// Folder that the pages are written to
    #[arg(value_name = "DIR")]
    pub folder: PathBuf,
}
