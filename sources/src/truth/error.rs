//! Errors of data sets with ground truth.

use crate::SourceError;
use std::path::PathBuf;
use thiserror::Error;

/// The layouts that [`find`](super::find()) recognises, for messages.
const LAYOUTS: &str = "folders image_2 and image_3, or image_0 and image_1, with disp_occ_0, disp_noc_0, \
    disp_occ or disp_noc (KITTI 2015, 2012); folders left, right, gt_depth_map and calib (KITTI depth); or a \
    folder per scene with im0.png, im1.png and disp0GT.pfm or disp0.pfm, im2, im6 and disp2 (.ppm and .pgm, or \
    .png), view1.png, view5.png and disp1.png, or left.png, right.png and groundtruth.png or gt.png (Middlebury)";

/// Errors of data sets. Every text names the file or folder and the remedy.
#[derive(Debug, Error)]
pub enum TruthError {
    /// No pair with ground truth.
    #[error("{}: no stereo pair with ground truth here or below: expected {}", path.display(), LAYOUTS)]
    NoPairs {
        /// The folder.
        path: PathBuf,
    },
    /// Two pairs with equal names, whose results would overwrite each other.
    #[error(
        "{}: its pair is called {name}, as is the one of {}: rename one of their folders",
        path.display(), other.display()
    )]
    SameName {
        /// The name.
        name: String,
        /// Left image of one pair.
        path: PathBuf,
        /// Left image of the other pair.
        other: PathBuf,
    },
    /// A file or folder that cannot be read.
    #[error("{}: {source}: give a folder of the data set that this user may read", path.display())]
    Io {
        /// Path that was opened.
        path: PathBuf,
        /// Cause.
        source: std::io::Error,
    },
    /// An invalid map.
    #[error("{}: {reason}", path.display())]
    Map {
        /// The file.
        path: PathBuf,
        /// The fault and the remedy.
        reason: String,
    },
    /// A map or mask that differs in size from the file it belongs to.
    #[error(
        "{}: {}x{} pixels, but {} has {}x{}: both must be of one pair, unscaled",
        path.display(), size.0, size.1, other.display(), expected.0, expected.1
    )]
    Size {
        /// The file.
        path: PathBuf,
        /// Its width and height.
        size: (usize, usize),
        /// The file it belongs to.
        other: PathBuf,
        /// Width and height of that file.
        expected: (usize, usize),
    },
    /// An invalid image or calibration.
    #[error(transparent)]
    Source(#[from] SourceError),
}
