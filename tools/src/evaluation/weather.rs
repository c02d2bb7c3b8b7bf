//! Detection, distance, class and road errors by weather, compared with the paper's table.

use super::box_score::{BoxCounts, BoxScore};
use super::false_alarm::FalseAlarm;
use super::free_ground::{FreeGroundCounts, FreeGroundScore};
use super::missed::{MissedObject, MissedObjects, by_class, write_missed};
use super::quantile;
use super::scene_match::{Detection, FalsePositives, FrameMatch, is_match, road_errors};
use crate::reporting::record::{tidy, tidy_finite};
use serde::Serialize;
use sources::scene::{FreeGround, ObjectClass, RoadTruth};
use std::collections::{BTreeMap, BTreeSet};
use std::fmt;

/// The paper's accuracy rates (its table "Result of Accuracy Rate").
pub const PAPER: [(&str, f64); 6] = [
    ("sunny", 0.905),
    ("light_rain", 0.851),
    ("heavy_rain", 0.687),
    ("night", 0.806),
    ("snow", 0.882),
    ("backlight", 0.763),
];

/// Distance ranges in metres: from, to.
pub const RANGES_M: [(f64, f64); 5] = [(3.0, 7.5), (7.5, 12.5), (12.5, 20.0), (20.0, 27.5), (27.5, 40.0)];

/// The stated error bar is this many standard deviations to either side.
pub const BAR_SIGMAS: f64 = 2.0;

/// Maximum distance of compared road rows, in metres.
pub const ROAD_M: f64 = 40.0;

/// Distance errors of one range.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct RangeErrors {
    /// Start of the range, in metres.
    pub from_m: f64,
    /// End of the range, in metres.
    pub to_m: f64,
    /// Evaluable objects.
    #[serde(rename = "due")]
    pub evaluable: usize,
    /// Those with a matching region.
    pub found: usize,
    /// Median absolute error, in percent of the distance.
    pub median_percent: Option<f64>,
    /// Median signed error, in percent; positive is too far.
    pub bias_percent: Option<f64>,
    /// Share of the matched objects whose true distance is within the stated error bar.
    pub covered: Option<f64>,
}

/// Classification counts of a group of objects.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Share {
    /// Evaluable objects, summed over frames.
    #[serde(rename = "due")]
    pub evaluable: usize,
    /// Those with a matching track.
    pub tracked: usize,
    /// Those whose track has the right class.
    pub right: usize,
}

impl Share {
    fn add(&mut self, tracked: bool, right: bool) {
        self.evaluable += 1;
        self.tracked += usize::from(tracked);
        self.right += usize::from(tracked && right);
    }

    fn merge(&mut self, other: Self) {
        self.evaluable += other.evaluable;
        self.tracked += other.tracked;
        self.right += other.right;
    }

    fn rate(&self) -> Option<f64> {
        tidy_finite(self.right as f64 / self.evaluable as f64)
    }
}

/// A confirmed track with its class.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ClassifiedTrack {
    /// Position and distance.
    pub found: Detection,
    /// Whether its class is vehicle.
    pub is_vehicle: bool,
}

/// Whether the recogniser is expected to classify an object as a vehicle.
pub fn is_vehicle(class: ObjectClass) -> bool {
    matches!(class, ObjectClass::Car | ObjectClass::Bus | ObjectClass::Lorry)
}

