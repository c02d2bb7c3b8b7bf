//! Simulated drives: the vehicle along bends and turns, boxes that stand or move, tracker and alarm.
//!
//! A box is seen as the detection sees it: its near side, the columns of all its sides within the depth of a region, with
//! noise of disparity and columns. The own motion has the noise of odometry. Seeds [`CHOOSING`] and 100 to 139 were
//! looked at while the rules were made, of 1000 to 1039 one that alarmed; [`REPORTING`] were not.

use super::path::LateralMotion;
use super::{Alarm, AlarmLevel, AlarmParameters, Candidate};
use crate::motion::Motion;
use crate::motion::body::Body;
use crate::motion::curvature::CurvatureFilter;
use crate::motion::path::SweptPath;
use crate::outline::Outline;
use crate::region::{PixelBox, Region};
use crate::rig::Rig;
use crate::road::edge_curve::{EdgeCurve, edge_curve};
use crate::tracking::filter::TimeToCollision;
use crate::tracking::filter::ground::{GroundMotion, Movement};
use crate::tracking::{Frame, Track, Tracker, TrackerParameters};
use std::ops::Range;

const RIG: Rig = Rig { focal_px: 879.0, baseline_m: 0.12, cx_px: 320.0, cy_px: 240.0 };
const SIZE: (usize, usize) = (640, 480);
const PERIOD_S: f64 = 0.08;
const CHOOSING: Range<u64> = 0..10;
const REPORTING: Range<u64> = 2000..2040;
/// Depth of a region ([`crate::detection::RegionParameters`]), in metres.
const DEPTH_SPAN_M: f64 = 4.5;

/// A place with a heading, in the plane of the road: right, forward, to the left.
#[derive(Clone, Copy, Debug)]
struct Place {
    x: f64,
    z: f64,
    heading: f64,
}

impl Place {
    fn ahead(self, way_m: f64) -> Self {
        Self { x: self.x - way_m * self.heading.sin(), z: self.z + way_m * self.heading.cos(), ..self }
    }

    fn right(self, way_m: f64) -> Self {
        Self { x: self.x + way_m * self.heading.cos(), z: self.z + way_m * self.heading.sin(), ..self }
    }

    fn turned(self, angle: f64) -> Self {
        Self { heading: self.heading + angle, ..self }
    }

    /// A point seen from here: right, forward.
    fn sees(self, x: f64, z: f64) -> [f64; 2] {
        let (dx, dz) = (x - self.x, z - self.z);
        let (sine, cosine) = self.heading.sin_cos();
        [cosine * dx + sine * dz, cosine * dz - sine * dx]
    }
}

/// A road: curvature by length from its start; the vehicle follows it.
#[derive(Clone, Copy, Debug)]
struct Road {
    /// Straight until here, in metres, then a transition of [`TRANSITION_M`] to the curvature, until the second length.
    bend_m: [f64; 2],
    curvature: f64,
}

const TRANSITION_M: f64 = 10.0;
const STRAIGHT: Road = Road { bend_m: [0.0; 2], curvature: 0.0 };

impl Road {
    fn curvature_at(&self, way_m: f64) -> f64 {
        let [from, to] = self.bend_m;
        let share = ((way_m - from) / TRANSITION_M).min((to - way_m) / TRANSITION_M).clamp(0.0, 1.0);
        self.curvature * share
    }

    /// The place after this length.
    fn place(&self, way_m: f64) -> Place {
        let start = Place { x: 0.0, z: 0.0, heading: 0.0 };
        let steps = (way_m.abs() / 0.05).ceil().max(1.0);
        let step = way_m / steps;
        (0..steps as u32).fold(start, |place, i| {
            let angle = self.curvature_at((f64::from(i) + 0.5) * step) * step;
            place.turned(angle / 2.0).ahead(step).turned(angle / 2.0)
        })
    }
}

/// A thing: its middle moves along the road (length, offset to the right) or freely.
#[derive(Clone, Copy, Debug)]
struct Thing {
    /// Length along the road and offset at the start.
    along_m: f64,
    offset_m: f64,
    /// Rates of both, in m/s.
    along_m_s: f64,
    across_m_s: f64,
    /// The offset changes only until here.
    stops_at_m: f64,
    length_m: f64,
    width_m: f64,
}

