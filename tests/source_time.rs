//! `lookout evaluate time`: gaps, jumps and repeats in the source's time raise no alarm that the truth does not have.

use crate::support::{Bench, document};

/// Scenes with traffic beside the path, and one with an obstacle in it.
const ARGS: [&str; 10] = [
    "evaluate",
    "time",
    "next-lane",
    "stopped-car",
    "car-rear",
    "--weather",
    "sunny",
    "--duration",
    "240",
    "--json",
];

#[test]
fn faults_in_time_raise_no_false_alarm_and_hide_no_true_one() {
    let bench = Bench::new();
    let report = document(&bench, &[&ARGS[..], &["--seed", "5", "--threads", "2", "--check"]].concat());
    for zero in ["false_alarms", "missed", "meaningless"] {
        assert_eq!(report[zero], 0, "{report}");
    }
    assert!(report["true_alarms"].as_u64() >= Some(3), "{report}");
    assert!(report["due"].as_u64() >= Some(1), "{report}");
    assert!(report["source_s"].as_f64() >= Some(240.0), "{report}");
    let faults = report["faults"].as_object().expect("faults by kind");
    for kind in ["gap", "jump_forward", "scene_change"] {
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
    let args = [&ARGS[..], &["--seed", "5", "--threads", "2", "--regular-stamps", "--check"]].concat();
    let output = bench.run(&args);
    assert_eq!(output.status.code(), Some(1), "{output:?}");
    let error = String::from_utf8_lossy(&output.stderr);
    assert!(error.contains("false alarms"), "{error}");
}
