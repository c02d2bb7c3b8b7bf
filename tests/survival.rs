//! Faults that a daemon in permanent operation survives and reports: stages that hang, exit or run out of memory, a
//! source that disappears, full shared memory.

use crate::support::viewer::Viewer;
use crate::support::{Bench, Need, WATCHDOG, pid_of, process, send, skip};
use messages::bus::Bus;
use messages::header::Header;
use messages::instance::Instance;
use messages::obstacles::{self, Newest};
use messages::service::OBSTACLES;
use messages::wait::{self, Next};
use rustix::process::{Pid, Resource, Rlimit, prlimit};
use std::io::Write;
use std::path::Path;
use std::process::{Command, Stdio};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

const STAGES: [&str; 4] = ["capture", "stereo", "road", "recognition"];

fn frames(status: &serde_json::Value) -> u64 {
    status["frames"].as_u64().unwrap()
}

fn reason(status: &serde_json::Value) -> &str {
    status["reason"].as_str().unwrap()
}

/// Configures a daemon that runs for ever on a repeated recording.
fn endless(bench: &Bench, more: &str) -> String {
    let recording = bench.record("drive", 8);
    bench.configure(&format!(
        "{more}[source]\nkind = \"folder\"\npath = \"{recording}\"\nrepeat = true\nfps = 20.0\n"
    ));
    recording
}

#[test]
fn a_stage_that_is_stopped_or_leaves_is_replaced() {
    let bench = Bench::new();
    endless(&bench, "");
    let daemon = bench.start(&["run", "--set", "supervision.liveness_deadline_ms=4000"]);
    for (role, signal) in STAGES.into_iter().map(|r| (r, "STOP")).chain([("road", "TERM")]) {
        let before = bench.status_when(|s| s["state"] == "running" && frames(s) > 3);
        let pid = pid_of(&before, role);
        // After SIGSTOP it is alive and silent; after SIGTERM it exits with code 0.
        send(pid, signal);
        let after = bench.status_when(|s| {
            let new = pid_of(s, role);
            s["state"] == "running" && new != pid && new != 0 && frames(s) > frames(&before) + 5
        });
        assert!(!Path::new(&format!("/proc/{pid}")).exists(), "{role}: the stopped one still exists");
        assert!(process(&after, role)["restarts"].as_u64().unwrap() >= 1, "{role}");
    }
    daemon.signal("TERM");
    assert!(daemon.wait().status.success());
    bench.assert_clean();
}

#[test]
fn out_of_memory_degrades_with_a_reason_and_recovers() {
    let bench = Bench::new();
    endless(&bench, "");
    let daemon = bench.start(&[
        "run",
        "--set",
        "supervision.restart_count=2",
        "--set",
        "supervision.retry_s=1",
        "--set",
        "stereo.disparities=200",
    ]);
    let before = bench.status_when(|s| s["state"] == "running" && frames(s) > 3);
    // Processes that the scheduler starts from now on get less memory than the stereo stage needs, but more than the
    // scheduler itself uses.
    let data_kib = |pid: u32| -> u64 {
        let text = std::fs::read_to_string(format!("/proc/{pid}/status")).unwrap();
        let line = text.lines().find_map(|l| l.strip_prefix("VmData:")).unwrap();
        line.split_ascii_whitespace().next().unwrap().parse().unwrap()
    };
    let (own, needed) = (data_kib(daemon.pid()), data_kib(pid_of(&before, "stereo")));
    let limit = needed * 3 / 4;
    assert!(own + 1024 < limit, "the scheduler has {own} KiB, the stereo stage {needed}");
    let scheduler = Pid::from_raw(daemon.pid() as i32).unwrap();
    let limit = Rlimit { current: Some(limit << 10), maximum: None };
    let old = prlimit(Some(scheduler), Resource::Data, limit).unwrap();
    send(pid_of(&before, "stereo"), "KILL");
    let degraded = bench.status_when(|s| s["state"] == "degraded");
    assert!(reason(&degraded).contains("stereo failed 3 times"), "{degraded}");
    assert_eq!((&degraded["alarm"], pid_of(&degraded, "stereo")), (&"off".into(), 0), "{degraded}");
    for role in ["capture", "road", "recognition"] {
        assert_eq!(pid_of(&degraded, role), pid_of(&before, role), "{role} was left alone");
    }
    // It is retried, and given up again.
    bench.status_when(|s| s["state"] == "degraded" && reason(s).contains("failed again"));
    prlimit(Some(scheduler), Resource::Data, old).unwrap();
    let healed = bench.status_when(|s| s["state"] == "running" && frames(s) > frames(&degraded) + 5);
    assert_eq!(reason(&healed), "");
    daemon.signal("TERM");
    let output = daemon.wait();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    bench.assert_clean();
}