fn car(along_m: f64, offset_m: f64) -> Thing {
    Thing {
        along_m,
        offset_m,
        along_m_s: 0.0,
        across_m_s: 0.0,
        stops_at_m: f64::INFINITY,
        length_m: 4.4,
        width_m: 1.8,
    }
}

fn walker(along_m: f64, offset_m: f64, across_m_s: f64) -> Thing {
    Thing { across_m_s, length_m: 0.4, width_m: 0.5, ..car(along_m, offset_m) }
}

struct Drive {
    road: Road,
    speed_m_s: f64,
    seconds: f64,
    things: Vec<Thing>,
    /// Lateral positions of the road's edges, if they are seen.
    edges_m: Option<[f64; 2]>,
}

/// Centres of the segments of the road's edges, in metres ahead of the camera.
const SEGMENTS_M: [f64; 8] = [5.75, 7.25, 9.0, 11.0, 13.0, 15.0, 17.0, 19.25];

/// What the alarm did.
#[derive(Clone, Copy, Debug, Default)]
struct Outcome {
    warning_frames: u32,
    alarm_frames: u32,
    /// Time to the first thing, along the road from camera to its near side, at the first alarm.
    ttc_s: Option<f64>,
    distance_m: Option<f64>,
}

fn normal(random: &mut fastrand::Rng) -> f64 {
    (0..12).map(|_| random.f64()).sum::<f64>() - 6.0
}

/// The region of a thing seen from the camera, with noise.
fn region(camera: Place, thing: &Thing, at: Place, random: &mut fastrand::Rng) -> Option<Region> {
    let (mut columns, mut nearest) = (Vec::new(), f64::INFINITY);
    for side in 0..4 {
        for step in 0..20 {
            let share = f64::from(step) / 20.0 - 0.5;
            let (l, w) = [(share, -0.5), (share, 0.5), (-0.5, share), (0.5, share)][side];
            let p = at.ahead(l * thing.length_m).right(w * thing.width_m);
            let [x, z] = camera.sees(p.x, p.z);
            let column = RIG.cx_px + RIG.focal_px * x / z.max(0.1);
            if z > 1.5 && (0.0..640.0).contains(&column) {
                nearest = nearest.min(z);
                columns.push((column, z, x));
            }
        }
    }
    let far = nearest + DEPTH_SPAN_M;
    let span = columns.iter().filter(|c| c.1 <= far);
    let ends = |of: fn(&(f64, f64, f64)) -> f64| {
        span.clone().map(of).fold((f64::INFINITY, f64::NEG_INFINITY), |(l, r), v| (l.min(v), r.max(v)))
    };
    let ((left, right), (left_m, right_m)) = (ends(|c| c.0), ends(|c| c.2));
    if !(nearest < 60.0 && right - left >= 6.0) {
        return None;
    }
    let disparity_px = (RIG.disparity_px(nearest) + 0.12 * normal(random)).max(0.5);
    let distance_m = RIG.distance_m(disparity_px);
    let jitter =
        |random: &mut fastrand::Rng, v: f64| (v + f64::from(random.i32(-4..5))).clamp(0.0, 640.0) as u32;
    let x = jitter(random, left);
    let width = jitter(random, right).saturating_sub(x).max(4);
    let px = |m: f64| RIG.focal_px * m / distance_m;
    let (top, bottom) = (RIG.cy_px - px(0.25), (RIG.cy_px + px(1.25)).min(480.0));
    let bounds = PixelBox { x, y: top.max(0.0) as u32, width, height: (bottom - top.max(0.0)) as u32 };
    let mut region = Region {
        bounds,
        disparity_px,
        disparity_sigma_px: 0.12,
        distance_m,
        lateral_m: RIG.lateral_m(f64::from(x) + f64::from(width) / 2.0, distance_m),
        width_m: f64::from(width) * distance_m / RIG.focal_px,
        height_m: 1.5,
        inset_m: [0.0; 2],
        is_hidden: [false; 2],
        goes_on: [false; 2],
        outline: Outline::default(),
        pixels: 2000,
        confidence: 0.9,
        evidence: 4.0,
    };
    region.set_ends([left_m, right_m]);
    Some(region)
}

