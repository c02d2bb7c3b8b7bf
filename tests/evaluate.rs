//! `lookout evaluate stereo` and `lidar`: scores against a reference implementation, selections, files, bad input.

use crate::support::{Bench, files, json, save_grey, shared_data};
use image::{ImageBuffer, Luma};
use serde_json::Value;
use sources::PairSource;
use sources::scene::{Drive, Scene};
use std::path::Path;

const SCORES: [&str; 8] = ["dens", "bad1", "bad2", "bad3", "D1", "epe", "hole3", "val3"];

fn save_map(path: &Path, values: &[u16], width: u32) {
    let height = values.len() as u32 / width;
    ImageBuffer::<Luma<u16>, _>::from_raw(width, height, values.to_vec())
        .expect("the values fit")
        .save(path)
        .expect("the map is written");
}

fn read_map(path: &Path) -> Vec<u16> {
    image::open(path).unwrap_or_else(|e| panic!("{}: {e}", path.display())).into_luma16().into_raw()
}

/// Makes folders of KITTI 2015's layout.
fn kitti_folders(bench: &Bench, name: &str, parts: &[&str]) {
    for part in parts {
        std::fs::create_dir_all(bench.path(name).join(part)).expect("folders");
    }
}

/// Three pairs of the drive in KITTI 2015's layout, with ground truth of all pixels and of those that are also in
/// the right image.
fn drive(bench: &Bench, name: &str) {
    let (width, height) = (160, 120);
    let rig = perception::rig::Rig { focal_px: 220.0, baseline_m: 0.24, cx_px: 80.0, cy_px: 55.0 };
    let mut drive = Drive::new(1, rig, (width, height), 10.0);
    kitti_folders(bench, name, &["image_2", "image_3", "disp_occ_0", "disp_noc_0"]);
    for index in 0..3 {
        let frame = drive.frame(40 + 9 * index);
        let path = |part: &str| bench.path(name).join(part).join(format!("{index:06}_10.png"));
        save_grey(&path("image_2"), &frame.left, width as u32, height as u32);
        save_grey(&path("image_3"), &frame.right, width as u32, height as u32);
        let all: Vec<u16> = frame.truth.disparity_px.iter().map(|d| (d * 256.0).round() as u16).collect();
        let inside = |(i, &d): (usize, &u16)| if f32::from(d) / 256.0 > (i % width) as f32 { 0 } else { d };
        let noc: Vec<u16> = all.iter().enumerate().map(inside).collect();
        save_map(&path("disp_occ_0"), &all, width as u32);
        save_map(&path("disp_noc_0"), &noc, width as u32);
    }
}

/// Reference implementation of the scores, in the order of [`SCORES`]: `truth` and `mask` as in KITTI's files.
fn reference_scores(truth: &[u16], mask: &[u16], map: &[u16], width: usize) -> [f64; 8] {
    let height = map.len() / width;
    let smaller = |found: [Option<u16>; 2]| found.into_iter().flatten().min().unwrap_or(0);
    let known = |map: &[u16], i: usize| (map[i] > 0).then_some(map[i]);
    let rows: Vec<u16> = (0..map.len())
        .map(|i| {
            let (x, start) = (i % width, i - i % width);
            let before = (0..=x).rev().find_map(|x| known(map, start + x));
            let after = (x..width).find_map(|x| known(map, start + x));
            known(map, i).unwrap_or(smaller([before, after]))
        })
        .collect();
    let filled = |i: usize| {
        let (x, y) = (i % width, i / width);
        let above = (0..=y).rev().find_map(|y| known(&rows, y * width + x));
        let below = (y..height).find_map(|y| known(&rows, y * width + x));
        known(&rows, i).unwrap_or(smaller([above, below]))
    };
    let pixels: Vec<usize> = (0..map.len()).filter(|&i| mask[i] > 0).collect();
    let px = |v: u16| f64::from(v) / 256.0;
    let error = |i: usize| (px(filled(i)) - px(truth[i])).abs();
    let raw = |i: usize| (px(map[i]) - px(truth[i])).abs();
    let count = |wanted: &dyn Fn(usize) -> bool| pixels.iter().filter(|&&i| wanted(i)).count() as f64;
    let (n, with_estimate) = (pixels.len() as f64, count(&|i| map[i] > 0));
    let above = |limit: f64| 100.0 * count(&|i| error(i) > limit) / n;
    [
        100.0 * with_estimate / n,
        above(1.0),
        above(2.0),
        above(3.0),
        100.0 * count(&|i| error(i) > 3.0 && error(i) > 0.05 * px(truth[i])) / n,
        pixels.iter().map(|&i| error(i)).sum::<f64>() / n,
        100.0 * count(&|i| map[i] == 0 || raw(i) > 3.0) / n,
        100.0 * count(&|i| map[i] > 0 && raw(i) > 3.0) / with_estimate,
    ]
}

