//! Final adjustment of a cascade's thresholds to a target hit rate or false-alarm rate.

use super::stage::{passes, threshold_for};
use perception::recognition::cascade::Stage;

/// Target of the whole cascade. The last stage is the most accurate, so its threshold is set to the target; the
/// earlier stages then reject hardly any validation objects that the last one accepts.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Aim {
    /// Thresholds remain as trained.
    AsTrained,
    /// The last stage accepts this share of the validation objects.
    HitRate(f64),
    /// The last stage accepts this share of the validation negatives.
    FalseAlarmRate(f64),
}

/// Margins of validation samples: sum minus threshold for each stage.
#[derive(Clone, Debug, Default)]
pub struct ValidationMargins {
    /// Objects without augmentation.
    pub objects: Vec<Vec<f64>>,
    /// Negatives without augmentation.
    pub rest: Vec<Vec<f64>>,
    /// Objects with augmentation: those that the last stage accepts determine the earlier stages.
    pub varied: Vec<Vec<f64>>,
}

/// Shifts the thresholds of `stages` to the target. Of the objects that the last stage accepts, the first stage
/// may reject the share `early`, decreasing to none for the last but one: early rejections save the most time.
pub fn finish(aim: Aim, early: f64, stages: &mut [Stage], judged: &ValidationMargins) {
    let Some((last, before)) = stages.split_last_mut() else { return };
    let of_last = |samples: &[Vec<f64>]| -> Vec<f64> {
        samples.iter().filter_map(|margins| margins.get(before.len()).copied()).collect()
    };
    let moved = match aim {
        Aim::AsTrained => None,
        Aim::HitRate(share) => {
            let objects = of_last(&judged.objects);
            (!objects.is_empty()).then(|| threshold_for(&objects, share))
        }
        Aim::FalseAlarmRate(share) => rejecting_threshold(of_last(&judged.rest), share),
    };
    let Some(moved) = moved else { return };
    let accepted: Vec<&Vec<f64>> = judged
        .varied
        .iter()
        .filter(|margins| margins.get(before.len()).is_some_and(|&margin| passes(margin, moved)))
        .collect();
    last.threshold += moved;
    if accepted.is_empty() {
        return;
    }
    let later = before.len().saturating_sub(1).max(1) as f64;
    for (i, stage) in before.iter_mut().enumerate() {
        let margins: Vec<f64> = accepted.iter().map(|margins| margins[i]).collect();
        stage.threshold += threshold_for(&margins, 1.0 - early * (1.0 - i as f64 / later));
    }
}

/// The threshold that accepts at most `share` of the sums, midway to the last accepted one; `None` when all may be
/// accepted.
fn rejecting_threshold(mut sums: Vec<f64>, share: f64) -> Option<f32> {
    sums.sort_unstable_by(|a, b| b.total_cmp(a));
    let passing = (share * sums.len() as f64 + 1e-9) as usize;
    let refused = *sums.get(passing)?;
    let passed = passing.checked_sub(1).map_or(refused, |i| sums[i]);
    Some(((refused + passed) / 2.0).max(refused + 1e-4) as f32)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn samples(margins: &[[f64; 2]]) -> Vec<Vec<f64>> {
        margins.iter().map(|m| m.to_vec()).collect()
    }

    fn thresholds(aim: Aim, early: f64, judged: &ValidationMargins) -> [f32; 2] {
        let mut stages = [1.0, 2.0].map(|threshold| Stage { threshold, trees: Vec::new() });
        finish(aim, early, &mut stages, judged);
        [stages[0].threshold, stages[1].threshold]
    }

    #[test]
    fn a_hit_rate_is_that_of_the_last_stage_and_those_before_let_its_objects_pass() {
        let mut judged = ValidationMargins {
            objects: samples(&[[0.5, 0.25], [-0.5, 0.125], [0.25, 0.375], [0.5, 0.75], [0.5, 1.0]]),
            ..ValidationMargins::default()
        };
        assert_eq!(thresholds(Aim::HitRate(0.8), 0.0, &judged), [1.0, 2.25]);
        assert_eq!(thresholds(Aim::AsTrained, 0.0, &judged), [1.0, 2.0]);
        judged.varied = judged.objects.clone();
        assert_eq!(thresholds(Aim::HitRate(0.8), 0.0, &judged), [1.25, 2.25]);
        // The first stage had rejected this one.
        assert_eq!(thresholds(Aim::HitRate(1.0), 0.0, &judged), [0.5, 2.125]);
        // It may reject one of five again.
        assert_eq!(thresholds(Aim::HitRate(1.0), 0.2, &judged), [1.25, 2.125]);
        assert_eq!(thresholds(Aim::HitRate(0.8), 0.0, &ValidationMargins::default()), [1.0, 2.0]);
    }

    #[test]
    fn a_false_alarm_rate_is_that_of_the_last_stage() {
        let mut judged = ValidationMargins {
            rest: samples(&[[0.0, -3.0], [0.0, -2.0], [-9.0, -1.0], [0.0, 0.5], [0.0, 1.0]]),
            ..ValidationMargins::default()
        };
        for (share, expected) in [(0.0, 0), (0.2, 1), (0.4, 2), (0.6, 3), (0.8, 4)] {
            let [first, last] = thresholds(Aim::FalseAlarmRate(share), 0.0, &judged);
            let passing = judged.rest.iter().filter(|m| passes(m[1], last - 2.0)).count();
            assert_eq!((first, passing), (1.0, expected), "{share}");
        }
        assert_eq!(thresholds(Aim::FalseAlarmRate(1.0), 0.0, &judged), [1.0, 2.0]);
        judged.varied = samples(&[[-0.5, 0.875], [0.25, 2.0], [-2.0, 0.5]]);
        assert_eq!(thresholds(Aim::FalseAlarmRate(0.2), 0.0, &judged), [0.5, 2.75]);
    }
}
