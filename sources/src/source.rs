//! The interface of every source: [`PairSource`], [`LiveSource`] and their errors.

use crate::recording::RecordingError;
use crate::scene::file::SceneError;
use perception::rig::Rig;
use std::path::PathBuf;
use std::time::Duration;
use thiserror::Error;

/// A sequence of rectified pairs of one size, read by index: so a source can be resumed, repeated
/// and read twice with the same result.
pub trait PairSource {
    /// Width and height of every image, in pixels.
    fn size(&self) -> (usize, usize);

    /// What turns disparity into metres, when the source knows.
    fn rig(&self) -> Option<Rig>;

    /// Pairs from index 0 on; `None` when they never end.
    fn count(&self) -> Option<u64>;

    /// Time from one pair to the next when it was taken, in nanoseconds.
    fn period_ns(&self) -> u64;

    /// Time of pair `index` in the scene, in nanoseconds: so many periods, unless the source knows when
    /// each pair was taken. A live source gives that of the pair it gave last, on the monotonic clock.
    fn time_ns(&self, index: u64) -> u64 {
        index.saturating_mul(self.period_ns())
    }

    /// A source that runs by itself, as cameras do; `None` for one that is read at any pace.
    fn live(&mut self) -> Option<&mut dyn LiveSource> {
        None
    }

    /// Writes pair `index`, both images `width` × `height` bytes, row after row.
    ///
    /// # Errors
    /// When the pair does not exist or cannot be decoded; the file is named.
    fn read(&mut self, index: u64, left: &mut [u8], right: &mut [u8]) -> Result<(), SourceError>;
}

/// A source that brings pairs when they are there: [`PairSource::read`] then gives the one that
/// [`Self::wait`] has found.
pub trait LiveSource {
    /// Waits for the next pair, at most about `patience`.
    fn wait(&mut self, patience: Duration) -> Readiness;
}

/// What waiting for a pair came to.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Readiness {
    /// A pair is there.
    Pair {
        /// When it was exposed, on the monotonic clock, in nanoseconds.
        capture_ns: u64,
    },
    /// None came.
    Nothing,
    /// None came, and this is why. It is told once; pairs may come again.
    Trouble(String),
    /// What was wrong is not any more.
    Recovered,
}

/// Names of the folders with the left and the right images, most specific first.
pub const LAYOUTS: [(&str, &str); 6] = [
    ("image_2", "image_3"),
    ("image_0", "image_1"),
    ("image_l", "image_r"),
    ("left", "right"),
    ("image_02/data", "image_03/data"),
    ("image_00/data", "image_01/data"),
];

/// Why pairs cannot be had. Every text names the file or folder and the remedy.
#[derive(Debug, Error)]
pub enum SourceError {
    /// The folder is not there, or cannot be listed.
    #[error("{}: {source}", path.display())]
    Io {
        /// What was opened.
        path: PathBuf,
        /// Why it failed.
        source: std::io::Error,
    },
    /// None of the known layouts.
    #[error(
        "{}: no stereo pairs here: expected two folders named {}, with images of the same names in both",
        path.display(),
        LAYOUTS.map(|(l, r)| format!("{l} and {r}")).join(", or ")
    )]
    Layout {
        /// The folder.
        path: PathBuf,
    },
    /// The left folder holds no image.
    #[error("{}: the folder is empty: put PNG, PGM or PPM images into it", path.display())]
    Empty {
        /// The folder.
        path: PathBuf,
    },
    /// One image of a pair is missing.
    #[error("{}: missing, but {} is there: add it, or remove the other", path.display(), other.display())]
    Unpaired {
        /// The image that should be there.
        path: PathBuf,
        /// The one that is.
        other: PathBuf,
    },
    /// An image has another size than the first.
    #[error(
        "{}: {}x{} pixels, but {} has {}x{}: all images of a source need one size",
        path.display(), size.0, size.1, first.display(), expected.0, expected.1
    )]
    Size {
        /// The image.
        path: PathBuf,
        /// Its size.
        size: (usize, usize),
        /// The first image.
        first: PathBuf,
        /// The size of that.
        expected: (usize, usize),
    },
    /// An image that cannot be decoded.
    #[error("{}: cannot be decoded: {reason}: replace or remove it", path.display())]
    Decode {
        /// The image.
        path: PathBuf,
        /// What the decoder says.
        reason: String,
    },
    /// A calibration file that cannot be used.
    #[error("{}: {reason}", path.display())]
    Calibration {
        /// The file.
        path: PathBuf,
        /// Line or key, and the remedy.
        reason: String,
    },
    /// A recording in MCAP.
    #[error(transparent)]
    Recording(#[from] RecordingError),
    /// A scene.
    #[error(transparent)]
    Scene(#[from] SceneError),
    /// An index beyond the end.
    #[error("pair {index} was asked for, but the source has only {count}")]
    End {
        /// The index.
        index: u64,
        /// Pairs that exist.
        count: u64,
    },
}
