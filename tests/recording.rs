//! Recording, replay of a recording, comparison.

use crate::support::{Bench, WATCHDOG, files, lines};
use sources::PairSource;
use sources::recording::RecordingSource;
use std::path::Path;
use std::process::{Command, Output, Stdio};
use std::time::{Duration, Instant};

/// Waits until `wanted` is true.
fn wait_for(what: &str, mut wanted: impl FnMut() -> bool) {
    let start = Instant::now();
    while !wanted() {
        assert!(start.elapsed() < WATCHDOG, "{what} never came");
        std::thread::sleep(Duration::from_millis(10));
    }
}

fn size(path: &Path) -> u64 {
    std::fs::metadata(path).map_or(0, |m| m.len())
}

/// Each pair of the recording must be one of the source's, to the last bit.
fn assert_pairs_of(path: &Path, recording: &str) -> u64 {
    let mut folder = sources::folder::FolderSource::open(Path::new(recording)).unwrap();
    let read = |source: &mut dyn PairSource, i: u64| {
        let (w, h) = source.size();
        let (mut l, mut r) = (vec![0; w * h], vec![0; w * h]);
        source.read(i, &mut l, &mut r).unwrap();
        (l, r)
    };
    let known: Vec<_> = (0..folder.count().unwrap()).map(|i| read(&mut folder, i)).collect();
    let mut source = RecordingSource::open(path).unwrap();
    assert_eq!((source.size(), source.rig()), (folder.size(), folder.rig()));
    let count = source.count().unwrap();
    for i in 0..count {
        assert!(known.contains(&read(&mut source, i)), "pair {i} is none of the source's");
    }
    count
}

#[test]
fn a_lockstep_run_and_the_replay_of_its_recording_are_equal_to_the_last_byte() {
    let bench = Bench::new();
    let recording = bench.record("drive", 12);
    bench.ok(&["replay", &recording, "--lockstep", "--out", "a", "--record", "run.mcap"]);
    bench.assert_clean();
    bench.ok(&["replay", "run.mcap", "--lockstep", "--out", "b"]);
    bench.ok(&["replay", "run.mcap", "--in-process", "--out", "c"]);
    let [a, b, c] = ["a", "b", "c"].map(|name| files(&bench.path(name)));
    assert_eq!(a.len(), 12 + 12 + 1);
    for other in [&b, &c] {
        assert_eq!(a.len(), other.len());
        for ((name, x), (other_name, y)) in a.iter().zip(other) {
            assert!(name == other_name && x == y, "{} differs", name.display());
        }
    }
    assert_eq!(assert_pairs_of(&bench.path("run.mcap"), &recording), 12);
    // The recording also holds the results of the run.
    let said = bench.ok(&["compare", "run.mcap", "b"]);
    assert!(said.contains("12 frames in both, 0 differ"), "{said}");
    bench.ok(&["compare", "a", "b/obstacles.jsonl"]);
    // A recording is never overwritten.
    let error = bench.fails(&["replay", &recording, "--lockstep", "--record", "run.mcap"]);
    assert!(error.contains("run.mcap: is there already"), "{error}");
    // Other parameters on the recorded pairs: the comparison shows what they change.
    bench.configure("[motion]\nodometry = false\n[alarm]\ndistance_m = 50\n");
    bench.ok(&["replay", "run.mcap", "--lockstep", "--out", "d"]);
    let output = bench.run(&["compare", "a", "d", "--json"]);
    assert_eq!(output.status.code(), Some(1));
    let result: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    let differing = result["differing"].as_u64().unwrap();
    let alarms = result["alarms"].as_u64().unwrap();
    assert!(alarms > 0 && alarms <= differing, "{result}");
    let with_alarm =
        result["differences"].as_array().unwrap().iter().find(|d| !d["alarm"].is_null()).unwrap();
    let first = with_alarm["sequence"].as_u64().unwrap() as usize;
    let level = |folder: &str| lines(&bench.path(folder))[first]["alarm"]["level"].clone();
    assert!(level("a") != level("d"));
    assert_eq!(with_alarm["alarm"], serde_json::json!([level("a"), level("d")]));
}

#[test]
fn a_running_daemon_is_recorded_and_goes_on() {
    let bench = Bench::new();
    let recording = bench.record("drive", 10);
    let daemon = bench.replay_endlessly(&recording, "10");
    let out = bench.ok(&["record", "-o", "live.mcap", "--seconds", "4", "--json"]);
    let report: serde_json::Value = serde_json::from_str(&out).unwrap();
    let frames = report["frames"].as_u64().unwrap();
    assert!(frames > 5 && report["ended"] == "its time is up", "{report}");
    // Split files, JPEG, all topics.
    let out = bench.ok(&[
        "record",
        "-o",
        "split.mcap",
        "--split-s",
        "1",
        "--jpeg",
        "--topics",
        "all",
        "--seconds",
        "4",
        "--json",
    ]);
    let split: serde_json::Value = serde_json::from_str(&out).unwrap();
    let parts = split["files"].as_array().unwrap();
    assert!(parts.len() >= 3, "{split}");
    // Lossy images are still images of the right size.
    let part = RecordingSource::open(&bench.path(parts[1].as_str().unwrap())).unwrap();
    assert_eq!(part.size(), (320, 240));
    let before = bench.status_when(|_| true)["frames"].as_u64().unwrap();
    bench.status_when(|status| status["frames"].as_u64().unwrap() > before + 5);
    // It ends with the daemon.
    let last = bench.start(&["record", "-o", "end.mcap"]);
    wait_for("the recording", || size(&bench.path("end.mcap")) > 300_000);
    daemon.signal("TERM");
    daemon.wait();
    let output = last.wait();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    bench.assert_clean();
    let source = RecordingSource::open(&bench.path("end.mcap")).unwrap();
    assert!(source.cut().is_none());
    assert_eq!(assert_pairs_of(&bench.path("live.mcap"), &recording), frames);
    bench.ok(&["replay", "live.mcap", "--in-process", "--out", "again", "--limit", "5"]);
    let error = bench.fails(&["record", "-o", "none.mcap"]);
    assert!(error.contains("no daemon"), "{error}");
}

