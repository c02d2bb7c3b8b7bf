//! Stereo visual odometry: the motion of the left camera from frame to frame.
//!
//! Input: the left image and the disparity map of each frame, with its time. Output: the motion since the frame before in
//! six degrees of freedom, with its covariance, or the reason why it is not known.
//!
//! Points of the scene are kept over many frames, each with the patch of the image in which it was seen first, and its
//! depth, which is filtered. In each frame they are projected by the predicted motion, their patches are enlarged to the
//! predicted scale and aligned ([`super::patch`]), and the motion is estimated from the places that are found
//! ([`super::camera_motion`]). Because patches are not renewed from frame to frame, errors of their places do not add up.
//! Moving things disagree with the motion of most points, and their points are dropped. (As in the sparse methods of
//! Forster et al., "SVO", 2014, and Geiger et al., "StereoScan", 2011, for a dense disparity map.)
//!
//! Memory is allocated once.

use super::camera_motion::{self, CameraMotion, Observation};
use super::corners::CornerFinder;
use super::patch::{self, Alignment, Patch, SCALES, WINDOW};
use super::pose::Pose;
use super::pyramid::{LEVELS, Pyramid, from_level, to_level};
use super::scene_point::ScenePoint;
use crate::image::GreyView;
use crate::rig::Rig;
use crate::simd::Level;
use crate::stereo::DisparityView;
use nalgebra::Matrix6;
use std::ops::RangeInclusive;

/// What odometry knows of the motion since the frame before.
#[derive(Clone, Copy, Debug, PartialEq)]
// A box would be an allocation per frame.
#[allow(clippy::large_enum_variant)]
pub enum OdometryResult {
    /// The first frame, or the first after [`Odometry::reset`].
    First,
    /// The motion is known.
    Known(OdometryEstimate),
    /// The motion is not known.
    Unknown(UnknownReason),
}

/// Why the motion is not known.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum UnknownReason {
    /// Too few points were found again: blocked, blurred or dark images, or too large a motion.
    FewPoints,
    /// Too few points agree with one motion.
    Disagreement,
    /// The motion that most points agree with is none of a vehicle, or too uncertain.
    Implausible,
}

/// The motion since the frame before.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OdometryEstimate {
    /// From the camera now to the camera before: the camera's movement in the frame of the camera before.
    pub motion: Pose,
    /// Covariance of translation (m) and rotation vector (rad), each x, y, z.
    pub covariance: Matrix6<f64>,
    /// Number of points that agree.
    pub inliers: usize,
    /// Number of points that were found again.
    pub points: usize,
    /// Time since the frame that it refers to, in seconds: that before, or an earlier one, if the motion was not known
    /// meanwhile.
    pub elapsed_s: f64,
    /// Error that all disparities of the map have in common, in px, to be added to them, by this frame alone; and its
    /// information (inverse variance).
    pub disparity_offset_px: (f64, f64),
}

/// Largest number of points.
const CAPACITY: usize = 400;
/// Corners nearer than this to the border of level 1, in px, are not used: their patches would not lie in the image.
const MARGIN_PX: usize = WINDOW / 2 + 4;
/// Fewest points with which a motion is known, and their share of those found again.
const MIN_INLIERS: usize = 16;
const MIN_INLIER_SHARE: f64 = 0.35;
/// Disparities below this, in px, are not used.
const MIN_DISPARITY_PX: f64 = 1.0;
/// Standard deviation of a point's disparity in one frame, in px: that of the matcher on textured surfaces.
const DISPARITY_SIGMA_PX: f64 = 0.35;
/// Smallest standard deviation of a filtered disparity, in px: the matcher's errors at a texture recur.
const MIN_DISPARITY_SIGMA_PX: f64 = 0.1;
/// Disparities around a point differ by at most this, in px, and this share: otherwise it lies at an edge in depth.
const MAX_SPREAD_PX: f64 = 1.0;
const MAX_SPREAD_SHARE: f64 = 0.06;
/// Half width of the neighbourhood that is looked at, in px.
const NEIGHBOURHOOD_PX: usize = 3;
/// Standard deviation of an aligned patch's place, in px.
const PLACE_SIGMA_PX: f64 = 0.15;
/// Largest share of a patch's variance that may remain after alignment.
const MAX_RESIDUAL_SHARE: f32 = 0.6;
/// Residual that is always allowed: noise of the sensor, in squared grey levels.
const NOISE_VARIANCE: f32 = 20.0;
/// Largest variance of the errors with which the motion becomes known, in units of the expected one. Chosen on the motorways
/// `random?seed=4`, 16 and 22: near the right speed it is 0.3 to 1.8, at wrong ones mostly 1.3 to 7, but 0.5 in seed 22.
const MAX_START_VARIANCE: f64 = 2.0;
/// Frames after which a point that is not an inlier is dropped.
const MAX_MISSES: u8 = 1;
/// Limits of what a vehicle can do.
const MAX_SPEED_M_S: f64 = 90.0;
const MAX_SIDEWAYS_M_S: f64 = 1.5;
const MAX_SIDEWAYS_SHARE: f64 = 0.25;
const MAX_TURN_RAD_S: f64 = 1.8;
const MAX_ACCELERATION_M_S2: f64 = 14.0;
const MAX_YAW_ACCELERATION_RAD_S2: f64 = 3.0;
/// Largest standard deviation of the speed, in m/s, and of the yaw rate, in rad/s, with which the motion is known.
const MAX_SPEED_SIGMA_M_S: f64 = 1.0;
const MAX_YAW_RATE_SIGMA_RAD_S: f64 = 0.05;

