//! Regression trees fitted to weighted samples by histograms over their codes.

use super::features::Codes;
use super::threads;
use perception::recognition::cascade::Split;

/// Regularisation of a tree.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TreeParameters {
    /// Maximum depth.
    pub max_depth: u32,
    /// Minimum share of the total weight in a leaf.
    pub min_leaf: f64,
    /// Shrinkage of a leaf's mean towards 0, in samples of mean weight.
    pub leaf_prior: f64,
    /// Shrinkage of a category's mean towards that of its node, in samples of mean weight.
    pub category_prior: f64,
}

/// An inner node. Children are nodes (after their parent) or leaves.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TreeNode {
    /// Index of the feature.
    pub feature: usize,
    /// Split of its values.
    pub split: Split,
    /// Left and right child.
    pub children: [Child; 2],
}

/// A child.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Child {
    /// Index of an inner node.
    Node(usize),
    /// Value of a leaf.
    Leaf(f32),
}

/// A fitted tree with its value on each sample.
#[derive(Clone, Debug)]
pub struct FittedTree {
    /// Nodes, the root first.
    pub nodes: Vec<TreeNode>,
    /// One per sample.
    pub values: Vec<f32>,
}

/// Number of nodes split in one pass over the codes.
const SLOTS: usize = 7;

/// Histogram entries of a node: one half for objects, one for negatives.
const SLOT: usize = 512;

/// Entries of a histogram: all slots, and one more for samples in none.
const ENTRIES: usize = (SLOTS + 1) * SLOT;

/// Categories with similar means are grouped: number of bins from −1 to 1.
const STEPS: usize = 128;

/// A node to be split.
#[derive(Clone, Copy, Debug)]
struct Open {
    /// Weight of its objects and of its negatives.
    weight: [f64; 2],
    /// Parent and side; `None` for the root.
    parent: Option<(usize, usize)>,
}

/// The best split of a node by one feature.
#[derive(Clone, Copy, Debug)]
struct Candidate {
    gain: f64,
    feature: usize,
    left: [bool; 256],
    weight_left: [f64; 2],
}

/// Weighted samples; the first `objects` of them are objects.
#[derive(Clone, Copy, Debug)]
pub struct Weighted<'a> {
    /// One per sample.
    pub weights: &'a [f32],
    /// Number of objects.
    pub objects: usize,
}

struct Fit<'a> {
    codes: &'a Codes,
    samples: Weighted<'a>,
    least: f64,
    leaf_prior: f64,
    category_prior: f64,
}

