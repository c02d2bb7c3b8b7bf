//! Whether a rig that does not say the size of its pictures can be that of the source.

use super::error::InputError;
use perception::rig::Rig;
use sources::calibration_file;
use std::path::Path;

/// Largest distance of a principal point from the middle of the pictures that goes unmentioned, as a share of their width
/// and height. KITTI's rectified cameras have 0.04. Rows are often cropped, so less is concluded from them.
const MAX_OFF_MIDDLE: (f64, f64) = (0.125, 0.25);

/// Largest difference of width or height from the pictures beside a calibration that goes unmentioned, as a share. The
/// drives of KITTI differ by 0.02.
const MAX_SIZE_DIFFERENCE: f64 = 0.05;

/// Checks the principal point of a rig, and tells what is doubtful. `name` is what the rig is called.
///
/// # Errors
/// If it lies outside of the pictures.
pub fn check(rig: &Rig, size: (usize, usize), name: &str) -> Result<(), InputError> {
    let (width, height) = (size.0 as f64, size.1 as f64);
    let is_inside = |at: f64, length: f64| at > 0.0 && at < length;
    if !is_inside(rig.cx_px, width) || !is_inside(rig.cy_px, height) {
        return Err(InputError::OtherSize { name: name.to_owned(), rig: *rig, size });
    }
    let off = |at: f64, length: f64| (at / length - 0.5).abs();
    if off(rig.cx_px, width) > MAX_OFF_MIDDLE.0 || off(rig.cy_px, height) > MAX_OFF_MIDDLE.1 {
        tracing::warn!(
            "{name}: its principal point, column {:.0} of row {:.0}, is far from the middle of the pictures of \
             {width}x{height} pixels: if it is for pictures of another size, distances are wrong: give the rig of these with \
             --rig or source.rig",
            rig.cx_px,
            rig.cy_px
        );
    }
    Ok(())
}

/// Tells if pictures of quite another size lie beside a named calibration that does not say its size.
pub fn tell_pictures_beside(path: &Path, (width, height): (usize, usize)) {
    let Some((picture, (w, h))) = calibration_file::pictures_beside(path) else { return };
    let differs = |a: usize, b: usize| a.abs_diff(b) as f64 > MAX_SIZE_DIFFERENCE * b as f64;
    if differs(width, w) || differs(height, h) {
        tracing::warn!(
            "{}: beside it are pictures of {w}x{h} pixels ({}), but the source has {width}x{height}: if it is for those, \
             distances are wrong: give the rig of these with --rig or source.rig",
            path.display(),
            picture.display()
        );
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_principal_point_outside_of_the_pictures_is_refused() {
        let rig = |cx_px: f64, cy_px: f64| Rig { focal_px: 700.0, baseline_m: 0.5, cx_px, cy_px };
        for (cx_px, cy_px, is_right) in [
            (609.0, 172.0, true),
            (400.0, 172.0, true),
            (1242.0, 172.0, false),
            (609.0, -3.0, false),
            (609.0, 400.0, false),
        ] {
            let result = check(&rig(cx_px, cy_px), (1242, 375), "calib.txt");
            assert_eq!(result.is_ok(), is_right, "{cx_px}, {cy_px}");
        }
        let error = check(&rig(640.0, 360.0), (640, 360), "calib.txt").unwrap_err().to_string();
        assert!(
            error.contains("calib.txt") && error.contains("640x360") && error.contains("--rig"),
            "{error}"
        );
    }
}
