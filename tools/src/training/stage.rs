//! Training of one stage: Gentle AdaBoost adds trees until the false-alarm rate is low enough.

use super::features::{Codes, Sums};
use super::tree::{self, Child, FittedTree, TreeNode, TreeParameters, Weighted};
use perception::recognition::cascade::Features;

/// Stopping criteria of a stage, and parameters of its trees.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StageParameters {
    /// Share of the objects that the stage must accept.
    pub hit_rate: f64,
    /// Training stops when at most this share of the negatives is accepted.
    pub false_alarm_rate: f64,
    /// Maximum number of trees.
    pub max_trees: usize,
    /// Learning rate: weight of each tree.
    pub learning_rate: f64,
    /// Whether a stage starts with all trees of the previous one and adds its own.
    pub chained: bool,
    /// Parameters of the trees.
    pub tree: TreeParameters,
}

/// Samples of both classes.
#[derive(Clone, Copy, Debug)]
pub struct Samples<'a> {
    /// Objects.
    pub objects: &'a [Sums],
    /// Negatives.
    pub rest: &'a [Sums],
}

/// Training samples, quantised, with the objects first.
#[derive(Clone, Copy, Debug)]
pub struct CodedSamples<'a> {
    /// Candidate features.
    pub features: &'a Features,
    /// Their values.
    pub codes: &'a Codes,
    /// Number of objects.
    pub objects: usize,
}

/// Initial sums of the samples: those of the trees that a chained stage starts with.
#[derive(Clone, Debug, Default)]
pub struct InitialSums {
    /// Of the training samples.
    pub learned: Vec<f64>,
    /// Of the validation objects.
    pub judged_objects: Vec<f64>,
    /// Of the validation negatives.
    pub judged_rest: Vec<f64>,
}

/// A trained stage.
#[derive(Clone, Debug)]
pub struct TrainedStage {
    /// Trees over the candidate features.
    pub trees: Vec<Vec<TreeNode>>,
    /// Threshold: smaller sums are rejected.
    pub threshold: f32,
    /// Accepted shares of the validation objects and negatives.
    pub judged: (f64, f64),
    /// The same for the training samples.
    pub learned: (f64, f64),
    /// Sums of the validation objects.
    pub judged_sums: Vec<f64>,
    /// Sums of the training objects.
    pub learned_sums: Vec<f64>,
}

/// Evaluates a tree on a sample.
fn value(tree: &[TreeNode], features: &Features, sample: &Sums) -> f32 {
    let mut at = 0;
    loop {
        let node = &tree[at];
        let left = sample.goes_left(features, node.feature, &node.split);
        match node.children[usize::from(!left)] {
            Child::Node(next) => at = next,
            Child::Leaf(value) => return value,
        }
    }
}

/// The largest threshold that accepts `share` of the sums.
pub fn threshold_for(sums: &[f64], share: f64) -> f32 {
    let mut sorted = sums.to_vec();
    sorted.sort_unstable_by(f64::total_cmp);
    let refused = ((1.0 - share) * sorted.len() as f64 + 1e-9) as usize;
    sorted.get(refused).map_or(0.0, |&s| s as f32)
}

/// Whether a sum passes a threshold, with the detector's tolerance.
pub fn passes(sum: f64, threshold: f32) -> bool {
    sum >= f64::from(threshold - 1e-5)
}

fn share(sums: &[f64], threshold: f32) -> f64 {
    sums.iter().filter(|&&s| passes(s, threshold)).count() as f64 / sums.len().max(1) as f64
}

/// Trains a stage on `learned`; its threshold and stopping are decided on the validation samples `judges`. `each`
/// is called after each tree with the number of trees and the share of accepted validation negatives. `None` when
/// no feature separates the classes.
pub fn train(
    parameters: &StageParameters,
    learned: CodedSamples<'_>,
    judges: Samples<'_>,
    begin: InitialSums,
    threads: usize,
    each: &mut dyn FnMut(usize, f64),
) -> Option<TrainedStage> {
    let CodedSamples { features, codes, objects } = learned;
    let count = codes.samples();
    let mut sums = begin.learned;
    let (mut judged_objects, mut judged_rest) = (begin.judged_objects, begin.judged_rest);
    let weight = |i: usize, sum: f64| if i < objects { (-sum).exp() } else { sum.exp() };
    let mut weights: Vec<f64> = sums.iter().enumerate().map(|(i, &sum)| weight(i, sum)).collect();
    // Both classes get the same total weight.
    for class in [0..objects, objects..count] {
        let total: f64 = weights[class.clone()].iter().sum();
        let scale = 0.5 * count as f64 / total.max(f64::MIN_POSITIVE);
        weights[class].iter_mut().for_each(|w| *w *= scale);
    }
    let mut weights: Vec<f32> = weights.into_iter().map(|w| w as f32).collect();
    let mut trees = Vec::new();
    let mut threshold = 0.0;
    while trees.len() < parameters.max_trees {
        let Some(FittedTree { mut nodes, values }) =
            tree::fit(codes, Weighted { weights: &weights, objects }, parameters.tree, threads)
        else {
            break;
        };
        let rate = parameters.learning_rate as f32;
        for child in nodes.iter_mut().flat_map(|n| &mut n.children) {
            if let Child::Leaf(value) = child {
                *value *= rate;
            }
        }
        let mut total = 0.0_f64;
        for (i, ((sum, weight), value)) in sums.iter_mut().zip(&mut weights).zip(&values).enumerate() {
            let value = value * rate;
            *sum += f64::from(value);
            *weight *= if i < objects { (-value).exp() } else { value.exp() };
            total += f64::from(*weight);
        }
        let scale = (count as f64 / total) as f32;
        weights.iter_mut().for_each(|w| *w *= scale);
        for (sums, samples) in [(&mut judged_objects, judges.objects), (&mut judged_rest, judges.rest)] {
            for (sum, sample) in sums.iter_mut().zip(samples) {
                *sum += f64::from(value(&nodes, features, sample));
            }
        }
        trees.push(nodes);
        threshold = threshold_for(&judged_objects, parameters.hit_rate);
        let false_alarms = share(&judged_rest, threshold);
        each(trees.len(), false_alarms);
        if false_alarms <= parameters.false_alarm_rate {
            break;
        }
    }
    (!trees.is_empty()).then(|| TrainedStage {
        trees,
        threshold,
        judged: (share(&judged_objects, threshold), share(&judged_rest, threshold)),
        learned: (share(&sums[..objects], threshold), share(&sums[objects..], threshold)),
        judged_sums: judged_objects,
        learned_sums: sums[..objects].to_vec(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn thresholds_let_the_share_pass() {
        let sums: Vec<f64> = (0..200).map(|i| f64::from(i) / 10.0).collect();
        let threshold = threshold_for(&sums, 0.99);
        assert_eq!(threshold, 0.2);
        assert_eq!(share(&sums, threshold), 0.99);
        assert_eq!(share(&sums, threshold_for(&sums, 1.0)), 1.0);
        assert_eq!(threshold_for(&[], 0.9), 0.0);
    }
}
