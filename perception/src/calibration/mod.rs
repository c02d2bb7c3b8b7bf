//! Stereo calibration from images of a calibration board.
//!
//! Input are image pairs of a printed [`Board`]: a chessboard, or a ChArUco board or AprilGrid, of which a part is enough.
//! [`finder::find`] locates its corners in each image with sub-pixel precision. [`calibrate`] estimates both cameras
//! ([`Camera`]: with the Brown–Conrady, rational or fisheye distortion model of OpenCV) and their relative [`Pose`] from the
//! corners of all pairs, and computes the [`Rectification`]. [`judge`] grades the result as good, usable or redo, with reasons.
//!
//! Units: pixels for image positions (the centre of the first pixel is 0), metres for lengths and radians for
//! angles. Camera coordinates are x right, y down, z forward.
//!
//! Start values come from the closed form of Zhang (2000), see [`homography`]; a bundle adjustment by
//! Levenberg–Marquardt refines them, see [`bundle`].

pub mod board;
pub mod bundle;
pub mod camera;
pub mod corner;
pub mod dictionary;
pub mod drive;
pub mod finder;
pub mod grid;
pub mod homography;
mod marker;
mod placement;
pub mod plane;
pub mod pose;
pub mod prediction;
pub mod projection;
pub mod rectification;
mod rejection;
pub mod right_turn;
pub mod saddle;
pub mod start;
pub mod stereo;
pub mod uncertainty;
pub mod verdict;

pub use board::{Board, BoardError, Pattern};
pub use camera::{Camera, Distortion, Lens};
pub use dictionary::Dictionary;
pub use finder::{NoBoard, Sighting};
pub use grid::Places;
pub use pose::Pose;
pub use projection::ProjectionUncertainty;
pub use rectification::{Crop, Rectification, RectificationError};
pub use right_turn::RightTurn;
pub use stereo::{
    CalibrationError, Pair, StereoCalibration, ViewFault, calibrate, calibrate_all, calibrate_simultaneous,
};
pub use verdict::{Grade, Reason, Verdict, judge};

#[cfg(test)]
mod tests;
