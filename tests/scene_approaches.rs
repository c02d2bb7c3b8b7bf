//! `lookout evaluate distance` over whole scenes: approaches that must raise the alarm, scenes that must stay silent.

use crate::support::{Bench, document};

#[test]
fn approaches_raise_the_alarm_and_silent_scenes_do_not() {
    let bench = Bench::new();
    let args = ["evaluate", "distance", "green-belt", "slope", "--set", "alarm.distance_m=14"];
    let report = document(&bench, &[&args[..], &["--json", "--out", "out"]].concat());
    let (approach, silent) = (&report["approaches"][0], &report["silent"][0]);
    assert_eq!((&approach["scene"], &silent["scene"]), (&"green-belt".into(), &"slope".into()));
    assert!((approach["start_m"].as_f64().unwrap() - 20.0).abs() < 0.05, "{approach}");
    assert!(approach["first_found_m"].as_f64().unwrap() > 17.0, "{approach}");
    assert_eq!(approach["preset_m"], 14.0);
    let alarm = approach["alarm_m"].as_f64().expect("the hedge raises the alarm");
    assert!((12.0..15.5).contains(&alarm), "{approach}");
    assert_eq!((&silent["frames"], &silent["alarms"]), (&100.into(), &0.into()));
    let strip = image::open(bench.path("out/green-belt.png")).unwrap();
    assert!(strip.width() > 3 * 320 && strip.height() > 240);
    assert!(!bench.path("out/slope.png").exists());
}

#[test]
fn a_stopped_car_is_warned_of_in_time_and_the_next_lane_is_not() {
    let bench = Bench::new();
    let args = ["evaluate", "distance", "stopped-car", "car-rear", "next-lane", "overtaken", "--json"];
    let report = document(&bench, &args);
    let [stopped, rear] = [0, 1].map(|i| &report["approaches"][i]);
    assert!(stopped["warning_ttc_s"].as_f64() >= Some(2.4), "{stopped}");
    for approach in [stopped, rear] {
        assert!(approach["ttc_median_percent"].as_f64() <= Some(3.0), "{approach}");
        assert!(approach["ttc_worst_percent"].as_f64() <= Some(10.0), "{approach}");
        assert_eq!(approach["ttc_missed"], 0, "{approach}");
    }
    // The preset distance, within a frame: 0.4 m at 5 m/s.
    let alarm = rear["alarm_m"].as_f64().expect("the car raises the alarm");
    assert!((9.6..=10.4).contains(&alarm), "{rear}");
    for silent in report["silent"].as_array().expect("silent scenes") {
        assert_eq!((&silent["alarms"], &silent["warning_frames"]), (&0.into(), &0.into()), "{silent}");
        assert_eq!(silent["off_frames"], 0, "it judges all the while: {silent}");
    }
}

#[test]
fn what_is_passed_in_bends_and_at_junctions_raises_nothing() {
    let bench = Bench::new();
    let scenes = [
        "bend-parked",
        "bend-parked-left",
        "bend-overtaking",
        "bend-overtaken",
        "bend-oncoming",
        "junction-parked",
    ];
    let report = document(&bench, &[&["evaluate", "distance"], &scenes[..], &["--json"]].concat());
    let silent = report["silent"].as_array().expect("silent scenes");
    assert_eq!(silent.len(), scenes.len());
    for scene in silent {
        assert_eq!((&scene["alarms"], &scene["warning_frames"]), (&0.into(), &0.into()), "{scene}");
    }
}
