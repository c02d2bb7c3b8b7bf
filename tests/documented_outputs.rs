//! Every field that the daemon gives as JSON stands in docs/outputs.md: status, summary, results, and lines of the stream.
//! The blocks `device` and `can_out` are tested where the features are: `gpu.rs`, `can_out.rs`.

use crate::support::documented::{Pages, fields};
use crate::support::{Bench, Daemon, document, json, lines};
use serde_json::Value;

/// Pairs of the scene: from frame 63 on its car is a cause of warning.
const FRAMES: &str = "66";

/// Pairs of the recording.
const RECORDED: u64 = 20;

fn page() -> Pages {
    Pages::read(&["outputs.md"])
}

/// Asserts that documents, which have the fields `expected`, have no field that is not documented.
#[track_caller]
fn assert_documented(what: &str, documents: &[Value], expected: &[&str]) {
    let all = Value::Array(documents.to_vec());
    let found = fields(&all);
    for field in expected {
        assert!(found.contains(*field), "{what} has no {field}, so it is not tested: {found:#?}");
    }
    let missing = page().missing(&all);
    assert!(missing.is_empty(), "docs/outputs.md does not name these fields of {what}: {missing:#?}");
}

#[test]
fn the_fields_of_results_are_documented() {
    let bench = Bench::new();
    bench.ok(&["replay", "scene:drive", "--lockstep", "--limit", FRAMES, "--out", "out"]);
    let expected = [
        "boundaries.sigma_m",
        "alarm.object.clearance_m",
        "obstacles.time_to_collision_sigma_s",
        "road.horizon_px",
    ];
    assert_documented("obstacles.jsonl", &lines(&bench.path("out")), &expected);
    // Nothing can be matched, so the alarm is off.
    bench.ok(&["replay", "scene:textureless", "--lockstep", "--limit", "4", "--out", "dark"]);
    let summaries = ["out", "dark"].map(|folder| json(&bench.path(folder).join("summary.json")));
    let expected = [
        "alarm_changes.object.track",
        "alarm_times.off_reasons.seconds",
        "calibration.text",
        "calibration_last.state",
        "processes.work.p50_ms",
    ];
    assert_documented("summary.json", &summaries, &expected);
}

/// A board with a sensor and a clock, and a recording of a vehicle that reports its motion.
fn start(bench: &Bench) -> Daemon {
    for (file, text) in [
        ("class/thermal/thermal_zone0/type", "cpu-thermal\n"),
        ("class/thermal/thermal_zone0/temp", "60000\n"),
        ("devices/system/cpu/cpufreq/policy0/scaling_min_freq", "600000\n"),
        ("devices/system/cpu/cpufreq/policy0/scaling_max_freq", "2400000\n"),
        ("devices/system/cpu/cpufreq/policy0/scaling_cur_freq", "2400000\n"),
    ] {
        let path = bench.path("sys").join(file);
        std::fs::create_dir_all(path.parent().expect("a folder")).expect("folders");
        std::fs::write(path, text).expect("the file is written");
    }
    bench.configure(&format!(
        "[heat]\nwatch = \"require\"\nzones = \"cpu*\"\nperiod_ms = 100\n\
         [clocks]\nset = \"require\"\ncpu_mhz = 2400\ncheck_ms = 100\n[board]\nsysfs = \"{}\"\n",
        bench.path("sys").display()
    ));
    let recording = bench.record("drive", RECORDED);
    let time_s = |n: u64| 100.0 + n as f64 * 0.1;
    let times: String = (0..RECORDED).map(|n| format!("{n:06}.png,{}\n", time_s(n))).collect();
    let motion: String = (0..RECORDED).map(|n| format!("{},10,0\n", time_s(n))).collect();
    std::fs::write(bench.path("drive/timestamps.csv"), format!("name,left_s\n{times}")).expect("written");
    std::fs::write(bench.path("drive/motion.csv"), format!("time_s,speed_m_s,yaw_rate_rad_s\n{motion}"))
        .expect("written");
    bench.start(&["replay", &recording, "--fps", "10", "--loop"])
}

#[test]
fn the_fields_of_the_status_and_of_the_stream_are_documented() {
    let bench = Bench::new();
    let daemon = start(&bench);
    bench.status_when(|status| {
        let has = |field: &Value| field[0].is_object();
        status["vehicle"].is_object()
            && has(&status["heat"]["zones"])
            && has(&status["heat"]["clocks"])
            && has(&status["alarm_changes"])
    });
    let out = bench.ok(&["stream", "--topics", "all", "--limit", "15"]);
    let stream: Vec<Value> = out.lines().map(|line| serde_json::from_str(line).expect("JSON")).collect();
    let status = document(&bench, &["status", "--json"]);
    daemon.signal("TERM");
    assert!(daemon.wait().status.success());
    let expected = [
        "alarm_changes.alarm.level",
        "heat.clocks.read_mhz",
        "heat.zones.celsius",
        "processes.privileges_refused",
        "vehicle.faults.stale",
    ];
    assert_documented("lookout status --json", &[status], &expected);
    assert_documented("lookout stream", &stream, &["capture_ns", "latency_ms", "run", "withdrawn"]);
    bench.assert_clean();
}

#[test]
fn a_field_that_no_page_names_is_found() {
    let text = "`alarm.level`, `alarm.object.class`\n| `speed_m_s`, `…_sigma_m_s` | the `lost one` |\n\
                `times.<level>.frames`, `zones[].name`, `status.state`\n```json\n`example`\n```\n";
    let document = serde_json::json!({
        "alarm": { "level": 0, "rule": 0 },
        "alarm_object": { "class": "", "track": 0 },
        "motion": { "speed_m_s": 0, "speed_sigma_m_s": 0, "yaw_sigma_m_s": 0 },
        "path": { "level": 0 },
        "times": { "off": { "frames": 0, "seconds": 0 } },
        "zones": [{ "name": 0, "celsius": 0 }, null],
        "state": "", "lost": [], "example": {}, "stages_ms": { "a stage": 0 },
    });
    let expected = [
        "alarm.rule",
        "alarm_object.track",
        "example",
        "lost",
        "motion.yaw_sigma_m_s",
        "path.level",
        "stages_ms",
        "times.off.seconds",
        "zones",
        "zones.celsius",
    ];
    assert_eq!(Pages::parse(text).missing(&document), expected);
    // The real page, too, lacks what no daemon gives.
    let document = serde_json::json!({ "alarm": { "level": 0, "no_such_field": 0 } });
    assert_eq!(page().missing(&document), ["alarm.no_such_field"]);
}
