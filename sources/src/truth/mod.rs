//! Data sets with ground truth: stereo pairs, the disparity of their left pixels, and where it
//! counts.

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
