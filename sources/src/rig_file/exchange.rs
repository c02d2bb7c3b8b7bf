//! Import and export of calibrations: OpenCV YAML, ROS camera_info, Kalibr camchain and KITTI calib.txt. All
//! are converted to two cameras, in metres, left to right.

use super::calibration::Calibration;
use super::values::{Cameras, camera, fisheye, numbers, pinhole, pixels, turn};
use super::yaml::{self, Value};
use super::{RigFile, check_camera, data_sets, rows, write_atomically};
use crate::{SourceError, calibration_file, calibration_text};
use nalgebra::{Matrix3, Rotation3, Vector3};
use perception::calibration::{Camera, Crop, Distortion, Pose};
use perception::excerpt::{VALUE_CHARS, excerpt};
use perception::rig::Rig;
use std::fmt::Write;
use std::path::{Path, PathBuf};

/// A calibration format.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Format {
    /// The rig file of this project.
    Toml,
    /// OpenCV FileStorage YAML: M1, D1, M2, D2, R, T, R1, R2, P1, P2, Q, image_size; `distortion_model: equidistant` if D1 and
    /// D2 are those of `cv::fisheye`.
    Opencv,
    /// ROS camera_info, one file per camera: the left one at the given path, the right one with "right"
    /// instead of "left" in its name, or with "_right" appended.
    Ros,
    /// Kalibr camchain: pinhole with radtan or equidistant, four coefficients.
    Kalibr,
    /// KITTI calib.txt: P2 and P3 of the rectified pair.
    Kitti,
}

/// Reads a calibration from one file, or from two (ROS and OpenCV). `size` is the image size for formats that
/// do not contain it; `crop` selects the rectification.
///
/// # Errors
/// Names the file, the key or line, and the expected content.
pub fn import(paths: &[PathBuf], size: Option<(usize, usize)>, crop: Crop) -> Result<RigFile, SourceError> {
    let Some(first) = paths.first() else {
        return Err(SourceError::Calibration { path: PathBuf::new(), reason: "no file given".into() });
    };
    let fail = |reason: String| SourceError::Calibration { path: first.clone(), reason };
    match first.extension().and_then(|e| e.to_str()) {
        Some("toml") => return from_toml(first, size),
        Some("txt") => {
            let rig = calibration_file::read(first, false)?;
            let size = size.ok_or_else(|| {
                fail("a calib.txt does not contain the image size: give it with --size".into())
            })?;
            return rectified(&rig, size, crop).map_err(fail);
        }
        _ => {}
    }
    // EuRoC has a file in the folder of each camera; the left one names the pair.
    let both = (paths.len() == 1 && first.ends_with(calibration_file::SENSOR))
        .then(|| other_sensor(first))
        .flatten();
    let both: Vec<&PathBuf> = paths.iter().chain(&both).collect();
    let mut documents = Vec::new();
    for path in both {
        let text = calibration_text::read(path)?;
        let document =
            yaml::parse(&text).map_err(|reason| SourceError::Calibration { path: path.clone(), reason })?;
        documents.push(document);
    }
    let key = |name: &str| documents.iter().any(|d| d.get(name).is_some());
    let read = if key("cam0") {
        kalibr(&documents[0])
    } else if key("camera_matrix") {
        ros(&documents)
    } else if key("T_BS") {
        data_sets::sensors(&documents)
    } else if key("M1") || key("K1") {
        opencv(&documents, size)
    } else if key("T") && key("R") {
        Err(OTHER_HALF_OF_INTRINSICS.into())
    } else {
        Err("found none of cam0 (Kalibr), camera_matrix (ROS), T_BS (EuRoC), M1 or K1 (OpenCV): give such a file, or make one \
             with lookout calibrate"
            .into())
    };
    let (cameras, between, size) = read.map_err(fail)?;
    for (camera, name) in cameras.iter().zip(["the left camera", "the right camera"]) {
        check_camera(camera, name).map_err(fail)?;
    }
    RigFile::from_cameras(cameras, between, size, crop).map_err(fail)
}

