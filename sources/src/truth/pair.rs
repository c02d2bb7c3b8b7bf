//! A stereo pair with ground truth, and the reader of its maps.

use super::error::TruthError;
use super::map_file::{self, DisparityMap};
use crate::calibration_file;
use crate::folder::read_grey;
use std::path::{Path, PathBuf};

/// Set of evaluated pixels.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Region {
    /// All pixels with ground truth (KITTI: Out-All).
    All,
    /// Those of them that are not occluded in the right image (KITTI: Out-Noc).
    Noc,
}

impl Region {
    /// Name in tables.
    pub fn name(self) -> &'static str {
        match self {
            Self::All => "all",
            Self::Noc => "noc",
        }
    }
}

/// A pair of a data set; files are read on demand.
#[derive(Clone, Debug, PartialEq)]
pub struct TruthPair {
    /// Name within the data set, usable as a file name.
    pub name: String,
    /// Left image.
    pub left: PathBuf,
    /// Right image, rectified with the left one.
    pub right: PathBuf,
    /// Ground truth files.
    pub files: TruthFiles,
}

/// Files with the ground truth of a pair.
#[derive(Clone, Debug, PartialEq)]
pub enum TruthFiles {
    /// KITTI's maps, 16-bit PNG, disparity × 256; at least one of them.
    Kitti {
        /// Map of all pixels.
        all: Option<PathBuf>,
        /// Map of the non-occluded pixels.
        noc: Option<PathBuf>,
    },
    /// One folder per scene, as in Middlebury.
    Scene {
        /// Disparity map of the left image.
        map: PathBuf,
        /// Image that is 255 where the pixel is not occluded.
        mask: Option<PathBuf>,
        /// Disparity map of the right image: a pixel is not occluded where both agree.
        right_map: Option<PathBuf>,
        /// Stored value per pixel of disparity; `None`: derived from the height of the map.
        scale: Option<f64>,
    },
    /// Depth, 16-bit PNG, metres × 256, and the KITTI calibration that converts it to disparity.
    Depth {
        /// Depth map.
        depth: PathBuf,
        /// Calibration.
        calibration: PathBuf,
    },
}

/// Ground truth of a pair: maps of `width` × `height`, row-major.
#[derive(Clone, Debug, PartialEq)]
pub struct Truth {
    /// Width in pixels.
    pub width: usize,
    /// Height in pixels.
    pub height: usize,
    /// Disparity of the left image in px; −1 = unknown.
    pub disparity_px: Vec<f32>,
    /// The evaluation masks of the data set; never empty.
    pub regions: Vec<(Region, Vec<bool>)>,
}

impl Truth {
    /// Mask of a region.
    pub fn region(&self, region: Region) -> Option<&[bool]> {
        self.regions.iter().find(|(r, _)| *r == region).map(|(_, mask)| mask.as_slice())
    }

    /// Mask of the non-occluded pixels, or of all where the set does not distinguish them.
    pub fn visible(&self) -> &[bool] {
        self.region(Region::Noc).or_else(|| self.region(Region::All)).unwrap_or(&[])
    }
}

impl TruthPair {
    /// The file with the ground truth; the first where there are several.
    pub fn truth_file(&self) -> &Path {
        match &self.files {
            TruthFiles::Kitti { all: Some(path), .. } | TruthFiles::Kitti { noc: Some(path), .. } => path,
            TruthFiles::Kitti { all: None, noc: None } => &self.left,
            TruthFiles::Scene { map, .. } => map,
            TruthFiles::Depth { depth, .. } => depth,
        }
    }

    /// The regions that [`Self::truth`] returns.
    pub fn regions(&self) -> Vec<Region> {
        let (all, noc) = match &self.files {
            TruthFiles::Kitti { all, noc } => (all.is_some(), noc.is_some()),
            TruthFiles::Scene { mask, right_map, .. } => (true, mask.is_some() || right_map.is_some()),
            TruthFiles::Depth { .. } => (true, false),
        };
        let regions = [(Region::All, all), (Region::Noc, noc)];
        regions.into_iter().filter(|(_, there)| *there).map(|(region, _)| region).collect()
    }

