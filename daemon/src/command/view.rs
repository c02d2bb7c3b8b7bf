//! `lookout view`.

use crate::command::config_args::ConfigArgs;
use crate::command::config_args::load;
use crate::command::console::say;
use crate::command::error::CommandError;
use crate::view::access::{Access, TokenError, given_token, new_token};
use crate::view::hub::Hub;
use crate::view::server::Server;
use crate::view::watcher::Watcher;
use clap::Args;
use messages::instance::Instance;
use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};
use std::io;
use std::net::SocketAddr;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

/// Where the page is, unless asked otherwise.
const ADDRESS: &str = "127.0.0.1:8467";

pub const HELP: &str = "Examples:
  lookout view                                  then open http://127.0.0.1:8467
  lookout view --instance front --bind 127.0.0.1:0
  lookout view --bind 0.0.0.0:8467              for a phone on the car's network: prints a link with a token
  curl http://127.0.0.1:8467/metrics            figures for Prometheus
  ssh -L 8467:127.0.0.1:8467 board              the page of a board, without opening it to the network

The page shows the left image with boxes, distances and the alarm, disparity, v-disparity with the
road, the bird's-eye view, and latency, rates, drops, CPU, temperatures, clocks and health over time.
The viewer waits for the daemon, outlives its restarts, and runs at the lowest priority: it takes the
newest frame and never holds a stage up. It must run as the daemon's user.

Whoever can reach the address sees the pictures: on an address of the machine itself (127.0.0.1, ::1)
that is every user of it, unless there is a token; on any other a token is always asked for. The
connection is not encrypted.";

#[derive(Args, Debug)]
pub struct View {
    #[command(flatten)]
    pub config: ConfigArgs,
    /// Address and port to serve at; port 0 takes a free one
    #[arg(long, default_value = ADDRESS, value_name = "ADDRESS:PORT")]
    pub bind: SocketAddr,
    /// Who knows it may look: 16 characters or more of letters, digits, - and _; @FILE reads it from a
    /// file, which other users of the machine cannot see in the list of processes [default: on an address
    /// other than the machine's own a new one is made and printed]
    #[arg(long, value_name = "TOKEN")]
    pub token: Option<String>,
}

/// The lowest priority there is without leave.
const NICE: i32 = 19;

pub fn run(args: &View, log: Option<&str>) -> Result<(), CommandError> {
    let config = load(&args.config, log, "view", Some("warn"))?;
    let instance = Instance::find(&config.instance.name, &config.instance.directory);
    let user = rustix::process::geteuid().as_raw();
    if let Some(owner) = instance.owner().filter(|&owner| owner != user) {
        return Err(CommandError::Other(format!(
            "the daemon \"{}\" belongs to user {owner}, this is user {user}: shared memory is its own; \
             try: sudo -u '#{owner}' lookout view",
            instance.name()
        )));
    }
    let token = token(args).map_err(|error| CommandError::Other(error.to_string()))?;
    messages::bus::set_library_log_level_of_reader();
    yield_to_the_daemon();
    let stop = Arc::new(AtomicBool::new(false));
    for signal in [SIGINT, SIGTERM, SIGHUP] {
        signal_hook::flag::register(signal, Arc::clone(&stop))
            .map_err(|e| CommandError::Other(format!("cannot catch signals: {e}")))?;
    }
    let hub = Arc::new(Hub::new());
    let access = |address| Access::new(address, token.clone());
    let server = Server::bind(args.bind, access, Arc::clone(&hub)).map_err(|e| cannot_bind(args.bind, &e))?;
    let address = server.address().map_err(|e| cannot_bind(args.bind, &e))?;
    say(invitation(address, instance.name(), token.as_deref()))?;
    let server = Arc::new(server);
    std::thread::Builder::new()
        .name("server".into())
        .spawn(move || server.run())
        .map_err(|e| CommandError::Other(format!("no thread for the server: {e}")))?;
    Watcher::new(instance, &config.board.sysfs, hub, stop).run();
    Ok(())
}

fn cannot_bind(address: SocketAddr, error: &io::Error) -> CommandError {
    let remedy = match error.kind() {
        io::ErrorKind::AddrInUse => "another viewer may be there: give another port, or 0 for a free one",
        io::ErrorKind::AddrNotAvailable => "give an address of this machine, or 0.0.0.0 for all",
        io::ErrorKind::PermissionDenied => "give a port from 1024 on",
        _ => "give another with --bind",
    };
    CommandError::Other(format!("--bind {address}: {error}: {remedy}"))
}

/// The token: as given; a new one where others than users of this machine can come.
fn token(args: &View) -> Result<Option<String>, TokenError> {
    match &args.token {
        Some(text) => given_token(text).map(Some),
        None if args.bind.ip().is_loopback() => Ok(None),
        None => new_token().map(Some),
    }
}

/// The line with the link. Where every address is served, the reader puts in the right one.
fn invitation(address: SocketAddr, name: &str, token: Option<&str>) -> String {
    let host = if address.ip().is_unspecified() {
        format!("ADDRESS-OF-THIS-MACHINE:{}", address.port())
    } else {
        address.to_string()
    };
    let link = token.map_or_else(String::new, |token| format!("/?token={token}"));
    format!("the daemon \"{name}\" is shown at http://{host}{link}")
}

/// Takes the last place for the processor, and the first when memory runs out.
fn yield_to_the_daemon() {
    if let Err(error) = messages::idle::run_when_idle() {
        tracing::warn!(%error, "does not wait until the processor is idle");
    }
    if let Err(error) = rustix::process::nice(NICE) {
        tracing::warn!(%error, "runs at normal priority");
    }
    if let Err(error) = std::fs::write("/proc/self/oom_score_adj", "800") {
        tracing::debug!(%error, "memory");
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_link_holds_what_is_needed() {
        let link = |address: &str, token| invitation(address.parse().unwrap(), "front", token);
        assert_eq!(link("127.0.0.1:80", None), "the daemon \"front\" is shown at http://127.0.0.1:80");
        assert!(link("[::1]:80", Some("abc")).ends_with("http://[::1]:80/?token=abc"));
        assert!(link("0.0.0.0:81", Some("abc")).ends_with("http://ADDRESS-OF-THIS-MACHINE:81/?token=abc"));
    }
}
