//! `lookout calibrate`, `rectify` and `rig`: generated boards before known cameras, seeded faults, bad
//! input, real images.

use crate::support::{self, Bench, python, save_grey, shared_data, turns};
use nalgebra::{Rotation3, Vector3};
use perception::calibration::{Board, Camera, Crop, Distortion, Pose};
use sources::chessboard::{BoardRenderer, Conditions, poses};
use sources::rig_file::RigFile;
use std::path::Path;
use std::process::Command;
use std::sync::OnceLock;

const SIZE: (usize, usize) = (480, 360);
const VIEWS: usize = 14;
const BOARD: [&str; 4] = ["--board", "9x6", "--square-mm", "25"];

fn cameras() -> ([Camera; 2], Pose) {
    let left = Camera {
        distortion: Distortion::BrownConrady([-0.25, 0.08, 0.001, -0.0004, 0.0, 0.0, 0.0, 0.0]),
        ..Camera::pinhole(400.5, 400.2, 246.0, 177.0)
    };
    let right = Camera { cx_px: 236.0, cy_px: 183.0, fx_px: 402.9, fy_px: 402.4, ..left };
    let between = Pose {
        rotation: Rotation3::new(Vector3::new(0.006, 0.012, -0.004)),
        translation_m: Vector3::new(-0.12, 0.001, -0.001),
    };
    ([left, right], between)
}

type Picture = Vec<u8>;

/// Images of the same views: correct; with a board 1 % too long; with the right camera
/// pitched by 0.1 degrees.
struct Set {
    good: Vec<[Picture; 2]>,
    stretched: Vec<[Picture; 2]>,
    pitched: Vec<Picture>,
}

fn set() -> &'static Set {
    static SET: OnceLock<Set> = OnceLock::new();
    SET.get_or_init(|| {
        let ([left, right], between) = cameras();
        let board = Board::new(9, 6, 0.025).unwrap();
        let studios = [left, right].map(|c| BoardRenderer::new(&c, SIZE, board));
        let pitch = Pose {
            rotation: Rotation3::new(Vector3::new(0.1_f64.to_radians(), 0.0, 0.0)),
            translation_m: Vector3::zeros(),
        };
        let fine = Conditions::default();
        let long = Conditions { stretch: 1.01, ..fine };
        let take = |side: usize, pose: &Pose, conditions: &Conditions, seed: usize| {
            studios[side].picture(pose, conditions, seed as u64).as_slice().to_vec()
        };
        let mut set = Set { good: Vec::new(), stretched: Vec::new(), pitched: Vec::new() };
        for (i, mut pose) in poses(VIEWS, (0.42, 0.75), 400.0 / 480.0, 3).into_iter().enumerate() {
            // Between both cameras.
            pose.translation_m.x += 0.06;
            let right = pose.then(&between);
            set.good.push([take(0, &pose, &fine, 2 * i), take(1, &right, &fine, 2 * i + 1)]);
            set.stretched.push([take(0, &pose, &long, 2 * i), take(1, &right, &long, 2 * i + 1)]);
            set.pitched.push(take(1, &right.then(&pitch), &fine, 2 * i + 1));
        }
        set
    })
}

fn save(folder: &Path, pairs: impl IntoIterator<Item = [Picture; 2]>) {
    for (i, pair) in pairs.into_iter().enumerate() {
        for (side, pixels) in ["left", "right"].iter().zip(pair) {
            std::fs::create_dir_all(folder.join(side)).unwrap();
            save_grey(
                &folder.join(side).join(format!("{}.png", i + 1)),
                &pixels,
                SIZE.0 as u32,
                SIZE.1 as u32,
            );
        }
    }
}

/// Calibrates from a folder; returns the JSON and whether it succeeded.
fn calibrate(bench: &Bench, folder: &Path, board: &[&str]) -> (serde_json::Value, bool) {
    let folder = folder.display().to_string();
    let mut args = vec!["calibrate", folder.as_str(), "-o", "rig.toml", "--json"];
    args.extend(board);
    let output = bench.run(&args);
    let text = String::from_utf8_lossy(&output.stdout).into_owned();
    let errors = String::from_utf8_lossy(&output.stderr).into_owned();
    let json = serde_json::from_str(&text).unwrap_or_else(|e| panic!("{e}\n{text}\n{errors}"));
    (json, output.status.success())
}

