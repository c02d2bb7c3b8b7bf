//! `lookout stream`.

use crate::command::attach::{check_owner, stop_on_signals};
use crate::command::config_args::{ConfigArgs, load};
use crate::command::error::CommandError;
use crate::command::low_priority::yield_to_the_daemon;
use crate::command::number::{fps, whole};
use crate::stream::follower::Follower;
use crate::stream::latest::Latest;
use crate::stream::relay::Relay;
use crate::stream::runs::Runs;
use crate::stream::sender::{self, End, Terms};
use crate::stream::server::Server;
use crate::stream::socket;
use crate::stream::topics::{self, Topics};
use clap::Args;
use clap::builder::PossibleValuesParser;
use config::Config;
use messages::instance::{Instance, InstanceError};
use std::os::fd::AsFd;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

/// Text below the options of `--help`.
pub const HELP: &str = "Examples:
  lookout stream | jq .alarm.level
  lookout stream | jq -c '.obstacles[] | select(.in_path) | [.class, .distance_m]'
  lookout stream --topics alarm,motion --rate 2
  lookout stream --topics status | jq -r '.status.state'
  lookout stream --limit 1 | jq .                            the next frame
  lookout stream --socket /run/lookout-stream/socket         as a member of the socket's group
  lookout stream --serve -c car.toml              serves stream.socket

One JSON object a line, one line a frame, with the fields of obstacles.jsonl (docs/outputs.md). run
and sequence identify a frame: run differs at each start of the daemon. A line with \"withdrawn\":
true says that the results before it no longer hold: the daemon has ended, or a stage has died. The
topic status adds the daemon's state once a second, as lookout status --json shows it.

It waits for the daemon, continues across its restarts, and ends when its reader does. A reader that
is slower than the daemon gets fewer frames, each the newest. It runs at the lowest priority and
never blocks a stage. It must run as the daemon's user, or read the socket that lookout stream
--serve offers to a group.";

#[derive(Args, Debug)]
pub struct Stream {
    #[command(flatten)]
    pub config: ConfigArgs,
    /// What each line has, separated by commas [default: all but status]
    #[arg(long, value_name = "LIST", value_delimiter = ',', value_parser = topic_names())]
    pub topics: Vec<String>,
    /// Lines per second at most; the newest frame wins [default: every frame]
    #[arg(long, value_name = "HZ", value_parser = fps)]
    pub rate: Option<f64>,
    /// End after this many lines
    #[arg(long, value_name = "N", value_parser = whole::<u64>(1, u64::MAX))]
    pub limit: Option<u64>,
    /// Read the socket of lookout stream --serve instead of shared memory [default: stream.socket, where the daemon
    /// runs as another user]
    #[arg(long, value_name = "PATH")]
    pub socket: Option<PathBuf>,
    /// Serve the socket of the configuration (stream.socket, stream.mode, stream.group) instead of printing
    #[arg(long, conflicts_with_all = ["topics", "rate", "limit", "socket"])]
    pub serve: bool,
}

fn topic_names() -> PossibleValuesParser {
    PossibleValuesParser::new(topics::names().chain([topics::ALL]))
}

pub fn run(args: &Stream, log: Option<&str>) -> Result<(), CommandError> {
    let config = load(&args.config, log, "stream", Some("warn"))?;
    messages::bus::set_library_log_level_of_reader();
    let source = source(args, &config)?;
    yield_to_the_daemon();
    let stop = stop_on_signals()?;
    if args.serve { serve(&config, stop) } else { print(args, &config, source, stop) }
}

/// The socket to read; `None` reads shared memory.
fn source(args: &Stream, config: &Config) -> Result<Option<PathBuf>, CommandError> {
    if args.socket.is_some() {
        return Ok(args.socket.clone());
    }
    let instance = Instance::find(&config.instance.name, &config.instance.directory);
    let is_foreign = matches!(instance.check_owner(), Err(InstanceError::OtherUser { .. }));
    if is_foreign && !args.serve && !config.stream.socket.as_os_str().is_empty() {
        return Ok(Some(config.stream.socket.clone()));
    }
    check_owner(&instance, "stream").map_err(|error| match is_foreign && !args.serve {
        true => CommandError::Other(format!(
            "{error}; or read the socket of lookout stream --serve with --socket"
        )),
        false => error,
    })?;
    Ok(None)
}

/// Serves the socket until a signal.
fn serve(config: &Config, stop: Arc<AtomicBool>) -> Result<(), CommandError> {
    let (listener, file) = socket::open(&config.stream)?;
    let latest = Arc::new(Latest::default());
    let server = Arc::new(Server::new(Arc::clone(&latest), Arc::clone(&stop)));
    Arc::clone(&server)
        .start(listener)
        .map_err(|e| CommandError::Other(format!("cannot start the server thread: {e}")))?;
    let runs = Runs::new(latest, Topics::all());
    Follower::new(&config.instance.name, &config.instance.directory, runs, stop).run();
    drop(file);
    server.say_goodbye();
    Ok(())
}

/// Prints lines until the reader ends, a signal, or the limit.
fn print(
    args: &Stream,
    config: &Config,
    source: Option<PathBuf>,
    stop: Arc<AtomicBool>,
) -> Result<(), CommandError> {
    let latest = Arc::new(Latest::default());
    let runs = Runs::new(Arc::clone(&latest), Topics::of(&args.topics));
    let period = args.rate.map(|rate| Duration::from_secs_f64(1.0 / rate));
    let terms = Terms { period, limit: args.limit, patience: None };
    std::thread::scope(|scope| {
        let feed_stop = Arc::clone(&stop);
        let feed = std::thread::Builder::new().name("feed".into()).spawn_scoped(scope, move || {
            let result = match source {
                Some(path) => Relay::new(&path, runs, Arc::clone(&feed_stop)).run(),
                None => {
                    let instance = &config.instance;
                    Follower::new(&instance.name, &instance.directory, runs, Arc::clone(&feed_stop)).run();
                    Ok(())
                }
            };
            // Without it no line comes any more.
            feed_stop.store(true, Ordering::Relaxed);
            result
        });
        let feed = feed.map_err(|e| CommandError::Other(format!("cannot start the feed thread: {e}")))?;
        let end = sender::run(std::io::stdout().as_fd(), &latest, &terms, &stop);
        stop.store(true, Ordering::Relaxed);
        match (feed.join(), end) {
            (Ok(Err(error)), _) => Err(CommandError::Other(error)),
            (_, Err(error)) => Err(CommandError::Other(format!("standard output: {error}"))),
            (Ok(Ok(())), Ok(End::Stopped | End::Gone | End::TooSlow | End::Complete)) => Ok(()),
            (Err(_), Ok(_)) => Err(CommandError::Other("the feed thread has failed".into())),
        }
    })
}
