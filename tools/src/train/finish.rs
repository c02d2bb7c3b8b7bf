//! Where a trained cascade draws the line: its thresholds, moved to the share of objects or of the rest that is
//! wanted of the whole.

use super::stage::{passes, threshold_for};
use perception::recognition::cascade::Stage;

/// What is wanted of the whole cascade.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Aim {
    /// Thresholds stay as the stages set them.
    AsTrained,
    /// This share of the judging objects passes: all thresholds are moved together.
    HitRate(f64),
    /// This share of the judging rest passes the last stage, which knows most; the stages before refuse hardly
    /// any object that it would let pass.
    FalseAlarmRate(f64),
}

/// Share of the objects that pass the last stage that each stage before lets pass.
const KEPT: f64 = 0.998;

/// Moves the thresholds of `stages` to the aim, judged by samples: how far each lies above each threshold.
pub fn finish(aim: Aim, stages: &mut [Stage], objects: &[Vec<f64>], rest: &[Vec<f64>]) {
    let Some((last, before)) = stages.split_last_mut() else { return };
    match aim {
        Aim::HitRate(share) if !objects.is_empty() => {
            let least: Vec<f64> =
                objects.iter().map(|margins| margins.iter().copied().fold(f64::INFINITY, f64::min)).collect();
            let moved = threshold_for(&least, share);
            before.iter_mut().chain([last]).for_each(|stage| stage.threshold += moved);
        }
        Aim::FalseAlarmRate(share) => {
            let of = |margins: &Vec<f64>| margins.get(before.len()).copied();
            let mut alarms: Vec<f64> = rest.iter().filter_map(of).collect();
            alarms.sort_unstable_by(|a, b| b.total_cmp(a));
            let passing = (share * alarms.len() as f64 + 1e-9) as usize;
            let Some(&refused) = alarms.get(passing) else { return };
            // Half way between the last that may pass and the first that may not.
            let passed = passing.checked_sub(1).map_or(refused, |i| alarms[i]);
            let moved = ((refused + passed) / 2.0).max(refused + 1e-4) as f32;
            last.threshold += moved;
            let accepted: Vec<&Vec<f64>> =
                objects.iter().filter(|m| of(m).is_some_and(|margin| passes(margin, moved))).collect();
            if accepted.is_empty() {
                return;
            }
            for (i, stage) in before.iter_mut().enumerate() {
                let margins: Vec<f64> = accepted.iter().map(|m| m[i]).collect();
                stage.threshold += threshold_for(&margins, KEPT);
            }
        }
        _ => {}
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn thresholds(aim: Aim, objects: &[Vec<f64>], rest: &[Vec<f64>]) -> [f32; 2] {
        let mut stages = [1.0, 2.0].map(|threshold| Stage { threshold, trees: Vec::new() });
        finish(aim, &mut stages, objects, rest);
        [stages[0].threshold, stages[1].threshold]
    }

    fn samples(margins: &[[f64; 2]]) -> Vec<Vec<f64>> {
        margins.iter().map(|m| m.to_vec()).collect()
    }

    #[test]
    fn a_hit_rate_moves_all_thresholds() {
        let objects = samples(&[[0.5, 0.25], [0.5, 0.125], [0.5, 0.375], [0.5, 0.75], [0.5, 1.0]]);
        assert_eq!(thresholds(Aim::HitRate(0.8), &objects, &[]), [1.25, 2.25]);
        // Two of five are held back by the stage before.
        assert_eq!(thresholds(Aim::HitRate(0.4), &objects, &[]), [1.5, 2.5]);
        assert_eq!(thresholds(Aim::HitRate(0.8), &[], &objects), [1.0, 2.0]);
        assert_eq!(thresholds(Aim::AsTrained, &objects, &objects), [1.0, 2.0]);
    }

    #[test]
    fn a_false_alarm_rate_moves_the_last_threshold_and_frees_its_objects() {
        let rest = samples(&[[0.0, -3.0], [0.0, -2.0], [-9.0, -1.0], [0.0, 0.5], [0.0, 1.0]]);
        for (share, expected) in [(0.0, 0), (0.2, 1), (0.4, 2), (0.6, 3), (0.8, 4)] {
            let [first, last] = thresholds(Aim::FalseAlarmRate(share), &[], &rest);
            let passing = rest.iter().filter(|m| passes(m[1], last - 2.0)).count();
            assert_eq!((first, passing), (1.0, expected), "{share}");
        }
        assert_eq!(thresholds(Aim::FalseAlarmRate(1.0), &[], &rest), [1.0, 2.0]);
        // The first stage refused an object that the last knows, and let one pass that the last does not.
        let objects = samples(&[[-0.5, 0.875], [0.25, 2.0], [-2.0, 0.5]]);
        assert_eq!(thresholds(Aim::FalseAlarmRate(0.2), &objects, &rest), [0.5, 2.75]);
    }
}