fn scores(row: &Value) -> [f64; 8] {
    SCORES.map(|name| row[name].as_f64().unwrap_or_else(|| panic!("{name} is missing in {row}")))
}

fn assert_near(found: [f64; 8], expected: [f64; 8], what: &str) {
    for i in 0..8 {
        assert!((found[i] - expected[i]).abs() < 1e-3, "{what}: {} {found:?} {expected:?}", SCORES[i]);
    }
}

fn document(bench: &Bench, args: &[&str]) -> Value {
    let args = [&["evaluate", "stereo"], args, &["--json"]].concat();
    serde_json::from_str(&bench.ok(&args)).expect("the output is JSON")
}

#[test]
fn scores_equal_the_reference_implementation_and_saved_maps_reproduce_them() {
    let bench = Bench::new();
    drive(&bench, "set");
    let options = ["--max-disparity", "32", "--out", "out", "--repeat", "2"];
    let report = document(&bench, &[&["set"], &options[..]].concat());
    assert_eq!((&report["method"], &report["disparities"]), (&"fast".into(), &32.into()));
    assert!(report["workspace_bytes"].as_u64() > Some(100_000));
    let set = &report["sets"][0];
    let rows = set["rows"].as_array().unwrap();
    assert_eq!((&set["set"], rows.len()), (&"set".into(), 6));
    let mut sums = [[0.0; 8]; 2];
    for (i, row) in rows.iter().enumerate() {
        let region = ["all", "noc"][i / 3];
        let name = format!("{:06}_10", i % 3);
        assert_eq!((&row["name"], &row["region"]), (&name.clone().into(), &region.into()));
        let file = |folder: &str| read_map(&bench.path(folder).join(format!("{name}.png")));
        let mask = file(if region == "all" { "set/disp_occ_0" } else { "set/disp_noc_0" });
        let expected = reference_scores(&file("set/disp_occ_0"), &mask, &file("out/set/disparity"), 160);
        assert_near(scores(row), expected, &format!("{name} {region}"));
        assert!(row["cpu_ms"].as_f64() > Some(0.0));
        (0..8).for_each(|c| sums[i / 3][c] += expected[c] / 3.0);
    }
    for (region, sum) in ["all", "noc"].into_iter().zip(sums) {
        assert_near(scores(&set["mean"][region]), sum, region);
    }
    assert!(set["mean"]["noc"]["bad3"].as_f64() < Some(10.0), "{set}");
    let roc = &report["roc"];
    assert_eq!(roc["bad3_percent"].as_array().unwrap().len(), 20);
    assert!(roc["best_area_percent"].as_f64() <= roc["area_percent"].as_f64());
    assert!(roc["area_percent"].as_f64() < roc["random_area_percent"].as_f64(), "{roc}");
    let reliability = &report["reliability"];
    for bound in ["within_1px", "within_3px"] {
        let bins = reliability[bound]["bins"].as_array().unwrap();
        let pixels: u64 = bins.iter().map(|bin| bin["pixels"].as_u64().unwrap()).sum();
        assert_eq!(pixels, roc["pixels"].as_u64().unwrap(), "{reliability}");
        assert!(reliability[bound]["error"].as_f64() < Some(0.3), "{reliability}");
    }
    assert_eq!(report["subpixel"]["estimate_percent"].as_array().unwrap().len(), 16);

    for part in ["errors", "colour"] {
        let picture = image::open(bench.path("out/set").join(part).join("000002_10.png")).unwrap();
        assert_eq!((picture.width(), picture.color()), (160, image::ColorType::Rgb8));
    }
    for plot in ["subpixel.png", "roc.png", "reliability.png"] {
        assert!(image::open(bench.path("out").join(plot)).is_ok(), "{plot}");
    }
    assert_eq!(json(&bench.path("out/evaluation.json")), report);

    let again = document(&bench, &["set", "--maps", "out"]);
    assert_eq!((&again["method"], &again["roc"]), (&"maps".into(), &Value::Null));
    assert_eq!(again["subpixel"], report["subpixel"]);
    for (a, b) in again["sets"][0]["rows"].as_array().unwrap().iter().zip(rows) {
        assert_eq!((scores(a), &a["cpu_ms"]), (scores(b), &Value::Null));
    }
    let flat = document(&bench, &["set", "--maps", "out/set/disparity"]);
    assert_eq!(flat["sets"], again["sets"]);

    // The odd and the even pairs are all pairs; a new run removes the images of the old one.
    let odd = document(&bench, &["set", "--maps", "out", "--pairs", "odd"]);
    let even = document(&bench, &["set", "--maps", "out", "--pairs", "even", "--out", "half"]);
    let names = |report: &Value| -> Vec<String> {
        let rows = report["sets"][0]["rows"].as_array().unwrap();
        rows.iter().filter(|r| r["region"] == "noc").map(|r| r["name"].as_str().unwrap().into()).collect()
    };
    assert_eq!(names(&odd), ["000000_10", "000002_10"]);
    assert_eq!(names(&even), ["000001_10"]);
    bench.ok(&["evaluate", "stereo", "set", "--maps", "out", "--pairs", "odd", "--out", "half"]);
    assert!(!bench.path("half/set/errors/000001_10.png").exists());
    assert!(bench.path("half/set/errors/000002_10.png").exists());

    std::fs::remove_file(bench.path("out/set/disparity/000001_10.png")).unwrap();
    let table = bench.ok(&["evaluate", "stereo", "set", "--maps", "out"]);
    for part in ["dens", "val3", "mean of 2", "sub-pixel: ", "1 pairs have no map", "method: maps"] {
        assert!(table.contains(part), "\"{part}\" is not in:\n{table}");
    }
}