impl Drive {
    /// Where a thing is after some seconds.
    fn thing_at(&self, thing: &Thing, seconds: f64) -> (f64, Place) {
        let along_m = thing.along_m + thing.along_m_s * seconds;
        let moved = thing.offset_m + thing.across_m_s * seconds;
        let offset_m =
            if thing.across_m_s > 0.0 { moved.min(thing.stops_at_m) } else { moved.max(-thing.stops_at_m) };
        (along_m, self.road.place(along_m).right(offset_m))
    }

    /// Distance from the camera back to the point about which the vehicle turns, which is what follows the road, in metres.
    fn turning_axle_m(&self) -> f64 {
        let motion = Motion { speed_m_s: self.speed_m_s, ..Motion::default() };
        Body::default().during(&motion).rear_axle_m
    }

    /// Change of the yaw rate over the last frame, in rad/s².
    fn yaw_acceleration_rad_s2(&self, way_m: f64) -> f64 {
        let before = self.road.curvature_at(way_m - self.speed_m_s * PERIOD_S);
        self.speed_m_s * (self.road.curvature_at(way_m) - before) / PERIOD_S
    }

    /// The curve of the road's edges seen from the camera, with the noise of edges.
    fn road_ahead(&self, camera: Place, way_m: f64, random: &mut fastrand::Rng) -> Option<EdgeCurve> {
        let mut found = Vec::new();
        for (side, offset_m) in self.edges_m?.into_iter().enumerate() {
            for z in SEGMENTS_M {
                let p = self.road.place(way_m + self.turning_axle_m() + z).right(offset_m);
                let [x, z] = camera.sees(p.x, p.z);
                found.push((side, x + 0.1 * normal(random), z));
            }
        }
        edge_curve(found.into_iter())
    }

    fn run(&self, seed: u64, is_motion_known: bool) -> Outcome {
        let mut random = fastrand::Rng::with_seed(seed);
        let body = Body::default();
        let mut tracker = Tracker::new(TrackerParameters::default(), RIG, SIZE).with_body(body);
        let (mut alarm, mut curvature) = (Alarm::new(AlarmParameters::default()), CurvatureFilter::default());
        let mut outcome = Outcome::default();
        for frame in 0..(self.seconds / PERIOD_S) as u64 {
            let seconds = frame as f64 * PERIOD_S;
            let way_m = self.speed_m_s * seconds;
            let camera = self.road.place(way_m).ahead(self.turning_axle_m());
            let mut regions: Vec<Region> = self
                .things
                .iter()
                .filter_map(|thing| region(camera, thing, self.thing_at(thing, seconds).1, &mut random))
                .collect();
            regions.sort_unstable_by(|a, b| a.distance_m.total_cmp(&b.distance_m));
            let motion = is_motion_known.then(|| Motion {
                speed_m_s: self.speed_m_s + 0.1 * normal(&mut random),
                speed_sigma_m_s: 0.1,
                yaw_rate_rad_s: self.speed_m_s * self.road.curvature_at(way_m) + 0.005 * normal(&mut random),
                yaw_rate_sigma_rad_s: 0.005,
                yaw_acceleration_rad_s2: self.yaw_acceleration_rad_s2(way_m) + 0.03 * normal(&mut random),
                ..Motion::default()
            });
            let time_ns = (seconds * 1e9) as u64;
            tracker.follow(&Frame { motion, ..Frame::new(time_ns, &regions) });
            let road = self.road_ahead(camera, way_m, &mut random);
            let path = motion.map(|m| curvature.update(&m, PERIOD_S, body, road));
            let confirmed = tracker.confirmed().map(Track::state);
            let state =
                alarm.update_on_path(time_ns, true, path, confirmed.map(|obstacle| Candidate::of(&obstacle)));
            outcome.warning_frames += u32::from(state.level >= AlarmLevel::Warning);
            if state.level == AlarmLevel::Alarm {
                outcome.alarm_frames += 1;
                if outcome.ttc_s.is_none() {
                    let thing = &self.things[0];
                    let gap_m = self.thing_at(thing, seconds).0
                        - thing.length_m / 2.0
                        - way_m
                        - self.turning_axle_m();
                    outcome.ttc_s = Some(gap_m / (self.speed_m_s - thing.along_m_s));
                    outcome.distance_m = Some(gap_m);
                }
            }
        }
        outcome
    }

