//! Stereo calibration from images of a chessboard.
//!
//! Input are image pairs of a printed chessboard ([`Board`]). [`finder::find`] locates its inner corners in each
//! image with sub-pixel precision. [`calibrate`] estimates both cameras ([`Camera`]: pinhole with the
//! Brown–Conrady or rational distortion model of OpenCV) and their relative [`Pose`] from the corners of all
//! pairs, and computes the [`Rectification`]. [`judge`] grades the result as good, usable or redo, with reasons.
//!
//! Units: pixels for image positions (the centre of the first pixel is 0), metres for lengths and radians for
//! angles. Camera coordinates are x right, y down, z forward.
//!
//! Start values come from the closed form of Zhang (2000), see [`homography`]; a bundle adjustment by
//! Levenberg–Marquardt refines them, see [`bundle`].

pub mod bundle;
pub mod camera;
pub mod corner;
pub mod drive;
pub mod finder;
pub mod grid;
pub mod homography;
pub mod plane;
pub mod pose;
pub mod prediction;
pub mod rectification;
mod rejection;
pub mod right_turn;
pub mod saddle;
pub mod start;
pub mod stereo;
pub mod uncertainty;
pub mod verdict;

pub use camera::{Camera, Lens};
pub use finder::{Board, BoardError, NoBoard, Sighting};
pub use pose::Pose;
pub use rectification::{Crop, Rectification, RectificationError};
pub use right_turn::RightTurn;
pub use stereo::{CalibrationError, Pair, StereoCalibration, ViewFault, calibrate, calibrate_all};
pub use verdict::{Grade, Reason, Verdict, judge};

#[cfg(test)]
mod tests;
