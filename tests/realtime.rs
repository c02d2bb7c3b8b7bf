//! Real time: what the system grants and refuses, no heap for a frame, ages that stay bounded.

mod support;

use messages::bus::Bus;
use messages::instance::Instance;
use messages::pipeline::Role;
use messages::wait::{self, Next};
use messages::{report, service};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};
use support::{Bench, WATCHDOG, pid_of};

const STAGES: [&str; 4] = ["capture", "stereo", "road", "recognition"];

fn process<'a>(status: &'a serde_json::Value, role: &str) -> &'a serde_json::Value {
    status["processes"].as_array().unwrap().iter().find(|p| p["role"] == role).unwrap()
}

/// `lookout` as somebody without any privilege over the machine; `None`, with a printed reason, where
/// that cannot be had.
fn unprivileged(bench: &Bench, args: &[&str]) -> Option<Command> {
    // In a user namespace of its own even root has no say over the whole machine's scheduling.
    let possible = Command::new("unshare")
        .args(["--map-root-user", "true"])
        .stderr(Stdio::null())
        .status()
        .is_ok_and(|s| s.success());
    if !possible {
        println!("skipped: this system allows no user namespace");
        return None;
    }
    let inner = bench.command(args);
    let mut command = Command::new("unshare");
    command.arg("--map-root-user").arg(inner.get_program()).args(inner.get_args());
    command.current_dir(bench.folder.path());
    Some(command)
}

#[test]
fn what_is_required_and_refused_stops_it_with_a_reason() {
    let bench = Bench::new();
    for (key, remedy) in [("scheduling", "CAP_SYS_NICE"), ("memory_lock", "CAP_IPC_LOCK")] {
        bench.configure(&format!("[source]\nkind = \"scene\"\n[realtime]\n{key} = \"require\"\n"));
        let Some(mut command) = unprivileged(&bench, &["run"]) else { return };
        let output = command.output().unwrap();
        let errors = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(1), "{key}: {errors}");
        let expected = format!("realtime.{key} is \"require\", but it was refused");
        assert!(errors.contains(&expected) && errors.contains(remedy), "{errors}");
        bench.assert_clean();
    }
}

#[test]
fn what_is_preferred_and_refused_is_logged_and_shown() {
    let bench = Bench::new();
    bench.configure(
        "[source]\nkind = \"scene\"\nfps = 5.0\n[realtime]\nscheduling = \"prefer\"\nmemory_lock = \"prefer\"\n",
    );
    let Some(mut command) = unprivileged(&bench, &["run"]) else { return };
    let mut daemon = command.stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap();
    let status = bench.status_when(|s| s["state"] == "running");
    for role in ["scheduler", "capture", "stereo", "road", "recognition"] {
        let process = process(&status, role);
        assert_eq!(process["priority"], 0, "{role}");
        assert_eq!(process["privileges_refused"], serde_json::json!(["scheduling", "memory_lock"]), "{role}");
    }
    let table = bench.ok(&["status"]);
    assert!(table.contains("stereo: shared time; refused: scheduling, memory_lock"), "{table}");
    support::send(daemon.id(), "TERM");
    let mut errors = String::new();
    std::io::Read::read_to_string(daemon.stderr.as_mut().unwrap(), &mut errors).unwrap();
    assert!(daemon.wait().unwrap().success(), "{errors}");
    assert!(errors.contains("realtime.scheduling was refused, goes on without"), "{errors}");
    bench.assert_clean();
}

/// Scheduling policy and real-time priority of a process, from /proc.
fn policy(pid: u32) -> (u32, u32) {
    let stat = std::fs::read_to_string(format!("/proc/{pid}/stat")).unwrap();
    let fields: Vec<&str> = stat.rsplit(')').next().unwrap().split_ascii_whitespace().collect();
    // Fields 41 and 40 of proc(5); the first here is field 3.
    (fields[41 - 3].parse().unwrap(), fields[40 - 3].parse().unwrap())
}

/// Whether this user may have real-time priorities and locked memory; says so where not.
fn is_privileged() -> bool {
    // In a thread of its own: this test program stays as it is.
    let fifo = std::thread::spawn(|| messages::privilege::set_fifo(10).is_ok()).join().unwrap();
    let lock = rustix::process::getuid().is_root();
    if !(fifo && lock) {
        println!("skipped: this user may not have real-time priorities and locked memory");
    }
    fifo && lock
}

