//! Result of a stereo evaluation, as text table and JSON document.

use super::bias::RangeErrors;
use super::reliability::ReliabilityReport;
use super::roc::Roc;
use super::score::{COLUMNS, Scores, mean};
use super::subpixel::Subpixel;
use crate::reporting::record::tidy;
use perception::stereo::epipolar::field::RowField;
use serde::Serialize;
use sources::truth::Region;
use std::collections::BTreeMap;
use std::fmt;

/// Scores of one image and region.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Row {
    /// Name of the pair within its set.
    pub name: String,
    /// `all` or `noc`.
    pub region: &'static str,
    /// Scores, flattened under their names.
    #[serde(flatten)]
    pub scores: Scores,
    /// Processor time of the matcher, median of its runs, in ms; `None` for given maps.
    pub cpu_ms: Option<f64>,
    /// By how much the rows of the right image were corrected; `None` if they were not.
    pub rows_corrected: Option<RowsCorrected>,
}

/// Vertical offset of the right image that was corrected, in pixels; positive is lower in the right image.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct RowsCorrected {
    /// Offset in the middle of the image.
    pub offset_px: f64,
    /// Change from the middle to the right border.
    pub across_px: f64,
    /// Change from the middle to the lower border.
    pub down_px: f64,
}

impl From<RowField> for RowsCorrected {
    fn from(field: RowField) -> Self {
        let RowField { offset_px, across_px, down_px } = field;
        let [offset_px, across_px, down_px] = [offset_px, across_px, down_px].map(tidy);
        Self { offset_px, across_px, down_px }
    }
}

impl fmt::Display for RowsCorrected {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { offset_px, across_px, down_px } = self;
        write!(
            f,
            "{offset_px:+.2} px in the middle, {across_px:+.2} px more at the right border, {down_px:+.2} px more at the lower one"
        )
    }
}

/// Mean over the images of a set with ground truth in a region.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Mean {
    /// Number of images.
    pub images: usize,
    /// Mean of each score over the images that have it.
    #[serde(flatten)]
    pub scores: Scores,
    /// Mean processor time in ms.
    pub cpu_ms: Option<f64>,
}

/// One data set.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct SetReport {
    /// Name of the given folder.
    pub set: String,
    /// Number of skipped pairs, which have no map.
    pub left_out: usize,
    /// Number of skipped pairs of which a picture or a map of the ground truth cannot be decoded.
    pub unreadable: u64,
    /// Sorted by region, then by pair.
    pub rows: Vec<Row>,
    /// By region.
    pub mean: BTreeMap<&'static str, Mean>,
}

impl SetReport {
    /// Sorts the rows by region and computes the means.
    pub fn new(set: String, mut rows: Vec<Row>, left_out: usize, unreadable: u64) -> Self {
        let order = [Region::All.name(), Region::Noc.name()];
        rows.sort_by_key(|row| order.iter().position(|name| *name == row.region));
        let mut means = BTreeMap::new();
        for region in order {
            let of_region = || rows.iter().filter(|row| row.region == region);
            let times: Vec<f64> = of_region().filter_map(|row| row.cpu_ms).collect();
            let images = of_region().count();
            if images > 0 {
                let cpu_ms =
                    (!times.is_empty()).then(|| tidy(times.iter().sum::<f64>() / times.len() as f64));
                let scores = mean(of_region().map(|row| &row.scores));
                means.insert(region, Mean { images, scores, cpu_ms });
            }
        }
        Self { set, left_out, unreadable, rows, mean: means }
    }
}

/// A whole stereo evaluation.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct StereoReport {
    /// Name of the matcher, or `maps`.
    pub method: String,
    /// Disparity search range; `None` for given maps.
    pub disparities: Option<usize>,
    /// Selection of pairs: `all`, `odd` or `even`.
    pub pairs: String,
    /// Disturbance of the right images.
    pub disturb: Option<&'static str>,
    /// Whether misaligned rows of the right images were corrected, by the matches of each pair.
    pub correct_rows: bool,
    /// Runs per pair.
    pub repeat: u32,
    /// Workspace of the largest matcher, in bytes; `None` for given maps.
    pub workspace_bytes: Option<usize>,
    /// Data sets.
    pub sets: Vec<SetReport>,
    /// Confidence ranking over the pixels of all sets (`noc` where a set has it, else `all`); `None` for given
    /// maps.
    pub roc: Option<Roc>,
    /// The same by score, and how far stated probabilities are off, over the same pixels.
    pub reliability: Option<ReliabilityReport>,
    /// Bias and spread by range and kind of surface, over the same pixels.
    pub by_range: Vec<RangeErrors>,
    /// Pixel-locking bias over the same pixels of the images with sub-pixel ground truth.
    pub subpixel: Option<Subpixel>,
}