/// Fits a tree to responses of 1 for objects and −1 for negatives; `None` when no feature separates them.
pub fn fit(
    codes: &Codes,
    samples: Weighted<'_>,
    parameters: TreeParameters,
    threads: usize,
) -> Option<FittedTree> {
    let weight_of =
        |range: std::ops::Range<usize>| -> f64 { samples.weights[range].iter().map(|&w| f64::from(w)).sum() };
    let total = [weight_of(0..samples.objects), weight_of(samples.objects..samples.weights.len())];
    let all = total[0] + total[1];
    let squares: f64 = samples.weights.iter().map(|&w| f64::from(w) * f64::from(w)).sum();
    // Effective sample size of the weights.
    let effective = all * all / squares.max(f64::MIN_POSITIVE);
    let fit = Fit {
        codes,
        samples,
        least: parameters.min_leaf * all,
        leaf_prior: parameters.leaf_prior * all / effective,
        category_prior: parameters.category_prior * all / effective,
    };
    let mut nodes: Vec<TreeNode> = Vec::new();
    // The slot of the open node of each sample, SLOTS for none.
    let mut slot = vec![0_u8; codes.samples()];
    let mut values = vec![fit.leaf(total); codes.samples()];
    let mut open = vec![Open { weight: total, parent: None }];
    for _ in 0..parameters.max_depth {
        let mut next = Vec::new();
        let mut next_slot = vec![u8::MAX; codes.samples()];
        // Samples in the slots of this pass only.
        for (pass, group) in open.chunks(SLOTS).enumerate() {
            let here = |slot: u8| usize::from(slot).checked_sub(pass * SLOTS).filter(|&s| s < group.len());
            let local: Vec<u16> = slot
                .iter()
                .enumerate()
                .map(|(i, &s)| {
                    let class = if i < samples.objects { 0 } else { 256 };
                    (here(s).unwrap_or(SLOTS) * SLOT + class) as u16
                })
                .collect();
            let best = fit.best_splits(group, &local, threads);
            for (s, (open, best)) in group.iter().zip(best).enumerate() {
                let Some(best) = best else { continue };
                let right = [open.weight[0] - best.weight_left[0], open.weight[1] - best.weight_left[1]];
                let leaves = [fit.leaf(best.weight_left), fit.leaf(right)];
                let index = nodes.len();
                nodes.push(TreeNode {
                    feature: best.feature,
                    split: codes.split(best.feature, &best.left),
                    children: [Child::Leaf(leaves[0]), Child::Leaf(leaves[1])],
                });
                if let Some((parent, side)) = open.parent {
                    nodes[parent].children[side] = Child::Node(index);
                }
                let first = next.len() as u8;
                next.push(Open { weight: best.weight_left, parent: Some((index, 0)) });
                next.push(Open { weight: right, parent: Some((index, 1)) });
                let row = codes.row(best.feature);
                for i in (0..slot.len()).filter(|&i| here(slot[i]) == Some(s)) {
                    let side = u8::from(!best.left[usize::from(row[i])]);
                    next_slot[i] = first + side;
                    values[i] = leaves[usize::from(side)];
                }
            }
        }
        if next.is_empty() {
            break;
        }
        (open, slot) = (next, next_slot);
    }
    (!nodes.is_empty()).then_some(FittedTree { nodes, values })
}