fn reasons(json: &serde_json::Value) -> String {
    json["reasons"].to_string()
}

#[test]
fn good_pictures_give_the_cameras_that_took_them() {
    let bench = Bench::new();
    save(&bench.path("set"), set().good.clone());
    let (json, ok) = calibrate(&bench, &bench.path("set"), &BOARD);
    assert!(ok && json["verdict"] == "good", "{json:#}");
    assert_eq!(json["pairs_used"], VIEWS);
    for key in ["rms_px", "vertical_mean_px", "vertical_heldout_px"] {
        assert!(json[key].as_f64().unwrap() < 0.1, "{json:#}");
    }
    assert!(json["seconds"].as_f64().unwrap() > 0.0);
    let rig = RigFile::read(&bench.path("rig.toml")).unwrap();
    let ([left, right], between) = cameras();
    let quality = rig.quality.as_ref().unwrap();
    for (found, truth, sigma) in
        [(&rig.cameras[0], left, quality.left_sigma), (&rig.cameras[1], right, quality.right_sigma)]
    {
        for (k, (a, b)) in found.parameters().iter().zip(truth.parameters()).take(8).enumerate() {
            assert!((a - b).abs() < 4.0 * sigma[k] + 1e-9, "parameter {k}: {a}, not {b}, sigma {}", sigma[k]);
        }
    }
    let baseline = between.translation_m.norm();
    assert!((rig.rectification.rig.baseline_m - baseline).abs() < 4.0 * quality.baseline_sigma_m);
    // The report, and images rectified with the rig.
    let args =
        ["calibrate", "set", "-o", "rig2.toml", "--board", "9x6", "--square-mm", "25", "--report", "report"];
    let text = bench.ok(&args);
    assert!(text.contains("verdict: good"), "{text}");
    for name in ["rectified.png", "epipolar.png", "residuals.png", "views.png", "coverage.png"] {
        assert!(image::open(bench.path("report").join(name)).is_ok(), "{name}");
        assert!(std::fs::read_to_string(bench.path("report/index.html")).unwrap().contains(name));
    }
    bench.ok(&["rectify", "rig.toml", "set/left/1.png", "set/right/1.png", "-o", "seen"]);
    let board = Board::new(9, 6, 0.025).unwrap();
    let rows = ["left.png", "right.png"].map(|name| {
        let (pixels, w, h) = sources::folder::read_grey(&bench.path("seen").join(name)).unwrap();
        let view = perception::image::GreyView::new(&pixels, w, h, w).unwrap();
        perception::calibration::finder::find(view, &board).unwrap().corners
    });
    let off =
        rows[0].iter().zip(&rows[1]).map(|(l, r)| (l.unwrap().y - r.unwrap().y).abs()).sum::<f64>() / 54.0;
    assert!(off < 0.12, "rows of rectified corners differ by {off} px");
    // Exported and imported again.
    bench.ok(&["rig", "rig.toml", "--format", "ros", "-o", "left.yaml"]);
    let shown = bench.ok(&["rig", "left.yaml", "right.yaml"]);
    assert!(shown.contains("baseline_m = 0.1"), "{shown}");
}

#[test]
fn a_rig_of_four_numbers_is_shown_and_converted() {
    let bench = Bench::new();
    let plain = "focal_px = 440.0\nbaseline_m = 0.12\ncx_px = 320.0\ncy_px = 240.0\n";
    std::fs::write(bench.path("plain.toml"), plain).unwrap();
    let shown = bench.ok(&["rig", "plain.toml"]);
    assert_eq!(shown, format!("# a pair that is rectified already\n{plain}"));
    let error = bench.fails(&["rig", "plain.toml", "--format", "opencv", "-o", "plain.yml"]);
    assert!(error.contains("plain.toml") && error.contains("--size"), "{error}");
    bench.ok(&["rig", "plain.toml", "--size", "640x480", "--format", "opencv", "-o", "plain.yml"]);
    let shown = bench.ok(&["rig", "plain.yml"]);
    assert!(["focal_px = 440.0", "width = 640"].iter().all(|line| shown.contains(line)), "{shown}");
}

