//! Notifications to systemd by sd_notify(3): ready, status, reloading, stopping, watchdog.
//!
//! A pure state machine decides when to send them; time is passed in. Only the scheduler feeds the watchdog, and only
//! while its loop runs and all stages are live: the supervisor restarts a stage that hangs, and systemd restarts the
//! daemon if the supervisor does not succeed.

use crate::printable::Printable;
use rustix::time::{ClockId, clock_gettime};
use std::io;
use std::os::linux::net::SocketAddrExt;
use std::os::unix::net::{SocketAddr, UnixDatagram};

/// The environment variable with the address of the socket.
pub const SOCKET: &str = "NOTIFY_SOCKET";

/// Environment variables of the notification protocol, which stages do not inherit.
pub const VARIABLES: [&str; 3] = [SOCKET, "WATCHDOG_USEC", "WATCHDOG_PID"];

/// Without a first pair, the daemon is ready when all stages have been live for this long, in nanoseconds.
const NO_SOURCE_NS: u64 = 3_000_000_000;

/// Minimum time between two status lines of the same state, in nanoseconds: every message wakes process 1.
const STATUS_NS: u64 = 10_000_000_000;

/// State of the daemon.
#[derive(Clone, Copy, Debug, Default)]
pub struct View {
    /// There has been a result.
    pub has_result: bool,
    /// A pair has been published.
    pub has_pair: bool,
    /// All stages are reporting; the writer may be down.
    pub all_live: bool,
    /// The run is stopping.
    pub is_stopping: bool,
}

/// The state machine.
#[derive(Clone, Debug)]
struct Protocol {
    /// Half of the watchdog's timeout; `None` = no watchdog.
    period_ns: Option<u64>,
    fed_ns: Option<u64>,
    live_since_ns: Option<u64>,
    is_ready: bool,
    is_stopping: bool,
    state: String,
    status_ns: Option<u64>,
}

impl Protocol {
    fn new(watchdog_ns: Option<u64>) -> Self {
        Self {
            period_ns: watchdog_ns.map(|ns| ns / 2),
            fed_ns: None,
            live_since_ns: None,
            is_ready: false,
            is_stopping: false,
            state: String::new(),
            status_ns: None,
        }
    }

    /// The notification that is due, as lines of the protocol.
    fn step(&mut self, now_ns: u64, view: View) -> Option<&'static str> {
        if view.all_live {
            self.live_since_ns.get_or_insert(now_ns);
        } else {
            self.live_since_ns = None;
        }
        if view.is_stopping {
            return (!std::mem::replace(&mut self.is_stopping, true)).then_some("STOPPING=1");
        }
        let idle = !view.has_pair && self.live_since_ns.is_some_and(|at| now_ns - at >= NO_SOURCE_NS);
        if !self.is_ready && (view.has_result || idle) {
            self.is_ready = true;
            return Some("READY=1");
        }
        let fed = self.fed_ns;
        let due =
            self.period_ns.is_some_and(|period| fed.is_none_or(|at| now_ns.saturating_sub(at) >= period));
        if due && view.all_live {
            self.fed_ns = Some(now_ns);
            return Some("WATCHDOG=1");
        }
        None
    }

    /// Whether a status line is due: at once when `state` changes, else every ten seconds.
    fn status_due(&mut self, now_ns: u64, state: &str) -> bool {
        let due = self.state != state || self.status_ns.is_none_or(|at| now_ns - at >= STATUS_NS);
        if due {
            self.status_ns = Some(now_ns);
            state.clone_into(&mut self.state);
        }
        due
    }
}

/// The connection to systemd. Without systemd all methods do nothing.
#[derive(Debug)]
pub struct Notify {
    socket: Option<(UnixDatagram, SocketAddr)>,
    protocol: Protocol,
}

impl Notify {
    /// Connects to the socket that the environment names. An unusable address is logged.
    pub fn from_environment() -> Self {
        let number = |name| std::env::var(name).ok().and_then(|text: String| text.parse::<u64>().ok());
        let socket = std::env::var(SOCKET).ok().filter(|name| !name.is_empty());
        let socket = socket.and_then(|name| {
            open(&name).map_err(|error| tracing::warn!(name, %error, "systemd cannot be notified")).ok()
        });
        // The variables may be meant for another process, for example a shell that has started this one.
        let is_ours = number("WATCHDOG_PID").is_none_or(|pid| pid == u64::from(std::process::id()));
        let watchdog_us = number("WATCHDOG_USEC").filter(|&us| us > 0 && is_ours && socket.is_some());
        Self { socket, protocol: Protocol::new(watchdog_us.map(|us| us.saturating_mul(1000))) }
    }

