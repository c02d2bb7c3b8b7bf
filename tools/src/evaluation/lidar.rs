//! Evaluation of regions on real images against LiDAR depth and KITTI labels.
//!
//! **Evaluable** are labelled cars (KITTI's classes Car and Van) whose centre is at most 40 m away, of which at
//! most half is truncated by the image border and which are at most partly occluded (KITTI's level 1). A car is
//! **covered** by a region whose box overlaps its own by 0.4 (intersection over union).
//!
//! The **LiDAR distance** of a car refers to its near side, as that of a region does: the first decile of the
//! depths within its box and within its length of the labelled position. That of a region without a label is
//! computed in the same way from the depths around the most frequent depth of its box.
//!
//! The **boxes of a car** are the regions that lie at least by half of their own area in its box, at a depth that the car
//! has. One is right; each more is a fragment, or a thing in front of it.
//!
//! The **class** of a label is right if the detectors, shown its box once, tell that of KITTI's: Car, Van, Truck and Tram are
//! vehicles, Pedestrian and Person_sitting pedestrians, Cyclist a rider. A region that shares no pixel with a label and is
//! told a class is a **false label**; of distant and of hidden things there are no labels, so some of these are right.

use super::label_classes::{ClassRow, Told, classes};
use super::quantile;
use super::weather::cell;
use crate::reporting::record::{tidy, tidy_finite};
use perception::region::{PixelBox, Region};
use serde::Serialize;
use sources::truth::label::Label;
use sources::truth::map_file::DisparityMap;
use std::fmt;

/// Maximum distance of evaluated cars and regions, in metres.
pub const MAX_DISTANCE_M: f64 = 40.0;

/// Minimum overlap of a region that covers a car.
pub const MIN_OVERLAP: f64 = 0.4;

/// Maximum truncation of a car by the image border.
const MAX_TRUNCATION: f64 = 0.5;

/// Minimum number of depth values for a LiDAR distance.
const MIN_DEPTHS: usize = 30;

/// Share of a region's box in that of a car from which the region is one of the car's boxes.
const MIN_SHARE_IN_CAR: f64 = 0.5;

/// Quantile of the depths that defines the near side.
const NEAR_QUANTILE: f64 = 0.1;

/// Origin of an image's disparity.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Disparity {
    /// Stereo matching.
    Matched,
    /// No right image: converted from the depth map.
    DepthMap,
}

/// Result for a labelled object.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Verdict {
    /// Covered by a region.
    Covered,
    /// Evaluable, but not covered.
    Missed,
    /// Not evaluable: not a car.
    OtherClass,
    /// Not evaluable: too far away.
    Far,
    /// Not evaluable: truncated by the image border.
    Cut,
    /// Not evaluable: occluded.
    Hidden,
}

impl Verdict {
    fn name(self) -> &'static str {
        match self {
            Self::Covered => "covered",
            Self::Missed => "missed",
            Self::OtherClass => "(other)",
            Self::Far => "(far)",
            Self::Cut => "(cut)",
            Self::Hidden => "(hidden)",
        }
    }
}

/// A labelled object with the region that overlaps it most.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct LabelRow {
    /// Name of the image.
    pub picture: String,
    /// Its class.
    pub class: String,
    /// Distance of its centre according to the label, in metres.
    pub label_m: f64,
    /// LiDAR distance of its near side, in metres.
    pub lidar_m: Option<f64>,
    /// Overlap of the region's box with its own, 0 to 1.
    pub overlap: f64,
    /// The region's distance, in metres.
    pub region_m: Option<f64>,
    /// Error relative to the LiDAR distance, in percent; positive is too far.
    pub error_percent: Option<f64>,
    /// Number of regions in its box at its depth.
    pub boxes: usize,
    /// What the detectors tell of its box, and how likely that is; `null` for nothing.
    pub told: Option<Told>,
    /// Whether it is at most partly occluded, and at most half of it cut by the border.
    pub in_sight: bool,
    /// Result.
    pub verdict: Verdict,
}

