//! Confidence ranking: the error rate of the remaining estimates as the least confident ones are removed
//! (sparsification; Hu and Mordohai, "A Quantitative Evaluation of Confidence Measures for Stereo Vision",
//! 2012).

use super::percent;
use crate::reporting::picture::Picture;
use crate::reporting::plot::{self, Series};
use crate::reporting::record::tidy;
use serde::Serialize;
use std::fmt;

/// Densities of the curve: 5 %, 10 %, …, 100 %.
const STEPS: u64 = 20;

/// Counts estimates and outliers (errors above 3 px) by confidence.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Sparsification {
    count: [u64; 256],
    wrong: [u64; 256],
}

impl Default for Sparsification {
    fn default() -> Self {
        Self { count: [0; 256], wrong: [0; 256] }
    }
}

/// The ROC curve and its areas, all in percent.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Roc {
    /// Number of estimates counted.
    pub pixels: u64,
    /// Share of the estimates that are kept, by decreasing confidence.
    pub density_percent: Vec<f64>,
    /// Outliers (errors above 3 px) among the kept estimates.
    pub bad3_percent: Vec<f64>,
    /// The same for an optimal ranking.
    pub best_percent: Vec<f64>,
    /// Area under the curve: mean over densities by the trapezoidal rule, constant below 5 %.
    pub area_percent: f64,
    /// Area under the optimal curve.
    pub best_area_percent: f64,
    /// Area for an uninformative confidence: the share of outliers.
    pub random_area_percent: f64,
}

impl Sparsification {
    /// Counts the pixels of `mask` that have an estimate. All slices have one value per pixel, disparities in px,
    /// `estimate` negative where unknown.
    pub fn add(&mut self, truth: &[f32], mask: &[bool], estimate: &[f32], confidence: &[u8]) {
        for (((&g, &d), &c), _) in truth.iter().zip(estimate).zip(confidence).zip(mask).filter(|(_, m)| **m) {
            if d >= 0.0 {
                self.count[usize::from(c)] += 1;
                self.wrong[usize::from(c)] += u64::from((d - g).abs() > 3.0);
            }
        }
    }

    /// Outliers among the `kept` most confident estimates; ties are distributed evenly.
    fn wrong_of(&self, kept: f64) -> f64 {
        let (mut left, mut wrong) = (kept, 0.0);
        for (&n, &w) in self.count.iter().zip(&self.wrong).rev() {
            let taken = left.min(n as f64);
            if n > 0 {
                wrong += w as f64 * taken / n as f64;
            }
            left -= taken;
        }
        wrong
    }

    /// The curve; `None` when nothing was counted.
    pub fn curve(&self) -> Option<Roc> {
        let (pixels, wrong) = (self.count.iter().sum::<u64>(), self.wrong.iter().sum::<u64>());
        if pixels == 0 {
            return None;
        }
        let kept: Vec<f64> = (1..=STEPS).map(|k| (pixels * k) as f64 / STEPS as f64).collect();
        let curve = |wrong_of: &dyn Fn(f64) -> f64| -> Vec<f64> {
            kept.iter().map(|&n| 100.0 * wrong_of(n) / n).collect()
        };
        let right = (pixels - wrong) as f64;
        let (found, best) = (curve(&|n| self.wrong_of(n)), curve(&|n| (n - right).max(0.0)));
        let tidied = |values: &[f64]| values.iter().map(|&v| tidy(v)).collect();
        Some(Roc {
            pixels,
            density_percent: (1..=STEPS).map(|k| 100.0 * k as f64 / STEPS as f64).collect(),
            area_percent: tidy(area(&found)),
            best_area_percent: tidy(area(&best)),
            random_area_percent: tidy(percent(wrong, pixels)),
            bad3_percent: tidied(&found),
            best_percent: tidied(&best),
        })
    }
}

/// Area under a curve of equidistant values over the range [0, 1], constant before the first value.
fn area(values: &[f64]) -> f64 {
    let first = values.first().copied().unwrap_or(f64::NAN);
    let sum: f64 = values.windows(2).map(|pair| (pair[0] + pair[1]) / 2.0).sum();
    (first + sum) / values.len() as f64
}