/// Results of one scene in one weather.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct WeatherRow {
    /// Name of the scene.
    pub scene: String,
    /// Name of the weather.
    pub weather: String,
    /// Method of the road fit, where several are compared.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub road: Option<String>,
    /// Number of frames.
    pub frames: usize,
    /// Duration in seconds.
    pub seconds: f64,
    /// Evaluable objects, summed over frames.
    #[serde(rename = "due")]
    pub evaluable: usize,
    /// Those with a matching region.
    #[serde(rename = "found")]
    pub true_positives: usize,
    /// `true_positives` ÷ `evaluable`.
    pub detection_rate: Option<f64>,
    /// The paper's accuracy rate for this weather.
    pub paper_rate: Option<f64>,
    /// Evaluable vehicles, and those classified as a vehicle.
    pub vehicles: Share,
    /// Other evaluable objects, and those with a track that is not classified as a vehicle.
    pub others: Share,
    /// Share of all evaluable objects with a matching track of the right class.
    pub class_rate: Option<f64>,
    /// The same of those with a matching track.
    pub class_rate_of_found: Option<f64>,
    /// Evaluable objects without a matching region, by class.
    pub missed: BTreeMap<&'static str, usize>,
    /// Each of these objects.
    pub missed_list: Vec<MissedObject>,
    /// False positives on the road per minute, summed over frames.
    pub false_per_minute: f64,
    /// Confirmed tracks that were a false positive on the road, per minute.
    pub false_tracks_per_minute: f64,
    /// Off-road false positives per minute, summed over frames.
    #[serde(rename = "stray_per_minute")]
    pub off_road_per_minute: f64,
    /// Frames with a road estimate.
    pub road_seen: usize,
    /// Median absolute height error of the road, in metres.
    pub road_median_m: Option<f64>,
    /// 95th percentile of the absolute height error of the road, in metres.
    pub road_p95_m: Option<f64>,
    /// Distance errors by range.
    pub ranges: Vec<RangeErrors>,
    /// Distance errors over all ranges.
    pub all: RangeErrors,
    /// Regions against objects, by today's rule and by the strict one.
    pub regions: BoxScore,
    /// The same of confirmed tracks that were detected in the frame.
    pub obstacles: BoxScore,
    /// Share of the frames with an alarm that has no cause.
    pub false_alarms: Option<f64>,
    /// Each of them.
    pub false_alarm_list: Vec<FalseAlarm>,
    /// Free space against the truly free ground.
    pub free_space: FreeGroundScore,
}

/// Results of one frame.
pub struct FrameResult<'a> {
    /// The scene, as in `lookout replay scene:NAME`, without the weather.
    pub scene: &'a str,
    /// Number of the frame.
    pub frame: u64,
    /// Regions matched with the ground truth.
    pub matched: &'a FrameMatch,
    /// Confirmed tracks that were detected in this frame, matched with the ground truth.
    pub obstacles: &'a FrameMatch,
    /// Numbers of confirmed tracks that are false positives on the road.
    pub false_tracks: &'a [u32],
    /// All confirmed tracks.
    pub tracks: &'a [ClassifiedTrack],
    /// Road profile of the model, where there is one.
    pub profile_px: Option<&'a [f32]>,
    /// Ground truth of the road.
    pub road: &'a RoadTruth,
}

/// Accumulates the frames of one scene and weather.
#[derive(Debug)]
pub struct Tally {
    scene: String,
    weather: String,
    rig: perception::rig::Rig,
    period_s: f64,
    frames: usize,
    false_positives: FalsePositives,
    false_tracks: BTreeSet<(usize, u32)>,
    /// Scenes that were merged: their tracks have numbers of their own.
    merged: usize,
    regions: BoxCounts,
    obstacles: BoxCounts,
    false_alarms: Vec<FalseAlarm>,
    free_ground: FreeGroundCounts,
    road_seen: usize,
    road_errors_m: Vec<f64>,
    /// For each evaluable object: true distance, and measured distance with its standard deviation.
    distances: Vec<(f64, Option<(f64, f64)>)>,
    missed: MissedObjects,
    vehicles: Share,
    others: Share,
}

impl Tally {
    /// An empty tally; frames are `period_s` seconds apart.
    pub fn new(scene: &str, weather: &str, rig: perception::rig::Rig, period_s: f64) -> Self {
        Self {
            scene: scene.into(),
            weather: weather.into(),
            rig,
            period_s,
            frames: 0,
            false_positives: FalsePositives::default(),
            false_tracks: BTreeSet::new(),
            merged: 0,
            regions: BoxCounts::default(),
            obstacles: BoxCounts::default(),
            false_alarms: Vec::new(),
            free_ground: FreeGroundCounts::default(),
            road_seen: 0,
            road_errors_m: Vec::new(),
            distances: Vec::new(),
            missed: MissedObjects::default(),
            vehicles: Share::default(),
            others: Share::default(),
        }
    }