#[test]
fn a_pair_is_scored_as_worked_out_by_hand() {
    let bench = Bench::new();
    kitti_folders(&bench, "set", &["image_0", "image_1", "disp_noc"]);
    kitti_folders(&bench, "maps", &[""]);
    for image in ["image_0", "image_1"] {
        save_grey(&bench.path("set").join(image).join("7.png"), &[90; 16], 8, 2);
    }
    // First row: unknown truth; exact; 1.5 px off; a hole that becomes 10.5, so 0.5 px off; 4 px
    // off at 100 px, within 5 %; 4 px off at 40 px; a hole that becomes 44, so 24 px off; 3 px off.
    // Second row: filled from the first; one truth of 9 px above which 104 px lie, so 95 px off.
    let step = |d: f64| (d * 256.0) as u16;
    let truth = [0.0, 10.0, 12.0, 10.0, 100.0, 40.0, 20.0, 47.0, 0.0, 0.0, 0.0, 0.0, 9.0, 0.0, 0.0, 0.0];
    let map = [7.0, 10.0, 10.5, 0.0, 104.0, 44.0, 0.0, 44.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0];
    save_map(&bench.path("set/disp_noc/7.png"), &truth.map(step), 8);
    save_map(&bench.path("maps/7.png"), &map.map(step), 8);
    let report = document(&bench, &["set", "--maps", "maps"]);
    let rows = report["sets"][0]["rows"].as_array().unwrap();
    assert_eq!((rows.len(), &rows[0]["region"]), (1, &"noc".into()));
    let epe = (1.5 + 0.5 + 4.0 + 4.0 + 24.0 + 3.0 + 95.0) / 8.0;
    assert_near(scores(&rows[0]), [62.5, 75.0, 62.5, 50.0, 37.5, epe, 62.5, 40.0], "by hand");
}

