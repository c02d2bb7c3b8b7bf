//! `lookout evaluate drive`: a thing in the driven strip is false, one beside it is not; the same figures as the reference
//! implementation; files, several recordings, bad input.

use crate::support::{Bench, Need, document, json, lines, python, shared_data, skip};
use perception::motion::pose::Pose;
use serde_json::Value;
use std::fmt::Write;
use std::path::Path;
use std::process::Command;
use tools::reporting::poses::pose_line;

const FRAMES: usize = 40;

/// Poses ten a second: so much ahead and to the right in m/s, turning to the left by this rate in rad/s.
fn poses([ahead_m_s, across_m_s]: [f64; 2], yaw_rate_rad_s: f64) -> Vec<Pose> {
    let mut pose = Pose::IDENTITY;
    let step = Pose {
        translation_m: [0.1 * across_m_s, 0.0, 0.1 * ahead_m_s],
        ..Pose::from_rotation_vector([0.0, -0.1 * yaw_rate_rad_s, 0.0])
    };
    let next = |_: usize| {
        let now = pose;
        pose = pose.after(&step);
        now
    };
    (0..FRAMES).map(next).collect()
}

fn save(path: &Path, poses: &[Pose]) {
    let text: String = poses.iter().map(|pose| pose_line(pose) + "\n").collect();
    std::fs::write(path, text).expect("the poses are written");
}

/// A recording of the synthetic drive, in which a car drives ahead at half the vehicle's 8 m/s, and paths: `ahead.txt` through
/// that car, `slow.txt` with the speed at which it comes nearer, so that it stands there, `bend.txt` to the left of it,
/// `aside.txt` where the cameras see nothing.
fn bench() -> (Bench, String) {
    let bench = Bench::new();
    let recording = bench.record("drive", FRAMES as u64);
    save(&bench.path("ahead.txt"), &poses([8.0, 0.0], 0.0));
    save(&bench.path("slow.txt"), &poses([4.0, 0.0], 0.0));
    save(&bench.path("bend.txt"), &poses([8.0, 0.0], 0.6));
    save(&bench.path("aside.txt"), &poses([8.0, 30.0], 0.0));
    (bench, recording)
}

const QUICK: [&str; 2] = ["--set", "stereo.disparities=32"];

fn evaluate(bench: &Bench, args: &[&str]) -> Value {
    document(bench, &[&["evaluate", "drive", "--json"], &QUICK[..], args].concat())
}

#[test]
fn what_stands_in_the_driven_strip_is_false_and_the_path_only_judges() {
    let (bench, recording) = bench();
    let [ahead, slow, aside] = ["ahead.txt", "slow.txt", "aside.txt"].map(|poses| {
        let report = evaluate(&bench, &[&recording, "--poses", poses]);
        assert_eq!(report["recordings"][0]["truth"], poses, "{report}");
        report["recordings"][0].clone()
    });
    assert_eq!((&ahead["frames"], &ahead["judged"]), (&40.into(), &26.into()), "{ahead}");
    assert!(ahead["in_strip_obstacles"].as_u64() > Some(5), "the car ahead: {ahead}");
    assert!(ahead["moving_tracks"].as_u64() >= Some(1), "it drives ahead: {ahead}");
    assert!(slow["false_obstacles"].as_u64() > Some(3), "it stands: {slow}");
    assert!(slow["false_tracks"].as_u64() >= Some(1), "{slow}");
    for what in ["obstacles", "tracks"] {
        let [all, parts @ ..] =
            ["in_strip", "false", "moving"].map(|kind| ahead[format!("{kind}_{what}")].as_u64().unwrap());
        assert_eq!(all, parts.iter().sum::<u64>(), "{what}: {ahead}");
    }
    assert_eq!((&aside["in_strip_obstacles"], &aside["in_strip_tracks"]), (&0.into(), &0.into()), "{aside}");
    // What the stages say does not depend on the path.
    for figure in
        ["levels", "warnings", "alarms", "off_reasons", "tracks", "boxes", "life_median_s", "life_strict_s"]
    {
        assert_eq!(ahead[figure], aside[figure], "{figure}");
    }
    let count = |level: &str| ahead["levels"][level].as_u64().unwrap();
    assert_eq!(["off", "clear", "warning", "alarm"].map(count).iter().sum::<u64>(), 40, "{ahead}");
    let kinds = |report: &Value| {
        let events = report["events"].as_array().unwrap();
        events.iter().filter(|event| event["kind"] == "false obstacle").count() as u64
    };
    assert_eq!((Some(kinds(&ahead)), kinds(&aside)), (ahead["false_tracks"].as_u64(), 0));
    assert_eq!(Some(kinds(&slow)), slow["false_tracks"].as_u64());
}

