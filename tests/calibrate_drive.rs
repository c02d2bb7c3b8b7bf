//! `lookout calibrate --from-drive`: a right camera that has turned is found again, in a scene and on a real drive; what does
//! not tell it is refused.

use crate::support::{Bench, document, shared_data};
use perception::calibration::RightTurn;
use sources::PairSource;
use sources::rig_file::RigFile;
use sources::scene::Scene;
use std::path::Path;
use tools::calibration::drive::rectified_rig;

/// Deviations that are wanted, in degrees.
const ROWS_DEG: f64 = 0.02;
const YAW_DEG: f64 = 0.05;

/// Writes a calibration that is wrong: with its right camera turned by these angles in degrees.
fn write_wrong(rig: &RigFile, [pitch, yaw, roll]: [f64; 3], path: &Path) {
    let [pitch_rad, yaw_rad, roll_rad] = [pitch, yaw, roll].map(f64::to_radians);
    let turn = RightTurn { pitch_rad, yaw_rad, roll_rad };
    let mut wrong = rig.clone();
    (wrong.rectification, wrong.between) =
        turn.applied(&rig.cameras, &rig.rectification, &rig.between).unwrap();
    wrong.write(path).unwrap();
}

/// What is left between a calibration and the right one: pitch, yaw and roll in degrees.
fn left_over(found: &Path, right: &RigFile) -> [f64; 3] {
    let found = RigFile::read(found).unwrap();
    assert_eq!(found.rectification.rig, right.rectification.rig);
    let left = RightTurn::between(&right.rectification, &found.rectification);
    [left.pitch_rad, left.yaw_rad, left.roll_rad].map(f64::to_degrees)
}

fn assert_near([pitch, yaw, roll]: [f64; 3], what: &str) {
    let text = format!("{what}: pitch {pitch:.4}, yaw {yaw:.4}, roll {roll:.4} degrees off");
    println!("{text}");
    assert!(pitch.abs() < ROWS_DEG && roll.abs() < ROWS_DEG && yaw.abs() < YAW_DEG, "{text}");
}

fn scene_rig(name: &str) -> RigFile {
    let scene = Scene::open(name).unwrap();
    rectified_rig(&scene.rig().unwrap(), scene.size())
}

#[test]
fn a_turned_camera_is_found_again_in_a_scene() {
    let bench = Bench::new();
    let right = scene_rig("motion");
    let turn = [-0.3, 0.3, -0.3];
    write_wrong(&right, turn, &bench.path("wrong.toml"));
    let args = [
        "calibrate",
        "--from-drive",
        "scene:motion",
        "--limit",
        "45",
        "--rig",
        "wrong.toml",
        "-o",
        "found.toml",
    ];
    let figures = document(&bench, &[&args[..], &["--json"]].concat());
    assert_near(left_over(&bench.path("found.toml"), &right), "scene:motion");
    // It says what was wrong, how sure it is, and that the baseline is kept.
    for (name, turned) in ["pitch", "yaw", "roll"].into_iter().zip(turn) {
        let found = figures[name]["degrees"].as_f64().unwrap();
        assert!((found + turned).abs() < YAW_DEG, "{figures}");
        assert!(figures[name]["error_degrees"].as_f64().unwrap() < ROWS_DEG, "{figures}");
    }
    let (before, after) = (&figures["rows_before_px"], &figures["rows_after_px"]);
    assert!(before.as_f64().unwrap() > 3.0 && after.as_f64().unwrap() < 0.1, "{figures}");
    assert_eq!(figures["distance_factor"], serde_json::Value::Null);
    assert_eq!(figures["baseline_m"].as_f64(), Some(right.rectification.rig.baseline_m));
}

#[test]
fn a_turned_camera_is_found_again_on_a_real_drive() {
    let Some(drive) = shared_data("drive_residential") else { return };
    let drive = drive.to_str().unwrap();
    let bench = Bench::new();
    let given = RigFile::read(&Path::new(drive).join("rig.toml")).unwrap();
    let calibrate = |rig: &str, out: &str| {
        let speed = format!("vehicle.motion={drive}/oxts.csv");
        let args =
            ["calibrate", "--from-drive", drive, "--limit", "50", "--rig", rig, "--set", &speed, "-o", out];
        document(&bench, &[&args[..], &["--json"]].concat())
    };
    // What the drive itself says of its calibration is the reference; a factory's calibration is near to it.
    let figures = calibrate(&format!("{drive}/rig.toml"), "reference.toml");
    let reference = RigFile::read(&bench.path("reference.toml")).unwrap();
    let off = left_over(&bench.path("reference.toml"), &given);
    assert!(off.iter().all(|degrees| degrees.abs() < 0.05), "{off:?}");
    // The speed tells that the baseline is right.
    let [factor, error] =
        ["distance_factor", "distance_factor_error"].map(|key| figures[key].as_f64().unwrap());
    assert!((factor - 1.0).abs() < 0.01 && error < 0.01, "{figures}");
    write_wrong(&given, [0.3, -0.3, 0.3], &bench.path("wrong.toml"));
    calibrate("wrong.toml", "found.toml");
    assert_near(left_over(&bench.path("found.toml"), &reference), "a turned camera");
}

#[test]
fn what_does_not_tell_it_is_refused_and_no_file_is_written() {
    let bench = Bench::new();
    let fails = |args: &[&str]| {
        let error = bench.fails(&[&["calibrate", "-o", "out.toml"], args].concat());
        assert!(!bench.path("out.toml").exists(), "{error}");
        error
    };
    let error = fails(&["--from-drive", "scene:motion", "--limit", "5"]);
    assert!(error.contains("5 pairs") && error.contains("at least 40"), "{error}");
    // Nothing to be seen.
    let error = fails(&["--from-drive", "scene:textureless?weather=night", "--limit", "40"]);
    assert!(error.contains("too few points"), "{error}");
    // Other cameras.
    let mut other = scene_rig("motion");
    other.rectification.size = (320, 240);
    other.rectification.valid = [0, 0, 320, 240];
    other.write(&bench.path("other.toml")).unwrap();
    let error = fails(&["--from-drive", "scene:motion", "--rig", "other.toml"]);
    assert!(error.contains("other.toml") && error.contains("320x240"), "{error}");
    let error = fails(&["--from-drive", "nowhere"]);
    assert!(error.contains("nowhere"), "{error}");
    for more in [["--live", "--json"], ["--board", "9x6"], ["--square-mm", "25"]] {
        let args = ["calibrate", "-o", "out.toml", "--from-drive", "scene:motion"];
        let output = bench.run(&[&args[..], &more].concat());
        let error = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.code() == Some(2) && error.contains("cannot be used with"), "{error}");
    }
    let output = bench.run(&["calibrate", "-o", "out.toml", "pictures"]);
    assert!(String::from_utf8_lossy(&output.stderr).contains("--board"), "{output:?}");
}