#[test]
fn disturbed_pairs_are_saved_as_a_set_that_scores_the_same() {
    let bench = Bench::new();
    drive(&bench, "set");
    let run = |args: &[&str]| document(&bench, &[args, &["--max-disparity", "32"]].concat());
    let noisy = run(&["set", "--pairs", "odd", "--disturb", "noise", "--save-pairs", "noisy"]);
    assert_eq!(noisy["disturb"], "noise");
    let bytes = |name: &str| std::fs::read(bench.path(name)).unwrap();
    let pixels = |name: &str| image::open(bench.path(name)).unwrap().into_luma8().into_raw();
    assert_eq!(pixels("noisy/image_2/000000_10.png"), pixels("set/image_2/000000_10.png"));
    assert_ne!(pixels("noisy/image_3/000000_10.png"), pixels("set/image_3/000000_10.png"));
    assert!(!bench.path("noisy/image_2/000001_10.png").exists());
    let again = run(&["noisy"]);
    for i in 0..4 {
        let (a, b) = (&noisy["sets"][0]["rows"][i], &again["sets"][0]["rows"][i]);
        assert_eq!((&a["name"], &a["region"]), (&b["name"], &b["region"]));
        assert_near(scores(a), scores(b), "saved");
    }
    // The same noise every time; other disturbances run too.
    let image = bytes("noisy/image_3/000002_10.png");
    run(&["set", "--disturb", "noise", "--save-pairs", "noisy"]);
    assert_eq!(bytes("noisy/image_3/000002_10.png"), image);
    for what in ["gain", "gamma", "blur", "vertical"] {
        run(&["set", "--pairs", "even", "--disturb", what, "--save-pairs", "noisy"]);
        assert_ne!(bytes("noisy/image_3/000001_10.png"), bytes("set/image_3/000001_10.png"), "{what}");
    }
    assert_eq!(files(&bench.path("noisy")).len(), 4 + 1, "one pair and the list of its files");
    // Several sets get separate folders, also if their names are equal.
    bench.ok(&["evaluate", "stereo", "set", "./set", "--save-pairs", "two", "--max-disparity", "8"]);
    assert!(bench.path("two/set-2/disp_noc_0/000002_10.png").exists() && bench.path("two/set").exists());
}

#[test]
fn rows_are_corrected_by_the_matches_of_each_pair() {
    let bench = Bench::new();
    bench.ok(&["scene", "street", "--pairs", "street", "--count", "2", "--every", "20"]);
    let run = |args: &[&str]| document(&bench, &[args, &["--max-disparity", "32"]].concat());
    let mean = |report: &Value, key: &str| report["sets"][0]["mean"]["noc"][key].as_f64().unwrap();
    let shifted = run(&["street", "--disturb", "vertical"]);
    let corrected = run(&["street", "--disturb", "vertical", "--correct-rows", "--save-pairs", "corrected"]);
    let [lost, rest] = [&shifted, &corrected].map(|report| mean(report, "bad1"));
    assert!(rest < 0.5 * lost, "{lost} {rest}");
    assert_eq!((&shifted["correct_rows"], &corrected["correct_rows"]), (&false.into(), &true.into()));
    for row in corrected["sets"][0]["rows"].as_array().unwrap() {
        let offset_px = row["rows_corrected"]["offset_px"].as_f64().expect("a street has corners");
        assert!((offset_px + 0.5).abs() < 0.1, "{row}");
    }
    assert!(shifted["sets"][0]["rows"][0]["rows_corrected"].is_null());
    // The saved pairs are those that were scored.
    assert_near(
        scores(&run(&["corrected"])["sets"][0]["rows"][0]),
        scores(&corrected["sets"][0]["rows"][0]),
        "saved",
    );
    let text = bench.ok(&["evaluate", "stereo", "street", "--correct-rows", "--max-disparity", "32"]);
    assert!(text.contains("\nrows corrected in 2 of 2 pairs, by "), "{text}");
    // A flat pair tells nothing of its rows.
    kitti_folders(&bench, "flat", &["image_2", "image_3", "disp_noc_0"]);
    for part in ["image_2", "image_3"] {
        save_grey(&bench.path("flat").join(part).join("0_10.png"), &[90; 160 * 120], 160, 120);
    }
    save_map(&bench.path("flat/disp_noc_0/0_10.png"), &[2560; 160 * 120], 160);
    assert!(run(&["flat", "--correct-rows"])["sets"][0]["rows"][0]["rows_corrected"].is_null());
}