/// A point of the scene.
#[derive(Clone, Debug, Default)]
struct Point {
    patches: [Patch; LEVELS],
    /// Number of levels with a patch.
    levels: usize,
    /// Camera that saw it first: from there to the first frame.
    reference: Pose,
    /// Place in that image, and disparity with its variance, in px.
    x: f64,
    y: f64,
    disparity_px: f64,
    variance: f64,
    /// Consecutive frames in which it was no inlier.
    misses: u8,
    age: u32,
}

/// Estimates the motion of the camera; memory is allocated once.
#[derive(Debug)]
pub struct Odometry {
    rig: Rig,
    level: Level,
    pyramid: Pyramid,
    corners: CornerFinder,
    points: Vec<Point>,
    spare: Vec<Point>,
    observations: Vec<Observation>,
    /// Point of each observation.
    owners: Vec<u32>,
    /// The points that were found again in the last frame; none if its motion is unknown.
    found: Vec<ScenePoint>,
    occupied: Vec<bool>,
    order: Vec<(f32, u32)>,
    /// From the camera of the last frame with a known motion to the first frame.
    pose: Pose,
    /// Motion in one second, if known.
    velocity: Option<[f64; 6]>,
    /// Time since the frame of `pose`, in seconds.
    since_s: f64,
    is_first: bool,
    offset: DisparityOffset,
}

impl Odometry {
    /// Odometry for rectified images of `width` × `height` px.
    pub fn new(rig: Rig, width: usize, height: usize) -> Self {
        let pyramid = Pyramid::new(width, height);
        let corners = CornerFinder::new(width / 2, height / 2);
        Self {
            rig,
            level: Level::best(),
            occupied: vec![false; corners.cells()],
            order: Vec::with_capacity(corners.cells()),
            pyramid,
            corners,
            points: Vec::with_capacity(CAPACITY),
            spare: vec![Point::default(); CAPACITY],
            observations: Vec::with_capacity(CAPACITY),
            owners: Vec::with_capacity(CAPACITY),
            found: Vec::with_capacity(CAPACITY),
            pose: Pose::IDENTITY,
            velocity: None,
            since_s: 0.0,
            is_first: true,
            offset: DisparityOffset::default(),
        }
    }

    /// Error that all disparities have in common, in px, as far as the motion shows it: it is added to them.
    pub fn disparity_offset_px(&self) -> f64 {
        self.offset.px
    }

    /// The points that were found again in the last frame; none if its motion is unknown.
    pub fn scene_points(&self) -> &[ScenePoint] {
        &self.found
    }

    /// Forgets everything: the next frame is a first one.
    pub fn reset(&mut self) {
        self.spare.append(&mut self.points);
        (self.pose, self.velocity, self.since_s, self.is_first) = (Pose::IDENTITY, None, 0.0, true);
    }

    /// Whether what is measured next refers to the last frame, and not to an earlier one.
    pub fn starts_anew(&self) -> bool {
        self.since_s == 0.0
    }

    /// From the camera of the last frame with a known motion to the first frame.
    pub fn pose(&self) -> Pose {
        self.pose
    }

