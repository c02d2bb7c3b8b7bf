//! `lookout calibrate` with ChArUco boards, AprilGrids and fisheye lenses, `lookout board`: boards drawn here, and boards as the
//! programs draw them that the patterns come from.

use crate::support::{Bench, python, save_grey, turns};
use nalgebra::{Rotation3, Vector2, Vector3};
use perception::calibration::{Board, Camera, Distortion, Pose};
use serde_json::Value;
use sources::chessboard::{BoardRenderer, Conditions, poses};
use sources::rig_file::RigFile;
use std::collections::HashSet;
use std::path::Path;
use std::process::Command;

const CHARUCO: [&str; 10] = [
    "--pattern",
    "charuco",
    "--board",
    "10x7",
    "--square-mm",
    "24",
    "--marker-mm",
    "18",
    "--dictionary",
    "5x5_100",
];
const APRIL_GRID: [&str; 6] = ["--pattern", "aprilgrid", "--board", "6x4", "--square-mm", "35"];

/// Calibrates from a folder; returns what was found and the rig file.
fn calibrate(bench: &Bench, folder: &str, more: &[&str]) -> (Value, RigFile) {
    let mut args = vec!["calibrate", folder, "-o", "rig.toml", "--json"];
    args.extend(more);
    let text = bench.ok(&args);
    (
        serde_json::from_str(&text).unwrap_or_else(|e| panic!("{e}: {text}")),
        RigFile::read(&bench.path("rig.toml")).unwrap(),
    )
}

/// Largest distance between where two cameras see the same directions, in pixels, over the image but `margin` of it at each border,
/// after the best rotation: that of a camera is absorbed by its pose.
fn apart_px(found: &Camera, truth: &Camera, (width, height): (usize, usize), margin: f64) -> f64 {
    let pixels: Vec<Vector2<f64>> = (0..63)
        .map(|i| {
            let at = |i: i32, n: i32, size: usize| {
                (margin + (1.0 - 2.0 * margin) * f64::from(i) / f64::from(n)) * size as f64
            };
            Vector2::new(at(i % 9, 8, width), at(i / 9, 6, height))
        })
        .collect();
    let mut turn = Rotation3::identity();
    let off = |turn: &Rotation3<f64>| -> Vec<Vector2<f64>> {
        let seen =
            |p: &Vector2<f64>| found.project(&(turn * truth.undistort(*p).unwrap().push(1.0))).unwrap() - p;
        pixels.iter().map(seen).collect()
    };
    // Gauss and Newton on three angles, with differences.
    for _ in 0..5 {
        let here = off(&turn);
        let mut normal = nalgebra::Matrix3::zeros();
        let mut right = Vector3::zeros();
        let slopes: Vec<Vec<Vector2<f64>>> = (0..3)
            .map(|k| {
                let there = off(&(Rotation3::new(Vector3::ith(k, 1e-5)) * turn));
                there.iter().zip(&here).map(|(a, b)| (a - b) / 1e-5).collect()
            })
            .collect();
        for i in 0..here.len() {
            for a in 0..3 {
                right[a] -= slopes[a][i].dot(&here[i]);
                for b in 0..3 {
                    normal[(a, b)] += slopes[a][i].dot(&slopes[b][i]);
                }
            }
        }
        turn = Rotation3::new(normal.try_inverse().unwrap() * right) * turn;
    }
    off(&turn).iter().map(Vector2::norm).fold(0.0, f64::max)
}