/// What a command prints as JSON, and what it tells on standard error.
fn both(bench: &Bench, args: &[&str]) -> (Value, String) {
    let output = bench.run(args);
    let told = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(output.status.success(), "{args:?}: {told}");
    (serde_json::from_slice(&output.stdout).expect("the output is JSON"), told)
}

#[test]
fn broken_pictures_are_left_out_counted_and_told() {
    let bench = Bench::new();
    drive(&bench, "set");
    let broken = bench.path("set/image_3/000001_10.png");
    let bytes = std::fs::read(&broken).unwrap();
    std::fs::write(&broken, &bytes[..bytes.len() / 2]).unwrap();
    let args = ["evaluate", "stereo", "set", "--max-disparity", "32", "--json"];
    let (report, told) = both(&bench, &args);
    let set = &report["sets"][0];
    assert_eq!((&set["unreadable"], &set["mean"]["noc"]["images"]), (&1.into(), &2.into()), "{report}");
    assert!(told.contains("image_3/000001_10.png") && told.contains("pair left out"), "{told}");
    let table = bench.ok(&args[..5]);
    assert!(table.contains("unreadable pairs, skipped: 1; --strict stops there"), "{table}");
    let text = bench.fails(&[&args[..], &["--strict"]].concat());
    assert!(text.contains("image_3/000001_10.png: cannot be decoded"), "{text}");
    // Maps of the ground truth, too; and nothing is left at last.
    std::fs::write(bench.path("set/disp_occ_0/000000_10.png"), "text").unwrap();
    assert_eq!(both(&bench, &args).0["sets"][0]["unreadable"], 2);
    std::fs::write(bench.path("set/image_2/000002_10.png"), "text").unwrap();
    let text = bench.fails(&args);
    assert!(text.contains("no pair can be read: ") && text.contains("image_2/000002_10.png"), "{text}");
}