    /// Reads the ground truth and its regions.
    ///
    /// # Errors
    /// Names the faulty file.
    pub fn truth(&self) -> Result<Truth, TruthError> {
        match &self.files {
            TruthFiles::Kitti { all, noc } => self.kitti(all.as_deref(), noc.as_deref()),
            TruthFiles::Scene { map, mask, right_map, scale } => {
                scene(map, mask.as_deref(), right_map.as_deref(), *scale)
            }
            TruthFiles::Depth { depth, calibration } => from_depth(depth, calibration),
        }
    }

    fn kitti(&self, all: Option<&Path>, noc: Option<&Path>) -> Result<Truth, TruthError> {
        let read = |path: Option<&Path>| path.map(|p| map_file::read(p, 256.0)).transpose();
        let (all_map, noc_map) = (read(all)?, read(noc)?);
        let mut regions = Vec::new();
        if let Some(map) = &all_map {
            regions.push((Region::All, map.known()));
        }
        if let Some(map) = &noc_map {
            if let (Some(whole), Some(path)) = (&all_map, noc) {
                same_size(map, path, whole, self.truth_file())?;
            }
            regions.push((Region::Noc, map.known()));
        }
        let Some(map) = all_map.or(noc_map) else {
            return Err(TruthError::NoPairs { path: self.left.clone() });
        };
        Ok(Truth { width: map.width, height: map.height, disparity_px: map.px, regions })
    }
}

fn same_size(map: &DisparityMap, path: &Path, whole: &DisparityMap, other: &Path) -> Result<(), TruthError> {
    let (size, expected) = ((map.width, map.height), (whole.width, whole.height));
    if size == expected {
        return Ok(());
    }
    Err(TruthError::Size { path: path.to_owned(), size, other: other.to_owned(), expected })
}

fn scene(
    path: &Path,
    mask: Option<&Path>,
    right_map: Option<&Path>,
    scale: Option<f64>,
) -> Result<Truth, TruthError> {
    let mut map = map_file::read(path, scale.unwrap_or(1.0))?;
    // Middlebury 2005 and 2006 store full-size disparities in maps of half and a third of the size.
    let scale = scale.unwrap_or_else(|| {
        let divisor: u8 = match map.height {
            901.. => 1,
            451.. => 2,
            _ => 3,
        };
        map.px.iter_mut().filter(|d| **d > 0.0).for_each(|d| *d /= f32::from(divisor));
        f64::from(divisor)
    });
    let mut regions = vec![(Region::All, map.known())];
    if let Some(mask_path) = mask {
        let (pixels, width, height) = read_grey(mask_path)?;
        let picture = DisparityMap { px: Vec::new(), width, height };
        same_size(&picture, mask_path, &map, path)?;
        let noc = map.px.iter().zip(&pixels).map(|(&d, &m)| d > 0.0 && m == 255).collect();
        regions.push((Region::Noc, noc));
    } else if let Some(right_path) = right_map {
        let right = map_file::read(right_path, scale)?;
        same_size(&right, right_path, &map, path)?;
        regions.push((Region::Noc, agreement(&map, &right)));
    }
    Ok(Truth { width: map.width, height: map.height, disparity_px: map.px, regions })
}

/// Left-right check: pixels whose corresponding right pixel has a disparity within 1 px of theirs. Both maps
/// have the same size.
fn agreement(left: &DisparityMap, right: &DisparityMap) -> Vec<bool> {
    let seen = |i: usize| {
        let d = left.px[i];
        let x = (i % left.width) as i64 - d.round_ties_even() as i64;
        d > 0.0 && x >= 0 && (right.px[i - i % left.width + x as usize] - d).abs() <= 1.0
    };
    (0..left.px.len()).map(seen).collect()
}

fn from_depth(path: &Path, calibration: &Path) -> Result<Truth, TruthError> {
    let rig = calibration_file::read(calibration, true)?;
    let mut map = map_file::read(path, 256.0)?;
    // From metres to px; known values are positive in both.
    for z in map.px.iter_mut().filter(|z| **z > 0.0) {
        *z = rig.disparity_px(f64::from(*z)) as f32;
    }
    let regions = vec![(Region::All, map.known())];
    Ok(Truth { width: map.width, height: map.height, disparity_px: map.px, regions })
}

#[cfg(test)]
mod tests {
    use super::*;
    use image::{GrayImage, ImageBuffer, Luma};

    fn save16(path: &Path, width: u32, values: &[u16]) {
        let height = values.len() as u32 / width;
        ImageBuffer::<Luma<u16>, _>::from_raw(width, height, values.to_vec()).unwrap().save(path).unwrap();
    }

