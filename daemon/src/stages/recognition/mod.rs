//! The stage recognition: `regions` to `obstacles` (classes of tracked obstacles, and the alarm).

pub mod cascade;
pub mod detectors;
pub mod parameters;

use super::motion::motion;
use super::stage::{FrameContext, FrameError, SetupError, Stage};
use crate::launch::FrameFormat;
use crate::stages::motion::body;
use crate::stages::track_record;
use config::Config;
use detectors::{Detector, RegionView, detectors};
use messages::alarm::Faults;
use messages::header::{modes, put_text};
use messages::obstacles::{AlarmRecord, MAX_COUNT, ObstacleRecord, ObstaclesMessage};
use messages::regions::{Regions, RegionsMessage, RoadRecord};
use messages::source_time::SourceTimeRecord;
use messages::track::MAX_TRACKS;
use messages::typed::{Output, Written};
use parameters::alarm_parameters;
use perception::alarm::{Alarm, Candidate};
use perception::frame_clock::{FrameClock, TimeStep};
use perception::image::GreyView;
use perception::motion::body::Body;
use perception::motion::curvature::CurvatureFilter;
use perception::motion::path::SweptPath;
use perception::road::edge_curve::{EdgeCurve, edge_curve};
use perception::tracking::Obstacle;
use perception::tracking::filter::ground::Movement;

/// Name of the class of obstacles that were not recognised.
pub const UNRECOGNISED: &str = "obstacle";

/// Adapter of recognisers and alarm.
pub struct RecognitionStage {
    detectors: Vec<Detector>,
    /// Tracked obstacles of the last frame, and since when their numbers hold.
    obstacles: Vec<Obstacle>,
    tracks_since: Option<u32>,
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
    baseline_m: f64,
    records: Vec<ObstacleRecord>,
    /// Sequence and alarm of the last frame: a frame that is repeated in lock-step gets the same result.
    last: Option<(u64, AlarmRecord)>,
}

impl RecognitionStage {
    /// Classifies the tracked obstacles of a message, writes the obstacles to `records`, and returns the alarm.
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
            self.curvature = CurvatureFilter::default();
        }
        if self.tracks_since.replace(message.road.tracks_since) != Some(message.road.tracks_since) {
            // A number now means another track.
            self.detectors.iter_mut().for_each(|detector| detector.schedule.reset());
            self.alarm.reset();
        }
        // A repeated time leaves classes as they are: the tracks are those of the frame before.
        if step != TimeStep::Repeated {
            let own = motion(&frame.motion);
            self.path = own
                .map(|m| self.curvature.update(&m, step.elapsed_s(), self.body, road_curve(&message.road)));
            if own.is_none() {
                self.curvature = CurvatureFilter::default();
            }
            self.obstacles.clear();
            self.obstacles.extend(message.tracks.iter().map(track_record::obstacle));
            if frame.modes & modes::RECOGNITION_OFF == 0 {
                self.recognise(message);
            }
        }
        let candidates = self.obstacles.iter().filter(|o| o.is_confirmed).map(Candidate::of);
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
            held: u32::from(state.is_held),
            nearest_m: state.nearest_m.unwrap_or(f64::INFINITY),
            time_to_collision_s: state.time_to_collision.map_or(f64::INFINITY, |t| t.seconds),
            required_deceleration_m_s2: state.required_deceleration_m_s2,
            road_seen: road.seen,
            obstacles: 0,
            slope: road.slope,
            horizon_px: road.horizon_px,
            confidence: road.confidence,
            camera_height_m: road.camera_height_m,
            space: road.space,
            ..self.path.as_ref().map_or_else(|| self.straight_fields(), path_fields)
        };
        let alarm = self.with_object(alarm, state.object).limited();
        self.records.clear();
        for obstacle in self.obstacles.iter().take(MAX_COUNT) {
            let candidate = Candidate::of(obstacle);
            let in_path = candidate
                .in_the_way(self.path.as_ref(), self.path_width_m, false)
                .is_some_and(|candidate| candidate.is_sure());
            let clearance_m = candidate.clearance_m(self.path.as_ref(), self.path_width_m);
            let record = obstacle_record(obstacle, in_path, self.class(obstacle.track));
            self.records.push(ObstacleRecord { clearance_m, ..record }.limited());
        }
        self.last = Some((frame.sequence, alarm));
        alarm
    }

    /// An alarm with the fields of what it is about: class and clearance are unknown of a track that is lost.
    fn with_object(&self, alarm: AlarmRecord, object: Option<u32>) -> AlarmRecord {
        let found = self.obstacles.iter().find(|obstacle| Some(obstacle.track) == object);
        AlarmRecord {
            object: object.unwrap_or(0),
            clearance_m: found.map_or(f64::INFINITY, |obstacle| {
                Candidate::of(obstacle).clearance_m(self.path.as_ref(), self.path_width_m)
            }),
            class: found.map_or([0; 16], |o| class_name(self.class(o.track))),
            ..alarm
        }
    }

    /// Class of a track and its probability: that of the strongest evidence, of equal ones the first detector's. `None` if
    /// it was not recognised.
    fn class(&self, track: u32) -> Option<(&str, f64)> {
        let known = self.detectors.iter().rev().flat_map(|d| {
            let classes = d.labels.iter().enumerate().rev();
            classes.filter_map(|(i, label)| Some((&label[..], d.schedule.probability(track, i)?)))
        });
        known.max_by(|a, b| a.1.total_cmp(&b.1))
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

    /// Classifies the obstacles that the schedule selects. Those without a usable crop are not classified.
    fn recognise(&mut self, message: &Regions<'_>) {
        let (tracks, baseline_m) = (&message.tracks, self.baseline_m);
        for detector in &mut self.detectors {
            detector.classify(&self.obstacles, |i, sizes| {
                let record = tracks.get(i).filter(|record| sizes.fit(record.width_m, record.height_m))?;
                let [_, _, width, height] = record.crop.map(|v| v as usize);
                let crop = GreyView::new(message.crop(record)?, width, height, width).ok()?;
                Some(RegionView::new(record, crop, baseline_m))
            });
        }
    }
}