#[test]
fn seeded_faults_turn_the_verdict() {
    let bench = Bench::new();
    let folder = |name: &str| bench.path(name);
    let set = set();
    // One picture half a pixel to the right, or down: the mean of a pixel and the one before it.
    for (try_, view) in [0, 2, 4, 6, 7, 9, 11, 13].into_iter().enumerate() {
        let (side, way) = (try_ % 2, if try_ % 4 < 2 { SIZE.0 } else { 1 });
        let mut shifted = set.good.clone();
        let old = shifted[view][side].clone();
        for i in way..old.len() {
            shifted[view][side][i] = ((u16::from(old[i]) + u16::from(old[i - way])) / 2) as u8;
        }
        let name = format!("shifted{try_}");
        save(&folder(&name), shifted);
        let (json, _) = calibrate(&bench, &folder(&name), &BOARD);
        assert_ne!(json["verdict"], "good", "{json:#}");
        assert_eq!(json["left_out"], serde_json::json!([(view + 1).to_string()]), "{json:#}");
        assert!(reasons(&json).contains(&format!("{} was left out", view + 1)), "{json:#}");
    }

    save(&folder("stretched"), set.stretched.clone());
    let (json, ok) = calibrate(&bench, &folder("stretched"), &BOARD);
    assert!(!ok && json["verdict"] == "redo", "{json:#}");
    assert!(reasons(&json).contains("longer along its rows"), "{json:#}");

    let pitched = set.good.iter().zip(&set.pitched).enumerate();
    let pitched: Vec<_> = pitched
        .map(|(i, (g, p))| if i < VIEWS / 2 { g.clone() } else { [g[0].clone(), p.clone()] })
        .collect();
    save(&folder("pitched"), pitched);
    let (json, ok) = calibrate(&bench, &folder("pitched"), &BOARD);
    assert!(!ok && json["verdict"] == "redo", "{json:#}");
    assert!(reasons(&json).contains("moved against each other"), "{json:#}");

    save(&folder("swapped"), set.good.iter().map(|[l, r]| [r.clone(), l.clone()]));
    let (json, ok) = calibrate(&bench, &folder("swapped"), &BOARD);
    assert!(!ok && json["verdict"] == "redo" && reasons(&json).contains("are swapped"), "{json:#}");

    let turn = |picture: &Picture| -> Picture { picture.iter().rev().copied().collect() };
    save(&folder("turned"), set.good.iter().map(|[l, r]| [turn(l), r.clone()]));
    let (json, ok) = calibrate(&bench, &folder("turned"), &BOARD);
    let words = "the left camera is upside down";
    assert!(!ok && json["verdict"] == "redo" && reasons(&json).contains(words), "{json:#}");
}

#[test]
fn bad_input_has_a_clear_verdict_and_leaves_a_good_rig_alone() {
    let bench = Bench::new();
    let folder = |name: &str| bench.path(name);
    let good = &set().good;
    std::fs::write(bench.path("rig.toml"), "precious").unwrap();
    let refused = |name: &str, board: &[&str], words: &str| {
        let (json, ok) = calibrate(&bench, &folder(name), board);
        assert!(!ok && json["verdict"] == "redo", "{name}: {json:#}");
        assert!(reasons(&json).contains(words), "{name}: {json:#}");
        assert_eq!(std::fs::read_to_string(bench.path("rig.toml")).unwrap(), "precious", "{name}");
    };
    save(&folder("good"), good.clone());
    refused("good", &["--board", "8x6", "--square-mm", "25"], "show 9x6 corners, not 8x6");
    refused("good", &["--board", "11x8", "--square-mm", "25"], "show 9x6 corners, not 11x8");
    save(&folder("few"), good[..3].to_vec());
    refused("few", &BOARD, "at least 4");
    save(&folder("alike"), vec![good[2].clone(); 12]);
    refused("alike", &BOARD, "");
    save(&folder("one"), good.clone());
    std::fs::remove_dir_all(folder("one").join("right")).unwrap();
    refused("one", &BOARD, "none of the other");
    save(&folder("sizes"), good.clone());
    save_grey(&folder("sizes").join("right/5.png"), &vec![9; 320 * 240], 320, 240);
    refused("sizes", &BOARD, "320x240");
    // Boards cut off at the left: all but the right three eighths are grey, in all but two.
    let cut = good.iter().enumerate().map(|(i, [l, r])| {
        let mut l = l.clone();
        if i > 1 {
            l.chunks_exact_mut(SIZE.0).for_each(|row| row[..5 * SIZE.0 / 8].fill(60));
        }
        [l, r.clone()]
    });
    save(&folder("cut"), cut);
    refused("cut", &BOARD, "cut off");
    std::fs::create_dir_all(folder("empty")).unwrap();
    refused("empty", &BOARD, "no images");
    refused("missing", &BOARD, "missing");
    save(&folder("broken"), good[..5].to_vec());
    std::fs::write(folder("broken").join("left/3.png"), b"no picture").unwrap();
    refused("broken", &BOARD, "3.png");
}

