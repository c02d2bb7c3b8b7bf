//! Obstacle tracking over frames.
//!
//! Input: the [`Region`]s of each frame with its time in nanoseconds; optionally image crops for scale change
//! ([`scale_change`]) and recogniser scores ([`classification_schedule`]). Output: [`Track`]s with distance
//! (m), closing speed (m/s), time to collision (s) and lateral motion (m, m/s), each with its standard
//! deviation.
//!
//! With the vehicle's own motion ([`Tracker::update_with_motion`]) tracks are predicted along with it, their speeds are
//! over ground, and each says whether it stands or moves ([`filter::ground`]).
//!
//! A gap or a step back in time ([`crate::frame_clock`]) ends all tracks; a repeated time changes none.
//!
//! Regions are assigned to tracks by minimum total cost ([`assign`]) of disparity difference, box overlap and
//! size. Each track has Kalman filters for distance and lateral position ([`filter`]). The paper measures
//! distances in single frames (section 4.3); tracking extends that.

pub mod assign;
pub mod classification;
pub mod classification_schedule;
pub mod filter;
pub mod scale_change;

use crate::frame_clock::{FrameClock, TimeStep};
use crate::motion::Motion;
use crate::motion::body::Body;
use crate::motion::planar::{OwnRates, PlanarStep};
use crate::region::{PixelBox, Region};
use crate::rig::Rig;
use assign::Assignment;
use classification::Classification;
use filter::ground::{Filters, GroundMotion, Movement};
use filter::{DistanceFilter, LateralFilter, MIN_DISTANCE_M, TimeToCollision};

/// An obstacle that is tracked from frame to frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Track {
    /// Identifier, unique during the life of the tracker, starting at 1.
    pub id: u32,
    /// Last region; its box is predicted while the track is not detected.
    pub region: Region,
    /// Index of the assigned region in this frame; `None` if there is none.
    pub detection: Option<usize>,
    /// Distance and closing speed.
    pub longitudinal: DistanceFilter,
    /// Lateral position and speed.
    pub lateral: LateralFilter,
    /// Smoothed width, in metres.
    pub width_m: f64,
    /// Smoothed height above the road, in metres.
    pub height_m: f64,
    /// Number of frames with a detection.
    pub seen: u32,
    /// Consecutive frames without a detection.
    pub missed: u32,
    /// Time since the last detection, in seconds; 0 if it is detected in this frame.
    pub unseen_s: f64,
    /// Consecutive frames with a detection, up to this one.
    pub consecutive_frames: u32,
    /// Smoothed change of the width from frame to frame: mean absolute log ratio.
    pub width_jitter: f64,
    /// Log-odds that it exists.
    pub existence: f64,
    /// Accumulated classification.
    pub classification: Classification,
    /// Whether it moves over ground; unknown while the own motion is.
    pub movement: Movement,
    /// Smoothed insets of its sides, in metres ([`Region::inset_m`]). They count over ground: the box at the near distance
    /// seems to move as the vehicle passes, the thing itself does not.
    inset_m: [f64; 2],
    /// Whether its speeds are over ground.
    is_over_ground: bool,
    /// Standard deviation of the closing speed of a standing thing in its place, in m/s.
    own_sigma_m_s: f64,
    /// Box and distance of the last detection.
    last: (PixelBox, f64),
    /// Whether that box is truncated by the border of the area that both cameras see.
    is_truncated: bool,
}

impl Track {
    /// Distance, in metres.
    pub fn distance_m(&self) -> f64 {
        self.longitudinal.distance_m()
    }

    /// Width of the thing itself, in metres; that of its box while the own motion is unknown.
    pub fn front_m(&self) -> f64 {
        if self.is_over_ground {
            (self.width_m - self.inset_m[0] - self.inset_m[1]).max(0.0)
        } else {
            self.width_m
        }
    }

    /// From the middle of the box to that of the thing itself, in metres; 0 while the own motion is unknown.
    fn shift_m(&self) -> f64 {
        if self.is_over_ground { middle_shift_m(self.inset_m) } else { 0.0 }
    }

    /// Closing speed (decrease of the distance), in m/s: the own speed if it stands.
    pub fn closing_m_s(&self) -> f64 {
        match self.movement {
            Movement::Standing => self.longitudinal.own_closing_m_s(),
            _ => self.longitudinal.closing_m_s(),
        }
    }