#[test]
fn a_stage_that_was_given_up_is_retried_on_sigusr1() {
    let bench = Bench::new();
    endless(&bench, "");
    let daemon =
        bench.start(&["run", "--set", "supervision.restart_count=0", "--set", "supervision.retry_s=0"]);
    let before = bench.status_when(|s| s["state"] == "running" && frames(s) > 3);
    send(pid_of(&before, "road"), "KILL");
    let degraded = bench.status_when(|s| s["state"] == "degraded");
    assert!(reason(&degraded).contains("road failed 1 times"), "{degraded}");
    daemon.signal("USR1");
    bench.status_when(|s| s["state"] == "running" && frames(s) > frames(&degraded) + 3);
    daemon.signal("TERM");
    assert!(daemon.wait().status.success());
}

#[test]
fn a_source_that_goes_away_is_waited_for() {
    let bench = Bench::new();
    let recording = endless(&bench, "");
    let daemon = bench.start(&["run", "--set", "source.strict=true"]);
    let before = bench.status_when(|s| s["state"] == "running" && frames(s) > 3);

    // Missing: the file is named, the stages keep running, and results return with the file.
    let picture = Path::new(&recording).join("left/000005.png");
    let away = Path::new(&recording).join("away.png");
    std::fs::rename(&picture, &away).unwrap();
    let degraded = bench.status_when(|s| s["state"] == "degraded");
    assert!(reason(&degraded).contains("left/000005.png"), "{degraded}");
    let off = bench.status_when(|s| s["alarm"] == "off");
    assert_eq!(pid_of(&off, "capture"), pid_of(&before, "capture"), "it was not restarted");
    std::fs::rename(&away, &picture).unwrap();
    let back = bench.status_when(|s| s["state"] == "running" && frames(s) > frames(&degraded) + 5);
    assert_eq!(reason(&back), "");

    daemon.signal("TERM");
    assert!(daemon.wait().status.success());
    bench.assert_clean();
}

#[test]
fn a_stalled_source_does_not_restart_its_stage() {
    let bench = Bench::new();
    let recording = endless(&bench, "[pacing]\nstall_ms = 300\n");
    let daemon = bench.start(&["run"]);
    bench.status_when(|s| s["state"] == "running" && frames(s) > 3);
    // A read that blocks for ever, as on a lost network.
    let picture = Path::new(&recording).join("left/000005.png");
    let [pipe, away] = ["pipe", "away"].map(|name| Path::new(&recording).join(name));
    std::fs::copy(&picture, &away).unwrap();
    assert!(Command::new("mkfifo").arg(&pipe).status().unwrap().success());
    std::fs::rename(&pipe, &picture).unwrap();
    let stalled = bench.status_when(|s| s["state"] == "degraded");
    assert!(reason(&stalled).contains("stalled: pair"), "{stalled}");
    let later = bench.status_when(|s| s["alarm"] == "off");
    let restarts: u64 = STAGES.iter().map(|r| process(&later, r)["restarts"].as_u64().unwrap()).sum();
    assert_eq!(restarts, 0, "nobody is at fault but the source: {later}");
    // The blocked read returns an end of file, finds no image, and is tried again.
    let end = std::fs::OpenOptions::new().write(true).open(&picture).unwrap();
    std::fs::rename(&away, &picture).unwrap();
    drop(end);
    let back = bench.status_when(|s| s["state"] == "running" && frames(s) > frames(&later) + 5);
    assert_eq!(reason(&back), "");
    daemon.signal("TERM");
    assert!(daemon.wait().status.success());
    bench.assert_clean();
}

/// The newest valid message, once it is as wanted.
fn obstacles_when(bench: &Bench, wanted: impl Fn(&Header, u32) -> bool) -> Header {
    let bus = Bus::join(&Instance::new(&bench.instance, &bench.path("run"))).unwrap();
    let results = bus.subscriber(&OBSTACLES).unwrap();
    let (mut newest, mut found) = (Newest::default(), None);
    let start = Instant::now();
    wait::run::<messages::bus::IpcError>(&[&results], || {
        while let Some(sample) = results.receive()? {
            let header = *sample.header();
            let message = obstacles::view(&header, sample.payload()).unwrap();
            if newest.accepts(&header) {
                assert!(header.withdraws == 0 || (message.alarm.level, message.obstacles.len()) == (0, 0));
                found = wanted(&header, message.alarm.level).then_some(header);
            }
        }
        assert!(start.elapsed() < WATCHDOG, "the wanted message never came");
        Ok(if found.is_some() { Next::Stop } else { Next::Wait(Duration::from_millis(100)) })
    })
    .unwrap();
    found.unwrap()
}

