//! Bagging: joins several cascades trained from different random numbers. Their errors are largely independent,
//! so the sum of their trees is wrong less often than each.

use super::features::{self, Sums};
use super::{stage, threads};
use perception::recognition::cascade::{Branch, Cascade, Node, Stage};

/// Sum of a stage's trees for a sample.
pub fn sum(cascade: &Cascade, stage: &Stage, sample: &Sums) -> f64 {
    let mut sum = 0.0;
    for tree in &stage.trees {
        let mut node = &tree[0];
        sum += loop {
            let left = sample.goes_left(&cascade.features, node.feature as usize, &node.split);
            match if left { node.left } else { node.right } {
                Branch::Leaf(value) => break f64::from(value),
                Branch::Node(next) => node = &tree[usize::from(next)],
            }
        };
    }
    sum
}

/// Sum minus threshold of a stage for a sample.
pub fn margin(cascade: &Cascade, stage: &Stage, sample: &Sums) -> f64 {
    sum(cascade, stage, sample) - f64::from(stage.threshold)
}

/// Margins of samples in each stage of a cascade.
pub fn margins(cascade: &Cascade, samples: &[Sums], threads: usize) -> Vec<Vec<f64>> {
    threads::map(threads, samples.len(), |i| {
        cascade.stages.iter().map(|stage| margin(cascade, stage, &samples[i])).collect()
    })
}

/// Joins cascades with chained stages: the stages of the first, which reject most windows early, then for each
/// other cascade one stage that adds the trees of its last stage and accepts the share `hit_rate` of the
/// validation `objects`. `None` for no cascades.
pub fn join(cascades: Vec<Cascade>, hit_rate: f64, objects: &[Sums]) -> Option<Cascade> {
    let mut cascades = cascades.into_iter();
    let mut joined = cascades.next()?;
    let passing = |joined: &Cascade, object: &&Sums| {
        joined.stages.iter().all(|stage| stage::passes(sum(joined, stage, object), stage.threshold))
    };
    let mut left: Vec<&Sums> = objects.iter().filter(|object| passing(&joined, object)).collect();
    for cascade in cascades {
        let (Some(before), Some(last)) = (joined.stages.last(), cascade.stages.last()) else { continue };
        let mut trees = before.trees.clone();
        for tree in &last.trees {
            let place = |node: &Node| {
                let feature = features::add(&mut joined.features, &cascade.features, node.feature as usize);
                Node { feature, ..*node }
            };
            trees.push(tree.iter().map(place).collect());
        }
        let mut stage = Stage { threshold: 0.0, trees };
        let sums: Vec<f64> = left.iter().map(|object| sum(&joined, &stage, object)).collect();
        stage.threshold = stage::threshold_for(&sums, hit_rate);
        let mut sums = sums.into_iter();
        left.retain(|_| sums.next().is_some_and(|sum| stage::passes(sum, stage.threshold)));
        joined.stages.push(stage);
    }
    Some(joined)
}

#[cfg(test)]
mod tests {
    use super::super::features::FeatureKind;
    use super::*;
    use perception::recognition::cascade::{Features, LbpFeature, Split};

    /// A cascade of one stage with one stump: `right` for windows whose feature has no bit of the right column.
    fn cascade(feature: LbpFeature, right: f32) -> Cascade {
        let mut words = [u32::MAX; 8];
        words[0] = 0;
        let node = Node {
            feature: 0,
            split: Split::Subset(words),
            left: Branch::Leaf(-1.0),
            right: Branch::Leaf(right),
        };
        let stage = Stage { threshold: -2.0, trees: vec![vec![node]] };
        Cascade { width: 9, height: 9, features: Features::Lbp(vec![feature]), stages: vec![stage] }
    }

    #[test]
    fn the_last_stage_sums_all_cascades_and_the_first_stays() {
        let feature = |x| LbpFeature { x, y: 0, width: 1, height: 1 };
        let samples: Vec<Sums> = (0..40_u64)
            .map(|seed| {
                let mut random = fastrand::Rng::with_seed(seed);
                let window: Vec<u8> = (0..81).map(|_| random.u8(..)).collect();
                Sums::of(&window, (9, 9), FeatureKind::Lbp)
            })
            .collect();
        // The last has the feature of the first.
        let parts = [cascade(feature(0), 2.0), cascade(feature(3), 3.0), cascade(feature(0), 5.0)];
        let joined = join(parts.to_vec(), 0.9, &samples).expect("a cascade");
        assert_eq!(joined.stages.iter().map(|s| s.trees.len()).collect::<Vec<_>>(), [1, 2, 3]);
        assert_eq!(joined.features.len(), 2);
        assert_eq!(joined.stages[0], parts[0].stages[0]);
        for sample in &samples {
            let each: f64 = parts.iter().map(|part| sum(part, &part.stages[0], sample)).sum();
            assert_eq!(sum(&joined, &joined.stages[2], sample), each);
        }
        let passes = |margins: &Vec<f64>| margins.iter().all(|&m| stage::passes(m, 0.0));
        let passed = margins(&joined, &samples, 2).iter().filter(|m| passes(m)).count();
        assert!((32..=40).contains(&passed), "{passed} of 40 pass two stages of 90 %");
        assert_eq!(join(parts[..1].to_vec(), 0.5, &samples), Some(parts[0].clone()));
        assert_eq!(join(Vec::new(), 0.5, &samples), None);
    }
}
