//! `lookout bridge`.

use crate::command::config_args::{ConfigArgs, load};
use crate::command::error::CommandError;
use clap::Args;
use config::Config;

/// Text below the options of `--help`.
pub const HELP: &str = "Examples:
  lookout bridge -c /etc/lookout/lookout.toml
  lookout bridge --set bridge.vehicle=car-7 --set bridge.connect=tls/fleet.example.com:7447
  lookout bridge --ros2                                      also standard messages of ROS 2

Publishes lookout/<fleet>/<vehicle>/{obstacles,alarm,motion,status} as JSON, each change of the alarm
as lookout/<fleet>/<vehicle>/events/<number> with pictures, and answers requests for events and for a
point cloud (docs/fleet.md). Events are kept on the disk until they were sent. It waits for the daemon
and for the network, goes on across restarts of both, runs at the lowest priority, and never blocks a
stage. It must run as the daemon's user, and needs a build with --features zenoh.";

#[derive(Args, Debug)]
pub struct BridgeCommand {
    #[command(flatten)]
    pub config: ConfigArgs,
    /// Send messages of ROS 2 as well, under the names of rmw_zenoh; as bridge.ros2 does
    #[arg(long)]
    pub ros2: bool,
}

pub fn run(args: &BridgeCommand, log: Option<&str>) -> Result<(), CommandError> {
    let mut config = load(&args.config, log, "bridge", Some("warn"))?;
    config.bridge.ros2 |= args.ros2;
    send(&config)
}

#[cfg(not(feature = "zenoh"))]
fn send(_: &Config) -> Result<(), CommandError> {
    Err(CommandError::Other("this build has no zenoh: build it with --features zenoh".into()))
}

#[cfg(feature = "zenoh")]
fn send(config: &Config) -> Result<(), CommandError> {
    use crate::command::attach::{check_owner, stop_on_signals};
    use crate::command::low_priority::yield_to_the_daemon;
    use messages::instance::Instance;

    check_owner(&Instance::find(&config.instance.name, &config.instance.directory), "bridge")?;
    messages::bus::set_library_log_level_of_reader();
    // Before any thread starts: threads inherit it.
    yield_to_the_daemon();
    let stop = stop_on_signals()?;
    crate::bridge::run(config, &stop).map_err(|error| CommandError::Other(error.to_string()))
}
