//! Obstacle tracking over frames: the one place that decides what exists.
//!
//! Input ([`Frame`]): the sightings of each frame ([`Region`]s with their evidence) with its time in nanoseconds, the vehicle's
//! own motion, and a look at both pictures; optionally image crops for image motion ([`image_motion`]). Output: [`Track`]s,
//! each with its probability of existence ([`existence`]), its size ([`extent`]), distance (m), closing speed (m/s), time to
//! collision (s) and lateral motion (m, m/s) with standard deviations; [`Track::state`] has them as plain numbers.
//!
//! With the vehicle's own motion tracks are predicted along with it, their speeds are over ground, and each says whether it
//! stands or moves ([`filter::ground`]).
//!
//! A track that is part of a wall ([`Track::is_part_of_boundary`]) is no thing of its own: whoever reports tracks leaves it out. What is
//! left of a car that is passed begins none (`passing`).
//!
//! A gap or a step back in time ([`crate::frame_clock`]) ends all tracks; a repeated time changes none.
//!
//! Sightings are assigned to tracks by minimum total cost ([`assign`]); what remains may be parts of a thing or the birth of a
//! track. Each track has a Kalman filter of its place and speed ([`filter`]). The paper measures distances in
//! single frames (section 4.3); tracking extends that.

pub mod assign;
mod association;
mod boundary_part;
pub mod classification;
pub mod classification_schedule;
pub mod detection_rate;
pub mod existence;
pub mod extent;
pub mod filter;
pub mod image_motion;
pub mod parameters;
mod passing;
mod registration;
mod static_points;
mod track;
mod visibility;

use crate::detection::MIN_EVIDENCE;
use crate::frame_clock::{FrameClock, TimeStep};
use crate::free_space::boundary::BeforeWall;
use crate::motion::Motion;
use crate::motion::body::Body;
use crate::motion::planar::{OwnRates, Planar, PlanarStep};
use crate::motion::scene_point::ScenePoint;
use crate::range::Range;
use crate::region::Region;
use crate::rig::Rig;
use assign::Assignment;
use detection_rate::DetectionRate;
use filter::estimate::MIN_DISTANCE_M;
use filter::ground::Movement;
pub use parameters::TrackerParameters;
use parameters::{BESIDE_M, KEEP_PROBABILITY, MAX_EVIDENCE, MIN_URGENT_M, UNHURRIED_S, UNMATCHED_COST};
use passing::Passing;
pub use track::{Obstacle, Track};
use visibility::{Expected, inside_share, visible_share};

/// Evidence of a look at both pictures that finds nothing, at least: it may have looked beside the thing.
const MIN_LOOK: f64 = -3.0;

/// Largest number of sightings per frame; the first ones are used.
const MAX_SIGHTINGS: usize = 64;

/// What a frame tells the tracker.
#[derive(Clone, Copy)]
pub struct Frame<'a> {
    /// Source time, in ns.
    pub time_ns: u64,
    /// Sightings of this frame.
    pub sightings: &'a [Region],
    /// Own motion since the last frame; `None` if it is unknown.
    pub motion: Option<Motion>,
    /// Points of this frame of which odometry knows whether they stand.
    pub points: &'a [ScenePoint],
    /// Whether obstacles could be detected at all: without a road they cannot, and nothing is missed.
    pub could_detect: bool,
    /// Looks for a predicted region in both pictures: its evidence, or `None` if they do not tell.
    pub verify: &'a dyn Fn(&Region) -> Option<f64>,
    /// How a thing with this outline on the ground, in metres right and ahead, and this height stands before the wall of which it may
    /// be a part; `None` where it can be none.
    pub before_wall: &'a dyn Fn(&[Planar], f64) -> Option<BeforeWall>,
}

impl<'a> Frame<'a> {
    /// A frame of which only the sightings are known.
    pub fn new(time_ns: u64, sightings: &'a [Region]) -> Self {
        Self {
            time_ns,
            sightings,
            motion: None,
            points: &[],
            could_detect: true,
            verify: &|_| None,
            before_wall: &|_, _| None,
        }
    }
}

