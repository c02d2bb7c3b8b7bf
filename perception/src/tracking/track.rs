//! One obstacle that is followed from frame to frame.

use super::boundary_part::BoundaryPart;
use super::existence::Existence;
use super::extent::{CutSides, Extent, clip, in_view};
use super::filter::ground::{GroundMotion, Movement};
use super::filter::{Estimate, TimeToCollision, TrackFilter};
use super::parameters::{
    CENTRE_SIGMA_PX, CENTRE_SIGMA_SHARE, CUT_DEPTH_SIGMA_M, CUT_SIGMA_SHARE, DIVIDED_SIGMA_SHARE,
    FOUND_AGAIN_S, MIN_SIGMA_PX, NOISE_INFLATION, OUTLIER_SIGMAS, SIDE_DEPTH_SHARE, STEP_FRAMES,
    SYSTEMATIC_PX, WALKER_M,
};
use crate::motion::planar::{OwnRates, Planar};
use crate::outline::Outline;
use crate::region::{PixelBox, Region, SHAPE_M};
use crate::rig::Rig;

/// Smoothing of the width's change from sighting to sighting, and its first value: what a new track may be.
const JITTER_GAIN: f64 = 0.25;
const INITIAL_JITTER: f64 = 0.3;
/// Deviations from the expected place up to this many of its standard deviations are the thing's own motion.
const EXPLAINED_SIGMAS: f64 = 2.0;
/// Tracks with a larger distance, lateral position, size or standard deviation of the distance are dropped, in metres:
/// a hundred times the range of a stereo camera.
const MAX_LENGTH_M: f64 = 10_000.0;
/// Distance below which no side is taken to be, in metres.
const MIN_DEPTH_M: f64 = 0.3;
/// Tracks with a larger speed or standard deviation of it are dropped, in m/s: several times that of any vehicle.
const MAX_SPEED_M_S: f64 = 1_000.0;

/// Cameras: rig, and size of the picture (width, height) in px.
pub(super) type Cameras = (Rig, (u32, u32));

/// An obstacle that is tracked from frame to frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Track {
    /// Identifier, unique during the life of the tracker, starting at 1.
    pub id: u32,
    /// Identifier with which this state began. It stays when two tracks of one thing are joined and the state gets the older `id`.
    pub origin: u32,
    /// Probability that it exists.
    pub existence: Existence,
    /// Whether it counts as an obstacle.
    pub is_confirmed: bool,
    /// Box in the left image: that of the whole thing, clipped at the border; predicted while nothing is seen of it.
    pub bounds: PixelBox,
    /// Last sighting, joined from all its parts.
    pub region: Region,
    /// Index of the sighting that was assigned to it in this frame; `None` if there is none.
    pub detection: Option<usize>,
    /// Place and speed.
    pub filter: TrackFilter,
    /// Size of the thing.
    pub extent: Extent,
    /// Number of frames with a sighting.
    pub seen: u32,
    /// Consecutive frames without a sighting.
    pub missed: u32,
    /// Time since the last sighting, in seconds; 0 if it is seen in this frame.
    pub unseen_s: f64,
    /// Time since the first sighting, in seconds.
    pub known_s: f64,
    /// Consecutive frames with a sighting, up to this one.
    pub consecutive_frames: u32,
    /// Smoothed change of the measured width from frame to frame: mean absolute log ratio.
    pub width_jitter: f64,
    /// Whether its image was found again in the last frame in which that was tried.
    pub(super) is_followed: bool,
    /// Whether it is part of a boundary, and no thing of its own.
    pub(super) boundary: BoundaryPart,
    /// Whether it moves over ground; unknown while the own motion is.
    pub movement: Movement,
    /// The same in the frame before.
    pub(super) movement_before: Movement,
    /// Consecutive frames in which static points contradicted that it moves.
    rest_frames: u8,
    /// Whether its speeds are over ground.
    pub(super) is_over_ground: bool,
    /// Standard deviation of the closing speed of a standing thing in its place, in m/s.
    pub(super) own_sigma_m_s: f64,
}

