//! `lookout soak`: faults are survived, budgets are checked, nothing is left behind.

use crate::support::{Bench, json};
use std::path::Path;
use std::process::Output;

/// Budgets that any machine keeps, so that the test does not depend on its speed.
const EASY: &str = "[soak]\nwarm_up_s = 1\nfault_pause_ms = 300\nnext_result_s = 60\nlatency_p50_ms = 10000\n\
                    latency_p99_ms = 20000\nlatency_p999_ms = 30000\ncpu_percent = 100\nprocessed_percent = 1\n\
                    memory_bytes = 1000000000\n";

fn soak(bench: &Bench, args: &[&str]) -> Output {
    let mut all = vec!["soak"];
    all.extend(args);
    bench.command(&all).arg("-c").arg(bench.path("car.toml")).output().expect("the binary runs")
}

fn text(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

fn number(report: &serde_json::Value, key: &str) -> f64 {
    report[key].as_f64().unwrap_or_else(|| panic!("{key} in {report}"))
}

fn line<'a>(report: &'a serde_json::Value, name: &str) -> &'a serde_json::Value {
    let lines = report["budgets"].as_array().expect("budgets");
    lines.iter().find(|l| l["name"] == name).unwrap_or_else(|| panic!("no budget {name}"))
}

/// Every count is explained: pairs by what became of them, results by where they are evaluated.
fn assert_counts_add_up(report: &serde_json::Value) {
    let n = |key| number(report, key);
    assert_eq!(n("offered") + n("surplus"), n("frames") + n("dropped") + n("lost"), "{report}");
    let [judged, disturbed] = [0, 1].map(|i| report["judged_frames"][i].as_f64().unwrap());
    assert_eq!(judged + disturbed + n("unsound"), n("traced"), "{report}");
    assert!(judged > 0.0 && n("unsound") == 0.0, "{report}");
}

fn assert_report_files(out: &Path, plots: &[&str]) {
    for name in ["soak.md", "soak.json", "daemon.toml", "daemon.log"] {
        assert!(out.join(name).is_file(), "{name}");
    }
    for name in plots {
        let svg = std::fs::read_to_string(out.join(name)).unwrap_or_else(|e| panic!("{name}: {e}"));
        assert!(svg.starts_with("<svg") && svg.contains("<path"), "{name}");
    }
}

#[test]
fn kills_are_survived_and_reported() {
    let bench = Bench::new();
    bench.configure(EASY);
    let recording = bench.record("drive", 10);
    let output =
        soak(&bench, &[&recording, "--kills", "6", "--seed", "11", "--fps", "10", "--out", "seen", "--json"]);
    assert!(output.status.success(), "{}", text(&output));
    let report: serde_json::Value = serde_json::from_slice(&output.stdout).expect("standard output is JSON");
    assert_eq!(json(&bench.path("seen/soak.json")), report);
    for (key, value) in [
        ("kills", 6.0),
        ("restarts", 6.0),
        ("failed_restarts", 0.0),
        ("leaked_shm_entries", 0.0),
        ("seed", 11.0),
    ] {
        assert_eq!(number(&report, key), value, "{key}: {report}");
    }
    assert_counts_add_up(&report);
    assert_eq!((&report["verdict"], &report["reasons"]), (&"pass".into(), &serde_json::json!([])));
    assert!(number(&report, "frames") > 10.0 && number(&report, "cpu_percent") > 0.0);
    assert!(number(&report, "rss_bytes") > 5e6 && number(&report, "next_result_s_max") > 0.05);
    for key in ["p50", "p99", "p999"] {
        assert!(report["latency_ms"][key].as_f64().is_some_and(|v| v > 0.0), "{report}");
    }
    // Half a minute is too short for a slope, and it says so.
    assert_eq!(line(&report, "slope_bytes_per_hour")["verdict"], "not_judged");
    assert_eq!(report["rss_slope_bytes_per_hour"], serde_json::Value::Null);
    let kills: u64 =
        report["fault_rows"].as_array().unwrap().iter().map(|r| r["count"].as_u64().unwrap()).sum();
    assert_eq!(kills, 6);
    assert_report_files(
        &bench.path("seen"),
        &["memory.svg", "latency.svg", "percentiles.svg", "cpu.svg", "recovery.svg"],
    );
    let page = std::fs::read_to_string(bench.path("seen/soak.md")).unwrap();
    assert!(page.contains("# Soak: pass") && page.contains("supervision.restart_count"), "{page}");
    bench.assert_clean();
}

#[test]
fn every_kind_of_fault_is_survived() {
    let bench = Bench::new();
    // Other tests may load the machine: only a stage that hangs may miss its deadline.
    bench.configure(EASY);
    let recording = bench.record("drive", 10);
    let output = soak(
        &bench,
        &[&recording, "--faults", "--minutes", "0.4", "--seed", "2", "--fps", "10", "--out", "seen"],
    );
    let report = json(&bench.path("seen/soak.json"));
    assert!(number(&report, "faults") >= 5.0, "{report}");
    assert_counts_add_up(&report);
    assert_eq!(number(&report, "leaked_shm_entries"), 0.0, "{report}");
    for row in report["fault_rows"].as_array().unwrap() {
        assert_eq!(row["failed"], 0, "{report}");
    }
    assert!(output.status.success(), "{}\n{}", text(&output), String::from_utf8_lossy(&output.stdout));
    bench.assert_clean();
}

