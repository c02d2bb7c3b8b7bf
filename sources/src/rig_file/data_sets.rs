//! Calibrations as data sets have them: KITTI's raw drives (`calib_cam_to_cam.txt`) and EuRoC (`sensor.yaml`).

use super::calibration::Calibration;
use super::values::{Cameras, camera, numbers, pinhole, pixels, turn};
use super::yaml::Value;
use super::{RigFile, check_camera};
use nalgebra::{Rotation3, Vector3};
use perception::calibration::{Crop, Pose};
use perception::excerpt::{VALUE_CHARS, excerpt};
use perception::rig::Rig;

/// Reads KITTI's `calib_cam_to_cam.txt`: of the colour cameras (02 and 03) or of the grey ones (00 and 01), for pictures
/// of `size`. Those of the synchronised drives are rectified, those of the raw ones are larger and are not.
///
/// # Errors
/// Names the line or the key, or both sizes.
pub fn kitti_raw(text: &str, colour: bool, size: Option<(usize, usize)>) -> Result<Calibration, String> {
    let [left, right] = if colour { ["02", "03"] } else { ["00", "01"] };
    let key = |name: &str, side: &str| format!("{name}_{side}");
    let rectified = size_of(text, &key("S_rect", left))?;
    let raw = size_of(text, &key("S", left))?;
    let size = size.unwrap_or(rectified);
    if size == rectified {
        let l: [f64; 12] = values(text, &key("P_rect", left))?;
        let r: [f64; 12] = values(text, &key("P_rect", right))?;
        let rig = Rig { focal_px: l[0], baseline_m: (l[3] - r[3]) / l[0], cx_px: l[2], cy_px: l[6] };
        let rig = rig.checked().map_err(|e| e.to_string())?;
        return Ok(Calibration::Rectified { rig, size: Some(rectified) });
    }
    if size != raw {
        return Err(format!(
            "for rectified images of {}x{} pixels or raw ones of {}x{}, the source has {}x{}: give the calibration of that day",
            rectified.0, rectified.1, raw.0, raw.1, size.0, size.1
        ));
    }
    let one = |side: &str| -> Result<_, String> {
        let k: [f64; 9] = values(text, &key("K", side))?;
        let d: [f64; 5] = values(text, &key("D", side))?;
        let camera = camera(&k, &d)?;
        check_camera(&camera, &key("K", side))?;
        let r: [f64; 9] = values(text, &key("R", side))?;
        let t: [f64; 3] = values(text, &key("T", side))?;
        // From camera 00 to this one.
        Ok((camera, turn(&r, &key("R", side))?, Vector3::from(t)))
    };
    let (l, r) = (one(left)?, one(right)?);
    let rotation = r.1 * l.1.inverse();
    let between = Pose { rotation, translation_m: r.2 - rotation * l.2 };
    let file = RigFile::from_cameras([l.0, r.0], between, size, Crop::Valid)?;
    Ok(Calibration::Cameras(Box::new(file)))
}

/// Exactly `N` numbers of a line `key: …`.
fn values<const N: usize>(text: &str, key: &str) -> Result<[f64; N], String> {
    let found = text
        .lines()
        .enumerate()
        .find(|(_, line)| line.split_ascii_whitespace().next() == Some(&format!("{key}:")));
    let (i, line) =
        found.ok_or_else(|| format!("{key} is missing: give KITTI's calib_cam_to_cam.txt as it is"))?;
    let list = line.split_ascii_whitespace().skip(1).map(|word| {
        let number = word.parse::<f64>().ok().filter(|v| v.is_finite());
        number.ok_or_else(|| format!("line {}: \"{}\" is not a number", i + 1, excerpt(word, VALUE_CHARS)))
    });
    let list = list.collect::<Result<Vec<f64>, _>>()?;
    let count = list.len();
    list.try_into().map_err(|_| format!("line {}: {key} has {count} numbers, not {N}", i + 1))
}

fn size_of(text: &str, key: &str) -> Result<(usize, usize), String> {
    let [w, h] = values(text, key)?;
    Ok((pixels(w)?, pixels(h)?))
}