impl Track {
    /// A new track of a sighting. `rates`: what the own motion adds, if it is known.
    pub(super) fn begin(
        id: u32,
        detection: usize,
        region: &Region,
        (rig, size): Cameras,
        rates: Option<&OwnRates>,
    ) -> Self {
        let scale = rig.focal_px * rig.baseline_m;
        let cut = CutSides::of(region, size);
        let mut track = Self {
            id,
            origin: id,
            existence: Existence::new(region.evidence),
            is_confirmed: false,
            bounds: region.bounds,
            region: *region,
            detection: Some(detection),
            filter: TrackFilter::new(
                scale,
                (region.disparity_px, noise_px(region, &rig, cut)),
                (region.lateral_m / region.distance_m, place_sigma_m(region, &rig, cut, 0.0)),
            ),
            extent: Extent::new(region, &rig),
            consecutive_frames: 1,
            width_jitter: INITIAL_JITTER,
            is_followed: false,
            boundary: BoundaryPart::default(),
            seen: 1,
            missed: 0,
            unseen_s: 0.0,
            known_s: 0.0,
            movement: Movement::Unknown,
            movement_before: Movement::Unknown,
            rest_frames: 0,
            own_sigma_m_s: 0.0,
            is_over_ground: rates.is_some(),
        };
        if let Some(rates) = rates {
            track.filter.shift(track.shift_m());
            track.filter.start_over_ground(rates);
            track.own_sigma_m_s = rates.sigma_at([region.lateral_m, region.distance_m])[1];
        }
        track
    }

    /// Takes in a sighting, which is `detection`; the last one is `unseen_s` ago.
    pub(super) fn update(&mut self, detection: usize, region: &Region, (rig, size): Cameras) {
        let cut = CutSides::of(region, size);
        if self.was_lost() {
            self.filter.separate_speed();
        }
        let noise_px = noise_px(region, &rig, cut);
        if cut.any() {
            // Its depth changes with what comes into view: none of that is scatter.
            self.filter.measure_cut_disparity(region.disparity_px, noise_px);
        } else {
            self.filter.measure_disparity(region.disparity_px, noise_px);
        }
        let change = (region.width_m / self.extent.width_m.max(0.05)).max(0.05).ln().abs();
        // A box that became wider or narrower may have gained or lost a side; beside what hides it, or at the border of the picture, it
        // does so anyway. At the border the image has to tell that it is one thing, or the side that is seen goes on as before.
        let open = cut.or_open(region);
        let half_m = region.width_m / 2.0;
        let [left_m, right_m] = match self.is_over_ground {
            true => region.ends_m(),
            false => [region.lateral_m - half_m, region.lateral_m + half_m],
        };
        let front_m = self.front_m();
        // An open side shows nothing of the place, and the other one stays where it is as the thing comes into view.
        let (lateral_m, outwards) = match (open.left, open.right) {
            (true, false) => (right_m - front_m / 2.0, -0.5),
            (false, true) => (left_m + front_m / 2.0, 0.5),
            _ => ((left_m + right_m) / 2.0, 0.0),
        };
        let enters = self.enters(region, cut);
        let is_one_thing = open.any() && (self.is_followed || !cut.any());
        let gained_m = if is_one_thing {
            0.0
        } else if enters && self.movement == Movement::Moving {
            self.unexplained_m(lateral_m)
        } else {
            region.width_m - self.extent.width_m
        };
        let sigma_m = place_sigma_m(region, &rig, open, self.extent.width_m).hypot(gained_m / 2.0);
        self.filter.measure_across([lateral_m, region.distance_m], sigma_m, self.is_followed);
        self.extent.update(region, &rig, (cut, open, enters), self.unseen_s);
        self.filter.shift(outwards * (self.front_m() - front_m));
        // Of what is not seen as a whole no width is measured, and what it was before is forgotten.
        let change = if open.any() { INITIAL_JITTER } else { change };
        self.width_jitter += JITTER_GAIN * (change - self.width_jitter);
        self.region = *region;
        self.detection = Some(detection);
        self.seen = self.seen.saturating_add(1);
        self.consecutive_frames = self.consecutive_frames.saturating_add(1);
        (self.missed, self.unseen_s) = (0, 0.0);
    }

