//! `lookout status`.

mod dashboard;
pub mod table;

use crate::can_out::state_file::{self, CanOutState};
use crate::command::attach::{cannot_join, check_owner, silent, stop_on_signals};
use crate::command::config_args::ConfigArgs;
use crate::command::config_args::load;
use crate::command::console::say;
use crate::command::error::CommandError;
use crate::status_json::StatusJson;
use clap::Args;
use dashboard::Dashboard;
use messages::bus::Bus;
use messages::instance::Instance;
use messages::neighbours::{Neighbours, absent};
use messages::service;
use messages::silence::TIMEOUT;
use messages::status::{self, StatusRecord};
use messages::wait::{self, Next};
use serde::Serialize;
use std::sync::atomic::Ordering;
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
    /// Update every second until Ctrl-C or the end of the daemon: full screen on a terminal, otherwise one
    /// line per update
    #[arg(long)]
    pub watch: bool,
    /// Print as JSON; with --watch one document per line
    #[arg(long)]
    pub json: bool,
}

/// The daemon's status, and the state of what sends it on a CAN bus.
#[derive(Serialize)]
struct Shown {
    #[serde(flatten)]
    status: StatusJson,
    /// `None` if no `lookout can` runs for the daemon.
    can_out: Option<CanOutState>,
}

impl Shown {
    fn new(status: &StatusRecord, instance: &Instance) -> Self {
        Self { status: StatusJson::new(status), can_out: state_file::read(instance) }
    }
}

/// Names the other daemons of this machine, which the same command shows.
fn say_others(instance: &Instance) -> Result<(), CommandError> {
    let others = Neighbours::of(instance);
    if !others.names.is_empty() {
        say(format_args!("other instances: {} (--instance NAME shows one)", others.names.join(", ")))?;
    }
    for folder in &others.foreign {
        say(format_args!("{folder}"))?;
    }
    Ok(())
}

pub fn run(args: &Status, log: Option<&str>) -> Result<(), CommandError> {
    let config = load(&args.config, log, "status", Some("error"))?;
    let instance = Instance::find(&config.instance.name, &config.instance.directory);
    check_owner(&instance, "status")?;
    if !instance.is_running() {
        return Err(absent(&instance).into());
    }
    let stop = stop_on_signals()?;
    let bus = Bus::join(&instance).map_err(|error| cannot_join(&instance, error))?;
    let statuses = bus.subscriber(&service::STATUS).map_err(|error| cannot_join(&instance, error))?;
    let mut last_status = Instant::now();
    let mut dashboard = (args.watch && !args.json).then(|| Dashboard::open(instance.name()));
    let (mut shown, mut ended) = (false, false);
    wait::run::<CommandError>(&[&statuses], || {
        while let Some(sample) = statuses.receive()? {
            let Ok(status) = status::view(sample.header(), sample.payload()) else { continue };
            last_status = Instant::now();
            match (&mut dashboard, args.json, args.watch) {
                (Some(dashboard), ..) => {
                    let can_out = state_file::read(&instance).map(|state| state.line());
                    dashboard.show(&status, can_out.as_deref())?;
                }
                (None, true, true) => say(serde_json::to_string(&Shown::new(&status, &instance))?)?,
                (None, true, false) => say(serde_json::to_string_pretty(&Shown::new(&status, &instance))?)?,
                (None, false, _) => {
                    say(table::table(instance.name(), &status))?;
                    if let Some(state) = state_file::read(&instance) {
                        say(state.line())?;
                    }
                    if !args.watch {
                        say_others(&instance)?;
                    }
                }
            }
            shown = true;
            if !args.watch {
                return Ok(Next::Stop);
            }
        }
        if stop.load(Ordering::Relaxed) {
            return Ok(Next::Stop);
        }
        if last_status.elapsed() > TIMEOUT || (shown && !instance.is_running()) {
            ended = true;
            return Ok(Next::Stop);
        }
        Ok(Next::Wait(Duration::from_millis(200)))
    })?;
    // Restores the terminal.
    drop(dashboard);
    match (shown, ended) {
        (true, true) if !instance.is_running() => {
            eprintln!("lookout: the daemon has ended");
            Ok(())
        }
        (true, false) => Ok(()),
        _ => Err(silent(&instance)),
    }
}
