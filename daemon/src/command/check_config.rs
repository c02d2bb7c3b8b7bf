//! `lookout check-config`.

use crate::command::console::say;
use crate::command::error::CommandError;
use crate::stages::recognition::cascade::recogniser;
use crate::stages::stage::SetupError;
use clap::Args;
use std::fmt::Display;
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
    let at = |key: &str| config::place(args.file.as_deref(), key);
    let fail = |key: &str, error: &dyn Display| CommandError::Other(format!("{}{error}", at(key)));
    recogniser(&config, 8, 8).map_err(|error| fail("recognition.cascade", &error))?;
    crate::input::vehicle::decoder(&config).map_err(SetupError::from)?;
    crate::can_out::identifiers(&config)?;
    let source = &config.source;
    if !source.rig.as_os_str().is_empty() {
        sources::calibration_file::read(&source.rig, true)
            .map_err(|error| CommandError::Other(format!("{}source.rig: {error}", at("source.rig"))))?;
    }
    let needs_path =
        ["folder", "recording"].contains(&&source.kind[..]) && source.left.as_os_str().is_empty();
    if needs_path && !source.path.exists() {
        let path = source.path.display();
        let text = format!(
            "source.path = \"{path}\": there is no such file or folder: name the pictures or the recording"
        );
        return Err(fail("source.path", &text));
    }
    let text = toml::to_string(&config).map_err(|e| CommandError::Other(e.to_string()))?;
    say(format_args!("# The effective configuration. No errors.\n{text}"))
}
