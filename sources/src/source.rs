//! The interfaces of all sources, [`PairSource`] and [`LiveSource`], and their errors.

use crate::recording::RecordingError;
use crate::scene::file::SceneError;
use crate::vehicle::VehicleReading;
use perception::rig::Rig;
use std::path::{Path, PathBuf};
use std::time::Duration;
use thiserror::Error;

/// What a source says about its pictures.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Geometry {
    /// Nothing.
    #[default]
    Unknown,
    /// They are rectified.
    Rectified,
    /// They are as the cameras took them, with the distortion of the lenses.
    Distorted,
}

/// A sequence of stereo pairs of one size, read by index, so that a source can be resumed, repeated, and read
/// twice with the same result.
pub trait PairSource {
    /// Width and height of every image, in pixels.
    fn size(&self) -> (usize, usize);

    /// Rectified intrinsics and baseline, where known; needed to convert disparity to metres.
    fn rig(&self) -> Option<Rig>;

    /// What the source says about its pictures.
    fn geometry(&self) -> Geometry {
        Geometry::Unknown
    }

    /// The file beside the pictures from which [`Self::rig`] is.
    fn rig_file(&self) -> Option<&Path> {
        None
    }

    /// Whether the pictures are those of KITTI's colour cameras, where a calibration has grey ones, too.
    fn has_colour_cameras(&self) -> bool {
        true
    }

    /// Number of pairs; `None` for an endless source.
    fn count(&self) -> Option<u64>;

    /// Nominal time from one pair to the next, in nanoseconds.
    fn period_ns(&self) -> u64;

    /// Source time of pair `index`, in nanoseconds: `index` periods, unless the source has a timestamp for each
    /// pair. A live source returns the time of its latest pair on the monotonic clock.
    fn time_ns(&self, index: u64) -> u64 {
        index.saturating_mul(self.period_ns())
    }

    /// What the user should know of the source before the first pair, one sentence each.
    fn notes(&self) -> Vec<String> {
        Vec::new()
    }

    /// What the vehicle reported at the time of pair `index`, once that pair was read; nothing unless the source knows it.
    fn vehicle(&self, index: u64) -> VehicleReading {
        let _ = index;
        VehicleReading::default()
    }

    /// The live interface of a source that runs at its own pace, such as cameras; `None` for all others.
    fn live(&mut self) -> Option<&mut dyn LiveSource> {
        None
    }

    /// Reads pair `index` into two images of `width` × `height` bytes, row-major.
    ///
    /// # Errors
    /// When the pair does not exist or cannot be decoded; the error names the file.
    fn read(&mut self, index: u64, left: &mut [u8], right: &mut [u8]) -> Result<(), SourceError>;
}

/// A source that delivers pairs at its own pace. [`PairSource::read`] returns the pair that [`Self::wait`]
/// has announced.
pub trait LiveSource {
    /// Waits for the next pair, at most about `patience`.
    fn wait(&mut self, patience: Duration) -> Readiness;
}

/// Result of waiting for a pair.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Readiness {
    /// A pair is ready.
    Pair {
        /// Time of the exposure on the monotonic clock, in nanoseconds.
        capture_ns: u64,
    },
    /// No pair arrived.
    Nothing,
    /// No pair arrived, for this reason. Each fault is reported once; pairs may follow.
    Trouble(String),
    /// The reported fault is over.
    Recovered,
}

/// Names of the folders with the left and the right images, most specific first.
pub const LAYOUTS: [(&str, &str); 11] = [
    ("image_2", "image_3"),
    ("image_0", "image_1"),
    ("image_l", "image_r"),
    ("left", "right"),
    ("image_02/data", "image_03/data"),
    ("image_00/data", "image_01/data"),
    ("image_02", "image_03"),
    ("image_00", "image_01"),
    ("mav0/cam0/data", "mav0/cam1/data"),
    ("cam0/data", "cam1/data"),
    ("cam0", "cam1"),
];

/// What to do with a folder in none of the [`LAYOUTS`].
const LAYOUT_REMEDY: &str = ": give a folder with the left and the right pictures in two folders with the same names (left \
                             and right, image_0 and image_1, image_2 and image_3, cam0 and cam1, a drive of KITTI's raw \
                             data, mav0 of EuRoC), or in one, named left_1.png and right_1.png; lookout replay \
                             also takes any names, with --left and --right";

