//! `lookout bridge` and `lookout fleet` on a network of their own. Built with the feature `zenoh` alone; `features.rs` tests
//! what a build without it says.
//!
//! `LOOKOUT_BRIDGE_SECONDS=60 cargo test --release -p lookout --features zenoh --test bridge every_event -- --nocapture`
//! replays for a minute; the default is 25 s.

// Also here, because `.ci/run` builds this program with every feature: a program of its own would link the daemon
// once more.
#[cfg(feature = "can")]
mod can_out;
mod support;

use serde_json::Value;
use std::io::{BufRead, BufReader, Write};
use std::net::TcpListener;
use std::path::Path;
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};
use std::time::{Duration, Instant};
use support::{Bench, Daemon, Need, WATCHDOG, lines, python, skip};

/// Rate of the replay with kills, in pairs a second.
const FPS: u64 = 8;

/// Length of that replay in seconds, unless `LOOKOUT_BRIDGE_SECONDS` says another.
const SECONDS: u64 = 25;

/// Kills of the bridge.
const KILLS: u64 = 2;

/// Frames that the daemon processes while the bridge is stopped.
const STOPPED_FRAMES: u64 = 60;

/// Bytes of the header of a PLY file, at least.
const PLY_HEADER: u64 = 200;

/// An endpoint that nobody uses.
fn endpoint() -> String {
    let listener = TcpListener::bind("127.0.0.1:0").expect("a free port");
    format!("tcp/{}", listener.local_addr().expect("an address"))
}

/// The table `[bridge]` of a test.
fn configure(bench: &Bench, more: &str) {
    let spool = bench.path("spool").display().to_string();
    bench
        .configure(&format!("[bridge]\nfleet = \"north\"\nvehicle = \"car-7\"\nspool = \"{spool}\"\n{more}"));
}

fn start_bridge(bench: &Bench) -> Daemon {
    bench.start(&["bridge", "-c", "car.toml"])
}

/// Ends a bridge, which ends well.
fn end(bridge: Daemon) {
    bridge.signal("TERM");
    let output = bridge.wait();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
}

/// Waits until something is so.
fn wait_until(what: &str, mut is_so: impl FnMut() -> bool) {
    let begin = Instant::now();
    while !is_so() {
        assert!(begin.elapsed() < WATCHDOG, "{what}");
        std::thread::sleep(Duration::from_millis(50));
    }
}

/// The router and subscriber in Python.
struct Subscriber {
    child: Child,
    input: ChildStdin,
    output: BufReader<ChildStdout>,
}

impl Subscriber {
    fn start(python: &str, endpoint: &str) -> Self {
        let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/bridge/subscribe.py");
        let mut command = Command::new(python);
        command.arg(script).arg(endpoint).stdin(Stdio::piped()).stdout(Stdio::piped());
        let mut child = command.spawn().expect("Python starts");
        let input = child.stdin.take().expect("an input");
        let output = BufReader::new(child.stdout.take().expect("an output"));
        let mut subscriber = Self { child, input, output };
        assert_eq!(subscriber.line(), "ready\n");
        subscriber
    }

    fn line(&mut self) -> String {
        let mut line = String::new();
        self.output.read_line(&mut line).expect("text");
        line
    }

    /// The point clouds that vehicles answer with (length and first bytes), and errors.
    fn clouds(&mut self) -> Value {
        writeln!(self.input, "cloud").expect("it reads");
        serde_json::from_str(&self.line()).expect("JSON")
    }

    /// All that it got.
    fn end(mut self) -> Value {
        drop(self.input);
        let mut line = String::new();
        self.output.read_line(&mut line).expect("text");
        assert!(self.child.wait().expect("it ends").success());
        serde_json::from_str(&line).expect("JSON")
    }
}

/// Frame and level of each change of the alarm in `obstacles.jsonl`.
fn changes(results: &[Value]) -> Vec<(u64, String)> {
    let changed = results.iter().filter(|line| line["alarm"]["changed"] == true);
    changed.map(|line| (number(&line["sequence"]), text(&line["alarm"]["level"]))).collect()
}