/// The rig of a TOML file. One of four numbers is a pair that is rectified already: two equal cameras without distortion,
/// whose picture stays as it is.
fn from_toml(path: &Path, size: Option<(usize, usize)>) -> Result<RigFile, SourceError> {
    let fail = |reason: String| SourceError::Calibration { path: path.to_owned(), reason };
    match calibration_file::open_sized(path, false, size)? {
        Calibration::Cameras(file) => Ok(*file),
        Calibration::Rectified { rig, size: of_file } => {
            let size = of_file.or(size).ok_or_else(|| {
                let without = "four numbers, which do not say the size of the pictures";
                fail(format!("{without}: add width and height to the file, or give it with --size"))
            })?;
            rectified(&rig, size, Crop::Same).map_err(fail)
        }
    }
}

/// A pair that is rectified already.
fn rectified(rig: &Rig, size: (usize, usize), crop: Crop) -> Result<RigFile, String> {
    let camera = Camera::pinhole(rig.focal_px, rig.focal_px, rig.cx_px, rig.cy_px);
    let translation_m = Vector3::new(-rig.baseline_m, 0.0, 0.0);
    RigFile::from_cameras([camera; 2], Pose { rotation: Rotation3::identity(), translation_m }, size, crop)
}

/// The `sensor.yaml` of the right camera, beside that of the left in a folder whose name ends with 0.
fn other_sensor(left: &Path) -> Option<PathBuf> {
    let camera = left.parent()?;
    let name = camera.file_name()?.to_str()?.strip_suffix('0')?;
    Some(camera.with_file_name(format!("{name}1")).join(calibration_file::SENSOR))
}

/// What to do with one of two files of OpenCV.
const OTHER_HALF_OF_INTRINSICS: &str = "OpenCV's extrinsics without the cameras (M1, D1, M2, D2): join it with the file of the \
                                        intrinsics: lookout rig EXTRINSICS INTRINSICS --size WIDTHxHEIGHT --format toml -o \
                                        rig.toml, and give rig.toml";

/// The same of the other.
const OTHER_HALF_OF_EXTRINSICS: &str = "OpenCV's intrinsics without R and T between the cameras: join it with the file of the \
                                        extrinsics: lookout rig EXTRINSICS INTRINSICS --size WIDTHxHEIGHT --format toml -o \
                                        rig.toml, and give rig.toml";

fn opencv(documents: &[Value], size: Option<(usize, usize)>) -> Result<Cameras, String> {
    if !["R", "T"].iter().any(|key| documents.iter().any(|d| d.get(key).is_some())) {
        return Err(OTHER_HALF_OF_EXTRINSICS.into());
    }
    // Intrinsics and extrinsics may be in two files.
    let holder = |key: &str| documents.iter().find(|d| d.get(key).is_some()).unwrap_or(&documents[0]);
    let name = |a: &'static str, b: &'static str| if holder(a).get(a).is_some() { a } else { b };
    let model = holder("distortion_model").get("distortion_model").and_then(Value::word);
    let is_fisheye = match model {
        None | Some("plumb_bob" | "rational_polynomial") => false,
        Some("equidistant" | "fisheye") => true,
        Some(other) => {
            return Err(format!(
                "distortion_model is {}: equidistant (of cv::fisheye) and plumb_bob are supported",
                excerpt(other, VALUE_CHARS)
            ));
        }
    };
    let side = |m: &str, d: &str| -> Result<Camera, String> {
        let coefficients =
            holder(d).get(d).and_then(Value::numbers).ok_or_else(|| format!("{d} is missing"))?;
        let lens = if is_fisheye { fisheye } else { camera };
        lens(&numbers(holder(m), m)?, &coefficients)
    };
    let left = side(name("M1", "K1"), "D1")?;
    let right = side(name("M2", "K2"), "D2")?;
    let size = if holder("image_size").get("image_size").is_some() {
        let [w, h] = numbers(holder("image_size"), "image_size")?;
        (pixels(w)?, pixels(h)?)
    } else if holder("image_width").get("image_width").is_some() {
        let [w] = numbers(holder("image_width"), "image_width")?;
        let [h] = numbers(holder("image_height"), "image_height")?;
        (pixels(w)?, pixels(h)?)
    } else {
        size.ok_or("found neither image_size nor image_width and image_height: give the image size, with lookout rig by --size")?
    };
    let t: [f64; 3] = numbers(holder("T"), "T")?;
    let between = Pose { rotation: turn(&numbers(holder("R"), "R")?, "R")?, translation_m: Vector3::from(t) };
    Ok(([left, right], between, size))
}