/// Errors of sources. Every text names the file or folder and the remedy.
#[derive(Debug, Error)]
pub enum SourceError {
    /// The folder is missing or cannot be listed.
    #[error("{}: {source}", path.display())]
    Io {
        /// Path that was opened.
        path: PathBuf,
        /// Cause.
        source: std::io::Error,
    },
    /// The folder has none of the known layouts.
    #[error(
        "{}: no stereo pairs here{hint}{}",
        path.display(),
        if *says_remedy { "" } else { LAYOUT_REMEDY }
    )]
    Layout {
        /// The folder.
        path: PathBuf,
        /// What it holds instead, after ": "; may be empty.
        hint: String,
        /// Whether the hint says what to do.
        says_remedy: bool,
    },
    /// A file where a folder is needed.
    #[error("{}: {explanation}", path.display())]
    Foreign {
        /// The file.
        path: PathBuf,
        /// What it is, and what to do.
        explanation: String,
    },
    /// The left folder contains no image.
    #[error(
        "{}: no pictures here{hint}: put PNG, JPEG, TIFF, BMP, WebP, PGM or PPM images into it", path.display()
    )]
    Empty {
        /// The folder.
        path: PathBuf,
        /// What it holds instead, after ": "; may be empty.
        hint: String,
    },
    /// A pattern that cannot be used, or matches nothing.
    #[error("{}: {reason}", pattern.display())]
    Pattern {
        /// The pattern.
        pattern: PathBuf,
        /// Why, and the remedy.
        reason: String,
    },
    /// Pictures of two cameras whose names have nothing in common.
    #[error(
        "no left picture has a partner: {lefts} in {} such as {}, {rights} in {} such as {}: give both the same names, but for \
         the words left and right, or name them with patterns whose stars stand for the same text (lookout replay --left, --right)",
        left.parent().unwrap_or(left).display(), left.file_name().unwrap_or_default().display(),
        right.parent().unwrap_or(right).display(), right.file_name().unwrap_or_default().display()
    )]
    NoPartners {
        /// A left picture.
        left: PathBuf,
        /// Number of left pictures.
        lefts: usize,
        /// A right picture.
        right: PathBuf,
        /// Number of right pictures.
        rights: usize,
    },
    /// One file for both cameras.
    #[error(
        "{}: left and right{} are the same file: give the pictures of each camera",
        left.display(),
        if left == right { String::new() } else { format!(" ({})", right.display()) }
    )]
    SameFile {
        /// What is given for the left camera.
        left: PathBuf,
        /// What is given for the right one.
        right: PathBuf,
    },
    /// One image of a pair is missing.
    #[error("{}: missing, but {} is there: add it, or remove the other", path.display(), other.display())]
    Unpaired {
        /// The missing image.
        path: PathBuf,
        /// Its existing partner.
        other: PathBuf,
    },
    /// An image differs in size from the first.
    #[error(
        "{}: {}x{} pixels, but {} has {}x{}: all images of a source need one size: remove or replace those of another size, or \
         replay them alone",
        path.display(), size.0, size.1, first.display(), expected.0, expected.1
    )]
    Size {
        /// The image.
        path: PathBuf,
        /// Its size.
        size: (usize, usize),
        /// The first image.
        first: PathBuf,
        /// The size of the first image.
        expected: (usize, usize),
    },
    /// An image that cannot be decoded.
    #[error("{}: cannot be decoded: {reason}: replace or remove it", path.display())]
    Decode {
        /// The image.
        path: PathBuf,
        /// Message of the decoder.
        reason: String,
    },
    /// An invalid calibration file.
    #[error("{}: {reason}", path.display())]
    Calibration {
        /// The file.
        path: PathBuf,
        /// Line or key, and the remedy.
        reason: String,
    },
    /// An invalid file of the vehicle's motion.
    #[error("{}: {reason}", path.display())]
    Motion {
        /// The file.
        path: PathBuf,
        /// Line or column, and the remedy.
        reason: String,
    },
    /// More files than a source may have.
    #[error("{}: more than {limit} {what}: {remedy}", path.display())]
    TooMany {
        /// The folder.
        path: PathBuf,
        /// What is counted.
        what: &'static str,
        /// How many there may be.
        limit: usize,
        /// What to do.
        remedy: &'static str,
    },
    /// An invalid MCAP recording.
    #[error(transparent)]
    Recording(#[from] RecordingError),
    /// An invalid scene.
    #[error(transparent)]
    Scene(#[from] SceneError),
    /// An index beyond the last pair.
    #[error("pair {index} requested, but the source has only {count}")]
    End {
        /// The index.
        index: u64,
        /// Number of pairs.
        count: u64,
    },
}

/// Checks that two paths are not the same file, by whatever names.
///
/// # Errors
/// If they are.
pub fn check_two_files(left: &Path, right: &Path) -> Result<(), SourceError> {
    let is_same = match (left.canonicalize(), right.canonicalize()) {
        (Ok(a), Ok(b)) => a == b,
        _ => left == right,
    };
    if is_same {
        Err(SourceError::SameFile { left: left.to_owned(), right: right.to_owned() })
    } else {
        Ok(())
    }
}

impl SourceError {
    /// Whether one pair is damaged and the others may be fine: a picture that is missing or cannot be decoded.
    pub fn is_of_one_pair(&self) -> bool {
        match self {
            Self::Decode { .. } | Self::Unpaired { .. } => true,
            Self::Recording(error) => matches!(error, RecordingError::Message { .. }),
            _ => false,
        }
    }
}
