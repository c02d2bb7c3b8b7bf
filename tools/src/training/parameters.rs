//! Parameters of the trainer and their defaults.

use super::augment::Variation;
use super::features::FeatureKind;
use super::finish::Aim;
use super::stage::StageParameters;
use super::tree::TreeParameters;

/// Parameters of training.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TrainParameters {
    /// Width and height of the window, in pixels.
    pub window: (u16, u16),
    /// Feature type.
    pub features: FeatureKind,
    /// Number of features that a stage chooses from, drawn anew for each stage; all when there are no more.
    pub pool: usize,
    /// Maximum number of stages.
    pub stages: usize,
    /// Number of cascades trained with different random numbers and joined.
    pub bags: usize,
    /// Parameters of a stage.
    pub stage: StageParameters,
    /// Augmented windows per object, in addition to the original.
    pub variants: usize,
    /// Strength of the augmentation.
    pub variation: Variation,
    /// Negative windows for each stage.
    pub negatives: usize,
    /// Share of each folder's images held out for validation; with 0 the training samples are used for validation
    /// too.
    pub validation: f64,
    /// Target of the whole cascade, measured on the images filled by an object and on patches without objects
    /// (random windows if there are no patches).
    pub aim: Aim,
    /// With a target: share of the objects accepted by the last stage that the first may reject.
    pub early: f64,
    /// Seed of the random numbers.
    pub seed: u64,
    /// Number of threads; the result does not depend on it.
    pub threads: usize,
}

impl TrainParameters {
    /// Default parameters.
    pub const fn usual(features: FeatureKind) -> Self {
        Self {
            window: (24, 24),
            features,
            pool: 4000,
            stages: 17,
            bags: 1,
            stage: StageParameters {
                hit_rate: 0.995,
                false_alarm_rate: 0.5,
                max_trees: 100,
                learning_rate: 0.5,
                chained: true,
                tree: TreeParameters { max_depth: 2, min_leaf: 0.01, leaf_prior: 10.0, category_prior: 20.0 },
            },
            variants: 7,
            variation: Variation::USUAL,
            negatives: 8000,
            validation: 0.2,
            aim: Aim::AsTrained,
            early: 0.0,
            seed: 1,
            threads: 1,
        }
    }
}