/// Camera, rectifying rotation, projection of the rectified camera, and image size.
type RosCamera = (Camera, Matrix3<f64>, [f64; 12], (usize, usize));

fn ros(documents: &[Value]) -> Result<Cameras, String> {
    let [left, right] = documents else {
        return Err("a camera_info file holds one camera: give the left and the right one".into());
    };
    let one = |d: &Value| -> Result<RosCamera, String> {
        let model = d.get("distortion_model").and_then(Value::word).unwrap_or("plumb_bob");
        if !["plumb_bob", "rational_polynomial", "equidistant"].contains(&model) {
            return Err(format!(
                "distortion_model is {}: plumb_bob, rational_polynomial and equidistant are supported",
                excerpt(model, VALUE_CHARS)
            ));
        }
        let coefficients = d
            .get("distortion_coefficients")
            .and_then(Value::numbers)
            .ok_or("distortion_coefficients is missing")?;
        let [w] = numbers(d, "image_width")?;
        let [h] = numbers(d, "image_height")?;
        let lens = if model == "equidistant" { fisheye } else { camera };
        let camera = lens(&numbers(d, "camera_matrix")?, &coefficients)?;
        let turn = turn(&numbers(d, "rectification_matrix")?, "rectification_matrix")?;
        Ok((camera, *turn.matrix(), numbers(d, "projection_matrix")?, (pixels(w)?, pixels(h)?)))
    };
    let (l, r) = (one(left)?, one(right)?);
    if l.3 != r.3 {
        return Err("the cameras have different image sizes".into());
    }
    // In rectified coordinates the right camera lies on the x axis of the left one; rotate that back.
    let rotation = Rotation3::from_matrix_unchecked(r.1.transpose() * l.1);
    let translation_m = r.1.transpose() * Vector3::new(r.2[3] / r.2[0], 0.0, 0.0);
    Ok(([l.0, r.0], Pose { rotation, translation_m }, l.3))
}

fn kalibr(document: &Value) -> Result<Cameras, String> {
    let one = |key: &str| -> Result<(Camera, (usize, usize)), String> {
        let c = document.get(key).ok_or_else(|| format!("{key} is missing: two cameras are required"))?;
        pinhole(c, "radtan", "distortion_coeffs").map_err(|reason| format!("{key}: {reason}"))
    };
    let (left, right) = (one("cam0")?, one("cam1")?);
    if left.1 != right.1 {
        return Err("the cameras have different image sizes".into());
    }
    let second = document.get("cam1").ok_or("cam1 is missing")?;
    let m: [f64; 16] = numbers(second, "T_cn_cnm1")?;
    let rotation = turn(&[m[0], m[1], m[2], m[4], m[5], m[6], m[8], m[9], m[10]], "T_cn_cnm1")?;
    let between = Pose { rotation, translation_m: Vector3::new(m[3], m[7], m[11]) };
    Ok(([left.0, right.0], between, left.1))
}