fn number(value: &Value) -> u64 {
    value.as_u64().expect("a number")
}

fn text(value: &Value) -> String {
    value.as_str().expect("a text").to_owned()
}

/// The frame of the last change that the daemon knows.
fn last_change(bench: &Bench) -> Option<u64> {
    let status = bench.status_when(|_| true);
    status["alarm_changes"].as_array()?.last()?["sequence"].as_u64()
}

#[test]
fn every_event_arrives_although_the_bridge_is_killed_twice() {
    let bench = Bench::new();
    let Some(python) = python("numpy, rosbags.typesys, zenoh", "eclipse-zenoh rosbags") else { return };
    let seconds = std::env::var("LOOKOUT_BRIDGE_SECONDS")
        .map_or(SECONDS, |text| text.parse().expect("LOOKOUT_BRIDGE_SECONDS is a number of seconds"));
    let endpoint = endpoint();
    configure(&bench, &format!("connect = \"{endpoint}\"\nros2 = true\nros2_images_hz = 2\n"));
    let mut subscriber = Subscriber::start(&python, &endpoint);
    let recording = bench.record("drive", 40);
    let mut bridge = start_bridge(&bench);
    let limit = (seconds * FPS).to_string();
    let replay = bench.start(&[
        "replay",
        &recording,
        "--fps",
        &FPS.to_string(),
        "--loop",
        "--limit",
        &limit,
        "--out",
        "out",
    ]);
    for part in 1..=KILLS {
        bench.status_when(|status| number(&status["frames"]) > part * seconds * FPS / 4);
        bridge.signal("KILL");
        drop(bridge);
        // It stays away until it has missed a change.
        let before = last_change(&bench);
        wait_until("no change while the bridge was away", || last_change(&bench) != before);
        bridge = start_bridge(&bench);
    }
    // The bridge may have to connect first.
    let mut answer = Value::Null;
    wait_until("no point cloud", || {
        answer = subscriber.clouds();
        answer["clouds"].as_array().is_some_and(|clouds| !clouds.is_empty())
    });
    let cloud = &answer["clouds"][0];
    assert_eq!((cloud[1].as_str(), number(&cloud[0]) > PLY_HEADER), (Some("ply"), true), "{answer}");
    assert!(replay.wait().status.success());
    // The withdrawal of the last result is the last event.
    let spool = bench.path("spool/north/car-7");
    let is_withdrawn = || {
        let files = std::fs::read_dir(&spool).expect("a folder").flatten();
        let events =
            files.filter(|file| file.path().extension().is_some_and(|extension| extension == "json"));
        events.map(|file| support::json(&file.path())).any(|event| event["withdrawn"] == true)
    };
    wait_until("the end of the daemon is no event", is_withdrawn);
    std::thread::sleep(Duration::from_secs(1));
    let got = subscriber.end();
    end(bridge);
    println!("{seconds} s of replay, {KILLS} kills of the bridge");
    check_events(&got, &changes(&lines(&bench.path("out"))));
    check_ros(&got);
    bench.assert_clean();
}

/// Compares the events that came with the changes that the replay has written.
fn check_events(got: &Value, expected: &[(u64, String)]) {
    assert_eq!(got["problems"], Value::Array(Vec::new()));
    let events = got["events"]["lookout/north/car-7"].as_array().expect("events");
    let numbers: Vec<u64> = events.iter().map(|event| number(&event["event"])).collect();
    assert_eq!(numbers, (1..=events.len() as u64).collect::<Vec<_>>(), "no number is missing");
    assert!(expected.len() >= 4, "the replay has hardly any change: {expected:?}");
    for (place, (sequence, level)) in expected.iter().enumerate() {
        // Where both the scheduler and the bridge were overtaken, the frame is a later one.
        let next = expected.get(place + 1).map_or(u64::MAX, |(next, _)| *next);
        let is_it = |event: &&Value| {
            event["to"] == **level && (*sequence..next).contains(&number(&event["sequence"]))
        };
        assert_eq!(events.iter().filter(is_it).count(), 1, "{level} in frame {sequence}: {events:#?}");
    }
    let last = events.last().expect("an event");
    assert_eq!((&last["withdrawn"], &last["to"]), (&true.into(), &"off".into()));
    assert!(events.iter().any(|event| event["in_time"] == false), "each kill cost a change: {events:#?}");
    assert!(number(&got["appeared"]) > KILLS, "the token of each of three bridges: {got}");
    // Most were seen in time, and have pictures.
    let pictures = got["pictures"].as_object().expect("pictures");
    assert!(!pictures.is_empty());
    for topic in ["obstacles", "alarm", "motion", "status"] {
        assert!(got["topics"][topic].as_u64() > Some(0), "{topic}: {}", got["topics"]);
    }
    println!(
        "{} changes, {} events, pictures of {}, {}",
        expected.len(),
        events.len(),
        pictures.len(),
        got["topics"]
    );
}