/// Tracks obstacles; memory is allocated once.
#[derive(Debug)]
pub struct Tracker {
    parameters: TrackerParameters,
    rig: Rig,
    /// Width and height of the image, in px.
    size: (u32, u32),
    tracks: Vec<Track>,
    /// Expected box of each track inside of the picture.
    bodies: Vec<[f64; 4]>,
    assignment: Assignment,
    /// Track of each sighting.
    owners: Vec<Option<u32>>,
    /// Whether a sighting is explained by a track, so that none begins with it.
    explained: Vec<bool>,
    /// Number of the track of each sighting; 0: none.
    numbers: Vec<u32>,
    order: Vec<(f64, u32)>,
    next_id: u32,
    clock: FrameClock,
    dropped: u64,
    body: Body,
    /// What the own motion adds in this frame; `None` while it is unknown, and the speeds of all tracks are relative.
    own: Option<OwnRates>,
    /// Own speed, in m/s, likewise.
    speed_m_s: Option<f64>,
    /// Displacement of the camera since the frame before, likewise.
    own_step: Option<PlanarStep>,
    /// Sum of its yaws, to the left positive, in rad.
    heading_rad: f64,
    /// Time since the frame before, in ns.
    elapsed_ns: u64,
    rate: DetectionRate,
    passing: Passing,
}

impl Tracker {
    /// A tracker without tracks, for sightings in images of `size` (width, height) taken with `rig`.
    pub fn new(parameters: TrackerParameters, rig: Rig, size: (usize, usize)) -> Self {
        Self {
            tracks: Vec::with_capacity(parameters.max_count),
            bodies: Vec::with_capacity(parameters.max_count),
            assignment: Assignment::new(MAX_SIGHTINGS, parameters.max_count),
            owners: Vec::with_capacity(MAX_SIGHTINGS),
            explained: Vec::with_capacity(MAX_SIGHTINGS),
            numbers: Vec::with_capacity(MAX_SIGHTINGS),
            order: Vec::with_capacity(parameters.max_count),
            parameters,
            rig,
            size: (size.0 as u32, size.1 as u32),
            next_id: 1,
            clock: FrameClock::default(),
            dropped: 0,
            body: Body::default(),
            own: None,
            speed_m_s: None,
            own_step: None,
            heading_rad: 0.0,
            elapsed_ns: 0,
            rate: DetectionRate::default(),
            passing: Passing::new(),
        }
    }

    /// The same for this vehicle.
    #[must_use]
    pub fn with_body(self, body: Body) -> Self {
        Self { body, ..self }
    }

    /// Sets the distance beyond which nothing is sighted, in metres ([`crate::range`]).
    pub fn set_range_m(&mut self, range_m: f64) {
        self.parameters.max_distance_m = range_m;
    }

    /// All tracks, oldest first.
    pub fn tracks(&self) -> &[Track] {
        &self.tracks
    }

    /// The tracks that count as obstacles.
    pub fn confirmed(&self) -> impl Iterator<Item = &Track> {
        self.tracks.iter().filter(|track| track.is_confirmed && !track.is_part_of_boundary())
    }

    /// Number of the track to which a sighting of the last frame belongs; 0 if it belongs to none, or to a part of a boundary.
    pub fn track_of(&self, sighting: usize) -> u32 {
        let number = self.numbers.get(sighting).copied().unwrap_or(0);
        let is_told = |track: &Track| track.id == number && !track.is_part_of_boundary();
        if self.tracks.iter().any(is_told) { number } else { 0 }
    }

    /// Number of tracks and sightings that were dropped because their numbers meant nothing: not finite, or beyond what
    /// can be measured.
    pub fn dropped(&self) -> u64 {
        self.dropped
    }

    /// Drops and counts the tracks whose numbers mean nothing. [`Self::follow`] and [`Self::measure_image_motion`] end with
    /// it.
    fn drop_implausible(&mut self) {
        let before = self.tracks.len();
        self.tracks.retain(Track::is_plausible);
        self.dropped += (before - self.tracks.len()) as u64;
    }

    /// [`Self::follow`] where only the sightings are known.
    pub fn update(&mut self, time_ns: u64, sightings: &[Region]) -> &[Track] {
        self.follow(&Frame::new(time_ns, sightings))
    }

