//! The viewer without a browser: what it serves, and which requests it refuses.

use crate::support::viewer::{Client, Viewer};
use crate::support::{Bench, WATCHDOG};
use std::io::Write;
use std::net::TcpStream;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

#[test]
fn parts_and_figures_come_without_a_browser() {
    let bench = Bench::new();
    bench.configure("[source]\nkind = \"scene\"\nseed = 1\nfps = 5\n");
    let daemon = bench.start(&["run"]);
    let viewer = Viewer::start(&bench, &[]);
    let mut page = viewer.socket();
    let (frame, parts) = page.frame();
    assert_eq!((&frame["width"], &frame["height"], parts.len()), (&640.into(), &480.into(), 4));
    for part in &parts[..3] {
        assert!(image::load_from_memory(part).unwrap().width() > 100);
    }
    assert!(parts[3].len().is_multiple_of(8) && parts[3].len() > 8000, "{}", parts[3].len());
    assert!(frame["latency_ms"].as_f64().unwrap() > 1.0);
    // A client that sends requests and reads no answer delays nobody.
    let mut mute = viewer.socket();
    (0..100).for_each(|_| mute.ask_only());
    // Frames come in order, each once.
    let (next, _) = page.frame();
    assert!(next["sequence"].as_u64() > frame["sequence"].as_u64());
    drop(mute);

    let start = std::time::Instant::now();
    let text = loop {
        // The first status is from before the stages were there.
        let text = viewer.get("/metrics", "");
        if text.contains("lookout_state{state=\"running\"} 1\n") {
            break text;
        }
        assert!(start.elapsed() < WATCHDOG, "it never ran: {text}");
        std::thread::sleep(std::time::Duration::from_millis(50));
    };
    for line in [
        "lookout_up 1\n",
        "lookout_process_up{process=\"stereo\"} 1\n",
        "# TYPE lookout_frames_total counter\n",
    ] {
        assert!(text.contains(line), "{line} is missing in {text}");
    }
    let status = viewer.get("/status.json", "");
    assert!(status.contains("\"processes\""), "{status}");
    daemon.signal("TERM");
    assert!(daemon.wait().status.success());
    let start = std::time::Instant::now();
    while !viewer.get("/metrics", "").contains("lookout_up 0\n") {
        assert!(start.elapsed() < WATCHDOG, "the end of the daemon was never noticed");
        std::thread::sleep(std::time::Duration::from_millis(50));
    }
    assert!(viewer.get("/status.json", "").starts_with("HTTP/1.1 503"));
    viewer.stop();
    bench.assert_clean();
}

#[test]
fn foreign_origins_and_malformed_requests_are_refused() {
    let bench = Bench::new();
    let viewer = Viewer::start(&bench, &[]);
    let upgrade = "Upgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Version: 13\r\n\
                   Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n";
    let starts =
        |answer: String, code: &str| assert!(answer.starts_with(&format!("HTTP/1.1 {code} ")), "{answer}");
    starts(viewer.get("/", ""), "200");
    starts(viewer.raw(b"GET / HTTP/1.1\r\nHost: evil.example\r\n\r\n"), "403");
    starts(viewer.raw(b"GET / HTTP/1.1\r\n\r\n"), "403");
    starts(viewer.get("/socket", &format!("{upgrade}Origin: http://evil.example\r\n")), "403");
    starts(viewer.get("/socket", ""), "426");
    starts(viewer.get("/../../etc/passwd", ""), "404");
    let twice = format!("GET / HTTP/1.1\r\nHost: {0}\r\nHost: {0}\r\n\r\n", viewer.address);
    starts(viewer.raw(twice.as_bytes()), "400");
    starts(viewer.raw(b"POST / HTTP/1.1\r\nHost: localhost\r\n\r\n"), "405");
    starts(viewer.get("/", &format!("X: {}\r\n", "y".repeat(20_000))), "431");
    starts(viewer.raw(b"\x16\x03\x01\x00\xa5\r\n\r\n"), "400");
    // RFC 6455 gives the answer to this key.
    let mut stream = TcpStream::connect(&viewer.address).unwrap();
    write!(stream, "GET /socket HTTP/1.1\r\nHost: {}\r\n{upgrade}\r\n", viewer.address).unwrap();
    let mut head = [0; 128];
    let count = std::io::Read::read(&mut stream, &mut head).unwrap();
    let head = String::from_utf8_lossy(&head[..count]);
    assert!(head.contains("101") && head.contains("s3pPLMBiTxaQ9kYGzzhZRbK+xOo="), "{head}");
    drop(stream);
    // Eight clients are served, the ninth is refused; idle connections do not take their places.
    let idle: Vec<TcpStream> = (0..8).map(|_| TcpStream::connect(&viewer.address).unwrap()).collect();
    let start = std::time::Instant::now();
    while !viewer.get("/metrics", "").contains("lookout_viewer_clients 0\n") {
        assert!(start.elapsed() < WATCHDOG, "a place was never given back");
    }
    let pages: Vec<_> = (0..8).map(|_| viewer.socket()).collect();
    starts(viewer.get("/socket", upgrade), "503");
    starts(viewer.get("/", ""), "200");
    drop((pages, idle));
    viewer.stop();

    let token = "a-token-of-our-own";
    let viewer = Viewer::start(&bench, &["--token", token]);
    assert!(viewer.link.ends_with(&format!("/?token={token}")), "{}", viewer.link);
    starts(viewer.get("/", ""), "401");
    starts(viewer.get("/metrics", "Authorization: Bearer wrong-wrong-wrong\r\n"), "401");
    starts(viewer.get("/metrics", &format!("Authorization: Bearer {token}\r\n")), "200");
    starts(viewer.get("/socket", upgrade), "403");
    let answer = viewer.get(&format!("/?token={token}"), "");
    assert!(answer.starts_with("HTTP/1.1 303 ") && answer.contains("HttpOnly; SameSite=Strict"), "{answer}");
    let cookie = answer.split("Set-Cookie: ").nth(1).and_then(|c| c.split(';').next()).unwrap();
    starts(viewer.get("/", &format!("Cookie: {cookie}\r\n")), "200");
    viewer.stop();
}