/// A table cell; a dash for a missing value.
fn cell(value: Option<f64>, decimals: usize) -> String {
    value.filter(|v| v.is_finite()).map_or("-".into(), |v| format!("{v:.decimals$}"))
}

fn line(
    f: &mut fmt::Formatter<'_>,
    name: &str,
    width: usize,
    region: &str,
    scores: &Scores,
    cpu_ms: Option<f64>,
) -> fmt::Result {
    write!(f, "{name:<width$} {region:<6}")?;
    for value in scores.values() {
        write!(f, "{:>8}", cell(Some(value), 2))?;
    }
    writeln!(f, "{:>8}", cell(cpu_ms, 1))
}

impl SetReport {
    /// How many pairs had their rows corrected, and by how much: the mean, and the smallest and largest offset in the middle.
    fn rows_corrected(&self) -> String {
        // A pair has a row for each region.
        let of_pairs: BTreeMap<&str, Option<RowsCorrected>> =
            self.rows.iter().map(|row| (row.name.as_str(), row.rows_corrected)).collect();
        let corrected: Vec<RowsCorrected> = of_pairs.values().flatten().copied().collect();
        let text = format!("rows corrected in {} of {} pairs", corrected.len(), of_pairs.len());
        if corrected.is_empty() {
            return text;
        }
        let mean = |value: fn(&RowsCorrected) -> f64| {
            corrected.iter().map(value).sum::<f64>() / corrected.len() as f64
        };
        let mean = RowsCorrected {
            offset_px: mean(|rows| rows.offset_px),
            across_px: mean(|rows| rows.across_px),
            down_px: mean(|rows| rows.down_px),
        };
        let offsets = || corrected.iter().map(|rows| rows.offset_px);
        let (least, most) =
            (offsets().fold(f64::INFINITY, f64::min), offsets().fold(f64::NEG_INFINITY, f64::max));
        format!("{text}, by {mean} in the mean; {least:+.2} to {most:+.2} px in the middle")
    }
}

