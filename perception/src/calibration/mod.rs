//! Calibration: from chessboards in pictures to a rectified pair of cameras.

pub mod bundle;
pub mod camera;
pub mod corner;
pub mod finder;
pub mod grid;
pub mod homography;
pub mod plane;
pub mod pose;
pub mod rectification;
pub mod saddle;
pub mod stereo;

pub use camera::{Camera, Lens};
pub use finder::{Board, BoardError, NoBoard, Sighting};
pub use pose::Pose;