    /// Standard deviation of the closing speed, in m/s.
    pub fn closing_sigma_m_s(&self) -> f64 {
        match self.movement {
            Movement::Standing => self.own_sigma_m_s,
            _ => self.longitudinal.closing_sigma_m_s(),
        }
    }

    /// Time to collision at constant closing speed; `None` if the track does not approach significantly.
    pub fn time_to_collision(&self) -> Option<TimeToCollision> {
        match self.movement {
            Movement::Standing => self.longitudinal.standing_time_to_collision(self.own_sigma_m_s),
            _ => self.longitudinal.time_to_collision(),
        }
    }

    /// Motion over ground; `None` while the own motion is unknown.
    pub fn ground(&self) -> Option<GroundMotion> {
        if !self.is_over_ground {
            return None;
        }
        let stands = self.movement == Movement::Standing;
        let speed_m_s = [self.lateral.speed_m_s(), self.longitudinal.speed_m_s()];
        Some(GroundMotion {
            speed_m_s: if stands { [0.0; 2] } else { speed_m_s },
            speed_sigma_m_s: [self.lateral.speed_sigma_m_s(), self.longitudinal.closing_sigma_m_s()],
            place_sigma_m: [self.lateral.lateral_sigma_m(), self.longitudinal.distance_sigma_m()],
            movement: self.movement,
        })
    }

    /// Its filters.
    fn filters(&mut self) -> Filters<'_> {
        Filters { longitudinal: &mut self.longitudinal, lateral: &mut self.lateral }
    }

    /// Whether all its numbers mean something: finite, and within what a stereo camera can measure.
    fn is_plausible(&self) -> bool {
        let (longitudinal, lateral) = (&self.longitudinal, &self.lateral);
        let lengths_m = [
            longitudinal.distance_m(),
            longitudinal.distance_sigma_m(),
            lateral.lateral_m(),
            self.width_m,
            self.height_m,
            self.region.height_m,
        ];
        let speeds_m_s = [
            longitudinal.closing_m_s(),
            longitudinal.closing_sigma_m_s(),
            lateral.speed_m_s(),
            lateral.speed_sigma_m_s(),
        ];
        // A comparison with NaN is false.
        lengths_m.iter().all(|m| m.abs() <= MAX_LENGTH_M)
            && speeds_m_s.iter().all(|v| v.abs() <= MAX_SPEED_M_S)
            && longitudinal.distance_m() > 0.0
            && self.width_jitter.is_finite()
    }

    /// Predicted box as left, top, right, bottom in px: the last box, scaled and moved to the predicted
    /// distance and lateral position.
    fn expected(&self, rig: &Rig, size: (u32, u32)) -> [f64; 4] {
        let (bounds, distance_m) = &self.last;
        let z = self.longitudinal.distance_m();
        let scale = distance_m / z;
        let centre = rig.cx_px + rig.focal_px * (self.lateral.lateral_m() - self.shift_m()) / z;
        // A truncated box shows only a part of the object, whose full width extends beyond the border.
        let half = if self.is_truncated {
            rig.focal_px * self.width_m / z / 2.0
        } else {
            f64::from(bounds.width) * scale / 2.0
        };
        let row = |y: u32| rig.cy_px + (f64::from(y) - rig.cy_px) * scale;
        let (left, right) = ((centre - half).max(0.0), (centre + half).min(f64::from(size.0)));
        [left, row(bounds.y), right.max(left), row(bounds.y + bounds.height)]
    }
}

/// Parameters of track management.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TrackerParameters {
    /// Number of detections after which a track is confirmed as an obstacle.
    pub confirm_frames: u32,
    /// Consecutive misses after which a confirmed track is deleted, at the latest after [`MAX_UNSEEN_S`]; an
    /// unconfirmed one is deleted at its first miss.
    pub forget_frames: u32,
    /// Smallest box overlap for an assignment, 0 to 1.
    pub min_overlap: f64,
    /// Largest number of tracks.
    pub max_count: usize,
}

impl Default for TrackerParameters {
    fn default() -> Self {
        Self { confirm_frames: 3, forget_frames: 5, min_overlap: 0.2, max_count: 128 }
    }
}