    /// Runs all seeds with known motion. Returns their outcomes, and prints a summary.
    fn outcomes(&self, name: &str) -> Vec<Outcome> {
        let mut all = Vec::new();
        for (which, seeds) in [("choosing", CHOOSING), ("reporting", REPORTING)] {
            let found: Vec<Outcome> = seeds.map(|seed| self.run(seed, true)).collect();
            let frames = found.len() as f64 * (self.seconds / PERIOD_S).floor();
            let share =
                |of: fn(&Outcome) -> u32| f64::from(found.iter().map(of).sum::<u32>()) / frames * 100.0;
            let mut ttcs: Vec<f64> = found.iter().filter_map(|o| o.ttc_s).collect();
            ttcs.sort_unstable_by(f64::total_cmp);
            println!(
                "{name}, {which}: warning or alarm in {:.1} % of frames, alarm in {:.1} %; alarms in {} of {} drives, at \
                 {:.2} s at the latest",
                share(|o| o.warning_frames),
                share(|o| o.alarm_frames),
                ttcs.len(),
                found.len(),
                ttcs.first().copied().unwrap_or(f64::NAN),
            );
            all.extend(found);
        }
        all
    }

    /// Drives with a warning; none has an alarm.
    fn warned(&self, name: &str) -> usize {
        let outcomes = self.outcomes(name);
        assert!(outcomes.iter().all(|o| o.alarm_frames == 0), "{name}: alarm");
        outcomes.iter().filter(|o| o.warning_frames > 0).count()
    }

    fn assert_silent(&self, name: &str) {
        assert_eq!(self.warned(name), 0, "{name}: drives with a warning");
    }

    /// Each drive alarms at least this long before the collision.
    fn assert_alarms(&self, name: &str, ttc_s: f64) {
        for outcome in self.outcomes(name) {
            assert!(outcome.ttc_s.is_some_and(|t| t >= ttc_s), "{name}: {outcome:?}");
        }
    }
}

/// Edges of a road of two lanes, seen from the right one.
const LANES: Option<[f64; 2]> = Some([-5.2, 2.0]);

/// A path of this curvature, in 1/m, and of this speed, in m/s.
pub(super) fn arc(curvature_per_m: f64, speed_m_s: f64) -> SweptPath {
    SweptPath {
        curvature_per_m,
        curvature_sigma_per_m: 0.001,
        speed_m_s,
        speed_sigma_m_s: 0.1,
        body: Body::default(),
        edges: None,
        is_turning_in: false,
    }
}

#[test]
fn a_turn_that_begins_raises_alarms_but_no_warnings() {
    let ground = GroundMotion {
        speed_m_s: [0.0; 2],
        speed_sigma_m_s: [0.1; 2],
        place_sigma_m: [0.1; 2],
        correlations: [0.0; 6],
        movement: Movement::Standing,
    };
    let level_at = |distance_m: f64, is_turning_in: bool| {
        let mut alarm = Alarm::new(AlarmParameters::default());
        let mut level = AlarmLevel::Off;
        for frame in 0..3 {
            let thing = Candidate {
                track: 1,
                seen: 20,
                consecutive_frames: 20,
                distance_m,
                closing_m_s: 10.0,
                time_to_collision: Some(TimeToCollision { seconds: distance_m / 10.0, sigma_s: 0.05 }),
                motion: LateralMotion { width_m: 1.8, ..LateralMotion::default() },
                ground: Some(ground),
                ..Candidate::default()
            };
            let path = SweptPath { is_turning_in, ..arc(0.0, 10.0) };
            level = alarm.update_on_path(frame * 80_000_000, true, Some(path), [thing]).level;
        }
        level
    };
    let levels = |distance_m| [level_at(distance_m, false), level_at(distance_m, true)];
    assert_eq!(levels(25.0), [AlarmLevel::Warning, AlarmLevel::Clear]);
    assert_eq!(levels(15.0), [AlarmLevel::Alarm; 2]);
}

/// Bends to both sides.
fn bends(radius_m: f64) -> [Road; 2] {
    [1.0, -1.0].map(|side| Road { bend_m: [10.0, 200.0], curvature: side / radius_m })
}

#[test]
fn a_car_parked_beyond_the_outer_edge_of_a_bend_is_silent() {
    for road in bends(60.0) {
        // On the right lane: the outer edge of a bend to the left is near, that of a bend to the right is beyond the other lane.
        let offset_m = if road.curvature > 0.0 { 4.0 } else { -7.0 };
        let things = [30.0, 45.0, 60.0].map(|along| car(along, offset_m)).to_vec();
        Drive { road, speed_m_s: 11.0, seconds: 6.0, things, edges_m: LANES }
            .assert_silent("parked beyond a bend");
    }
}