/// Writes a calibration. Returns the paths of the written files.
///
/// # Errors
/// When a file cannot be written, or the format does not support the lens model.
pub fn write(rig: &RigFile, format: Format, path: &Path) -> Result<Vec<PathBuf>, SourceError> {
    let fail = |reason: &str| SourceError::Calibration { path: path.to_owned(), reason: reason.into() };
    let distortions = || rig.cameras.iter().map(|c| &c.distortion);
    let fisheyes = distortions().filter(|d| matches!(d, Distortion::Equidistant(_))).count();
    if fisheyes == 1 && format == Format::Opencv {
        return Err(fail(
            "OpenCV's pairs have lenses of one model, these are a fisheye and another lens: write ros, kalibr or toml",
        ));
    }
    let beyond = |from: usize| distortions().any(|d| d.coefficients().iter().skip(from).any(|v| *v != 0.0));
    let text = match format {
        Format::Toml => {
            rig.write(path)?;
            return Ok(vec![path.to_owned()]);
        }
        Format::Opencv => to_opencv(rig),
        Format::Kalibr if beyond(4) => {
            return Err(fail("Kalibr's radtan has k1, k2, p1 and p2 only: calibrate with --lens radial2"));
        }
        Format::Kalibr => to_kalibr(rig),
        Format::Kitti => to_kitti(rig),
        Format::Ros => {
            let name = path.file_name().and_then(|n| n.to_str()).unwrap_or("left.yaml");
            let other = match name.rsplit_once('.') {
                _ if name.contains("left") => name.replace("left", "right"),
                Some((stem, end)) => format!("{stem}_right.{end}"),
                None => format!("{name}_right"),
            };
            let right = path.with_file_name(other);
            write_atomically(path, &to_ros(rig, 0))?;
            write_atomically(&right, &to_ros(rig, 1))?;
            return Ok(vec![path.to_owned(), right]);
        }
    };
    write_atomically(path, &text)?;
    Ok(vec![path.to_owned()])
}

/// A number that reads back exactly, with a decimal point: YAML 1.1, which ROS and Kalibr read, takes 1e-5 as text.
fn number(value: f64) -> String {
    let text = format!("{value:?}");
    match text.split_once('e') {
        Some((digits, power)) if !digits.contains('.') => format!("{digits}.0e{power}"),
        _ => text,
    }
}

fn list(values: impl IntoIterator<Item = f64>) -> String {
    let words: Vec<String> = values.into_iter().map(number).collect();
    format!("[{}]", words.join(", "))
}

fn matrix(camera: &Camera) -> [f64; 9] {
    [camera.fx_px, 0.0, camera.cx_px, 0.0, camera.fy_px, camera.cy_px, 0.0, 0.0, 1.0]
}

/// Distortion coefficients: five or eight in OpenCV's order, or the four of a fisheye lens.
fn coefficients(camera: &Camera) -> &[f64] {
    match &camera.distortion {
        Distortion::BrownConrady(k) if k[5..].iter().any(|v| *v != 0.0) => k,
        Distortion::BrownConrady(k) => &k[..5],
        Distortion::Equidistant(k) => k,
    }
}

/// The name of the distortion model in ROS.
fn model(camera: &Camera) -> &'static str {
    match coefficients(camera).len() {
        4 => "equidistant",
        5 => "plumb_bob",
        _ => "rational_polynomial",
    }
}

fn projection(rig: &RigFile, side: usize) -> [f64; 12] {
    let r = &rig.rectification.rig;
    let shift = if side == 0 { 0.0 } else { -r.focal_px * r.baseline_m };
    [r.focal_px, 0.0, r.cx_px, shift, 0.0, r.focal_px, r.cy_px, 0.0, 0.0, 0.0, 1.0, 0.0]
}

fn to_opencv(rig: &RigFile) -> String {
    let mut text = "%YAML:1.0\n---\n".to_owned();
    let (w, h) = rig.size();
    let _ = writeln!(text, "image_size: [{w}, {h}]");
    if model(&rig.cameras[0]) == "equidistant" {
        let _ = writeln!(text, "distortion_model: equidistant");
    }
    let mut put = |name: &str, rows: usize, values: &[f64]| {
        let _ = writeln!(
            text,
            "{name}: !!opencv-matrix\n   rows: {rows}\n   cols: {}\n   dt: d\n   data: {}",
            values.len() / rows,
            list(values.iter().copied())
        );
    };
    for (side, n) in ["1", "2"].into_iter().enumerate() {
        put(&format!("M{n}"), 3, &matrix(&rig.cameras[side]));
        put(&format!("D{n}"), 1, coefficients(&rig.cameras[side]));
    }
    put("R", 3, &rows(&rig.between.rotation).concat());
    put("T", 3, rig.between.translation_m.as_slice());
    for (side, n) in ["1", "2"].into_iter().enumerate() {
        put(&format!("R{n}"), 3, &rows(&rig.rectification.turns[side]).concat());
        put(&format!("P{n}"), 3, &projection(rig, side));
    }
    put("Q", 4, &rig.rectification.reprojection().concat());
    text
}

