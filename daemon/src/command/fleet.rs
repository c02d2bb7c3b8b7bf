//! `lookout fleet`.

use crate::command::config_args::{ConfigArgs, load};
use crate::command::error::CommandError;
use clap::Args;
use config::Config;

/// Text below the options of `--help`.
pub const HELP: &str = "Examples:
  lookout fleet --set bridge.connect=tcp/router:7447
  lookout fleet --fleet north --watch
  lookout fleet --json | jq -r '.[] | select(.alarm == \"alarm\") | .vehicle'

Lists the vehicles whose lookout bridge is connected (docs/fleet.md). Endpoints and certificates are
those of [bridge]. It needs a build with --features zenoh, and no daemon.";

#[derive(Args, Debug)]
pub struct Fleet {
    #[command(flatten)]
    pub config: ConfigArgs,
    /// Only this fleet [default: all]
    #[arg(long, value_name = "NAME", value_parser = name)]
    pub fleet: Option<String>,
    /// Update every two seconds until Ctrl-C
    #[arg(long)]
    pub watch: bool,
    /// Print as JSON; with --watch one document per line
    #[arg(long)]
    pub json: bool,
}

/// A name that can be part of a key.
fn name(text: &str) -> Result<String, String> {
    let is_part =
        !text.is_empty() && text.bytes().all(|b| b.is_ascii_alphanumeric() || b == b'-' || b == b'_');
    if is_part { Ok(text.to_owned()) } else { Err("give letters, digits, - and _".into()) }
}

pub fn run(args: &Fleet, log: Option<&str>) -> Result<(), CommandError> {
    // The level of the configuration is the daemon's.
    let config = load(&args.config, Some(log.unwrap_or("error")), "fleet", None)?;
    list(args, &config)
}

#[cfg(not(feature = "zenoh"))]
fn list(_: &Fleet, _: &Config) -> Result<(), CommandError> {
    Err(CommandError::Other("this build has no zenoh: build it with --features zenoh".into()))
}

#[cfg(feature = "zenoh")]
fn list(args: &Fleet, config: &Config) -> Result<(), CommandError> {
    use crate::bridge::fleet::{Fleet, table};
    use crate::command::attach::stop_on_signals;
    use crate::command::console::say;
    use std::io::IsTerminal;
    use std::sync::atomic::Ordering;
    use std::time::{Duration, Instant};

    /// Time between two lists.
    const PERIOD: Duration = Duration::from_secs(2);
    /// Clears the screen of a terminal, and moves to its first line.
    const CLEAR: &str = "\x1b[2J\x1b[H";

    let stop = stop_on_signals()?;
    let fleet = Fleet::connect(config, args.fleet.as_deref()).map_err(CommandError::Other)?;
    let clear = if args.watch && std::io::stdout().is_terminal() { CLEAR } else { "" };
    while !stop.load(Ordering::Relaxed) {
        let begin = Instant::now();
        let vehicles = fleet.vehicles().map_err(CommandError::Other)?;
        match (args.json, args.watch) {
            (true, true) => say(serde_json::to_string(&vehicles)?)?,
            (true, false) => say(serde_json::to_string_pretty(&vehicles)?)?,
            (false, _) => say(format_args!("{clear}{}", table(&vehicles)))?,
        }
        if !args.watch {
            break;
        }
        while begin.elapsed() < PERIOD && !stop.load(Ordering::Relaxed) {
            std::thread::sleep(PERIOD / 20);
        }
    }
    Ok(())
}
