//! `lookout train`, `lookout detect` and `lookout evaluate detection`, from images to boxes.

use crate::support::{Bench, save_grey};
use serde_json::Value;
use std::path::Path;

/// Noise with a dark roof, a bright window and dark wheels where `object` (left, top, side) is.
fn scene(seed: u64, width: usize, height: usize, object: Option<(usize, usize, usize)>) -> Vec<u8> {
    let mut random = fastrand::Rng::with_seed(seed);
    (0..width * height)
        .map(|i| {
            let (x, y) = (i % width, i / width);
            let noise = random.u8(..90);
            let Some((left, top, side)) = object else { return noise + (x / 9 * 37 % 80) as u8 };
            if !(left..left + side).contains(&x) || !(top..top + side).contains(&y) {
                return noise + (x / 9 * 37 % 80) as u8;
            }
            noise / 2
                + match ((x - left) * 8 / side, (y - top) * 8 / side) {
                    (1..=6, 0..=1) => 20,
                    (1..=6, 2..=4) => 190,
                    (0..=1 | 6..=7, 6..=7) => 5,
                    _ => 100,
                }
        })
        .collect()
}

fn patches(folder: &Path, from: u64, count: u64, object: bool) {
    std::fs::create_dir_all(folder).expect("a folder");
    for i in 0..count {
        let side = 32;
        let pixels = scene(from + i, side, side, object.then_some((0, 0, side)));
        save_grey(&folder.join(format!("{i}.png")), &pixels, side as u32, side as u32);
    }
}

const SMALL: [&str; 12] = [
    "--stages",
    "3",
    "--pool",
    "300",
    "--negative-windows",
    "300",
    "--variants",
    "3",
    "--max-trees",
    "8",
    "--false-alarm-rate",
    "0.2",
];

#[test]
fn a_trained_cascade_is_evaluated_and_finds_objects() {
    let bench = Bench::new();
    for (name, from, object) in [("p", 0, true), ("n", 500, false), ("tp", 1000, true), ("tn", 1500, false)] {
        patches(&bench.path(name), from, 60, object);
    }
    for (features, threads) in [("lbp", "1"), ("lbp", "3"), ("haar", "2")] {
        let name = format!("{features}{threads}.xml");
        let mut args = vec!["train", "--positives", "p", "--negatives", "n", "-o", &name];
        args.extend(SMALL);
        args.extend(["--features", features, "--threads", threads, "--report", "report", "--json"]);
        let result: Value = serde_json::from_str(&bench.ok(&args)).expect("JSON");
        assert_eq!(result["positives"], 60, "{result}");
        assert!(result["validation"]["hit_rate"].as_f64() > Some(0.8), "{result}");
        assert!(!bench.path(&format!("{name}.part")).exists());
        for file in ["training.json", "stages.txt", "stages.png", "roc.png", "features.png"] {
            assert!(bench.path("report").join(file).is_file(), "{file}");
        }
        let judge = ["evaluate", "detection", &name, "--positives", "tp", "--negatives", "tn"];
        let judged: Value =
            serde_json::from_str(&bench.ok(&[&judge[..], &["--json"]].concat())).expect("JSON");
        assert!(judged["hit_rate"].as_f64() > Some(0.8), "{judged}");
        assert!(judged["false_alarm_rate"].as_f64() < Some(0.1), "{judged}");
        assert_eq!(judged["positives"], 60);
        assert!(bench.ok(&judge).contains("of 60 objects detected"));
        // The object in a larger image.
        let pixels = scene(7, 150, 110, Some((60, 30, 44)));
        save_grey(&bench.path("scene.png"), &pixels, 150, 110);
        let detect = ["detect", &name, "scene.png", "--json", "--overlay", "found.png"];
        let found: Value = serde_json::from_str(&bench.ok(&detect)).expect("JSON");
        let boxes = found.as_array().expect("a list");
        let near = |b: &Value| {
            let at = |key: &str| b[key].as_i64().expect("a number");
            (at("x") - 60).abs() < 12 && (at("y") - 30).abs() < 12 && (at("width") - 44).abs() < 16
        };
        assert!(boxes.iter().any(near), "{features}: {found}");
        assert!(boxes.iter().all(|b| b["image"] == "scene.png" && b["score"].as_u64() > Some(3)));
        assert!(bench.path("found.png").is_file());
    }
    let bytes = |name: &str| std::fs::read(bench.path(name)).expect("a cascade");
    assert_eq!(bytes("lbp1.xml"), bytes("lbp3.xml"));
}

