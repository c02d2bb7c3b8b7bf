//! `lookout evaluate ncap`: a car that stands is warned of in time, one aside is not; without rules a run fails; the page,
//! the scenes, and bad input.

use crate::support::{Bench, document, json};
use serde_json::Value;

/// One place of impact, sunny.
const SHORT: [&str; 4] = ["--nominal", "--weather", "sunny", "--threads=2"];

fn evaluate(bench: &Bench, args: &[&str]) -> Value {
    document(bench, &[&["evaluate", "ncap", "--json"], &SHORT[..], args].concat())
}

#[test]
fn a_car_that_stands_is_warned_of_in_time() {
    let bench = Bench::new();
    let report = evaluate(&bench, &["--rows", "ccrs", "--speeds", "20", "--only", "impacts"]);
    let run = &report["runs"][0];
    assert_eq!(
        (&run["row"], &run["passed"], &run["impact_m_s"]),
        (&"CCRs".into(), &true.into(), &0.0.into())
    );
    let ttc = |name: &str| run["ttc_s"][name].as_f64().unwrap_or(-1.0);
    assert!((1.7..4.0).contains(&ttc("warning")) && ttc("alarm") > 0.5, "{report}");
    assert!(ttc("visible") > 5.0 && ttc("visible") >= ttc("detected"), "{report}");
    assert!(ttc("detected") >= ttc("tracked") && ttc("tracked") > ttc("warning"), "{report}");
    assert_eq!(run["due"], serde_json::json!({"warning": true, "alarm": "avoid"}));
    assert!((run["free_impact_m_s"].as_f64().unwrap() - 20.0 / 3.6).abs() < 1e-6, "{report}");
    assert_eq!((&report["sums"][0]["runs"], &report["table"][0]["judged"]), (&[1, 1].into(), &1.into()));
}

#[test]
fn without_rules_nothing_is_warned_of_and_the_page_says_so() {
    let bench = Bench::new();
    let off: Vec<String> =
        ["ttc_warning_s", "ttc_alarm_s", "deceleration_warning_m_s2", "deceleration_alarm_m_s2"]
            .map(|key| format!("--set=alarm.{key}=0"))
            .into();
    let off: Vec<&str> = off.iter().map(String::as_str).collect();
    let choice = ["--rows", "CCRs-FCW", "--speeds", "80", "--only", "impacts", "--out", "out"];
    let report = evaluate(&bench, &[&choice[..], &off].concat());
    let run = &report["runs"][0];
    assert_eq!((&run["passed"], &run["is_warning_only"]), (&false.into(), &true.into()), "{report}");
    assert!(run["reasons"][0].as_str().is_some_and(|why| why.starts_with("warning late")), "{report}");
    assert_eq!(json(&bench.path("out/evaluation.json")), report);
    // The same runs, in the order in which they ended.
    let ended = std::fs::read_to_string(bench.path("out/runs.jsonl")).unwrap();
    let mut ended: Vec<Value> = ended.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    let mut runs = report["runs"].as_array().unwrap().clone();
    for list in [&mut ended, &mut runs] {
        list.sort_by_key(|run| run["id"].as_str().unwrap().to_owned());
    }
    assert_eq!(ended, runs);
    let page = std::fs::read_to_string(bench.path("out/index.html")).unwrap();
    assert!(page.contains("w1.7*") && page.contains("warning late") && page.contains("image/jpeg"), "{page}");
    // The scene of the run is a scene like any other.
    let scene = format!("scene:out/scenes/{}.toml", run["id"].as_str().unwrap());
    bench.ok(&["replay", &scene, "--in-process", "--limit", "2", "--out", "frames"]);
}

#[test]
fn who_walks_aside_is_no_reason_for_a_warning() {
    let bench = Bench::new();
    let report = evaluate(&bench, &["--rows", "CPLA", "--speeds", "20", "--only", "near-misses"]);
    assert_eq!(report["near_miss_sums"][0]["runs"][1], 2, "{report}");
    let far = report["runs"].as_array().unwrap().iter().find(|run| run["miss"] == "beside by 1.0 m").unwrap();
    assert_eq!((&far["passed"], &far["due"]), (&true.into(), &Value::Null), "{report}");
    assert!(report["table"].as_array().unwrap().is_empty());
}

#[test]
fn mistakes_are_told_before_the_run() {
    let bench = Bench::new();
    let error = bench.fails(&["evaluate", "ncap", "--rows", "CCRx"]);
    assert!(error.contains("--rows CCRx: no such row in 2026") && error.contains("CPNCO"), "{error}");
    let error = bench.fails(&["evaluate", "ncap", "--rows", "CCRs", "--speeds", "77"]);
    assert!(error.contains("none of the tests has any of these speeds: give some of"), "{error}");
    assert!(error.contains(" 20, ") && !error.contains("77"), "{error}");
    for wrong in [
        &["--year", "2020"][..],
        &["--rig", "none"],
        &["--fps", "1"],
        &["--seeds", "9-3"],
        &["--weather", "hail"],
        &["--only", "some"],
    ] {
        let output = bench.run(&[&["evaluate", "ncap"], wrong].concat());
        assert_eq!(output.status.code(), Some(2), "{wrong:?}");
    }
}