fn to_ros(rig: &RigFile, side: usize) -> String {
    let camera = &rig.cameras[side];
    let (w, h) = rig.size();
    let (d, model) = (coefficients(camera), model(camera));
    let block = |name: &str, rows: usize, values: &[f64]| {
        format!(
            "{name}:\n  rows: {rows}\n  cols: {}\n  data: {}\n",
            values.len() / rows,
            list(values.iter().copied())
        )
    };
    format!(
        "image_width: {w}\nimage_height: {h}\ncamera_name: {}\n{}distortion_model: {model}\n{}{}{}",
        ["left", "right"][side],
        block("camera_matrix", 3, &matrix(camera)),
        block("distortion_coefficients", 1, d),
        block("rectification_matrix", 3, &rows(&rig.rectification.turns[side]).concat()),
        block("projection_matrix", 3, &projection(rig, side)),
    )
}

fn to_kalibr(rig: &RigFile) -> String {
    let mut text = String::new();
    let (w, h) = rig.size();
    for (side, camera) in rig.cameras.iter().enumerate() {
        let k = [camera.fx_px, camera.fy_px, camera.cx_px, camera.cy_px];
        let _ = writeln!(
            text,
            "cam{side}:\n  camera_model: pinhole\n  intrinsics: {}\n  distortion_model: {}\n  \
             distortion_coeffs: {}\n  resolution: [{w}, {h}]\n  rostopic: /cam{side}/image_raw",
            list(k),
            if model(camera) == "equidistant" { "equidistant" } else { "radtan" },
            list(camera.distortion.coefficients()[..4].iter().copied())
        );
    }
    let t = rig.between.translation_m;
    let _ = writeln!(text, "  T_cn_cnm1:");
    for (row, t) in rows(&rig.between.rotation).iter().zip(t.iter()) {
        let _ = writeln!(text, "  - {}", list(row.iter().copied().chain([*t])));
    }
    let _ = writeln!(text, "  - [0.0, 0.0, 0.0, 1.0]");
    text
}

fn to_kitti(rig: &RigFile) -> String {
    let line = |name: &str, side: usize| {
        let words: Vec<String> = projection(rig, side).iter().map(|v| format!("{v:?}")).collect();
        format!("{name}: {}\n", words.join(" "))
    };
    [("P0", 0), ("P1", 1), ("P2", 0), ("P3", 1)].map(|(name, side)| line(name, side)).concat()
}

#[cfg(test)]
mod tests {
    use super::super::tests::example;
    use super::*;

    fn close(a: &RigFile, b: &RigFile, format: Format) {
        for side in 0..2 {
            for (x, y) in a.cameras[side].parameters().iter().zip(b.cameras[side].parameters()) {
                assert!((x - y).abs() < 1e-9, "{format:?}");
            }
        }
        assert!((a.between.translation_m - b.between.translation_m).norm() < 1e-9, "{format:?}");
        assert!((a.between.rotation.matrix() - b.between.rotation.matrix()).norm() < 1e-9, "{format:?}");
        assert_eq!(a.size(), b.size());
    }