#[test]
fn a_sweep_prints_both_tables() {
    let bench = Bench::new();
    patches(&bench.path("p"), 0, 40, true);
    patches(&bench.path("n"), 500, 40, false);
    let mut args = vec!["train", "--positives", "p", "--negatives", "n", "-o", "none.xml", "--sweep"];
    args.extend(SMALL);
    let text = bench.ok(&args);
    assert!(text.contains("depth  stages") && text.contains("growth  window px"), "{text}");
    args.push("--json");
    let sweep: Value = serde_json::from_str(&bench.ok(&args)).expect("JSON");
    for depth in 1..=3 {
        let rows = sweep["stages"].as_array().expect("a list");
        assert!(rows.iter().any(|r| r["max_depth"] == depth && r["ms"].as_f64() > Some(0.0)));
    }
    assert_eq!(sweep["windows"].as_array().map(Vec::len), Some(15));
    assert!(!bench.path("none.xml").exists());
}

#[test]
fn unusable_input_is_named() {
    let bench = Bench::new();
    patches(&bench.path("p"), 0, 4, true);
    std::fs::create_dir(bench.path("empty")).expect("a folder");
    std::fs::write(bench.path("bad.xml"), "<opencv_storage><cascade/></opencv_storage>").expect("a file");
    let detect = bench.fails(&["detect", "bad.xml", "p/0.png"]);
    assert!(detect.contains("bad.xml") && detect.contains("<stageType> is missing"), "{detect}");
    assert!(bench.fails(&["detect", "no.xml", "p/0.png"]).contains("no.xml"));
    let train = bench.fails(&["train", "--positives", "p", "--negatives", "empty", "-o", "x.xml"]);
    assert!(train.contains("empty") && train.contains("no images"), "{train}");
    for args in [
        &["train", "--positives", "p", "--negatives", "p", "-o", "x", "--window", "4x4"][..],
        &["train", "--positives", "p", "--negatives", "p", "-o", "x", "--hit-rate", "1.5"],
        &["detect", "bad.xml"],
        &["detect", "bad.xml", "p/0.png", "--growth", "1"],
    ] {
        assert_eq!(bench.run(args).status.code(), Some(2), "{args:?}");
    }
}

#[test]
fn the_running_time_is_reported_for_the_image_and_for_its_regions() {
    let bench = Bench::new();
    let cascade = concat!(env!("CARGO_MANIFEST_DIR"), "/../models/vehicle.xml");
    let args = ["evaluate", "recognition", cascade, "--frames", "3", "--json"];
    let table: serde_json::Value = serde_json::from_str(&bench.ok(&args)).expect("the output is JSON");
    assert_eq!((&table["pictures"], &table["paper_sliding_ms"]), (&3.into(), &35.0.into()));
    assert!(table["regions"].as_f64() > Some(1.0), "{table}");
    let row = &table["rows"][0];
    assert_eq!((&row["features"], &row["paper_regions_ms"]), (&"haar".into(), &18.3.into()));
    for time in ["sliding_ms", "regions_ms", "expected_ms"] {
        assert!(row[time].as_f64() > Some(0.0), "{time}: {row}");
    }
    let text = bench.fails(&["evaluate", "recognition", "none.xml"]);
    assert!(text.contains("none.xml") && text.contains("OpenCV cascade"), "{text}");
}

