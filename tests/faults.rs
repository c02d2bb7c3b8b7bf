//! Faults: killed stages, signals, hostile messages, second instances.

use crate::support::{self, Bench, json, lines, pid_of, send};
use messages::bus::Bus;
use messages::header::{Header, Kind};
use messages::instance::Instance;
use messages::service::PAIR;

#[test]
fn any_stage_can_be_killed_and_results_go_on() {
    let bench = Bench::new();
    let recording = bench.record("drive", 10);
    let daemon = bench
        .start(&["replay", &recording, "--fps", "20", "--loop", "--limit", "100000", "--out", "results"]);
    let frames = |s: &serde_json::Value| s["frames"].as_u64().unwrap();
    bench.status_when(|s| s["state"] == "running" && frames(s) > 3);
    let mut files = 0;
    for (round, role) in ["capture", "stereo", "road", "recognition", "writer"].iter().enumerate() {
        let before = bench.status_when(|s| s["state"] == "running");
        let pid = pid_of(&before, role);
        send(pid, "KILL");
        let after = bench.status_when(|s| {
            let new = pid_of(s, role);
            s["state"] == "running" && new != pid && new != 0 && frames(s) > frames(&before) + 5
        });
        let process = after["processes"].as_array().unwrap().iter().find(|p| p["role"] == *role).unwrap();
        assert_eq!(process["restarts"], 1, "{role}");
        // A dead stage leaves nothing in shared memory: no growth from round to round.
        if round == 0 {
            files = bench.shared_files();
        } else {
            assert!(
                bench.shared_files() <= files + 2,
                "{role}: {} files, {files} before",
                bench.shared_files()
            );
        }
    }
    daemon.signal("TERM");
    let output = daemon.wait();
    // A replay that was stopped has failed.
    assert_eq!(output.status.code(), Some(1));
    assert!(String::from_utf8_lossy(&output.stderr).contains("stopped by a signal"));
    bench.assert_clean();
    assert_eq!(json(&bench.path("results/summary.json"))["restarts"], 5);
    let sequences: Vec<u64> =
        lines(&bench.path("results")).iter().map(|l| l["sequence"].as_u64().unwrap()).collect();
    assert!(sequences.windows(2).all(|w| w[0] < w[1]), "frames came twice or out of order: {sequences:?}");
}

#[test]
fn signals_drain_and_leave_nothing() {
    for signal in ["INT", "TERM"] {
        let bench = Bench::new();
        bench.configure("[source]\nkind = \"scene\"\n");
        let daemon = bench.start(&["run"]);
        let status = bench.status_when(|s| s["frames"].as_u64().unwrap() >= 1);
        let stages: Vec<u32> =
            ["capture", "stereo", "road", "recognition"].map(|r| pid_of(&status, r)).into();
        daemon.signal(signal);
        let output = daemon.wait();
        assert!(output.status.success(), "{signal}: {}", String::from_utf8_lossy(&output.stderr));
        bench.assert_clean();
        for pid in stages {
            assert!(!std::path::Path::new(&format!("/proc/{pid}")).exists(), "{pid} still runs");
        }
        assert!(bench.fails(&["status"]).contains("no daemon named"));
    }
}

#[test]
fn a_killed_scheduler_takes_its_stages_along_and_the_next_run_cleans_up() {
    let bench = Bench::new();
    bench.configure("[source]\nkind = \"scene\"\n");
    let daemon = bench.start(&["run"]);
    let status = bench.status_when(|s| s["frames"].as_u64().unwrap() >= 1);
    daemon.signal("KILL");
    daemon.wait();
    let stereo = format!("/proc/{}", pid_of(&status, "stereo"));
    let start = std::time::Instant::now();
    while std::path::Path::new(&stereo).exists() {
        // A process that has died but was not reaped by init yet counts as gone.
        let state = std::fs::read_to_string(format!("{stereo}/stat")).unwrap_or_default();
        if state.rsplit(')').next().is_none_or(|s| s.trim_start().starts_with('Z')) {
            break;
        }
        assert!(start.elapsed() < support::WATCHDOG, "the stereo stage outlived its scheduler");
        std::thread::sleep(std::time::Duration::from_millis(10));
    }
    let recording = bench.record("drive", 2);
    bench.ok(&["replay", &recording, "--lockstep"]);
    bench.assert_clean();
}