/// Result of one image.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct PictureRow {
    /// Name of the image.
    pub picture: String,
    /// Origin of the disparity.
    pub disparity: Disparity,
    /// Height of the camera above the road, in metres; `null` without a road estimate.
    pub camera_height_m: Option<f64>,
    /// Number of regions within 40 m.
    pub regions: usize,
    /// Distance errors of these regions against LiDAR, in percent, where LiDAR has a distance.
    pub errors_percent: Vec<f64>,
    /// Of a picture with labels: regions that share no pixel with any, and what was told of them.
    pub unlabelled: Vec<Option<Told>>,
}

/// Statistics of distance errors.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Errors {
    /// Number of distances.
    pub count: usize,
    /// Median absolute error, in percent.
    pub median_percent: Option<f64>,
    /// 90th percentile of the absolute error, in percent.
    pub p90_percent: Option<f64>,
    /// Median signed error, in percent; positive is too far.
    pub bias_percent: Option<f64>,
}

/// Report of the LiDAR evaluation.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct LidarReport {
    /// Name of the matcher.
    pub method: String,
    /// Number of times each image was processed in a row; 1: single images, of which sightings with strong evidence count.
    pub repeats: u64,
    /// Number of images that were skipped, because a picture or the depth map cannot be decoded.
    pub unreadable: u64,
    /// Images.
    pub pictures: Vec<PictureRow>,
    /// ClassifiedTrack objects.
    pub labels: Vec<LabelRow>,
    /// Number of evaluable cars.
    #[serde(rename = "due")]
    pub evaluable: usize,
    /// Number of covered cars.
    pub covered: usize,
    /// `covered` ÷ `evaluable`.
    pub share: Option<f64>,
    /// Mean number of boxes of an evaluable car that has any.
    pub boxes_per_car: Option<f64>,
    /// Classes of the labels by distance.
    pub classes: Vec<ClassRow>,
    /// Distance errors of the covered cars.
    pub cars: Errors,
    /// Distance errors of all regions of matched pairs.
    pub matched: Errors,
    /// Distance errors of all regions of images with a depth map only.
    pub depth_map: Errors,
}

impl Errors {
    fn new(errors_percent: impl Iterator<Item = f64>) -> Self {
        let mut signed: Vec<f64> = errors_percent.collect();
        let mut sizes: Vec<f64> = signed.iter().map(|e| e.abs()).collect();
        Self {
            count: signed.len(),
            median_percent: quantile(&mut sizes, 0.5).map(tidy),
            p90_percent: quantile(&mut sizes, 0.9).map(tidy),
            bias_percent: quantile(&mut signed, 0.5).map(tidy),
        }
    }
}

/// The known depths of a box between two distances.
fn depths(map: &DisparityMap, bounds: &PixelBox, (from_m, to_m): (f64, f64)) -> Vec<f64> {
    let columns = (bounds.x as usize).min(map.width)..((bounds.x + bounds.width) as usize).min(map.width);
    let rows = (bounds.y as usize).min(map.height)..((bounds.y + bounds.height) as usize).min(map.height);
    rows.flat_map(|y| &map.px[y * map.width..][columns.clone()])
        .map(|&z| f64::from(z))
        .filter(|z| *z > 0.0 && (from_m..=to_m).contains(z))
        .collect()
}

fn near_side_m(mut depths: Vec<f64>) -> Option<f64> {
    if depths.len() < MIN_DEPTHS { None } else { quantile(&mut depths, NEAR_QUANTILE) }
}

/// The box of a label in whole pixels.
pub fn label_box(label: &Label, width: usize, height: usize) -> PixelBox {
    let [left, top, right, bottom] = label.bounds_px;
    let edge = |v: f64, most: usize| v.round().clamp(0.0, most as f64) as u32;
    let (x, y) = (edge(left, width), edge(top, height));
    // KITTI's right and bottom edges are inclusive.
    let (right, bottom) = (edge(right + 1.0, width), edge(bottom + 1.0, height));
    PixelBox { x, y, width: right.saturating_sub(x), height: bottom.saturating_sub(y) }
}

/// Nearest and farthest distance of a labelled object, in metres, wherever it turns its sides.
fn depth_range_m(label: &Label) -> (f64, f64) {
    let reach = 0.5 * label.length_m.hypot(label.width_m) + 0.3;
    (label.distance_m - reach, label.distance_m + reach)
}

