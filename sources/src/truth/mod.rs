//! Data sets with ground truth (KITTI, Middlebury): stereo pairs, disparity of the left image, and evaluation
//! masks.

mod error;
pub mod find;
pub mod label;
pub mod lidar;
pub mod map_file;
mod pair;
pub mod pfm;

pub use error::TruthError;
pub use find::find;
pub use pair::{Region, Truth, TruthFiles, TruthPair};
