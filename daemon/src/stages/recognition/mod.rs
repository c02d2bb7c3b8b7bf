//! The stage recognition: `regions` to `obstacles` (tracks, classes and the alarm).

pub mod cascade;
pub mod parameters;

use super::motion::motion;
use super::stage::{FrameContext, FrameError, SetupError, Stage};
use crate::launch::FrameFormat;
use crate::stages::motion::body;
use cascade::recogniser;
use config::Config;
use messages::alarm::Faults;
use messages::header::{modes, put_text};
use messages::obstacles::{AlarmRecord, MAX_COUNT, ObstacleRecord, ObstaclesMessage};
use messages::regions::{self, RegionRecord, Regions, RegionsMessage, RoadRecord};
use messages::source_time::SourceTimeRecord;
use messages::typed::{Output, Written};
use parameters::{alarm_parameters, schedule_parameters, tracker_parameters};
use perception::alarm::{Alarm, Candidate};
use perception::frame_clock::{FrameClock, TimeStep};
use perception::image::GreyView;
use perception::motion::body::Body;
use perception::motion::curvature::CurvatureFilter;
use perception::motion::path::SweptPath;
use perception::recognition::Recogniser;
use perception::region::{PixelBox, Region};
use perception::rig::Rig;
use perception::road::edge_curve::{EdgeCurve, edge_curve};
use perception::tracking::classification_schedule::ScheduleParameters;
use perception::tracking::scale_change::ScaleChangeMeter;
use perception::tracking::{Track, Tracker};

/// Name of the class of obstacles that were not recognised.
pub const UNRECOGNISED: &str = "obstacle";

/// Minimum width and height of a region that is classified, as a share of the recogniser's window. Smaller regions
/// (posts, kerbs) can only be parts of an object.
const MIN_SHARE: f64 = 0.35;

/// Adapter of recogniser, tracker and alarm.
pub struct RecognitionStage {
    recogniser: Option<Box<dyn Recogniser>>,
    label: String,
    /// Minimum width and height of a region that is classified, in metres.
    min_m: f64,
    schedule: ScheduleParameters,
    tracker: Tracker,
    scale_change: ScaleChangeMeter,
    alarm: Alarm,
    clock: FrameClock,
    source_time: SourceTimeRecord,
    path_width_m: f64,
    body: Body,
    curvature: CurvatureFilter,
    /// The path that the body sweeps; `None` while the own motion is unknown.
    path: Option<SweptPath>,
    /// Source time of the last frame with a road.
    road_ns: u64,
    /// How long a raised alarm stays on without a road, in nanoseconds.
    hold_ns: u64,
    rig: Rig,
    regions: Vec<Region>,
    records: Vec<ObstacleRecord>,
    /// Sequence and alarm of the last frame: a frame that is repeated in lock-step gets the same result.
    last: Option<(u64, AlarmRecord)>,
}