#[test]
fn a_charuco_board_that_is_partly_in_sight_calibrates_fisheye_lenses() {
    const SIZE: (usize, usize) = (480, 360);
    let bench = Bench::new();
    let left = Camera {
        distortion: Distortion::Equidistant([-0.02, 0.01, -0.006, 0.001]),
        ..Camera::pinhole(190.5, 190.2, 243.0, 178.0)
    };
    let right = Camera { cx_px: 237.0, cy_px: 183.0, ..left };
    let between = Pose {
        rotation: Rotation3::new(Vector3::new(0.006, 0.012, -0.004)),
        translation_m: Vector3::new(-0.06, 0.001, -0.001),
    };
    let board = Board::charuco((10, 7), 0.024, 0.018, "5x5_100".parse().unwrap(), false).unwrap();
    let studios = [left, right].map(|c| BoardRenderer::new(&c, SIZE, board));
    for (i, mut pose) in poses(18, (0.15, 0.26), 190.0 / 480.0, 3).into_iter().enumerate() {
        // Towards the borders: a whole board would not fit there.
        pose.translation_m.x = 2.0 * pose.translation_m.x + 0.03;
        pose.translation_m.y *= 2.4;
        for (side, pose) in [pose, pose.then(&between)].iter().enumerate() {
            let picture = studios[side].picture(pose, &Conditions::default(), (2 * i + side) as u64);
            let path = bench.path("set").join(["left", "right"][side]).join(format!("{i:02}.png"));
            std::fs::create_dir_all(path.parent().unwrap()).unwrap();
            save_grey(&path, picture.as_slice(), SIZE.0 as u32, SIZE.1 as u32);
        }
    }
    let (json, rig) =
        calibrate(&bench, "set", &[&CHARUCO[..], &["--lens", "fisheye", "--report", "report"]].concat());
    assert!(json["verdict"] == "good", "{json:#}");
    assert!(json["pairs_used"].as_u64().unwrap() >= 14 && json["rms_px"].as_f64().unwrap() < 0.1, "{json:#}");
    for (side, (found, truth)) in rig.cameras.iter().zip([left, right]).enumerate() {
        // Where boards were, and towards the borders, where few were: there as stated.
        let middle = apart_px(found, &truth, SIZE, 0.3);
        let (outer, sigma) =
            (apart_px(found, &truth, SIZE, 0.12), &json["projection_sigma_px"][side]["largest"]);
        let within = 3.0 * sigma.as_f64().unwrap();
        assert!(middle < 0.1 && outer < within, "{middle}, {outer}, {json:#}: {found:?}");
    }
    assert!((rig.between.translation_m - between.translation_m).norm() < 1e-4, "{:?}", rig.between);
    let sigma = json["projection_sigma_px"][0].clone();
    let (middle, largest) = (sigma["middle"].as_f64().unwrap(), sigma["largest"].as_f64().unwrap());
    assert!(0.0 < middle && middle < largest && largest < 20.0, "{sigma}");
    assert!(bench.path("report/projection.png").is_file());
    // For other programs: the corners, of which no picture shows all, and the maps.
    let text = |name: &str| std::fs::read_to_string(bench.path("report").join(name)).unwrap();
    let corners = text("corners.vnl");
    let lines: Vec<Vec<&str>> = corners.lines().skip(1).map(|line| line.split(' ').collect()).collect();
    assert_eq!(lines.len() as u64, 2 * 70 * json["pairs_used"].as_u64().unwrap());
    let names: HashSet<&str> = lines.iter().map(|line| line[0]).collect();
    assert!(names.contains("left/00.png") && names.contains("right/00.png"), "{names:?}");
    assert_eq!(names.len() * 70, lines.len(), "a name for each image");
    let (seen, unseen): (Vec<_>, Vec<_>) = lines.iter().partition(|line| line[3] == "0");
    assert!(
        seen.len() > 1000 && !unseen.is_empty() && unseen.iter().all(|line| line[1..] == ["0", "0", "-1"])
    );
    let map = text("projection.csv");
    let mut map = map.lines();
    let corner_px: f64 = map.next().unwrap().split(' ').nth(2).unwrap().parse().unwrap();
    assert!((0.005..0.1).contains(&corner_px), "{corner_px}");
    assert_eq!(map.next().unwrap(), "camera,x_px,y_px,distance_m,sigma_px,independent_px");
    let cells: Vec<Vec<&str>> = map.map(|line| line.split(',').collect()).collect();
    assert!(cells.len() > 300 && cells.iter().any(|cell| cell[0] == "right" && cell[3] == "inf"));
    assert!(cells.iter().all(|cell| cell[5].parse::<f64>().unwrap() > 0.0), "{cells:?}");
    // The rectified pair is a pinhole camera of a field of view that can be chosen.
    let width_deg =
        |rig: &RigFile| 2.0 * (SIZE.0 as f64 / 2.0 / rig.rectification.rig.focal_px).atan().to_degrees();
    assert!((width_deg(&rig) - 100.0).abs() < 1.0, "{}", width_deg(&rig));
    let (_, wide) =
        calibrate(&bench, "set", &[&CHARUCO[..], &["--lens", "fisheye", "--fov", "120"]].concat());
    assert!((width_deg(&wide) - 120.0).abs() < 0.5, "{}", width_deg(&wide));
    // The pictures rectified: straight lines again, rows that agree.
    bench.ok(&["rectify", "rig.toml", "set/left/00.png", "set/right/00.png", "-o", "seen"]);
    // As other programs have it, and back.
    for (format, name, files) in [
        ("kalibr", "camchain.yaml", &["camchain.yaml"][..]),
        ("ros", "left.yaml", &["left.yaml", "right.yaml"]),
        ("opencv", "cv.yml", &["cv.yml"]),
    ] {
        bench.ok(&["rig", "rig.toml", "--format", format, "-o", name]);
        bench.ok(&[&["rig"], files, &["--format", "toml", "-o", "back.toml"]].concat());
        let back = RigFile::read(&bench.path("back.toml")).unwrap();
        for (a, b) in back.cameras.iter().zip(&rig.cameras) {
            let off =
                a.parameters().iter().zip(b.parameters()).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
            assert!(off < 1e-9 && matches!(a.distortion, Distortion::Equidistant(_)), "{format}: {a:?}");
        }
    }
    let error = bench.run(&["rig", "rig.toml", "--format", "kitti", "-o", "calib.txt"]);
    assert!(error.status.success(), "the rectified pair is that of any lens");
    // Without the lens's model the views fit worse.
    let rms_px = json["rms_px"].as_f64().unwrap();
    let output = bench.run(&[&["calibrate", "set", "-o", "plain.toml", "--json"], &CHARUCO[..]].concat());
    let json: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert!(json["rms_px"].as_f64().unwrap() > 2.0 * rms_px, "{rms_px}, {json:#}");
    bench.assert_clean();
}

