//! Free space ahead and what bounds it: boundaries, ground at another height, obstacles, and the end of what is known.
//!
//! Input: the stixels of a frame ([`crate::detection::stixels`]), the road's surface and edges, and the obstacles. Output:
//! [`Boundary`]s in metres, the use of each stixel ([`StixelUse`]), and [`FreeSector`]s: how far the ground is known to be
//! free in each direction.
//!
//! 1. [`ground_grid`]: heights above the road by direction and distance; [`raised_ground`]: lawns and pavements among them.
//! 2. [`curve`]: stixels that continue each other along a wall, a hedge or a guard rail. A boundary is longer than a
//!    vehicle, goes on without the gaps between parked cars, and has a steady height, or is higher than any vehicle.
//!    [`track`] filters them over frames, puts parts together, and looks whether known points are still there (`look`). What
//!    stands before a boundary (`relief`) is no part of it.
//! 3. [`sectors`]: the free distance of each direction. Unknown ground is not free.
//!
//! A boundary may stand across the way: an end wall, a barrier, the rail of a bend that is not taken. What of it is in the
//! own path ([`corridor`]) stays an obstacle: there is one way to the alarm, and it does not depend on whether something
//! was taken for a boundary.

pub mod boundary;
pub mod corridor;
pub mod curve;
pub mod ground_grid;
pub mod limits;
mod look;
pub mod raised_ground;
mod relief;
pub mod road_view;
pub mod sectors;
pub mod track;

use crate::detection::RegionParameters;
use crate::detection::stixel_use::StixelUse;
use crate::detection::stixels::{Stixel, Stixels};
use crate::motion::planar::PlanarStep;
use crate::region::Region;
use crate::rig::Rig;
use boundary::{Boundary, Meeting};
use corridor::Corridor;
use curve::{CurveFinder, RayStixel};
use ground_grid::GroundGrid;
use limits::{
    GATE_SIGMAS, HEIGHT_STEP_M, LOW_HEIGHT_M, MAX_GATE_M, MAX_GROUND_M, MAX_SPREAD_M, RELIEF_STRIPS,
    ROUGHNESS_M,
};
use look::FrameView;
use raised_ground::RaisedGround;
use relief::Relief;
use road_view::RoadView;
use sectors::{FreeSector, SectorFinder, SectorInput};
use track::TrackList;

/// Finds boundaries, raised ground and free space in maps of one size; memory is allocated once.
#[derive(Debug)]
pub struct FreeSpaceFinder {
    rig: Rig,
    path_width_m: f64,
    /// The own path in the last frame.
    corridor: Corridor,
    min_height_m: f64,
    grid: GroundGrid,
    raised: RaisedGround,
    curves: CurveFinder,
    tracks: TrackList,
    sectors: SectorFinder,
    uses: Vec<StixelUse>,
    /// Of each strip, before one boundary.
    reliefs: Vec<Relief>,
}

impl FreeSpaceFinder {
    /// A finder for such stixels. `path_width_m` is the width of the own path, `regions` are the parameters of obstacles.
    pub fn new(rig: Rig, path_width_m: f64, regions: &RegionParameters, stixels: &Stixels) -> Self {
        let grid = GroundGrid::new(rig, stixels);
        Self {
            path_width_m,
            corridor: Corridor::new(path_width_m, None),
            min_height_m: regions.min_height_m,
            raised: RaisedGround::new(&grid),
            curves: CurveFinder::new(rig, stixels),
            tracks: TrackList::new(regions.confirm),
            sectors: SectorFinder::new(rig, &grid),
            uses: Vec::with_capacity(stixels.capacity()),
            reliefs: Vec::with_capacity(stixels.strips()),
            grid,
            rig,
        }
    }

    /// Forgets what was seen before; called when no road is visible, too.
    pub fn reset(&mut self) {
        self.tracks.clear();
        self.uses.clear();
        self.sectors.clear();
    }

    /// The boundaries of the last frame, nearest first.
    pub fn boundaries(&self) -> &[Boundary] {
        self.tracks.boundaries()
    }

    /// The own path in the last frame.
    pub fn corridor(&self) -> Corridor {
        self.corridor
    }

    /// What each stixel of the last frame is used for.
    pub fn uses(&self) -> &[StixelUse] {
        &self.uses
    }

    /// How far the ground is known to be free, by direction from left to right.
    pub fn sectors(&self) -> &[FreeSector] {
        self.sectors.sectors()
    }

    /// Finds the boundaries and the raised ground of a frame, `elapsed_s` seconds after the last one, since when the camera
    /// has moved by `step`; afterwards [`Self::uses`] holds for these stixels.
    pub fn classify(
        &mut self,
        stixels: &Stixels,
        road: RoadView<'_>,
        step: Option<PlanarStep>,
        elapsed_s: f64,
    ) {
        let corridor = Corridor::new(self.path_width_m, step);
        self.corridor = corridor;
        self.mark_raised_ground(stixels, road);
        let curves = self.curves.find(stixels, &self.uses, road.surface.noise_px());
        let view = FrameView { stixels, surface: road.surface, rig: self.rig };
        self.tracks.update(curves, step, elapsed_s, |boundary, i| view.look(boundary, i));
        self.tracks.publish(&corridor);
        self.mark_boundaries(stixels, road.surface.noise_px());
        for (stixel_use, stixel) in self.uses.iter_mut().zip(stixels.list()) {
            // Of what is not higher than road may be, nothing is an obstacle, wherever it is.
            let is_road =
                *stixel_use == StixelUse::RaisedGround && f64::from(stixel.high_m) <= self.min_height_m;
            if !stixel_use.is_free() && !is_road && corridor.contains(place(stixel, &self.rig)) {
                *stixel_use = StixelUse::Free;
            }
        }
    }