/// Longest time for which a track is predicted without a detection, in seconds: as the longest step of the time that
/// is bridged ([`crate::frame_clock::MAX_STEP_NS`]), and for the same reason.
pub const MAX_UNSEEN_S: f64 = 1.0;

/// Tracks with a larger distance, lateral position, size or standard deviation of the distance are dropped, in metres:
/// a hundred times the range of a stereo camera.
const MAX_LENGTH_M: f64 = 10_000.0;
/// Tracks with a larger speed or standard deviation of it are dropped, in m/s: several times that of any vehicle.
const MAX_SPEED_M_S: f64 = 1_000.0;

/// Log-odds of existence from which a track is confirmed, limits of the evidence of a sighting and of the sum, and the share
/// of the sum that is kept from frame to frame.
const CONFIRM_LOG_ODDS: f64 = 2.5;
const MAX_SIGHTING_EVIDENCE: f64 = 3.0;
const MAX_LOG_ODDS: f64 = 9.0;
const KEPT_SHARE: f64 = 0.8;
/// Largest number of regions per frame; the nearest are used.
const MAX_DETECTIONS: usize = 64;
/// Gate of the disparity difference: this many standard deviations of prediction and measurement,
const GATE_SIGMAS: f64 = 4.0;
/// plus this many px, plus this share of the disparity: the near side jumps when parts are merged.
const GATE_PX: f64 = 0.5;
const GATE_SHARE: f64 = 0.08;
/// Weight of containment: if one box contains the other, the overlap is at least this share of the contained
/// area, since regions split and merge.
const CONTAINMENT_WEIGHT: f64 = 0.6;
/// Cost of a region without a track, in the unit of a squared normalised innovation.
const UNMATCHED_COST: f64 = 24.0;
/// Costs of boxes without overlap, and of widths that differ by a factor of e.
const OVERLAP_COST: f64 = 12.0;
const SIZE_COST: f64 = 3.0;
/// Standard deviation of the centre of a box: in px (strips of four columns), and as a share of the width.
const CENTRE_SIGMA_PX: f64 = 3.0;
const CENTRE_SIGMA_SHARE: f64 = 0.04;
/// A box closer to the image border than this, in px, is truncated.
const BORDER_PX: f64 = 8.0;
/// Initial value of the width jitter.
const INITIAL_WIDTH_JITTER: f64 = 0.3;
/// Smoothing gains of width and height.
const WIDTH_GAIN: f64 = 0.25;
const HEIGHT_GAIN_UP: f64 = 0.15;
const HEIGHT_GAIN_DOWN: f64 = 0.5;
/// Inflation of the disparity's standard deviation: its errors are correlated over frames, while the filter
/// assumes independence.
const NOISE_INFLATION: f64 = 1.5;
/// Smallest standard deviation of a disparity measurement, in px: parts of an object move within its region.
const MIN_SIGMA_PX: f64 = 0.08;

/// Tracks obstacles; memory is allocated once.
#[derive(Debug)]
pub struct Tracker {
    parameters: TrackerParameters,
    rig: Rig,
    /// Width and height of the image, in px.
    size: (u32, u32),
    tracks: Vec<Track>,
    assignment: Assignment,
    matched: Vec<bool>,
    order: Vec<(f64, u32)>,
    next_id: u32,
    clock: FrameClock,
    dropped: u64,
    body: Body,
    /// What the own motion adds in this frame; `None` while it is unknown, and the speeds of all tracks are relative.
    own: Option<OwnRates>,
}

impl Tracker {
    /// A tracker without tracks, for regions of images of `size` (width, height) taken with `rig`.
    pub fn new(parameters: TrackerParameters, rig: Rig, size: (usize, usize)) -> Self {
        Self {
            tracks: Vec::with_capacity(parameters.max_count),
            assignment: Assignment::new(MAX_DETECTIONS, parameters.max_count),
            matched: Vec::with_capacity(MAX_DETECTIONS),
            order: Vec::with_capacity(parameters.max_count),
            parameters,
            rig,
            size: (size.0 as u32, size.1 as u32),
            next_id: 1,
            clock: FrameClock::default(),
            dropped: 0,
            body: Body::default(),
            own: None,
        }
    }

    /// The same for this vehicle.
    #[must_use]
    pub fn with_body(self, body: Body) -> Self {
        Self { body, ..self }
    }

    /// All tracks, oldest first.
    pub fn tracks(&self) -> &[Track] {
        &self.tracks
    }