/// Checks what the messages of ROS 2 said; that each could be decoded, the subscriber has checked.
fn check_ros(got: &Value) {
    let ros = &got["ros"];
    let boxes = ros["vision_msgs/msg/Detection3DArray"]["boxes"].as_array().expect("boxes");
    assert!(
        boxes.iter().all(|of| of[2].as_f64() > Some(0.5) && of[3].as_f64() > Some(0.0)) && !boxes.is_empty()
    );
    let map = &ros["stereo_msgs/msg/DisparityImage"];
    assert_eq!(
        (&map["size"], &map["f"], &map["min"]),
        (&serde_json::json!([240, 320]), &440.0.into(), &(-1.0).into())
    );
    assert!((1.0..32.0).contains(&map["max"].as_f64().expect("a number")), "{map}");
    let image = &ros["sensor_msgs/msg/Image"];
    assert_eq!((&image["encoding"], &image["bytes"]), (&"mono8".into(), &(240 * 320).into()));
    assert!(ros["nav_msgs/msg/Odometry"]["count"].as_u64() > Some(0), "{ros}");
    let names = ros["diagnostic_msgs/msg/DiagnosticArray"]["names"].as_array().expect("names");
    assert_eq!(names[0], "lookout");
    // The bridge's node and its five publishers.
    let graph = got["graph"].as_array().expect("tokens");
    assert_eq!(graph.len(), 6, "{graph:?}");
}

/// Waits until a list of `lookout fleet` has one vehicle, with a state.
fn wait_for_state(state: &str, mut list: impl FnMut() -> Value) {
    wait_until(&format!("the fleet does not see: {state}"), || has_state(&list(), state));
}

fn has_state(list: &Value, state: &str) -> bool {
    list[0]["vehicle"] == "car-7" && list[0]["state"] == state
}