    /// Adds a frame.
    pub fn add(&mut self, frame: &FrameResult<'_>) {
        self.frames += 1;
        self.false_positives.on_road += frame.matched.false_positives.on_road;
        self.false_positives.off_road += frame.matched.false_positives.off_road;
        self.false_tracks.extend(frame.false_tracks.iter().map(|&track| (0, track)));
        self.regions.add(frame.matched);
        self.obstacles.add(frame.obstacles);
        self.missed.add((frame.scene, &self.weather), frame.frame, frame.matched);
        for evaluable in &frame.matched.evaluable {
            self.distances
                .push((evaluable.object.distance_m, evaluable.detection.map(|f| (f.distance_m, f.sigma_m))));
            let overlap = |t: &&ClassifiedTrack| t.found.bounds.overlap(&evaluable.object.bounds);
            let by = frame.tracks.iter().filter(|t| is_match(&evaluable.object, &t.found));
            let track = by.max_by(|a, b| overlap(a).total_cmp(&overlap(b)));
            let wanted = is_vehicle(evaluable.object.class);
            let share = if wanted { &mut self.vehicles } else { &mut self.others };
            share.add(track.is_some(), track.is_some_and(|t| t.is_vehicle == wanted));
        }
        if let Some(profile) = frame.profile_px {
            self.road_seen += 1;
            let scale = self.rig.focal_px * self.rig.baseline_m;
            let errors = &mut self.road_errors_m;
            road_errors(profile, &frame.road.rows_px, self.rig.baseline_m, scale, ROAD_M, errors);
        }
    }

    /// Adds alarms without a cause.
    pub fn add_false_alarms(&mut self, found: Vec<FalseAlarm>) {
        self.false_alarms.extend(found);
    }

    /// Adds the free space of a frame.
    pub fn add_free_space(&mut self, truth: &FreeGround, polygons: &[Vec<[f64; 2]>]) {
        self.free_ground.add(truth, &self.rig, polygons);
    }

    /// Adds the frames of another scene.
    pub fn merge(&mut self, other: Self) {
        self.frames += other.frames;
        self.false_positives.on_road += other.false_positives.on_road;
        self.false_positives.off_road += other.false_positives.off_road;
        let scene = self.merged + 1;
        self.false_tracks.extend(other.false_tracks.iter().map(|&(before, track)| (scene + before, track)));
        self.merged = scene + other.merged;
        self.regions.merge(&other.regions);
        self.obstacles.merge(&other.obstacles);
        self.false_alarms.extend(other.false_alarms);
        self.free_ground.merge(&other.free_ground);
        self.road_seen += other.road_seen;
        self.road_errors_m.extend(other.road_errors_m);
        self.distances.extend(other.distances);
        self.missed.merge(&other.missed);
        self.vehicles.merge(other.vehicles);
        self.others.merge(other.others);
    }

    fn range(&self, from_m: f64, to_m: f64) -> RangeErrors {
        let of_range = || self.distances.iter().filter(|(truth, _)| (from_m..to_m).contains(truth));
        let found: Vec<(f64, f64, f64)> =
            of_range().filter_map(|&(truth, found)| found.map(|(d, sigma)| (truth, d, sigma))).collect();
        let mut sizes: Vec<f64> =
            found.iter().map(|(truth, d, _)| 100.0 * (d - truth).abs() / truth).collect();
        let mut signed: Vec<f64> = found.iter().map(|(truth, d, _)| 100.0 * (d - truth) / truth).collect();
        let covered =
            found.iter().filter(|(truth, d, sigma)| (d - truth).abs() <= BAR_SIGMAS * sigma).count();
        RangeErrors {
            from_m,
            to_m,
            evaluable: of_range().count(),
            found: found.len(),
            median_percent: quantile(&mut sizes, 0.5).map(tidy),
            bias_percent: quantile(&mut signed, 0.5).map(tidy),
            covered: tidy_finite(covered as f64 / found.len() as f64),
        }
    }

