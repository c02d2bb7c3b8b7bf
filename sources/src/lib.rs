//! Where stereo pairs come from: recorded folders and MCAP files, data sets with truth and synthetic
//! scenes.

pub mod calibration_file;
pub mod camera;
pub mod chessboard;
pub mod folder;
pub mod recording;
pub mod rectified;
pub mod rig_file;
pub mod scene;
mod source;
pub mod truth;

pub use source::{LiveSource, PairSource, Readiness, SourceError};