#[test]
fn unusable_input_is_named() {
    let bench = Bench::new();
    drive(&bench, "set");
    let fails = |args: &[&str], expected: &[&str]| {
        let error = bench.fails(&[&["evaluate", "stereo"], args].concat());
        for part in expected {
            assert!(error.contains(part), "{args:?}: \"{part}\" is not in: {error}");
        }
    };
    std::fs::create_dir(bench.path("empty")).unwrap();
    fails(
        &["empty"],
        &["empty: no stereo pair", "image_2 and image_3", "disp_noc_0", "disp0GT.pfm", "gt_depth_map"],
    );
    fails(&["gone"], &["gone"]);
    fails(&["set", "--maps", "empty"], &["empty: no map of any pair", "empty/set/000000_10.png"]);
    save_map(&bench.path("empty/000001_10.png"), &[1; 12], 4);
    fails(&["set", "--maps", "empty"], &["empty/000001_10.png: 4x3", "image_2/000001_10.png has 160x120"]);
    save_grey(&bench.path("empty/000001_10.png"), &[1; 12], 4, 3);
    fails(&["set", "--maps", "empty"], &["empty/000001_10.png: L8", "16-bit"]);
    // Nothing is ever written into a data set, nor into a folder that will be cleaned.
    let before = files(&bench.path("set"));
    fails(&["set", "--save-pairs", "set"], &["is inside the data set", "--save-pairs"]);
    fails(&["set", "--save-pairs", "set/../set/new"], &["is inside the data set"]);
    fails(&["set", "--out", "."], &["is inside the data set", "--out"]);
    fails(&["set", "--maps", "empty", "--out", "empty"], &["--maps is inside an output folder"]);
    fails(&["set", "--save-pairs", "x", "--out", "x"], &["--save-pairs and --out"]);
    assert!(files(&bench.path("set")) == before && !bench.path("x").exists());

    save_grey(&bench.path("set/image_2/000000_10.png"), &[0; 100], 10, 10);
    fails(&["set"], &["image_2/000000_10.png is 10x10", "image_3/000000_10.png"]);
    save_grey(&bench.path("set/image_3/000000_10.png"), &[0; 100], 10, 10);
    fails(&["set"], &["image_2/000000_10.png: 10x10", "disp_occ_0/000000_10.png has 160x120"]);
    std::fs::write(bench.path("set/disp_occ_0/000000_10.png"), "text").unwrap();
    fails(&["set", "--strict"], &["disp_occ_0/000000_10.png: cannot be decoded"]);
    fails(&["set", "--set", "source.strict=true"], &["disp_occ_0/000000_10.png: cannot be decoded"]);
    std::fs::remove_file(bench.path("set/image_3/000001_10.png")).unwrap();
    std::fs::remove_file(bench.path("set/disp_occ_0/000000_10.png")).unwrap();
    fails(&["set"], &["image_3/000001_10.png"]);

    kitti_folders(&bench, "scene", &[""]);
    for name in ["im0.png", "im1.png"] {
        save_grey(&bench.path("scene").join(name), &[9; 100], 10, 10);
    }
    std::fs::write(bench.path("scene/disp0GT.pfm"), b"Pf\n10 10\n-1.0\n12345678").unwrap();
    fails(&["scene"], &["scene/disp0GT.pfm: truncated: 8 bytes", "10x10 need 400"]);
    std::fs::write(bench.path("scene/disp0GT.pfm"), b"P5\n10 10\n255\n").unwrap();
    fails(&["scene"], &["scene/disp0GT.pfm: not a PFM"]);
    fails(&["scene", "--pairs", "even"], &["scene: --pairs even leaves none of its 1"]);
    for args in [
        &["evaluate"][..],
        &["evaluate", "stereo"],
        &["evaluate", "wether", "set"],
        &["evaluate", "stereo", "set", "--max-disparity", "256"],
        &["evaluate", "stereo", "set", "--maps", "x", "--disturb", "gain"],
        &["evaluate", "stereo", "set", "--disturb", "fog"],
        &["evaluate", "stereo", "set", "--maps", "x", "--correct-rows"],
        &["evaluate", "stereo", "set", "--method", "guess"],
    ] {
        assert_eq!(bench.run(args).status.code(), Some(2), "{args:?}");
    }
    let help = bench.ok(&["evaluate", "stereo", "--help"]);
    assert!(help.contains("Examples:") && help.contains("gt_depth_map") && help.contains("hole3"), "{help}");
}

#[test]
fn real_sets_are_read_in_all_their_layouts() {
    let Some(middlebury) = shared_data("middlebury") else { return };
    let Some(depth) = shared_data("kitti_depth") else { return };
    let bench = Bench::new();
    let path = |name: &str| middlebury.join(name).display().to_string();
    let (teddy, motorcycle) = (path("teddy"), path("Motorcycle"));
    let report = document(&bench, &[&teddy, &motorcycle, "--max-disparity", "64"]);
    let bad3 = |set: usize, region: &str| report["sets"][set]["mean"][region]["bad3"].as_f64().unwrap();
    for set in [0, 1] {
        assert!(bad3(set, "noc") < 20.0 && bad3(set, "noc") < bad3(set, "all"), "{report}");
    }
    let depth = depth.display().to_string();
    let report = document(&bench, &[&depth, "--pairs", "even"]);
    let mean = &report["sets"][0]["mean"];
    assert!(mean["noc"].is_null() && mean["all"]["bad3"].as_f64() < Some(20.0), "{report}");
}

