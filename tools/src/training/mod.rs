//! Training of boosted cascades: Gentle AdaBoost over trees of LBP or Haar features, stage by stage, on the
//! windows that the previous stages accept (paper, section 3.6).
//!
//! The output format is OpenCV's. In addition to OpenCV's trainer there are data augmentation, shrinkage of means
//! towards a prior, minimum leaf weights, and thresholds and stopping decided on held-out validation images.

pub mod ablation;
pub mod augment;
pub mod bags;
pub mod checkpoint;
mod error;
pub mod features;
pub mod finish;
pub mod mine;
mod parameters;
pub mod pictures;
pub mod report;
pub mod stage;
pub mod sweep;
#[cfg(test)]
mod tests;
pub mod threads;
mod trainer;
pub mod tree;

pub use error::TrainError;
pub use features::FeatureKind;
pub use parameters::TrainParameters;
pub use trainer::{Progress, StageFigures, Trained, train};
