//! Boundaries beside the path: walls, hedges, fences, guard rails, fronts of houses, as curves on the ground.
//!
//! Input: the stixels of a frame ([`crate::detection::stixels`]) and the road's surface. Output: [`Boundary`]s, in metres,
//! and for each stixel whether it belongs to one ([`StixelUse`]).
//!
//! A boundary is longer than a vehicle, goes on without the gaps between parked cars, and has a steady height. A straight
//! line on the ground is a straight line of the inverse distance over the column ([`curve`]), so that curves are followed
//! from strip to strip by a Kalman filter of inverse distance and slope, whose errors are those of disparity.
//! [`track`] filters them over frames, moved by the own motion.
//!
//! A boundary may stand across the way: an end wall, a barrier, the rail of a bend that is not taken. What of it is in the
//! own path ([`corridor`]) stays an obstacle: there is one way to the alarm, and it does not depend on whether something
//! was taken for a boundary.

pub mod corridor;
pub mod curve;
pub mod limits;
pub mod track;

use crate::detection::RegionParameters;
use crate::detection::stixel_use::StixelUse;
use crate::detection::stixels::Stixels;
use crate::motion::planar::PlanarStep;
use crate::rig::Rig;
use crate::road::ground_grid::{GroundGrid, MAX_HEIGHT_M, SECTOR_STRIPS};
use crate::road::raised_ground::RaisedGround;
use crate::road::surface::RoadSurface;
use corridor::Corridor;
use curve::{CurveFinder, RayStixel};
use limits::{GATE_SIGMAS, HEIGHT_STEP_M, LOW_HEIGHT_M, ROUGHNESS_M};
use track::TrackList;

/// Maximum number of points of a boundary.
pub const MAX_POINTS: usize = 24;

/// Maximum number of boundaries.
pub const MAX_BOUNDARIES: usize = 8;

/// A point at the foot of a boundary.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct BoundaryPoint {
    /// Lateral position, in metres right of the camera axis.
    pub lateral_m: f64,
    /// Distance along z, in metres.
    pub distance_m: f64,
    /// Height above the road, in metres; at most the largest height of an obstacle.
    pub height_m: f64,
    /// Standard deviation of the position across the boundary, in metres.
    pub sigma_m: f64,
    /// Time for which the point has not been seen, in seconds.
    pub unseen_s: f64,
}

/// Where a boundary stands.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Side {
    /// Left of the own path.
    #[default]
    Left,
    /// Right of it.
    Right,
    /// Across it.
    Across,
}

/// A boundary: a curve on the ground, its points from left to right as the camera sees them.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Boundary {
    /// Number that it keeps as long as it is seen.
    pub id: u32,
    /// Where it stands.
    pub side: Side,
    points: [BoundaryPoint; MAX_POINTS],
    count: usize,
}

impl Boundary {
    /// The points.
    pub fn points(&self) -> &[BoundaryPoint] {
        &self.points[..self.count]
    }

    fn points_mut(&mut self) -> &mut [BoundaryPoint] {
        &mut self.points[..self.count]
    }

    /// Adds a point; returns whether there was room.
    pub(crate) fn push(&mut self, point: BoundaryPoint) -> bool {
        let has_room = self.count < MAX_POINTS;
        if has_room {
            self.points[self.count] = point;
            self.count += 1;
        }
        has_room
    }

    /// Length in metres.
    pub fn length_m(&self) -> f64 {
        let step = |pair: &[BoundaryPoint]| {
            (pair[1].lateral_m - pair[0].lateral_m).hypot(pair[1].distance_m - pair[0].distance_m)
        };
        self.points().windows(2).map(step).sum()
    }

    /// Where the ray with this slope (metres right a metre ahead) meets it: distance, height and standard deviation
    /// there, and the distance of the camera from its line, all in metres.
    pub fn meet(&self, slope: f64) -> Option<Meeting> {
        let across = |p: &BoundaryPoint| p.lateral_m - slope * p.distance_m;
        self.points().windows(2).find_map(|pair| {
            let [a, b] = [&pair[0], &pair[1]];
            let [from, to] = [across(a), across(b)];
            if from > 0.0 || to < 0.0 || to - from < 1e-9 {
                return None;
            }
            let share = -from / (to - from);
            let mix = |value: fn(&BoundaryPoint) -> f64| value(a) + share * (value(b) - value(a));
            let [right, ahead] = [b.lateral_m - a.lateral_m, b.distance_m - a.distance_m];
            let line_m = (a.lateral_m * ahead - a.distance_m * right).abs() / right.hypot(ahead).max(1e-9);
            Some(Meeting {
                distance_m: mix(|p| p.distance_m),
                height_m: mix(|p| p.height_m),
                sigma_m: mix(|p| p.sigma_m),
                line_m,
            })
        })
    }
}

/// Where a ray meets a boundary.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Meeting {
    /// Distance along z, in metres.
    pub distance_m: f64,
    /// Height of the boundary there, in metres.
    pub height_m: f64,
    /// Standard deviation across the boundary, in metres.
    pub sigma_m: f64,
    /// Distance of the camera from the line of the boundary there, in metres.
    pub line_m: f64,
}