#[test]
fn the_alarm_of_a_dead_stage_is_withdrawn() {
    for role in ["stereo", "recognition"] {
        let bench = Bench::new();
        // At 6 m from the camera the recording's car is an alarm in every frame.
        endless(&bench, "[motion]\nodometry = false\n[alarm]\ndistance_m = 50\n");
        // A dead stage stays away long enough for the test.
        let daemon = bench.start(&[
            "run",
            "--set",
            "supervision.restart_longest_ms=5000",
            "--set",
            "supervision.restart_first_ms=5000",
        ]);
        let status = bench.status_when(|s| s["state"] == "running" && frames(s) > 3);
        let before = obstacles_when(&bench, |header, _| header.withdraws == 0);
        send(pid_of(&status, role), "KILL");
        let off = obstacles_when(&bench, |header, level| header.withdraws == 1 && level == 0);
        assert!(off.issued_ns > before.issued_ns);
        // A reader that joins now receives the same first.
        let late = obstacles_when(&bench, |header, _| header.withdraws == 1);
        assert_eq!(late.issued_ns, off.issued_ns, "{role}");
        // When the stage is back, results are valid again.
        obstacles_when(&bench, |header, _| header.withdraws == 0 && header.issued_ns > off.issued_ns);
        daemon.signal("TERM");
        assert!(daemon.wait().status.success());
        bench.assert_clean();
    }
}

/// Runs `lookout` with a small /dev/shm of its own; where the system forbids that the test is skipped.
fn with_small_memory(bench: &Bench, mebibytes: u32, args: &[&str]) -> Option<Command> {
    let mount = format!("mount -t tmpfs -o size={mebibytes}m tmpfs /dev/shm");
    let possible = Command::new("unshare")
        .args(["--mount", "--map-root-user", "sh", "-c", &mount])
        .stderr(Stdio::null())
        .status()
        .is_ok_and(|s| s.success());
    if !possible {
        skip(Need::Namespaces, "this system allows no mount namespace");
        return None;
    }
    let inner = bench.command(args);
    let mut command = Command::new("unshare");
    command.args(["--mount", "--map-root-user", "sh", "-c", &format!("{mount} && exec \"$0\" \"$@\"")]);
    command.arg(inner.get_program()).args(inner.get_args()).current_dir(bench.folder.path());
    Some(command)
}

/// Memory is full as long as this exists.
struct Filling<'a>(&'a AtomicBool);

impl Drop for Filling<'_> {
    fn drop(&mut self) {
        self.0.store(false, Ordering::Relaxed);
    }
}

#[test]
fn full_shared_memory_is_reported_at_the_start_and_survived_later() {
    let bench = Bench::new();
    endless(&bench, "[realtime]\nprefault = \"require\"\n");
    let Some(mut tight) = with_small_memory(&bench, 1, &["run"]) else { return };
    let output = tight.output().unwrap();
    let errors = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(1), "{errors}");
    assert!(errors.contains("/dev/shm has") && errors.contains("enlarge it"), "{errors}");

    let settings = [
        "run",
        "--set",
        "supervision.restart_count=1",
        "--set",
        "supervision.retry_s=1",
        "--set",
        "supervision.restart_longest_ms=2000",
        "--set",
        "supervision.restart_first_ms=2000",
    ];
    let mut enough = with_small_memory(&bench, 24, &settings).unwrap();
    let mut daemon = enough.stderr(Stdio::null()).spawn().unwrap();
    let status = |wanted: &dyn Fn(&serde_json::Value) -> bool| {
        let start = Instant::now();
        loop {
            let inner = bench.command(&["status", "--json"]);
            let mut command = Command::new("nsenter");
            command.args([
                "--user",
                "--preserve-credentials",
                "--mount",
                "--target",
                &daemon.id().to_string(),
            ]);
            command.arg(inner.get_program()).args(inner.get_args());
            let output = command.output().unwrap();
            if output.status.success() {
                let status: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
                if wanted(&status) {
                    return status;
                }
            }
            assert!(
                start.elapsed() < WATCHDOG,
                "the wanted status never came: {}",
                String::from_utf8_lossy(&output.stderr)
            );
            std::thread::sleep(Duration::from_millis(50));
        }
    };
    let running = status(&|s| s["state"] == "running" && frames(s) > 3);
    assert_eq!(process(&running, "stereo")["prefaulted"], true, "{running}");
    // Another process fills it except for what `lookout status` needs: running stages have their pages and are not
    // affected. What a dead stage releases is filled, too.
    let folder = format!("/proc/{}/root/dev/shm", daemon.id());
    let fill = format!("{folder}/fill");
    let full = AtomicBool::new(true);
    std::thread::scope(|scope| {
        scope.spawn(|| {
            let mut file = std::fs::File::create(&fill).unwrap();
            while full.load(Ordering::Relaxed) {
                let free = rustix::fs::statvfs(&folder[..]).unwrap();
                if free.f_bavail * free.f_frsize > 512 << 10 {
                    let _ = file.write(&[1; 4096]);
                } else {
                    std::thread::sleep(Duration::from_millis(5));
                }
            }
            std::fs::remove_file(&fill).unwrap();
        });
        // Also when this test fails.
        let filling = Filling(&full);
        status(&|s| s["state"] == "running" && frames(s) > frames(&running) + 10);
        // A stage that is started now finds no room; the daemon reports that, and recovers when there is room.
        send(pid_of(&running, "stereo"), "KILL");
        let degraded = status(&|s| s["state"] == "degraded");
        assert!(reason(&degraded).contains("stereo failed"), "{degraded}");
        drop(filling);
        status(&|s| s["state"] == "running" && frames(s) > frames(&degraded) + 5);
    });
    send(daemon.id(), "TERM");
    assert!(daemon.wait().unwrap().success());
}