impl RecognitionStage {
    /// Tracks and classifies the regions of a message, writes the obstacles to `records`, and returns the alarm.
    fn update(&mut self, frame: &FrameContext, message: &Regions<'_>) -> AlarmRecord {
        if let Some((sequence, alarm)) = self.last
            && sequence == frame.sequence
        {
            return alarm;
        }
        let step = self.clock.step(frame.source_ns);
        self.count(frame.sequence, step);
        if step.is_discontinuity() {
            // What was raised before says nothing about this frame.
            (self.last, self.road_ns) = (None, frame.source_ns);
            self.scale_change.reset();
            self.curvature = CurvatureFilter::default();
        }
        // A repeated time leaves tracks and classes as they are: their detections belong to the frame before.
        if step != TimeStep::Repeated {
            let own = motion(&frame.motion);
            self.path = own
                .map(|m| self.curvature.update(&m, step.elapsed_s(), self.body, road_curve(&message.road)));
            if own.is_none() {
                self.curvature = CurvatureFilter::default();
            }
            self.track(frame, message);
        }
        self.source_time.dropped_obstacles = self.tracker.dropped();
        let tracker = &self.tracker;
        let candidates = tracker.tracks().iter().filter(|t| tracker.is_confirmed(t)).map(Candidate::of);
        let road = &message.road;
        if road.seen == 1 || frame.source_ns < self.road_ns {
            self.road_ns = frame.source_ns;
        }
        // The obstacle that raised the alarm may itself hide the road.
        let is_raised = matches!(self.last, Some((_, alarm)) if alarm.track > 0);
        let is_covered = is_raised && frame.source_ns - self.road_ns <= self.hold_ns;
        let no_road = Faults::NO_ROAD.when(road.seen == 0 && !is_covered);
        let faults = frame.faults.and(no_road).and(Faults::TIME.when(self.clock.is_unreliable()));
        let state = self.alarm.update_on_path(frame.source_ns, faults.is_none(), self.path, candidates);
        let alarm = AlarmRecord {
            level: state.level as u32,
            rule: state.rule as u32,
            track: state.track.unwrap_or(0),
            faults: faults.0,
            changed: u32::from(state.changed),
            nearest_m: state.nearest_m.unwrap_or(f64::INFINITY),
            time_to_collision_s: state.time_to_collision.map_or(f64::INFINITY, |t| t.seconds),
            required_deceleration_m_s2: state.required_deceleration_m_s2,
            road_seen: road.seen,
            obstacles: 0,
            slope: road.slope,
            horizon_px: road.horizon_px,
            confidence: road.confidence,
            camera_height_m: road.camera_height_m,
            ..self.path.as_ref().map_or_else(|| self.straight_fields(), path_fields)
        }
        .limited();
        self.records.clear();
        for track in tracker.tracks().iter().take(MAX_COUNT) {
            let confirmed = tracker.is_confirmed(track);
            let candidate = Candidate::of(track);
            let in_path = candidate.in_the_way(self.path.as_ref(), self.path_width_m, false).is_some();
            self.records.push(obstacle(track, confirmed, in_path, &self.label));
        }
        self.last = Some((frame.sequence, alarm));
        alarm
    }

    /// The fields of an alarm for the straight strip, while the own motion is unknown.
    fn straight_fields(&self) -> AlarmRecord {
        AlarmRecord {
            path_half_width_m: self.path_width_m / 2.0,
            path_rear_axle_m: self.body.rear_axle_m,
            path_front_m: self.body.front_m,
            ..AlarmRecord::default()
        }
    }

    /// Updates tracks and classes from the regions of a message.
    fn track(&mut self, frame: &FrameContext, message: &Regions<'_>) {
        self.regions.clear();
        self.regions.extend(message.regions.iter().map(region));
        self.tracker.update_with_motion(frame.source_ns, &self.regions, motion(&frame.motion));
        let crop = |track: &Track| {
            let record = message.regions.get(track.detection?)?;
            let [x, y, width, height] = record.crop;
            let pixels = message.crop(record)?;
            Some((GreyView::new(pixels, width as usize, height as usize, width as usize).ok()?, (x, y)))
        };
        self.tracker.measure_scale_change(&mut self.scale_change, frame.source_ns, crop);
        if frame.modes & modes::RECOGNITION_OFF == 0 {
            self.recognise(message);
        }
    }