/// Reads the `sensor.yaml` of two cameras of EuRoC: pinhole, radial-tangential or equidistant, with the pose of each in the body.
pub(super) fn sensors(documents: &[Value]) -> Result<Cameras, String> {
    let [left, right] = documents else {
        return Err("a sensor.yaml holds one camera: give the left and the right one".into());
    };
    let one = |d: &Value| -> Result<_, String> {
        let (camera, size) = pinhole(d, "radial-tangential", "distortion_coefficients")?;
        let m: [f64; 16] = numbers(d, "T_BS")?;
        let rotation = turn(&[m[0], m[1], m[2], m[4], m[5], m[6], m[8], m[9], m[10]], "T_BS")?;
        Ok((camera, rotation, Vector3::new(m[3], m[7], m[11]), size))
    };
    let (l, r) = (one(left)?, one(right)?);
    if l.3 != r.3 {
        return Err("the cameras have different image sizes".into());
    }
    // From the left camera to the body, and from there to the right one.
    let rotation: Rotation3<f64> = r.1.inverse() * l.1;
    let between = Pose { rotation, translation_m: r.1.inverse() * (l.2 - r.2) };
    Ok(([l.0, r.0], between, l.3))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::calibration_file::{self, KITTI_RAW};
    use nalgebra::Matrix3;
    use perception::calibration::Distortion;
    use std::path::Path;

    const CAMERA: &str = "S_02: 100 60\nK_02: 80 0 50 0 80 30 0 0 1\nD_02: -0.3 0.1 0 0 0\nR_02: 1 0 0 0 1 0 0 0 1\n\
                          T_02: 0.06 0 0\nS_rect_02: 90 40\nP_rect_02: 70 0 45 4.2 0 70 20 0 0 0 1 0\n";

    fn text() -> String {
        let right =
            CAMERA.replace("_02", "_03").replace("0.06 0 0", "-0.44 0 0").replace("45 4.2", "45 -30.8");
        format!("calib_time: 09-Jan-2012 13:57:47\ncorner_dist: 9.950000e-02\n{CAMERA}{right}")
    }

    #[test]
    fn the_raw_drives_of_kitti_are_read_rectified_and_not() {
        let Calibration::Rectified { rig, size: Some((90, 40)) } =
            kitti_raw(&text(), true, Some((90, 40))).unwrap()
        else {
            panic!("rectified pictures")
        };
        assert_eq!((rig.focal_px, rig.cx_px, rig.cy_px), (70.0, 45.0, 20.0));
        assert!((rig.baseline_m - 0.5).abs() < 1e-12);
        let Calibration::Cameras(file) = kitti_raw(&text(), true, Some((100, 60))).unwrap() else {
            panic!("raw pictures")
        };
        assert!((file.between.translation_m - Vector3::new(-0.5, 0.0, 0.0)).norm() < 1e-12);
        assert_eq!(file.cameras[0].distortion.coefficients()[0], -0.3);
        for (from, to, size, expected) in [
            ("", "", (91, 40), "90x40"),
            ("K_03", "K_04", (100, 60), "K_03 is missing"),
            ("D_03: -0.3", "D_03: x", (100, 60), "\"x\" is not a number"),
            ("T_03: -0.44", "T_03:", (100, 60), "T_03 has 2 numbers, not 3"),
        ] {
            let error = kitti_raw(&text().replace(from, to), true, Some(size)).unwrap_err();
            assert!(error.contains(expected), "{error}");
        }
        assert!(kitti_raw(&text(), false, None).unwrap_err().contains("S_rect_00 is missing"));
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join(KITTI_RAW);
        std::fs::write(&path, text()).unwrap();
        assert_eq!(calibration_file::read_for(&path, true, (90, 40)).unwrap(), rig);
    }

    fn write_sensor(path: &Path, x_m: f64) {
        let text = format!(
            "# General sensor definitions.\nsensor_type: camera\nT_BS:\n  cols: 4\n  rows: 4\n  data: [0.0, -1.0, 0.0, 0.0,\n         \
             1.0, 0.0, 0.0, {x_m},\n         0.0, 0.0, 1.0, 0.0,\n         0.0, 0.0, 0.0, 1.0]\nrate_hz: 20\n\
             resolution: [64, 48]\ncamera_model: pinhole\nintrinsics: [60.0, 60.0, 32.0, 24.0] #fu, fv, cu, cv\n\
             distortion_model: radial-tangential\ndistortion_coefficients: [-0.2, 0.07, 0.0, 0.0]\n"
        );
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(path, text).unwrap();
    }

    #[test]
    fn the_cameras_of_euroc_are_read_from_both_files() {
        let folder = tempfile::tempdir().unwrap();
        let left = folder.path().join("cam0/sensor.yaml");
        write_sensor(&left, 0.0);
        let error = calibration_file::open(&left, true).unwrap_err().to_string();
        assert!(error.contains("cam1"), "{error}");
        // The body's y axis is the camera's x axis.
        write_sensor(&folder.path().join("cam1/sensor.yaml"), 0.11);
        let Calibration::Cameras(file) = calibration_file::open(&left, true).unwrap() else {
            panic!("cameras")
        };
        assert!((file.between.translation_m - Vector3::new(-0.11, 0.0, 0.0)).norm() < 1e-12);
        assert!((file.between.rotation.matrix() - Matrix3::identity()).norm() < 1e-12);
        assert_eq!((file.size(), file.cameras[1].distortion.coefficients()[1]), ((64, 48), 0.07));
        let text = std::fs::read_to_string(&left).unwrap();
        std::fs::write(&left, text.replace("radial-tangential", "equidistant")).unwrap();
        let Calibration::Cameras(file) = calibration_file::open(&left, true).unwrap() else {
            panic!("cameras")
        };
        assert_eq!(file.cameras[0].distortion, Distortion::Equidistant([-0.2, 0.07, 0.0, 0.0]));
        std::fs::write(&left, text.replace("radial-tangential", "fov")).unwrap();
        let error = calibration_file::open(&left, true).unwrap_err().to_string();
        assert!(error.contains("fov") && error.contains("radial-tangential or equidistant"), "{error}");
    }
}