#[test]
fn a_car_that_stands_in_our_lane_around_a_bend_alarms_in_time() {
    for road in bends(60.0) {
        for along in [45.0, 60.0] {
            let drive = Drive {
                road,
                speed_m_s: 11.0,
                seconds: along / 11.0 - 0.5,
                things: vec![car(along, 0.0)],
                edges_m: LANES,
            };
            drive.assert_alarms("standing around a bend", 1.6);
        }
    }
}

#[test]
fn a_turn_at_a_junction_past_parked_cars_is_silent() {
    for side in [1.0, -1.0] {
        // A quarter turn of 8 m radius at 5 m/s; cars on both sides of the road turned into and at the corner.
        let road = Road { bend_m: [12.0, 12.0 + 8.0 * 1.57 + TRANSITION_M], curvature: side / 8.0 };
        let mut things: Vec<Thing> =
            [37.0, 43.0, 49.0].iter().flat_map(|&a| [car(a, 2.8), car(a, -2.8)]).collect();
        things.push(car(6.0, -side * 2.8));
        let drive = Drive { road, speed_m_s: 5.0, seconds: 9.0, things, edges_m: None };
        drive.assert_silent("turn past parked cars");
    }
}

#[test]
fn parked_cars_half_a_metre_beside_the_body_are_silent() {
    for side in [1.0, -1.0] {
        let things: Vec<Thing> = (3..12).map(|i| car(f64::from(i) * 6.0, side * 2.3)).collect();
        for speed_m_s in [4.0, 8.0, 12.0] {
            let things = things.clone();
            Drive { road: STRAIGHT, speed_m_s, seconds: 60.0 / speed_m_s, things, edges_m: None }
                .assert_silent("parked 0.5 m beside");
        }
    }
}

#[test]
fn traffic_beside_us_is_silent() {
    for road in [STRAIGHT, bends(60.0)[0], bends(60.0)[1]] {
        let moving =
            |along_m: f64, offset_m: f64, along_m_s: f64| Thing { along_m_s, ..car(along_m, offset_m) };
        let oncoming = vec![moving(80.0, -3.4, -10.0), moving(110.0, -3.4, -11.0)];
        Drive { road, speed_m_s: 10.0, seconds: 6.0, things: oncoming, edges_m: LANES }
            .assert_silent("oncoming");
        let overtaken = vec![moving(25.0, 3.4, 6.0)];
        Drive { road, speed_m_s: 11.0, seconds: 6.0, things: overtaken, edges_m: LANES }
            .assert_silent("overtaking");
        let overtaking = vec![moving(-10.0, -3.4, 15.0)];
        Drive { road, speed_m_s: 10.0, seconds: 6.0, things: overtaking, edges_m: LANES }
            .assert_silent("overtaken");
    }
}

#[test]
fn a_car_that_is_followed_is_hardly_ever_said_to_brake() {
    let warned: usize = [STRAIGHT, bends(60.0)[0], bends(60.0)[1]]
        .into_iter()
        .map(|road| {
            let ahead = vec![Thing { along_m_s: 10.0, ..car(16.0, 0.0) }];
            Drive { road, speed_m_s: 10.0, seconds: 6.0, things: ahead, edges_m: LANES }.warned("following")
        })
        .sum();
    // Distances by disparity alone, with errors that are independent between frames: half a metre over four frames looks like braking.
    let drives = 3 * (CHOOSING.count() + REPORTING.count());
    println!("following: a warning in {warned} of {drives} drives");
    assert!(warned <= 2, "{warned}");
}

#[test]
fn a_stopped_car_ahead_alarms_as_early_as_on_the_straight_strip() {
    for (speed_m_s, from_m) in [(5.0, 35.0), (9.0, 45.0), (13.9, 68.0)] {
        let seconds = from_m / speed_m_s - 0.8;
        let drive =
            Drive { road: STRAIGHT, speed_m_s, seconds, things: vec![car(from_m, 0.3)], edges_m: None };
        // The limit less a frame: the rules are evaluated ahead by the frames of confirmation.
        drive.assert_alarms("stopped car", 1.5);
        let mean = |known: bool| {
            let all = REPORTING.map(|seed| drive.run(seed, known).distance_m.expect("an alarm"));
            all.sum::<f64>() / REPORTING.count() as f64
        };
        let (known, unknown) = (mean(true), mean(false));
        println!("{speed_m_s} m/s: first alarm at {known:.2} m with motion, {unknown:.2} m without");
        assert!(known > unknown - 0.02 * unknown, "{known} {unknown}");
    }
}