    /// Counts a step of the time that is not normal. Logs it at counts 1, 2, 4, 8, …: a time that is wrong in each frame
    /// must not fill the log.
    fn count(&mut self, sequence: u64, step: TimeStep) {
        let counts = &mut self.source_time;
        match step {
            TimeStep::First | TimeStep::Forward { .. } => {}
            TimeStep::Gap { elapsed_s } => {
                counts.gaps += 1;
                if counts.gaps.is_power_of_two() {
                    let total = counts.gaps;
                    tracing::warn!(sequence, elapsed_s, total, "gap in the source's time: tracks start anew");
                }
            }
            TimeStep::Back { by_s } => {
                counts.steps_back += 1;
                if counts.steps_back.is_power_of_two() {
                    let total = counts.steps_back;
                    tracing::warn!(sequence, by_s, total, "the source's time went back: tracks start anew");
                }
            }
            TimeStep::Repeated => {
                counts.repeats += 1;
                if counts.repeats.is_power_of_two() {
                    let total = counts.repeats;
                    tracing::warn!(sequence, total, "the source's time is that of the frame before");
                }
            }
        }
    }

    /// Classifies the tracks that the schedule selects. Tracks without a usable crop are not classified.
    fn recognise(&mut self, message: &regions::Regions<'_>) {
        let Some(recogniser) = &mut self.recogniser else { return };
        let (min_m, baseline_m) = (self.min_m, self.rig.baseline_m);
        let record = |track: &Track| track.detection.and_then(|d| message.regions.get(d));
        let may = |track: &Track| {
            record(track).is_some_and(|r| r.width_m.min(r.height_m) >= min_m && message.crop(r).is_some())
        };
        self.tracker.classify(self.schedule, may, |track| {
            let record = record(track)?;
            let [_, _, width, height] = record.crop.map(|v| v as usize);
            let crop = GreyView::new(message.crop(record)?, width, height, width).ok()?;
            let metre_px = record.disparity_px / baseline_m;
            recogniser.recognise(crop, Some(metre_px)).map(|found| found.score)
        });
    }
}

impl Stage for RecognitionStage {
    type In = RegionsMessage;
    type Out = ObstaclesMessage;

    fn new(config: &Config, format: &FrameFormat) -> Result<Self, SetupError> {
        let recogniser = recogniser(config, format.width, format.height)?;
        let (rig, size) = (format.rig(), (format.width, format.height));
        Ok(Self {
            recogniser: recogniser.map(|r| Box::new(r) as Box<dyn Recogniser>),
            label: config.recognition.label.clone(),
            min_m: MIN_SHARE * config.recognition.window_m,
            schedule: schedule_parameters(config),
            tracker: Tracker::new(tracker_parameters(config), rig, size).with_body(body(config)),
            scale_change: ScaleChangeMeter::new(format.width, format.height),
            alarm: Alarm::new(alarm_parameters(config)),
            clock: FrameClock::default(),
            source_time: SourceTimeRecord::default(),
            road_ns: 0,
            hold_ns: alarm_parameters(config).hold_ns,
            path_width_m: config.alarm.path_width_m,
            body: body(config),
            curvature: CurvatureFilter::default(),
            path: None,
            rig,
            regions: Vec::with_capacity(regions::MAX_COUNT),
            records: Vec::with_capacity(MAX_COUNT),
            last: None,
        })
    }

    fn check(config: &Config, format: &FrameFormat) -> Result<(), SetupError> {
        recogniser(config, format.width, format.height)?;
        Ok(())
    }

    fn process(
        &mut self,
        frame: &FrameContext,
        message: Regions<'_>,
        output: Output<'_, ObstaclesMessage>,
    ) -> Result<Written, FrameError> {
        let alarm = self.update(frame, &message);
        Ok(output.write(alarm, &self.records)?)
    }

    fn source_time(&self) -> SourceTimeRecord {
        self.source_time
    }
}

fn region(record: &RegionRecord) -> Region {
    let [x, y, width, height] = record.bounds;
    Region {
        bounds: PixelBox { x, y, width, height },
        disparity_px: record.disparity_px,
        disparity_sigma_px: record.disparity_sigma_px,
        distance_m: record.distance_m,
        lateral_m: record.lateral_m,
        width_m: record.width_m,
        height_m: record.height_m,
        inset_m: record.inset_m,
        confidence: record.confidence,
        evidence: record.evidence,
        pixels: record.pixels,
    }
}