impl Fit<'_> {
    /// Value of a leaf with these weights.
    fn leaf(&self, [objects, rest]: [f64; 2]) -> f32 {
        ((objects - rest) / (objects + rest + self.leaf_prior).max(f64::MIN_POSITIVE)) as f32
    }

    /// Reduction of the squared error by a leaf.
    fn worth(&self, [objects, rest]: [f64; 2]) -> f64 {
        let sum = objects - rest;
        sum * sum / (objects + rest + self.leaf_prior).max(f64::MIN_POSITIVE)
    }

    fn best_splits(&self, open: &[Open], local: &[u16], threads: usize) -> Vec<Option<Candidate>> {
        const RUN: usize = 128;
        let features = self.codes.features();
        let runs = threads::map(threads, features.div_ceil(RUN), |run| {
            let mut best: Vec<Option<Candidate>> = vec![None; open.len()];
            let mut histograms = [vec![0.0_f32; ENTRIES], vec![0.0_f32; ENTRIES]];
            let range = run * RUN..features.min((run + 1) * RUN);
            for feature in range.clone().step_by(2) {
                let other = (feature + 1).min(range.end - 1);
                self.fill(&mut histograms, [feature, other], local, open.len());
                for (histogram, feature) in histograms.iter().zip([feature, other]) {
                    for (s, (best, node)) in best.iter_mut().zip(open).enumerate() {
                        let min_gain = best.map_or(1e-9, |b| b.gain);
                        let part = &histogram[s * SLOT..][..SLOT];
                        if let Some(found) = self.split(part, node, feature, min_gain) {
                            *best = Some(found);
                        }
                    }
                }
            }
            best
        });
        // Ties are resolved to the lowest feature, independently of threads.
        let mut best: Vec<Option<Candidate>> = vec![None; open.len()];
        for run in runs {
            for (best, found) in best.iter_mut().zip(run) {
                if let Some(found) = found
                    && best.is_none_or(|b| found.gain > b.gain)
                {
                    *best = Some(found);
                }
            }
        }
        best
    }

    /// Histograms of two features in one pass, so that their additions are independent.
    fn fill(&self, histograms: &mut [Vec<f32>; 2], features: [usize; 2], local: &[u16], slots: usize) {
        let [a, b] = histograms;
        a[..slots * SLOT].fill(0.0);
        b[..slots * SLOT].fill(0.0);
        let (Ok(a), Ok(b)) =
            (<&mut [f32; ENTRIES]>::try_from(&mut a[..]), <&mut [f32; ENTRIES]>::try_from(&mut b[..]))
        else {
            return;
        };
        let codes = self.codes.row(features[0]).iter().zip(self.codes.row(features[1]));
        for ((&weight, &local), (&x, &y)) in self.samples.weights.iter().zip(local).zip(codes) {
            a[(usize::from(local) + usize::from(x)) % ENTRIES] += weight;
            b[(usize::from(local) + usize::from(y)) % ENTRIES] += weight;
        }
    }

    /// The best split of a node by one feature, if its gain exceeds `min_gain`.
    fn split(&self, histogram: &[f32], node: &Open, feature: usize, min_gain: f64) -> Option<Candidate> {
        let (objects, rest) = histogram.split_at(256);
        let weight = |code: usize| [f64::from(objects[code]), f64::from(rest[code])];
        let whole = node.weight[0] + node.weight[1];
        let mean = (node.weight[0] - node.weight[1]) / whole.max(f64::MIN_POSITIVE);
        let worth = self.worth(node.weight);
        // Bin of each code: for ordered codes the code itself, for categories by their mean.
        let ordered = self.codes.ordered();
        let mut step_of = [0_u8; 256];
        let mut steps = [[0.0_f64; 2]; STEPS];
        for code in 0..if ordered { STEPS / 2 } else { 256 } {
            let [o, r] = weight(code);
            let step = if ordered {
                code
            } else {
                let shrunk = (o - r + self.category_prior * mean)
                    / (o + r + self.category_prior).max(f64::MIN_POSITIVE);
                ((shrunk + 1.0) * 0.5 * (STEPS - 1) as f64 + 0.5) as usize
            };
            step_of[code] = step as u8;
            let step = &mut steps[step % STEPS];
            step[0] += o;
            step[1] += r;
        }
        let mut best: Option<(f64, usize, [f64; 2])> = None;
        let mut left = [0.0; 2];
        for (i, step) in steps[..STEPS - 1].iter().enumerate() {
            if step[0] + step[1] <= 0.0 {
                continue;
            }
            left[0] += step[0];
            left[1] += step[1];
            let right = [node.weight[0] - left[0], node.weight[1] - left[1]];
            if left[0] + left[1] < self.least || right[0] + right[1] < self.least {
                continue;
            }
            let gain = self.worth(left) + self.worth(right) - worth;
            if gain > best.map_or(min_gain, |b| b.0) {
                best = Some((gain, i, left));
            }
        }
        let (gain, last, weight_left) = best?;
        let mut codes_left = [false; 256];
        for (is_left, &step) in codes_left.iter_mut().zip(&step_of) {
            *is_left = usize::from(step) <= last;
        }
        if ordered {
            codes_left[STEPS / 2..].fill(false);
        }
        Some(Candidate { gain, feature, left: codes_left, weight_left })
    }
}

#[cfg(test)]
mod tests {
    use super::super::features::FeatureKind::{Haar, Lbp};
    use super::super::features::Sums;
    use super::*;
    use perception::recognition::cascade::{Features, HaarFeature, LbpFeature, WeightedRect};

    const FREE: TreeParameters =
        TreeParameters { max_depth: 1, min_leaf: 0.0, leaf_prior: 0.0, category_prior: 0.0 };

    /// Windows of 6 × 6: objects are brighter on the left; a part of them only with `share`.
    fn samples(count: usize, haar: bool) -> Vec<Sums> {
        let mut random = fastrand::Rng::with_seed(8);
        (0..2 * count)
            .map(|i| {
                let bright = if i < count { 0 } else { 3 };
                let window: Vec<u8> = (0..36)
                    .map(
                        |p| if (p % 6) / 3 * 3 == bright { 150 + random.u8(..100) } else { random.u8(..100) },
                    )
                    .collect();
                Sums::of(&window, (6, 6), if haar { Haar } else { Lbp })
            })
            .collect()
    }