    /// Whether a track is confirmed as an obstacle.
    pub fn is_confirmed(&self, track: &Track) -> bool {
        track.seen >= self.parameters.confirm_frames && track.existence >= CONFIRM_LOG_ODDS
    }

    /// Number of tracks and regions that were dropped because their numbers meant nothing: not finite, or beyond what
    /// can be measured.
    pub fn dropped(&self) -> u64 {
        self.dropped
    }

    /// Drops and counts the tracks whose numbers mean nothing. [`Self::update`] and
    /// [`Self::measure_scale_change`] end with it.
    fn drop_implausible(&mut self) {
        let before = self.tracks.len();
        self.tracks.retain(Track::is_plausible);
        self.dropped += (before - self.tracks.len()) as u64;
    }

    /// Updates the tracks with the regions of the frame at `time_ns`; returns all tracks, oldest first. A gap or a
    /// step back in time ends all tracks first; a repeated time changes nothing. The own motion is unknown.
    pub fn update(&mut self, time_ns: u64, regions: &[Region]) -> &[Track] {
        self.update_with_motion(time_ns, regions, None)
    }

    /// The same with the own motion since the last frame; `None` if it is unknown.
    pub fn update_with_motion(
        &mut self,
        time_ns: u64,
        regions: &[Region],
        motion: Option<Motion>,
    ) -> &[Track] {
        let step = self.clock.step(time_ns);
        if step == TimeStep::Repeated {
            return &self.tracks;
        }
        if step.is_discontinuity() {
            self.tracks.clear();
        }
        let elapsed_s = step.elapsed_s();
        let regions = &regions[..regions.len().min(MAX_DETECTIONS)];
        self.predict(elapsed_s, motion);
        // What has passed the camera cannot be detected again, while its disparity would match everything near.
        self.tracks.retain(|track| track.distance_m() > MIN_DISTANCE_M);
        for track in &mut self.tracks {
            track.missed += 1;
            track.unseen_s += elapsed_s;
            track.detection = None;
        }
        self.set_costs(regions);
        self.matched.clear();
        self.matched.resize(regions.len(), false);
        let assigned = self.assignment.solve(UNMATCHED_COST);
        for (d, track) in assigned.iter().enumerate() {
            let Some(t) = *track else { continue };
            self.matched[d] = true;
            let edges = (self.rig, self.size);
            update_track(&mut self.tracks[t as usize], d, &regions[d], edges);
        }
        if let Some(own) = self.own {
            for track in self.tracks.iter_mut().filter(|t| t.missed == 0) {
                // As the vehicle turns by an angle, it sees the sides of a thing turned by it.
                let (before, aspect_m_s) = (track.movement, own.turning_rad_s() * track.front_m());
                track.movement = track.filters().movement(before, aspect_m_s);
            }
        }
        let (forget, confirm) = (self.parameters.forget_frames, self.parameters.confirm_frames);
        self.tracks.retain(|t| {
            let is_bridged = t.missed < forget && t.unseen_s <= MAX_UNSEEN_S;
            t.missed == 0 || (t.seen >= confirm && is_bridged)
        });
        self.drop_implausible();
        for track in self.tracks.iter_mut().filter(|t| t.missed > 0) {
            track.consecutive_frames = 0;
            track.region.bounds = clip(track.expected(&self.rig, self.size), self.size);
        }
        for (d, region) in regions.iter().enumerate() {
            if !region.is_valid() {
                self.dropped += 1;
            } else if !self.matched[d]
                && region.evidence > 0.0
                && self.tracks.len() < self.parameters.max_count
            {
                let track = self.begin(d, region);
                if track.is_plausible() {
                    self.tracks.push(track);
                } else {
                    self.dropped += 1;
                }
            }
        }
        &self.tracks
    }