#[test]
fn what_enters_the_strip_alarms() {
    // A walker from the left, 1.4 m/s, in the strip when we arrive; a car that cuts in 14 m ahead, 4 m/s slower.
    let walks = Drive {
        road: STRAIGHT,
        speed_m_s: 8.0,
        seconds: 3.3,
        things: vec![walker(30.0, -4.6, 1.4)],
        edges_m: None,
    };
    walks.assert_alarms("walker", 1.2);
    let cuts_in = Thing { along_m_s: 6.0, across_m_s: 1.5, stops_at_m: 0.0, ..car(24.0, -3.4) };
    Drive { road: STRAIGHT, speed_m_s: 10.0, seconds: 4.6, things: vec![cuts_in], edges_m: None }
        .assert_alarms("cut-in", 1.2);
    let leaves = Drive {
        road: STRAIGHT,
        speed_m_s: 8.0,
        seconds: 6.0,
        things: vec![walker(32.0, -0.5, 2.0)],
        edges_m: None,
    };
    leaves.assert_silent("walker who has left");
}

#[test]
fn at_rest_only_what_drives_into_us_warns() {
    let at_rest =
        |things: Vec<Thing>| Drive { road: STRAIGHT, speed_m_s: 0.0, seconds: 6.0, things, edges_m: None };
    at_rest(vec![car(8.0, 0.0), walker(7.0, -4.0, 1.4), car(10.0, 2.2)]).assert_silent("at rest");
    let rolls = Thing { along_m_s: -6.0, ..car(42.0, 0.0) };
    at_rest(vec![rolls]).assert_alarms("at rest, driven into", 1.4);
}

#[test]
fn who_may_be_in_the_way_of_a_turn_raises_a_warning_and_keeps_no_alarm() {
    let path = |curvature_per_m| arc(curvature_per_m, 5.56);
    // The walker is where the turn leads, or straight ahead.
    let walker = |lateral_m, distance_m, speed_m_s: [f64; 2]| Candidate {
        track: 1,
        seen: 20,
        consecutive_frames: 20,
        distance_m,
        closing_m_s: 6.0,
        time_to_collision: Some(TimeToCollision { seconds: distance_m / 6.0, sigma_s: 0.1 }),
        motion: LateralMotion { lateral_m, width_m: 0.6, ..LateralMotion::default() },
        ground: Some(GroundMotion {
            speed_m_s,
            speed_sigma_m_s: [0.3; 2],
            place_sigma_m: [0.05, 0.1],
            correlations: [0.0; 6],
            movement: Movement::Moving,
        }),
        ..Candidate::default()
    };
    let turning = || walker(-2.64, 12.4, [-1.5, -0.9]);
    let mut alarm = Alarm::new(AlarmParameters::default());
    let step_ns = 80_000_000;
    let states: Vec<_> = (0..5)
        .map(|frame| alarm.update_on_path(frame * step_ns, true, Some(path(1.0 / 15.0)), [turning()]))
        .collect();
    assert_eq!(states[4].level, AlarmLevel::Warning, "{states:?}");
    assert_eq!(states[4].nearest_m, None, "it is not said to be in the path: {states:?}");
    // An alarm that it raised before ends when it only may be in the way.
    let mut alarm = Alarm::new(AlarmParameters::default());
    let ahead = || walker(0.0, 6.0, [0.0, -0.5]);
    let raised =
        (0..5).map(|frame| alarm.update_on_path(frame * step_ns, true, Some(path(0.0)), [ahead()])).last();
    assert_eq!(raised.map(|state| state.level), Some(AlarmLevel::Alarm));
    let later = (5..25)
        .map(|frame| alarm.update_on_path(frame * step_ns, true, Some(path(1.0 / 15.0)), [turning()]))
        .last();
    assert_eq!(later.map(|state| state.level), Some(AlarmLevel::Warning));
}
