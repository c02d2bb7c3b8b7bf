//! `lookout evaluate time`: gaps, jumps and repeats in the source's time raise no alarm that the truth does not have.

use crate::support::{Bench, document, json, lines};

/// Scenes with traffic beside the path, and one with an obstacle in it.
const ARGS: [&str; 8] =
    ["evaluate", "time", "next-lane", "stopped-car", "car-rear", "--weather", "sunny", "--json"];

#[test]
fn faults_in_time_raise_no_false_alarm_and_hide_no_true_one() {
    let bench = Bench::new();
    let report = document(
        &bench,
        &[&ARGS[..], &["--duration", "150", "--seed", "5", "--threads", "2", "--check"]].concat(),
    );
    for zero in ["false_alarms", "missed", "meaningless"] {
        assert_eq!(report[zero], 0, "{report}");
    }
    assert!(report["true_alarms"].as_u64() >= Some(3), "{report}");
    assert!(report["due"].as_u64() >= Some(1), "{report}");
    assert!(report["source_s"].as_f64() >= Some(150.0), "{report}");
    let faults = report["faults"].as_object().expect("faults by kind");
    for kind in ["gap", "jump_back", "scene_change"] {
        assert!(faults[kind].as_u64() >= Some(2), "{report}");
    }
    // The stage has noticed them.
    let counted = &report["counted"];
    assert!(counted["gap"].as_u64() >= faults["scene_change"].as_u64(), "{report}");
    assert_eq!(counted["dropped_obstacle"], 0, "{report}");
}

/// The companion: with stamps that hide the faults, the same evaluation finds alarms without a cause, or misses some.
#[test]
fn faults_that_the_stages_cannot_know_of_are_found_by_the_check() {
    let bench = Bench::new();
    let more = ["--duration", "80", "--seed", "5", "--threads", "2", "--regular-stamps", "--check"];
    let args = [&ARGS[..], &more].concat();
    let output = bench.run(&args);
    assert_eq!(output.status.code(), Some(1), "{output:?}");
    let error = String::from_utf8_lossy(&output.stderr);
    assert!(error.contains("false alarms"), "{error}");
}

#[test]
fn the_daemon_counts_gaps_and_switches_the_alarm_off_when_there_are_too_many() {
    let bench = Bench::new();
    // One pair in two seconds.
    let args = ["replay", "scene:street", "--lockstep", "--limit", "8", "--set", "source.fps=0.5"];
    bench.ok(&[&args[..], &["--out", "results"]].concat());
    let counted = &json(&bench.path("results/summary.json"))["source_time"];
    assert_eq!((&counted["gaps"], &counted["steps_back"]), (&7.into(), &0.into()), "{counted}");
    let results = lines(&bench.path("results"));
    let reason = |k: usize| results[k]["alarm"]["reason"].as_str().unwrap_or("").to_owned();
    assert!(!reason(2).contains("time of the source"), "{:?}", results[2]["alarm"]);
    for k in 3..8 {
        assert!(reason(k).contains("time of the source"), "{:?}", results[k]["alarm"]);
    }
}
