//! The alarm in plain words: level, reason, object and clearance of each frame; frames and time by level in the summary.

use crate::support::{Bench, json, lines};
use serde_json::Value;

/// Number of frames of each level in `obstacles.jsonl`.
fn counts(lines: &[Value]) -> [u64; 4] {
    ["off", "clear", "warning", "alarm"]
        .map(|level| lines.iter().filter(|line| line["alarm"]["level"] == level).count() as u64)
}

/// Number of frames, and the seconds, of each level in `summary.json`.
fn times(summary: &Value) -> ([u64; 4], f64) {
    let times = &summary["alarm_times"];
    let levels = ["off", "clear", "warning", "alarm"].map(|level| &times[level]);
    let seconds = levels.iter().map(|level| level["seconds"].as_f64().unwrap()).sum();
    (levels.map(|level| level["frames"].as_u64().unwrap()), seconds)
}

#[test]
fn every_frame_tells_why_and_the_summary_counts() {
    let bench = Bench::new();
    let recording = bench.record("drive", 40);
    bench.ok(&["replay", &recording, "--lockstep", "--out", "a"]);
    let told = bench.ok(&["replay", &recording, "--in-process", "--out", "b"]);
    let all = lines(&bench.path("a"));
    let levels = counts(&all);
    assert!(levels[1] > 0 && levels[2] + levels[3] > 0, "the car ahead comes near: {levels:?}");
    for line in &all {
        let alarm = &line["alarm"];
        assert!(alarm["reason"].as_str().is_some_and(|reason| !reason.is_empty()), "{alarm}");
        let (level, object) = (alarm["level"].as_str().unwrap(), &alarm["object"]);
        if level == "warning" || level == "alarm" {
            assert_eq!(object["track"], alarm["track"], "{alarm}");
            let here = line["obstacles"].as_array().unwrap();
            if let Some(obstacle) = here.iter().find(|o| o["track"] == object["track"]) {
                for field in ["class", "clearance_m"] {
                    assert_eq!(object[field], obstacle[field], "{alarm} {obstacle}");
                }
                let clearance_m = object["clearance_m"].as_f64().unwrap();
                // Half of what overlaps at most: the smaller of both widths.
                assert!(clearance_m > -4.0 && (obstacle["in_path"] == false || clearance_m < 0.5), "{line}");
            }
        } else if level == "clear" {
            assert_eq!(object.is_null(), alarm["nearest_m"].is_null(), "{alarm}");
        }
    }
    let summaries = ["a", "b"].map(|folder| json(&bench.path(folder).join("summary.json")));
    for field in ["alarms", "alarm_changes"] {
        assert_eq!(summaries[0][field], summaries[1][field], "{field}");
    }
    assert!(summaries[0]["alarm_changes"].as_array().is_some_and(|changes| changes.len() > 1));
    for (folder, summary) in ["a", "b"].into_iter().zip(summaries) {
        let (frames, seconds) = times(&summary);
        assert_eq!(frames, levels, "{folder}: {summary}");
        // The last frame has no time yet.
        assert!((seconds - 3.9).abs() < 1e-6, "{folder}: {summary}");
    }
    assert!(told.contains("alarm off in") && told.contains("clear in"), "{told}");
}

#[test]
fn the_summary_says_why_the_alarm_was_off() {
    let bench = Bench::new();
    let recording = bench.record("drive", 12);
    // Black pictures from frame 4 on.
    for (side, i) in ["left", "right"].into_iter().flat_map(|side| (4..12).map(move |i| (side, i))) {
        let path = bench.path("drive").join(side).join(format!("{i:06}.png"));
        crate::support::save_grey(&path, &vec![0; 320 * 240], 320, 240);
    }
    let told = bench.ok(&["replay", &recording, "--lockstep", "--out", "out"]);
    let all = lines(&bench.path("out"));
    let off = counts(&all)[0];
    assert!(off >= 5, "{off}");
    let summary = json(&bench.path("out/summary.json"));
    let reasons = summary["alarm_times"]["off_reasons"].as_array().unwrap();
    let dark = reasons.iter().find(|r| r["reason"] == "the picture is too dark").expect("a reason");
    let by_line = |line: &&Value| line["alarm"]["reason"].as_str().unwrap().contains("too dark");
    assert_eq!(dark["frames"].as_u64(), Some(all.iter().filter(by_line).count() as u64), "{summary}");
    assert!(dark["seconds"].as_f64() > Some(0.2), "{summary}");
    assert!(told.contains("frames (") && told.contains("the picture is too dark"), "{told}");
}

#[test]
fn a_camera_that_hangs_turns_the_alarm_off() {
    let bench = Bench::new();
    let recording = bench.record("drive", 40);
    // The left camera shows frame 14 until frame 29.
    let left = bench.path("drive").join("left");
    for i in 15..30 {
        std::fs::copy(left.join("000014.png"), left.join(format!("{i:06}.png"))).unwrap();
    }
    bench.ok(&["replay", &recording, "--lockstep", "--out", "out"]);
    let all = lines(&bench.path("out"));
    let is_told = |line: &Value| line["alarm"]["reason"].as_str().unwrap().contains("the same picture again");
    let told: Vec<usize> = (0..all.len()).filter(|&i| is_told(&all[i])).collect();
    // Half a second after the last new picture, and until the next one.
    assert_eq!(told, (20..30).collect::<Vec<_>>());
    assert!(told.iter().all(|&i| all[i]["alarm"]["level"] == "off"));
    assert_ne!(all[36]["alarm"]["level"], "off", "{}", all[36]["alarm"]);
    // Until then what is ahead is predicted.
    let ahead =
        |i: usize| all[i]["obstacles"].as_array().unwrap().iter().find(|o| o["in_path"] == true).cloned();
    let (before, coasting) = (ahead(14).expect("the car ahead"), ahead(17).expect("it is predicted"));
    assert_eq!((&before["track"], &coasting["predicted"]), (&coasting["track"], &Value::Bool(true)));
}