    /// Sends the notification that is due; has to be called in every iteration of the loop.
    pub fn step(&mut self, now_ns: u64, view: View) {
        if let Some(line) = self.protocol.step(now_ns, view) {
            self.send(line);
        }
    }

    /// Sends a status line if one is due. A change of `state` is sent at once.
    pub fn status(&mut self, now_ns: u64, state: &str, text: impl FnOnce() -> String) {
        if self.socket.is_some() && self.protocol.status_due(now_ns, state) {
            self.send(&format!("STATUS={}", one_line(&text())));
        }
    }

    /// A reload begins.
    pub fn reloading(&self) {
        let now = clock_gettime(ClockId::Monotonic);
        let us = now.tv_sec as u64 * 1_000_000 + now.tv_nsec as u64 / 1000;
        self.send(&format!("RELOADING=1\nMONOTONIC_USEC={us}"));
    }

    /// The reload has ended, successfully or not.
    pub fn reloaded(&self, text: &str) {
        self.send(&format!("READY=1\nSTATUS={}", one_line(text)));
    }

    /// Sends without blocking. A lost status is sent again later, and no notification is worth a late frame.
    fn send(&self, text: &str) {
        if let Some((socket, address)) = &self.socket
            && let Err(error) = socket.send_to_addr(text.as_bytes(), address)
        {
            tracing::debug!(%error, text, "systemd was not notified");
        }
    }
}

fn open(name: &str) -> io::Result<(UnixDatagram, SocketAddr)> {
    let address = match name.strip_prefix('@') {
        Some(name) => SocketAddr::from_abstract_name(name)?,
        None => SocketAddr::from_pathname(name)?,
    };
    let socket = UnixDatagram::unbound()?;
    socket.set_nonblocking(true)?;
    Ok((socket, address))
}

/// Replaces line breaks, which separate the fields of the protocol, and escapes what else forges output of systemctl.
fn one_line(text: &str) -> String {
    Printable(text.replace('\n', "; ")).to_string()
}

#[cfg(test)]
mod tests {
    use super::*;

    const S: u64 = 1_000_000_000;
    const LIVE: View = View { has_result: true, has_pair: true, all_live: true, is_stopping: false };

    #[test]
    fn ready_comes_with_the_first_result() {
        let mut protocol = Protocol::new(None);
        let waiting = View { has_result: false, ..LIVE };
        for second in 0..60 {
            // Pairs are published, so a result will follow.
            assert_eq!(protocol.step(second * S, waiting), None);
        }
        assert_eq!(protocol.step(60 * S, LIVE), Some("READY=1"));
        assert_eq!(protocol.step(61 * S, LIVE), None);
    }

    #[test]
    fn without_a_source_ready_means_that_all_stages_are_live() {
        let mut protocol = Protocol::new(None);
        let idle = View { has_result: false, has_pair: false, ..LIVE };
        assert_eq!(protocol.step(0, View { all_live: false, ..idle }), None);
        assert_eq!(protocol.step(S, idle), None);
        assert_eq!(protocol.step(3 * S, View { all_live: false, ..idle }), None);
        assert_eq!(protocol.step(4 * S, idle), None);
        assert_eq!(protocol.step(6 * S, idle), None);
        assert_eq!(protocol.step(7 * S, idle), Some("READY=1"));
    }

    #[test]
    fn the_watchdog_is_fed_at_half_its_time_and_only_while_all_are_live() {
        let mut protocol = Protocol::new(Some(10 * S));
        assert_eq!(protocol.step(0, LIVE), Some("READY=1"));
        let mut fed = Vec::new();
        for tick in 0..600 {
            let now = tick * S / 10;
            let all_live = !(20..40).contains(&(tick / 10));
            if protocol.step(now, View { all_live, ..LIVE }).is_some() {
                fed.push(tick / 10);
            }
        }
        assert_eq!(fed, [0, 5, 10, 15, 40, 45, 50, 55]);
        assert_eq!(protocol.step(60 * S, View { is_stopping: true, ..LIVE }), Some("STOPPING=1"));
        assert_eq!(protocol.step(70 * S, View { is_stopping: true, ..LIVE }), None);
    }

    #[test]
    fn a_status_is_sent_when_it_changes_or_is_old() {
        let mut protocol = Protocol::new(None);
        let sent: Vec<u64> = (0..30)
            .filter(|&s| protocol.status_due(s * S, if s < 5 { "starting" } else { "running" }))
            .collect();
        assert_eq!(sent, [0, 5, 15, 25]);
        assert_eq!(one_line("a\nREADY=1"), "a; READY=1");
    }
}