    /// Computes the row of the table.
    pub fn row(&self) -> WeatherRow {
        let seconds = self.frames as f64 * self.period_s;
        let per_minute = |count: usize| tidy(count as f64 * 60.0 / seconds.max(1e-9));
        let true_positives = self.distances.iter().filter(|(_, found)| found.is_some()).count();
        let evaluable = self.distances.len();
        let false_frames: usize = self.false_alarms.iter().map(|alarm| alarm.frames).sum();
        let missed_list = self.missed.list();
        let mut heights: Vec<f64> = self.road_errors_m.iter().map(|e| e.abs()).collect();
        WeatherRow {
            scene: self.scene.clone(),
            weather: self.weather.clone(),
            road: None,
            frames: self.frames,
            seconds: tidy(seconds),
            evaluable,
            true_positives,
            detection_rate: tidy_finite(true_positives as f64 / evaluable as f64),
            paper_rate: PAPER.iter().find(|(name, _)| *name == self.weather).map(|(_, rate)| *rate),
            missed: by_class(&missed_list),
            missed_list,
            vehicles: self.vehicles,
            others: self.others,
            class_rate: tidy_finite((self.vehicles.right + self.others.right) as f64 / evaluable as f64),
            class_rate_of_found: tidy_finite(
                (self.vehicles.right + self.others.right) as f64
                    / (self.vehicles.tracked + self.others.tracked) as f64,
            ),
            false_per_minute: per_minute(self.false_positives.on_road),
            false_tracks_per_minute: per_minute(self.false_tracks.len()),
            off_road_per_minute: per_minute(self.false_positives.off_road),
            road_seen: self.road_seen,
            road_median_m: quantile(&mut heights, 0.5).map(tidy),
            road_p95_m: quantile(&mut heights, 0.95).map(tidy),
            ranges: RANGES_M.iter().map(|&(from, to)| self.range(from, to)).collect(),
            all: self.range(0.0, f64::INFINITY),
            regions: self.regions.score(seconds),
            obstacles: self.obstacles.score(seconds),
            false_alarms: tidy_finite(false_frames as f64 / self.frames as f64),
            false_alarm_list: self.false_alarms.clone(),
            free_space: self.free_ground.score(),
        }
    }
}

/// Report of the weather evaluation.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct WeatherReport {
    /// Name of the matcher.
    pub method: String,
    /// One row per scene and weather.
    pub rows: Vec<WeatherRow>,
}

pub(super) fn cell(value: Option<f64>, decimals: usize) -> String {
    value.map_or("-".into(), |v| format!("{v:.decimals$}"))
}

impl WeatherRow {
    /// Scene, weather and, where road models are compared, the road model.
    fn name(&self) -> String {
        let road = self.road.as_ref().map_or(String::new(), |road| format!(", {road}"));
        format!("{} {}{road}", self.scene, self.weather)
    }
}

impl WeatherReport {
    fn write_detection(&self, f: &mut fmt::Formatter<'_>, width: usize) -> fmt::Result {
        writeln!(
            f,
            "{:<width$}{:>8}{:>10}{:>10}{:>8}{:>10}{:>11}{:>13}{:>10}{:>10}{:>9}",
            "scene",
            "frames",
            "evaluable",
            "detected",
            "paper",
            "false/min",
            "tracks/min",
            "off-road/min",
            "road seen",
            "road cm",
            "95 % cm"
        )?;
        for row in &self.rows {
            writeln!(
                f,
                "{:<width$}{:>8}{:>10}{:>10}{:>8}{:>10.1}{:>11.1}{:>13.1}{:>10}{:>10}{:>9}",
                row.name(),
                row.frames,
                row.evaluable,
                cell(row.detection_rate, 3),
                cell(row.paper_rate, 3),
                row.false_per_minute,
                row.false_tracks_per_minute,
                row.off_road_per_minute,
                row.road_seen,
                cell(row.road_median_m.map(|m| 100.0 * m), 1),
                cell(row.road_p95_m.map(|m| 100.0 * m), 1),
            )?;
        }
        Ok(())
    }

