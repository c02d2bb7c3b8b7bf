//! `lookout view`.

use super::{CommandError, load, say};
use crate::cli_view::View;
use crate::view::access::{Access, TokenError, given_token, new_token};
use crate::view::hub::Hub;
use crate::view::server::Server;
use crate::view::watcher::Watcher;
use messages::instance::Instance;
use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};
use std::io;
use std::net::SocketAddr;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

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