#[test]
fn a_real_set_is_calibrated() {
    let Some(folder) = shared_data("chessboard_sg1") else { return };
    let bench = Bench::new();
    let args = ["--board", "9x6", "--square-mm", "24.23", "--cross-validate"];
    let (json, ok) = calibrate(&bench, &folder, &args);
    assert!(ok, "{json:#}");
    assert_eq!(json["pairs_with_board"], 29);
    let value = |key: &str| json[key].as_f64().unwrap();
    // OpenCV on the same pictures, with every pair: 0.251 px, 0.236 px, 94.09 mm.
    assert!(value("rms_px") < 0.251 && value("vertical_heldout_px") < 0.2, "{json:#}");
    let all = |key: &str| json["all_views"][key].as_f64().unwrap();
    assert!(all("rms_px") < 0.251 && all("vertical_heldout_px") < 0.2, "{json:#}");
    assert_eq!(json["all_views"]["pairs_used"], 29);
    assert!((value("baseline_m") / 0.094 - 1.0).abs() < 0.005, "{json:#}");
    assert!(json["left_out"].as_array().unwrap().len() <= 4, "{json:#}");
    // The board was hand-held: it moved by a fifth of a pixel between the exposures. Nothing else is wrong.
    assert_eq!(json["verdict"], "usable", "{json:#}");
    let wrong = json["reasons"].as_array().unwrap();
    let others = wrong.iter().filter(|r| {
        let text = r.as_str().unwrap();
        let by_motion =
            ["varying from view to view", "was left out", "corners left out", "off by more than 0.25 px"];
        !by_motion.iter().any(|words| text.contains(words))
    });
    assert_eq!(others.count(), 0, "{json:#}");
    // Another board size is never guessed.
    let (json, ok) = calibrate(&bench, &folder, &["--board", "8x6", "--square-mm", "24.23"]);
    assert!(!ok && json["verdict"] == "redo", "{json:#}");
}

/// A real pair of cameras, with pictures turned by 180° or put into the other folder.
#[test]
fn upside_down_and_swapped_cameras_of_a_real_set_are_told_apart() {
    let Some(folder) = shared_data("chessboard_sg1") else { return };
    let bench = Bench::new();
    for (name, is_turned, is_swapped, words) in [
        ("left", [true, false], false, "the left camera is upside down"),
        ("right", [false, true], false, "the right camera is upside down"),
        ("both", [true, true], false, "or both cameras are upside down"),
        ("swapped", [false, false], true, "are swapped"),
    ] {
        // Every third pair is enough.
        for index in (1..30).step_by(3) {
            for side in 0..2 {
                let picture = folder.join(format!("{}{index}.jpg", ["left", "right"][side]));
                let (mut pixels, width, height) = sources::folder::read_grey(&picture).unwrap();
                if is_turned[side] {
                    pixels.reverse();
                }
                let side = ["left", "right"][if is_swapped { 1 - side } else { side }];
                std::fs::create_dir_all(bench.path(name).join(side)).unwrap();
                let path = bench.path(name).join(side).join(format!("{index}.png"));
                save_grey(&path, &pixels, width as u32, height as u32);
            }
        }
        let (json, ok) = calibrate(&bench, &bench.path(name), &["--board", "9x6", "--square-mm", "24.23"]);
        assert!(!ok && json["verdict"] == "redo" && reasons(&json).contains(words), "{name}: {json:#}");
    }
}

