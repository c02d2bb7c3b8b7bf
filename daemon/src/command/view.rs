//! `lookout view`.

use crate::command::attach::{check_owner, stop_on_signals};
use crate::command::config_args::ConfigArgs;
use crate::command::config_args::load;
use crate::command::console::say;
use crate::command::error::CommandError;
use crate::command::low_priority::yield_to_the_daemon;
use crate::view::access::{Access, TokenError, given_token, new_token};
use crate::view::hub::Hub;
use crate::view::server::Server;
use crate::view::watcher::Watcher;
use clap::Args;
use messages::instance::Instance;
use messages::neighbours::absent;
use std::io;
use std::net::SocketAddr;
use std::sync::Arc;

/// Default address of the page.
const ADDRESS: &str = "127.0.0.1:8467";

pub const HELP: &str = "Examples:
  lookout view                                  then open http://127.0.0.1:8467
  lookout view --instance front --bind 127.0.0.1:0
  lookout view --bind 0.0.0.0:8467              for a phone on the same network; prints a link
  curl http://127.0.0.1:8467/metrics            Prometheus metrics
  ssh -L 8467:127.0.0.1:8467 board              the page of a remote board through SSH

The page shows the left image with boxes, distances and the alarm, disparity, v-disparity with the
road profile, a bird's-eye view, and latency, rates, drops, CPU, temperatures, clocks and health
over time. The viewer waits for the daemon, continues across its restarts, and runs at the lowest
priority: it takes the newest frame and never blocks a stage. It must run as the daemon's user.

Anyone who can reach the address sees the images. On a loopback address (127.0.0.1, ::1) that is
every user of the machine, unless --token is given; on any other address a token is always
required. The connection is not encrypted.";

#[derive(Args, Debug)]
pub struct View {
    #[command(flatten)]
    pub config: ConfigArgs,
    /// Address and port to listen on; port 0 chooses a free one
    #[arg(long, default_value = ADDRESS, value_name = "ADDRESS:PORT", value_parser = address)]
    pub bind: SocketAddr,
    /// Access token: 16 or more letters, digits, - and _. @FILE reads it from a file, so that other users
    /// do not see it in the list of processes [default: on an address that is not loopback a random one
    /// is generated and printed]
    #[arg(long, value_name = "TOKEN")]
    pub token: Option<String>,
}

fn address(text: &str) -> Result<SocketAddr, String> {
    text.parse().map_err(|_| format!("give an IP address and a port, such as {ADDRESS} or 0.0.0.0:8467"))
}

pub fn run(args: &View, log: Option<&str>) -> Result<(), CommandError> {
    let config = load(&args.config, log, "view", Some("warn"))?;
    let instance = Instance::find(&config.instance.name, &config.instance.directory);
    check_owner(&instance, "view")?;
    let token = token(args).map_err(|error| CommandError::Other(error.to_string()))?;
    messages::bus::set_library_log_level_of_reader();
    yield_to_the_daemon();
    let stop = stop_on_signals()?;
    let hub = Arc::new(Hub::new());
    let access = |address| Access::new(address, token.clone());
    let server = Server::bind(args.bind, access, Arc::clone(&hub)).map_err(|e| cannot_bind(args.bind, &e))?;
    let address = server.address().map_err(|e| cannot_bind(args.bind, &e))?;
    say(invitation(address, &instance, token.as_deref()))?;
    if !instance.is_running() {
        eprintln!("lookout: note: {}; the page waits for it", absent(&instance));
    }
    let server = Arc::new(server);
    std::thread::Builder::new()
        .name("server".into())
        .spawn(move || server.run())
        .map_err(|e| CommandError::Other(format!("cannot start the server thread: {e}")))?;
    Watcher::new(instance, &config.board.sysfs, hub, stop).run();
    Ok(())
}

fn cannot_bind(address: SocketAddr, error: &io::Error) -> CommandError {
    let remedy = match error.kind() {
        io::ErrorKind::AddrInUse => "another viewer may use it: give another port, or 0 for a free one",
        io::ErrorKind::AddrNotAvailable => "give an address of this machine, or 0.0.0.0 for all",
        io::ErrorKind::PermissionDenied => "give a port of at least 1024",
        _ => "give another address with --bind",
    };
    CommandError::Other(format!("--bind {address}: {error}: {remedy}"))
}

/// The token: the given one, otherwise none on a loopback address and a random one elsewhere.
fn token(args: &View) -> Result<Option<String>, TokenError> {
    match &args.token {
        Some(text) => given_token(text).map(Some),
        None if args.bind.ip().is_loopback() => Ok(None),
        None => new_token().map(Some),
    }
}

/// The line with the link. A wildcard address is no host name, so the user has to fill in the machine's.
fn invitation(address: SocketAddr, instance: &Instance, token: Option<&str>) -> String {
    let host = if address.ip().is_unspecified() {
        format!("ADDRESS-OF-THIS-MACHINE:{}", address.port())
    } else {
        address.to_string()
    };
    let link = token.map_or_else(String::new, |token| format!("/?token={token}"));
    let shown = if instance.is_running() { "is shown at" } else { "will be shown, once it runs, at" };
    format!("the daemon \"{}\" {shown} http://{host}{link}", instance.name())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_link_contains_host_port_and_token() {
        let folder = tempfile::tempdir().unwrap();
        let front = Instance::new("front", folder.path());
        let link = |address: &str, token| invitation(address.parse().unwrap(), &front, token);
        let waits = "the daemon \"front\" will be shown, once it runs, at http://127.0.0.1:80";
        assert_eq!(link("127.0.0.1:80", None), waits);
        assert!(link("[::1]:80", Some("abc")).ends_with("http://[::1]:80/?token=abc"));
        assert!(link("0.0.0.0:81", Some("abc")).ends_with("http://ADDRESS-OF-THIS-MACHINE:81/?token=abc"));
    }
}