#[test]
fn a_real_time_stage_that_never_sleeps_is_ended_by_the_kernel() {
    if !is_privileged() {
        return;
    }
    let bench = Bench::new();
    let recording = bench.record("drive", 4);
    // A frame of the full method over all disparities takes many times that.
    bench.configure(&format!(
        "restart_window_s = 60\n[realtime]\nscheduling = \"require\"\nbudget_ms = 5\n\
         [source]\nkind = \"folder\"\npath = \"{recording}\"\nrepeat = true\nfps = 5.0\n"
    ));
    let settings = ["stereo.disparities=255", "stereo.method=full", "supervision.restart_count=1"];
    let mut args = vec!["run"];
    settings.iter().for_each(|setting| args.extend(["--set", setting]));
    let daemon = bench.start(&args);
    let status = bench.status_when(|s| s["state"] == "degraded");
    let reason = status["reason"].as_str().unwrap();
    assert!(reason.contains("stereo failed 2 times") && reason.contains("realtime.budget_ms"), "{reason}");
    daemon.signal("TERM");
    assert!(daemon.wait().status.success());
    bench.assert_clean();
}

#[test]
fn what_is_granted_is_had_and_the_writer_never_asks() {
    if !is_privileged() {
        return;
    }
    let bench = Bench::new();
    let recording = bench.record("drive", 10);
    bench.configure(
        "[realtime]\nscheduling = \"require\"\nmemory_lock = \"require\"\nprefault = \"require\"\n",
    );
    let daemon = bench
        .start(&["replay", &recording, "--fps", "10", "--loop", "--limit", "100000", "--out", "results"]);
    let status = bench.status_when(|s| s["state"] == "running" && s["frames"].as_u64().unwrap() > 3);
    for (role, priority) in
        [("scheduler", 55), ("capture", 50), ("stereo", 20), ("road", 30), ("recognition", 40), ("writer", 0)]
    {
        let process = process(&status, role);
        assert_eq!(
            (&process["priority"], &process["memory_locked"]),
            (&priority.into(), &true.into()),
            "{role}"
        );
        let fifo = u32::from(priority > 0);
        assert_eq!(policy(pid_of(&status, role)), (fifo, priority), "{role} in /proc");
    }
    // Every page of the pools is there.
    for entry in std::fs::read_dir("/dev/shm").unwrap().flatten() {
        let name = entry.file_name().into_string().unwrap_or_default();
        if name.starts_with(&format!("lookout.{}.", daemon.pid())) {
            let Ok(metadata) = entry.metadata() else { continue };
            let there = std::os::unix::fs::MetadataExt::blocks(&metadata) * 512;
            assert!(there >= metadata.len(), "{name}: {there} of {} bytes", metadata.len());
        }
    }
    daemon.signal("TERM");
    daemon.wait();
    bench.assert_clean();
}

/// Heap allocations for frames after the warm-up, by role, as the summary of a run says.
fn allocations(summary: &serde_json::Value, role: &str) -> (u64, u64) {
    let process = process(summary, role);
    (process["frames"].as_u64().unwrap(), process["allocations"].as_u64().unwrap())
}

#[test]
fn no_stage_allocates_for_a_frame() {
    let bench = Bench::new();
    let recording = bench.record("drive", 40);
    let out = bench.ok(&["replay", &recording, "--lockstep", "--loop", "--limit", "1050", "--json"]);
    let summary: serde_json::Value = serde_json::from_str(&out).unwrap();
    for role in STAGES {
        let (frames, count) = allocations(&summary, role);
        assert_eq!((frames, count), (1050, 0), "{role}: allocations in 1,000 frames after the first 50");
    }
}

#[test]
fn the_count_of_allocations_can_tell() {
    // The writer makes pictures and lines as it likes: the same figure must not be 0 there.
    let bench = Bench::new();
    let recording = bench.record("drive", 10);
    let args = ["replay", &recording, "--lockstep", "--loop", "--limit", "70", "--out", "results", "--json"];
    let summary: serde_json::Value = serde_json::from_str(&bench.ok(&args)).unwrap();
    let (frames, count) = allocations(&summary, "writer");
    assert!(frames == 70 && count >= 20, "{count} allocations in the writer's {frames} frames");
}