    #[test]
    fn a_stump_finds_what_tells_the_classes_apart() {
        for haar in [false, true] {
            let samples = samples(20, haar);
            let features = if haar {
                let rect = |x, width, weight| WeightedRect { x, y: 0, width, height: 6, weight };
                let feature = |x, weight| HaarFeature {
                    rects: [rect(0, 6, -1.0), rect(x, 3, weight), WeightedRect::default()],
                    tilted: false,
                };
                Features::Haar(vec![feature(1, 2.0), feature(3, 2.0)])
            } else {
                let feature = |y| LbpFeature { x: 0, y, width: 2, height: 1 };
                Features::Lbp(vec![feature(0), feature(2)])
            };
            let codes = Codes::new(&features, &samples, 1);
            let weights = vec![1.0; 40];
            let tree = fit(&codes, Weighted { weights: &weights, objects: 20 }, FREE, 1).expect("a tree");
            assert_eq!(tree.nodes.len(), 1);
            assert!(tree.values[..20].iter().all(|&v| v > 0.99), "{haar}");
            assert!(tree.values[20..].iter().all(|&v| v < -0.99), "{haar}");
            // The detector's decision gives the same leaf.
            let node = &tree.nodes[0];
            for (sample, &value) in samples.iter().zip(&tree.values) {
                let left = sample.goes_left(&features, node.feature, &node.split);
                assert_eq!(node.children[usize::from(!left)], Child::Leaf(value));
            }
        }
    }

    #[test]
    fn priors_and_least_leaves_hold_back() {
        let samples = samples(20, false);
        let features = Features::Lbp(vec![LbpFeature { x: 0, y: 1, width: 2, height: 1 }]);
        let codes = Codes::new(&features, &samples, 1);
        let weights = vec![0.5; 40];
        let fitted = |p| fit(&codes, Weighted { weights: &weights, objects: 20 }, p, 1);
        let free = fitted(FREE).expect("a tree").values[0];
        let shrunk = fitted(TreeParameters { leaf_prior: 20.0, ..FREE }).expect("a tree").values[0];
        // 20 samples against a prior of 20.
        assert!((shrunk - free / 2.0).abs() < 0.02, "{free} {shrunk}");
        assert!(fitted(TreeParameters { min_leaf: 0.6, ..FREE }).is_none());
    }

    #[test]
    fn deep_trees_are_the_same_on_any_number_of_threads() {
        let mut random = fastrand::Rng::with_seed(9);
        let samples: Vec<Sums> = (0..600)
            .map(|_| Sums::of(&(0..36).map(|_| random.u8(..)).collect::<Vec<u8>>(), (6, 6), Lbp))
            .collect();
        let features = Features::Lbp(super::super::features::all_lbp(6, 6));
        let codes = Codes::new(&features, &samples, 2);
        let weights: Vec<f32> = (0..600).map(|_| random.f32()).collect();
        let parameters = TreeParameters { max_depth: 5, ..FREE };
        let tree = |threads| fit(&codes, Weighted { weights: &weights, objects: 250 }, parameters, threads);
        let one = tree(1).expect("a tree");
        assert!(one.nodes.len() > 15, "{}", one.nodes.len());
        for threads in [2, 3] {
            let other = tree(threads).expect("a tree");
            assert_eq!((&other.nodes, &other.values), (&one.nodes, &one.values));
        }
        // Every sample ends where its decisions lead.
        for (sample, &value) in samples.iter().zip(&one.values) {
            let mut at = 0;
            let reached = loop {
                let node = &one.nodes[at];
                let left = sample.goes_left(&features, node.feature, &node.split);
                match node.children[usize::from(!left)] {
                    Child::Node(next) => at = next,
                    Child::Leaf(value) => break value,
                }
            };
            assert_eq!(reached, value);
        }
    }
}
