//! `lookout can`.

use crate::can_out::identifiers;
use crate::command::config_args::{ConfigArgs, load};
use crate::command::console::say;
use crate::command::error::CommandError;
use crate::stages::whole_number::whole;
use clap::Args;
use config::Config;

/// Text below the options of `--help`.
pub const HELP: &str = "Examples:
  lookout can -c /etc/lookout/lookout.toml
  lookout can --set can_out.interface=can0
  lookout can --dbc > lookout.dbc

Sends the results of a running daemon on a CAN bus, at a fixed period: alarm, health, nearest obstacle,
path, own motion and obstacles (docs/can.md). It waits for the daemon, continues across its restarts, and
says on the bus when there is none. Information only: nothing is a request to the vehicle. It must run as
the daemon's user, and needs a build with the feature can.";

#[derive(Args, Debug)]
pub struct Can {
    #[command(flatten)]
    pub config: ConfigArgs,
    /// Print the DBC file of the configured frames instead
    #[arg(long)]
    pub dbc: bool,
}

pub fn run(args: &Can, log: Option<&str>) -> Result<(), CommandError> {
    let config = load(&args.config, log, "can", None)?;
    let identifiers = identifiers(&config)?;
    if args.dbc {
        return say(tools::can_out::dbc(identifiers, whole(config.can_out.period_ms)).trim_end());
    }
    if config.can_out.interface.is_empty() {
        let text = "can_out.interface is empty: name a CAN interface, such as can0";
        return Err(CommandError::Other(text.into()));
    }
    send(&config)
}

#[cfg(not(feature = "can"))]
fn send(_: &Config) -> Result<(), CommandError> {
    Err(CommandError::Other("this build cannot send on a CAN bus: build it with --features can".into()))
}

#[cfg(feature = "can")]
fn send(config: &Config) -> Result<(), CommandError> {
    use crate::can_out::sender::{self, Settings};
    use crate::can_out::{Shared, watcher::Watcher};
    use crate::command::attach::{check_owner, stop_on_signals};
    use messages::instance::Instance;
    use std::sync::Arc;
    use std::sync::atomic::Ordering;
    use tools::can_out::socket::SocketPort;

    /// As the writer's: a process without a deadline in the frame path.
    const NICE: i32 = 10;

    let instance = Instance::find(&config.instance.name, &config.instance.directory);
    check_owner(&instance, "can")?;
    messages::bus::set_library_log_level_of_reader();
    if let Err(error) = rustix::process::nice(NICE) {
        tracing::warn!(%error, "cannot lower the priority: runs at normal priority");
    }
    let c = &config.can_out;
    let settings = Settings {
        identifiers: identifiers(config)?,
        period_ns: whole::<u64>(c.period_ms) * 1_000_000,
        stale_ns: whole::<u64>(c.stale_ms) * 1_000_000,
    };
    let stop = stop_on_signals()?;
    let shared = Arc::new(Shared::default());
    let thread = {
        let (port, shared, stop) = (SocketPort::new(&c.interface), Arc::clone(&shared), Arc::clone(&stop));
        std::thread::Builder::new().name("sender".into()).spawn(move || {
            sender::run(port, settings, &shared, &stop);
        })
    };
    let thread =
        thread.map_err(|error| CommandError::Other(format!("cannot start the sender's thread: {error}")))?;
    let watched = Watcher::new(instance, &c.interface, shared, Arc::clone(&stop)).run();
    stop.store(true, Ordering::Relaxed);
    // It ends within a period.
    let joined = thread.join();
    watched.map_err(|error| CommandError::Other(error.to_string()))?;
    joined.map_err(|_| CommandError::Other("the sender's thread has failed: see the log".into()))
}