#[test]
fn boards_as_opencv_and_kalibr_print_them_are_found() {
    let Some(python) = python("cv2, numpy", "opencv-python") else { return };
    let _turn = turns::beside_others();
    let bench = Bench::new();
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/support/board_pictures.py");
    let run = |args: &[&str]| -> Value {
        let output =
            Command::new(&python).arg(&script).args(args).current_dir(bench.path("")).output().unwrap();
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        serde_json::from_slice(&output.stdout).unwrap()
    };
    for (pattern, lens, arguments) in [
        ("charuco", "plain", &CHARUCO[..]),
        ("legacy", "fisheye", &[&CHARUCO[..], &["--legacy", "--lens", "fisheye"]].concat()),
        ("aprilgrid", "plain", &APRIL_GRID[..]),
        ("apriltags", "plain", &[&CHARUCO[..9], &["apriltag_36h11"]].concat()),
        ("aprilgrid", "fisheye", &[&APRIL_GRID[..], &["--lens", "fisheye"]].concat()),
    ] {
        let folder = format!("{pattern}-{lens}");
        let truth = run(&["draw", pattern, lens, "12", &folder]);
        let (json, rig) = calibrate(&bench, &folder, arguments);
        let context = format!("{pattern} {lens}: {json:#}");
        assert!(
            json["pairs_used"].as_u64().unwrap() >= 10 && json["rms_px"].as_f64().unwrap() < 0.1,
            "{context}"
        );
        for (side, found) in rig.cameras.iter().enumerate() {
            let p: Vec<f64> = serde_json::from_value(truth["cameras"][side].clone()).unwrap();
            let distortion = match lens {
                "fisheye" => Distortion::Equidistant(p[4..8].try_into().unwrap()),
                _ => Distortion::BrownConrady([p[4], p[5], p[6], p[7], p[8], 0.0, 0.0, 0.0]),
            };
            let camera = Camera { distortion, ..Camera::pinhole(p[0], p[1], p[2], p[3]) };
            let apart = apart_px(found, &camera, (640, 480), 0.12);
            assert!(apart < 0.25, "{context} {side}: {apart}");
        }
        let between: [f64; 3] = serde_json::from_value(truth["translation_m"].clone()).unwrap();
        assert!(
            (rig.between.translation_m - Vector3::from(between)).norm() < 2e-4,
            "{context} {:?}",
            rig.between
        );
    }
    // And boards that are printed here are found by OpenCV: every inner corner, every tag.
    for (pattern, arguments, count) in [
        ("charuco", &CHARUCO[..], 70),
        ("legacy", &[&CHARUCO[..], &["--legacy"]].concat(), 70),
        ("apriltags", &[&CHARUCO[..9], &["apriltag_36h11"]].concat(), 70),
        ("aprilgrid", &APRIL_GRID[..], 24),
    ] {
        bench.ok(&[&["board", "-o", "printed.svg"], arguments].concat());
        let said = run(&["detect", pattern, "printed.svg"]);
        let mut found: Vec<u64> = serde_json::from_value(said["found"].clone()).unwrap();
        found.sort_unstable();
        assert_eq!(found, (0..count).collect::<Vec<u64>>(), "{pattern}");
    }
    // The last calibration is that of a fisheye: OpenCV rectifies its pixels to the same places.
    let rig = RigFile::read(&bench.path("rig.toml")).unwrap();
    bench.ok(&["rig", "rig.toml", "--format", "opencv", "-o", "cv.yml"]);
    let said = run(&["rectify", "cv.yml"]);
    assert_eq!(said["model"], "equidistant");
    let places = |key: &str| -> Vec<[f64; 2]> { serde_json::from_value(said[key].clone()).unwrap() };
    for (side, key) in ["left", "right"].into_iter().enumerate() {
        for (pixel, theirs) in places("pixels").into_iter().zip(places(key)) {
            let ours = rig.rectification.rectified(&rig.cameras, side, Vector2::from(pixel)).unwrap();
            assert!((ours - Vector2::from(theirs)).norm() < 1e-3, "{key} {pixel:?}: {ours}, {theirs:?}");
        }
    }
    bench.assert_clean();
}

#[test]
fn a_board_is_printed_in_true_size() {
    let bench = Bench::new();
    let text = bench.ok(&[&["board", "-o", "board.svg"], &CHARUCO[..]].concat());
    assert!(text.contains("264 x 192 mm") && text.contains("--dictionary 5x5_100"), "{text}");
    let svg = std::fs::read_to_string(bench.path("board.svg")).unwrap();
    assert!(svg.starts_with("<svg") && svg.contains("width=\"284mm\""), "{}", &svg[..300]);
    for (args, code, words) in [
        (&["board", "-o", "b.svg", "--board", "9x6"][..], 2, "--square-mm"),
        (
            &["board", "-o", "b.svg", "--pattern", "charuco", "--board", "9x6", "--square-mm", "20"],
            2,
            "--marker-mm",
        ),
        (&["board", "-o", "no/b.svg", "--board", "9x6", "--square-mm", "20"], 1, "no/b.svg"),
        (
            &["board", "-o", "b.svg", "--board", "9x6", "--square-mm", "20", "--legacy"],
            1,
            "--pattern charuco",
        ),
    ] {
        let output = bench.run(args);
        let error = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.code() == Some(code) && error.contains(words), "{args:?}: {error}");
    }
    bench.assert_clean();
}