    fn save8(path: &Path, width: u32, values: &[u8]) {
        let height = values.len() as u32 / width;
        GrayImage::from_raw(width, height, values.to_vec()).unwrap().save(path).unwrap();
    }

    fn pair(files: TruthFiles) -> TruthPair {
        TruthPair { name: "a".into(), left: "l.png".into(), right: "r.png".into(), files }
    }

    #[test]
    fn kitti_has_the_regions_of_its_maps() {
        let folder = tempfile::tempdir().unwrap();
        let (all, noc) = (folder.path().join("all.png"), folder.path().join("noc.png"));
        save16(&all, 3, &[0, 256, 640, 1, 0, 0]);
        save16(&noc, 3, &[0, 256, 0, 0, 0, 0]);
        let both = pair(TruthFiles::Kitti { all: Some(all.clone()), noc: Some(noc.clone()) });
        let truth = both.truth().unwrap();
        assert_eq!((truth.width, truth.height), (3, 2));
        assert_eq!(truth.disparity_px, [-1.0, 1.0, 2.5, 1.0 / 256.0, -1.0, -1.0]);
        assert_eq!(truth.region(Region::All).unwrap(), [false, true, true, true, false, false]);
        assert_eq!(truth.visible(), [false, true, false, false, false, false]);
        let only = pair(TruthFiles::Kitti { all: None, noc: Some(noc.clone()) }).truth().unwrap();
        assert_eq!(only.regions.len(), 1);
        assert_eq!(both.regions(), [Region::All, Region::Noc]);
        assert_eq!((only.region(Region::All), only.disparity_px[1]), (None, 1.0));
        save16(&noc, 2, &[1, 2]);
        let error = both.truth().unwrap_err().to_string();
        assert!(error.contains("noc.png: 2x1") && error.contains("3x2"), "{error}");
    }

    #[test]
    fn a_scene_tells_occluded_pixels_by_its_mask_or_its_right_map() {
        let folder = tempfile::tempdir().unwrap();
        let path = |name: &str| folder.path().join(name);
        save8(&path("d.png"), 4, &[4, 4, 8, 0]);
        save8(&path("m.png"), 4, &[255, 128, 255, 255]);
        save8(&path("r.png"), 4, &[8, 12, 0, 0]);
        let scene = |mask: Option<PathBuf>, right_map, scale| {
            pair(TruthFiles::Scene { map: path("d.png"), mask, right_map, scale }).truth().unwrap()
        };
        let truth = scene(Some(path("m.png")), None, Some(4.0));
        assert_eq!(truth.disparity_px, [1.0, 1.0, 2.0, -1.0]);
        assert_eq!(truth.region(Region::Noc).unwrap(), [true, false, true, false]);
        // Pixel 0: outside; 1: column 0 has 2, within 1 px; 2: column 0 has 2.
        let truth = scene(None, Some(path("r.png")), Some(4.0));
        assert_eq!(truth.region(Region::Noc).unwrap(), [false, true, true, false]);
        assert_eq!(truth.region(Region::All).unwrap(), [true, true, true, false]);
        // Maps of small height and unknown scale are a third of the full size.
        let truth = scene(None, None, None);
        assert_eq!(truth.disparity_px[2], 8.0 / 3.0);
        assert_eq!(truth.region(Region::Noc), None);
        save8(&path("r.png"), 2, &[8, 12, 0, 0]);
        let files = TruthFiles::Scene {
            map: path("d.png"),
            mask: None,
            right_map: Some(path("r.png")),
            scale: Some(4.0),
        };
        let error = pair(files).truth().unwrap_err().to_string();
        assert!(error.contains("r.png: 2x2") && error.contains("d.png"), "{error}");
    }

    #[test]
    fn distances_become_disparities() {
        let folder = tempfile::tempdir().unwrap();
        let (depth, calibration) = (folder.path().join("z.png"), folder.path().join("c.txt"));
        save16(&depth, 2, &[0, 20 * 256]);
        let text = "P2: 700 0 600 45 0 700 180 0 0 0 1 0\nP3: 700 0 600 -335 0 700 180 0 0 0 1 0\n";
        std::fs::write(&calibration, text).unwrap();
        let truth = pair(TruthFiles::Depth { depth, calibration }).truth().unwrap();
        assert_eq!(truth.disparity_px, [-1.0, 19.0]);
        assert_eq!(truth.visible(), [false, true]);
    }
}