    /// Estimates the motion to a frame that was taken `elapsed_s` after the one before.
    pub fn update(
        &mut self,
        left: GreyView<'_>,
        disparity: DisparityView<'_>,
        elapsed_s: f64,
    ) -> OdometryResult {
        self.pyramid.build(left);
        self.found.clear();
        self.since_s += elapsed_s;
        if self.is_first {
            self.is_first = false;
            self.since_s = 0.0;
            self.add_points(left, disparity);
            return OdometryResult::First;
        }
        let predicted = if self.velocity.is_some() { self.predicted() } else { self.searched(left) };
        self.find_again(left, &predicted, 1);
        let found = self.observations.len();
        let result = self.estimate(&predicted);
        match result {
            Ok(estimate) => {
                self.pose = self.pose.after(&estimate.motion);
                self.velocity = Some(velocity(&estimate.motion, self.since_s));
                let to_now = estimate.motion.inverse();
                self.found.extend(self.observations.iter().map(|o| ScenePoint {
                    at_px: o.at_px,
                    distance_m: to_now.apply(o.point_m)[2],
                    is_static: o.is_inlier,
                }));
                self.since_s = 0.0;
                self.update_points(disparity);
                self.add_points(left, disparity);
                OdometryResult::Known(OdometryEstimate { points: found, ..estimate })
            }
            Err(reason) => {
                if self.since_s > MAX_LOST_S || self.velocity.is_none() {
                    // Points of so long ago will not be found again; and at the start nothing is lost.
                    self.spare.append(&mut self.points);
                    (self.velocity, self.since_s) = (None, 0.0);
                    self.add_points(left, disparity);
                }
                OdometryResult::Unknown(reason)
            }
        }
    }

    /// Lets the time of a frame pass whose picture shows nothing new: what is measured next refers to the last one that did.
    pub fn skip(&mut self, elapsed_s: f64) {
        self.found.clear();
        if !self.is_first {
            self.since_s += elapsed_s;
        }
    }

    /// Predicted motion from the camera now to that before, at constant velocity.
    fn predicted(&self) -> Pose {
        let Some(v) = self.velocity else { return Pose::IDENTITY };
        let [x, y, z, a, b, c] = v.map(|v| v * self.since_s);
        Pose { translation_m: [x, y, z], ..Pose::from_rotation_vector([a, b, c]) }
    }

    /// The motion while the velocity is not known: of the speeds straight ahead, that from which most points agree with one
    /// motion. What is far away, or moves along with the vehicle, is found again from any of them; the ground beside is not.
    fn searched(&mut self, left: GreyView<'_>) -> Pose {
        let every = (self.points.len() / SEARCHED_POINTS).max(1);
        let elapsed_s = self.since_s;
        let is_plausible = |pose: &Pose| is_plausible(&pose.inverse(), elapsed_s, None);
        let mut best = (0.0, Pose::IDENTITY);
        for speed_m_s in SEARCHED_SPEEDS_M_S {
            let motion = Pose { translation_m: [0.0, 0.0, speed_m_s * elapsed_s], ..Pose::IDENTITY };
            self.find_again(left, &motion, every);
            let start = motion.inverse();
            let found = camera_motion::estimate(&self.rig, &mut self.observations, start, is_plausible);
            // Points that were mistaken for others agree with a wrong speed, but not as well as points can.
            let agreement = |found: &CameraMotion| found.inliers as f64 / found.variance_factor.max(1.0);
            if let Some(found) = found.filter(|found| agreement(found) > best.0) {
                best = (agreement(&found), found.pose.inverse());
            }
        }
        best.1
    }

