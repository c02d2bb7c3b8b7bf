//! Evaluates a cascade on patches, each resized to the window and classified.

use crate::training::augment::{Part, Sampling, window};
use crate::training::bags;
use crate::training::features::Sums;
use crate::training::pictures::SourcePicture;
use crate::training::threads;
use crate::training::{FeatureKind, TrainError};
use perception::recognition::cascade::Cascade;
use serde::Serialize;

/// Result of a cascade on one patch.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Verdict {
    /// Minimum over the stages of sum minus threshold. The patch is accepted when this is not negative; raising
    /// all thresholds by this amount keeps it accepted.
    pub margin: f64,
    /// Number of stages passed before the first rejection.
    pub stages: usize,
}

impl Verdict {
    /// Whether it passes all stages with all thresholds raised by `moved`.
    pub fn hit(&self, moved: f64) -> bool {
        self.margin >= moved - 1e-5
    }
}

/// A point of the ROC, with all thresholds raised by `moved`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct RocPoint {
    /// Offset added to each stage's threshold.
    pub moved: f64,
    /// Share of the positives accepted.
    pub hit_rate: f64,
    /// Share of the negatives accepted.
    pub false_alarm_rate: f64,
}

/// Detection statistics of a cascade on patches.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct DetectionReport {
    /// Number of positives (patches with an object).
    pub positives: usize,
    /// Number of negatives (patches without).
    pub negatives: usize,
    /// Accepted positives.
    pub hits: usize,
    /// Accepted negatives.
    pub false_alarms: usize,
    /// Share of the positives accepted.
    pub hit_rate: f64,
    /// Share of the negatives accepted.
    pub false_alarm_rate: f64,
    /// Mean of the correctly classified shares of positives and negatives.
    pub balanced_accuracy: f64,
    /// Largest hit rate at a false-alarm rate of at most 1 %, with all thresholds shifted together.
    pub hit_rate_at_1_percent: f64,
    /// The same at 2 %.
    pub hit_rate_at_2_percent: f64,
    /// Area under the ROC curve.
    pub area: f64,
    /// Rates after the first stage, the first two stages, and so on.
    pub stages: Vec<RocPoint>,
    /// ROC from the strictest to the most lenient threshold, thinned out.
    pub roc: Vec<RocPoint>,
}

/// Number of ROC points kept.
const POINTS: usize = 200;

/// Classifies a window of the cascade's size.
pub fn judge(cascade: &Cascade, pixels: &[u8]) -> Verdict {
    let kind = FeatureKind::of(&cascade.features);
    let sample = Sums::of(pixels, (cascade.width, cascade.height), kind);
    if !sample.is_valid {
        return Verdict { margin: f64::NEG_INFINITY, stages: 0 };
    }
    let mut verdict = Verdict { margin: f64::INFINITY, stages: 0 };
    for stage in &cascade.stages {
        let margin = bags::margin(cascade, stage, &sample);
        verdict.margin = verdict.margin.min(margin);
        if verdict.margin >= -1e-5 {
            verdict.stages += 1;
        }
    }
    verdict
}

/// Classifies images, each resized by area averaging to the cascade's window.
pub fn judge_all(cascade: &Cascade, pictures: &[SourcePicture], threads: usize) -> Vec<Verdict> {
    let size = (usize::from(cascade.width), usize::from(cascade.height));
    threads::map(threads, pictures.len(), |i| {
        let view = pictures[i].grey.view();
        let mut pixels = Vec::new();
        window(view, Part::whole(view), Sampling::Area, size, &mut pixels);
        judge(cascade, &pixels)
    })
}

fn share(verdicts: &[Verdict], passes: impl Fn(&Verdict) -> bool) -> f64 {
    verdicts.iter().filter(|v| passes(v)).count() as f64 / verdicts.len().max(1) as f64
}

/// Statistics of the results on positives and negatives; `stages` is the number of stages of the cascade.
///
/// # Errors
/// When there are no positives or no negatives.
pub fn report(
    positives: &[Verdict],
    negatives: &[Verdict],
    stages: usize,
) -> Result<DetectionReport, TrainError> {
    if positives.is_empty() || negatives.is_empty() {
        return Err(TrainError::Data("patches with and without objects are needed".into()));
    }
    let point = |moved: f64| RocPoint {
        moved,
        hit_rate: share(positives, |v| v.hit(moved)),
        false_alarm_rate: share(negatives, |v| v.hit(moved)),
    };
    let mut margins: Vec<f64> = positives.iter().chain(negatives).map(|v| v.margin).collect();
    margins.retain(|m| m.is_finite());
    margins.sort_unstable_by(|a, b| b.total_cmp(a));
    margins.dedup();
    let full: Vec<RocPoint> = margins.iter().map(|&m| point(m)).collect();
    let at = |most: f64| {
        full.iter().filter(|p| p.false_alarm_rate <= most).map(|p| p.hit_rate).fold(0.0, f64::max)
    };
    let mut area = 0.0;
    let mut last = (0.0, 0.0);
    for p in full.iter().map(|p| (p.false_alarm_rate, p.hit_rate)).chain([(1.0, 1.0)]) {
        area += (p.0 - last.0) * (p.1 + last.1) / 2.0;
        last = p;
    }
    let own = point(0.0);
    let count = |verdicts: &[Verdict]| verdicts.iter().filter(|v| v.hit(0.0)).count();
    let stages = (1..=stages)
        .map(|n| RocPoint {
            moved: 0.0,
            hit_rate: share(positives, |v| v.stages >= n),
            false_alarm_rate: share(negatives, |v| v.stages >= n),
        })
        .collect();
    Ok(DetectionReport {
        positives: positives.len(),
        negatives: negatives.len(),
        hits: count(positives),
        false_alarms: count(negatives),
        hit_rate: own.hit_rate,
        false_alarm_rate: own.false_alarm_rate,
        balanced_accuracy: (own.hit_rate + 1.0 - own.false_alarm_rate) / 2.0,
        hit_rate_at_1_percent: at(0.01),
        hit_rate_at_2_percent: at(0.02),
        area,
        stages,
        roc: full.iter().step_by(full.len().div_ceil(POINTS).max(1)).copied().collect(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn verdicts(margins: &[f64]) -> Vec<Verdict> {
        margins.iter().map(|&margin| Verdict { margin, stages: if margin >= 0.0 { 2 } else { 1 } }).collect()
    }

    #[test]
    fn figures_are_counted() {
        let positives = verdicts(&[0.5, 0.4, 0.1, -0.2]);
        let negatives = verdicts(&[0.2, -0.3, -0.4, -0.5, f64::NEG_INFINITY]);
        let report = report(&positives, &negatives, 2).expect("a report");
        assert_eq!((report.hits, report.false_alarms), (3, 1));
        assert_eq!((report.hit_rate, report.false_alarm_rate), (0.75, 0.2));
        assert!((report.balanced_accuracy - 0.775).abs() < 1e-12);
        // Two of four objects are detected without a false alarm.
        assert_eq!(report.hit_rate_at_2_percent, 0.5);
        // Correctly ordered pairs: 5 + 5 + 4 + 4 of 20.
        assert!((report.area - 0.9).abs() < 1e-12, "{}", report.area);
        assert_eq!(report.stages[0].false_alarm_rate, 1.0);
        assert!(super::report(&positives, &[], 2).is_err());
    }
}