#[test]
fn a_recorder_that_is_killed_leaves_all_whole_chunks() {
    let bench = Bench::new();
    let recording = bench.record("drive", 10);
    let daemon = bench.replay_endlessly(&recording, "20");
    let recorder = bench.start(&["record", "-o", "cut.mcap"]);
    // In the middle of its third chunk at the earliest.
    wait_for("the recording", || size(&bench.path("cut.mcap")) > 2_000_000);
    recorder.signal("KILL");
    recorder.wait();
    let source = RecordingSource::open(&bench.path("cut.mcap")).unwrap();
    let cut = source.cut().expect("it has no end");
    // Chunks are written whole: nothing, or the beginning of one, is behind the last.
    assert!(cut.bytes < 3_000_000, "{cut:?}");
    let count = source.count().unwrap();
    // 320 x 240, twice a frame, hardly compressed: nearly all that was written can be read.
    assert!(count * 153_600 * 3 > size(&bench.path("cut.mcap")), "{count} pairs");
    assert_eq!(assert_pairs_of(&bench.path("cut.mcap"), &recording), count);
    bench.ok(&["replay", "cut.mcap", "--in-process", "--out", "again", "--limit", "6"]);
    assert_eq!(lines(&bench.path("again")).len(), 6);
    // The daemon is not affected, and the dead recorder's slot is free again.
    for name in ["next.mcap", "other.mcap"] {
        bench.ok(&["record", "-o", name, "--seconds", "1"]);
    }
    let status = bench.status_when(|_| true);
    assert_eq!(status["state"], "running");
    assert!(status["processes"].as_array().unwrap().iter().all(|p| p["restarts"] == 0), "{status}");
    daemon.signal("TERM");
    daemon.wait();
    bench.assert_clean();
}

#[test]
fn a_full_disk_stops_the_recorder_and_not_the_daemon() {
    let bench = Bench::new();
    let recording = bench.record("drive", 10);
    let daemon = bench.replay_endlessly(&recording, "20");
    // The process's file size limit stands for a full disk: the same error at the same call.
    let limited = |blocks: u32| -> Output {
        let record = bench.command(&["record", "-o", "full.mcap"]);
        let args: Vec<_> = record.get_args().map(|a| a.to_string_lossy().into_owned()).collect();
        let program = record.get_program().to_string_lossy().into_owned();
        let script = format!("ulimit -f {blocks}; exec '{program}' {}", args.join(" "));
        Command::new("sh")
            .args(["-c", &script])
            .current_dir(bench.folder.path())
            .stdin(Stdio::null())
            .output()
            .unwrap()
    };
    // Room for two chunks (4 if the shell counts in kilobytes), and a part of the next.
    let output = limited(12_000);
    let errors = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(1), "{errors}");
    assert!(
        errors.contains("full.mcap: the recording has ended") && errors.contains("can be replayed"),
        "{errors}"
    );
    assert!(assert_pairs_of(&bench.path("full.mcap"), &recording) > 3);
    let before = bench.status_when(|status| status["state"] == "running")["frames"].as_u64().unwrap();
    bench.status_when(|status| status["frames"].as_u64().unwrap() > before + 5);
    // A folder that is not there, and one that is deleted meanwhile.
    let error = bench.fails(&["record", "-o", "missing/a.mcap", "--seconds", "1"]);
    assert!(error.contains("cannot be created") && !error.contains("can be replayed"), "{error}");
    std::fs::create_dir(bench.path("folder")).unwrap();
    let mut record = bench.command(&["record", "-o", "folder/a.mcap", "--seconds", "60"]);
    let record = record.stderr(Stdio::piped()).stdout(Stdio::null()).spawn().unwrap();
    while !bench.path("folder/a.mcap").exists() {
        std::thread::sleep(std::time::Duration::from_millis(20));
    }
    std::fs::remove_dir_all(bench.path("folder")).unwrap();
    let output = record.wait_with_output().unwrap();
    let errors = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(1), "{errors}");
    assert!(errors.contains("folder/a.mcap") && errors.contains("deleted"), "{errors}");
    // Too little room at the start.
    let error = bench.fails(&["record", "-o", "big.mcap", "--min-free-mb", "10000000"]);
    assert!(error.contains("--min-free-mb") && !bench.path("big.mcap").exists(), "{error}");
    daemon.signal("TERM");
    daemon.wait();
    bench.assert_clean();
}

#[test]
fn recordings_that_cannot_be_used_are_named_with_the_remedy() {
    let bench = Bench::new();
    std::fs::write(bench.path("text.mcap"), "no recording").unwrap();
    let error = bench.fails(&["replay", "text.mcap", "--lockstep"]);
    assert!(error.contains("text.mcap: no MCAP file"), "{error}");
    let error = bench.fails(&["replay", "absent.mcap", "--lockstep"]);
    assert!(error.contains("absent.mcap"), "{error}");
    let error = bench.fails(&["compare", "absent", "text.mcap"]);
    assert!(error.contains("absent"), "{error}");
    for args in [
        &["record", "-o", "a.mcap", "--topics", "nothing"][..],
        &["record", "-o", "a.mcap", "--png", "--raw"],
    ] {
        assert_eq!(bench.run(args).status.code(), Some(2), "{args:?}");
    }
}