    /// Aligns the patches of one point of `every`; fills `observations`.
    fn find_again(&mut self, left: GreyView<'_>, predicted: &Pose, every: usize) {
        self.observations.clear();
        self.owners.clear();
        let to_now = self.pose.after(predicted).inverse();
        let to_before = self.pose.inverse();
        let first = if self.velocity.is_some() { 1 } else { LEVELS - 1 };
        let (rig, scale) = (self.rig, self.rig.focal_px * self.rig.baseline_m);
        for (index, point) in self.points.iter_mut().enumerate().step_by(every) {
            let place = point.place_m(&rig, scale);
            let now = to_now.after(&point.reference).apply(place);
            if now[2] < 0.5 {
                continue;
            }
            let to_px = |p: [f64; 3]| {
                [rig.cx_px + rig.focal_px * p[0] / p[2], rig.cy_px + rig.focal_px * p[1] / p[2]]
            };
            let [x, y] = to_px(now);
            let enlarged = (place[2] / now[2]) as f32;
            if !SCALES.contains(&enlarged) {
                continue;
            }
            let mut at = Alignment { x: x as f32, y: y as f32, ..Alignment::default() };
            for k in (0..point.levels.min(first + 1)).rev() {
                let mut on_level = Alignment { x: to_level(at.x, k), y: to_level(at.y, k), ..at };
                let image = self.pyramid.level(left, k);
                patch::align(self.level, &point.patches[k], enlarged, image, &mut on_level);
                if on_level.found || k == 0 {
                    at = Alignment { x: from_level(on_level.x, k), y: from_level(on_level.y, k), ..on_level };
                }
            }
            if !at.found || at.residual > MAX_RESIDUAL_SHARE * at.variance + NOISE_VARIANCE {
                continue;
            }
            let relative = to_before.after(&point.reference);
            let farther = point.moved_m(&rig, scale, -0.01);
            let depth_slope_m = relative.rotate(std::array::from_fn(|k| (farther[k] - place[k]) / 0.01));
            self.observations.push(Observation {
                point_m: relative.apply(place),
                depth_slope_m,
                disparity_sigma_px: point.variance.sqrt(),
                at_px: [f64::from(at.x), f64::from(at.y)],
                sigma_px: PLACE_SIGMA_PX,
                ..Observation::default()
            });
            self.owners.push(index as u32);
        }
    }

    fn estimate(&mut self, predicted: &Pose) -> Result<OdometryEstimate, UnknownReason> {
        let found = self.observations.len();
        if found < MIN_INLIERS {
            return Err(UnknownReason::FewPoints);
        }
        let (elapsed_s, before) = (self.since_s, self.velocity);
        let is_plausible = |pose: &Pose| is_plausible(&pose.inverse(), elapsed_s, before);
        let start = predicted.inverse();
        let estimate = camera_motion::estimate(&self.rig, &mut self.observations, start, is_plausible)
            .ok_or(UnknownReason::Implausible)?;
        if before.is_none() && estimate.variance_factor > MAX_START_VARIANCE {
            return Err(UnknownReason::Disagreement);
        }
        if estimate.inliers < MIN_INLIERS || (estimate.inliers as f64) < MIN_INLIER_SHARE * found as f64 {
            return Err(UnknownReason::Disagreement);
        }
        let speed_sigma = estimate.covariance[(2, 2)].sqrt() / elapsed_s.max(1e-3);
        let yaw_sigma = estimate.covariance[(4, 4)].sqrt() / elapsed_s.max(1e-3);
        if speed_sigma > MAX_SPEED_SIGMA_M_S || yaw_sigma > MAX_YAW_RATE_SIGMA_RAD_S {
            return Err(UnknownReason::Implausible);
        }
        let (more_px, information) = estimate.disparity_offset_px;
        let disparity_offset_px = (self.offset.px + more_px, information);
        self.offset.learn(estimate.disparity_offset_px, elapsed_s);
        Ok(OdometryEstimate {
            disparity_offset_px,
            motion: estimate.pose.inverse(),
            covariance: estimate.covariance,
            inliers: estimate.inliers,
            points: found,
            elapsed_s,
        })
    }