    /// Updates the tracks with a frame; returns all tracks, oldest first. A gap or a step back in time ends all tracks first;
    /// a repeated time changes nothing.
    pub fn follow(&mut self, frame: &Frame<'_>) -> &[Track] {
        let Some(elapsed_s) = self.advance(frame.time_ns, frame.motion) else { return &self.tracks };
        let sightings = &frame.sightings[..frame.sightings.len().min(MAX_SIGHTINGS)];
        self.rate.age(elapsed_s);
        self.assign(sightings);
        self.take_in(frame, sightings, elapsed_s);
        self.miss(frame, sightings, elapsed_s);
        self.tell_parts_of_boundaries(frame, elapsed_s);
        self.join();
        self.judge();
        self.drop_implausible();
        self.forget_numbers();
        self.passing.remember(&self.tracks, &self.body);
        self.begin(frame, sightings);
        &self.tracks
    }

    /// Predicts the tracks to a frame that shows nothing new ([`crate::frozen_picture`]): nothing is found in it, and nothing is missed.
    pub fn coast(&mut self, time_ns: u64, motion: Option<Motion>) -> &[Track] {
        if self.advance(time_ns, motion).is_some() {
            self.numbers.clear();
            self.judge();
            self.drop_implausible();
        }
        &self.tracks
    }

    /// Predicts everything to the time of a frame; returns the time since the frame before, in seconds, or `None` if it is the same time.
    fn advance(&mut self, time_ns: u64, motion: Option<Motion>) -> Option<f64> {
        let step = self.clock.step(time_ns);
        if step == TimeStep::Repeated {
            return None;
        }
        if step.is_discontinuity() {
            self.tracks.clear();
            self.rate = DetectionRate::default();
            self.passing.clear();
        }
        let elapsed_s = step.elapsed_s();
        self.elapsed_ns = (elapsed_s * 1e9).round() as u64;
        self.predict(elapsed_s, motion);
        self.passing.advance(self.own_step.as_ref(), elapsed_s);
        Some(elapsed_s)
    }

    /// Predicts all tracks to this frame, over ground if the own motion is known.
    fn predict(&mut self, elapsed_s: f64, motion: Option<Motion>) {
        let motion = motion.filter(Motion::is_finite);
        self.speed_m_s = motion.map(|m| m.speed_m_s);
        self.own = motion.map(|m| OwnRates::of(&m, &self.body));
        self.own_step = motion.map(|m| PlanarStep::of(&m, &self.body, elapsed_s));
        let yaw_rad = self.own_step.map_or(0.0, |step| step.yaw_rad());
        self.heading_rad += if yaw_rad.is_finite() { yaw_rad } else { 0.0 };
        match self.own.zip(self.own_step) {
            None => self.predict_relative(elapsed_s),
            Some((rates, step)) => self.predict_over_ground(elapsed_s, &rates, &step),
        }
        // What has passed the camera cannot be detected again, while its disparity would match everything near.
        self.tracks.retain(|track| track.distance_m() > MIN_DISTANCE_M);
        self.bodies.clear();
        for track in &mut self.tracks {
            track.missed = track.missed.saturating_add(1);
            track.unseen_s += elapsed_s;
            track.known_s += elapsed_s;
            track.detection = None;
            track.movement_before = track.movement;
            self.bodies.push(track.body_in_view(&self.rig, self.size));
        }
    }

    fn predict_relative(&mut self, elapsed_s: f64) {
        for track in &mut self.tracks {
            if track.is_over_ground {
                track.filter.shift(-track.shift_m());
                track.is_over_ground = false;
                track.filter.end_over_ground();
                (track.movement, track.own_sigma_m_s) = (Movement::Unknown, 0.0);
            }
            track.filter.predict(elapsed_s);
        }
    }

    fn predict_over_ground(&mut self, elapsed_s: f64, rates: &OwnRates, step: &PlanarStep) {
        for track in &mut self.tracks {
            if !track.is_over_ground {
                track.is_over_ground = true;
                track.filter.shift(track.shift_m());
                track.filter.begin_over_ground(rates);
            }
            track.filter.predict_over_ground(step, rates, elapsed_s);
            track.own_sigma_m_s = rates.sigma_at(track.filter.place_m())[1];
        }
    }

