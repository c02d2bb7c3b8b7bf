//! Histograms of oriented gradients (HOG) with a linear SVM: Dalal and Triggs 2005, as OpenCV's `HOGDescriptor` computes
//! them with its defaults.
//!
//! Square-rooted grey levels, cells of 8 × 8 pixels, blocks of 2 × 2 cells that overlap by half, 9 bins without sign,
//! L2-Hys. Descriptors differ from OpenCV's by rounding (the order of sums), scores by less than 1e-4; scales, scaled
//! images, places of windows and grouping are the same.
//!
//! | module | contents |
//! |---|---|
//! | [`model`] | the SVM and its file |
//! | [`gradient`] | weighted gradients, summed vertically |
//! | [`block`] | normalised blocks, and the sum of a window |
//! | `recogniser` | the best window in the crop of a region |
//! | [`scan`] | sliding window over scales |

pub mod block;
pub mod gradient;
pub mod model;
mod recogniser;
pub mod scan;

pub use model::{HogModel, ModelError};
pub use recogniser::HogRecogniser;
pub use scan::{HogScanner, ScoredWindow};

/// Side of a cell, and from one window to the next, in pixels.
pub const CELL: usize = 8;

/// Bins of a half turn.
pub const BINS: usize = 9;
