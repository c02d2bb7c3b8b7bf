//! Reliability diagram: how often estimates are right, against the probability that is stated for them (Murphy and Winkler, 1977).

use super::roc::{Roc, Sparsification};
use crate::reporting::picture::Picture;
use crate::reporting::plot::{self, Series};
use crate::reporting::record::tidy;
use perception::stereo::reliability::{Reliability, scores};
use serde::Serialize;
use std::fmt;

/// Bounds of the error of a right estimate, in pixels.
const BOUNDS_PX: [f32; 2] = [1.0, 3.0];
/// Bins of the stated probability, and of the score.
const BINS: usize = 20;
const CLASSES: usize = 16;

/// Counts estimates, and those within each bound, by score.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ReliabilityCounts {
    count: [u64; 256],
    right: [[u64; 256]; 2],
    ranking: Sparsification,
}

impl Default for ReliabilityCounts {
    fn default() -> Self {
        Self { count: [0; 256], right: [[0; 256]; 2], ranking: Sparsification::default() }
    }
}

/// Estimates of similar stated probability.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Bin {
    /// Mean stated probability.
    pub stated: f64,
    /// Share that is right.
    pub right: f64,
    /// Estimates.
    pub pixels: u64,
}

/// Stated and true shares for one bound.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Diagram {
    /// Mean of |stated − true| over the estimates: the expected calibration error.
    pub error: f64,
    /// By stated probability.
    pub bins: Vec<Bin>,
}

/// Estimates of similar score, from which a table of probabilities can be made.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Class {
    /// Scores from this one on, to the next class.
    pub score: usize,
    /// Estimates.
    pub pixels: u64,
    /// Share within 1 px.
    pub within_1px: f64,
    /// Share within 3 px.
    pub within_3px: f64,
}

/// Ranking by score, and reliability of the stated probabilities.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ReliabilityReport {
    /// Ranking by score.
    pub roc: Roc,
    /// Within 1 px.
    pub within_1px: Diagram,
    /// Within 3 px.
    pub within_3px: Diagram,
    /// By score.
    pub classes: Vec<Class>,
}

fn share(part: u64, whole: u64) -> f64 {
    part as f64 / whole.max(1) as f64
}

impl ReliabilityCounts {
    /// Counts the pixels of `mask` that have an estimate. All slices have one value per pixel, disparities in px, `estimate` negative
    /// where unknown.
    pub fn add(&mut self, truth: &[f32], mask: &[bool], estimate: &[f32], confidence: &[u8], width: usize) {
        let scores = scores(confidence, width);
        self.ranking.add(truth, mask, estimate, &scores);
        for (((&g, &d), &score), _) in truth.iter().zip(estimate).zip(&scores).zip(mask).filter(|(_, m)| **m)
        {
            if d >= 0.0 {
                self.count[usize::from(score)] += 1;
                for (right, bound) in self.right.iter_mut().zip(BOUNDS_PX) {
                    right[usize::from(score)] += u64::from((d - g).abs() <= bound);
                }
            }
        }
    }

    fn diagram(&self, bound: usize) -> Diagram {
        let mut bins = [(0.0, 0_u64, 0_u64); BINS];
        for score in 0..=u8::MAX {
            let own = Reliability::of(score);
            let stated = f64::from([own.within_1px, own.within_3px][bound]);
            let bin = &mut bins[((stated * BINS as f64) as usize).min(BINS - 1)];
            let count = self.count[usize::from(score)];
            bin.0 += stated * count as f64;
            bin.1 += self.right[bound][usize::from(score)];
            bin.2 += count;
        }
        let bins: Vec<Bin> = bins
            .into_iter()
            .filter(|bin| bin.2 > 0)
            .map(|(stated, right, pixels)| Bin {
                stated: tidy(stated / pixels as f64),
                right: tidy(share(right, pixels)),
                pixels,
            })
            .collect();
        let whole: u64 = bins.iter().map(|bin| bin.pixels).sum();
        let off: f64 = bins.iter().map(|bin| (bin.stated - bin.right).abs() * bin.pixels as f64).sum();
        Diagram { error: tidy(off / whole.max(1) as f64), bins }
    }

    /// The report; `None` when nothing was counted.
    pub fn report(&self) -> Option<ReliabilityReport> {
        let class = |k: usize| {
            let scores = 256 / CLASSES * k..256 / CLASSES * (k + 1);
            let sum = |of: &[u64; 256]| of[scores.clone()].iter().sum::<u64>();
            let pixels = sum(&self.count);
            let right = |bound: usize| tidy(share(sum(&self.right[bound]), pixels));
            Class { score: scores.start, pixels, within_1px: right(0), within_3px: right(1) }
        };
        Some(ReliabilityReport {
            roc: self.ranking.curve()?,
            within_1px: self.diagram(0),
            within_3px: self.diagram(1),
            classes: (0..CLASSES).map(class).filter(|class| class.pixels > 0).collect(),
        })
    }
}

impl ReliabilityReport {
    /// Plots stated against true shares.
    pub fn plot(&self) -> Picture {
        let series = |name: &str, diagram: &Diagram| Series {
            name: format!("{name}, error {:.3}", diagram.error),
            points: diagram.bins.iter().map(|bin| (bin.stated, bin.right)).collect(),
        };
        let exact = Series { name: "exact".into(), points: vec![(0.0, 0.0), (1.0, 1.0)] };
        let series =
            [series("within 1 px", &self.within_1px), series("within 3 px", &self.within_3px), exact];
        plot::lines("Share of right estimates by stated probability", "stated", "true", &series)
    }
}

/// Two lines.
impl fmt::Display for ReliabilityReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(
            f,
            "by the score, which contains the confidence around a pixel: area under the bad3 ROC {:.2} %",
            self.roc.area_percent
        )?;
        write!(
            f,
            "stated probabilities: within 1 px off by {:.3} in the mean, within 3 px by {:.3}",
            self.within_1px.error, self.within_3px.error
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A map whose estimates are right as often as their probability says, times `factor`.
    fn counts(factor: f64) -> ReliabilityCounts {
        let mut random = fastrand::Rng::with_seed(5);
        let mut counts = ReliabilityCounts::default();
        for confidence in (20..=240).step_by(20) {
            let stated = Reliability::of(confidence);
            // Wide enough that most windows lie inside.
            let (width, n) = (200, 200 * 200);
            let estimate: Vec<f32> = (0..n)
                .map(|_| match random.f64() / factor {
                    r if r < f64::from(stated.within_1px) => 10.5,
                    r if r < f64::from(stated.within_3px) => 12.5,
                    _ => 30.0,
                })
                .collect();
            let mask: Vec<bool> =
                (0..n).map(|i| (7..193).contains(&(i % width)) && (7..193).contains(&(i / width))).collect();
            counts.add(&vec![10.0; n], &mask, &estimate, &vec![confidence; n], width);
        }
        counts
    }

    #[test]
    fn true_probabilities_have_no_error_and_others_have() {
        let report = counts(1.0).report().unwrap();
        assert!(report.within_1px.error < 0.01 && report.within_3px.error < 0.01, "{report}");
        let wrong = counts(0.8).report().unwrap();
        assert!((wrong.within_3px.error - 0.17).abs() < 0.03, "{wrong}");
        assert!(report.roc.area_percent < report.roc.random_area_percent);
        assert_eq!(report.classes.iter().map(|class| class.pixels).sum::<u64>(), 12 * 186 * 186);
        assert!(report.plot().width() > 100 && report.to_string().contains("within 3 px by"));
        assert_eq!(ReliabilityCounts::default().report(), None);
    }
}