    /// Filters the depths of the inliers, and drops points that were not found or do not agree.
    fn update_points(&mut self, disparity: DisparityView<'_>) {
        let to_now = self.pose.inverse();
        let (rig, scale) = (self.rig, self.rig.focal_px * self.rig.baseline_m);
        for point in &mut self.points {
            point.misses = point.misses.saturating_add(1);
        }
        for (observation, &owner) in self.observations.iter().zip(&self.owners) {
            let point = &mut self.points[owner as usize];
            if !observation.is_inlier {
                // It moves by itself, or was mistaken for another place.
                point.misses = u8::MAX;
                continue;
            }
            point.misses = 0;
            point.age += 1;
            let [x, y] = observation.at_px;
            let Some(measured) = disparity_at(disparity, x, y) else { continue };
            let measured = measured + self.offset.px;
            // Disparity now as a function of that in the reference image, linearised.
            let relative = to_now.after(&point.reference);
            let depth_m = |p: [f64; 3]| relative.apply(p)[2];
            let now = scale / depth_m(point.place_m(&rig, scale)).max(0.1);
            let slope = (scale / depth_m(point.moved_m(&rig, scale, 0.01)).max(0.1) - now) / 0.01;
            let innovation = measured - now;
            let spread = slope * slope * point.variance + DISPARITY_SIGMA_PX * DISPARITY_SIGMA_PX;
            if innovation * innovation > 16.0 * spread {
                continue;
            }
            let gain = slope * point.variance / spread;
            point.disparity_px = (point.disparity_px + gain * innovation).max(0.5 * MIN_DISPARITY_PX);
            let least = MIN_DISPARITY_SIGMA_PX * MIN_DISPARITY_SIGMA_PX;
            point.variance = (point.variance * (1.0 - gain * slope)).max(least);
        }
        let mut index = 0;
        while index < self.points.len() {
            if self.points[index].misses > MAX_MISSES {
                let point = self.points.swap_remove(index);
                self.spare.push(point);
            } else {
                index += 1;
            }
        }
    }

    /// Adds points at corners in cells that have none.
    fn add_points(&mut self, left: GreyView<'_>, disparity: DisparityView<'_>) {
        let to_now = self.pose.inverse();
        let (rig, scale) = (self.rig, self.rig.focal_px * self.rig.baseline_m);
        self.occupied.fill(false);
        for point in &self.points {
            let now = to_now.after(&point.reference).apply(point.place_m(&rig, scale));
            if now[2] > 0.5 {
                let x = rig.cx_px + rig.focal_px * now[0] / now[2];
                let y = rig.cy_px + rig.focal_px * now[1] / now[2];
                let cell = self.corners.cell(to_level(x as f32, 1), to_level(y as f32, 1));
                self.occupied[cell] = true;
            }
        }
        let image = self.pyramid.level(left, 1);
        let occupied = &self.occupied;
        let found = self.corners.find(image, MARGIN_PX, |cell| !occupied[cell]);
        self.order.clear();
        let scored = found.iter().enumerate().filter(|(_, corner)| corner.score > 0.0);
        self.order.extend(scored.map(|(k, corner)| (corner.score, k as u32)));
        self.order.sort_unstable_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
        for &(_, cell) in &self.order {
            let corner = found[cell as usize];
            let [x, y] = [corner.x, corner.y].map(|v| from_level(f32::from(v), 1));
            let Some(disparity_px) = disparity_at(disparity, f64::from(x), f64::from(y)) else { continue };
            let disparity_px = (disparity_px + self.offset.px).max(0.5 * MIN_DISPARITY_PX);
            let Some(mut point) = self.spare.pop() else { break };
            point.levels = 0;
            while point.levels < self.pyramid.count() {
                let k = point.levels;
                let image = self.pyramid.level(left, k);
                if !point.patches[k].store(image, to_level(x, k), to_level(y, k)) {
                    break;
                }
                point.levels += 1;
            }
            if point.levels == 0 {
                self.spare.push(point);
                continue;
            }
            (point.x, point.y) = (f64::from(x), f64::from(y));
            (point.disparity_px, point.variance) = (disparity_px, DISPARITY_SIGMA_PX * DISPARITY_SIGMA_PX);
            (point.reference, point.misses, point.age) = (self.pose, 0, 0);
            self.points.push(point);
        }
    }
}

/// Speeds that are tried while the velocity is not known, in m/s, and about how many points are looked for with each.
const SEARCHED_SPEEDS_M_S: [f64; 8] = [0.0, 4.0, 8.0, 13.0, 19.0, 26.0, 33.0, 40.0];
const SEARCHED_POINTS: usize = 160;

/// Time without a known motion after which all points are renewed, in seconds.
const MAX_LOST_S: f64 = 0.5;

/// Error that all disparities have in common: what remains of the cameras' calibration and of the matcher.
#[derive(Clone, Copy, Debug, Default)]
struct DisparityOffset {
    px: f64,
    /// Inverse of its variance, in 1/px².
    information: f64,
}

/// Largest offset, in px, and its standard deviation before anything is known.
const MAX_OFFSET_PX: f64 = 0.3;
const INITIAL_OFFSET_SIGMA_PX: f64 = 0.1;
/// Share of the information of a frame that is new: the same points are seen again and again, with the same errors.
const NEW_SHARE: f64 = 0.05;
/// Time over which it may change, in seconds.
const OFFSET_TIME_S: f64 = 120.0;

