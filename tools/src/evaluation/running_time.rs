//! Running time of recognition compared with the paper: whole image against regions only.

use super::quantile;
use crate::reporting::record::{tidy, tidy_finite};
use perception::recognition::cascade::Features;
use serde::Serialize;
use std::fmt;

/// The paper's times (its table "running time"), in milliseconds: AdaBoost on the whole image, and its method on
/// regions with LBP and with Haar features.
pub const PAPER_SLIDING_MS: f64 = 35.0;
const PAPER_LBP_MS: f64 = 18.2;
const PAPER_HAAR_MS: f64 = 18.3;

/// Processor time of one image, in milliseconds.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PictureTimes {
    /// Sliding window over the whole image, with the paper's window sizes.
    pub sliding_ms: f64,
    /// The same in the crops of the regions.
    pub regions_ms: f64,
    /// In the crops, with only the two window sizes expected at the region's distance.
    pub expected_ms: f64,
}

/// A row of the table.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct RunningTime {
    /// File name of the cascade.
    pub cascade: String,
    /// `lbp` or `haar`.
    pub features: &'static str,
    /// Median time for the whole image, in ms.
    pub sliding_ms: Option<f64>,
    /// Median time for the regions with all window sizes, in ms.
    pub regions_ms: Option<f64>,
    /// Median time for the regions with the expected window sizes, in ms.
    pub expected_ms: Option<f64>,
    /// Median over the images of regions ÷ whole image.
    pub regions_ratio: Option<f64>,
    /// The paper's time on regions with such features, in ms.
    pub paper_regions_ms: f64,
}

/// Running times of several cascades.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct RunningTimes {
    /// Number of images.
    pub pictures: usize,
    /// Mean number of regions per image.
    pub regions: f64,
    /// The paper's time for the whole image, in ms.
    pub paper_sliding_ms: f64,
    /// One row per cascade.
    pub rows: Vec<RunningTime>,
}

impl RunningTime {
    /// Summarises the times of a cascade.
    pub fn new(cascade: &str, features: &Features, times: &[PictureTimes]) -> Self {
        let is_lbp = matches!(features, Features::Lbp(_));
        let of = |pick: fn(&PictureTimes) -> f64| {
            let mut values: Vec<f64> = times.iter().map(pick).collect();
            quantile(&mut values, 0.5).and_then(tidy_finite)
        };
        Self {
            cascade: cascade.to_owned(),
            features: if is_lbp { "lbp" } else { "haar" },
            sliding_ms: of(|t| t.sliding_ms),
            regions_ms: of(|t| t.regions_ms),
            expected_ms: of(|t| t.expected_ms),
            regions_ratio: of(|t| t.regions_ms / t.sliding_ms),
            paper_regions_ms: if is_lbp { PAPER_LBP_MS } else { PAPER_HAAR_MS },
        }
    }
}

impl RunningTimes {
    /// The table of several cascades.
    pub fn new(pictures: usize, regions: usize, rows: Vec<RunningTime>) -> Self {
        let regions = tidy(regions as f64 / pictures.max(1) as f64);
        Self { pictures, regions, paper_sliding_ms: PAPER_SLIDING_MS, rows }
    }
}

impl fmt::Display for RunningTimes {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let cell = |value: Option<f64>| value.map_or("-".into(), |v| format!("{v:.2}"));
        let width = self.rows.iter().map(|row| row.cascade.chars().count()).max().unwrap_or(0).max(7) + 1;
        writeln!(
            f,
            "{:<width$}{:>9}{:>12}{:>12}{:>9}{:>15}{:>14}{:>12}",
            "cascade",
            "features",
            "picture ms",
            "regions ms",
            "ratio",
            "expected size",
            "paper: whole",
            "in regions"
        )?;
        for row in &self.rows {
            writeln!(
                f,
                "{:<width$}{:>9}{:>12}{:>12}{:>9}{:>15}{:>14.1}{:>12.1}",
                row.cascade,
                row.features,
                cell(row.sliding_ms),
                cell(row.regions_ms),
                cell(row.regions_ratio),
                cell(row.expected_ms),
                self.paper_sliding_ms,
                row.paper_regions_ms
            )?;
        }
        write!(
            f,
            "\n{} images, {:.1} regions each; medians, processor time of one thread; the paper's times were measured on its board",
            self.pictures, self.regions
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_are_medians_beside_the_papers_times() {
        let times = [(9.0, 3.0), (10.0, 2.0), (50.0, 4.0)];
        let times =
            times.map(|(sliding_ms, regions_ms)| PictureTimes { sliding_ms, regions_ms, expected_ms: 1.0 });
        let row = RunningTime::new("mine.xml", &Features::Lbp(Vec::new()), &times);
        assert_eq!((row.features, row.sliding_ms, row.regions_ms), ("lbp", Some(10.0), Some(3.0)));
        assert_eq!((row.regions_ratio, row.paper_regions_ms), (Some(0.2), 18.2));
        let haar = RunningTime::new("vehicle", &Features::Haar(Vec::new()), &[]);
        assert_eq!((haar.sliding_ms, haar.paper_regions_ms), (None, 18.3));
        let text = RunningTimes::new(3, 12, vec![row, haar]).to_string();
        assert!(
            text.contains("mine.xml") && text.contains("4.0 regions each") && text.contains("35.0"),
            "{text}"
        );
    }
}