#[test]
fn the_programs_that_own_the_formats_read_and_write_them() {
    let Some(python) = python("cv2, numpy, yaml", "opencv-python and PyYAML") else { return };
    let bench = Bench::new();
    let (mut cameras, between) = cameras();
    // YAML 1.1 takes a number without a decimal point for text.
    cameras[0].distortion = Distortion::BrownConrady([-0.25, 0.08, 1e-5, -0.0004, 0.0, 0.0, 0.0, 0.0]);
    let rig = RigFile::from_cameras(cameras, between, SIZE, Crop::Valid).unwrap();
    rig.write(&bench.path("rig.toml")).unwrap();
    for (format, name) in
        [("opencv", "cv.yml"), ("ros", "left.yaml"), ("kalibr", "camchain.yaml"), ("kitti", "calib.txt")]
    {
        bench.ok(&["rig", "rig.toml", "--format", format, "-o", name]);
    }
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/support/read_calibration.py");
    let output = Command::new(&python).arg(&script).arg(bench.path("")).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let said: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    let same = |value: &serde_json::Value, expected: &[f64]| {
        let read: Vec<f64> = serde_json::from_value(value.clone()).unwrap_or_else(|e| panic!("{e}: {value}"));
        assert_eq!(read.len(), expected.len(), "{value}");
        for (a, b) in read.iter().zip(expected) {
            assert!((a - b).abs() <= 1e-12 * b.abs().max(1.0), "{read:?}, not {expected:?}");
        }
    };
    let row_after_row = |r: &Rotation3<f64>| r.matrix().transpose().as_slice().to_vec();
    let own = rig.rectification.rig;
    for side in 0..2 {
        let camera = &rig.cameras[side];
        let (fx, fy, cx, cy) = (camera.fx_px, camera.fy_px, camera.cx_px, camera.cy_px);
        let matrix = [fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0];
        let aside = [0.0, -own.focal_px * own.baseline_m][side];
        let f = own.focal_px;
        let projection = [f, 0.0, own.cx_px, aside, 0.0, f, own.cy_px, 0.0, 0.0, 0.0, 1.0, 0.0];
        let turn = row_after_row(&rig.rectification.turns[side]);
        let n = side + 1;
        same(&said["opencv"][format!("M{n}")], &matrix);
        same(&said["opencv"][format!("D{n}")], &camera.distortion.coefficients()[..5]);
        same(&said["opencv"][format!("R{n}")], &turn);
        same(&said["opencv"][format!("P{n}")], &projection);
        let ros = &said["ros"][side];
        same(&ros["camera_matrix"], &matrix);
        same(&ros["distortion_coefficients"], &camera.distortion.coefficients()[..5]);
        same(&ros["rectification_matrix"], &turn);
        same(&ros["projection_matrix"], &projection);
        same(&ros["size"], &[SIZE.0 as f64, SIZE.1 as f64]);
        let kalibr = &said["kalibr"][side];
        same(&kalibr["intrinsics"], &[fx, fy, cx, cy]);
        same(&kalibr["distortion"], &camera.distortion.coefficients()[..4]);
        same(&kalibr["size"], &[SIZE.0 as f64, SIZE.1 as f64]);
        same(&said["kitti"][["P2", "P3"][side]], &projection);
    }
    same(&said["opencv"]["R"], &row_after_row(&between.rotation));
    same(&said["opencv"]["T"], between.translation_m.as_slice());
    same(&said["opencv"]["size"], &[SIZE.0 as f64, SIZE.1 as f64]);
    let from_left = between.rotation.matrix().to_homogeneous();
    let mut from_left: Vec<f64> = from_left.transpose().as_slice().to_vec();
    for k in 0..3 {
        from_left[4 * k + 3] = between.translation_m[k];
    }
    same(&said["kalibr"][1]["from_left"], &from_left);
    // With these parameters OpenCV rectifies onto the same rows and triangulates the points.
    assert!(said["points"].as_u64().unwrap() > 100, "{said}");
    for key in ["rows_px", "places_m"] {
        assert!(said[key].as_f64().unwrap() < 1e-4, "{key}: {}", said[key]);
    }
    // What these libraries write can be imported.
    for files in [&["cv2.yml"][..], &["ros2_left.yaml", "ros2_right.yaml"], &["camchain2.yaml"]] {
        let paths: Vec<_> = files.iter().map(|f| bench.path(f)).collect();
        let back = sources::rig_file::import(&paths, None, Crop::Valid).unwrap();
        assert_eq!(back.size(), SIZE, "{files:?}");
        for (a, b) in back.cameras.iter().zip(&rig.cameras) {
            for (a, b) in a.parameters().iter().zip(b.parameters()) {
                assert!((a - b).abs() < 1e-9, "{files:?}: {a}, not {b}");
            }
        }
        assert!((back.between.translation_m - between.translation_m).norm() < 1e-9, "{files:?}");
        assert!((back.between.rotation.matrix() - between.rotation.matrix()).norm() < 1e-9, "{files:?}");
    }
}