#[test]
fn several_recordings_have_a_column_each_and_a_page_with_pictures() {
    let (bench, recording) = bench();
    let args = [&recording, &recording, "--poses", "slow.txt", "--poses", "aside.txt", "--out", "out"];
    let report = evaluate(&bench, &args);
    let sum = |name: &str| {
        let each = report["recordings"].as_array().unwrap();
        each.iter().map(|recording| recording[name].as_u64().unwrap()).sum::<u64>()
    };
    for figure in
        ["frames", "judged", "false_obstacles", "moving_obstacles", "in_strip_obstacles", "boxes", "tracks"]
    {
        assert_eq!(report["total"][figure].as_u64(), Some(sum(figure)), "{figure}: {report}");
    }
    assert_eq!(json(&bench.path("out/evaluation.json")), report);
    let page = std::fs::read_to_string(bench.path("out/index.html")).unwrap();
    let events: usize =
        report["recordings"].as_array().unwrap().iter().map(|r| r["events"].as_array().unwrap().len()).sum();
    assert!(events > 0 && page.matches("<img src=\"data:image/jpeg;base64,").count() == 3 * events.min(80));
    assert!(page.contains("false obstacle") && page.contains("Judged by aside.txt"), "{page}");
    // By own odometry, as a table; without a total.
    let text = bench.ok(&[&["evaluate", "drive", &recording, "--limit", "20"], &QUICK[..]].concat());
    assert!(text.contains("judged by own odometry") && !text.contains("total"), "{text}");
}

#[test]
fn mistakes_in_the_files_are_told_before_the_run() {
    let (bench, recording) = bench();
    let fails = |args: &[&str]| bench.fails(&[&["evaluate", "drive"], args].concat());
    save(&bench.path("short.txt"), &poses([8.0, 0.0], 0.0)[1..]);
    let error = fails(&[&recording, "--poses", "short.txt"]);
    assert!(error.contains("short.txt: 39 poses for 40 frames"), "{error}");
    let error = fails(&[&recording, "--poses", "none.txt"]);
    assert!(error.contains("none.txt"), "{error}");
    std::fs::write(bench.path("bad.txt"), "1 2 3\n").unwrap();
    let error = fails(&[&recording, "--poses", "bad.txt"]);
    assert!(error.contains("bad.txt: line 1: 3 numbers, not 12"), "{error}");
    let error = fails(&[&recording, &recording, "--poses", "ahead.txt"]);
    assert!(error.contains("--poses: 1 files for 2 recordings: give --poses once for each"), "{error}");
    let error = fails(&[&recording, "--rig", "a.toml", "--rig", "b.toml"]);
    assert!(error.contains("--rig: 2 files for 1 recordings"), "{error}");
    std::fs::write(bench.path("times.csv"), "name,left_s\n0,1.0\n").unwrap();
    let error = fails(&[&recording, "--oxts", "none.csv", "--times", "times.csv"]);
    assert!(error.contains("none.csv"), "{error}");
    assert!(fails(&["nothing/here"]).contains("nothing/here"));
    // Wrong use is another exit code.
    assert_eq!(bench.run(&["evaluate", "drive"]).status.code(), Some(2));
    assert_eq!(bench.run(&["evaluate", "drive", &recording, "--oxts", "a.csv"]).status.code(), Some(2));
}