    /// Finds the free space of a frame, after [`Self::classify`], with the obstacles that were found in it.
    pub fn update(&mut self, stixels: &Stixels, road: RoadView<'_>, regions: &[Region]) {
        self.sectors.update(&SectorInput {
            grid: &self.grid,
            raised: &self.raised,
            stixels,
            uses: &self.uses,
            road,
            boundaries: self.tracks.boundaries(),
            regions,
        });
    }

    fn mark_raised_ground(&mut self, stixels: &Stixels, road: RoadView<'_>) {
        self.grid.fill(stixels, road);
        self.raised.update(&self.grid, road.surface);
        self.uses.clear();
        self.uses.extend(stixels.list().iter().map(|stixel| {
            let raised = self.raised.sector(self.grid.sector_of(stixel.strip as usize));
            let bin = self.grid.bin(stixel.disparity_px.into());
            let cells = self.grid.sector(self.grid.sector_of(stixel.strip as usize));
            let is_low = f64::from(stixel.high_m) <= MAX_GROUND_M;
            // The face of a kerb is not higher than the ground behind it.
            let is_face = |behind: usize| {
                raised.get(behind) == Some(&true)
                    && stixel.high_m <= cells[behind].mean_m() + 2.0 * MAX_SPREAD_M as f32
            };
            let is_ground = is_low && bin.is_some_and(|bin| raised[bin] || is_face(bin + 1));
            if is_ground { StixelUse::RaisedGround } else { StixelUse::Free }
        }));
    }

    fn mark_boundaries(&mut self, stixels: &Stixels, noise_px: f64) {
        for boundary in self.tracks.boundaries() {
            self.reliefs.clear();
            for strip in 0..stixels.strips() {
                let meeting = boundary.meet(self.rig.lateral_m(Stixels::column(strip), 1.0));
                let own = meeting.map(|meeting| {
                    let all = stixels.range(strip).filter(|i| self.uses[*i].is_free());
                    let all = all.map(|i| &stixels.list()[i]);
                    let own = all.filter(|stixel| belongs(stixel, &meeting, &self.rig, noise_px));
                    let ray = |stixel: &Stixel| RayStixel::new(stixel, &self.rig, noise_px);
                    Relief::of(own.map(|stixel| (ray(stixel), stixel.rows)), &meeting)
                });
                self.reliefs.push(own.unwrap_or_default());
            }
            for strip in 0..stixels.strips() {
                let slope = self.rig.lateral_m(Stixels::column(strip), 1.0);
                let Some(meeting) = boundary.meet(slope) else { continue };
                let around = strip.saturating_sub(RELIEF_STRIPS)..(strip + RELIEF_STRIPS + 1);
                let around = &self.reliefs[around.start..around.end.min(self.reliefs.len())];
                if Relief::sum(around).stands_before() {
                    continue;
                }
                for i in stixels.range(strip) {
                    let stixel = &stixels.list()[i];
                    if self.uses[i].is_free() && belongs(stixel, &meeting, &self.rig, noise_px) {
                        self.uses[i] = StixelUse::Boundary;
                    }
                }
            }
        }
    }
}

/// Place of a stixel, in metres right and ahead of the camera.
fn place(stixel: &Stixel, rig: &Rig) -> [f64; 2] {
    let distance_m = 1.0 / RayStixel::new(stixel, rig, 0.0).inverse_m;
    [rig.lateral_m(Stixels::column(stixel.strip as usize), distance_m), distance_m]
}

/// Whether a stixel is part of a boundary: at its distance, within the errors of both, where the noise is so low that a person
/// before the boundary would differ from it, and not higher than the boundary, as a person before a guard rail is.
fn belongs(stixel: &Stixel, boundary: &Meeting, rig: &Rig, noise_px: f64) -> bool {
    let ray = RayStixel::new(stixel, rig, noise_px);
    let across_m = boundary.sigma_m.hypot(ROUGHNESS_M);
    let shape = ray.inverse_m * across_m / boundary.line_m.max(across_m);
    let gate = GATE_SIGMAS * ray.sigma.hypot(shape);
    let is_high = f64::from(stixel.high_m) > boundary.height_m + 2.0 * HEIGHT_STEP_M;
    let is_sure = GATE_SIGMAS * ray.sigma * boundary.line_m * boundary.distance_m <= MAX_GATE_M;
    (boundary.height_m >= LOW_HEIGHT_M || !is_high)
        && is_sure
        && (ray.inverse_m - 1.0 / boundary.distance_m).abs() <= gate
}

#[cfg(test)]
mod tests;