/// The curvature of the road ahead, if its edges are seen.
fn road_curve(road: &RoadRecord) -> Option<EdgeCurve> {
    let edges = road.edges.iter().flat_map(|sides| sides.iter().enumerate());
    // An edge that is not seen is all zeros.
    let seen = edges.filter(|(_, edge)| edge.distance_m > 0.0);
    edge_curve(seen.map(|(side, edge)| (side, edge.lateral_m.into(), edge.distance_m.into())))
}

/// The fields of an alarm that say which path is known.
fn path_fields(path: &SweptPath) -> AlarmRecord {
    AlarmRecord {
        path_known: 1,
        path_curvature_per_m: path.curvature_per_m,
        path_curvature_sigma_per_m: path.curvature_sigma_per_m,
        path_half_width_m: path.body.width_m / 2.0,
        path_edges_from_m: path.edges.map_or(0.0, |e| e.from_m),
        path_edges_curvature_per_m: path.edges.map_or(0.0, |e| e.curvature_per_m),
        path_camera_right_m: path.body.camera_right_m,
        path_rear_axle_m: path.body.rear_axle_m,
        path_front_m: path.body.front_m,
        path_camera_yaw_rad: path.body.camera_yaw_rad,
        ..AlarmRecord::default()
    }
}

fn obstacle(track: &Track, confirmed: bool, in_path: bool, label: &str) -> ObstacleRecord {
    let b = track.region.bounds;
    let mut class = [0; 16];
    let score = track.classification.score();
    put_text(&mut class, if score.is_some() { label } else { UNRECOGNISED });
    let ttc = track.time_to_collision();
    let ground = track.ground();
    ObstacleRecord {
        track: track.id,
        confirmed: u32::from(confirmed),
        seen: track.seen,
        missed: track.missed,
        bounds: [b.x, b.y, b.width, b.height],
        distance_m: track.distance_m(),
        distance_sigma_m: track.longitudinal.distance_sigma_m(),
        lateral_m: track.lateral.lateral_m(),
        width_m: track.front_m(),
        height_m: track.region.height_m,
        across_m_s: ground.map_or(track.lateral.speed_m_s(), |g| g.speed_m_s[0]),
        along_m_s: ground.map_or(0.0, |g| g.speed_m_s[1]),
        closing_m_s: track.closing_m_s(),
        closing_sigma_m_s: track.closing_sigma_m_s(),
        time_to_collision_s: ttc.map_or(f64::INFINITY, |t| t.seconds),
        time_to_collision_sigma_s: ttc.map_or(0.0, |t| t.sigma_s),
        in_path: u32::from(in_path),
        moving: track.movement as u32,
        score: score.map_or(0.0, f64::from),
        class,
    }
    .limited()
}

#[cfg(test)]
mod tests {
    use messages::alarm::{LEVELS, MOVING, RULES, level_name, moving_name, rule_name};
    use perception::alarm::{AlarmLevel, AlarmRule};
    use perception::tracking::filter::ground::Movement;

    #[test]
    fn numbers_of_levels_and_rules_match_their_names() {
        let levels = [AlarmLevel::Off, AlarmLevel::Standby, AlarmLevel::Warning, AlarmLevel::Alarm];
        assert_eq!(levels.map(|l| level_name(l as u32)), LEVELS);
        assert_eq!(levels[3] as u32, messages::alarm::ALARM);
        let rules = [AlarmRule::Distance, AlarmRule::TimeToCollision, AlarmRule::Deceleration];
        assert_eq!(rules.map(|r| rule_name(r as u32).unwrap()), RULES[1..]);
        assert_eq!(rule_name(AlarmRule::None as u32), None);
        let movements = [Movement::Unknown, Movement::Standing, Movement::Moving];
        assert_eq!(movements.map(|m| moving_name(m as u32)), MOVING);
    }
}