    fn write_distances(&self, f: &mut fmt::Formatter<'_>, width: usize) -> fmt::Result {
        writeln!(
            f,
            "\nDistance: median absolute error in percent, median signed error (+ too far, - too near), share of \
             true distances within the error bar"
        )?;
        write!(f, "{:<width$}", "scene")?;
        for (from, to) in RANGES_M {
            write!(f, "{:>22}", format!("{from} to {to} m"))?;
        }
        writeln!(f, "{:>22}", "all")?;
        for row in &self.rows {
            write!(f, "{:<width$}", row.name())?;
            for range in row.ranges.iter().chain([&row.all]) {
                let sign = range.bias_percent.map_or("-".into(), |v| format!("{v:+.2}"));
                let text = format!("{} {sign} {}", cell(range.median_percent, 2), cell(range.covered, 2));
                write!(f, "{text:>22}")?;
            }
            writeln!(f)?;
        }
        Ok(())
    }

    fn write_boxes(&self, f: &mut fmt::Formatter<'_>, width: usize) -> fmt::Result {
        writeln!(
            f,
            "\nBoxes: share of the evaluable objects that are detected, the same if a box may find one object only, \
             boxes for each detected object, false boxes a minute on and off the road; of regions, of confirmed \
             tracks; share of frames with a false alarm; share of the free ground that is found, m wrongly called free"
        )?;
        for row in &self.rows {
            write!(f, "{:<width$}", row.name())?;
            for score in [&row.regions, &row.obstacles] {
                let text = format!(
                    "{} {} {} {:.1} {:.1}",
                    cell(score.detection_rate, 3),
                    cell(score.strict_rate, 3),
                    cell(score.boxes_per_object, 2),
                    score.false_per_minute,
                    score.off_road_per_minute
                );
                write!(f, "{text:>34}")?;
            }
            let free = &row.free_space;
            let text = [cell(row.false_alarms, 3), cell(free.found, 3), cell(free.wrong_m, 3)];
            writeln!(f, "{:>8}{:>8}{:>8}", text[0], text[1], text[2])?;
        }
        Ok(())
    }

    fn write_classes(&self, f: &mut fmt::Formatter<'_>, width: usize) -> fmt::Result {
        writeln!(
            f,
            "\nClass: share of the evaluable objects with a matching track of the right class; the same of those \
             with a matching track; of vehicles, of others"
        )?;
        for row in &self.rows {
            writeln!(
                f,
                "{:<width$}{:>8}{:>8}{:>16}{:>16}",
                row.name(),
                cell(row.class_rate, 3),
                cell(row.class_rate_of_found, 3),
                format!("{} of {}", cell(row.vehicles.rate(), 3), row.vehicles.evaluable),
                format!("{} of {}", cell(row.others.rate(), 3), row.others.evaluable),
            )?;
        }
        Ok(())
    }
}

/// Tables of detection, distance, class and boxes, then missed objects and false alarms.
impl fmt::Display for WeatherReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let width = self.rows.iter().map(|row| row.name().chars().count()).max().unwrap_or(0).max(12);
        self.write_detection(f, width)?;
        self.write_distances(f, width)?;
        self.write_classes(f, width)?;
        self.write_boxes(f, width)?;
        let mut missed = self.rows.iter().filter(|row| !row.missed_list.is_empty()).peekable();
        if missed.peek().is_some() {
            writeln!(f, "\nMissed")?;
        }
        missed.try_for_each(|row| write_missed(f, &row.name(), &row.missed_list))?;
        let mut false_alarms = self.rows.iter().flat_map(|row| &row.false_alarm_list).peekable();
        if false_alarms.peek().is_some() {
            writeln!(f, "\nFalse alarms")?;
        }
        for alarm in false_alarms {
            writeln!(f, "{alarm}")?;
        }
        write!(f, "\nmethod: {}", self.method)
    }
}

