//! Real time: what the system grants and what it refuses.

use crate::support::{self, Bench, Need, pid_of, process, skip};
use std::process::{Command, Stdio};

/// `lookout` as a user without privileges over the machine; where that is impossible the test is skipped.
fn unprivileged(bench: &Bench, args: &[&str]) -> Option<Command> {
    // In its own user namespace even root may not change the scheduling of the machine.
    let possible = Command::new("unshare")
        .args(["--map-root-user", "true"])
        .stderr(Stdio::null())
        .status()
        .is_ok_and(|s| s.success());
    if !possible {
        skip(Need::Namespaces, "this system allows no user namespace");
        return None;
    }
    let inner = bench.command(args);
    let mut command = Command::new("unshare");
    command.arg("--map-root-user").arg(inner.get_program()).args(inner.get_args());
    command.current_dir(bench.folder.path());
    Some(command)
}

#[test]
fn a_required_privilege_that_is_refused_stops_the_start_with_a_reason() {
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
fn a_preferred_privilege_that_is_refused_is_logged_and_shown() {
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
    assert!(errors.contains("realtime.scheduling was refused, continuing without"), "{errors}");
    bench.assert_clean();
}

/// Scheduling policy and real-time priority of a process, from /proc.
fn policy(pid: u32) -> (u32, u32) {
    let stat = std::fs::read_to_string(format!("/proc/{pid}/stat")).unwrap();
    let fields: Vec<&str> = stat.rsplit(')').next().unwrap().split_ascii_whitespace().collect();
    // Fields 41 and 40 of proc(5); the first here is field 3.
    (fields[41 - 3].parse().unwrap(), fields[40 - 3].parse().unwrap())
}

/// Whether this user may have real-time priorities and locked memory; if not, the test is skipped.
fn is_privileged() -> bool {
    // In a thread of its own, so that this test program keeps its scheduling.
    let fifo = std::thread::spawn(|| messages::privilege::set_fifo(10).is_ok()).join().unwrap();
    let lock = rustix::process::getuid().is_root();
    if !(fifo && lock) {
        skip(Need::RealTime, "this user may not have real-time priorities and locked memory");
    }
    fifo && lock
}

#[test]
fn a_real_time_stage_that_never_sleeps_is_ended_by_the_kernel() {
    if !is_privileged() {
        return;
    }
    let bench = Bench::new();
    let recording = bench.record_noise("noise", 2, (1920, 1080));
    // The scheduler has the same limit. What it does at once, such as the removal of what a dead stage has left, takes milliseconds, tens
    // of them beside other tests; a frame of the full method of this size and with all disparities takes several hundred.
    bench.configure(&format!(
        "restart_window_s = 60\n[realtime]\nscheduling = \"require\"\nbudget_ms = 100\n\
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
fn granted_privileges_take_effect_and_the_writer_requests_none() {
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
    // Every page of the pools is allocated.
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
