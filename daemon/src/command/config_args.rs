//! Arguments that choose and override the configuration of a command.

use crate::command::error::CommandError;
use clap::Args;
use config::{Config, ConfigErrors};
use std::path::PathBuf;

/// Arguments that choose and override the configuration.
#[derive(Args, Debug, Clone)]
pub struct ConfigArgs {
    /// Configuration file, or one of the profiles replay, tk1, orin-nano, rpi5, rk3588
    #[arg(short, long, value_name = "FILE")]
    pub config: Option<PathBuf>,
    /// Override one configuration key, for example stereo.lambda_vertical=8; may be repeated
    #[arg(long, value_name = "KEY=VALUE")]
    pub set: Vec<String>,
    /// Name of the daemon instance; several can run on a machine [default: instance.name]
    #[arg(long, value_name = "NAME")]
    pub instance: Option<String>,
}

/// Reads the configuration that the arguments choose, and starts logging. `default_level` replaces
/// `log.level` if no configuration was named.
///
/// # Errors
/// All errors in the configuration.
pub fn load(
    args: &ConfigArgs,
    log: Option<&str>,
    process: &'static str,
    default_level: Option<&str>,
) -> Result<Config, CommandError> {
    let config = read(args, log, default_level)?;
    crate::logging::start(process, &config.log.level);
    Ok(config)
}

/// Reads the configuration that the arguments choose.
///
/// # Errors
/// All errors in the configuration.
pub fn read(
    args: &ConfigArgs,
    log: Option<&str>,
    default_level: Option<&str>,
) -> Result<Config, CommandError> {
    let mut config = with_set(config::load(args.config.as_deref())?, &args.set)?;
    if let Some(name) = &args.instance {
        // Parsed as a configuration, so that the same check applies as to instance.name.
        let text = format!("[instance]\nname = {}", toml::Value::String(name.clone()));
        config::parse(&text, std::path::Path::new("--instance")).map_err(ConfigErrors::without_lines)?;
        config.instance.name.clone_from(name);
    }
    let level = match (log, default_level, &args.config) {
        (Some(level), ..) => level,
        (None, Some(level), None) => level,
        _ => &config.log.level,
    };
    config.log.level = level.to_owned();
    Ok(config)
}

/// Applies each KEY=VALUE of `--set`.
fn with_set(config: Config, settings: &[String]) -> Result<Config, CommandError> {
    if settings.is_empty() {
        return Ok(config);
    }
    let wrong = |setting: &str| {
        CommandError::Other(format!(
            "--set {setting}: give TABLE.KEY=VALUE, for example stereo.lambda_vertical=8"
        ))
    };
    let mut document =
        toml::Table::try_from(&config).map_err(|error| CommandError::Other(error.to_string()))?;
    for setting in settings {
        let (key, value) = setting.split_once('=').ok_or_else(|| wrong(setting))?;
        let (table, key) = key.trim().split_once('.').ok_or_else(|| wrong(setting))?;
        // A value that is not valid TOML is a string without quotes.
        let value = format!("value = {value}")
            .parse::<toml::Table>()
            .ok()
            .and_then(|mut t| t.remove("value"))
            .unwrap_or_else(|| toml::Value::String(value.to_owned()));
        let entry = document.entry(table).or_insert_with(|| toml::Table::new().into());
        let table = entry.as_table_mut().ok_or_else(|| wrong(setting))?;
        table.insert(key.to_owned(), value);
    }
    // The lines are those of a text that nobody wrote.
    Ok(config::parse(&document.to_string(), std::path::Path::new("--set"))
        .map_err(ConfigErrors::without_lines)?)
}