impl Stage for RecognitionStage {
    type In = RegionsMessage;
    type Out = ObstaclesMessage;

    fn new(config: &Config, format: &FrameFormat) -> Result<Self, SetupError> {
        Ok(Self {
            detectors: detectors(config, format.width, format.height)?,
            obstacles: Vec::with_capacity(MAX_TRACKS),
            tracks_since: None,
            alarm: Alarm::new(alarm_parameters(config)),
            clock: FrameClock::default(),
            source_time: SourceTimeRecord::default(),
            road_ns: 0,
            hold_ns: alarm_parameters(config).hold_ns,
            path_width_m: config.alarm.path_width_m,
            body: body(config),
            curvature: CurvatureFilter::default(),
            path: None,
            baseline_m: format.rig().baseline_m,
            records: Vec::with_capacity(MAX_COUNT),
            last: None,
        })
    }

    fn check(config: &Config, format: &FrameFormat) -> Result<(), SetupError> {
        detectors(config, format.width, format.height)?;
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

/// Name of a class.
fn class_name(class: Option<(&str, f64)>) -> [u8; 16] {
    let mut name = [0; 16];
    put_text(&mut name, class.map_or(UNRECOGNISED, |(label, _)| label));
    name
}

fn obstacle_record(obstacle: &Obstacle, in_path: bool, class: Option<(&str, f64)>) -> ObstacleRecord {
    let b = obstacle.bounds;
    let (ttc, ground) = (obstacle.time_to_collision, obstacle.ground);
    ObstacleRecord {
        track: obstacle.track,
        confirmed: u32::from(obstacle.is_confirmed),
        seen: obstacle.seen,
        missed: obstacle.missed,
        bounds: [b.x, b.y, b.width, b.height],
        probability: obstacle.probability,
        distance_m: obstacle.distance_m,
        distance_sigma_m: obstacle.distance_sigma_m,
        lateral_m: obstacle.lateral_m,
        width_m: obstacle.width_m,
        height_m: obstacle.height_m,
        across_m_s: ground.map_or(obstacle.lateral_speed_m_s, |g| g.speed_m_s[0]),
        along_m_s: ground.map_or(0.0, |g| g.speed_m_s[1]),
        closing_m_s: obstacle.closing_m_s,
        closing_sigma_m_s: obstacle.closing_sigma_m_s,
        time_to_collision_s: ttc.map_or(f64::INFINITY, |t| t.seconds),
        time_to_collision_sigma_s: ttc.map_or(0.0, |t| t.sigma_s),
        in_path: u32::from(in_path),
        moving: ground.map_or(Movement::Unknown, |g| g.movement) as u32,
        score: class.map_or(0.0, |(_, probability)| probability),
        class: class_name(class),
        ..ObstacleRecord::default()
    }
}

#[cfg(test)]
mod tests {
    use super::Movement;
    use messages::alarm::{LEVELS, MOVING, RULES, level_name, moving_name, rule_name};
    use perception::alarm::{AlarmLevel, AlarmRule};

    #[test]
    fn numbers_of_levels_and_rules_match_their_names() {
        let levels = [AlarmLevel::Off, AlarmLevel::Clear, AlarmLevel::Warning, AlarmLevel::Alarm];
        assert_eq!(levels.map(|l| level_name(l as u32)), LEVELS);
        assert_eq!(levels[3] as u32, messages::alarm::ALARM);
        let rules = [AlarmRule::Distance, AlarmRule::TimeToCollision, AlarmRule::Deceleration];
        assert_eq!(rules.map(|r| rule_name(r as u32).unwrap()), RULES[1..]);
        assert_eq!(rule_name(AlarmRule::None as u32), None);
        let movements = [Movement::Unknown, Movement::Standing, Movement::Moving];
        assert_eq!(movements.map(|m| moving_name(m as u32)), MOVING);
    }
}
