//! Dense stereo: from a rectified pair to a disparity map with confidence.

pub mod blocks;
pub mod confidence;
pub mod cost;
pub mod device;
mod disparity;
pub mod energy;
pub mod epipolar;
pub mod fallback;
pub mod fill;
#[cfg(feature = "gpu")]
pub mod gpu;
mod matcher;
pub mod median;
pub mod mpv;
pub mod pyramid;
pub mod scale;
pub mod solver;
pub mod speckle;
pub mod viterbi;
pub mod winner;
mod worker;

pub use disparity::DisparityView;
pub use matcher::{MatchError, MatchOutput, Matcher, MatcherError};
pub use mpv::{Mpv, MpvParameters, Search};
