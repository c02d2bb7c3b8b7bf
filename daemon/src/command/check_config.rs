//! `lookout check-config`.

use super::{CommandError, say};
use crate::cli::CheckConfig;
use crate::rooms;

pub fn run(args: &CheckConfig) -> Result<(), CommandError> {
    if args.reference {
        return say(config::reference().trim_end());
    }
    let config = config::load(args.file.as_deref())?;
    // What the configuration names must be there and sound, too.
    rooms::recogniser(&config, 8, 8)?;
    if !config.source.rig.as_os_str().is_empty() {
        sources::calibration_file::read(&config.source.rig, true)?;
    }
    let text = toml::to_string(&config).map_err(|e| CommandError::Other(e.to_string()))?;
    say(format_args!("# The effective configuration. No errors.\n{text}"))
}