    /// Whether it is part of a boundary, and no thing of its own: what moves is none.
    pub fn is_part_of_boundary(&self) -> bool {
        self.boundary.is_part() && self.movement != Movement::Moving
    }

    /// Whether it was out of sight for so long that what is found in its place may be another thing. One frame without a sighting is
    /// not, however slow the frames are.
    pub(super) fn was_lost(&self) -> bool {
        self.missed > 1 && self.unseen_s > FOUND_AGAIN_S
    }

    /// By how much the place across that one side tells is farther from the expected one than its uncertainty explains, in metres: by
    /// so much the box may have gained something else.
    fn unexplained_m(&self, lateral_m: f64) -> f64 {
        let [expected_m, sigma_m] = [self.filter.place_m()[0], self.filter.place_sigma_m()[0]];
        ((lateral_m - expected_m).abs() - EXPLAINED_SIGMAS * sigma_m).max(0.0)
    }

    /// Whether a thing that the picture cuts on one side comes into view: the side that is seen goes away from the border.
    fn enters(&self, region: &Region, cut: CutSides) -> bool {
        let columns = |bounds: &PixelBox| [f64::from(bounds.x), f64::from(bounds.x + bounds.width)];
        let ([left, right], [left_before, right_before]) =
            (columns(&region.bounds), columns(&self.region.bounds));
        match (cut.left, cut.right) {
            (true, false) => right - right_before > CENTRE_SIGMA_PX,
            (false, true) => left_before - left > CENTRE_SIGMA_PX,
            _ => false,
        }
    }

    /// The whole box of the thing, also outside of the picture: left, top, right, bottom, in px.
    pub(super) fn body(&self, rig: &Rig) -> [f64; 4] {
        self.extent.edges(rig, self.lateral_m() - self.shift_m(), self.distance_m())
    }

    /// The part of it that both cameras see.
    pub(super) fn body_in_view(&self, rig: &Rig, size: (u32, u32)) -> [f64; 4] {
        in_view(self.body(rig), self.distance_m(), size, rig)
    }

    /// Sets the box in the picture; `false` if it is outside.
    pub(super) fn place_box(&mut self, (rig, size): Cameras) -> bool {
        let bounds = clip(self.body(&rig), size);
        self.bounds = bounds.unwrap_or(self.bounds);
        bounds.is_some()
    }

    /// Distance, in metres.
    pub fn distance_m(&self) -> f64 {
        self.filter.distance_m()
    }

    /// Place of its middle, in metres right of the camera's axis.
    pub fn lateral_m(&self) -> f64 {
        self.filter.place_m()[0]
    }

    /// Standard deviation of the distance, in metres, with the part of the error that the filter cannot average out.
    pub fn distance_sigma_m(&self) -> f64 {
        self.estimate().place_sigma_m()[1].hypot(self.systematic_m())
    }

    /// Whether static points that tell with these standard deviations (m/s) that it stands are on it. Where its image goes on as it moves,
    /// they may lie beside it, until several frames agree.
    pub(super) fn may_rest(&mut self, sigma_m_s: Option<Planar>) -> bool {
        let is_known = self.is_followed && self.movement == Movement::Moving;
        let contradicts = is_known && sigma_m_s.is_some_and(|sigma| self.filter.contradicts_rest(sigma));
        self.rest_frames = if contradicts { self.rest_frames.saturating_add(1) } else { 0 };
        !contradicts || self.rest_frames >= STEP_FRAMES
    }

    /// Whether both distances differ by no more than outliers do.
    pub(super) fn agrees_in_distance(&self, other: &Self) -> bool {
        let sigma_m = self.distance_sigma_m().hypot(other.distance_sigma_m());
        (self.distance_m() - other.distance_m()).abs() <= OUTLIER_SIGMAS * sigma_m
    }

    /// Standard deviation of that part: of disparity and shape.
    fn systematic_m(&self) -> f64 {
        (self.distance_m() * SYSTEMATIC_PX / self.filter.disparity_px()).hypot(SHAPE_M)
    }

