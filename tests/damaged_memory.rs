//! Another program of the same user removes or damages the files of a run in shared memory.

use crate::support::{Bench, pid_of, send};
use serde_json::Value;
use std::path::PathBuf;

fn frames(status: &Value) -> u64 {
    status["frames"].as_u64().expect("a count")
}

// They run alone, because the files of a run whose mark was removed look abandoned to other tests.

/// A service on the synthetic scene, which runs.
fn start(bench: &Bench) -> crate::support::Daemon {
    bench.configure("[source]\nkind = \"scene\"\n");
    let daemon = bench.start(&["run"]);
    bench.status_when(|s| s["state"] == "running" && frames(s) > 3);
    daemon
}

/// Files of the instance's run.
fn files(bench: &Bench) -> Vec<PathBuf> {
    let instance = messages::instance::Instance::new(&bench.instance, &bench.path("run"));
    instance.shared_memory()
}

/// Removes them. The daemon, too, removes files of its run as soon as it misses the first.
fn remove(files: &[PathBuf]) {
    for file in files {
        if let Err(error) = std::fs::remove_file(file) {
            assert_eq!(error.kind(), std::io::ErrorKind::NotFound, "{}: {error}", file.display());
        }
    }
}

fn node_counter(bench: &Bench) -> PathBuf {
    files(bench)
        .into_iter()
        .find(|file| file.to_string_lossy().ends_with(".global_mgmt"))
        .expect("a node counter")
}

#[test]
fn a_service_whose_files_are_removed_starts_anew() {
    let bench = Bench::alone();
    let daemon = start(&bench);
    for round in 0..2 {
        let before = files(&bench);
        assert!(before.len() > 20, "{before:?}");
        remove(&before);
        // It is the same process, which SIGTERM and systemd know.
        let after = bench.status_when(|s| s["state"] == "running" && frames(s) > 3);
        assert_eq!(pid_of(&after, "scheduler"), daemon.pid(), "round {round}");
        assert!(files(&bench).iter().all(|file| !before.contains(file)));
        // A stage that dies is restarted in the new run.
        send(pid_of(&after, "road"), "KILL");
        bench.status_when(|s| s["state"] == "running" && frames(s) > frames(&after) + 3);
    }
    // The same for what a cleaner of temporary folders would remove.
    std::fs::remove_dir_all(bench.path("run").join(&bench.instance).join("bus")).expect("our own folder");
    let before = files(&bench);
    bench.status_when(|s| s["state"] == "running" && frames(s) > 3);
    assert!(files(&bench).iter().all(|file| !before.contains(file)));
    daemon.signal("TERM");
    let output = daemon.wait();
    let log = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(output.status.success(), "{log}");
    assert_eq!(log.matches("starting anew").count(), 3, "{log}");
    bench.assert_clean();
}

#[test]
fn a_replay_whose_files_are_removed_fails_with_the_reason() {
    let bench = Bench::alone();
    let recording = bench.record("drive", 8);
    let daemon = bench.replay_endlessly(&recording, "20");
    let before = files(&bench);
    assert!(before.len() > 20, "{before:?}");
    remove(&before);
    let output = daemon.wait();
    let errors = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(1), "{errors}");
    assert!(errors.contains("another program has removed it"), "{errors}");
    bench.assert_clean();
}

#[test]
fn a_wait_in_damaged_shared_memory_is_bounded() {
    let bench = Bench::alone();
    let daemon = start(&bench);
    let status = bench.status_when(|s| s["state"] == "running");
    // iceoryx2 waits without limit for this file to have content: a reader that joins, and the scheduler as soon as a
    // stage has died.
    let counter = std::fs::OpenOptions::new().write(true).open(node_counter(&bench)).expect("our own file");
    counter.set_len(0).expect("it can be truncated");
    let errors = bench.fails(&["status"]);
    assert!(errors.contains("shared memory has not responded for 6 s (joining the run)"), "{errors}");
    // A signal that comes during the wait ends it, so that none is sent.
    send(pid_of(&status, "road"), "KILL");
    let output = daemon.wait();
    let log = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(1), "{log}");
    assert!(log.contains("shared memory has not responded for 6 s"), "{log}");
    // Its stages have ended with it, and the next run removes what it left.
    let again = start(&bench);
    again.signal("TERM");
    assert!(again.wait().status.success());
    bench.assert_clean();
}