#[test]
fn a_bridge_that_is_flooded_killed_and_stopped_changes_no_frame_and_the_fleet_sees_it() {
    let bench = Bench::new();
    let endpoint = endpoint();
    configure(
        &bench,
        &format!(
            "mode = \"peer\"\nconnect = \"\"\nlisten = \"{endpoint}\"\nros2 = true\nros2_hz = 100\nros2_images_hz = 100\n\
             obstacles_hz = 100\nalarm_hz = 100\nmotion_hz = 100\nstatus_hz = 1\nbuffer_mb = 1\n"
        ),
    );
    let recording = bench.record("drive", 60);
    let mut bridge = start_bridge(&bench);
    let set = format!("bridge.connect={endpoint}");
    let list = || {
        let output = bench.run(&["fleet", "--json", "--set", &set]);
        serde_json::from_slice::<Value>(&output.stdout).unwrap_or_default()
    };
    // In lock-step, until all of this has happened to the bridge.
    let daemon = bench.start(&["replay", &recording, "--lockstep", "--loop", "--out", "with"]);
    wait_for_state("running", list);
    for _ in 0..KILLS {
        bridge.signal("KILL");
        drop(bridge);
        bridge = start_bridge(&bench);
        wait_for_state("running", list);
    }
    // It does not move any more, and its network and its places in shared memory are as they are.
    bridge.signal("STOP");
    let stopped_at = number(&bench.status_when(|_| true)["frames"]);
    bench.status_when(|status| number(&status["frames"]) > stopped_at + STOPPED_FRAMES);
    daemon.signal("TERM");
    assert!(daemon.wait().status.success());
    bridge.signal("CONT");
    wait_for_state("no daemon", list);
    let all = list();
    assert_eq!((&all[0]["fleet"], &all[0]["version"]), (&"north".into(), &env!("CARGO_PKG_VERSION").into()));
    assert!(all[0]["events"].as_u64() > Some(1), "{all}");
    let shown = bench.ok(&["fleet", "--set", &set, "--fleet", "north"]);
    assert!(shown.contains("car-7") && shown.ends_with("1 connected\n"), "{shown}");
    end(bridge);
    let error = bench.fails(&["fleet", "--set", &set]);
    assert!(error.contains("bridge.connect") && error.contains("start a router there"), "{error}");
    // The same frames without a bridge.
    let frames = lines(&bench.path("with")).len();
    assert!(frames as u64 > stopped_at + STOPPED_FRAMES, "{frames} frames");
    let limit = frames.to_string();
    bench.ok(&["replay", &recording, "--lockstep", "--loop", "--limit", &limit, "--out", "without"]);
    let read = |name: &str| std::fs::read(bench.path(name).join("obstacles.jsonl")).expect("results");
    assert!(read("without") == read("with"), "the bridge has changed one of {frames} frames");
    println!("{frames} frames in lock-step, {KILLS} kills of the bridge and a stop: no difference");
    bench.assert_no_memory_left();
    // A bridge that stood still while its daemon ended may put an empty folder back, which the next run takes for
    // somebody else's.
    let left = bench.left_in_run_folder();
    assert!(left.is_empty(), "{left:?}");
}

/// The lists that `lookout fleet --watch --json` has written to a file so far.
fn watched(bench: &Bench, file: &str) -> Vec<Value> {
    let text = std::fs::read_to_string(bench.path(file)).expect("a file");
    // The last line may still be in the making.
    let whole = text.split_inclusive('\n').filter(|line| line.ends_with('\n'));
    whole.map(|line| serde_json::from_str(line).expect("a document a line")).collect()
}

#[test]
fn the_watched_fleet_follows_a_vehicle_and_its_daemon() {
    let bench = Bench::new();
    let endpoint = endpoint();
    configure(&bench, &format!("mode = \"peer\"\nconnect = \"\"\nlisten = \"{endpoint}\"\nstatus_hz = 1\n"));
    let recording = bench.record("drive", 20);
    let bridge = start_bridge(&bench);
    let set = format!("bridge.connect={endpoint}");
    wait_until("the bridge does not listen", || bench.run(&["fleet", "--set", &set]).status.success());
    let begin = Instant::now();
    let as_json = bench.start_into("watched.jsonl", &["fleet", "--watch", "--json", "--set", &set]);
    let as_text = bench.start_into("watched.txt", &["fleet", "--watch", "--set", &set]);
    let last = || watched(&bench, "watched.jsonl").pop().unwrap_or_default();
    let table = || std::fs::read_to_string(bench.path("watched.txt")).expect("a file");
    wait_for_state("no daemon", last);
    let daemon = bench.start(&["replay", &recording, "--fps", "10", "--loop"]);
    wait_for_state("running", last);
    wait_until("the table does not show the daemon", || table().contains("running"));
    daemon.signal("TERM");
    assert!(daemon.wait().status.success());
    wait_for_state("no daemon", last);
    // Without a connection the list is empty; the vehicle returns by itself.
    bridge.signal("KILL");
    drop(bridge);
    wait_until("the fleet keeps a vehicle that is gone", || last() == Value::Array(Vec::new()));
    wait_until("the table keeps a vehicle that is gone", || table().ends_with("\n0 connected\n"));
    let bridge = start_bridge(&bench);
    wait_for_state("no daemon", last);
    // Every two seconds, the first at once.
    let lists = watched(&bench, "watched.jsonl").len() as u64;
    let seconds = begin.elapsed().as_secs();
    assert!((5..=seconds / 2 + 1).contains(&lists), "{lists} lists in {seconds} s");
    for watch in [as_json, as_text] {
        end(watch);
    }
    let text = table();
    assert!(text.starts_with("fleet ") && text.ends_with(" connected\n"), "{text}");
    // Only the screen of a terminal is cleared.
    assert!(!text.contains('\u{1b}'), "{text}");
    end(bridge);
    bench.assert_clean();
}

