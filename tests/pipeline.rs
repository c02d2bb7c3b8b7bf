//! The whole daemon on recorded pairs: lock-step, live rate, overload.

use crate::support::{Bench, files, json, lines, shared_data};

/// Two runs are equal if every file has the same bytes.
fn assert_same(a: &std::path::Path, b: &std::path::Path) {
    let (a, b) = (files(a), files(b));
    let names = |f: &[(std::path::PathBuf, Vec<u8>)]| f.iter().map(|(n, _)| n.clone()).collect::<Vec<_>>();
    assert_eq!(names(&a), names(&b));
    for ((name, a), (_, b)) in a.iter().zip(&b) {
        assert!(a == b, "{} differs", name.display());
    }
}

#[test]
fn lockstep_gives_the_same_bytes_twice_and_in_one_process() {
    let bench = Bench::new();
    let recording = bench.record("drive", 12);
    bench.ok(&["replay", &recording, "--lockstep", "--out", "a"]);
    bench.ok(&["replay", &recording, "--lockstep", "--out", "b"]);
    bench.ok(&["replay", &recording, "--in-process", "--out", "c"]);
    bench.assert_clean();
    let [a, b, c] = ["a", "b", "c"].map(|name| bench.path(name));
    assert_same(&a, &b);
    assert_same(&a, &c);
    let lines = lines(&a);
    let sequences: Vec<u64> = lines.iter().map(|l| l["sequence"].as_u64().unwrap()).collect();
    assert_eq!(sequences, (0..12).collect::<Vec<_>>());
    assert_eq!(files(&a).len(), 12 + 12 + 1, "overlays, disparity maps and lines");
    let summary = json(&a.join("summary.json"));
    assert_eq!(
        (&summary["frames"], &summary["dropped"], &summary["offered"]),
        (&12.into(), &0.into(), &12.into())
    );
    // The comparison can fail: another parameter gives other bytes.
    bench.configure("[motion]\nodometry = false\n[alarm]\ndistance_m = 50\n");
    bench.ok(&["replay", &recording, "--in-process", "--out", "d"]);
    assert!(files(&a) != files(&bench.path("d")));
}

#[test]
fn every_instruction_set_gives_the_same_bytes_and_an_unknown_one_is_refused() {
    let bench = Bench::new();
    let recording = bench.record("drive", 6);
    let replay = |level: &str, mode: &str, out: &str| {
        let args = ["replay", &recording, mode, "--out", out];
        bench.command(&args).env("LOOKOUT_LEVEL", level).output().expect("the binary runs")
    };
    let refused = replay("mmx", "--lockstep", "none");
    assert_eq!(refused.status.code(), Some(1));
    let error = String::from_utf8_lossy(&refused.stderr).into_owned();
    let Some((_, levels)) = error.split_once("LOOKOUT_LEVEL=mmx: this machine has ") else {
        panic!("{error}")
    };
    assert!(levels.starts_with("plain"), "{error}");
    assert!(replay("", "--lockstep", "best").status.success());
    for level in levels.trim().split(", ") {
        assert!(replay(level, "--in-process", level).status.success(), "{level}");
        assert_same(&bench.path("best"), &bench.path(level));
    }
    bench.assert_clean();
}

#[test]
fn the_car_ahead_is_found_at_its_distance_and_raises_the_alarm() {
    let bench = Bench::new();
    let recording = bench.record("drive", 30);
    bench.ok(&["replay", &recording, "--in-process", "--out", "a"]);
    let lines = lines(&bench.path("a"));
    let mut missed = Vec::new();
    for line in &lines {
        let t = (line["sequence"].as_u64().unwrap() + 40) as f64 * 0.1;
        let truth = sources::scene::Drive::lead_distance_m(t);
        let near = line["obstacles"].as_array().unwrap().iter().any(|o| {
            let (distance, lateral) = (o["distance_m"].as_f64().unwrap(), o["lateral_m"].as_f64().unwrap());
            lateral.abs() < 0.5 && (distance - truth).abs() < 0.08 * truth
        });
        if !near {
            missed.push(line["sequence"].as_u64().unwrap());
        }
    }
    assert!(missed.len() <= 4, "the car ahead was missed in frames {missed:?} of 30");
    // It comes from 16 m to 6 m; the alarm is set to 10 m.
    let level = |i: usize| lines[i]["alarm"]["level"].as_str().unwrap();
    assert_eq!(level(3), "clear");
    let raised = lines.iter().find(|l| l["alarm"]["level"] == "alarm").expect("an alarm");
    let alarm = &raised["alarm"];
    assert!(alarm["rule"] == "distance" && alarm["changed"] == true && alarm["track"].is_u64(), "{alarm}");
    assert_eq!(level(29), "alarm");
}

