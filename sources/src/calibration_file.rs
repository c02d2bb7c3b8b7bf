//! Reads the rig of a rectified source: KITTI `calib.txt` or rig TOML.

pub use crate::calibration_text::KITTI_RAW;
pub use crate::rig_file::calibration::Calibration;

use crate::{SourceError, calibration_text, pairs, picture, rig_file, toml_text};
use perception::calibration::Crop;
use perception::excerpt::{VALUE_CHARS, excerpt};
use perception::rig::Rig;
use serde::Deserialize;
use std::path::{Path, PathBuf};

/// What a rig TOML has to hold.
const PLAIN_RIG: &str =
    "give focal_px, baseline_m, cx_px and cy_px, or a rig file of lookout calibrate or lookout rig";

/// Calibration of a camera of EuRoC.
pub const SENSOR: &str = "sensor.yaml";

/// A rig TOML of an already rectified pair: the fields of [`Rig`], and the size of the pictures if it is to be checked.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct RigFile {
    focal_px: f64,
    baseline_m: f64,
    cx_px: f64,
    cy_px: f64,
    /// Size of the pictures, if the file says it.
    width: Option<usize>,
    height: Option<usize>,
}

impl RigFile {
    /// Checks pictures of a size against the size in the file.
    fn check_size(&self, size: Option<(usize, usize)>) -> Result<(), String> {
        match (self.width, self.height, size) {
            (Some(w), Some(h), Some((width, height))) if (w, h) != (width, height) => Err(format!(
                "for pictures of {w}x{h} pixels (width, height), the source has {width}x{height}: calibrate at that size, or \
                 name the rig of these pictures"
            )),
            (Some(_), None, _) | (None, Some(_), _) => {
                Err("width or height is missing: give both, or neither".into())
            }
            _ => Ok(()),
        }
    }
}

/// Reads the rig of a calibration, see [`open`].
///
/// # Errors
/// Names the file, the line or key, and the expected content.
pub fn read(path: &Path, colour: bool) -> Result<Rig, SourceError> {
    Ok(open(path, colour)?.rig())
}

/// Reads the rig of a calibration, for pictures of `size`.
///
/// # Errors
/// As [`open`], and if the file is for pictures of another size.
pub fn read_for(path: &Path, colour: bool, size: (usize, usize)) -> Result<Rig, SourceError> {
    let fail = |reason: String| SourceError::Calibration { path: path.to_owned(), reason };
    open_for(path, colour, size)?.rig_for(size).map_err(fail)
}

/// Reads a calibration for pictures of a size that is not known, see [`open_for`].
///
/// # Errors
/// Names the file, the line or key, and the expected content.
pub fn open(path: &Path, colour: bool) -> Result<Calibration, SourceError> {
    open_sized(path, colour, None)
}

/// Reads a calibration for pictures of a size, of which some formats depend, from a TOML file (a rig file, or `focal_px`,
/// `baseline_m`, `cx_px`, `cy_px`, and `width` and `height` if they are to be checked), a YAML file of OpenCV, Kalibr or EuRoC, KITTI's `calib_cam_to_cam.txt`, or, for any
/// other extension, from a KITTI calibration: `P0:` and `P1:`, or `P2:` and `P3:`, 12 numbers each. Lines
/// without names are numbered: line n is Pn. With `colour`, P2 and P3 (KITTI's colour cameras) take
/// precedence where both pairs are present.
///
/// # Errors
/// Names the file, the line or key, and the expected content.
pub fn open_for(path: &Path, colour: bool, size: (usize, usize)) -> Result<Calibration, SourceError> {
    open_sized(path, colour, Some(size))
}

