//! Recording, replay from a recording, comparison: the binary as processes.

mod support;

use sources::PairSource;
use sources::recording::RecordingSource;
use std::path::Path;
use std::process::{Command, Output, Stdio};
use std::time::{Duration, Instant};
use support::{Bench, WATCHDOG, files, lines};

/// Starts the daemon on a recording that never ends.
fn daemon(bench: &Bench, recording: &str, fps: &str) -> support::Daemon {
    let daemon =
        bench.start(&["replay", recording, "--fps", fps, "--loop", "--limit", "100000", "--log", "error"]);
    bench.status_when(|status| status["state"] == "running");
    daemon
}

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
    // The recording holds the run's own results, too.
    let said = bench.ok(&["compare", "run.mcap", "b"]);
    assert!(said.contains("12 frames in both, 0 differ"), "{said}");
    bench.ok(&["compare", "a", "b/obstacles.jsonl"]);
    // A recording is never written over.
    let error = bench.fails(&["replay", &recording, "--lockstep", "--record", "run.mcap"]);
    assert!(error.contains("run.mcap: is there already"), "{error}");
    // Other parameters on the recorded pairs: the comparison says what that changes.
    bench.configure("[alarm]\ndistance_m = 50\n");
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
    let daemon = daemon(&bench, &recording, "10");
    let out = bench.ok(&["record", "-o", "live.mcap", "--seconds", "4", "--json"]);
    let report: serde_json::Value = serde_json::from_str(&out).unwrap();
    let frames = report["frames"].as_u64().unwrap();
    assert!(frames > 5 && report["ended"] == "its time is up", "{report}");
    // Split files, JPEG, everything there is.
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
    let daemon = daemon(&bench, &recording, "20");
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
    // The daemon has not noticed, and the dead recorder's place is free again.
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
    let daemon = daemon(&bench, &recording, "20");
    // The limit of the process stands for the end of the disk: the same error at the same call.
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
    // Too little room to begin with.
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

/// A Python with the mcap packages: the one of `LOOKOUT_PYTHON`, the system's, or a new one with the
/// packages from the index, where that can be reached.
fn python(bench: &Bench) -> Option<String> {
    let works = |python: &str| {
        let check = Command::new(python).args(["-c", "import mcap.reader, mcap_protobuf.decoder"]).output();
        check.is_ok_and(|output| output.status.success())
    };
    let candidates = [std::env::var("LOOKOUT_PYTHON").ok(), Some("python3".into())];
    if let Some(python) = candidates.into_iter().flatten().find(|p| works(p)) {
        return Some(python);
    }
    let folder = bench.path("python").display().to_string();
    let made = Command::new("python3").args(["-m", "venv", &folder]).output();
    let pip = format!("{folder}/bin/pip");
    let packages = ["mcap", "mcap-protobuf-support", "foxglove-schemas-protobuf"];
    if made.is_ok_and(|output| output.status.success()) {
        let _ = Command::new(pip)
            .args(["install", "-q", "--retries", "0", "--timeout", "20"])
            .args(packages)
            .output();
    }
    let own = format!("{folder}/bin/python");
    works(&own).then_some(own)
}

#[test]
fn the_mcap_package_reads_it_and_foxgloves_own_types_agree() {
    let bench = Bench::new();
    let Some(python) = python(&bench) else {
        println!("skipped: no python3 with mcap and mcap-protobuf-support, and none could be installed");
        return;
    };
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/support/read_recording.py");
    let read = |file: &str| -> serde_json::Value {
        let output = Command::new(&python).arg(&script).arg(bench.path(file)).output().unwrap();
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        serde_json::from_slice(&output.stdout).unwrap()
    };
    let recording = bench.record("drive", 14);
    bench.ok(&["replay", &recording, "--lockstep", "--out", "a", "--record", "run.mcap"]);
    let said = read("run.mcap");
    if said["published"] != true {
        println!("foxglove-schemas-protobuf is not there: decoded by the file's own descriptors alone");
    }
    for topic in
        ["/left/image", "/right/image", "/pair", "/obstacles", "/obstacles/scene", "/left/annotations"]
    {
        assert_eq!(said["topics"][topic], 14, "{topic}: {said}");
    }
    assert_eq!(said["schemas"]["/left/image"], "foxglove.RawImage protobuf");
    assert_eq!(said["schemas"]["/obstacles"], "lookout.Obstacles jsonschema");
    let first = &said["first"];
    assert_eq!(
        (&first["/left/image"]["width"], &first["/left/image"]["bytes"]),
        (&320.into(), &76_800.into())
    );
    let (pixels, ..) = sources::folder::read_grey(&Path::new(&recording).join("left/000000.png")).unwrap();
    assert_eq!(first["/left/image"]["data"], serde_json::json!(pixels[..16]));
    let p: Vec<f64> = serde_json::from_value(first["/right/calibration"]["P"].clone()).unwrap();
    assert_eq!((p[0], p[3]), (440.0, -440.0 * 0.12));
    // As many boxes as the frame with the most obstacles has.
    let most =
        lines(&bench.path("a")).iter().map(|l| l["obstacles"].as_array().unwrap().len()).max().unwrap();
    assert!(most > 0);
    assert_eq!(
        (&first["/obstacles/scene"]["entities"], &first["/left/annotations"]["boxes"]),
        (&most.into(), &most.into())
    );
    assert_eq!(said["first"]["/obstacles"], lines(&bench.path("a"))[0]);
    assert_eq!(said["metadata"]["lookout.summary"]["ended because"], "the run has ended");
    assert_eq!(said["metadata"]["lookout.recording"]["baseline_m"], "0.12");
    // A live one with everything.
    let daemon = daemon(&bench, &recording, "10");
    bench.ok(&["record", "-o", "all.mcap", "--topics", "all", "--png", "--seconds", "3"]);
    bench.ok(&["record", "-o", "cloud.mcap", "--topics", "images,points", "--seconds", "3"]);
    bench.ok(&["record", "-o", "none.mcap", "--seconds", "1"]);
    daemon.signal("TERM");
    daemon.wait();
    let said = read("all.mcap");
    assert_eq!(said["schemas"]["/left/image"], "foxglove.CompressedImage protobuf");
    assert_eq!(said["first"]["/left/image"]["format"], "png");
    assert_eq!(
        (&said["first"]["/points"]["point_stride"], &said["schemas"]["/points"]),
        (&16.into(), &"foxglove.PointCloud protobuf".into())
    );
    assert!(said["first"]["/points"]["bytes"].as_u64().unwrap() > 16 * 500, "{said}");
    assert_eq!(said["first"]["/status"]["state"], "running");
    // A point of every second column and row, where its pixel is and as bright; only when it is asked for.
    let clouds = &read("cloud.mcap")["clouds"];
    let points = clouds["points"].as_u64().unwrap();
    assert!(clouds["clouds"].as_u64() > Some(1) && points > 1000, "{clouds}");
    assert_eq!((&clouds["on_pixels"], &clouds["grey"]), (&points.into(), &points.into()), "{clouds}");
    assert_eq!(clouds["columns"], serde_json::json!([0]));
    let fields = serde_json::json!([["x", 0, 7], ["y", 4, 7], ["z", 8, 7], ["intensity", 12, 7]]);
    assert_eq!(clouds["fields"], fields);
    assert!(read("none.mcap")["topics"]["/points"].is_null());
    assert_eq!(said["schemas"]["/tf"], "foxglove.FrameTransform protobuf");
}