/// Finds boundaries; memory is allocated once.
#[derive(Debug)]
pub struct BoundaryFinder {
    rig: Rig,
    path_width_m: f64,
    curves: CurveFinder,
    tracks: TrackList,
    grid: GroundGrid,
    raised: RaisedGround,
    min_height_m: f64,
    uses: Vec<StixelUse>,
}

impl BoundaryFinder {
    /// A finder for the stixels of images of `width` × `height`. `path_width_m` is the width of the own path, `regions`
    /// the parameters of obstacles.
    pub fn new(rig: Rig, path_width_m: f64, regions: &RegionParameters, stixels: &Stixels) -> Self {
        let grid = GroundGrid::new(rig, stixels.strips());
        let confirm = regions.confirm;
        Self {
            raised: RaisedGround::new(&grid),
            grid,
            min_height_m: regions.min_height_m,
            rig,
            path_width_m,
            curves: CurveFinder::new(rig, stixels),
            tracks: TrackList::new(confirm),
            uses: Vec::with_capacity(stixels.capacity()),
        }
    }

    /// Forgets what was seen before.
    pub fn reset(&mut self) {
        self.tracks.clear();
        self.uses.clear();
    }

    /// The boundaries of the last frame.
    pub fn boundaries(&self) -> &[Boundary] {
        self.tracks.boundaries()
    }

    /// What each stixel of the last frame is used for.
    pub fn uses(&self) -> &[StixelUse] {
        &self.uses
    }

    /// Finds the boundaries of a frame, `elapsed_s` seconds after the last one, since when the camera has moved by
    /// `step`.
    pub fn update(
        &mut self,
        stixels: &Stixels,
        (surface, top): (&RoadSurface, usize),
        step: Option<PlanarStep>,
        elapsed_s: f64,
    ) {
        let corridor = Corridor::new(self.path_width_m, step);
        self.mark_raised_ground(stixels, surface, top);
        let curves = self.curves.find(stixels, &self.uses, surface.noise_px());
        self.tracks.update(curves, step, elapsed_s, &corridor);
        self.mark_boundaries(stixels, surface, &corridor);
        for (stixel_use, stixel) in self.uses.iter_mut().zip(stixels.list()) {
            let ray = RayStixel::new(stixel, &self.rig, 0.0);
            let slope = self.rig.lateral_m(Stixels::column(stixel.strip as usize), 1.0);
            let is_low = f64::from(stixel.high_m) <= self.min_height_m;
            if *stixel_use == StixelUse::RaisedGround
                && !is_low
                && corridor.contains([slope / ray.inverse_m, 1.0 / ray.inverse_m])
            {
                *stixel_use = StixelUse::Free;
            }
        }
    }

    /// Finds the ground beside the road, and the stixels on it.
    fn mark_raised_ground(&mut self, stixels: &Stixels, surface: &RoadSurface, top: usize) {
        self.grid.clear();
        for strip in 0..stixels.strips() {
            self.grid.add_strip(strip, Stixels::column(strip), stixels.depths(strip), top, surface);
        }
        self.grid.expect(surface, stixels.height());
        self.raised.update(&self.grid, surface);
        self.uses.clear();
        self.uses.extend(stixels.list().iter().map(|stixel| {
            let raised = self.raised.sector(stixel.strip as usize / SECTOR_STRIPS);
            let bin = self.grid.bin(stixel.disparity_px.into());
            let is_low = f64::from(stixel.high_m) <= MAX_HEIGHT_M;
            let is_ground = is_low && bin.is_some_and(|bin| raised[bin]);
            if is_ground { StixelUse::RaisedGround } else { StixelUse::Free }
        }));
    }

    fn mark_boundaries(&mut self, stixels: &Stixels, surface: &RoadSurface, corridor: &Corridor) {
        let boundaries = self.tracks.boundaries();
        if boundaries.is_empty() {
            return;
        }
        for strip in 0..stixels.strips() {
            let slope = (Stixels::column(strip) - self.rig.cx_px) / self.rig.focal_px;
            for boundary in boundaries {
                let Some(meeting) = boundary.meet(slope) else { continue };
                for i in stixels.range(strip) {
                    let stixel = &stixels.list()[i];
                    let ray = RayStixel::new(stixel, &self.rig, surface.noise_px());
                    let is_part = belongs(&ray, f64::from(stixel.high_m), &meeting);
                    if self.uses[i] == StixelUse::Free
                        && is_part
                        && !corridor.contains([slope / ray.inverse_m, 1.0 / ray.inverse_m]) {
                        self.uses[i] = StixelUse::Boundary;
                    }
                }
            }
        }
    }
}

/// Whether a stixel is part of a boundary: at its distance, within the errors of both, and not higher than it, as a person
/// before a guard rail is.
fn belongs(ray: &RayStixel, high_m: f64, boundary: &Meeting) -> bool {
    let across_m = boundary.sigma_m.hypot(ROUGHNESS_M);
    let shape = ray.inverse_m * across_m / boundary.line_m.max(across_m);
    let gate = GATE_SIGMAS * ray.sigma.hypot(shape);
    let is_low = boundary.height_m >= LOW_HEIGHT_M || high_m <= boundary.height_m + 1.5 * HEIGHT_STEP_M;
    is_low && (ray.inverse_m - 1.0 / boundary.distance_m).abs() <= gate
}
