//! Notifications to systemd, on a real socket; the reload of the configuration.

use crate::support::{Bench, Need, WATCHDOG, pid_of, send, skip};
use serde_json::Value;
use std::io::ErrorKind;
use std::os::linux::net::SocketAddrExt;
use std::os::unix::net::{SocketAddr, UnixDatagram};
use std::time::{Duration, Instant};

fn receive(socket: &UnixDatagram) -> String {
    let mut buffer = [0; 4096];
    socket.set_read_timeout(Some(WATCHDOG)).expect("a time");
    // Interrupted when this process was stopped and continued: signal(7), sockets with a timeout.
    let bytes = loop {
        match socket.recv(&mut buffer) {
            Err(error) if error.kind() == ErrorKind::Interrupted => {}
            result => break result.expect("a message comes"),
        }
    };
    String::from_utf8(buffer[..bytes].to_vec()).expect("it is text")
}

/// Messages up to the first that `wanted` is true of.
fn until(socket: &UnixDatagram, wanted: impl Fn(&str) -> bool) -> Vec<String> {
    let mut messages = Vec::new();
    loop {
        let message = receive(socket);
        let found = wanted(&message);
        messages.push(message);
        if found {
            return messages;
        }
    }
}

fn recognition(status: &Value) -> (u32, u64) {
    let process =
        status["processes"].as_array().expect("processes").iter().find(|p| p["role"] == "recognition");
    (pid_of(status, "recognition"), process.expect("recognition")["restarts"].as_u64().expect("a count"))
}

#[test]
fn ready_status_watchdog_reload_and_stop_are_notified() {
    let bench = Bench::new();
    bench.configure("[source]\nkind = \"scene\"\n");
    let path = bench.path("notify");
    let socket = UnixDatagram::bind(&path).expect("a socket");
    // A stage that dies is away for two seconds: ten times the interval of the watchdog messages.
    let wait = ["--set", "supervision.restart_longest_ms=2000", "--set", "supervision.restart_first_ms=2000"];
    let daemon = bench.start_with(
        &[&["run"][..], &wait].concat(),
        &[("NOTIFY_SOCKET", path.to_str().expect("text")), ("WATCHDOG_USEC", "400000")],
    );
    let before = until(&socket, |m| m == "READY=1");
    assert!(!before.iter().any(|m| m.contains("running")), "ready before it ran: {before:?}");
    let status = bench.status_when(|s| s["state"] == "running");
    assert!(status["frames"].as_u64() >= Some(1));
    let told = until(&socket, |m| m.starts_with("STATUS=running: "));
    let line = told.last().expect("a status");
    assert!(line.contains("frames a second, ") && line.contains("ms end to end"), "{line}");
    until(&socket, |m| m == "WATCHDOG=1");

    // While a stage is away the watchdog is not fed; when it is back, it is again.
    send(pid_of(&status, "stereo"), "KILL");
    let (mut last, mut longest) = (Instant::now(), Duration::ZERO);
    while longest < Duration::from_millis(1500) {
        until(&socket, |m| m == "WATCHDOG=1");
        longest = longest.max(last.elapsed());
        last = Instant::now();
    }
    bench.status_when(|s| s["state"] == "running");

    daemon.signal("HUP");
    let told = until(&socket, |m| m.starts_with("READY=1"));
    let begin = told.iter().find(|m| m.starts_with("RELOADING=1")).expect("it says that it reads again");
    assert!(
        begin.lines().any(|l| l.strip_prefix("MONOTONIC_USEC=").is_some_and(|n| n.parse::<u64>().is_ok()))
    );
    assert!(told.last().is_some_and(|m| m.contains("STATUS=the configuration was read again: nothing")));

    // Only the scheduler notifies.
    let stages = bench.status_when(|s| s["state"] == "running");
    let environment = std::fs::read(format!("/proc/{}/environ", pid_of(&stages, "road"))).expect("it runs");
    let environment = String::from_utf8_lossy(&environment).into_owned();
    assert!(!environment.contains("NOTIFY_SOCKET") && !environment.contains("WATCHDOG_"), "{environment}");

    daemon.signal("TERM");
    until(&socket, |m| m == "STOPPING=1");
    assert!(daemon.wait().status.success());
    bench.assert_clean();
}

