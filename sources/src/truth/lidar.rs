//! Images with LiDAR depth: stereo pairs, or left images only, some with labels.

use super::error::TruthError;
use super::find;
use super::map_file::{self, DisparityMap};
use std::path::{Path, PathBuf};

/// The layout that [`frames`] reads, for messages.
pub const LAYOUT: &str = "folders left, calib and gt_depth_map or gt_depth, and right or labels or both, with files of equal names";

/// An image with LiDAR depth; files are read on demand.
#[derive(Clone, Debug, PartialEq)]
pub struct LidarFrame {
    /// Name within the data set.
    pub name: String,
    /// Left image.
    pub left: PathBuf,
    /// Right image, where there is one.
    pub right: Option<PathBuf>,
    /// Depth map: 16-bit PNG, metres × 256, 0 = unknown.
    pub depth: PathBuf,
    /// KITTI calibration.
    pub calibration: PathBuf,
    /// Labels, where there are any.
    pub labels: Option<PathBuf>,
}

impl LidarFrame {
    /// Depth in metres, −1 = unknown.
    ///
    /// # Errors
    /// When the file cannot be read.
    pub fn depth_m(&self) -> Result<DisparityMap, TruthError> {
        map_file::read(&self.depth, 256.0)
    }
}

/// The images of a folder, sorted by name.
///
/// # Errors
/// When the folder has another layout, or an image lacks one of the files.
pub fn frames(root: &Path) -> Result<Vec<LidarFrame>, TruthError> {
    let folder = |names: &[&str]| names.iter().map(|name| root.join(name)).find(|path| path.is_dir());
    let none = || TruthError::Map {
        path: root.to_owned(),
        reason: format!("no LiDAR depth here: expected {LAYOUT}"),
    };
    let (Some(left), Some(depth), Some(calibration)) =
        (folder(&["left"]), folder(&["gt_depth_map", "gt_depth"]), folder(&["calib"]))
    else {
        return Err(none());
    };
    let (right, labels) = (folder(&["right"]), folder(&["labels"]));
    if right.is_none() && labels.is_none() {
        return Err(none());
    }
    let there = |path: PathBuf| {
        let reason = || "is missing, but its depth map exists: add it, or remove the depth map".to_owned();
        if path.is_file() { Ok(path) } else { Err(TruthError::Map { reason: reason(), path }) }
    };
    let mut found = Vec::new();
    for depth in find::pictures(&depth)? {
        let file = Path::new(depth.file_name().unwrap_or_default()).to_owned();
        found.push(LidarFrame {
            name: file.with_extension("").to_string_lossy().into_owned(),
            left: there(left.join(&file))?,
            right: right.as_ref().map(|folder| there(folder.join(&file))).transpose()?,
            calibration: there(calibration.join(file.with_extension("txt")))?,
            labels: labels
                .as_ref()
                .map(|folder| there(folder.join(file.with_extension("txt"))))
                .transpose()?,
            depth,
        });
    }
    if found.is_empty() { Err(none()) } else { Ok(found) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;

    fn set(files: &[&str]) -> tempfile::TempDir {
        let root = tempfile::tempdir().unwrap();
        for file in files {
            let path = root.path().join(file);
            fs::create_dir_all(path.parent().unwrap()).unwrap();
            fs::write(path, "").unwrap();
        }
        root
    }

    #[test]
    fn pairs_and_labelled_pictures_are_told_apart() {
        let pairs = set(&["left/1.png", "right/1.png", "gt_depth_map/1.png", "calib/1.txt", "left/9.png"]);
        let found = frames(pairs.path()).unwrap();
        assert_eq!((found.len(), &found[0].name[..], &found[0].labels), (1, "1", &None));
        assert_eq!(found[0].right.as_deref(), Some(pairs.path().join("right/1.png").as_path()));
        let cars = set(&["left/2.png", "gt_depth/2.png", "calib/2.txt", "labels/2.txt"]);
        let found = frames(cars.path()).unwrap();
        assert_eq!((&found[0].right, found[0].labels.is_some()), (&None, true));
    }

    #[test]
    fn what_is_missing_is_named() {
        let message = |files: &[&str]| frames(set(files).path()).unwrap_err().to_string();
        assert!(message(&["left/1.png"]).contains("no LiDAR depth here: expected folders left"));
        let text = message(&["left/1.png", "gt_depth/1.png", "calib/1.txt"]);
        assert!(text.contains("right or labels"), "{text}");
        let text = message(&["left/1.png", "gt_depth/1.png", "calib/2.txt", "labels/1.txt"]);
        assert!(text.contains("calib/1.txt: is missing"), "{text}");
    }
}