/// A picture of a car's rear with LiDAR depth and a label: a pair in `pairs`, its left picture in `cars`.
fn lidar_sets(bench: &Bench) {
    let mut scene = Scene::open("car-rear").expect("the scene ships");
    let ((width, height), rig) = (scene.size(), scene.rig().expect("the scene has a rig"));
    let (mut left, mut right) = (vec![0; width * height], vec![0; width * height]);
    scene.read(30, &mut left, &mut right).expect("the frame is drawn");
    let truth = scene.truth(30);
    let metres = |&d: &f32| if d > 0.0 { (rig.distance_m(f64::from(d)) * 256.0).round() as u16 } else { 0 };
    let depth: Vec<u16> = truth.disparity_px.iter().map(metres).collect();
    let car = truth.objects.iter().find(|o| o.subject && o.in_path).expect("a car is in the path");
    let b = car.bounds;
    let label = format!(
        "Car 0 0 0 {} {} {} {} 1.5 {} 4 0 1.6 {} 0\nDontCare -1 -1 -10 1 2 3 4 -1 -1 -1 -1 -1 -1 -10\n",
        b.x,
        b.y,
        b.x + b.width - 1,
        b.y + b.height - 1,
        car.width_m,
        car.distance_m + 2.0
    );
    let p = |at: f64| format!("{0} 0 {1} {at} 0 {0} {2} 0 0 0 1 0", rig.focal_px, rig.cx_px, rig.cy_px);
    let calibration = format!("P2: {}\nP3: {}\n", p(0.0), p(-rig.focal_px * rig.baseline_m));
    kitti_folders(bench, "pairs", &["left", "right", "gt_depth_map", "calib"]);
    kitti_folders(bench, "cars", &["left", "labels", "gt_depth", "calib"]);
    for (set, map) in [("pairs", "gt_depth_map"), ("cars", "gt_depth")] {
        let path = |part: &str, end: &str| bench.path(set).join(part).join(format!("7.{end}"));
        save_grey(&path("left", "png"), &left, width as u32, height as u32);
        save_map(&path(map, "png"), &depth, width as u32);
        std::fs::write(path("calib", "txt"), &calibration).expect("written");
    }
    save_grey(&bench.path("pairs/right/7.png"), &right, width as u32, height as u32);
    std::fs::write(bench.path("cars/labels/7.txt"), label).expect("written");
}

