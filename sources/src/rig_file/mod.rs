//! The rig file: two calibrated cameras, their rectification and calibration quality, with serial number,
//! date and checksum. Also import and export of the calibration formats of other programs.

pub mod calibration;
pub mod data_sets;
mod exchange;
mod values;
mod yaml;

pub use exchange::{Format, import, write as export};

use crate::calibration_text;
use crate::limits::MAX_SIDE_PX;
use crate::{SourceError, toml_text};
use nalgebra::{Matrix3, Rotation3, Vector2, Vector3};
use perception::calibration::{Camera, Crop, Distortion, Pose, Rectification};
use perception::excerpt::{VALUE_CHARS, excerpt};
use perception::rig::Rig;
use serde::{Deserialize, Serialize};
use std::io::Write;
use std::path::Path;

/// Version of the file layout.
const LAYOUT: u32 = 1;
const CHECKSUM: &str = "checksum = \"";

/// A calibrated pair of cameras.
#[derive(Clone, Debug, PartialEq)]
pub struct RigFile {
    /// Name of this pair of cameras.
    pub serial: String,
    /// Calibration date: year-month-day, and time in UTC.
    pub date: String,
    /// Left and right camera.
    pub cameras: [Camera; 2],
    /// Transform from the left to the right camera's coordinates.
    pub between: Pose,
    /// Rectification of both cameras.
    pub rectification: Rectification,
    /// Calibration quality, where known.
    pub quality: Option<Quality>,
}

/// Quality of a calibration.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Quality {
    /// `good`, `usable` or `redo`.
    pub verdict: String,
    /// Pairs of images that were used.
    pub pairs_used: usize,
    /// Root mean square reprojection error, in pixels.
    pub rms_px: f64,
    /// Mean vertical error of rectified corners, in pixels.
    pub vertical_mean_px: f64,
    /// The same on views that took no part in the calibration.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub vertical_heldout_px: Option<f64>,
    /// Standard deviation of the baseline, in metres.
    pub baseline_sigma_m: f64,
    /// Standard deviation of the disparity of distant objects, in pixels.
    pub disparity_sigma_px: f64,
    /// Standard deviations of fx, fy, cx, cy, k1, k2, p1, p2, k3, k4, k5, k6 of the left camera; of a fisheye lens fx, fy, cx, cy,
    /// k1, k2, k3, k4, and zeros.
    pub left_sigma: [f64; 12],
    /// The same of the right camera.
    pub right_sigma: [f64; 12],
}

/// Structure of the file. `focal_px`, `baseline_m`, `cx_px` and `cy_px` have the names of a plain rig TOML.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Document {
    layout: u32,
    serial: String,
    date: String,
    width: usize,
    height: usize,
    focal_px: f64,
    baseline_m: f64,
    cx_px: f64,
    cy_px: f64,
    /// x, y, width and height of the area valid in both rectified images.
    valid: [usize; 4],
    left: CameraTable,
    right: CameraTable,
    between: BetweenTable,
    #[serde(skip_serializing_if = "Option::is_none")]
    quality: Option<Quality>,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct CameraTable {
    fx_px: f64,
    fy_px: f64,
    cx_px: f64,
    cy_px: f64,
    /// Absent for the Brown–Conrady model.
    #[serde(default, skip_serializing_if = "DistortionModel::is_brown_conrady")]
    distortion_model: DistortionModel,
    /// k1, k2, p1, p2, k3, k4, k5, k6; of the equidistant model k1, k2, k3, k4.
    distortion: Vec<f64>,
    /// Rotation from the camera's to the rectified coordinates, row-major.
    rectifying_rotation: [[f64; 3]; 3],
}

#[derive(Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
enum DistortionModel {
    #[default]
    BrownConrady,
    Equidistant,
}

impl DistortionModel {
    fn is_brown_conrady(&self) -> bool {
        *self == Self::BrownConrady
    }

    fn of(distortion: &Distortion) -> Self {
        match distortion {
            Distortion::BrownConrady(_) => Self::BrownConrady,
            Distortion::Equidistant(_) => Self::Equidistant,
        }
    }