impl Roc {
    /// Plots the curves.
    pub fn plot(&self) -> Picture {
        let series = |name: &str, values: &[f64]| Series {
            name: name.into(),
            points: self.density_percent.iter().copied().zip(values.iter().copied()).collect(),
        };
        let random = vec![self.random_area_percent; self.density_percent.len()];
        let series = [
            series("by confidence", &self.bad3_percent),
            series("optimal ranking", &self.best_percent),
            series("random ranking", &random),
        ];
        plot::lines("Estimates kept that are more than 3 px off", "% kept", "%", &series)
    }
}

/// A one-line summary.
impl fmt::Display for Roc {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "confidence ranking: area under the bad3 ROC {:.2} % (optimal {:.2} %, random {:.2} %; {} pixels)",
            self.area_percent, self.best_area_percent, self.random_area_percent, self.pixels
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_curve_is_that_of_a_sorted_list() {
        for seed in 0..10 {
            let mut random = fastrand::Rng::with_seed(seed);
            let n = 400;
            let truth = vec![10.0_f32; n];
            // Each confidence at most once: no ties.
            let mut order: Vec<u8> = (0..=255).collect();
            random.shuffle(&mut order);
            let confidence: Vec<u8> = (0..n).map(|i| order[i.min(255)]).collect();
            let mask: Vec<bool> = (0..n).map(|i| i < 200).collect();
            let estimate: Vec<f32> = (0..n).map(|_| if random.bool() { 10.5 } else { 14.0 }).collect();
            let mut counts = Sparsification::default();
            assert_eq!(counts.curve(), None);
            counts.add(&truth, &mask, &estimate, &confidence);
            let curve = counts.curve().unwrap();
            let mut sorted: Vec<(u8, bool)> = (0..200).map(|i| (confidence[i], estimate[i] > 13.0)).collect();
            sorted.sort_by_key(|pixel| std::cmp::Reverse(pixel.0));
            for (k, bad) in curve.bad3_percent.iter().enumerate() {
                let kept = 10 * (k + 1);
                let wrong = sorted[..kept].iter().filter(|s| s.1).count();
                assert!((bad - 100.0 * wrong as f64 / kept as f64).abs() < 1e-3, "seed {seed}, {kept} kept");
            }
            assert_eq!(curve.bad3_percent[19], curve.random_area_percent);
            assert_eq!(curve.best_percent[19], curve.random_area_percent);
            assert!(curve.best_area_percent <= curve.area_percent);
        }
    }

    #[test]
    fn confidence_that_knows_is_best_and_one_level_is_random() {
        let truth = vec![10.0_f32; 1000];
        let mask = vec![true; 1000];
        let estimate: Vec<f32> = (0..1000).map(|i| if i % 10 == 0 { 20.0 } else { 10.0 }).collect();
        let knows: Vec<u8> = (0..1000).map(|i| if i % 10 == 0 { 3 } else { 200 }).collect();
        let curve = |confidence: &[u8]| {
            let mut counts = Sparsification::default();
            counts.add(&truth, &mask, &estimate, confidence);
            counts.curve().unwrap()
        };
        let best = curve(&knows);
        assert_eq!((best.area_percent, best.random_area_percent), (best.best_area_percent, 10.0));
        // By hand: 0 up to 90 %, 5/95 at 95 %, 10 % at 100 %; trapezoids of width 0.05.
        let expected = 100.0 * 0.05 * ((5.0 / 95.0) + (5.0 / 95.0 + 0.1)) / 2.0;
        assert!((best.area_percent - expected).abs() < 1e-3, "{best:?}");
        let level = curve(&[7; 1000]);
        assert!((level.area_percent - 10.0).abs() < 1e-9);
        assert!(level.to_string().contains("area under the bad3 ROC"));
        assert!(level.plot().width() > 100);
    }
}