#[test]
fn regions_are_scored_against_lidar_depth_and_labels() {
    let bench = Bench::new();
    lidar_sets(&bench);
    let args = ["evaluate", "lidar", "pairs", "cars", "--out", "out", "--json"];
    let report: Value = serde_json::from_str(&bench.ok(&args)).expect("the output is JSON");
    let pictures = report["pictures"].as_array().unwrap();
    assert_eq!((&pictures[0]["picture"], &pictures[0]["disparity"]), (&"pairs/7".into(), &"matched".into()));
    assert_eq!((&pictures[1]["picture"], &pictures[1]["disparity"]), (&"cars/7".into(), &"depth_map".into()));
    for picture in pictures {
        let errors = picture["errors_percent"].as_array().unwrap();
        assert!(errors.iter().any(|e| e.as_f64().unwrap().abs() < 5.0), "{picture}");
        assert!(picture["camera_height_m"].as_f64().is_some(), "{picture}");
    }
    assert_eq!((&report["due"], &report["covered"]), (&1.into(), &1.into()), "{report}");
    let car = &report["labels"][0];
    assert!(car["error_percent"].as_f64().unwrap().abs() < 5.0, "{car}");
    let saved = json(&bench.path("out/evaluation.json"));
    assert_eq!(saved, report);
    assert!(bench.path("out/pairs/7.png").is_file() && bench.path("out/cars/7.png").is_file());
    let text = bench.ok(&["evaluate", "lidar", "cars", "--repeat", "3"]);
    assert!(text.contains("1 of 1 covered") && text.contains("3 times in a row"), "{text}");

    let text = bench.fails(&["evaluate", "lidar", "cars", "--out", "cars/left"]);
    assert!(text.contains("is inside the data set cars"), "{text}");
    std::fs::write(bench.path("cars/labels/7.txt"), "Car 0 0\n").unwrap();
    let text = bench.fails(&["evaluate", "lidar", "cars"]);
    assert!(text.contains("labels/7.txt: line 1: 3 fields"), "{text}");
    std::fs::write(bench.path("cars/labels/7.txt"), "").unwrap();
    std::fs::write(bench.path("cars/left/7.png"), "text").unwrap();
    let (report, told) = both(&bench, &["evaluate", "lidar", "pairs", "cars", "--json"]);
    assert_eq!((&report["unreadable"], report["pictures"].as_array().unwrap().len()), (&1.into(), 1));
    assert!(told.contains("cars/left/7.png: cannot be decoded") && told.contains("pair left out"), "{told}");
    let text = bench.fails(&["evaluate", "lidar", "pairs", "cars", "--strict"]);
    assert!(text.contains("cars/left/7.png: cannot be decoded"), "{text}");
    let text = bench.fails(&["evaluate", "lidar", "cars"]);
    assert!(text.contains("no pair can be read: ") && text.contains("cars/left/7.png"), "{text}");
    lidar_sets(&bench);
    std::fs::write(bench.path("cars/labels/7.txt"), "").unwrap();
    save_map(&bench.path("cars/gt_depth/7.png"), &[1; 100], 10);
    let text = bench.fails(&["evaluate", "lidar", "pairs", "cars"]);
    assert!(
        text.contains("left/7.png: 640x480 pixels") && text.contains("gt_depth/7.png has 10x10"),
        "{text}"
    );
    let text = bench.fails(&["evaluate", "lidar", "pairs/left"]);
    assert!(text.contains("no LiDAR depth here: expected folders left"), "{text}");
}

/// Pairs with exact ground truth: disparities have next to no bias on them, upright or slanted; maps that are half a pixel off have.
#[test]
fn pairs_of_a_scene_show_the_bias_of_disparities() {
    let bench = Bench::new();
    bench.ok(&["scene", "street", "--pairs", "exact", "--count", "2", "--every", "20"]);
    let error = bench.fails(&["scene", "bend-parked", "--pairs", "none", "--count", "5000"]);
    assert!(error.contains("bend-parked: has ") && error.contains("--count "), "{error}");
    for part in ["image_2", "image_3", "disp_occ_0", "disp_noc_0"] {
        assert_eq!(std::fs::read_dir(bench.path("exact").join(part)).unwrap().count(), 2, "{part}");
    }
    let report = document(&bench, &["exact", "--out", "maps"]);
    let ranges = |report: &Value| report["by_range"].as_array().unwrap().clone();
    let own = ranges(&report);
    for surface in ["upright", "slanted"] {
        assert!(own.iter().filter(|range| range["surface"] == surface).count() >= 2, "{own:?}");
    }
    for range in own.iter().filter(|range| range["pixels"].as_u64() > Some(10_000)) {
        assert!(range["bias_px"].as_f64().unwrap().abs() < 0.1, "{range}");
        assert!(range["spread_px"].as_f64() < Some(0.5), "{range}");
    }
    for entry in std::fs::read_dir(bench.path("maps/exact/disparity")).unwrap() {
        let path = entry.unwrap().path();
        let mut map = image::open(&path).unwrap().into_luma16();
        map.pixels_mut().filter(|d| d[0] > 0).for_each(|d| d[0] += 128);
        map.save(&path).unwrap();
    }
    let shifted = ranges(&document(&bench, &["exact", "--maps", "maps"]));
    for (range, own) in shifted.iter().zip(&own).filter(|(_, own)| own["pixels"].as_u64() > Some(10_000)) {
        let by = range["bias_px"].as_f64().unwrap() - own["bias_px"].as_f64().unwrap();
        assert!((by - 0.5).abs() < 0.05, "{range}, {own}");
    }
    bench.assert_clean();
}