    /// Width of the thing itself, in metres; that of its box while the own motion is unknown.
    pub fn front_m(&self) -> f64 {
        if self.is_over_ground { self.extent.front_m() } else { self.extent.width_m }
    }

    /// From the middle of the box to that of the thing itself, in metres; 0 while the own motion is unknown.
    pub(super) fn shift_m(&self) -> f64 {
        if self.is_over_ground { self.extent.shift_m() } else { 0.0 }
    }

    /// Whether it is as narrow and as low as somebody who walks, and goes across like one.
    fn is_walker(&self) -> bool {
        let [width_m, height_m] = WALKER_M;
        let may_walk = self.is_over_ground && self.movement != Movement::Standing;
        may_walk
            && self.front_m() <= width_m
            && self.extent.height_m <= height_m
            && self.filter.walks_across()
    }

    /// Place and speed, with what is known of walkers if it is one.
    fn estimate(&self) -> Estimate {
        if self.is_walker() { self.filter.as_walker() } else { *self.filter }
    }

    /// Closing speed (decrease of the distance), in m/s: the own speed if it stands.
    pub fn closing_m_s(&self) -> f64 {
        match self.movement {
            Movement::Standing => self.filter.own_closing_m_s(),
            _ => self.estimate().closing_m_s(),
        }
    }

    /// Standard deviation of the closing speed, in m/s.
    pub fn closing_sigma_m_s(&self) -> f64 {
        match self.movement {
            Movement::Standing => self.own_sigma_m_s,
            _ => self.estimate().speed_sigma_m_s()[1],
        }
    }

    /// Time to collision at constant closing speed, or as it goes on braking; `None` if the track does not approach significantly.
    pub fn time_to_collision(&self) -> Option<TimeToCollision> {
        match self.movement {
            Movement::Standing => self.filter.standing_time_to_collision(self.own_sigma_m_s),
            _ => self.estimate().time_to_collision(),
        }
    }

    /// Motion over ground; `None` while the own motion is unknown.
    pub fn ground(&self) -> Option<GroundMotion> {
        self.is_over_ground.then(|| self.estimate().ground_motion(self.movement, self.systematic_m()))
    }

    /// What is known of the obstacle.
    pub fn state(&self) -> Obstacle {
        let (ground, estimate) = (self.ground(), self.estimate());
        let [lateral_m, distance_m] = estimate.place_m();
        Obstacle {
            track: self.id,
            probability: self.existence.probability(),
            is_confirmed: self.is_confirmed,
            seen: self.seen,
            missed: self.missed,
            consecutive_frames: self.consecutive_frames,
            unseen_s: self.unseen_s,
            width_jitter: self.width_jitter,
            bounds: self.bounds,
            distance_m,
            distance_sigma_m: self.distance_sigma_m(),
            lateral_m,
            lateral_speed_m_s: estimate.speed_m_s()[0],
            lateral_speed_sigma_m_s: estimate.speed_sigma_m_s()[0],
            width_m: self.front_m(),
            outline: if self.is_over_ground { self.extent.outline } else { Outline::default() },
            height_m: self.extent.height_m,
            before_wall_m: self.boundary.wall_m(),
            closing_m_s: self.closing_m_s(),
            closing_sigma_m_s: self.closing_sigma_m_s(),
            time_to_collision: self.time_to_collision(),
            ground,
        }
    }

    /// Whether it probably exists and was seen some times, so that it tells how often what is there is seen.
    pub(super) fn is_known(&self) -> bool {
        self.seen >= 3 && self.existence.is_probable()
    }

    /// Whether all its numbers mean something: finite, and within what a stereo camera can measure.
    pub(super) fn is_plausible(&self) -> bool {
        let ([lateral_m, distance_m], [lateral_sigma_m, distance_sigma_m]) =
            (self.filter.place_m(), self.filter.place_sigma_m());
        let sizes_m = [self.extent.width_m, self.extent.height_m, self.region.height_m];
        let places_m = [lateral_m, distance_m, lateral_sigma_m, distance_sigma_m];
        let (speed, rate, sigma) =
            (self.filter.speed_m_s(), self.filter.rate(), self.filter.speed_sigma_m_s());
        // A comparison with NaN is false.
        sizes_m.iter().chain(&places_m).all(|m| m.abs() <= MAX_LENGTH_M)
            && [speed, rate, sigma].as_flattened().iter().all(|v| v.abs() <= MAX_SPEED_M_S)
            && distance_m > 0.0
            && self.width_jitter.is_finite()
            && self.existence.probability().is_finite()
    }
}

