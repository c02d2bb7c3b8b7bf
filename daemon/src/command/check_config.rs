//! `lookout check-config`.

use super::{CommandError, say};
use crate::cli::CheckConfig;
use crate::stages::recognition::cascade::recogniser;
use crate::stages::stage::SetupError;

pub fn run(args: &CheckConfig) -> Result<(), CommandError> {
    if args.reference {
        return say(config::reference().trim_end());
    }
    let config = config::load(args.file.as_deref())?;
    // What the configuration names must be there and sound, too.
    recogniser(&config, 8, 8).map_err(SetupError::from)?;
    if !config.source.rig.as_os_str().is_empty() {
        sources::calibration_file::read(&config.source.rig, true)?;
    }
    let text = toml::to_string(&config).map_err(|e| CommandError::Other(e.to_string()))?;
    say(format_args!("# The effective configuration. No errors.\n{text}"))
}