#[test]
fn a_budget_that_is_not_kept_fails_the_soak() {
    let bench = Bench::new();
    bench.configure(&EASY.replace("memory_bytes = 1000000000", "memory_bytes = 1000000"));
    let recording = bench.record("drive", 10);
    let output = soak(&bench, &[&recording, "--minutes", "0.1", "--fps", "10", "--out", "seen"]);
    assert_eq!(output.status.code(), Some(1), "{}", text(&output));
    assert!(text(&output).contains("(soak.memory_bytes)"), "{}", text(&output));
    let report = json(&bench.path("seen/soak.json"));
    assert_eq!(report["verdict"], "fail");
    assert_eq!(line(&report, "memory_bytes")["verdict"], "fail");
    assert_eq!(line(&report, "latency_p50_ms")["verdict"], "pass");
    assert_eq!(line(&report, "next_result_s")["verdict"], "not_judged");
    assert!(std::fs::read_to_string(bench.path("seen/soak.md")).unwrap().contains("# Soak: FAIL"));
    bench.assert_clean();
}

#[test]
fn a_soak_that_cannot_start_says_why() {
    let bench = Bench::new();
    bench.configure(EASY);
    let output = soak(&bench, &["nowhere", "--minutes", "0.1", "--out", "seen"]);
    assert_eq!(output.status.code(), Some(1));
    assert!(text(&output).contains("nowhere"), "{}", text(&output));
    let output = soak(&bench, &["--overload", "--faults"]);
    assert_eq!(output.status.code(), Some(2));
    // No board has no GPU clock; that is found before anything is rendered or run.
    std::fs::create_dir(bench.path("sys")).unwrap();
    let sysfs = format!("board.sysfs={}", bench.path("sys").display());
    let output = soak(&bench, &["--gpu-table", "--out", "table", "--set", &sysfs]);
    assert_eq!(output.status.code(), Some(1));
    assert!(text(&output).contains("--gpu-table: no GPU below"), "{}", text(&output));
    assert!(!bench.path("table").exists());
    bench.assert_clean();
}

#[test]
fn the_ambient_table_has_a_row_for_each_temperature_and_needs_a_sensor() {
    let bench = Bench::new();
    let recording = bench.record("drive", 4);
    let sys = bench.path("sys");
    bench.configure(&format!("{EASY}[board]\nsysfs = \"{}\"\n", sys.display()));
    let run = |celsius: &str| {
        let table = ["--ambient-table", celsius, "--minutes", "0.05"];
        soak(&bench, &[&[recording.as_str(), "--out", "seen", "--json"], &table[..]].concat())
    };
    let refused = run("20");
    assert_eq!(refused.status.code(), Some(1));
    let words = text(&refused);
    assert!(words.contains("no thermal zone") && words.contains(sys.to_str().unwrap()), "{words}");

    let zone = sys.join("class/thermal/thermal_zone0");
    let chip = sys.join("class/hwmon/hwmon0");
    for folder in [&zone, &chip] {
        std::fs::create_dir_all(folder).unwrap();
    }
    std::fs::write(zone.join("type"), "cpu-thermal").unwrap();
    for (file, number) in [("power1_input", "2900000"), ("power2_input", "9200000")] {
        std::fs::write(chip.join(file), number).unwrap();
    }
    std::fs::write(chip.join("power2_label"), "VDD_IN").unwrap();
    let mut runs = serde_json::Value::Null;
    for (celsius, milli) in [("55", "71500"), ("20", "46250")] {
        std::fs::write(zone.join("temp"), milli).unwrap();
        let output = run(celsius);
        assert!(output.status.success(), "{}", text(&output));
        runs = serde_json::from_slice(&output.stdout).expect("standard output is JSON");
    }
    assert_eq!(json(&bench.path("seen/ambient-table.json")), runs);
    let ambient: Vec<_> = runs.as_array().unwrap().iter().map(|run| run["ambient_c"].as_f64()).collect();
    assert_eq!(ambient, [Some(20.0), Some(55.0)]);
    for phase in ["standby", "full_load"] {
        assert_eq!(runs[1][phase], serde_json::json!({ "chip_c": [71.5, 71.5], "power_w": 9.2 }), "{runs}");
    }
    assert!(runs[0]["fps"][1].as_f64() > Some(0.0) && runs[0]["rail"] == "VDD_IN", "{runs}");
    let table = std::fs::read_to_string(bench.path("seen/ambient-table.md")).unwrap();
    assert!(table.contains("| here  |        55.0 |              72 to 72 |"), "{table}");
    bench.assert_clean();
}