    /// Predicts all tracks to this frame, over ground if the own motion is known.
    fn predict(&mut self, elapsed_s: f64, motion: Option<Motion>) {
        let motion = motion.filter(Motion::is_finite);
        self.own = motion.map(|m| OwnRates::of(&m, &self.body));
        let Some((rates, motion)) = self.own.zip(motion) else {
            for track in &mut self.tracks {
                if track.is_over_ground {
                    track.lateral.shift(-track.shift_m());
                    track.is_over_ground = false;
                    track.filters().end();
                    (track.movement, track.own_sigma_m_s) = (Movement::Unknown, 0.0);
                }
                track.longitudinal.predict(elapsed_s);
                track.lateral.predict(elapsed_s);
            }
            return;
        };
        let step = PlanarStep::of(&motion, &self.body, elapsed_s);
        for track in &mut self.tracks {
            if !track.is_over_ground {
                track.is_over_ground = true;
                track.lateral.shift(track.shift_m());
                track.filters().begin(&rates);
            }
            let mut filters = track.filters();
            filters.predict(&step, &rates, elapsed_s);
            let place = [track.lateral.lateral_m(), track.longitudinal.distance_m()];
            track.own_sigma_m_s = rates.sigma_at(place)[1];
        }
    }

    /// Sets the cost of assigning each region to each track.
    fn set_costs(&mut self, regions: &[Region]) {
        self.assignment.begin(regions.len(), self.tracks.len());
        for (t, track) in self.tracks.iter().enumerate() {
            let expected = track.expected(&self.rig, self.size);
            let disparity = track.longitudinal.disparity_px();
            let spread_px = track.longitudinal.disparity_sigma_px();
            for (d, region) in regions.iter().enumerate().filter(|(_, region)| region.is_valid()) {
                let spread = spread_px.hypot(region.disparity_sigma_px);
                let innovation = (region.disparity_px - disparity).abs();
                if innovation > GATE_SIGMAS * spread + GATE_PX + GATE_SHARE * disparity {
                    continue;
                }
                let overlap = overlap(&expected, &region.bounds);
                if overlap < self.parameters.min_overlap {
                    continue;
                }
                let sigmas = (innovation / spread.max(1e-3)).min(GATE_SIGMAS);
                let size = (region.width_m / track.width_m.max(0.05)).max(0.05).ln().abs();
                let cost = sigmas * sigmas + OVERLAP_COST * (1.0 - overlap) + SIZE_COST * size.min(1.0);
                self.assignment.set(d, t, cost);
            }
        }
    }

    fn begin(&mut self, detection: usize, region: &Region) -> Track {
        let id = self.next_id;
        self.next_id = self.next_id.wrapping_add(1).max(1);
        let scale = self.rig.focal_px * self.rig.baseline_m;
        let is_truncated = border_contact(region, self.size) != (false, false);
        let mut track = Track {
            id,
            region: *region,
            detection: Some(detection),
            longitudinal: DistanceFilter::new(scale, region.disparity_px, noise_px(region)),
            lateral: LateralFilter::new(region.lateral_m, centre_sigma_m(region, &self.rig, is_truncated)),
            width_m: region.width_m,
            height_m: region.height_m,
            consecutive_frames: 1,
            width_jitter: INITIAL_WIDTH_JITTER,
            is_truncated,
            seen: 1,
            missed: 0,
            unseen_s: 0.0,
            existence: region.evidence.min(MAX_SIGHTING_EVIDENCE),
            classification: Classification::default(),
            movement: Movement::Unknown,
            own_sigma_m_s: 0.0,
            inset_m: region.inset_m,
            is_over_ground: self.own.is_some(),
            last: (region.bounds, region.distance_m),
        };
        if let Some(rates) = &self.own {
            track.lateral.shift(track.shift_m());
            track.filters().start(rates);
            track.own_sigma_m_s = rates.sigma_at([region.lateral_m, region.distance_m])[1];
        }
        track
    }
}

/// Standard deviation of a region's disparity for the filter, in px.
fn noise_px(region: &Region) -> f64 {
    NOISE_INFLATION * region.disparity_sigma_px.max(MIN_SIGMA_PX)
}