/// Every image of the shared data sets except the chessboards; prints the processor time of each set.
#[test]
fn pictures_without_a_board_have_none() {
    let _turn = turns::beside_others();
    let chessboard = Board::new(9, 6, 0.025).unwrap();
    let charuco = Board::charuco((10, 7), 0.024, 0.018, "4x4_50".parse().unwrap(), false).unwrap();
    let april_grid = Board::april_grid((6, 6), 0.03, 0.3, 2).unwrap();
    for set in ["road_images", "kitti2015", "kitti_cars", "kitti_depth", "kitti_sequence_1", "middlebury"] {
        let Some(folder) = shared_data(set) else { return };
        let mut times = Vec::new();
        for (path, _) in support::files(&folder) {
            let path = folder.join(path);
            let Ok((pixels, width, height)) = sources::folder::read_grey(&path) else { continue };
            let view = perception::image::GreyView::new(&pixels, width, height, width).unwrap();
            for board in [&charuco, &april_grid] {
                let found = perception::calibration::finder::find(view, board);
                assert!(found.is_err(), "{}: {found:?}", path.display());
            }
            let (found, ms) = tools::calibration::timed(view, &chessboard);
            assert!(found.is_err(), "{}: {found:?}", path.display());
            times.push((ms, path));
        }
        assert!(!times.is_empty(), "{set}");
        times.sort_by(|a, b| a.0.total_cmp(&b.0));
        let (middle, most) = (&times[times.len() / 2], &times[times.len() - 1]);
        println!("{set}: {} pictures, median {:.1} ms, {:?} {:.1} ms", times.len(), middle.0, most.1, most.0);
    }
}

