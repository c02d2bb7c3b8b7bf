//! Parameters of the trainer and their defaults.

use super::augment::Variation;
use super::features::FeatureKind;
use super::finish::Aim;
use super::stage::StageParameters;
use super::tree::TreeParameters;

/// How a cascade is trained.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TrainParameters {
    /// Width and height of the window, in pixels.
    pub window: (u16, u16),
    /// Features.
    pub features: FeatureKind,
    /// Features that a stage chooses from, drawn anew for each; all when there are no more.
    pub pool: usize,
    /// Stages.
    pub stages: usize,
    /// Cascades that are trained and joined, each with random numbers of its own.
    pub bags: usize,
    /// How a stage is trained.
    pub stage: StageParameters,
    /// Varied windows made of each object, besides the object as it is.
    pub variants: usize,
    /// How they are varied.
    pub variation: Variation,
    /// Windows without objects that each stage learns from.
    pub negatives: usize,
    /// Share of each folder's pictures that judge and are not learned from; with 0 the samples
    /// that are learned from judge themselves.
    pub validation: f64,
    /// What is wanted of the whole cascade, judged by the pictures that are filled by an object and patches
    /// without (windows where there are no patches).
    pub aim: Aim,
    /// With an aim: share of the objects that the last stage lets pass that the first may refuse.
    pub early: f64,
    /// Random numbers come from this.
    pub seed: u64,
    /// Threads; the result is the same for any number.
    pub threads: usize,
}

impl TrainParameters {
    /// What the trainer does unless told otherwise.
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