    /// The distortion with these coefficients; `camera` is its name in the error.
    fn with(self, coefficients: &[f64], camera: &str) -> Result<Distortion, String> {
        let count = coefficients.len();
        let wrong = |expected: usize| format!("{camera}.distortion has {count} numbers, not {expected}");
        match self {
            Self::BrownConrady => coefficients.try_into().map(Distortion::BrownConrady).map_err(|_| wrong(8)),
            Self::Equidistant => coefficients.try_into().map(Distortion::Equidistant).map_err(|_| wrong(4)),
        }
    }
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct BetweenTable {
    /// Rotation from the left to the right camera's coordinates, row-major.
    rotation: [[f64; 3]; 3],
    translation_m: [f64; 3],
}

fn rows(r: &Rotation3<f64>) -> [[f64; 3]; 3] {
    let m = r.matrix();
    [0, 1, 2].map(|i| [m[(i, 0)], m[(i, 1)], m[(i, 2)]])
}

/// Checks that the rows form a rotation matrix; `what` names it in the error.
fn rotation(rows: &[[f64; 3]; 3], what: &str) -> Result<Rotation3<f64>, String> {
    let m = Matrix3::from_fn(|i, j| rows[i][j]);
    let off = (m * m.transpose() - Matrix3::identity()).norm();
    if !off.is_finite() || off > 1e-4 || m.determinant() < 0.0 {
        return Err(format!(
            "{what} is not a rotation matrix (its rows are not perpendicular and of length 1)"
        ));
    }
    Ok(Rotation3::from_matrix_eps(&m, 1e-15, 50, Rotation3::from_matrix_unchecked(m)))
}

/// 64-bit FNV-1a: detects accidental changes, not forgery.
fn checksum(text: &str) -> String {
    let hash = text
        .bytes()
        .fold(0xcbf2_9ce4_8422_2325_u64, |h, b| (h ^ u64::from(b)).wrapping_mul(0x0000_0100_0000_01b3));
    format!("{hash:016x}")
}

impl RigFile {
    /// Image width and height, in pixels.
    pub fn size(&self) -> (usize, usize) {
        self.rectification.size
    }

    /// Checks that pictures have the size with which the cameras were calibrated.
    ///
    /// # Errors
    /// Names both sizes and the remedy.
    pub fn check_size(&self, (width, height): (usize, usize)) -> Result<(), String> {
        let (w, h) = self.size();
        if (w, h) == (width, height) {
            return Ok(());
        }
        Err(format!(
            "calibrated with images of {w}x{h} pixels, the source has {width}x{height}: calibrate at that size, or name the \
             rig of these images with --rig or source.rig (the size of cameras is camera.width and camera.height)"
        ))
    }

    /// Largest distance by which rectification moves a pixel of either camera, in pixels, over a grid; infinite where
    /// it is not defined.
    pub fn rectification_px(&self) -> f64 {
        /// Positions along a side.
        const GRID: usize = 9;
        let (width, height) = self.size();
        let mut largest: f64 = 0.0;
        for at in 0..2 * GRID * GRID {
            let (side, i, j) = (at % 2, at / 2 % GRID, at / 2 / GRID);
            let along = |i: usize, length: usize| (i * (length - 1)) as f64 / (GRID - 1) as f64;
            let pixel = Vector2::new(along(i, width.max(1)), along(j, height.max(1)));
            let from = self.rectification.source(&self.cameras, side, pixel);
            largest = largest.max(from.map_or(f64::INFINITY, |from| (from - pixel).norm()));
        }
        largest
    }

    /// A rig from cameras that another program calibrated; the rectification is computed here.
    ///
    /// # Errors
    /// When the cameras cannot be rectified.
    pub fn from_cameras(
        cameras: [Camera; 2],
        between: Pose,
        size: (usize, usize),
        crop: Crop,
    ) -> Result<Self, String> {
        let rectification = Rectification::new(&cameras, &between, size, crop).map_err(|e| e.to_string())?;
        Ok(Self {
            serial: String::new(),
            date: String::new(),
            cameras,
            between,
            rectification,
            quality: None,
        })
    }

    /// The TOML text of the file.
    ///
    /// # Errors
    /// When a number cannot be represented.
    pub fn to_toml(&self) -> Result<String, String> {
        let r = &self.rectification;
        let camera = |side: usize| {
            let c = &self.cameras[side];
            CameraTable {
                fx_px: c.fx_px,
                fy_px: c.fy_px,
                cx_px: c.cx_px,
                cy_px: c.cy_px,
                distortion_model: DistortionModel::of(&c.distortion),
                distortion: c.distortion.coefficients().to_vec(),
                rectifying_rotation: rows(&r.turns[side]),
            }
        };
        let document = Document {
            layout: LAYOUT,
            serial: self.serial.clone(),
            date: self.date.clone(),
            width: r.size.0,
            height: r.size.1,
            focal_px: r.rig.focal_px,
            baseline_m: r.rig.baseline_m,
            cx_px: r.rig.cx_px,
            cy_px: r.rig.cy_px,
            valid: r.valid,
            left: camera(0),
            right: camera(1),
            between: BetweenTable {
                rotation: rows(&self.between.rotation),
                translation_m: self.between.translation_m.into(),
            },
            quality: self.quality.clone(),
        };
        let body = toml::to_string(&document).map_err(|e| e.to_string())?;
        let header = format!(
            "# A calibrated pair of cameras. Distance in m = focal_px x baseline_m / disparity in px\n\
             # = {:.6} / disparity, in rectified pixels.\n",
            r.rig.focal_px * r.rig.baseline_m
        );
        let text = header + &body;
        let sum = checksum(&text);
        Ok(format!("{text}\n# Of all bytes above this comment and its empty line.\n# {CHECKSUM}{sum}\"\n"))
    }

