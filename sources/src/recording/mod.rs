//! Recordings: MCAP files with Foxglove's message types, as `lookout record` writes them, and ROS 2 bags in
//! MCAP with a left and a right image topic.
//!
//! Images and geometry are Foxglove messages in Protocol Buffers ([`foxglove`]). Results and state are JSON
//! with a JSON schema: the same documents as in `obstacles.jsonl` and `lookout status --json`.

mod cdr;
pub mod foxglove;
mod image_message;
mod index;
mod lengths;
mod source;
#[cfg(test)]
mod tests;
mod vehicle;

pub use index::{Cut, Index, Stored};
pub use source::RecordingSource;
pub use vehicle::VehicleLine;

use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};
use thiserror::Error;

/// Left image.
pub const LEFT_IMAGE: &str = "/left/image";
/// Right image.
pub const RIGHT_IMAGE: &str = "/right/image";
/// Calibration of the left images.
pub const LEFT_CALIBRATION: &str = "/left/calibration";
/// Calibration of the right images.
pub const RIGHT_CALIBRATION: &str = "/right/calibration";
/// Number, times and size of each stereo pair.
pub const PAIR: &str = "/pair";
/// What the vehicle reported at each pair.
pub const VEHICLE: &str = "/vehicle";
/// Name of the schema of [`VEHICLE`].
pub const VEHICLE_SCHEMA: &str = "lookout.Vehicle";
/// A line of `obstacles.jsonl` for each frame.
pub const OBSTACLES: &str = "/obstacles";
/// The obstacles as 3D boxes.
pub const SCENE: &str = "/obstacles/scene";
/// The obstacles as boxes in the left image.
pub const ANNOTATIONS: &str = "/left/annotations";
/// The point cloud.
pub const POINTS: &str = "/points";
/// The state of the daemon.
pub const STATUS: &str = "/status";
/// Counts of messages that could not be recorded.
pub const LOSS: &str = "/loss";
/// Transforms between vehicle and cameras.
pub const TRANSFORM: &str = "/tf";
/// Pose of the vehicle since the start.
pub const ODOMETRY: &str = "/odometry";

/// Name of the metadata record at the start of a recording: the rig, in full precision.
pub const ABOUT: &str = "lookout.recording";
/// Name of the metadata record at the end of a recording: lost messages and the reason for its end.
pub const SUMMARY: &str = "lookout.summary";

/// File name extension of recordings.
pub const ENDING: &str = "mcap";

/// Whether a file begins as MCAP files do.
pub fn has_magic(path: &Path) -> bool {
    // Opening a pipe would wait for its writer.
    path.is_file()
        && File::open(path).is_ok_and(|mut file| {
            let mut magic = [0; mcap::MAGIC.len()];
            file.read_exact(&mut magic).is_ok() && magic == *mcap::MAGIC
        })
}

/// Why a recording cannot be used.
#[derive(Debug, Error)]
pub enum RecordingError {
    /// The file cannot be read.
    #[error("{}: {source}: give a recording of `lookout record`, or a ROS 2 bag in MCAP", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// The file is not in MCAP format.
    #[error("{}: no MCAP file: {explanation}", path.display())]
    Foreign {
        /// The file.
        path: PathBuf,
        /// What it is instead, and what to do.
        explanation: String,
    },
    /// A record is damaged.
    #[error(
        "{}: damaged at byte {at}: {reason}: copy the file again, or save what is left of it with the mcap \
         tool (mcap recover)", path.display()
    )]
    Damaged {
        /// The file.
        path: PathBuf,
        /// Offset in the file, in bytes.
        at: u64,
        /// What is wrong.
        reason: String,
    },
    /// The file holds more than the reader takes.
    #[error(
        "{}: {found}: a recording has at most {limit}: divide it, or keep only the topics that you need, with the mcap \
         tool (mcap filter)", path.display()
    )]
    TooLarge {
        /// The file.
        path: PathBuf,
        /// What there is, and where.
        found: String,
        /// How much there may be.
        limit: u64,
    },
    /// The file holds no stereo pairs.
    #[error("{}: {reason}", path.display())]
    NoPairs {
        /// The file.
        path: PathBuf,
        /// What is missing, and what the file holds.
        reason: String,
    },
    /// A message cannot be decoded, or differs from the first pair.
    #[error("{}: {topic}, message at {time_ns} ns: {reason}", path.display())]
    Message {
        /// The file.
        path: PathBuf,
        /// The topic.
        topic: String,
        /// Log time of the message.
        time_ns: u64,
        /// What is wrong.
        reason: String,
    },
}