#[test]
fn a_second_instance_is_refused_and_the_first_goes_on() {
    let bench = Bench::new();
    bench.configure("[source]\nkind = \"scene\"\n");
    let daemon = bench.start(&["run"]);
    let first = bench.status_when(|s| s["frames"].as_u64().unwrap() >= 1);
    let error = bench.fails(&["run"]);
    assert!(error.contains("already running") && error.contains(&daemon.pid().to_string()), "{error}");
    let frames = first["frames"].as_u64().unwrap();
    bench.status_when(|s| s["frames"].as_u64().unwrap() > frames);
    daemon.signal("TERM");
    assert!(daemon.wait().status.success());
    bench.assert_clean();
}

#[test]
fn hostile_messages_are_counted_and_skipped() {
    let bench = Bench::new();
    bench.configure("[source]\nkind = \"scene\"\nfps = 5.0\n");
    let daemon = bench.start(&["run"]);
    bench.status_when(|s| s["frames"].as_u64().unwrap() >= 1);
    {
        // Another process of this user may publish whatever it likes.
        let bus = Bus::join(&Instance::new(&bench.instance, &bench.path("run"))).unwrap();
        let publisher = bus.publisher(&PAIR, 640, 480).unwrap();
        let mut random = fastrand::Rng::with_seed(5);
        for round in 0..60 {
            // Some are as long as an honest pair, so that they pass the check of the length.
            let honest = round % 8 == 0;
            let bytes = if honest { 2 * 640 * 480 } else { random.usize(1..5000) };
            let mut loan = publisher.loan(bytes).unwrap();
            loan.payload_mut().iter_mut().for_each(|b| *b = random.u8(..));
            let mut header = Header::new(if honest || round % 3 == 0 { Kind::Pair } else { Kind::Status });
            (header.width, header.height) = (random.u32(..), random.u32(..9000));
            if round % 4 == 0 {
                (header.width, header.height) = (640, 480);
            }
            header.sequence = random.u64(..);
            header.capture_ns = random.u64(..);
            *loan.header_mut() = header;
            publisher.send(loan).unwrap();
            std::thread::sleep(std::time::Duration::from_millis(5));
        }
    }
    let refused = |s: &serde_json::Value| {
        s["processes"].as_array().unwrap().iter().find(|p| p["role"] == "stereo").unwrap()["refused"]
            .as_u64()
            .unwrap()
    };
    let after = bench.status_when(|s| refused(s) > 0);
    let frames = after["frames"].as_u64().unwrap();
    let later = bench.status_when(|s| s["frames"].as_u64().unwrap() > frames);
    let restarts: u64 =
        later["processes"].as_array().unwrap().iter().map(|p| p["restarts"].as_u64().unwrap()).sum();
    assert_eq!(restarts, 0, "{later}");
    daemon.signal("TERM");
    assert!(daemon.wait().status.success());
    bench.assert_clean();
}

#[test]
fn a_crash_loop_is_given_up_with_its_reason() {
    let bench = Bench::new();
    let recording = bench.record("drive", 10);
    let text = std::fs::read_to_string(bench.path("car.toml")).unwrap();
    std::fs::write(bench.path("car.toml"), text.replace("restart_count = 100", "restart_count = 1")).unwrap();
    let daemon = bench.start(&["replay", &recording, "--fps", "20", "--loop", "--limit", "100000"]);
    let status = bench.status_when(|s| s["frames"].as_u64().unwrap() >= 1);
    let pid = pid_of(&status, "road");
    send(pid, "KILL");
    let status = bench.status_when(|s| s["state"] == "running" && pid_of(s, "road") != pid);
    send(pid_of(&status, "road"), "KILL");
    let output = daemon.wait();
    assert_eq!(output.status.code(), Some(1));
    let errors = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(errors.contains("road failed 2 times"), "{errors}");
    bench.assert_clean();
}