#[cfg(test)]
mod tests {
    use super::super::scene_match::Evaluable;
    use super::*;
    use perception::region::PixelBox;
    use perception::rig::Rig;
    use sources::scene::ObjectTruth;

    fn evaluable(distance_m: f64, found: Option<(f64, f64)>) -> Evaluable {
        let bounds = PixelBox { x: 1, y: 1, width: 9, height: 9 };
        let object = ObjectTruth {
            id: 3,
            class: ObjectClass::Cone,
            subject: true,
            distance_m,
            lateral_m: 0.0,
            width_m: 0.4,
            height_m: 0.7,
            along_m: 10.0,
            closing_m_s: 0.0,
            bounds,
            pixels: 81,
            visible: 1.0,
            seen_by_both: 1.0,
            in_path: true,
            on_road: true,
        };
        Evaluable {
            object,
            detection: found.map(|(distance_m, sigma_m)| Detection { bounds, distance_m, sigma_m }),
        }
    }

    #[test]
    fn rates_errors_and_cover_are_those_of_the_frames() {
        let rig = Rig { focal_px: 879.0, baseline_m: 0.12, cx_px: 320.0, cy_px: 220.0 };
        let mut tally = Tally::new("street", "night", rig, 0.08);
        let matched = FrameMatch {
            evaluable: vec![
                evaluable(10.0, Some((10.2, 0.11))),
                evaluable(10.0, Some((9.5, 0.1))),
                evaluable(30.0, None),
            ],
            matched: vec![true, true, false],
            false_positives: FalsePositives { on_road: 1, off_road: 0 },
            one_to_one: 1,
            boxes: 3,
        };
        let road = RoadTruth::default();
        for _ in 0..3 {
            let found = matched.evaluable[0].detection.unwrap();
            let tracks = [ClassifiedTrack { found, is_vehicle: false }];
            let frame = FrameResult {
                scene: "street",
                frame: 0,
                matched: &matched,
                obstacles: &matched,
                false_tracks: &[7],
                tracks: &tracks,
                profile_px: None,
                road: &road,
            };
            tally.add(&frame);
        }
        // Another scene: its tracks are others.
        let mut whole = Tally::new("street", "night", rig, 0.08);
        whole.merge(tally);
        let tally = whole;
        let row = tally.row();
        assert_eq!((row.regions.strict_rate, row.obstacles.boxes_per_object), (Some(0.3333), Some(1.5)));
        assert_eq!((row.frames, row.evaluable, row.true_positives), (3, 9, 6));
        assert_eq!(row.detection_rate, Some(0.6667));
        assert_eq!(row.paper_rate, Some(0.806));
        // One per frame, every 80 ms; one track.
        assert_eq!((row.false_per_minute, row.false_tracks_per_minute), (750.0, 250.0));
        assert_eq!(row.missed["cone"], 3);
        // Cones are not vehicles: right when classified as an obstacle.
        assert_eq!(
            (row.others.evaluable, row.others.tracked, row.others.right, row.vehicles.evaluable),
            (9, 6, 6, 0)
        );
        assert_eq!((row.class_rate, row.class_rate_of_found), (Some(0.6667), Some(1.0)));
        let near = &row.ranges[1];
        assert_eq!((near.evaluable, near.found, near.covered), (6, 6, Some(0.5)));
        assert!([Some(2.0), Some(5.0)].contains(&near.median_percent), "{near:?}");
        assert_eq!(row.ranges[4].median_percent, None);
        let text = WeatherReport { method: "fast".into(), rows: vec![row] }.to_string();
        assert!(text.contains("0.667") && text.contains("0.806") && text.contains("3 cone"), "{text}");
    }
}