    /// Finds the track that each sighting shows: one sighting each at minimum total cost, then the parts of things.
    fn assign(&mut self, sightings: &[Region]) {
        self.assignment.begin(sightings.len(), self.tracks.len());
        for (t, (track, body)) in self.tracks.iter().zip(&self.bodies).enumerate() {
            for (s, region) in sightings.iter().enumerate().filter(|(_, region)| region.is_valid()) {
                if let Some(cost) = association::cost(track, body, region, self.parameters.min_overlap) {
                    self.assignment.set(s, t, cost);
                }
            }
        }
        self.owners.clear();
        self.owners.extend_from_slice(self.assignment.solve(UNMATCHED_COST));
        self.owners.resize(sightings.len(), None);
        for (s, owner) in self.owners.iter().enumerate() {
            if let Some(track) = owner.and_then(|t| self.tracks.get_mut(t as usize)) {
                track.detection = Some(s);
            }
        }
        self.explained.clear();
        for (s, region) in sightings.iter().enumerate() {
            let mut is_explained = self.owners[s].is_some() || !region.is_valid();
            if !is_explained {
                let known = self.tracks.iter().zip(&self.bodies).enumerate();
                let mut known =
                    known.filter(|(_, (t, _))| t.existence.is_probable() && !t.is_part_of_boundary());
                self.owners[s] = known
                    .clone()
                    .find(|(_, (track, body))| association::is_part(track, body, region, &self.rig))
                    .map(|(t, _)| t as u32);
                // A sighting that contains a thing which is seen by itself, too, shows nothing new.
                is_explained = self.owners[s].is_some()
                    || known.any(|(_, (t, body))| {
                        t.detection.is_some() && association::contains(t, body, region)
                    });
            }
            self.explained.push(is_explained);
        }
        let number = |owner: &Option<u32>| owner.map_or(0, |t| self.tracks[t as usize].id);
        self.numbers.clear();
        self.numbers.extend(self.owners.iter().map(number));
    }

    /// Updates each track with its sighting, joined from all parts.
    fn take_in(&mut self, frame: &Frame<'_>, sightings: &[Region], elapsed_s: f64) {
        let cameras = (self.rig, self.size);
        for (t, (track, body)) in self.tracks.iter_mut().zip(&self.bodies).enumerate() {
            let mut parts =
                self.owners.iter().enumerate().filter(|(_, owner)| **owner == Some(t as u32)).map(|(s, _)| s);
            let Some(first) = track.detection.or_else(|| parts.clone().next()) else { continue };
            let mut whole = sightings[first];
            parts.by_ref().filter(|s| *s != first).for_each(|s| whole.join(&sightings[s], &self.rig));
            let evidence = whole.evidence.min(MAX_EVIDENCE) + association::agreement(track, body, &whole);
            // A doubtful sighting is at least as good as none.
            let evidence = evidence.max(self.rate.miss_evidence());
            if track.is_known() {
                self.rate.look(1.0, true);
            }
            track.existence.look(evidence, 1.0, elapsed_s);
            track.update(first, &whole, cameras);
            let rest = static_points::speed_sigma_m_s(&whole, frame.points, &self.rig, elapsed_s);
            let rest = rest.filter(|_| self.own.is_some());
            if track.may_rest(rest)
                && let Some(sigma_m_s) = rest
            {
                track.filter.zero_velocity_update(sigma_m_s);
            }
        }
        self.tell_movement();
    }

    /// Tells of the things that are seen whether they move.
    fn tell_movement(&mut self) {
        let Some(own) = self.own else { return };
        for track in self.tracks.iter_mut().filter(|track| track.missed == 0) {
            // As the vehicle turns by an angle, it sees the sides of a thing turned by it.
            let (width_m, before) = (track.front_m(), track.movement_before);
            track.movement = track.filter.movement(before, own.turning_rad_s() * width_m, width_m);
        }
    }

    /// Decides for each track, at its place in this frame, whether it is part of a boundary; none is while the own motion is unknown.
    fn tell_parts_of_boundaries(&mut self, frame: &Frame<'_>, elapsed_s: f64) {
        let is_known = self.own.is_some();
        for track in &mut self.tracks {
            let wall = if is_known { before_wall(track, frame) } else { None };
            track.boundary.look(wall, elapsed_s);
        }
    }

