//! `lookout odometry` and `lookout evaluate odometry`: poses, figures, files, bad input; the same figures as the
//! reference implementation.

use crate::support::{Bench, Need, python, shared_data, skip};
use perception::motion::pose::Pose;
use serde_json::Value;
use sources::motion_file::{read_oxts, read_poses};
use sources::scene::Scene;
use std::path::{Path, PathBuf};
use std::process::Command;
use tools::reporting::poses::pose_line;

fn save(path: &Path, poses: &[Pose]) {
    let text: String = poses.iter().map(|pose| pose_line(pose) + "\n").collect();
    std::fs::write(path, text).expect("the poses are written");
}

/// A bend to the left at 10 m/s and 0.2 rad/s, ten frames a second; `scale` enlarges it.
fn bend(frames: usize, scale: f64) -> Vec<Pose> {
    let pose = |i: usize| {
        let turned = 0.02 * i as f64;
        let translation_m = [50.0 * scale * (turned.cos() - 1.0), 0.0, 50.0 * scale * turned.sin()];
        Pose { translation_m, ..Pose::from_rotation_vector([0.0, -turned, 0.0]) }
    };
    (0..frames).map(pose).collect()
}

fn document(text: &str) -> Value {
    serde_json::from_str(text).unwrap_or_else(|e| panic!("{e}: {text}"))
}

#[test]
fn every_frame_has_a_pose() {
    let bench = Bench::new();
    let recording = bench.record("drive", 5);
    let told = bench.ok(&["odometry", &recording, "--set", "stereo.disparities=32", "-o", "poses.txt"]);
    assert!(told.starts_with("poses.txt: 5 poses, "), "{told}");
    let poses = read_poses(&bench.path("poses.txt")).unwrap().poses;
    assert_eq!((poses.len(), poses[0]), (5, Pose::IDENTITY));
    let output =
        bench.run(&["odometry", &recording, "--set", "stereo.disparities=32", "-o", "-", "--limit", "3"]);
    let (text, told) = (String::from_utf8(output.stdout).unwrap(), String::from_utf8(output.stderr).unwrap());
    let file = std::fs::read_to_string(bench.path("poses.txt")).unwrap();
    assert_eq!(text.lines().collect::<Vec<_>>(), file.lines().take(3).collect::<Vec<_>>());
    assert!(told.contains("3 poses"), "{told}");
    let error = bench.fails(&["odometry", &recording, "-o", "none/poses.txt"]);
    assert!(error.contains("none/poses.txt") && error.contains("-o"), "{error}");
    assert!(bench.fails(&["odometry", "none", "-o", "p.txt"]).contains("none"));
}

#[test]
fn a_start_at_the_speed_of_a_motorway_is_known() {
    for seed in [4, 10] {
        let bench = Bench::new();
        let mut scene = Scene::open(&format!("random?seed={seed}")).unwrap();
        let truth: Vec<f64> = [3, 7].map(|k| scene.truth(k).motion.pose.translation_m[2]).to_vec();
        bench.ok(&["odometry", &format!("scene:random?seed={seed}"), "--limit", "8", "-o", "poses.txt"]);
        let poses = read_poses(&bench.path("poses.txt")).unwrap().poses;
        let way_m = poses[7].translation_m[2] - poses[3].translation_m[2];
        let true_m = truth[1] - truth[0];
        assert!(true_m > 6.0 && (way_m - true_m).abs() < 0.05 * true_m, "seed {seed}: {way_m} of {true_m} m");
    }
}