#[test]
fn far_above_capacity_the_newest_frame_wins_and_drops_are_counted() {
    let bench = Bench::alone();
    let recording = bench.record("drive", 10);
    let args = ["replay", &recording, "--fps", "1000", "--loop", "--limit", "400", "--json"];
    let out = bench.ok(&[&args[..], &["--set", "stereo.method=full"]].concat());
    bench.assert_clean();
    let summary: serde_json::Value = serde_json::from_str(&out).unwrap();
    let number = |v: &serde_json::Value| v.as_u64().unwrap();
    assert_eq!(number(&summary["offered"]), 400);
    // Every offered pair came out or was overtaken, from the first on.
    assert_eq!(number(&summary["lost"]), 0, "{out}");
    assert!(number(&summary["dropped"]) > 0, "this machine matches 1000 pairs a second: {out}");
    // The age of a processed pair is bounded by the stage's own time, whatever rate is offered.
    let stereo = summary["processes"].as_array().unwrap().iter().find(|p| p["role"] == "stereo").unwrap();
    let (age, work) = (&stereo["age"]["p50_ms"], &stereo["work"]["p99_ms"]);
    assert!(age.as_f64().unwrap() <= 2.0 * work.as_f64().unwrap() + 20.0, "{stereo}");
}

#[test]
fn at_a_rate_that_is_kept_every_frame_comes_out() {
    let bench = Bench::alone();
    let recording = bench.record("drive", 6);
    bench.ok(&["replay", &recording, "--fps", "2", "--out", "a"]);
    let summary = json(&bench.path("a/summary.json"));
    assert_eq!((&summary["offered"], &summary["dropped"]), (&6.into(), &0.into()));
    // The writer may be overtaken on a busy machine; then it counts that.
    let processes = summary["processes"].as_array().unwrap();
    let writer = processes.iter().find(|p| p["role"] == "writer").unwrap();
    assert_eq!(lines(&bench.path("a")).len() as u64 + writer["skipped"].as_u64().unwrap(), 6);
    // Six pairs at two a second: five periods. A mean, so the machine's stalls do not matter.
    assert!(summary["seconds"].as_f64().unwrap() > 2.0, "{summary}");
}

#[test]
fn every_frame_of_the_kitti_sequence_comes_out() {
    let Some(sequence) = shared_data("kitti_sequence_1") else { return };
    let bench = Bench::new();
    bench.configure("[road]\nleast_support = 0.25\n");
    let text = std::fs::read_to_string(bench.path("car.toml")).unwrap();
    std::fs::write(bench.path("car.toml"), text.replace("disparities = 32", "disparities = 128")).unwrap();
    let path = sequence.display().to_string();
    bench.ok(&["replay", &path, "--lockstep", "--out", "a"]);
    bench.ok(&["replay", &path, "--in-process", "--out", "b"]);
    bench.assert_clean();
    assert_same(&bench.path("a"), &bench.path("b"));
    let lines = lines(&bench.path("a"));
    let pairs = std::fs::read_dir(sequence.join("image_l")).unwrap().count();
    assert_eq!(lines.len(), pairs);
    for (i, line) in lines.iter().take(24).enumerate() {
        let road = &line["road"];
        // The camera of the KITTI car is 1.65 m above the road.
        let height = road["camera_height_m"].as_f64().expect("the road is seen in every frame");
        assert!((1.45..1.85).contains(&height), "{line}");
        // A region that was detected once is not confirmed yet.
        assert!(i == 0 || line["obstacles"].as_array().unwrap().len() > 5, "{line}");
    }
    // In frame 17 a parked car stands right of the lane, its rear at 15.6 m (seen in the picture).
    // It covers the columns 715 to 795.
    let car = lines[17]["obstacles"].as_array().unwrap().iter().find(|o| {
        let [x, width] = ["x_px", "width_px"].map(|key| o[key].as_u64().unwrap());
        let d = o["distance_m"].as_f64().unwrap();
        x < 795 && x + width > 715 && (15.0..16.2).contains(&d) && o["confirmed"] == true
    });
    assert!(car.is_some(), "{}", lines[17]);
}