/// See [`open`] and [`open_for`].
pub(crate) fn open_sized(
    path: &Path,
    colour: bool,
    size: Option<(usize, usize)>,
) -> Result<Calibration, SourceError> {
    if path.extension().is_some_and(|e| e == "yaml" || e == "yml") {
        let file = rig_file::import(&[path.to_owned()], size, Crop::Valid)?;
        return Ok(Calibration::Cameras(Box::new(file)));
    }
    let fail = |reason: String| SourceError::Calibration { path: path.to_owned(), reason };
    let text = calibration_text::read(path)?;
    if path.ends_with(KITTI_RAW) {
        return rig_file::data_sets::kitti_raw(&text, colour, size).map_err(fail);
    }
    let (rig, size) = if path.extension().is_some_and(|e| e == "toml") {
        // A full rig file describes the unrectified cameras; its rectified rig is the one of the recordings.
        if text.lines().any(|l| l.trim_start().starts_with("layout")) {
            let file = rig_file::RigFile::from_toml(&text).map_err(fail)?;
            return Ok(Calibration::Cameras(Box::new(file)));
        }
        let file: RigFile = toml_text::parse(&text).map_err(|e| fail(format!("{e}: {PLAIN_RIG}")))?;
        file.check_size(size).map_err(fail)?;
        let rig = Rig {
            focal_px: file.focal_px,
            baseline_m: file.baseline_m,
            cx_px: file.cx_px,
            cy_px: file.cy_px,
        };
        (rig, file.width.zip(file.height))
    } else {
        (kitti(&text, colour).map_err(fail)?, None)
    };
    let rig = rig.checked().map_err(|e| fail(e.to_string()))?;
    Ok(Calibration::Rectified { rig, size })
}

/// The TOML text of a rectified pair: what [`open`] reads.
pub fn plain_toml(rig: &Rig, size: Option<(usize, usize)>) -> String {
    let Rig { focal_px, baseline_m, cx_px, cy_px } = rig;
    let size = size.map_or(String::new(), |(width, height)| format!("width = {width}\nheight = {height}\n"));
    format!(
        "focal_px = {focal_px:?}\nbaseline_m = {baseline_m:?}\ncx_px = {cx_px:?}\ncy_px = {cy_px:?}\n{size}"
    )
}

/// Size of the pictures beside a calibration, with one of them, where there are some.
pub fn pictures_beside(path: &Path) -> Option<(PathBuf, (usize, usize))> {
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let (left, _) = pairs::find(folder).ok()?.pairs.into_iter().next()?;
    let size = picture::header(&left).ok()?.size;
    Some((left, size))
}

fn kitti(text: &str, colour: bool) -> Result<Rig, String> {
    let matrix = |name: &str| -> Result<Option<Vec<f64>>, String> {
        for (i, line) in text.lines().enumerate() {
            let mut words = line.split_ascii_whitespace().peekable();
            let first = words.peek().copied().unwrap_or("");
            // Some copies of the odometry set omit the names: line n is Pn.
            let is_bare = first.parse::<f64>().is_ok() && name[1..] == i.to_string();
            if !is_bare && first.trim_end_matches(':') != name {
                continue;
            }
            let numbers = words
                .skip(usize::from(!is_bare))
                .map(|w| {
                    w.parse().map_err(|_| {
                        format!("line {}: \"{}\" is not a number", i + 1, excerpt(w, VALUE_CHARS))
                    })
                })
                .collect::<Result<Vec<f64>, _>>()?;
            if numbers.len() != 12 {
                return Err(format!(
                    "line {}: {name} has {} numbers, not 12: give the whole matrix",
                    i + 1,
                    numbers.len()
                ));
            }
            return Ok(Some(numbers));
        }
        Ok(None)
    };
    let order = if colour { [("P2", "P3"), ("P0", "P1")] } else { [("P0", "P1"), ("P2", "P3")] };
    for (left, right) in order {
        if let (Some(l), Some(r)) = (matrix(left)?, matrix(right)?) {
            let apart = (l[2] - r[2]).abs().max((l[6] - r[6]).abs()).max((l[0] - r[0]).abs());
            if apart > 0.5 {
                return Err(format!(
                    "{left} and {right} have focal lengths or principal points {apart:.2} px apart: \
                     give the calibration of a rectified pair"
                ));
            }
            // P = [f 0 cx tx; 0 f cy ty; …], tx = −f·(camera position).
            return Ok(Rig { focal_px: l[0], baseline_m: (l[3] - r[3]) / l[0], cx_px: l[2], cy_px: l[6] });
        }
    }
    Err("neither P0: and P1: nor P2: and P3: found; expected a KITTI calib.txt or a rig .toml".into())
}

