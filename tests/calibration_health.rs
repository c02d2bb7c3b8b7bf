//! The online check of the calibration: a right camera that turns during a run is found, corrected and reported; what
//! cannot be corrected, and pictures that are no pair, are degraded with the reason.

use crate::support::{Bench, save_grey, shared_data};
use serde_json::Value;
use std::path::Path;

/// Row offset of 0.2 degrees at 440 px of focal length, pitched down: the image content moves up.
const TURNED_PX: f64 = -1.536;

/// A street before cameras with small images, 12.5 pairs a second; `camera` and `first` are more keys.
fn scene(bench: &Bench, name: &str, first: &str, camera: &str) -> String {
    let text = format!(
        "title = \"A street\"\n{first}\nseed = 5\n\
         [camera]\nfocal_px = 440\ncx_px = 160\ncy_px = 110\nwidth_px = 320\nheight_px = 240\n{camera}\n\
         [ego]\nspeed_m_s = 4\n\
         [[beside]]\nkind = \"buildings\"\nlateral_m = -8\nto_m = 150\n\
         [[beside]]\nkind = \"buildings\"\nlateral_m = 9\nto_m = 150\n\
         [[beside]]\nkind = \"parked_cars\"\nlateral_m = 4\nto_m = 150\n\
         [[objects]]\nkind = \"van\"\nahead = [[0, 14, 0], [9, 12, 0]]\n"
    );
    std::fs::write(bench.path(name), text).expect("the scene is written");
    format!("scene:{name}")
}

/// What the check found over a run in lock-step, and what was logged.
fn changes(bench: &Bench, scene: &str, more: &[&str]) -> (Vec<Value>, String) {
    let (summary, log) = summary(bench, scene, more);
    (summary["calibration"].as_array().expect("changes").clone(), log)
}

/// The summary of a run in lock-step, and what was logged.
fn summary(bench: &Bench, scene: &str, more: &[&str]) -> (Value, String) {
    let output = bench.run(&[&["replay", scene, "--lockstep", "--json"], more].concat());
    let log = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(output.status.success(), "{log}");
    (serde_json::from_slice(&output.stdout).expect("the summary is JSON"), log)
}

fn states(changes: &[Value]) -> Vec<&str> {
    changes.iter().filter_map(|change| change["state"].as_str()).collect()
}

fn frame(change: &Value) -> u64 {
    change["sequence"].as_u64().expect("a frame")
}

#[test]
fn a_camera_that_turns_in_flight_is_found_corrected_and_told() {
    let bench = Bench::new();
    // The mount gives way from pair 25 to pair 26.
    let turned = scene(&bench, "turned.toml", "seconds = 7.2", "right_pitch_deg = [[2, 0], [2.08, 0.2]]");
    let (found, log) = changes(&bench, &turned, &[]);
    println!("{found:#?}");
    assert!(states(&found)[0] == "good" && frame(&found[0]) < 25 && found[0]["moved_px"] == 0.0);
    let last = found.last().expect("changes");
    assert_eq!((&last["state"], &last["cause"]), (&"good".into(), &"none".into()));
    assert!(frame(last) <= 60, "{last}");
    let moved_px = last["moved_px"].as_f64().expect("a change");
    assert!((moved_px + TURNED_PX).abs() < 0.3, "{moved_px}");
    let text = last["text"].as_str().expect("words");
    assert!(text.contains("cameras moved by ") && text.contains("distances at 30 m uncertain by "), "{text}");
    assert!(log.contains("calibrate again soon"), "{log}");

    // Without correction it stays degraded, and says what that costs.
    let (found, log) = changes(&bench, &turned, &["--set", "calibration.correct_px=0"]);
    println!("{found:#?}");
    let first = found.iter().find(|change| change["state"] == "degraded").expect("it is found");
    assert!((25..=55).contains(&frame(first)) && first["cause"] == "rows_differ", "{first}");
    assert_eq!(states(&found).last(), Some(&"degraded"));
    assert!(found.iter().all(|change| change["corrected_px"] == 0.0));
    let text = first["text"].as_str().expect("words");
    assert!(
        text.starts_with("degraded: rows differ by ") && text.contains(" % of the matches lost"),
        "{text}"
    );
    assert!(log.contains(text) && log.contains("calibrate again"), "{log}");
    let lost = first["lost"].as_f64().expect("a share");
    assert!(lost > 0.09 && lost < 0.5, "{lost}");
    let typical_px = found.last().expect("changes")["typical_px"].as_f64().expect("an offset");
    assert!((typical_px + TURNED_PX).abs() < 0.3, "{typical_px}");

    // An offset beyond the permitted correction stays degraded; the bound and the switch have effect.
    let (found, _) = changes(&bench, &turned, &["--set", "calibration.correct_px=1"]);
    println!("{found:#?}");
    let last = found.last().expect("changes");
    assert_eq!((&last["state"], &last["cause"]), (&"degraded".into(), &"beyond_correction".into()));
    let more = ["--set", "calibration.bound_px=3", "--set", "calibration.correct_px=0"];
    let (found, _) = changes(&bench, &turned, &more);
    assert!(states(&found).iter().all(|state| *state == "good"), "{found:#?}");
    let (found, log) = changes(&bench, &turned, &["--set", "calibration.check=false"]);
    assert!(found.is_empty() && !log.contains("calibration"), "{found:?} {log}");
}

