//! Calibration files: our own, KITTI's, and those that `lookout rig` imports.

use super::harness::{fuzz, written};
use super::text;
use nalgebra::{Rotation3, Vector3};
use perception::calibration::{Camera, Crop, Pose};
use sources::rig_file::{Format, RigFile, export, import};
use std::path::Path;

/// A rig as `lookout calibrate` makes one.
fn rig() -> RigFile {
    let left = Camera {
        distortion: [0.1153, -0.2117, -0.00058, -0.00266, 0.0, 0.0, 0.0, 0.0],
        ..Camera::pinhole(463.104, 462.77, 314.812, 187.324)
    };
    let right = Camera { cx_px: 326.946, cy_px: 179.417, ..left };
    let rotation = Rotation3::new(Vector3::new(0.00741, 0.02216, 0.00964));
    let between = Pose { rotation, translation_m: Vector3::new(-0.094054, -0.00092, 0.002549) };
    RigFile::from_cameras([left, right], between, (640, 360), Crop::Valid).expect("a sound rig")
}

/// The rig in another program's format; its files one after the other.
fn exported(format: Format, ending: &str) -> Vec<u8> {
    let folder = tempfile::tempdir().expect("a folder");
    let paths = export(&rig(), format, &folder.path().join(format!("rig.{ending}"))).expect("it is written");
    paths.iter().flat_map(|path| std::fs::read(path).expect("it was written")).collect()
}

#[test]
fn rig_file() {
    let own = rig().to_toml().expect("it has a text");
    // Without the checksum, or every change would end there.
    let open = own[..own.find("# Of all bytes").expect("the checksum's comment")].to_owned();
    fuzz("calibrations::rig_file", vec![own.into(), open.into()], 8192, |input, _| match RigFile::from_toml(
        &text(input),
    ) {
        Err(error) => error,
        Ok(rig) => {
            let again = rig.to_toml().expect("what was read can be written");
            RigFile::from_toml(&again).expect("what was written can be read");
            "ok".into()
        }
    });
}

#[test]
fn calibration_text() {
    let seeds = [
        "P0: 700 0 600 0 0 700 180 0 0 0 1 0\nP1: 700 0 600 -378 0 700 180 0 0 0 1 0\n",
        "focal_px = 879.0\nbaseline_m = 0.12\ncx_px = 320.0\ncy_px = 240.0\n",
    ];
    fuzz(
        "calibrations::calibration_text",
        seeds.map(|s| s.as_bytes().to_vec()).into(),
        4096,
        |input, path| {
            // The extension selects the format.
            let ending = if input.first().is_some_and(u8::is_ascii_lowercase) { "toml" } else { "txt" };
            match sources::calibration_file::read(&written(path, ending, input), input.len() % 2 == 0) {
                Err(error) => error.to_string(),
                Ok(rig) => {
                    assert!(rig.focal_px > 0.0 && rig.baseline_m > 0.0, "{rig:?}");
                    "ok".into()
                }
            }
        },
    );
}

fn import_text(input: &[u8], path: &Path) -> String {
    let path = written(path, "yaml", input);
    match import(&[path], Some((640, 360)), Crop::Valid) {
        Err(error) => error.to_string(),
        Ok(rig) => format!("ok {:?}", rig.to_toml().is_ok()),
    }
}

#[test]
fn imported_calibration() {
    let mut seeds: Vec<Vec<u8>> =
        [Format::Opencv, Format::Ros, Format::Kalibr].map(|format| exported(format, "yaml")).into();
    seeds.push(b"cam0: {a: [1, 2, [3]], 'b': \"c\"}\n- x\n%YAML:1.0\n---\nM1: !!opencv-matrix\n".to_vec());
    fuzz("calibrations::imported_calibration", seeds, 16_384, import_text);
}