/// A key with a certificate that the test's authority has signed for this machine; the authority is made first.
fn certificates(bench: &Bench) -> bool {
    let script = "set -e
        new='-newkey ec -pkeyopt ec_paramgen_curve:prime256v1 -nodes'
        openssl req -x509 $new -days 2 -subj /CN=test -addext basicConstraints=critical,CA:TRUE -keyout ca.key -out ca.pem
        openssl req $new -subj /CN=car-7 -keyout car.key -out car.csr
        printf 'subjectAltName=DNS:localhost,IP:127.0.0.1' >names
        openssl x509 -req -in car.csr -CA ca.pem -CAkey ca.key -CAcreateserial -days 2 -extfile names -out car.pem";
    if Command::new("openssl").arg("version").output().is_err() {
        skip(Need::OpenSsl, "no openssl for certificates");
        return false;
    }
    let made =
        Command::new("sh").args(["-c", script]).current_dir(bench.folder.path()).output().expect("sh runs");
    assert!(made.status.success(), "{}", String::from_utf8_lossy(&made.stderr));
    true
}

#[test]
fn certificates_are_asked_of_both_sides() {
    let bench = Bench::new();
    if !certificates(&bench) {
        return;
    }
    let endpoint = endpoint().replace("tcp/127.0.0.1", "tls/localhost");
    let all = "tls_ca = \"ca.pem\"\ntls_certificate = \"car.pem\"\ntls_key = \"car.key\"\n";
    configure(&bench, &format!("mode = \"peer\"\nconnect = \"\"\nlisten = \"{endpoint}\"\n{all}"));
    let bridge = start_bridge(&bench);
    let connect = format!("bridge.connect={endpoint}");
    let mut list = String::new();
    wait_until("no connection with certificates", || {
        let output = bench.run(&["fleet", "-c", "car.toml", "--set", &connect]);
        list = String::from_utf8_lossy(&output.stdout).into_owned();
        list.contains("car-7")
    });
    // Without a certificate, without the authority, without encryption.
    let plain = format!("bridge.connect={}", endpoint.replace("tls/", "tcp/"));
    let ca = format!("bridge.tls_ca={}", bench.path("ca.pem").display());
    for settings in [&["--set", &connect, "--set", &ca][..], &["--set", &connect], &["--set", &plain]] {
        let error = bench.fails(&[&["fleet"], settings].concat());
        assert!(error.contains("start a router there"), "{settings:?}: {error}");
    }
    end(bridge);
}

#[test]
fn what_cannot_be_used_is_refused_with_a_remedy() {
    let bench = Bench::new();
    configure(&bench, "");
    let error = bench.fails(&["bridge", "-c", "car.toml", "--set", "bridge.vehicle=a/b"]);
    assert!(error.contains("bridge.vehicle = \"a/b\""), "{error}");
    let error = bench.fails(&["bridge", "-c", "car.toml", "--set", "bridge.connect=nowhere"]);
    assert!(error.contains("bridge.connect"), "{error}");
    let error = bench.fails(&["bridge", "-c", "car.toml", "--set", "bridge.tls_key=key.pem"]);
    assert!(error.contains("give both, or none"), "{error}");
    let bridge = start_bridge(&bench);
    wait_until("the bridge uses no folder", || bench.path("spool/north/car-7/lock").exists());
    let mut error = String::new();
    wait_until("a second bridge of the vehicle is not refused", || {
        error = bench.fails(&["bridge", "-c", "car.toml"]);
        error.contains("another lookout bridge uses it")
    });
    end(bridge);
}