/// What `drive_truth.py` says of the same results. It knows the level clear by its earlier name.
fn reference(python: &str, script: &Path, bench: &Bench, args: &[&str]) -> Value {
    let text = std::fs::read_to_string(bench.path("out/obstacles.jsonl")).unwrap();
    let text = text.replace("\"level\":\"clear\"", "\"level\":\"standby\"");
    std::fs::write(bench.path("earlier.jsonl"), text).unwrap();
    let mut command = Command::new(python);
    command.current_dir(bench.folder.path()).arg(script).arg("earlier.jsonl").args(args);
    let output = command.output().expect("python runs");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    serde_json::from_slice(&output.stdout).expect("it prints JSON")
}

/// OXTS of a drive at 8 m/s that turns to the left, with uneven times, and the times of the frames in between.
fn save_oxts(bench: &Bench) {
    let (mut oxts, mut times) =
        ("time_s,vf_m_s,wu,lat_deg,lon_deg,yaw_rad\n".to_owned(), "name,left_s\n".to_owned());
    let (mut east_m, mut north_m, mut yaw_rad) = (0.0_f64, 0.0_f64, 3.0_f64);
    let scale = 6_378_137.0 * 49.0_f64.to_radians().cos();
    for i in 0..500 {
        let time_s = 50.0 + 0.01 * f64::from(i);
        let wrapped = yaw_rad.sin().atan2(yaw_rad.cos());
        let (lat_deg, lon_deg) =
            (49.0 + (north_m / 6_378_137.0).to_degrees(), 8.4 + (east_m / scale).to_degrees());
        let _ = writeln!(oxts, "{time_s:.3},8,0.1,{lat_deg:.12},{lon_deg:.12},{wrapped:.9}");
        (east_m, north_m) = (east_m + 0.08 * yaw_rad.cos(), north_m + 0.08 * yaw_rad.sin());
        yaw_rad += 0.001;
    }
    for i in 0..FRAMES {
        let _ = writeln!(times, "{i:06}.png,{:.4}", 50.1004 + 0.1001 * i as f64);
    }
    std::fs::write(bench.path("oxts.csv"), oxts).unwrap();
    std::fs::write(bench.path("times.csv"), times).unwrap();
}

#[test]
fn the_figures_are_those_of_the_reference_implementation() {
    let Some(data) = shared_data("kitti_sequence_1") else { return };
    let script = data.join("../../peers/drive_truth.py");
    if !script.is_file() {
        skip(Need::Data, "../shared/peers/drive_truth.py is not there: it is not part of the project");
        return;
    }
    let Some(python) = python("numpy", "numpy") else { return };
    let (bench, recording) = bench();
    save_oxts(&bench);
    bench.ok(&["replay", &recording, "--in-process", "--out", "out"]);
    assert_eq!(lines(&bench.path("out")).len(), FRAMES);
    let truths: [&[&str]; 4] = [
        &["--poses", "ahead.txt"],
        &["--poses", "bend.txt"],
        &["--poses", "aside.txt"],
        &["--oxts", "oxts.csv", "--times", "times.csv"],
    ];
    for truth in truths {
        let expected = reference(&python, &script, &bench, truth);
        let report = evaluate(&bench, &[&[&recording[..]], truth].concat());
        let found = &report["recordings"][0];
        for figure in ["frames", "judged", "warnings", "alarms"] {
            assert_eq!(found[figure], expected[figure], "{truth:?}, {figure}: {report} {expected}");
        }
        // It takes all that is in the strip as false.
        for figure in ["obstacles", "tracks"] {
            let [ours, theirs] = [&found[format!("in_strip_{figure}")], &expected[format!("false_{figure}")]];
            assert_eq!(ours, theirs, "{truth:?}, {figure}: {report} {expected}");
        }
        for (ours, figure, digit) in
            [("in_strip_per_frame", "false_per_frame", 0.00051), ("seconds", "seconds", 0.051)]
        {
            let [a, b] = [&found[ours], &expected[figure]].map(|value| value.as_f64().unwrap());
            assert!((a - b).abs() < digit, "{truth:?}, {figure}: {a}, not {b}");
        }
        for (ours, theirs) in
            [("off", "off"), ("clear", "standby"), ("warning", "warning"), ("alarm", "alarm")]
        {
            let there = expected["levels"][theirs].as_u64().unwrap_or(0);
            assert_eq!(found["levels"][ours].as_u64(), Some(there), "{ours}: {report} {expected}");
        }
    }
}
