//! Calibration files: our own, KITTI's, and those that `lookout rig` imports.

use super::harness::{Format as Fuzzed, fuzz_format, written};
use super::{structure, text};
use fastrand::Rng;
use nalgebra::{Rotation3, Vector3};
use perception::calibration::{Camera, Crop, Distortion, Pose};
use sources::rig_file::{Format, RigFile, export, import};

/// A rig as `lookout calibrate` makes one, each time another.
fn some_rig(random: &mut Rng) -> RigFile {
    let is_fisheye = random.bool();
    let mut near = |value: f64| value * (0.95 + 0.1 * random.f64());
    let distortion = if is_fisheye {
        Distortion::Equidistant([near(-0.02), near(0.01), near(-0.006), near(0.001)])
    } else {
        let k = [near(0.1153), near(-0.2117), near(-0.00058), near(-0.00266)];
        Distortion::BrownConrady([k[0], k[1], k[2], k[3], 0.0, 0.0, 0.0, 0.0])
    };
    let left =
        Camera { distortion, ..Camera::pinhole(near(463.104), near(462.77), near(314.812), near(187.324)) };
    let right = Camera { cx_px: near(326.946), cy_px: near(179.417), ..left };
    let rotation = Rotation3::new(Vector3::new(near(0.00741), near(0.02216), near(0.00964)));
    let between = Pose { rotation, translation_m: Vector3::new(near(-0.094), near(-0.00092), near(0.0025)) };
    RigFile::from_cameras([left, right], between, (640, 360), Crop::Valid).expect("a sound rig")
}

/// The rig in another program's format; its files one after the other.
fn exported(rig: &RigFile, format: Format, ending: &str) -> Vec<Vec<u8>> {
    let folder = tempfile::tempdir().expect("a folder");
    let paths = export(rig, format, &folder.path().join(format!("rig.{ending}"))).expect("it is written");
    paths.iter().map(|path| std::fs::read(path).expect("it was written")).collect()
}

#[test]
fn rig_file() {
    let mut generate = |random: &mut Rng| {
        let mut own = some_rig(random).to_toml().expect("it has a text");
        if random.u8(0..4) > 0 {
            // Without the checksum, or every change would end there.
            own.truncate(own.find("# Of all bytes").expect("the checksum's comment"));
        }
        own.into_bytes()
    };
    let name = "calibrations::rig_file";
    let format = Fuzzed { name, longest: 8192, generate: &mut generate, change: structure::lines };
    fuzz_format(format, |input, _| {
        let rig = RigFile::from_toml(&text(input))?;
        let again = rig.to_toml().expect("what was read can be written");
        RigFile::from_toml(&again).expect("what was written can be read");
        Ok("ok".into())
    });
}

#[test]
fn calibration_text() {
    let mut generate = |random: &mut Rng| {
        let rig = some_rig(random);
        match random.u8(0..3) {
            0 => {
                let r = rig.rectification.rig;
                let (f, b, x, y) = (r.focal_px, r.baseline_m, r.cx_px, r.cy_px);
                format!("focal_px = {f:?}\nbaseline_m = {b:?}\ncx_px = {x:?}\ncy_px = {y:?}\n").into_bytes()
            }
            1 => rig.to_toml().expect("it has a text").into_bytes(),
            _ => exported(&rig, Format::Kitti, "txt").concat(),
        }
    };
    let name = "calibrations::calibration_text";
    let format = Fuzzed { name, longest: 4096, generate: &mut generate, change: structure::lines };
    fuzz_format(format, |input, path| {
        // The extension selects the format.
        let ending = if input.starts_with(b"P") { "txt" } else { "toml" };
        let rig = sources::calibration_file::read(&written(path, ending, input), input.len() % 2 == 0)
            .map_err(|e| e.to_string())?;
        assert!(rig.focal_px > 0.0 && rig.baseline_m > 0.0, "{rig:?}");
        Ok("ok".into())
    });
}

/// Stands between the two files of a calibration of ROS.
const BETWEEN: &str = "# the right camera\n";

#[test]
fn imported_calibration() {
    let mut generate = |random: &mut Rng| {
        let rig = some_rig(random);
        match random.u8(0..3) {
            0 => exported(&rig, Format::Opencv, "yaml").concat(),
            1 => exported(&rig, Format::Ros, "yaml").join(BETWEEN.as_bytes()),
            _ => exported(&rig, Format::Kalibr, "yaml").concat(),
        }
    };
    let name = "calibrations::imported_calibration";
    let format = Fuzzed { name, longest: 16_384, generate: &mut generate, change: structure::lines };
    fuzz_format(format, |input, path| {
        let text = text(input);
        let files: Vec<&str> = text.split(BETWEEN).take(2).collect();
        let paths: Vec<_> = ["left.yaml", "right.yaml"]
            .into_iter()
            .zip(files)
            .map(|(ending, file)| written(path, ending, file.as_bytes()))
            .collect();
        let rig = import(&paths, Some((640, 360)), Crop::Valid).map_err(|e| e.to_string())?;
        Ok(format!("ok {:?}", rig.to_toml().is_ok()))
    });
}
