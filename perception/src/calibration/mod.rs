//! Calibration: from chessboards in pictures to a rectified pair of cameras.

pub mod bundle;
pub mod camera;
pub mod corner;
pub mod finder;
pub mod grid;
pub mod homography;
pub mod plane;
pub mod pose;
pub mod prediction;
pub mod rectification;
pub mod saddle;
pub mod start;
pub mod stereo;
pub mod uncertainty;
pub mod verdict;

pub use camera::{Camera, Lens};
pub use finder::{Board, BoardError, NoBoard, Sighting};
pub use pose::Pose;
pub use rectification::{Crop, Rectification, RectificationError};
pub use stereo::{CalibrationError, Pair, StereoCalibration, ViewFault, calibrate, calibrate_all};
pub use verdict::{Grade, Reason, Verdict, judge};

#[cfg(test)]
mod tests;
