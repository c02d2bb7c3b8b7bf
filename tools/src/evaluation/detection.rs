//! A cascade judged on patches: each is brought to the size of the window and classified.

use crate::training::augment::{Part, Sampling, window};
use crate::training::bags;
use crate::training::features::Sums;
use crate::training::pictures::SourcePicture;
use crate::training::threads;
use crate::training::{FeatureKind, TrainError};
use perception::recognition::cascade::Cascade;
use serde::Serialize;

/// One patch's way through a cascade.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Verdict {
    /// Least of the stages' sums over their thresholds: the patch is a hit when this is not below
    /// 0, and would be when all thresholds were higher by as much.
    pub margin: f64,
    /// Stages passed before the first that refused it.
    pub stages: usize,
}

impl Verdict {
    /// Whether it passes all stages, with all thresholds higher by `moved`.
    pub fn hit(&self, moved: f64) -> bool {
        self.margin >= moved - 1e-5
    }
}

/// A point of the ROC: all thresholds higher by `moved`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct RocPoint {
    /// Added to each stage's threshold.
    pub moved: f64,
    /// Share of the objects found.
    pub hit_rate: f64,
    /// Share of the rest taken for objects.
    pub false_alarm_rate: f64,
}

/// Figures of a cascade on patches.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct DetectionReport {
    /// Patches with an object.
    pub positives: usize,
    /// Patches without.
    pub negatives: usize,
    /// Objects found.
    pub hits: usize,
    /// Others taken for objects.
    pub false_alarms: usize,
    /// Share of the objects found.
    pub hit_rate: f64,
    /// Share of the rest taken for objects.
    pub false_alarm_rate: f64,
    /// Mean of the shares of objects and of the rest that are judged right.
    pub balanced_accuracy: f64,
    /// The largest hit rate at a false-alarm rate of at most 1 % and 2 %, all thresholds moved together.
    pub hit_rate_at_1_percent: f64,
    /// The same at 2 %.
    pub hit_rate_at_2_percent: f64,
    /// Area under the ROC.
    pub area: f64,
    /// The figures with only the first stages, one after the other.
    pub stages: Vec<RocPoint>,
    /// From the strictest to the most lenient, thinned out.
    pub roc: Vec<RocPoint>,
}

/// Points of the ROC that are kept.
const POINTS: usize = 200;

/// The verdict on a window that was brought to the cascade's size.
pub fn judge(cascade: &Cascade, pixels: &[u8]) -> Verdict {
    let kind = FeatureKind::of(&cascade.features);
    let sample = Sums::of(pixels, (cascade.width, cascade.height), kind);
    if !sample.sound {
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

/// The verdicts on pictures, each resized by area to the cascade's window.
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

/// Figures of verdicts on patches with and without an object; `stages` is how many the cascade has.
///
/// # Errors
/// When there are none of either.
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
        // Without a false alarm two of four are found.
        assert_eq!(report.hit_rate_at_2_percent, 0.5);
        // Pairs in the right order: 5 + 5 + 4 + 4 of 20.
        assert!((report.area - 0.9).abs() < 1e-12, "{}", report.area);
        assert_eq!(report.stages[0].false_alarm_rate, 1.0);
        assert!(super::report(&positives, &[], 2).is_err());
    }
}