/// The synthetic drive, whose right camera is pitched by 0.2 degrees from pair 12 on.
#[test]
fn a_camera_that_turns_in_flight_is_noticed_and_comes_back_when_corrected() {
    let _turn = turns::beside_others();
    use perception::rectify::Remap;
    use perception::simd::Level;
    use perception::stereo::epipolar::correction::RowCorrection;
    use perception::stereo::epipolar::shift::shift_rows;
    use perception::stereo::epipolar::{EpipolarCheck, EpipolarParameters, EpipolarState, MatchedPair};
    use perception::stereo::{DisparityView, MatchOutput, Matcher, Mpv, MpvParameters, Search};
    use sources::PairSource;

    /// Time between two pairs, in seconds.
    const STEP: f64 = 0.1;
    let (width, height) = (640, 480);
    let mut drive = sources::scene::Drive::paper(1);
    assert_eq!(drive.size(), (width, height));
    let rig = drive.rig().expect("the drive has a rig");
    let turn = Rotation3::new(Vector3::new(0.2_f64.to_radians(), 0.0, 0.0));
    let turned = Remap::new(Level::best(), width, height, |x, y| {
        let ray =
            Vector3::new((x as f64 - rig.cx_px) / rig.focal_px, (y as f64 - rig.cy_px) / rig.focal_px, 1.0);
        let ray = turn * ray;
        Some((rig.focal_px * ray.x / ray.z + rig.cx_px, rig.focal_px * ray.y / ray.z + rig.cy_px))
    });
    let mut matcher =
        Mpv::new(MpvParameters::default(), Search::Windows, width, height, 64).expect("a matcher");
    let mut check = EpipolarCheck::new(EpipolarParameters::default());
    // The offset is 3 px: more than is corrected by default.
    let mut correction = RowCorrection::new(4.0);
    let (mut left, mut right) = (vec![0; width * height], vec![0; width * height]);
    let (mut seen, mut corrected) = (vec![0; width * height], vec![0; width * height]);
    let (mut disparity, mut confidence) = (vec![0; width * height], vec![0; width * height]);
    let (mut noticed, mut back) = (None, None);
    for index in 0..50 {
        drive.read(index, &mut left, &mut right).expect("the drive never ends");
        let view = |p| perception::image::GreyView::new(p, width, height, width).expect("the size fits");
        if index >= 12 {
            turned.apply(view(&right), &mut seen).expect("the size fits");
        } else {
            seen.copy_from_slice(&right);
        }
        correction.advance(STEP);
        shift_rows(Level::best(), view(&seen), &correction.applied(), &mut corrected);
        let output = MatchOutput { disparity: &mut disparity, confidence: &mut confidence };
        matcher.compute(view(&left), view(&corrected), output).expect("the size fits");
        let map = DisparityView::new(&disparity, width, height).expect("the size fits");
        let pair = MatchedPair {
            left: view(&left),
            right: view(&corrected),
            disparity: map,
            confidence: &confidence,
        };
        let health = check.update(pair, &correction.applied(), STEP);
        correction.update(&check);
        if index == 11 {
            assert_eq!(health.state, EpipolarState::Good, "{health:?}");
            assert!(!correction.has_moved() && health.lost < 0.02, "{health:?}");
        }
        if index >= 12 && noticed.is_none() && health.state == EpipolarState::Degraded {
            noticed = Some(index - 11);
        }
        if noticed.is_some() && back.is_none() && health.state == EpipolarState::Good {
            back = Some(index - 11);
        }
    }
    let health = check.health();
    println!("noticed after {noticed:?} frames, good again after {back:?}: {health:?}");
    assert!(noticed.is_some_and(|n| n <= 10), "{noticed:?}");
    assert!(back.is_some_and(|n| n <= 29), "{back:?}");
    assert!(health.typical_px < 0.3 && health.lost < 0.02 && correction.has_moved(), "{health:?}");
}

#[test]
fn a_recording_is_rectified_as_it_is_read() {
    let bench = Bench::new();
    save(&bench.path("set"), set().good.clone());
    let (json, ok) = calibrate(&bench, &bench.path("set"), &BOARD);
    assert!(ok, "{json:#}");
    let rig = bench.path("rig.toml").display().to_string();
    bench.ok(&["rectify", "rig.toml", "set/left/1.png", "set/right/1.png", "-o", "one"]);
    let left = image::open(bench.path("one/left.png")).unwrap().into_luma8();
    // The overlay shows the left image: they agree where nothing is drawn.
    let agreeing = |out: &str| {
        let overlay = image::open(bench.path(out).join("overlay/000000.png")).unwrap().into_rgb8();
        left.enumerate_pixels().filter(|(x, y, p)| overlay.get_pixel(*x, *y).0 == [p.0[0]; 3]).count()
    };
    // By itself, because the rig can; when told to; and not when told not to.
    let [seen, told, raw] =
        [("seen", None), ("told", Some("true")), ("raw", Some("false"))].map(|(out, setting)| {
            let setting = setting.map(|value| format!("source.rectify={value}"));
            let args = ["replay", "set", "--in-process", "--limit", "2", "--rig", &rig, "--out", out];
            let more: Vec<&str> = setting.iter().flat_map(|setting| ["--set", setting]).collect();
            bench.ok(&[&args[..], &more].concat());
            agreeing(out)
        });
    println!("{seen} pixels agree, {told} when told to rectify, {raw} when told not to");
    assert!(seen > SIZE.0 * SIZE.1 / 10 && seen == told && 4 * raw < 3 * seen);
    let error = bench.fails(&["replay", "set", "--in-process", "--set", "source.rectify=true"]);
    assert!(error.contains("source.rig"), "{error}");
    // The file beside the pictures counts, too.
    std::fs::copy(&rig, bench.path("set/rig.toml")).unwrap();
    bench.ok(&["replay", "set", "--in-process", "--limit", "2", "--out", "beside"]);
    assert_eq!(agreeing("beside"), seen);
    // A rig for pictures of another size is refused, whatever is set.
    let small = bench.record("small", 2);
    for value in ["\"auto\"", "true", "false"] {
        let setting = format!("source.rectify={value}");
        let error = bench.fails(&["replay", &small, "--in-process", "--rig", &rig, "--set", &setting]);
        assert!(error.contains("480x360") && error.contains("320x240"), "{value}: {error}");
    }
    let pair = ["small/left/000000.png", "small/right/000000.png"];
    let error = bench.fails(&["obstacles", pair[0], pair[1], "--rig", &rig]);
    assert!(error.contains("480x360") && error.contains("320x240"), "{error}");
}