/// What is known of an obstacle in a frame.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Obstacle {
    /// Identifier of its track, from 1.
    pub track: u32,
    /// Probability that it exists, 0 to 1.
    pub probability: f64,
    /// Whether that suffices to count as an obstacle.
    pub is_confirmed: bool,
    /// Number of frames with a sighting.
    pub seen: u32,
    /// Consecutive frames without a sighting, up to this one: its place is then a prediction.
    pub missed: u32,
    /// Consecutive frames with a sighting, up to this one.
    pub consecutive_frames: u32,
    /// Time since the last sighting, in seconds.
    pub unseen_s: f64,
    /// Mean absolute log ratio of its measured width from frame to frame.
    pub width_jitter: f64,
    /// Box in the left image.
    pub bounds: PixelBox,
    /// Distance, in metres.
    pub distance_m: f64,
    /// Standard deviation of the distance, in metres.
    pub distance_sigma_m: f64,
    /// Lateral position of its middle, in metres right of the camera axis.
    pub lateral_m: f64,
    /// Lateral speed, in m/s; over ground if that is known.
    pub lateral_speed_m_s: f64,
    /// Its standard deviation, in m/s.
    pub lateral_speed_sigma_m_s: f64,
    /// Width, in metres.
    pub width_m: f64,
    /// Outline between its ends; flat while the own motion is unknown.
    pub outline: Outline,
    /// Height, in metres.
    pub height_m: f64,
    /// By how much its nearest point stands before a wall that is as high, in metres; `None` where there is none.
    pub before_wall_m: Option<f64>,
    /// Closing speed, in m/s.
    pub closing_m_s: f64,
    /// Its standard deviation, in m/s.
    pub closing_sigma_m_s: f64,
    /// Time to collision; `None` if it does not approach significantly.
    pub time_to_collision: Option<TimeToCollision>,
    /// Motion over ground; `None` while the own motion is unknown.
    pub ground: Option<GroundMotion>,
}

/// Standard deviation of a region's disparity for the filter, in px. What is cut by the picture shows another part of its side in each
/// frame.
fn noise_px(region: &Region, rig: &Rig, cut: CutSides) -> f64 {
    let noise_px = NOISE_INFLATION * region.disparity_sigma_px.max(MIN_SIGMA_PX);
    let depth_m = if cut.any() { CUT_DEPTH_SIGMA_M } else { 0.0 };
    noise_px.hypot(region.disparity_px * depth_m / rig.distance_m(region.disparity_px))
}

/// Standard deviation of the place that a box tells, in metres: of its middle, or, where one side is not seen, of the other
/// one. Of a middle of which neither side is seen nothing is known. `width_m`: of the thing, as far as it has been seen before.
fn place_sigma_m(region: &Region, rig: &Rig, open: CutSides, width_m: f64) -> f64 {
    let [left_m, right_m] = region.ends_m();
    let (share, side_m) = match (open.left, open.right) {
        (true, true) if region.goes_on.contains(&true) => (DIVIDED_SIGMA_SHARE, 0.0),
        (true, true) => (CUT_SIGMA_SHARE, 0.0),
        (true, false) => (CENTRE_SIGMA_SHARE, right_m),
        (false, true) => (CENTRE_SIGMA_SHARE, left_m),
        (false, false) => (CENTRE_SIGMA_SHARE, 0.0),
    };
    let strips_m = CENTRE_SIGMA_PX * region.distance_m / rig.focal_px;
    // The column of a side is known; an error of its depth moves it along its line of sight.
    let depth_m = SIDE_DEPTH_SHARE * region.width_m.max(width_m);
    strips_m.hypot(share * region.width_m).hypot(depth_m * side_m / region.distance_m.max(MIN_DEPTH_M))
}
