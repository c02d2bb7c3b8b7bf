//! The online check of the calibration: a right camera that turns during a run is detected, reported with the
//! reason, and corrected where that is configured.

use crate::support::Bench;
use serde_json::Value;

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
    let output = bench.run(&[&["replay", scene, "--lockstep", "--json"], more].concat());
    let log = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(output.status.success(), "{log}");
    let summary: Value = serde_json::from_slice(&output.stdout).expect("the summary is JSON");
    (summary["calibration"].as_array().expect("changes").clone(), log)
}

fn states(changes: &[Value]) -> Vec<&str> {
    changes.iter().filter_map(|change| change["state"].as_str()).collect()
}

#[test]
fn a_camera_that_turns_in_flight_is_noticed_within_30_frames_and_corrected() {
    let bench = Bench::new();
    // The mount gives way from pair 25 to pair 26.
    let turned = scene(&bench, "turned.toml", "seconds = 7.2", "right_pitch_deg = [[2, 0], [2.08, 0.2]]");
    let (found, log) = changes(&bench, &turned, &[]);
    println!("{found:#?}");
    assert_eq!(states(&found), ["good", "degraded"]);
    let at = |change: &Value| change["sequence"].as_u64().expect("a frame");
    assert!(at(&found[0]) < 25 && (25..=55).contains(&at(&found[1])));
    let text = found[1]["text"].as_str().expect("words");
    assert!(text.starts_with("degraded: vertical offset ") && text.contains("(bound 0.5)"), "{text}");
    let worst_px = found[1]["worst_px"].as_f64().expect("an offset");
    assert!(worst_px > 0.5 && worst_px < -TURNED_PX + 0.3, "{worst_px}");
    assert!(log.contains(text) && log.contains("calibrate again"), "{log}");

    let (found, _) = changes(&bench, &turned, &["--set", "calibration.correct_px=3"]);
    println!("{found:#?}");
    assert_eq!(states(&found), ["good", "degraded", "good"]);
    let shift = found[2]["corrected_px"].as_f64().expect("a shift");
    assert!((shift - TURNED_PX).abs() < 0.2, "{shift}");
    assert_eq!(found[1]["corrected_px"], 0.0);

    // An offset beyond the permitted correction stays degraded; the bound and the switch have effect.
    let (found, _) = changes(&bench, &turned, &["--set", "calibration.correct_px=1"]);
    assert_eq!(states(&found), ["good", "degraded"]);
    let (found, _) = changes(&bench, &turned, &["--set", "calibration.bound_px=3"]);
    assert_eq!(states(&found), ["good"]);
    let (found, log) = changes(&bench, &turned, &["--set", "calibration.check=false"]);
    assert!(found.is_empty() && !log.contains("calibration"), "{found:?} {log}");
}

#[test]
fn cameras_that_do_not_move_stay_good() {
    let bench = Bench::new();
    for (name, camera) in [("still.toml", ""), ("sway.toml", "sway_pitch_deg = 0.3\nsway_roll_deg = 0.3")] {
        let still = scene(&bench, name, "seconds = 4.8", camera);
        let (found, _) = changes(&bench, &still, &["--set", "calibration.every_frames=1"]);
        assert_eq!(states(&found), ["good"], "{name}: {found:#?}");
    }
}

#[test]
fn the_status_reports_a_degraded_calibration_and_its_recovery() {
    let bench = Bench::new();
    let off = scene(&bench, "off.toml", "seconds = 6\nrepeats = true", "right_pitch_deg = 0.2");
    let daemon = bench.start(&["replay", &off]);
    let status = bench.status_when(|s| s["state"] == "degraded");
    let health = &status["calibration"];
    assert_eq!(health["state"], "degraded");
    assert!((health["offset_px"].as_f64().unwrap() - TURNED_PX).abs() < 0.3, "{status:#}");
    let reason = status["reason"].as_str().unwrap();
    assert!(reason.starts_with("calibration degraded: vertical offset 1."), "{reason}");
    let table = bench.ok(&["status"]);
    assert!(table.contains("calibration: degraded: vertical offset 1."), "{table}");
    daemon.signal("TERM");
    daemon.wait();

    let daemon = bench.start(&["replay", &off, "--set", "calibration.correct_px=3"]);
    let status =
        bench.status_when(|s| s["calibration"]["state"] == "good" && s["calibration"]["corrected_px"] != 0.0);
    assert_eq!((&status["state"], &status["reason"]), (&"running".into(), &"".into()));
    let table = bench.ok(&["status"]);
    assert!(table.contains("calibration: good: ") && table.contains("rows shifted by -1."), "{table}");
    daemon.signal("TERM");
    daemon.wait();
    bench.assert_clean();
}
