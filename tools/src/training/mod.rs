//! Trains boosted cascades: Gentle AdaBoost over trees of LBP or Haar features, stage by stage, on
//! what the stages before let pass (paper, section 3.6).
//!
//! The format is OpenCV's; what OpenCV's trainer lacks is there: varied samples, means that are drawn
//! to a prior, least leaf weights, and thresholds and ends of stages judged by pictures that were
//! not learned from.

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
