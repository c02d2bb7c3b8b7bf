//! `lookout status`.

mod dashboard;
pub mod table;

use crate::command::config_args::ConfigArgs;
use crate::command::config_args::load;
use crate::command::console::say;
use crate::command::error::CommandError;
use crate::status_json::StatusJson;
use clap::Args;
use dashboard::Dashboard;
use messages::bus::Bus;
use messages::instance::{Instance, InstanceError};
use messages::service;
use messages::status::{self};
use messages::wait::{self, Next};
use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// Text below the options of `--help`.
pub const HELP: &str = "Examples:
  lookout status
  lookout status --watch
  lookout status --json";

#[derive(Args, Debug)]
pub struct Status {
    #[command(flatten)]
    pub config: ConfigArgs,
    /// Show it every second until Ctrl-C, or until the daemon ends: a screen of its own on a terminal,
    /// a line each time elsewhere
    #[arg(long)]
    pub watch: bool,
    /// Print as JSON, one document (with --watch: one a line)
    #[arg(long)]
    pub json: bool,
}

/// How long a daemon may take to answer.
const PATIENCE: Duration = Duration::from_secs(5);

pub fn run(args: &Status, log: Option<&str>) -> Result<(), CommandError> {
    let config = load(&args.config, log, "status", Some("error"))?;
    let instance = Instance::find(&config.instance.name, &config.instance.directory);
    let absent = || CommandError::from(InstanceError::NotRunning(instance.name().to_owned()));
    let (owner, user) = (instance.owner(), rustix::process::geteuid().as_raw());
    if let Some(owner) = owner.filter(|&owner| owner != user) {
        return Err(CommandError::Other(format!(
            "the daemon \"{}\" belongs to user {owner}, this is user {user}: shared memory is its own; \
             try: sudo -u '#{owner}' lookout status",
            instance.name()
        )));
    }
    if !instance.is_running() {
        return Err(absent());
    }
    // Leaves properly, so that nothing of it stays in the daemon's shared memory.
    let stop = Arc::new(AtomicBool::new(false));
    for signal in [SIGINT, SIGTERM, SIGHUP] {
        signal_hook::flag::register(signal, Arc::clone(&stop))
            .map_err(|e| CommandError::Other(format!("cannot catch signals: {e}")))?;
    }
    let bus = Bus::join(&instance)?;
    let statuses = bus.subscriber(&service::STATUS)?;
    let mut heard = Instant::now();
    let mut dashboard = (args.watch && !args.json).then(|| Dashboard::open(instance.name()));
    let (mut shown, mut ended) = (false, false);
    wait::run::<CommandError>(&[&statuses], || {
        while let Some(sample) = statuses.receive()? {
            let Ok(status) = status::view(sample.header(), sample.payload()) else { continue };
            heard = Instant::now();
            match (&mut dashboard, args.json, args.watch) {
                (Some(dashboard), ..) => dashboard.show(&status)?,
                (None, true, true) => say(serde_json::to_string(&StatusJson::new(&status))?)?,
                (None, true, false) => say(serde_json::to_string_pretty(&StatusJson::new(&status))?)?,
                (None, false, _) => say(table::table(instance.name(), &status))?,
            }
            shown = true;
            if !args.watch {
                return Ok(Next::Stop);
            }
        }
        if stop.load(Ordering::Relaxed) {
            return Ok(Next::Stop);
        }
        if heard.elapsed() > PATIENCE || (shown && !instance.is_running()) {
            ended = true;
            return Ok(Next::Stop);
        }
        Ok(Next::Wait(Duration::from_millis(200)))
    })?;
    // Gives the terminal back.
    drop(dashboard);
    match (shown, ended) {
        (true, true) => {
            eprintln!("lookout: the daemon has ended");
            Ok(())
        }
        (true, false) => Ok(()),
        (false, _) => Err(absent()),
    }
}