#[test]
fn a_path_that_is_two_percent_too_long_drifts_by_two_percent() {
    let bench = Bench::new();
    let recording = bench.record("drive", 45);
    save(&bench.path("truth.txt"), &bend(45, 1.0));
    save(&bench.path("found.txt"), &bend(45, 1.02));
    let evaluate = ["evaluate", "odometry", &recording, "--poses", "truth.txt", "--estimate", "found.txt"];
    let report = document(&bench.ok(&[&evaluate[..], &["--json", "--out", "out"]].concat()));
    assert_eq!((&report["frames"], &report["truth"]), (&45.into(), &"truth.txt".into()));
    let drift = report["drift"].as_array().unwrap();
    let lengths: Vec<f64> = drift.iter().map(|row| row["length_m"].as_f64().unwrap()).collect();
    assert_eq!(lengths, [10.0, 20.0, 40.0]);
    for row in drift {
        let percent = row["translation_percent"].as_f64().unwrap();
        // The chord of a part is shorter than the part; parts end at a frame.
        assert!((1.8..2.3).contains(&percent) && row["rotation_deg_per_m"].as_f64() < Some(1e-4), "{row}");
    }
    // Ten metres a second at the rate of the recording.
    let rms = report["frame_to_frame"]["speed_rms_m_s"].as_f64().unwrap();
    assert!(rms > 0.1, "{report}");
    assert!(report["filtered"].is_null() && report["unknown_percent"].is_null(), "{report}");
    for name in ["path.svg", "speed.svg", "yaw_rate.svg"] {
        let svg = std::fs::read_to_string(bench.path("out").join(name)).unwrap();
        assert!(svg.contains("estimate") || svg.contains("frame to frame"), "{name}");
    }
    assert_eq!(document(&std::fs::read_to_string(bench.path("out/evaluation.json")).unwrap()), report);
    let text = bench.ok(&evaluate);
    assert!(text.contains("drift %") && text.contains("frame to frame: speed"), "{text}");

    let error = bench.fails(&["evaluate", "odometry", &recording]);
    assert!(error.contains("--poses FILE, or --oxts CSV with --times CSV"), "{error}");
    save(&bench.path("short.txt"), &bend(44, 1.0));
    let error = bench.fails(&["evaluate", "odometry", &recording, "--poses", "short.txt"]);
    assert!(error.contains("short.txt: 44 poses for 45 frames"), "{error}");
    save(&bench.path("long.txt"), &bend(46, 1.0));
    let args = ["evaluate", "odometry", &recording, "--poses", "truth.txt", "--estimate", "long.txt"];
    let error = bench.fails(&args);
    assert!(error.contains("long.txt: 46 poses, but") && error.contains("45 frames"), "{error}");
    std::fs::write(bench.path("bad.txt"), "1 2 3\n").unwrap();
    let error = bench.fails(&["evaluate", "odometry", &recording, "--poses", "bad.txt"]);
    assert!(error.contains("bad.txt: line 1"), "{error}");
}

#[test]
fn a_scene_brings_its_own_truth() {
    let bench = Bench::new();
    let report = document(&bench.ok(&["evaluate", "odometry", "scene:bend", "--limit", "6", "--json"]));
    assert_eq!((&report["frames"], &report["truth"]), (&6.into(), &"the truth of the scene".into()));
    assert!(report["length_m"].as_f64() > Some(1.0), "{report}");
    // What the stages say of the motion is evaluated, even if that is nothing.
    assert!(report["unknown_percent"].is_number() || report["filtered"].is_null(), "{report}");
    // An estimate that is the truth has no error.
    let mut scene = sources::scene::Scene::open("bend").unwrap();
    let poses: Vec<Pose> = (0..60).map(|index| scene.truth(index).motion.pose).collect();
    save(&bench.path("poses.txt"), &poses);
    let args = ["evaluate", "odometry", "scene:bend", "--limit", "60", "--estimate", "poses.txt", "--json"];
    let report = document(&bench.ok(&args));
    assert!(report["drift"].as_array().unwrap().len() > 1, "{report}");
    assert!(report["drift_all"]["translation_percent"].as_f64() < Some(0.01), "{report}");
    assert_eq!(report["frame_to_frame"]["speed_rms_m_s"], 0.0, "{report}");
}

/// What the reference implementation (`odometry_eval.py`) says of poses.
fn reference(python: &str, script: &Path, args: &[&Path]) -> Value {
    let mut command = Command::new(python);
    let output = command.arg(script).args(args).output().expect("python runs");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    document(&String::from_utf8_lossy(&output.stdout))
}