/// LiDAR distance of a labelled object's near side, in metres.
pub fn label_distance_m(depth_m: &DisparityMap, label: &Label) -> Option<f64> {
    let bounds = label_box(label, depth_m.width, depth_m.height);
    near_side_m(depths(depth_m, &bounds, depth_range_m(label)))
}

/// Whether a region is one of a labelled object's boxes, of which one is enough.
fn is_box_of(region: &Region, label: &Label, bounds: &PixelBox) -> bool {
    let (near_m, far_m) = depth_range_m(label);
    let (own, shared) = (&region.bounds, region.bounds.shared_area(bounds));
    let area = f64::from(own.width) * f64::from(own.height);
    (near_m..=far_m).contains(&region.distance_m) && shared >= MIN_SHARE_IN_CAR * area && shared > 0.0
}

/// LiDAR distance of the near side of the dominant surface in a box, in metres.
pub fn region_distance_m(depth_m: &DisparityMap, bounds: &PixelBox) -> Option<f64> {
    // Bins of 4 % of the distance.
    const PER_STEP: f64 = 25.0;
    let all = depths(depth_m, bounds, (0.0, f64::INFINITY));
    let step = |z: f64| (z.max(1.0).ln() * PER_STEP) as usize;
    let mut counts = vec![0_usize; all.iter().map(|&z| step(z) + 2).max()?];
    for &z in &all {
        counts[step(z)] += 1;
    }
    let around = |k: usize| counts[k.saturating_sub(1)..(k + 2).min(counts.len())].iter().sum::<usize>();
    let fullest = (0..counts.len()).max_by_key(|&k| around(k))?;
    near_side_m(all.into_iter().filter(|&z| step(z).abs_diff(fullest) <= 1).collect())
}

fn error_percent(found_m: f64, true_m: f64) -> f64 {
    tidy(100.0 * (found_m - true_m) / true_m)
}

/// Evaluates a labelled object against the regions of its image.
pub fn judge(
    picture: &str,
    label: &Label,
    depth_m: &DisparityMap,
    regions: &[Region],
    told: Option<Told>,
) -> LabelRow {
    let bounds = label_box(label, depth_m.width, depth_m.height);
    let overlap = |region: &&Region| region.bounds.overlap(&bounds);
    let best = regions.iter().max_by(|a, b| overlap(a).total_cmp(&overlap(b))).filter(|r| overlap(r) > 0.0);
    let shared = best.as_ref().map_or(0.0, overlap);
    let lidar_m = label_distance_m(depth_m, label);
    let region_m = best.map(|region| region.distance_m);
    let verdict = match label {
        Label { class, .. } if !["Car", "Van"].contains(&&class[..]) => Verdict::OtherClass,
        Label { distance_m, .. } if *distance_m > MAX_DISTANCE_M => Verdict::Far,
        Label { truncated, .. } if *truncated > MAX_TRUNCATION => Verdict::Cut,
        Label { occluded, .. } if *occluded > 1 => Verdict::Hidden,
        _ if shared >= MIN_OVERLAP => Verdict::Covered,
        _ => Verdict::Missed,
    };
    LabelRow {
        picture: picture.to_owned(),
        class: label.class.clone(),
        label_m: tidy(label.distance_m),
        lidar_m: lidar_m.map(tidy),
        overlap: tidy(shared),
        region_m: region_m.map(tidy),
        error_percent: region_m.zip(lidar_m).map(|(found, truth)| error_percent(found, truth)),
        boxes: regions.iter().filter(|region| is_box_of(region, label, &bounds)).count(),
        told,
        in_sight: label.truncated <= MAX_TRUNCATION && label.occluded <= 1,
        verdict,
    }
}

impl PictureRow {
    /// Evaluates the regions of an image.
    pub fn new(
        picture: &str,
        disparity: Disparity,
        camera_height_m: Option<f64>,
        depth_m: &DisparityMap,
        regions: &[Region],
        unlabelled: Vec<Option<Told>>,
    ) -> Self {
        let judged = || regions.iter().filter(|region| region.distance_m <= MAX_DISTANCE_M);
        let error = |region: &Region| {
            Some(error_percent(region.distance_m, region_distance_m(depth_m, &region.bounds)?))
        };
        Self {
            picture: picture.to_owned(),
            disparity,
            camera_height_m: camera_height_m.map(tidy),
            regions: judged().count(),
            errors_percent: judged().filter_map(error).collect(),
            unlabelled,
        }
    }
}