/// The tables, then the diagnostics.
impl fmt::Display for StereoReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let names = self.sets.iter().flat_map(|set| &set.rows).map(|row| row.name.chars().count());
        let width = names.max().unwrap_or(0).max(16);
        for set in &self.sets {
            writeln!(f, "{}", set.set)?;
            write!(f, "{:<width$} {:<6}", "pair", "region")?;
            for name in COLUMNS.iter().chain(&["ms"]) {
                write!(f, "{name:>8}")?;
            }
            writeln!(f)?;
            for (&region, mean) in &set.mean {
                for row in set.rows.iter().filter(|row| row.region == region) {
                    line(f, &row.name, width, region, &row.scores, row.cpu_ms)?;
                }
                let name = format!("mean of {}", mean.images);
                line(f, &name, width, region, &mean.scores, mean.cpu_ms)?;
            }
            if set.left_out > 0 {
                writeln!(f, "{} pairs have no map and were skipped", set.left_out)?;
            }
            if set.unreadable > 0 {
                writeln!(f, "unreadable pairs, skipped: {}; --strict stops there", set.unreadable)?;
            }
            if self.correct_rows {
                writeln!(f, "{}", set.rows_corrected())?;
            }
            writeln!(f)?;
        }
        match &self.subpixel {
            Some(subpixel) => writeln!(f, "{subpixel}")?,
            None => writeln!(
                f,
                "sub-pixel: pixel-locking bias not available: no estimate within 1 px of ground truth with sub-pixel values"
            )?,
        }
        for range in &self.by_range {
            writeln!(f, "{range}")?;
        }
        if let Some(roc) = &self.roc {
            writeln!(f, "{roc}")?;
        }
        if let Some(reliability) = &self.reliability {
            writeln!(f, "{reliability}")?;
        }
        write!(f, "method: {}", self.method)?;
        if let Some(disparities) = self.disparities {
            write!(f, ", {disparities} disparities")?;
        }
        if let Some(bytes) = self.workspace_bytes {
            write!(f, ", workspace {:.1} MiB", bytes as f64 / f64::from(1 << 20))?;
        }
        if self.pairs != "all" {
            write!(f, "; {} pairs only", self.pairs)?;
        }
        if let Some(name) = self.disturb {
            write!(f, "; right images disturbed: {name}")?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn row(name: &str, region: Region, bad3: f64, cpu_ms: Option<f64>) -> Row {
        let scores = Scores {
            dens: 100.0,
            bad1: 30.0,
            bad2: 20.0,
            bad3,
            d1: 5.0,
            epe: 0.5,
            hole3: 9.0,
            val3: f64::NAN,
        };
        Row { name: name.into(), region: region.name(), scores, cpu_ms, rows_corrected: None }
    }

    fn report() -> StereoReport {
        let rows = vec![
            row("1", Region::All, 12.0, Some(100.0)),
            row("1", Region::Noc, 10.0, Some(100.0)),
            row("2", Region::All, 8.0, Some(200.0)),
        ];
        StereoReport {
            method: "full".into(),
            pairs: "odd".into(),
            sets: vec![SetReport::new("kitti".into(), rows, 3, 0)],
            ..StereoReport::default()
        }
    }

    #[test]
    fn the_table_has_a_line_for_each_image_and_region_and_the_means() {
        let text = report().to_string();
        let lines: Vec<Vec<&str>> = text.lines().map(|l| l.split_whitespace().collect()).collect();
        assert_eq!(lines[0], ["kitti"]);
        assert_eq!(lines[1][..4], ["pair", "region", "dens", "bad1"]);
        assert_eq!(
            lines[2],
            ["1", "all", "100.00", "30.00", "20.00", "12.00", "5.00", "0.50", "9.00", "-", "100.0"]
        );
        assert_eq!((lines[3][0], lines[3][5]), ("2", "8.00"));
        assert_eq!(lines[4][..4], ["mean", "of", "2", "all"]);
        assert_eq!((lines[4][7], lines[4][12]), ("10.00", "150.0"));
        assert_eq!(lines[5][..2], ["1", "noc"]);
        assert_eq!(lines[6][..4], ["mean", "of", "1", "noc"]);
        assert!(
            text.contains("3 pairs have no map") && text.ends_with("method: full; odd pairs only"),
            "{text}"
        );
    }

    #[test]
    fn the_document_has_the_table_in_it() {
        let json = serde_json::to_value(report()).unwrap();
        let set = &json["sets"][0];
        assert_eq!(set["rows"].as_array().unwrap().len(), 3);
        assert_eq!((&set["rows"][1]["name"], &set["rows"][1]["bad3"]), (&"2".into(), &8.0.into()));
        assert_eq!((&set["mean"]["all"]["bad3"], &set["mean"]["noc"]["images"]), (&10.0.into(), &1.into()));
        assert!(set["mean"]["all"]["val3"].is_null() && json["roc"].is_null());
    }

    #[test]
    fn the_correction_of_rows_is_told_by_pairs() {
        let mut report = report();
        report.correct_rows = true;
        assert!(report.to_string().contains("rows corrected in 0 of 2 pairs\n"), "{report}");
        let rows = |offset_px: f64| Some(RowsCorrected { offset_px, across_px: 0.1, down_px: -0.2 });
        for row in &mut report.sets[0].rows {
            row.rows_corrected = rows(if row.name == "1" { 0.3 } else { -0.1 });
        }
        let expected = "rows corrected in 2 of 2 pairs, by +0.10 px in the middle, +0.10 px more at the right border, \
                        -0.20 px more at the lower one in the mean; -0.10 to +0.30 px in the middle\n";
        assert!(report.to_string().contains(expected), "{report}");
    }
}