#[test]
fn abstract_addresses_work_and_a_watchdog_of_another_process_is_not_fed() {
    let bench = Bench::new();
    bench.configure("[source]\nkind = \"scene\"\n");
    let name = format!("lookout-test-{}", bench.instance);
    let address = SocketAddr::from_abstract_name(&name).expect("a name");
    let socket = UnixDatagram::bind_addr(&address).expect("a socket");
    let daemon = bench.start_with(
        &["run"],
        &[("NOTIFY_SOCKET", &format!("@{name}")), ("WATCHDOG_USEC", "100000"), ("WATCHDOG_PID", "1")],
    );
    let mut told = until(&socket, |m| m.starts_with("STATUS=running"));
    daemon.signal("TERM");
    told.extend(until(&socket, |m| m == "STOPPING=1"));
    assert!(told.iter().any(|m| m == "READY=1") && !told.iter().any(|m| m == "WATCHDOG=1"), "{told:?}");
    assert!(daemon.wait().status.success());
    // An address without a listener does no harm.
    let daemon = bench.start_with(&["run"], &[("NOTIFY_SOCKET", "/no/such/socket")]);
    bench.status_when(|s| s["state"] == "running");
    daemon.signal("TERM");
    assert!(daemon.wait().status.success());
    bench.assert_clean();
}

#[test]
fn a_reload_restarts_the_affected_stages_and_refuses_fixed_keys() {
    let bench = Bench::new();
    let configure = |more: &str| bench.configure(&format!("[source]\nkind = \"scene\"\nseed = 1\n{more}"));
    configure("[alarm]\ndistance_m = 10\n");
    let path = bench.path("notify");
    let socket = UnixDatagram::bind(&path).expect("a socket");
    let daemon = bench.start_with(&["run"], &[("NOTIFY_SOCKET", path.to_str().expect("text"))]);
    let before = bench.status_when(|s| s["state"] == "running");
    until(&socket, |m| m == "READY=1");
    let answer = || {
        daemon.signal("HUP");
        let told = until(&socket, |m| m.starts_with("READY=1"));
        told.last().expect("an answer").clone()
    };

    configure("[alarm]\ndistance_m = 14\n");
    let text = answer();
    assert!(text.contains("STATUS=the configuration was read again; changed: alarm.distance_m"), "{text}");
    let after = bench.status_when(|s| s["state"] == "running" && recognition(s).0 != recognition(&before).0);
    assert_eq!(recognition(&after).1, 0, "that is no failure");
    for role in ["scheduler", "capture", "stereo", "road"] {
        assert_eq!(pid_of(&after, role), pid_of(&before, role), "{role}");
    }

    // A key that all stages share, an invalid value, a missing cascade: nothing is applied.
    bench.configure("[source]\nkind = \"scene\"\nseed = 2\n[alarm]\ndistance_m = 5\n");
    let text = answer();
    assert!(text.contains("and refused: source.seed cannot change while the daemon runs"), "{text}");
    configure("[alarm]\ndistance_m = \"near\"\n");
    let text = answer();
    assert!(
        text.contains("and refused") && text.contains("car.toml:17: alarm.distance_m = \"near\""),
        "{text}"
    );
    assert_eq!(text.lines().count(), 2, "{text}");
    configure("[recognition]\ncascade = \"gone.xml\"\n");
    let text = answer();
    assert!(text.contains("and refused: recognition.cascade: gone.xml"), "{text}");
    // So alarm.distance_m is still 14.
    configure("[alarm]\ndistance_m = 14\n");
    let text = answer();
    assert!(text.contains("nothing has changed"), "{text}");
    let last = bench.status_when(|s| s["state"] == "running");
    assert_eq!(recognition(&last), recognition(&after));
    daemon.signal("TERM");
    assert!(daemon.wait().status.success());
    bench.assert_clean();
}

#[test]
fn a_replay_ends_when_its_terminal_does() {
    // Under nohup SIGHUP is ignored, and the daemon inherits that from this process.
    if hang_up_is_ignored() {
        skip(Need::Hangup, "SIGHUP is ignored here (nohup?), so a daemon started from here ignores it, too");
        return;
    }
    let bench = Bench::new();
    let recording = bench.record("drive", 4);
    let daemon = bench.start(&["replay", &recording, "--fps", "10", "--loop", "--limit", "100000"]);
    bench.status_when(|s| s["frames"].as_u64().is_some_and(|frames| frames >= 1));
    daemon.signal("HUP");
    let output = daemon.wait();
    assert!(String::from_utf8_lossy(&output.stderr).contains("stopped by a signal"));
    bench.assert_clean();
}

/// Whether this process ignores SIGHUP, the first bit of the mask.
fn hang_up_is_ignored() -> bool {
    let status = std::fs::read_to_string("/proc/self/status").unwrap();
    let mask = status.lines().find_map(|line| line.strip_prefix("SigIgn:")).expect("the kernel tells");
    u64::from_str_radix(mask.trim(), 16).unwrap() & 1 == 1
}