    #[test]
    fn every_format_is_read_as_it_was_written() {
        let folder = tempfile::tempdir().unwrap();
        let rig = example();
        let mut wide = example();
        for (camera, k2) in wide.cameras.iter_mut().zip([-0.01, -0.02]) {
            camera.distortion = Distortion::Equidistant([0.02, k2, 0.003, -0.0004]);
        }
        for (rig, (format, name)) in [&rig, &wide].into_iter().flat_map(|rig| {
            [rig; 4].into_iter().zip([
                (Format::Opencv, "cv.yml"),
                (Format::Ros, "left.yaml"),
                (Format::Ros, "front.yaml"),
                (Format::Kalibr, "camchain.yaml"),
            ])
        }) {
            let files = write(rig, format, &folder.path().join(name)).unwrap();
            assert_eq!(files.len(), if format == Format::Ros { 2 } else { 1 });
            close(&import(&files, None, Crop::Valid).unwrap(), rig, format);
        }
        // One of each: each camera has its model, but for OpenCV.
        wide.cameras[0] = rig.cameras[0];
        assert!(write(&wide, Format::Opencv, &folder.path().join("cv.yml")).is_err());
        let files = write(&wide, Format::Kalibr, &folder.path().join("camchain.yaml")).unwrap();
        close(&import(&files, None, Crop::Valid).unwrap(), &wide, Format::Kalibr);
        let files = write(&rig, Format::Kitti, &folder.path().join("calib.txt")).unwrap();
        let back = import(&files, Some((640, 360)), Crop::Same).unwrap();
        let (a, b) = (back.rectification.rig, rig.rectification.rig);
        assert!((a.focal_px - b.focal_px).abs() < 1e-9 && (a.baseline_m - b.baseline_m).abs() < 1e-12);
        assert!(import(&files, None, Crop::Same).unwrap_err().to_string().contains("size"));
        // Four numbers.
        let path = folder.path().join("plain.toml");
        let plain = "focal_px = 440.0\nbaseline_m = 0.12\ncx_px = 301.0\ncy_px = 190.5\n";
        std::fs::write(&path, plain).unwrap();
        let paths = [path];
        let back = import(&paths, Some((640, 360)), Crop::Valid).unwrap();
        let numbers = Rig { focal_px: 440.0, baseline_m: 0.12, cx_px: 301.0, cy_px: 190.5 };
        let off = |a: f64, b: f64| assert!((a - b).abs() < 1e-9, "{a}, not {b}");
        let found = back.rectification.rig;
        off(found.focal_px, numbers.focal_px);
        off(found.baseline_m, numbers.baseline_m);
        off(found.cx_px, numbers.cx_px);
        off(found.cy_px, numbers.cy_px);
        assert!(back.size() == (640, 360) && back.rectification_px() < 1e-9);
        let error = import(&paths, None, Crop::Valid).unwrap_err().to_string();
        assert!(error.contains("plain.toml") && error.contains("--size"), "{error}");
        std::fs::write(&paths[0], format!("{plain}width = 640\nheight = 360\n")).unwrap();
        assert_eq!(import(&paths, None, Crop::Valid).unwrap(), back);
        assert!(import(&paths, Some((320, 180)), Crop::Valid).is_err(), "two sizes");
        // A lens model that the format does not support.
        let mut rig = rig;
        rig.cameras[1].distortion = Distortion::BrownConrady([0.1, 0.0, 0.0, 0.0, 0.1, 0.0, 0.0, 0.0]);
        assert!(write(&rig, Format::Kalibr, &folder.path().join("k.yaml")).is_err());
        let files = write(&rig, Format::Opencv, &folder.path().join("k3.yml")).unwrap();
        close(&import(&files, None, Crop::Valid).unwrap(), &rig, Format::Opencv);
    }

    #[test]
    fn faults_are_named() {
        let folder = tempfile::tempdir().unwrap();
        let rig = example();
        let path = folder.path().join("left.yaml");
        write(&rig, Format::Ros, &path).unwrap();
        let alone = import(std::slice::from_ref(&path), None, Crop::Valid).unwrap_err().to_string();
        assert!(alone.contains("left and the right"), "{alone}");
        let path = folder.path().join("cv.yml");
        write(&rig, Format::Opencv, &path).unwrap();
        let text = std::fs::read_to_string(&path).unwrap();
        for (from, to, expected) in [
            ("M2", "X2", "K2 is missing"),
            ("image_size: [640, 360]\n", "", "size"),
            ("T: !!", "T2: !!", "T is missing"),
            ("463.104", "x", "not a number"),
            ("463.104", "-463.104", "focal"),
            ("data: [", "data: [1, ", "10 numbers"),
        ] {
            std::fs::write(&path, text.replacen(from, to, 1)).unwrap();
            let error = import(std::slice::from_ref(&path), None, Crop::Valid).unwrap_err().to_string();
            assert!(error.contains(expected) && error.contains("cv.yml"), "{from}: {error}");
        }
    }
}