/// Both must say the same, to the digits that the reference prints.
fn assert_same(report: &Value, reference: &Value) {
    let number = |value: &Value| value.as_f64().unwrap_or_else(|| panic!("{value}: {report} {reference}"));
    assert_eq!(report["frames"], reference["frames"]);
    let rows = reference["drift_percent_deg_per_m_by_length"].as_object().unwrap();
    assert!(rows.len() > 1, "{reference}");
    let drift = report["drift"].as_array().unwrap();
    for (length_m, expected) in rows {
        let row = drift.iter().find(|row| number(&row["length_m"]).to_string() == *length_m);
        let row = row.unwrap_or_else(|| panic!("no part of {length_m} m: {report}"));
        assert_eq!(row["parts"], expected[2], "{report} {reference}");
        assert!(
            (number(&row["translation_percent"]) - number(&expected[0])).abs() < 0.0051,
            "{row} {expected}"
        );
        // The reference takes the arc cosine of the trace, which for small angles magnifies what poses of six digits are not
        // orthogonal by.
        let rotation = number(&expected[1]);
        let apart = (number(&row["rotation_deg_per_m"]) - rotation).abs();
        assert!(apart < 5.1e-5 + 0.01 * rotation, "{row} {expected}");
    }
    let rates = &report["frame_to_frame"];
    let apart = |ours: &str| (number(&rates[ours]) - number(&reference[ours])).abs();
    assert!(apart("speed_rms_m_s") < 0.00051, "{report} {reference}");
    assert!(apart("yaw_rate_rms_rad_s") < 5.1e-5, "{report} {reference}");
}

/// The true poses with an error that a program could have: scale, drift of the heading, and noise.
fn spoilt(poses: &[Pose]) -> Vec<Pose> {
    let mut random = fastrand::Rng::with_seed(7);
    let mut noise = || random.f64() - 0.5;
    let mut last = Pose::IDENTITY;
    let steps = poses.windows(2).map(|pair| pair[0].inverse().after(&pair[1])).collect::<Vec<_>>();
    let moved = steps.iter().map(|step| {
        let turn = Pose::from_rotation_vector([0.001 * noise(), 0.001 + 0.002 * noise(), 0.001 * noise()]);
        let mut wrong = step.after(&turn);
        wrong.translation_m = wrong.translation_m.map(|v| v * 1.01 + 0.02 * noise());
        last = last.after(&wrong);
        last
    });
    std::iter::once(Pose::IDENTITY).chain(moved).collect()
}

#[test]
fn the_figures_are_those_of_the_reference_implementation() {
    let (Some(kitti), Some(drive)) = (shared_data("kitti_sequence_1"), shared_data("drive_residential"))
    else {
        return;
    };
    let script: PathBuf = kitti.join("../../peers/odometry_eval.py");
    if !script.is_file() {
        skip(Need::Data, "../shared/peers/odometry_eval.py is not there: it is not part of the project");
        return;
    }
    let Some(python) = python("numpy", "numpy") else { return };
    let bench = Bench::new();
    let found = bench.path("found.txt");
    let found_name = found.to_str().unwrap();

    let truth = kitti.join("poses.txt");
    save(&found, &spoilt(&read_poses(&truth).unwrap().poses));
    let expected = reference(&python, &script, &[&found, Path::new("--truth"), &truth]);
    let (kitti, truth) = (kitti.to_str().unwrap(), truth.to_str().unwrap());
    let args = ["evaluate", "odometry", kitti, "--poses", truth, "--estimate", found_name, "--json"];
    assert_same(&document(&bench.ok(&args)), &expected);

    let (oxts, times) = (drive.join("oxts.csv"), drive.join("timestamps.csv"));
    save(&found, &spoilt(&read_oxts(&oxts, &times).unwrap().poses));
    let args = [&found, Path::new("--oxts"), &oxts, Path::new("--times"), &times];
    let expected = reference(&python, &script, &args);
    let [drive, oxts, times] = [&drive, &oxts, &times].map(|path| path.to_str().unwrap());
    let args =
        ["evaluate", "odometry", drive, "--oxts", oxts, "--times", times, "--estimate", found_name, "--json"];
    assert_same(&document(&bench.ok(&args)), &expected);
}