/// Age and work of frames, in ms, as a stage reports them, until `count` of them were heard.
fn listen(bench: &Bench, role: Role, count: usize) -> Vec<(f64, f64)> {
    let bus = Bus::join(&Instance::new(&bench.instance, &bench.path("run"))).unwrap();
    let reports = bus.subscriber(&service::REPORT).unwrap();
    let mut heard = Vec::new();
    let start = Instant::now();
    wait::run::<messages::bus::IpcError>(&[&reports], || {
        while let Some(sample) = reports.receive()? {
            let report = report::view(sample.header(), sample.payload()).unwrap();
            if report.role() == Some(role) && report.is_frame == 1 {
                heard.push((report.age_ns as f64 * 1e-6, report.work_ns as f64 * 1e-6));
            }
        }
        assert!(start.elapsed() < WATCHDOG, "{} of {count} frames came", heard.len());
        Ok(if heard.len() < count { Next::Wait(Duration::from_millis(200)) } else { Next::Stop })
    })
    .unwrap();
    heard
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}

#[test]
fn at_far_more_than_capacity_ages_stay_bounded_and_do_not_grow() {
    let bench = Bench::new();
    // Pacing off, and matching so heavy that no machine keeps the rate: newer frames overtake older ones.
    let recording = bench.record_paper("drive", 4);
    let offered_ms: f64 = 1000.0 / 200.0;
    let args = ["replay", &recording, "--fps", "200", "--loop", "--limit", "1000000"];
    let heavy = ["--set", "stereo.method=full", "--set", "stereo.disparities=128"];
    let daemon = bench.start(&[&args[..], &heavy].concat());
    bench.status_when(|s| s["state"] == "running" && s["frames"].as_u64().unwrap() > 5);
    let heard = listen(&bench, Role::Stereo, 150);
    let status = bench.status_when(|_| true);
    let (capture, stereo) = (process(&status, "capture"), process(&status, "stereo"));
    let number = |p: &serde_json::Value, key: &str| p[key].as_u64().unwrap();
    assert!(
        number(capture, "frames") >= 2 * number(stereo, "frames"),
        "this machine matches {} of {} pairs: not overloaded",
        stereo["frames"],
        capture["frames"]
    );
    assert!(number(stereo, "skipped") > 0);
    let age = |part: &[(f64, f64)]| median(part.iter().map(|(age, _)| *age).collect());
    let work = median(heard.iter().map(|(_, work)| *work).collect());
    let (first, last) = (age(&heard[..50]), age(&heard[100..]));
    // The source's own period may be longer than what was asked for; on a shared core it waits for others.
    let period = offered_ms.max(1000.0 / capture["rate_hz"].as_f64().unwrap().max(1.0));
    assert!(age(&heard) <= period + work, "age {:.2} ms, period {period:.2}, work {work:.2}", age(&heard));
    assert!(last <= first + period + work, "the age grew from {first:.2} to {last:.2} ms");
    daemon.signal("TERM");
    daemon.wait();
    bench.assert_clean();
}

#[test]
fn the_pace_follows_what_the_slowest_stage_sustains_and_lateness_is_a_state() {
    let bench = Bench::new();
    let recording = bench.record("drive", 10);
    bench.configure(
        "[pacing]\nfollow = true\nmax_fps = 1000\nmin_fps = 1\ndeadline_ms = 1\nlate_frames = 5\n",
    );
    let heavy = ["--set", "stereo.method=full"];
    let args = ["replay", &recording, "--fps", "900", "--loop", "--limit", "1000000"];
    let daemon = bench.start(&[&args[..], &heavy].concat());
    let status = bench.status_when(|s| {
        let pacing = &s["pacing"];
        pacing["slowest_ms"].as_f64().unwrap() > 1.2 && pacing["rate_hz"].as_f64().unwrap() < 890.0
    });
    assert_eq!(status["pacing"]["follows"], true);
    // Nothing comes through in a millisecond: late, counted, and said.
    let late = bench.status_when(|s| s["state"] == "degraded");
    assert!(late["reason"].as_str().unwrap().contains("results are late"), "{late}");
    assert!(late["deadline"]["late"].as_u64().unwrap() >= 5);
    assert!(late["deadline"]["age_ms"].as_f64().unwrap() > 1.0);
    daemon.signal("TERM");
    daemon.wait();
    bench.assert_clean();
}