    /// Parses the TOML text of a rig file.
    ///
    /// # Errors
    /// Names the line or key, and the expected content.
    pub fn from_toml(text: &str) -> Result<Self, String> {
        if let Some(at) = text.rfind(CHECKSUM) {
            // A line without its quotation mark must not be repeated as a whole.
            let stated: String =
                text[at + CHECKSUM.len()..].chars().take_while(|c| *c != '"').take(VALUE_CHARS).collect();
            let stated = excerpt(&stated, VALUE_CHARS);
            let body = text[..at].rfind("\n\n#").map_or("", |end| &text[..=end]);
            let body = body.strip_suffix('\n').map_or(body, |b| if b.ends_with('\n') { b } else { body });
            if checksum(body) != stated {
                return Err(format!(
                    "the checksum is {}, not {stated}: the file was changed or damaged; restore it, or delete \
                     the checksum's line if the change is meant",
                    checksum(body)
                ));
            }
        }
        let d: Document = toml_text::parse(text)
            .map_err(|e| format!("{e}: give a rig file of lookout calibrate or lookout rig"))?;
        if d.layout != LAYOUT {
            return Err(format!("layout = {}: this program reads layout {LAYOUT}", d.layout));
        }
        let rig = Rig { focal_px: d.focal_px, baseline_m: d.baseline_m, cx_px: d.cx_px, cy_px: d.cy_px };
        let rig = rig.checked().map_err(|e| e.to_string())?;
        let [x, y, w, h] = d.valid;
        let fits = |at: usize, length: usize, whole: usize| {
            length > 0 && at.checked_add(length).is_some_and(|end| end <= whole)
        };
        let max_px = MAX_SIDE_PX as usize;
        if d.width > max_px || d.height > max_px || !fits(x, w, d.width) || !fits(y, h, d.height) {
            return Err(format!("valid = {:?} does not lie in {}x{} pixels", d.valid, d.width, d.height));
        }
        let camera = |t: &CameraTable, name: &str| -> Result<Camera, String> {
            let c = Camera {
                fx_px: t.fx_px,
                fy_px: t.fy_px,
                cx_px: t.cx_px,
                cy_px: t.cy_px,
                distortion: t.distortion_model.with(&t.distortion, name)?,
            };
            check_camera(&c, name)?;
            Ok(c)
        };
        let turns = [
            rotation(&d.left.rectifying_rotation, "left.rectifying_rotation")?,
            rotation(&d.right.rectifying_rotation, "right.rectifying_rotation")?,
        ];
        Ok(Self {
            serial: d.serial,
            date: d.date,
            cameras: [camera(&d.left, "left")?, camera(&d.right, "right")?],
            between: Pose {
                rotation: rotation(&d.between.rotation, "between.rotation")?,
                translation_m: Vector3::from(d.between.translation_m),
            },
            rectification: Rectification { turns, rig, size: (d.width, d.height), valid: d.valid },
            quality: d.quality,
        })
    }

    /// Reads a rig file.
    ///
    /// # Errors
    /// Names the file, the line or key, and the expected content.
    pub fn read(path: &Path) -> Result<Self, SourceError> {
        let text = calibration_text::read(path)?;
        Self::from_toml(&text).map_err(|reason| SourceError::Calibration { path: path.to_owned(), reason })
    }