    /// Judges the tracks without a sighting by what should have been seen of them, and by both pictures.
    fn miss(&mut self, frame: &Frame<'_>, sightings: &[Region], elapsed_s: f64) {
        for t in 0..self.tracks.len() {
            let (track, body) = (&self.tracks[t], &self.bodies[t]);
            if track.missed == 0 {
                continue;
            }
            let is_merged = || {
                let seen = self.owners.iter().zip(sightings).filter(|(owner, _)| owner.is_some());
                seen.into_iter().any(|(_, region)| association::contains(track, body, region))
            };
            let share = if frame.could_detect && !is_merged() { self.visible_share(t) } else { 0.0 };
            let evidence =
                self.predicted(t).filter(|_| share > 0.0).and_then(|region| (frame.verify)(&region));
            let track = &mut self.tracks[t];
            if track.is_known() {
                self.rate.look(share, false);
            }
            // Pictures that show something there confirm nothing: it may be anything at that distance. But nothing is missed.
            if evidence.is_none_or(|evidence| evidence < 0.0) {
                let miss = self.rate.miss_evidence();
                track.existence.look(evidence.unwrap_or(miss).max(MIN_LOOK), share, elapsed_s);
            }
            track.consecutive_frames = 0;
        }
    }

    /// Share of the thing of track `t` that should be seen.
    fn visible_share(&self, t: usize) -> f64 {
        let track = &self.tracks[t];
        let thing = Expected {
            edges: track.body(&self.rig),
            distance_m: track.distance_m(),
            disparity_px: track.filter.disparity_px(),
        };
        let others = self
            .tracks
            .iter()
            .filter(|other| other.is_confirmed && other.missed == 0 && other.distance_m() < thing.distance_m);
        visible_share(&thing, others.map(|other| other.body(&self.rig)), &self.parameters, self.size)
    }

    /// The region of track `t` as it is expected in the picture; `None` if it is not completely inside.
    fn predicted(&self, t: usize) -> Option<Region> {
        let track = &self.tracks[t];
        let edges = track.body(&self.rig);
        let bounds = extent::clip(edges, self.size)?;
        let is_inside = edges[0] >= 0.0
            && edges[1] >= 0.0
            && edges[2] <= f64::from(self.size.0)
            && edges[3] <= f64::from(self.size.1);
        is_inside.then(|| Region {
            bounds,
            disparity_px: track.filter.disparity_px(),
            distance_m: track.distance_m(),
            ..track.region
        })
    }

    /// Joins tracks that follow the same thing: one without a sighting that lies within one with a sighting. The older number
    /// remains. The motion is that of the one that was seen more often, unless it was lost, the image of the other is followed, or the
    /// distances contradict each other: each may be a chain of sightings of different things.
    fn join(&mut self) {
        for body in self.bodies.iter_mut().zip(&self.tracks) {
            *body.0 = body.1.body_in_view(&self.rig, self.size);
        }
        for part in 0..self.tracks.len() {
            let (track, body) = (&self.tracks[part], &self.bodies[part]);
            if track.missed == 0 || track.existence.is_over() {
                continue;
            }
            let whole = self.tracks.iter().zip(&self.bodies).position(|(other, other_body)| {
                // Who walks before a wall does not become a part of it.
                let may_join = !other.is_part_of_boundary() || track.is_part_of_boundary();
                let is_seen = other.missed == 0 && may_join;
                is_seen && association::is_within((track, body), (other, other_body), &self.rig)
            });
            let Some(whole) = whole else { continue };
            let older = whole.min(part);
            self.tracks.swap(older, whole);
            self.bodies.swap(older, whole);
            // What follows the part is now at the other place.
            let ended = whole.max(part);
            let ids = [older, ended].map(|t| self.tracks[t].id);
            let id = ids[0].min(ids[1]);
            let (part, kept) = (self.tracks[ended], &mut self.tracks[older]);
            let is_known = !part.was_lost() && part.agrees_in_distance(kept);
            if part.seen > kept.seen && is_known && !kept.is_followed {
                kept.filter.take_motion(&part.filter);
                (kept.movement, kept.movement_before, kept.seen) = (part.movement, part.movement, part.seen);
            }
            self.tracks[older].id = id;
            self.tracks[older].known_s = self.tracks[older].known_s.max(part.known_s);
            self.numbers.iter_mut().filter(|number| ids.contains(number)).for_each(|number| *number = id);
            self.tracks[ended].existence = existence::Existence::new(MIN_EVIDENCE);
        }
    }

