//! Reads the text of a calibration of any format.

use crate::SourceError;
use crate::bounded_file::read_text;
use crate::limits::CALIBRATION;
use std::io::ErrorKind;
use std::path::Path;

/// Calibration of a day of KITTI's raw drives.
pub const KITTI_RAW: &str = "calib_cam_to_cam.txt";

/// What to do without a file that can be read.
const REMEDY: &str =
    "give a rig file of lookout calibrate, a KITTI calib.txt, or YAML of OpenCV, Kalibr or EuRoC";

/// The text of a calibration of any format.
///
/// # Errors
/// Says what to give instead.
pub fn read(path: &Path) -> Result<String, SourceError> {
    let fail = |reason: String| SourceError::Calibration { path: path.to_owned(), reason };
    if path.is_dir() {
        let known = ["rig.toml", "calib.txt", KITTI_RAW].map(|name| path.join(name));
        return Err(fail(match known.into_iter().find(|file| file.is_file()) {
            Some(file) => format!("a folder: give the file in it, {}", file.display()),
            None => "a folder: give the file of the calibration (rig.toml, calib.txt, or YAML)".into(),
        }));
    }
    read_text(path, &CALIBRATION).map_err(|source| match source.kind() {
        ErrorKind::NotFound => fail(format!("there is no such file: {REMEDY}")),
        ErrorKind::InvalidData => fail(format!("not a text: {REMEDY}")),
        _ => SourceError::Io { path: path.to_owned(), source },
    })
}
