//! `lookout check-config`.

use super::CommandError;
use crate::cli::CheckConfig;

pub fn run(args: &CheckConfig) -> Result<(), CommandError> {
    if args.reference {
        print!("{}", config::reference());
        return Ok(());
    }
    let config = config::load(args.file.as_deref())?;
    let text = toml::to_string(&config).map_err(|e| CommandError::Other(e.to_string()))?;
    println!("# The effective configuration. No errors.\n{text}");
    Ok(())
}