impl LidarReport {
    /// Summarises all images; `unreadable` more were skipped.
    pub fn new(
        method: &str,
        repeats: u64,
        unreadable: u64,
        pictures: Vec<PictureRow>,
        labels: Vec<LabelRow>,
    ) -> Self {
        let count = |verdict: Verdict| labels.iter().filter(|row| row.verdict == verdict).count();
        let covered = count(Verdict::Covered);
        let evaluable = covered + count(Verdict::Missed);
        let cars = labels.iter().filter(|row| row.verdict == Verdict::Covered);
        let in_view = labels.iter().filter(|row| matches!(row.verdict, Verdict::Covered | Verdict::Missed));
        let in_sight = labels.iter().filter(|row| row.in_sight);
        let in_sight: Vec<_> = in_sight.map(|row| (&row.class[..], row.label_m, row.told.as_ref())).collect();
        let boxes: Vec<f64> = in_view.map(|row| row.boxes as f64).filter(|&boxes| boxes > 0.0).collect();
        let of = |disparity: Disparity| {
            let rows = pictures.iter().filter(move |row| row.disparity == disparity);
            Errors::new(rows.flat_map(|row| row.errors_percent.iter().copied()))
        };
        Self {
            method: method.to_owned(),
            repeats,
            unreadable,
            evaluable,
            covered,
            share: tidy_finite(covered as f64 / evaluable as f64),
            boxes_per_car: tidy_finite(boxes.iter().sum::<f64>() / boxes.len() as f64),
            classes: classes(&in_sight),
            cars: Errors::new(cars.filter_map(|row| row.error_percent)),
            matched: of(Disparity::Matched),
            depth_map: of(Disparity::DepthMap),
            pictures,
            labels,
        }
    }
}

impl fmt::Display for Errors {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let sign = self.bias_percent.map_or("-".into(), |v| format!("{v:+.2}"));
        write!(
            f,
            "{} distances, absolute error {} % median, {} % 90th percentile; {sign} % median signed error",
            self.count,
            cell(self.median_percent, 2),
            cell(self.p90_percent, 2)
        )
    }
}

