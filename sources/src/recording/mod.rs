//! Recordings: MCAP files with Foxglove's message types, as `lookout record` writes them, and ROS 2
//! bags with two image topics.
//!
//! Pixels and geometry are in Foxglove's own messages (Protocol Buffers: no text around the pixels),
//! what is ours in JSON with a JSON schema: the documents that `obstacles.jsonl` and
//! `lookout status --json` hold, too.

mod cdr;
pub mod foxglove;
mod image_message;
mod index;
mod lengths;
pub mod protobuf;
mod source;
#[cfg(test)]
mod tests;

pub use index::{Cut, Index, Stored};
pub use source::RecordingSource;

use std::path::PathBuf;
use thiserror::Error;

/// Left image.
pub const LEFT_IMAGE: &str = "/left/image";
/// Right image.
pub const RIGHT_IMAGE: &str = "/right/image";
/// Calibration of the left images.
pub const LEFT_CALIBRATION: &str = "/left/calibration";
/// Calibration of the right images.
pub const RIGHT_CALIBRATION: &str = "/right/calibration";
/// What ties two images together: their number and times.
pub const PAIR: &str = "/pair";
/// A line of `obstacles.jsonl` per frame.
pub const OBSTACLES: &str = "/obstacles";
/// The obstacles as boxes in space.
pub const SCENE: &str = "/obstacles/scene";
/// The obstacles as boxes in the left image.
pub const ANNOTATIONS: &str = "/left/annotations";
/// The point cloud.
pub const POINTS: &str = "/points";
/// The state of the daemon.
pub const STATUS: &str = "/status";
/// Messages that could not be recorded.
pub const LOSS: &str = "/loss";
/// Where the camera looks.
pub const TRANSFORM: &str = "/tf";

/// Name of the metadata record at the start of a recording: rig and period, exactly.
pub const ABOUT: &str = "lookout.recording";
/// Name of the metadata record at its end: what was lost, and why it ended.
pub const SUMMARY: &str = "lookout.summary";

/// The ending of the files.
pub const ENDING: &str = "mcap";

/// Why a recording cannot be used.
#[derive(Debug, Error)]
pub enum RecordingError {
    /// It cannot be read.
    #[error("{}: {source}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// It is something else.
    #[error("{}: no MCAP file: give a recording of `lookout record`, or a ROS 2 bag in MCAP", path.display())]
    Foreign {
        /// The file.
        path: PathBuf,
    },
    /// Something in it is damaged.
    #[error(
        "{}: damaged at byte {at}: {reason}: copy the file again, or save what is left of it with the mcap \
         tool (mcap recover)", path.display()
    )]
    Damaged {
        /// The file.
        path: PathBuf,
        /// Where.
        at: u64,
        /// What is wrong.
        reason: String,
    },
    /// There are no pairs in it.
    #[error("{}: {reason}", path.display())]
    NoPairs {
        /// The file.
        path: PathBuf,
        /// What is there, and what is wanted.
        reason: String,
    },
    /// A message that cannot be used.
    #[error("{}: {topic}, message at {time_ns} ns: {reason}", path.display())]
    Message {
        /// The file.
        path: PathBuf,
        /// The topic.
        topic: String,
        /// Its time in the file.
        time_ns: u64,
        /// What is wrong.
        reason: String,
    },
}