impl DisparityOffset {
    /// Adds what a frame says: what still has to be added, in px, and its information.
    fn learn(&mut self, (more_px, information): (f64, f64), elapsed_s: f64) {
        let least = 1.0 / (INITIAL_OFFSET_SIGMA_PX * INITIAL_OFFSET_SIGMA_PX);
        let new = NEW_SHARE * information;
        if !(new > 0.0 && more_px.is_finite()) {
            return;
        }
        self.information = self.information.max(least) * (-elapsed_s / OFFSET_TIME_S).exp() + new;
        let change = (new / self.information * more_px).clamp(-0.01, 0.01);
        self.px = (self.px + change).clamp(-MAX_OFFSET_PX, MAX_OFFSET_PX);
    }
}

impl Point {
    /// Place in the reference camera, in metres. `scale` is focal length × baseline.
    fn place_m(&self, rig: &Rig, scale: f64) -> [f64; 3] {
        self.moved_m(rig, scale, 0.0)
    }

    /// The place with another disparity.
    fn moved_m(&self, rig: &Rig, scale: f64, by_px: f64) -> [f64; 3] {
        let z = scale / (self.disparity_px + by_px).max(0.1);
        [(self.x - rig.cx_px) / rig.focal_px * z, (self.y - rig.cy_px) / rig.focal_px * z, z]
    }
}

/// Disparity at a place, in px: the median of its surroundings; `None` where it is unknown, too small, or at an edge in
/// depth.
fn disparity_at(map: DisparityView<'_>, x: f64, y: f64) -> Option<f64> {
    let half = NEIGHBOURHOOD_PX as f64;
    if !(x >= half
        && y >= half
        && x + half + 1.0 < map.width() as f64
        && y + half + 1.0 < map.height() as f64)
    {
        return None;
    }
    let (x, y) = (x.round() as usize, y.round() as usize);
    let mut values = [0_u16; 9];
    for (k, value) in values.iter_mut().enumerate() {
        let (column, row) = (x + k % 3 * NEIGHBOURHOOD_PX, y + k / 3 * NEIGHBOURHOOD_PX);
        *value = map.row(row - NEIGHBOURHOOD_PX)[column - NEIGHBOURHOOD_PX];
    }
    let centre = map.row(y)[x];
    values.sort_unstable();
    let px = |v: u16| f64::from(v) / 256.0;
    let known = &values[values.iter().position(|&v| v > 0)?..];
    let (low, high) = (px(*known.first()?), px(*known.last()?));
    let is_even = high - low <= MAX_SPREAD_PX + MAX_SPREAD_SHARE * high;
    (known.len() >= 7 && centre > 0 && is_even && px(centre) >= MIN_DISPARITY_PX).then(|| px(centre))
}

/// Translation and rotation vector in a second.
fn velocity(motion: &Pose, elapsed_s: f64) -> [f64; 6] {
    let [x, y, z] = motion.translation_m;
    let [a, b, c] = motion.rotation_vector();
    [x, y, z, a, b, c].map(|v| v / elapsed_s.max(1e-3))
}

/// Whether a vehicle can move in this way within `elapsed_s`, after it moved with `before`.
fn is_plausible(motion: &Pose, elapsed_s: f64, before: Option<[f64; 6]>) -> bool {
    let v = velocity(motion, elapsed_s);
    let within = |value: f64, range: RangeInclusive<f64>| range.contains(&value);
    let sideways = MAX_SIDEWAYS_M_S + MAX_SIDEWAYS_SHARE * v[2].abs();
    let mut plausible = within(v[2], -MAX_SPEED_M_S..=MAX_SPEED_M_S)
        && v[..2].iter().all(|v| v.abs() <= sideways)
        && v[3..].iter().all(|v| v.abs() <= MAX_TURN_RAD_S);
    if let Some(before) = before {
        let speed = MAX_ACCELERATION_M_S2 * elapsed_s + 0.7;
        let turn = MAX_YAW_ACCELERATION_RAD_S2 * elapsed_s + 0.1;
        plausible &= (v[2] - before[2]).abs() <= speed && (v[4] - before[4]).abs() <= turn;
    }
    plausible
}

#[cfg(test)]
mod tests;