    /// Confirms tracks, ends those that do not exist or left the picture, and sets the boxes of all others.
    fn judge(&mut self) {
        let (parameters, cameras) = (self.parameters, (self.rig, self.size));
        let (body, needed_m) = (self.body, self.needed_m());
        let keep = KEEP_PROBABILITY.min(parameters.confirm_probability);
        self.tracks.retain_mut(|track| {
            let probability = track.existence.probability();
            track.is_confirmed = if track.is_confirmed {
                probability >= keep
            } else {
                let is_time = track.known_s >= UNHURRIED_S || is_urgent(track, &body, needed_m);
                probability >= parameters.confirm_probability && is_time
            };
            let is_known = track.missed == 0 || !is_outside(&track.body(&cameras.0), track, cameras.1);
            is_known
                && !track.existence.is_over()
                && track.unseen_s <= parameters.max_unseen_s
                && track.place_box(cameras)
        });
    }

    /// Distance within which things are urgent, in metres; while the own speed is unknown all are.
    fn needed_m(&self) -> f64 {
        self.speed_m_s.map_or(f64::INFINITY, |speed_m_s| Range::needed_m(speed_m_s).max(MIN_URGENT_M))
    }

    /// Sightings of tracks that have ended belong to none.
    fn forget_numbers(&mut self) {
        for number in &mut self.numbers {
            if !self.tracks.iter().any(|track| track.id == *number) {
                *number = 0;
            }
        }
    }

    /// Begins tracks with the sightings that nothing explains.
    fn begin(&mut self, frame: &Frame<'_>, sightings: &[Region]) {
        let cameras = (self.rig, self.size);
        for (s, region) in sightings.iter().enumerate() {
            if !region.is_valid() {
                self.dropped += 1;
            } else if !self.explained[s]
                && region.evidence > 0.0
                && !self.passing.covers(region, &self.body)
                && self.tracks.len() < self.parameters.max_count
            {
                let mut track = Track::begin(self.next_id, s, region, cameras, self.own.as_ref());
                track.is_confirmed = track.existence.probability() >= self.parameters.confirm_probability
                    && is_urgent(&track, &self.body, self.needed_m());
                if self.own.is_some() {
                    track.boundary.look(before_wall(&track, frame), 0.0);
                }
                if track.is_plausible() {
                    self.numbers[s] = track.id;
                    self.next_id = self.next_id.wrapping_add(1).max(1);
                    self.tracks.push(track);
                } else {
                    self.dropped += 1;
                }
            }
        }
    }
}

/// Whether what a track follows is so near to the straight way of the vehicle, and so near ahead, that there is no time to wait.
fn is_urgent(track: &Track, body: &Body, needed_m: f64) -> bool {
    let from_middle_m = (track.lateral_m() + body.camera_right_m).abs();
    let beside_m = from_middle_m - (track.extent.width_m + body.width_m) / 2.0;
    beside_m <= BESIDE_M && track.distance_m() <= needed_m
}

/// How the outline of a track stands before the wall of which it may be a part.
fn before_wall(track: &Track, frame: &Frame<'_>) -> Option<BeforeWall> {
    let outline_m = track.extent.outline.points_m([track.lateral_m(), track.distance_m()], track.front_m());
    (frame.before_wall)(&outline_m, track.extent.height_m)
}

/// Whether most of a thing without a sighting is outside of the area that both cameras see: it has left, and does not come back.
fn is_outside(body: &[f64; 4], track: &Track, size: (u32, u32)) -> bool {
    inside_share(body, track.filter.disparity_px(), size) < 0.5
}

#[cfg(test)]
mod border_tests;
#[cfg(test)]
mod tests;
#[cfg(test)]
mod things_tests;