impl fmt::Display for LidarReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let names = self.pictures.iter().map(|row| row.picture.chars().count());
        let width = names.max().unwrap_or(0).max(8) + 1;
        writeln!(
            f,
            "{:<width$}{:>11}{:>10}{:>9}{:>10}{:>10}",
            "picture", "disparity", "camera m", "regions", "error %", "p90 %"
        )?;
        for row in &self.pictures {
            let errors = Errors::new(row.errors_percent.iter().copied());
            writeln!(
                f,
                "{:<width$}{:>11}{:>10}{:>9}{:>10}{:>10}",
                row.picture,
                if row.disparity == Disparity::Matched { "matched" } else { "depth map" },
                row.camera_height_m.map_or("no road".into(), |m| format!("{m:.2}")),
                row.regions,
                cell(errors.median_percent, 2),
                cell(errors.p90_percent, 2)
            )?;
        }
        if !self.labels.is_empty() {
            writeln!(
                f,
                "\n{:<width$}{:>12}{:>9}{:>9}{:>9}{:>10}{:>9}{:>7}  {:<18}",
                "picture", "label", "label m", "LiDAR m", "overlap", "region m", "error %", "boxes", "told"
            )?;
        }
        for row in &self.labels {
            writeln!(
                f,
                "{:<width$}{:>12}{:>9.2}{:>9}{:>9.2}{:>10}{:>9}{:>7}  {:<18}{}",
                row.picture,
                row.class,
                row.label_m,
                cell(row.lidar_m, 2),
                row.overlap,
                cell(row.region_m, 2),
                cell(row.error_percent, 2),
                row.boxes,
                row.told.as_ref().map_or("-".into(), |t| format!("{} {:.2}", t.class, t.probability)),
                row.verdict.name()
            )?;
        }
        writeln!(f)?;
        if self.unreadable > 0 {
            writeln!(f, "unreadable pictures, skipped: {}; --strict stops there", self.unreadable)?;
        }
        if self.evaluable > 0 {
            writeln!(
                f,
                "cars within {MAX_DISTANCE_M} m in view: {} of {} covered ({}); boxes a car {}; {}",
                self.covered,
                self.evaluable,
                cell(self.share, 3),
                cell(self.boxes_per_car, 2),
                self.cars
            )?;
        }
        for row in &self.classes {
            writeln!(f, "{row}")?;
        }
        let unlabelled: Vec<&Option<Told>> = self.pictures.iter().flat_map(|row| &row.unlabelled).collect();
        if !unlabelled.is_empty() {
            let told = unlabelled.iter().filter(|told| told.is_some()).count();
            writeln!(f, "regions without a label: {told} of {} told a class", unlabelled.len())?;
        }
        if self.matched.count > 0 {
            writeln!(f, "regions of matched pairs: {}", self.matched)?;
        }
        if self.depth_map.count > 0 {
            writeln!(f, "regions of depth maps: {}", self.depth_map)?;
        }
        if self.pictures.iter().any(|row| row.disparity == Disparity::DepthMap) {
            writeln!(
                f,
                "depth map: no right image, so the disparity is converted from the LiDAR depth; the matcher is not used"
            )?;
        }
        let history = match self.repeats {
            1 => "single images, sightings with strong evidence".to_owned(),
            n => format!("each image {n} times in a row, confirmed by tracking"),
        };
        write!(f, "{history}; method: {}", self.method)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use perception::outline::Outline;

    /// A road of 12 m, a car's rear of 40 × 30 px at 10 m and a wall at 30 m above it.
    fn depth() -> DisparityMap {
        let (width, height) = (100, 80);
        let px = (0..width * height).map(|i| {
            let (x, y) = (i % width, i / width);
            if (40..80).contains(&x) && (30..60).contains(&y) {
                10.0
            } else if y < 30 {
                30.0
            } else {
                12.0
            }
        });
        DisparityMap { px: px.collect(), width, height }
    }

    fn label() -> Label {
        Label {
            class: "Car".into(),
            truncated: 0.0,
            occluded: 0,
            bounds_px: [40.0, 30.0, 79.0, 59.0],
            height_m: 1.5,
            width_m: 1.6,
            length_m: 4.0,
            distance_m: 12.0,
        }
    }

    fn region(bounds: PixelBox, distance_m: f64) -> Region {
        Region {
            bounds,
            disparity_px: 10.0,
            disparity_sigma_px: 0.1,
            distance_m,
            lateral_m: 0.0,
            width_m: 1.6,
            height_m: 1.4,
            inset_m: [0.0; 2],
            is_hidden: [false; 2],
            goes_on: [false; 2],
            outline: Outline::default(),
            pixels: 900,
            confidence: 1.0,
            evidence: 4.0,
        }
    }

    #[test]
    fn classes_told_are_counted_by_distance() {
        let (depth, regions) = (depth(), Vec::new());
        let told = |class: &str| Some(Told { class: class.into(), probability: 0.9 });
        let row = |change: &dyn Fn(&mut Label), told: Option<Told>| {
            let mut label = label();
            change(&mut label);
            judge("1", &label, &depth, &regions, told)
        };
        let rows = vec![
            row(&|_| (), told("vehicle")),
            row(&|l| l.class = "Van".into(), None),
            row(&|l| l.distance_m = 50.0, told("rider")),
            row(&|l| l.class = "Cyclist".into(), told("rider")),
            row(&|l| l.occluded = 2, None),
            row(&|l| l.class = "Misc".into(), told("vehicle")),
        ];
        let unlabelled = vec![None, told("vehicle")];
        let page = PictureRow::new("1", Disparity::DepthMap, None, &depth, &regions, unlabelled);
        let report = LidarReport::new("fast", 1, 0, vec![page], rows);
        let counts: Vec<_> =
            report.classes.iter().map(|r| (&r.class[..], r.to_m, r.due, r.right, r.wrong)).collect();
        let expected =
            [("vehicle", Some(15.0), 2, 1, 0), ("vehicle", None, 1, 0, 1), ("rider", Some(15.0), 1, 1, 0)];
        assert_eq!(counts, expected);
        let text = report.to_string();
        assert!(text.contains("class vehicle up to 15 m: 1 of 2 told, 0 told another class"), "{text}");
        assert!(text.contains("regions without a label: 1 of 2 told a class"), "{text}");
    }

    #[test]
    fn distances_are_those_of_the_near_side() {
        let depth = depth();
        assert_eq!(label_box(&label(), 100, 80), PixelBox { x: 40, y: 30, width: 40, height: 30 });
        assert_eq!(label_distance_m(&depth, &label()), Some(10.0));
        // Half of the box shows the wall: the label determines which half is the car.
        let tall = Label { bounds_px: [40.0, 0.0, 79.0, 59.0], ..label() };
        assert_eq!(label_distance_m(&depth, &tall), Some(10.0));
        assert_eq!(label_distance_m(&depth, &Label { distance_m: 20.0, ..label() }), None);
        assert_eq!(region_distance_m(&depth, &PixelBox { x: 38, y: 28, width: 44, height: 34 }), Some(10.0));
        assert_eq!(region_distance_m(&depth, &PixelBox { x: 0, y: 0, width: 5, height: 5 }), None);
        assert_eq!(region_distance_m(&depth, &PixelBox { x: 200, y: 0, width: 5, height: 5 }), None);
    }

    #[test]
    fn cars_are_covered_by_overlap_and_others_are_not_judged() {
        let depth = depth();
        let regions = [
            region(PixelBox { x: 44, y: 30, width: 36, height: 30 }, 10.5),
            region(PixelBox { x: 0, y: 0, width: 90, height: 70 }, 10.0),
        ];
        let row = judge("1", &label(), &depth, &regions, None);
        assert_eq!((row.verdict, row.overlap), (Verdict::Covered, 0.9));
        assert_eq!((row.region_m, row.lidar_m, row.error_percent), (Some(10.5), Some(10.0), Some(5.0)));
        // The large box is not the car's: most of it lies beside it.
        assert_eq!(row.boxes, 1);
        let fragments = [
            regions[0],
            region(PixelBox { x: 40, y: 40, width: 10, height: 20 }, 12.0),
            region(PixelBox { x: 40, y: 40, width: 10, height: 20 }, 20.0),
        ];
        assert_eq!(judge("1", &label(), &depth, &fragments, None).boxes, 2);
        let verdict = |label: Label| judge("1", &label, &depth, &regions[1..], None).verdict;
        assert_eq!(verdict(label()), Verdict::Missed);
        assert_eq!(verdict(Label { class: "Cyclist".into(), ..label() }), Verdict::OtherClass);
        assert_eq!(verdict(Label { distance_m: 40.1, ..label() }), Verdict::Far);
        assert_eq!(verdict(Label { truncated: 0.6, ..label() }), Verdict::Cut);
        assert_eq!(verdict(Label { occluded: 2, ..label() }), Verdict::Hidden);
        assert_eq!(judge("1", &label(), &depth, &[], None).region_m, None);
        let pictures = vec![
            PictureRow::new("1", Disparity::DepthMap, Some(1.6), &depth, &regions[..1], Vec::new()),
            PictureRow::new("2", Disparity::Matched, None, &depth, &[], Vec::new()),
        ];
        assert_eq!(pictures[0].errors_percent, [5.0]);
        let missed = judge("1", &label(), &depth, &regions[1..], None);
        let report = LidarReport::new("fast", 1, 0, pictures, vec![row, missed]);
        assert_eq!((report.evaluable, report.covered, report.share), (2, 1, Some(0.5)));
        assert_eq!(
            (report.cars.median_percent, report.matched.count, report.depth_map.count),
            (Some(5.0), 0, 1)
        );
        let text = report.to_string();
        assert_eq!(report.boxes_per_car, Some(1.0));
        assert!(
            text.contains("1 of 2 covered (0.500); boxes a car 1.00") && text.contains("no road"),
            "{text}"
        );
        assert!(text.contains("the matcher is not used") && text.contains("single images"), "{text}");
    }
}
