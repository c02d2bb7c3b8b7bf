//! `lookout check-config`.

use crate::command::console::say;
use crate::command::error::CommandError;
use crate::stages::recognition::cascade::recogniser;
use crate::stages::stage::SetupError;
use clap::Args;
use std::path::PathBuf;

/// Text below the options of `--help`.
pub const HELP: &str = "Examples:
  lookout check-config car.toml
  lookout check-config rpi5
  lookout check-config --reference > docs/configuration.md";

#[derive(Args, Debug)]
pub struct CheckConfig {
    /// Configuration file or profile
    #[arg(required_unless_present = "reference")]
    pub file: Option<PathBuf>,
    /// Print the reference of all keys instead
    #[arg(long, conflicts_with = "file")]
    pub reference: bool,
}

pub fn run(args: &CheckConfig) -> Result<(), CommandError> {
    if args.reference {
        return say(config::reference().trim_end());
    }
    let config = config::load(args.file.as_deref())?;
    // Files that the configuration names have to exist and be valid, too.
    recogniser(&config, 8, 8).map_err(SetupError::from)?;
    crate::input::vehicle::decoder(&config).map_err(SetupError::from)?;
    crate::can_out::identifiers(&config)?;
    if !config.source.rig.as_os_str().is_empty() {
        sources::calibration_file::read(&config.source.rig, true)?;
    }
    let text = toml::to_string(&config).map_err(|e| CommandError::Other(e.to_string()))?;
    say(format_args!("# The effective configuration. No errors.\n{text}"))
}