/// Updates a track with region `d`.
fn update_track(track: &mut Track, d: usize, region: &Region, (rig, size): (Rig, (u32, u32))) {
    track.longitudinal.update(region.disparity_px, noise_px(region));
    let contact = border_contact(region, size);
    let is_truncated = contact != (false, false);
    let change = (region.width_m / track.width_m.max(0.05)).max(0.05).ln().abs();
    if is_truncated {
        track.width_m = track.width_m.max(region.width_m);
    }
    let other = region.width_m - track.width_m;
    // If one side is truncated, the centre is inferred from the other side.
    let (lateral_m, sigma_m) = match contact {
        (true, false) => (region.lateral_m + other / 2.0, centre_sigma_m(region, &rig, false)),
        (false, true) => (region.lateral_m - other / 2.0, centre_sigma_m(region, &rig, false)),
        // A box that became wider or narrower may have gained or lost a side.
        _ => (region.lateral_m, centre_sigma_m(region, &rig, is_truncated).hypot(other / 2.0)),
    };
    // While a thing enters the image its width is unknown; what grows must not look like a speed over ground.
    let is_partial = is_truncated && track.is_over_ground;
    let sigma_m = if is_partial { sigma_m.max(centre_sigma_m(region, &rig, true)) } else { sigma_m };
    let shift_m = if track.is_over_ground { middle_shift_m(region.inset_m) } else { 0.0 };
    track.lateral.update(lateral_m + shift_m, sigma_m);
    for (smoothed, inset_m) in track.inset_m.iter_mut().zip(region.inset_m) {
        *smoothed += WIDTH_GAIN * (inset_m - *smoothed);
    }
    track.is_truncated = is_truncated;
    if !is_truncated {
        track.width_jitter += WIDTH_GAIN * (change - track.width_jitter);
        track.width_m += WIDTH_GAIN * other;
    }
    // Boxes more often extend into the background above than they are too low.
    let taller = region.height_m - track.height_m;
    track.height_m += if taller > 0.0 { HEIGHT_GAIN_UP } else { HEIGHT_GAIN_DOWN } * taller;
    track.region = *region;
    track.detection = Some(d);
    track.last = (region.bounds, region.distance_m);
    track.existence =
        (KEPT_SHARE * track.existence + region.evidence.min(MAX_SIGHTING_EVIDENCE)).min(MAX_LOG_ODDS);
    track.seen = track.seen.saturating_add(1);
    track.consecutive_frames = track.consecutive_frames.saturating_add(1);
    (track.missed, track.unseen_s) = (0, 0.0);
}

/// From the middle of a box to that of the thing itself, in metres.
fn middle_shift_m([left, right]: [f64; 2]) -> f64 {
    (left - right) / 2.0
}

/// Whether a box touches the left and the right border of the area that both cameras see. On the left, the
/// right camera misses as many columns of the left image as the disparity.
fn border_contact(region: &Region, (width, _): (u32, u32)) -> (bool, bool) {
    let (left, right) = (f64::from(region.bounds.x), region.bounds.x + region.bounds.width);
    (left <= region.disparity_px + BORDER_PX, f64::from(right) >= f64::from(width) - BORDER_PX)
}

/// Standard deviation of a box's centre, in metres; half the width for a truncated box.
fn centre_sigma_m(region: &Region, rig: &Rig, is_truncated: bool) -> f64 {
    let strips = CENTRE_SIGMA_PX * region.distance_m / rig.focal_px;
    strips.hypot(if is_truncated { 0.5 } else { CENTRE_SIGMA_SHARE } * region.width_m)
}

/// Intersection over union, or the weighted share of the smaller box that lies in the larger one, if that is
/// greater.
fn overlap(expected: &[f64; 4], bounds: &PixelBox) -> f64 {
    let [left, top, right, bottom] = *expected;
    let (x, y) = (f64::from(bounds.x), f64::from(bounds.y));
    let (w, h) = (f64::from(bounds.width), f64::from(bounds.height));
    let wide = (right.min(x + w) - left.max(x)).max(0.0);
    let high = (bottom.min(y + h) - top.max(y)).max(0.0);
    let shared = wide * high;
    let areas = ((right - left) * (bottom - top), w * h);
    let (joint, smaller) = (areas.0 + areas.1 - shared, areas.0.min(areas.1));
    if smaller <= 0.0 { 0.0 } else { (shared / joint).max(CONTAINMENT_WEIGHT * shared / smaller) }
}

/// Intersection of a box with the image.
fn clip(edges: [f64; 4], (width, height): (u32, u32)) -> PixelBox {
    let to_pixel = |v: f64, most: u32| v.round().clamp(0.0, f64::from(most)) as u32;
    let (x, y) = (to_pixel(edges[0], width), to_pixel(edges[1], height));
    let (right, bottom) = (to_pixel(edges[2], width), to_pixel(edges[3], height));
    PixelBox { x, y, width: right.saturating_sub(x), height: bottom.saturating_sub(y) }
}

#[cfg(test)]
mod tests;
