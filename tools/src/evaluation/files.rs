//! Output folders of evaluations, and removal of earlier output.

use crate::reporting::output::OutputError;
use crate::reporting::picture::{PictureError, save_disparity, save_grey};
use serde::Serialize;
use std::fs;
use std::io;
use std::path::{Component, Path, PathBuf};

/// Lists the images written by an evaluation, one per line.
const LIST: &str = "files.txt";

/// The machine-readable report.
const REPORT: &str = "evaluation.json";

fn io_error(path: &Path) -> impl Fn(io::Error) -> OutputError + '_ {
    |source| OutputError::Io { path: path.to_owned(), source }
}

/// Creates the folder and the folders of `pictures` (paths below it), and removes the output of an earlier
/// evaluation: the images in its list and its report, nothing else.
///
/// # Errors
/// When a folder cannot be created or a file cannot be removed.
pub fn prepare(folder: &Path, pictures: &[PathBuf]) -> Result<(), OutputError> {
    fs::create_dir_all(folder).map_err(io_error(folder))?;
    let list = folder.join(LIST);
    let earlier =
        if list.is_file() { fs::read_to_string(&list).map_err(io_error(&list))? } else { String::new() };
    let mine = |name: &&str| {
        let path = Path::new(name);
        path.extension().is_some_and(|e| e == "png")
            && path.components().all(|part| matches!(part, Component::Normal(_)))
    };
    for name in earlier.lines().filter(mine).chain([REPORT]) {
        let path = folder.join(name);
        if path.is_file() {
            fs::remove_file(&path).map_err(io_error(&path))?;
            // An empty ground truth folder would imply that the set has such ground truth. Other folders stay.
            if let Some(parent) = path.parent().filter(|parent| *parent != folder) {
                let _ = fs::remove_dir(parent);
            }
        }
    }
    for path in pictures.iter().filter_map(|path| path.parent()) {
        let path = folder.join(path);
        fs::create_dir_all(&path).map_err(io_error(&path))?;
    }
    let lines: String = pictures.iter().map(|path| format!("{}\n", path.display())).collect();
    fs::write(&list, lines).map_err(io_error(&list))
}

/// Writes the report to a folder created by [`prepare`].
///
/// # Errors
/// When it cannot be written.
pub fn write_report(folder: &Path, report: &impl Serialize) -> Result<(), OutputError> {
    let path = folder.join(REPORT);
    let mut text = serde_json::to_vec_pretty(report).map_err(|e| io_error(&path)(e.into()))?;
    text.push(b'\n');
    fs::write(&path, text).map_err(io_error(&path))
}

/// A pair with ground truth to save in KITTI 2015's layout: one value per pixel each.
#[derive(Clone, Copy, Debug)]
pub struct KittiPair<'a> {
    /// Left image.
    pub left: &'a [u8],
    /// Right image.
    pub right: &'a [u8],
    /// Ground truth in px, not positive where unknown.
    pub truth: &'a [f32],
    /// Mask of all pixels with ground truth, where the set has this region.
    pub all: Option<&'a [bool]>,
    /// Mask of the non-occluded pixels, where the set has this region.
    pub noc: Option<&'a [bool]>,
    /// Width in pixels.
    pub width: usize,
    /// Height in pixels.
    pub height: usize,
}

/// Folders of KITTI 2015's layout: both images, ground truth of all pixels and of the non-occluded ones.
pub const KITTI_FOLDERS: [&str; 4] = ["image_2", "image_3", "disp_occ_0", "disp_noc_0"];

impl KittiPair<'_> {
    /// Writes the images and one map per region to `folder`, which [`prepare`] has created. Maps are rounded to
    /// 1/256 px; values out of the 16-bit range become unknown.
    ///
    /// # Errors
    /// When a file cannot be written.
    pub fn save(&self, folder: &Path, name: &str) -> Result<(), PictureError> {
        let path = |part: &str| folder.join(part).join(format!("{name}.png"));
        let [left, right, all, noc] = KITTI_FOLDERS;
        save_grey(&path(left), self.left, self.width, self.height)?;
        save_grey(&path(right), self.right, self.width, self.height)?;
        for (part, mask) in [(all, self.all), (noc, self.noc)] {
            if let Some(mask) = mask {
                let steps = |(&d, &m): (&f32, &bool)| if m { steps(d) } else { 0 };
                let map: Vec<u16> = self.truth.iter().zip(mask).map(steps).collect();
                save_disparity(&path(part), &map, self.width, self.height)?;
            }
        }
        Ok(())
    }
}

/// A disparity in 1/256 px; 0 where it is unknown or out of range.
fn steps(px: f32) -> u16 {
    let steps = (px * 256.0).round();
    if px > 0.0 && steps <= 65_535.0 { steps.max(1.0) as u16 } else { 0 }
}

#[cfg(test)]
mod tests {
    use super::super::report::StereoReport;
    use super::*;

    #[test]
    fn a_new_evaluation_removes_the_pictures_of_the_old_one_and_nothing_else() {
        let root = tempfile::tempdir().unwrap();
        let out = root.path().join("a/out");
        let picture = PathBuf::from("set/errors/1.png");
        prepare(&out, std::slice::from_ref(&picture)).unwrap();
        for name in ["set/errors/1.png", "set/errors/mine.png", "mine.txt"] {
            fs::write(out.join(name), "x").unwrap();
        }
        fs::write(root.path().join("a/kept.png"), "x").unwrap();
        write_report(&out, &StereoReport::default()).unwrap();
        // A manipulated list cannot remove files outside the folder, nor unlisted ones.
        let list = fs::read_to_string(out.join(LIST)).unwrap();
        assert_eq!(list, "set/errors/1.png\n");
        let outside = root.path().join("a/kept.png");
        fs::write(out.join(LIST), format!("{list}../kept.png\n{}\nmine.txt\n", outside.display())).unwrap();
        prepare(&out, &[PathBuf::from("set/errors/2.png")]).unwrap();
        assert!(!out.join("set/errors/1.png").exists() && !out.join(REPORT).exists());
        assert!(out.join("set/errors/mine.png").exists() && out.join("mine.txt").exists());
        assert!(outside.exists());
        let error = prepare(&out.join("mine.txt"), &[]).unwrap_err().to_string();
        assert!(error.contains("mine.txt"), "{error}");
    }

    #[test]
    fn a_saved_pair_is_one_of_kitti() {
        let folder = tempfile::tempdir().unwrap();
        let files: Vec<PathBuf> = KITTI_FOLDERS.iter().map(|part| Path::new(part).join("7.png")).collect();
        prepare(folder.path(), &files).unwrap();
        let truth = [10.0, 300.0, -1.0, 0.001];
        let (all, noc) = ([true, true, false, true], [true, false, false, false]);
        let pair = KittiPair {
            left: &[1, 2, 3, 4],
            right: &[5, 6, 7, 8],
            truth: &truth,
            all: Some(&all),
            noc: Some(&noc),
            width: 2,
            height: 2,
        };
        pair.save(folder.path(), "7").unwrap();
        let map = |part: &str| image::open(folder.path().join(part).join("7.png")).unwrap();
        assert_eq!(map("disp_occ_0").into_luma16().into_raw(), [2560, 0, 0, 1]);
        assert_eq!(map("disp_noc_0").into_luma16().into_raw(), [2560, 0, 0, 0]);
        assert_eq!(map("image_3").into_luma8().into_raw(), [5, 6, 7, 8]);
    }
}