#[test]
fn a_slow_drift_and_a_roll_are_corrected_without_a_word_of_alarm() {
    let bench = Bench::new();
    let drift = scene(&bench, "drift.toml", "seconds = 9.6", "right_pitch_deg = [[1, 0], [9, 0.2]]");
    let (found, _) = changes(&bench, &drift, &[]);
    println!("{found:#?}");
    assert!(found.iter().all(|change| change["state"] == "good" && change["lost"].as_f64() < Some(0.05)));
    assert!(found.last().expect("changes")["moved_px"].as_f64() > Some(0.4), "{found:#?}");
}

#[test]
fn cameras_that_do_not_move_stay_good() {
    let bench = Bench::new();
    for (name, camera) in [("still.toml", ""), ("sway.toml", "sway_pitch_deg = 0.3\nsway_roll_deg = 0.3")] {
        let still = scene(&bench, name, "seconds = 4.8", camera);
        let (found, _) = summary(&bench, &still, &["--set", "calibration.every_frames=1"]);
        let changes = found["calibration"].as_array().expect("changes");
        assert_eq!(states(changes), ["good"], "{name}: {changes:#?}");
        let last = &found["calibration_last"];
        assert_eq!((&last["corrected_px"], &last["moved_px"]), (&0.0.into(), &0.0.into()), "{name}: {last}");
        assert!(last["lost"].as_f64() < Some(0.01), "{name}: {last}");
    }
}

#[test]
fn the_status_tells_what_is_degraded_and_what_is_corrected() {
    let bench = Bench::new();
    let off = scene(&bench, "off.toml", "seconds = 6\nrepeats = true", "right_pitch_deg = 0.2");
    let daemon = bench.start(&["replay", &off, "--set", "calibration.correct_px=0"]);
    let status = bench.status_when(|s| s["state"] == "degraded");
    let health = &status["calibration"];
    assert_eq!((&health["state"], &health["cause"]), (&"degraded".into(), &"rows_differ".into()));
    assert!((health["offset_px"].as_f64().unwrap() - TURNED_PX).abs() < 0.3, "{status:#}");
    assert!(health["lost"].as_f64() > health["lost_max"].as_f64(), "{status:#}");
    // The rows differed from the start on: nothing has moved.
    assert_eq!(health["moved"], false);
    let reason = status["reason"].as_str().unwrap();
    assert!(reason.starts_with("calibration degraded: rows differ by 1."), "{reason}");
    assert!(reason.ends_with("calibrate again") && !reason.contains("moved"), "{reason}");
    let table = bench.ok(&["status"]);
    assert!(table.contains("calibration: degraded: rows differ by 1."), "{table}");
    daemon.signal("TERM");
    daemon.wait();

    let daemon = bench.start(&["replay", &off]);
    let status = bench.status_when(|s| {
        s["calibration"]["state"] == "good" && s["calibration"]["corrected_px"].as_f64() < Some(-1.3)
    });
    assert_eq!((&status["state"], &status["reason"]), (&"running".into(), &"".into()));
    assert_eq!(status["calibration"]["moved"], false, "{status:#}");
    let table = bench.ok(&["status"]);
    assert!(table.contains("calibration: good: ") && table.contains("rows shifted by -1."), "{table}");
    daemon.signal("TERM");
    daemon.wait();
    bench.assert_clean();
}