#[test]
fn an_address_that_cannot_be_served_is_reported_with_a_remedy() {
    let bench = Bench::new();
    let viewer = Viewer::start(&bench, &[]);
    let taken = bench.fails(&["view", "--bind", &viewer.address]);
    assert!(taken.contains(&viewer.address) && taken.contains("another port"), "{taken}");
    let weak = bench.fails(&["view", "--bind", "127.0.0.1:0", "--token", "1234"]);
    assert!(weak.contains("--token") && weak.contains("16"), "{weak}");
    let elsewhere = bench.fails(&["view", "--bind", "192.0.2.1:0"]);
    assert!(elsewhere.contains("address of this machine"), "{elsewhere}");
    // On any address other than loopback a token is always required.
    let open = Viewer::start(&bench, &["--bind", "0.0.0.0:0"]);
    assert!(open.link.contains("/?token="), "{}", open.link);
    open.stop();
    viewer.stop();
}

/// Connections that never finish their request: 200 are opened while this makes authorised requests.
fn ask_beside_slow_connections(viewer: &Viewer, more: &str) {
    let slow: Vec<TcpStream> = (0..200)
        .map(|_| {
            let mut stream = TcpStream::connect(&viewer.address).unwrap();
            stream.write_all(b"GET / HTTP/1.1\r\nX: ").unwrap();
            stream
        })
        .collect();
    let trickling = AtomicBool::new(true);
    std::thread::scope(|scope| {
        scope.spawn(|| {
            while trickling.load(Ordering::Relaxed) {
                // Those that were closed fail.
                slow.iter().for_each(|mut stream| drop(stream.write(b"x")));
                std::thread::sleep(Duration::from_millis(20));
            }
        });
        let answers: Vec<String> = (0..20).map(|_| viewer.get("/metrics", more)).collect();
        trickling.store(false, Ordering::Relaxed);
        let good = answers.iter().filter(|answer| answer.starts_with("HTTP/1.1 200 ")).count();
        assert_eq!(good, 20, "{answers:?}");
    });
}

#[test]
fn slow_connections_do_not_keep_out_those_that_ask() {
    let bench = Bench::new();
    // All come from the same address, with a token and without.
    let token = "a-token-of-our-own";
    let viewer = Viewer::start(&bench, &["--token", token]);
    ask_beside_slow_connections(&viewer, &format!("Authorization: Bearer {token}\r\n"));
    viewer.stop();
    let viewer = Viewer::start(&bench, &[]);
    ask_beside_slow_connections(&viewer, "");
    viewer.stop();
}

#[test]
fn pages_that_only_ping_leave_their_places() {
    let bench = Bench::new();
    let viewer = Viewer::start(&bench, &[]);
    let mut idle: Vec<_> = (0..8).map(|_| viewer.socket()).collect();
    let start = std::time::Instant::now();
    while !viewer.get("/metrics", "").contains("lookout_viewer_clients 0\n") {
        assert!(start.elapsed() < WATCHDOG, "pings hold the places for ever");
        // Fails once the viewer has closed the connection.
        idle.iter_mut().for_each(Client::ping);
        std::thread::sleep(Duration::from_millis(500));
    }
    let mut page = viewer.socket();
    let (answer, _) = page.ask();
    assert!(answer["absent"].is_string(), "{answer}");
    viewer.stop();
}

#[test]
fn a_stopped_daemon_is_told() {
    let bench = Bench::new();
    bench.configure("[source]\nkind = \"scene\"\nseed = 1\nfps = 5\n");
    let daemon = bench.start(&["run"]);
    bench.status_when(|status| status["state"] == "running");
    let viewer = Viewer::start(&bench, &[]);
    viewer.socket().frame();
    daemon.signal("STOP");
    let pid = daemon.pid();
    for args in [&["status"][..], &["status", "--watch"], &["record", "-o", "a.mcap"]] {
        let told = bench.fails(args);
        assert!(told.contains(&format!("process {pid}")) && told.contains("SIGSTOP"), "{args:?}: {told}");
    }
    let (mut page, start) = (viewer.socket(), std::time::Instant::now());
    loop {
        let (answer, _) = page.ask();
        if answer["absent"].as_str().is_some_and(|absent| absent.contains("SIGSTOP")) {
            break;
        }
        assert!(start.elapsed() < WATCHDOG, "the page never told it: {answer}");
    }
    daemon.signal("CONT");
    bench.status_when(|status| status["state"] == "running");
    page.frame();
    viewer.stop();
    daemon.signal("TERM");
    assert!(daemon.wait().status.success());
    bench.assert_clean();
}