#[test]
fn classes_are_evaluated_and_scores_calibrated() {
    let bench = Bench::new();
    let network = ["evaluate", "classes", "street", "--frames", "6", "--json"];
    let pictures = [&network[..], &["--examples", "examples"]].concat();
    let report: Value = serde_json::from_str(&bench.ok(&pictures)).expect("JSON");
    let labels: Vec<&str> =
        report["rows"].as_array().expect("rows").iter().filter_map(|r| r["label"].as_str()).collect();
    assert_eq!(labels, ["vehicle", "pedestrian", "rider"]);
    assert!(report["rows"][0]["recall"].as_f64() > Some(0.8), "{report}");
    for label in ["vehicle", "other"] {
        let folder = bench.path(&format!("examples/{label}"));
        let file = std::fs::read_dir(&folder).expect("examples").flatten().next().expect("an example").path();
        assert_eq!(sources::folder::read_grey(&file).map(|(_, w, h)| (w, h)).expect("a picture"), (64, 64));
    }
    // A network says probabilities.
    bench.ok(&[&network[..], &["--calibrate", "none"]].concat());
    assert_eq!(std::fs::read_dir(bench.path("none")).expect("a folder").count(), 0);
    let cascade = ["--set", "recognition.network=\"\"", "--set", "recognition.cascade=\"vehicle\""];
    let classes = [&network[..], &cascade].concat();
    let with_people = [&classes[..], &["--set", "recognition.detectors=[{}]"]].concat();
    let report: Value = serde_json::from_str(&bench.ok(&with_people)).expect("JSON");
    assert_eq!((&report["frames"], &report["rows"][0]["label"]), (&6.into(), &"vehicle".into()));
    assert!(report["rows"][0]["right"].as_u64() > Some(4), "{report}");
    // The people detector is there in every build, and looks at what has a person's size.
    let people = &report["rows"][1];
    assert_eq!(people["label"], "pedestrian");
    assert!(people["looks"][0].as_u64() > Some(0) && people["look_ms"].as_f64() > Some(0.0), "{report}");
    // What was fitted is used beside a model.
    bench.ok(&[&classes[..], &["--calibrate", "fitted"]].concat());
    let fitted = std::fs::read_to_string(bench.path("fitted/vehicle.calibration")).expect("a calibration");
    assert!(fitted.starts_with("# lookout evaluate classes street --frames 6"), "{fitted}");
    let shipped = concat!(env!("CARGO_MANIFEST_DIR"), "/../models/vehicle.xml");
    std::fs::copy(shipped, bench.path("mine.xml")).expect("a copy");
    std::fs::write(bench.path("mine.xml.calibration"), &fitted).expect("a file");
    bench.ok(&[&classes[..], &["--set", "recognition.cascade=\"mine.xml\""]].concat());
    std::fs::write(bench.path("mine.xml.calibration"), fitted.replace("miss", "mess")).expect("a file");
    let text = bench.fails(&[&classes[..], &["--set", "recognition.cascade=\"mine.xml\""]].concat());
    assert!(
        text.contains("mine.xml.calibration: line") && text.contains("evaluate classes --calibrate"),
        "{text}"
    );
}

#[test]
fn detectors_that_cannot_be_used_are_refused_with_the_remedy() {
    let bench = Bench::new();
    for (detector, expected) in [
        ("kind = \"cascade\"", "car.toml:"),
        ("kind = \"cascade\"", "name the file of the model"),
        ("kind = \"hog\"\nmodel = \"gone.hog\"", "recognition.detectors: gone.hog"),
        ("kind = \"hog\"\nmodel = \"gone.hog\"", "people for the one that ships"),
        ("kind = \"cascade\"\nmodel = \"gone.xml\"", "OpenCV cascade XML"),
        ("kind = \"hog\"\nmodel = \"car.toml\"", "line 1"),
        ("kind = \"network\"\nmodel = \"gone.onnx\"", "objects for the network that ships"),
        ("kind = \"network\"\nmodel = \"car.toml\"", "no ONNX file"),
    ] {
        bench.configure(&format!("[[recognition.detectors]]\n{detector}\n"));
        let text = bench.fails(&["check-config", "car.toml"]);
        assert!(text.contains(expected), "{detector}: {text}");
    }
}