/// `lookout` beside a daemon with a /dev/shm of its own.
fn beside(bench: &Bench, daemon: u32, args: &[&str]) -> Command {
    let inner = bench.command(args);
    let mut command = Command::new("nsenter");
    command.args(["--user", "--preserve-credentials", "--mount", "--target", &daemon.to_string()]);
    command.arg(inner.get_program()).args(inner.get_args()).current_dir(bench.folder.path());
    command
}

#[test]
fn readers_join_when_shared_memory_is_full() {
    let bench = Bench::new();
    endless(&bench, "[realtime]\nprefault = \"require\"\n");
    let Some(mut enough) = with_small_memory(&bench, 24, &["run"]) else { return };
    let mut daemon = enough.stderr(Stdio::null()).spawn().unwrap();
    let run = |args: &[&str]| beside(&bench, daemon.id(), args).output().unwrap();
    let start = Instant::now();
    while !serde_json::from_slice::<serde_json::Value>(&run(&["status", "--json"]).stdout)
        .is_ok_and(|status| status["state"] == "running" && frames(&status) > 3)
    {
        assert!(start.elapsed() < WATCHDOG, "the daemon never ran");
        std::thread::sleep(Duration::from_millis(100));
    }
    // To the last page.
    let folder = format!("/proc/{}/root/dev/shm", daemon.id());
    let mut fill = std::fs::File::create(format!("{folder}/fill")).unwrap();
    let top_up = |fill: &mut std::fs::File| while fill.write(&[1; 4096]).is_ok_and(|n| n > 0) {};
    let free = || {
        let stat = rustix::fs::statvfs(&folder[..]).unwrap();
        stat.f_bavail * stat.f_frsize
    };
    top_up(&mut fill);
    assert_eq!(free(), 0);
    // A process that enters a mount namespace starts in its root folder.
    let recording = |name: &str| bench.path(name).display().to_string();
    let (a, b) = (recording("a.mcap"), recording("b.mcap"));
    for args in [&["status"][..], &["status", "--json"], &["record", "-o", &a, "--seconds", "1"]] {
        let output = run(args);
        assert!(output.status.success(), "{args:?}: {}", String::from_utf8_lossy(&output.stderr));
    }
    let mut viewer = beside(&bench, daemon.id(), &["view", "--bind", "127.0.0.1:0"]);
    let viewer = Viewer::spawn(&mut viewer);
    viewer.socket().frame();
    assert!(viewer.get("/metrics", "").contains("lookout_up 1\n"));
    viewer.stop();

    // When the pages that the daemon keeps for readers are gone, too, they say so.
    let mut cushion = std::fs::read_dir(&folder).unwrap().flatten().map(|entry| entry.path());
    let cushion = cushion.find(|path| path.to_string_lossy().ends_with(".cushion")).unwrap();
    std::fs::remove_file(cushion).unwrap();
    top_up(&mut fill);
    for args in [&["status"][..], &["record", "-o", &b, "--seconds", "1"]] {
        let output = run(args);
        let errors = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(1), "{args:?}: {errors}");
        for part in ["/dev/shm is full (0 of", "enlarge it", "is running (process"] {
            assert!(errors.contains(part), "{args:?}: {errors}");
        }
    }
    let mut viewer = beside(&bench, daemon.id(), &["view", "--bind", "127.0.0.1:0"]);
    let viewer = Viewer::spawn(&mut viewer);
    let (mut page, start) = (viewer.socket(), Instant::now());
    while !page.ask().0["absent"].as_str().is_some_and(|absent| absent.contains("/dev/shm is full")) {
        assert!(start.elapsed() < WATCHDOG, "the page never told it");
    }
    // It goes on by itself when there is room.
    std::fs::remove_file(format!("{folder}/fill")).unwrap();
    drop(fill);
    page.frame();
    viewer.stop();
    assert!(run(&["status"]).status.success());
    send(daemon.id(), "TERM");
    assert!(daemon.wait().unwrap().success());
}