    /// Writes the file atomically: the previous one stays until the new one is on disk.
    ///
    /// # Errors
    /// When it cannot be written.
    pub fn write(&self, path: &Path) -> Result<(), SourceError> {
        let fail = |reason: String| SourceError::Calibration { path: path.to_owned(), reason };
        write_atomically(path, &self.to_toml().map_err(fail)?)
    }
}

/// Checks the plausibility of a camera's parameters.
fn check_camera(camera: &Camera, name: &str) -> Result<(), String> {
    let focal = 1.0..1e6;
    if !focal.contains(&camera.fx_px) || !focal.contains(&camera.fy_px) {
        return Err(format!(
            "{name}: focal lengths of {} and {} px: give them in pixels, above 1",
            camera.fx_px, camera.fy_px
        ));
    }
    if camera.parameters().iter().any(|v| !v.is_finite() || v.abs() > 1e6) {
        return Err(format!("{name}: a parameter is not finite or far too large"));
    }
    Ok(())
}

/// Writes a text file atomically.
fn write_atomically(path: &Path, text: &str) -> Result<(), SourceError> {
    let io = |source| SourceError::Io { path: path.to_owned(), source };
    let mut name = path.file_name().unwrap_or_default().to_owned();
    name.push(".part");
    let part = path.with_file_name(name);
    let write = || -> std::io::Result<()> {
        let mut file = std::fs::File::create(&part)?;
        file.write_all(text.as_bytes())?;
        file.sync_all()?;
        std::fs::rename(&part, path)
    };
    write().map_err(|error| {
        let _ = std::fs::remove_file(&part);
        io(error)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    pub fn example() -> RigFile {
        let left = Camera {
            distortion: Distortion::BrownConrady([0.1153, -0.2117, -0.00058, -0.00266, 0.0, 0.0, 0.0, 0.0]),
            ..Camera::pinhole(463.104, 462.77, 314.812, 187.324)
        };
        let right = Camera { cx_px: 326.946, cy_px: 179.417, ..left };
        let between = Pose {
            rotation: Rotation3::new(Vector3::new(0.00741, 0.02216, 0.00964)),
            translation_m: Vector3::new(-0.094054, -0.00092, 0.002549),
        };
        let mut rig = RigFile::from_cameras([left, right], between, (640, 360), Crop::Valid).unwrap();
        rig.serial = "bench 7".into();
        rig.date = "2026-03-01 12:00:00".into();
        rig.quality = Some(Quality {
            verdict: "good".into(),
            pairs_used: 29,
            rms_px: 0.2,
            vertical_mean_px: 0.15,
            vertical_heldout_px: Some(0.19),
            baseline_sigma_m: 0.0003,
            disparity_sigma_px: 0.4,
            left_sigma: [0.1; 12],
            right_sigma: [0.2; 12],
        });
        rig
    }

    #[test]
    fn a_rig_is_read_as_it_was_written() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("rig.toml");
        let rig = example();
        rig.write(&path).unwrap();
        let back = RigFile::read(&path).unwrap();
        assert_eq!(back.cameras, rig.cameras);
        assert_eq!(back.quality, rig.quality);
        assert_eq!(back.rectification.rig, rig.rectification.rig);
        assert!((back.rectification.matrix(1) - rig.rectification.matrix(1)).norm() < 1e-14);
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1, "a temporary file is left");
        // Also readable as a plain rig TOML.
        let plain = crate::calibration_file::read(&path, false).unwrap();
        assert_eq!(plain, rig.rectification.rig);
    }

    #[test]
    fn fisheye_lenses_are_kept() {
        let mut rig = example();
        rig.cameras[1].distortion = Distortion::Equidistant([0.02, -0.01, 0.003, -0.0004]);
        let back = RigFile::from_toml(&rig.to_toml().unwrap()).unwrap();
        assert_eq!(back.cameras, rig.cameras);
    }

    #[test]
    fn changed_and_broken_files_are_refused() {
        let text = example().to_toml().unwrap();
        let error = RigFile::from_toml(&text.replace("463.104", "463.204")).unwrap_err();
        assert!(error.contains("checksum"), "{error}");
        let open: String =
            text.lines().filter(|l| !l.contains("checksum")).map(|l| format!("{l}\n")).collect();
        assert!(RigFile::from_toml(&open.replace("463.104", "463.204")).is_ok());
        for (from, to, expected) in [
            ("layout = 1", "layout = 9", "layout 1"),
            ("463.104", "-463.104", "focal"),
            ("463.104", "nan", "focal"),
            ("baseline_m = 0.09", "baseline_m = -0.09", "swapped"),
            ("width = 640", "width = 64", "does not lie"),
            ("[left]", "[links]", "links"),
            ("rotation = [[", "rotation = [[9", "not a rotation"),
            ("distortion = [", "distortion = [0.5, ", "left.distortion has 9 numbers, not 8"),
            ("distortion = [", "distortion_model = \"equidistant\"\ndistortion = [", "has 8 numbers, not 4"),
            ("distortion = [", "distortion_model = \"fov\"\ndistortion = [", "fov"),
        ] {
            let error = RigFile::from_toml(&open.replacen(from, to, 1)).unwrap_err();
            assert!(error.contains(expected), "{from}: {error}");
        }
        for cut in 0..text.len() {
            // No truncated file causes a panic.
            let _ = RigFile::from_toml(&text[..cut]);
        }
    }

    #[test]
    fn a_good_rig_survives_a_failed_write() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("rig.toml");
        example().write(&path).unwrap();
        let before = std::fs::read(&path).unwrap();
        // The temporary file cannot be created where a folder has its name.
        std::fs::create_dir(folder.path().join("rig.toml.part")).unwrap();
        assert!(example().write(&path).is_err());
        assert_eq!(std::fs::read(&path).unwrap(), before);
    }
}