#[test]
fn live_pairs_are_chosen_and_calibrated() {
    let bench = Bench::new();
    // Every view three times: only the first of each adds information.
    let views = set().good.iter().flat_map(|pair| [pair.clone(), pair.clone(), pair.clone()]);
    save(&bench.path("pictures"), views);
    let args = ["calibrate", "--live", "pictures", "-o", "rig.toml", "--json"];
    let output = bench.run(&[&args[..], &BOARD].concat());
    let said = String::from_utf8_lossy(&output.stderr);
    let result: serde_json::Value =
        serde_json::from_slice(&output.stdout).unwrap_or_else(|e| panic!("{e}: {said}"));
    assert!(output.status.success() && result["verdict"] != "redo", "{result}\n{said}");
    let kept = result["pairs"].as_u64().unwrap();
    assert!((10..=VIEWS as u64).contains(&kept), "{kept} of {VIEWS} views: {said}");
    assert!(said.contains("only 5 views were used"), "what is missing must be said: {said}");
    assert!((result["baseline_m"].as_f64().unwrap() - 0.12).abs() < 0.001, "{result}");
    assert_eq!(std::fs::read_dir(bench.path("rig.pictures/left")).unwrap().count() as u64, kept);
    // New images are not mixed with existing ones.
    let again = bench.fails(&[&args[..], &BOARD].concat());
    assert!(again.contains("rig.pictures") && again.contains("--pictures"), "{again}");
    // From the running daemon, which repeats the same pairs.
    let folder = bench.path("pictures");
    std::fs::write(
        folder.join("rig.toml"),
        "focal_px = 400.0\nbaseline_m = 0.12\ncx_px = 240.0\ncy_px = 180.0\n",
    )
    .unwrap();
    let pictures = folder.display().to_string();
    let daemon = bench.start(&["replay", &pictures, "--fps", "6", "--loop", "--limit", "100000"]);
    bench.status_when(|status| status["state"] == "running");
    let config = bench.path("car.toml").display().to_string();
    let live = ["calibrate", "--live", "-c", &config, "-o", "live.toml", "--json", "--pictures", "kept"];
    let calibration = bench.start(&[&live[..], &BOARD].concat());
    // The daemon ends while the calibration waits for more pairs: it ends, too, with those that it has.
    let start = std::time::Instant::now();
    let count = || std::fs::read_dir(bench.path("kept/left")).map_or(0, Iterator::count);
    while count() < 6 {
        assert!(start.elapsed() < support::WATCHDOG, "no pairs were kept");
        std::thread::sleep(std::time::Duration::from_millis(20));
    }
    daemon.signal("TERM");
    daemon.wait();
    let output = calibration.wait();
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(said.contains("pair 6 kept") && said.contains("pairs kept in kept"), "{said}");
}