#[cfg(test)]
mod tests {
    use super::*;

    const KITTI: &str = "P0: 700 0 600 0 0 700 180 0 0 0 1 0\n\
                         P1: 700 0 600 -378 0 700 180 0 0 0 1 0\n\
                         P2: 710 0 601 45 0 710 181 0 0 0 1 0\n\
                         P3: 710 0 601 -339 0 710 181 0 0 0 1 0\n";

    fn read_text(name: &str, text: &str) -> Result<Rig, String> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join(name);
        std::fs::write(&path, text).unwrap();
        read(&path, name.contains("colour")).map_err(|e| e.to_string())
    }

    #[test]
    fn kitti_files_give_the_rig_of_the_camera_pair() {
        let grey = read_text("calib.txt", KITTI).unwrap();
        assert_eq!(grey, Rig { focal_px: 700.0, baseline_m: 0.54, cx_px: 600.0, cy_px: 180.0 });
        let bare: String = KITTI.lines().take(2).map(|l| format!("{}\n", &l[4..])).collect();
        assert_eq!(read_text("calib.txt", &bare).unwrap(), grey);
        let colour = read_text("colour.txt", KITTI).unwrap();
        assert!((colour.baseline_m - 384.0 / 710.0).abs() < 1e-12 && colour.cx_px == 601.0);
    }

    #[test]
    fn a_toml_file_gives_its_rig() {
        let text = "focal_px = 879.0\nbaseline_m = 0.12\ncx_px = 320.0\ncy_px = 240.0\n";
        let rig = read_text("rig.toml", text).unwrap();
        assert_eq!((rig.baseline_m, &plain_toml(&rig, None)[..]), (0.12, text));
        let sized = plain_toml(&rig, Some((640, 480)));
        assert_eq!((read_text("rig.toml", &sized).unwrap(), sized.ends_with("height = 480\n")), (rig, true));
        for (from, to, expected) in [
            ("0.12", "120", "metres"),
            ("0.12", "nan", "metres"),
            ("focal_px", "focal", "unknown field"),
            ("cy_px = 240.0", "", "cy_px"),
        ] {
            let error = read_text("rig.toml", &text.replace(from, to)).unwrap_err();
            assert!(error.contains(expected) && error.contains("rig.toml"), "{error}");
        }
    }

    #[test]
    fn a_size_in_a_plain_rig_is_checked() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("rig.toml");
        let plain = "focal_px = 879.0\nbaseline_m = 0.12\ncx_px = 320.0\ncy_px = 240.0\n";
        std::fs::write(&path, format!("{plain}width = 640\nheight = 480\n")).unwrap();
        assert!(read_for(&path, true, (640, 480)).is_ok());
        assert!(!open(&path, true).unwrap().is_without_size());
        let error = read_for(&path, true, (320, 240)).unwrap_err().to_string();
        assert!(error.contains("640x480") && error.contains("320x240"), "{error}");
        std::fs::write(&path, plain).unwrap();
        assert!(open(&path, true).unwrap().is_without_size());
        std::fs::write(&path, format!("{plain}width = 640\n")).unwrap();
        assert!(read(&path, true).unwrap_err().to_string().contains("give both"));
    }

    #[test]
    fn faults_name_the_line() {
        let error = read_text("calib.txt", &KITTI.replace("-378", "x")).unwrap_err();
        assert!(error.contains("line 2: \"x\" is not a number"), "{error}");
        let error = read_text("calib.txt", &KITTI.replace("-378", "")).unwrap_err();
        assert!(error.contains("line 2: P1 has 11 numbers"), "{error}");
        let error = read_text("calib.txt", &KITTI.replace("0 600 -378", "0 610 -378")).unwrap_err();
        assert!(error.contains("P0 and P1") && error.contains("10.00 px apart"), "{error}");
        assert!(read_text("calib.txt", "").unwrap_err().contains("neither P0"));
        // Swapped cameras give a negative baseline.
        let error = read_text("calib.txt", &KITTI.replace("-378", "378")).unwrap_err();
        assert!(error.contains("swapped"), "{error}");
    }
}