#[test]
fn swapped_and_identical_pictures_are_told() {
    let bench = Bench::new();
    let recording = bench.record("drive", 20);
    let (found, _) = changes(&bench, &recording, &[]);
    assert!(found.iter().all(|change| change["cause"] == "none"), "{found:#?}");
    let folder = Path::new(&recording);
    let rename = |from: &str, to: &str| std::fs::rename(folder.join(from), folder.join(to)).expect("renamed");
    rename("left", "old");
    rename("right", "left");
    rename("old", "right");
    let (found, log) = changes(&bench, &recording, &[]);
    let last = found.last().expect("changes");
    assert_eq!((&last["state"], &last["cause"]), (&"degraded".into(), &"swapped".into()), "{found:#?}");
    assert!(frame(last) < 12 && log.contains("exchange left and right: the cameras, folders"), "{log}");
    std::fs::remove_dir_all(folder.join("right")).expect("removed");
    std::fs::create_dir(folder.join("right")).expect("created");
    for file in std::fs::read_dir(folder.join("left")).expect("pictures").flatten() {
        std::fs::copy(file.path(), folder.join("right").join(file.file_name())).expect("copied");
    }
    let (found, log) = changes(&bench, &recording, &[]);
    let last = found.last().expect("changes");
    assert_eq!((&last["state"], &last["cause"]), (&"degraded".into(), &"identical".into()), "{found:#?}");
    assert!(frame(last) < 12 && log.contains("its own device, folder or picture"), "{log}");
}

/// A recording of one real pair, `count` times, whose right picture has its rows moved down by `rows` in all, half pixels
/// as the mean of two rows; `None` without the data.
fn real_pair(bench: &Bench, name: &str, rows: f64, count: usize) -> Option<String> {
    let data = shared_data("kitti2015")?;
    let folder = bench.path(name);
    for side in ["left", "right"] {
        std::fs::create_dir_all(folder.join(side)).expect("folders");
    }
    let read =
        |side: &str| sources::folder::read_grey(&data.join(side).join("000016_10.png")).expect("a picture");
    let ((left, width, height), (right, ..)) = (read("image_2"), read("image_3"));
    let at = |y: f64, x: usize| right[(y.clamp(0.0, (height - 1) as f64) as usize) * width + x];
    let moved: Vec<u8> = (0..width * height)
        .map(|i| {
            let y = (i / width) as f64 - rows;
            ((u16::from(at(y.floor(), i % width)) + u16::from(at(y.ceil(), i % width))) / 2) as u8
        })
        .collect();
    for index in 0..count {
        for (side, pixels) in [("left", &left), ("right", &moved)] {
            let path = folder.join(side).join(format!("{index:06}.pgm"));
            save_grey(&path, pixels, width as u32, height as u32);
        }
    }
    let rig = "focal_px = 721.5377\nbaseline_m = 0.5327\ncx_px = 609.5593\ncy_px = 172.854\n";
    std::fs::write(folder.join("rig.toml"), rig).expect("the rig is written");
    Some(folder.display().to_string())
}

#[test]
fn a_real_pair_with_moved_rows_is_corrected_or_told() {
    let bench = Bench::new();
    let Some(moved) = real_pair(&bench, "moved", 1.5, 24) else { return };
    let more = ["--set", "stereo.disparities=128"];
    let (found, _) = summary(&bench, &moved, &more);
    let last = &found["calibration_last"];
    assert_eq!((&last["state"], &last["cause"]), (&"good".into(), &"none".into()), "{found:#}");
    // The set's own rectification leaves 0.3 px.
    let corrected_px = last["corrected_px"].as_f64().expect("a shift");
    assert!((corrected_px - 1.8).abs() < 0.2 && last["lost"].as_f64() < Some(0.02), "{last}");
    let (found, _) = changes(&bench, &moved, &[&more[..], &["--set", "calibration.correct_px=0"]].concat());
    assert_eq!(states(&found), ["degraded"], "{found:#?}");
    // As it was recorded nothing is degraded, not in the first frames either.
    let plain = real_pair(&bench, "plain", 0.0, 12).expect("the data is there");
    let (found, _) = changes(&bench, &plain, &more);
    assert_eq!(states(&found), ["good"], "{found:#?}");
    // Ten rows: beyond what is measured.
    let far = real_pair(&bench, "far", 10.0, 12).expect("the data is there");
    let (found, _) = changes(&bench, &far, &more);
    println!("{found:#?}");
    let last = found.last().expect("changes");
    assert_eq!((&last["state"], &last["cause"]), (&"degraded".into(), &"rows_apart".into()), "{found:#?}");
}
