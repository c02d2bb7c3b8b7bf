//! Free space: for each direction, the range of distances in which the ground was measured and nothing stands.
//!
//! Unknown ground is not free: a range ends where fewer pixels than [`MIN_GROUND_SHARE`] of a cell's are on the ground. A
//! short stretch is bridged ([`MAX_BRIDGED_CELLS`]): ground that is seen right behind it would be hidden by anything that
//! stands in it.

use super::boundary::Boundary;
use super::curve::RayStixel;
use super::ground_grid::{GroundGrid, RoadCell};
use super::limits::{
    FREE_SIGMAS, LOW_HEIGHT_M, MAX_BRIDGED_CELLS, MAX_START_RATIO, MIN_CELL_PIXELS, MIN_GROUND_SHARE,
    MIN_SECTORS, MIN_STANDING_M, MIN_START_SHARE,
};
use super::raised_ground::RaisedGround;
use super::road_view::RoadView;
use crate::detection::stixel_use::StixelUse;
use crate::detection::stixels::{STRIP_COLUMNS, Stixels};
use crate::region::Region;
use crate::rig::Rig;
use crate::road::edges::Edges;

/// Why a range of free ground ends.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum FreeEnd {
    /// Nothing is known beyond.
    #[default]
    Unknown,
    /// An obstacle.
    Obstacle,
    /// A boundary.
    Boundary,
    /// An edge of the road: a kerb, or ground at another height.
    Edge,
}

/// Free ground in one direction: between two columns of the image, from `near_m` to `far_m`. What is nearer than `near_m`
/// is not seen.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct FreeSector {
    /// Left side: metres right of the camera axis a metre ahead.
    pub left_slope: f64,
    /// Right side, likewise.
    pub right_slope: f64,
    /// Distance along z from which the ground is known to be free, in metres; 0 if none is.
    pub near_m: f64,
    /// Distance along z up to which it is, in metres; 0 if none is.
    pub far_m: f64,
    /// Why it ends there.
    pub end: FreeEnd,
}

/// What free space is found from.
#[derive(Clone, Copy, Debug)]
pub struct SectorInput<'a> {
    /// Heights near the ground.
    pub grid: &'a GroundGrid,
    /// Ground at another height.
    pub raised: &'a RaisedGround,
    /// Stixels.
    pub stixels: &'a Stixels,
    /// What they are used for.
    pub uses: &'a [StixelUse],
    /// The road.
    pub road: RoadView<'a>,
    /// Boundaries.
    pub boundaries: &'a [Boundary],
    /// Obstacles.
    pub regions: &'a [Region],
}

/// Finds free sectors; memory is allocated once.
#[derive(Debug)]
pub struct SectorFinder {
    rig: Rig,
    /// Columns of a sector.
    columns: usize,
    sectors: Vec<FreeSector>,
}

impl SectorFinder {
    /// Sectors as those of the grid, none of them free.
    pub fn new(rig: Rig, grid: &GroundGrid) -> Self {
        let columns = grid.sector_strips() * STRIP_COLUMNS;
        let slope = |column: usize| rig.lateral_m(column as f64 - 0.5, 1.0);
        let sector = |i: usize| FreeSector {
            left_slope: slope(i * columns),
            right_slope: slope((i + 1) * columns),
            ..FreeSector::default()
        };
        Self { rig, columns, sectors: (0..grid.sectors()).map(sector).collect() }
    }

    /// The sectors, from left to right.
    pub fn sectors(&self) -> &[FreeSector] {
        &self.sectors
    }

    /// Nothing is free; called when no road is visible.
    pub fn clear(&mut self) {
        for sector in &mut self.sectors {
            (sector.near_m, sector.far_m, sector.end) = (0.0, 0.0, FreeEnd::Unknown);
        }
    }

    /// Finds the free space of a frame.
    pub fn update(&mut self, input: &SectorInput<'_>) {
        let Some(start) = common_start(input.grid) else { return self.clear() };
        for (i, sector) in self.sectors.iter_mut().enumerate() {
            (sector.near_m, sector.far_m, sector.end) = known_ground(input, i, start);
            for boundary in input.boundaries {
                let slopes = [sector.left_slope, sector.right_slope];
                for meeting in slopes.into_iter().filter_map(|slope| boundary.meet(slope)) {
                    let error_m =
                        FREE_SIGMAS * meeting.sigma_m * meeting.distance_m / meeting.line_m.max(0.1);
                    sector.limit(meeting.distance_m - error_m, FreeEnd::Boundary);
                }
            }
            for side in [0, 1] {
                for slope in [sector.left_slope, sector.right_slope] {
                    if let Some(distance_m) = edge_distance_m(input.road.edges, side, slope) {
                        sector.limit(distance_m, FreeEnd::Edge);
                    }
                }
            }
        }
        self.limit_by_stixels(input);
        for region in input.regions.iter().filter(|region| region.evidence > 0.0) {
            let error_m =
                FREE_SIGMAS * self.rig.distance_error_m(region.distance_m, region.disparity_sigma_px);
            let (from, to) = (region.bounds.x as usize, (region.bounds.x + region.bounds.width) as usize);
            let end = to.div_ceil(self.columns).min(self.sectors.len());
            for sector in &mut self.sectors[(from / self.columns).min(end)..end] {
                if let Some(distance_m) = region.meets_m([sector.left_slope, sector.right_slope]) {
                    sector.limit(distance_m - error_m, FreeEnd::Obstacle);
                }
            }
        }
        self.drop_slivers();
    }

    /// Drops ranges that are empty, and runs of sectors that are too narrow to be ground ([`MIN_SECTORS`]).
    fn drop_slivers(&mut self) {
        let mut from = 0;
        while from < self.sectors.len() {
            let run = self.sectors[from..].iter().take_while(|sector| sector.far_m > sector.near_m).count();
            let end = from + run.max(1);
            if run < MIN_SECTORS {
                for sector in &mut self.sectors[from..end] {
                    (sector.near_m, sector.far_m) = (0.0, 0.0);
                }
            }
            from = end;
        }
    }

    /// Each stixel that stands limits its sector, whether a region was grown from it or not.
    fn limit_by_stixels(&mut self, input: &SectorInput<'_>) {
        for (stixel, stixel_use) in input.stixels.list().iter().zip(input.uses) {
            let stands = stixel.low_m < LOW_HEIGHT_M as f32
                && f64::from(stixel.high_m - stixel.low_m) >= MIN_STANDING_M
                && *stixel_use != StixelUse::RaisedGround;
            if !stands {
                continue;
            }
            let ray = RayStixel::new(stixel, &self.rig, input.road.surface.noise_px());
            let distance_m = 1.0 / (ray.inverse_m + FREE_SIGMAS * ray.sigma);
            let end = if *stixel_use == StixelUse::Boundary { FreeEnd::Boundary } else { FreeEnd::Obstacle };
            // At its sides the matcher smooths it into the ground behind.
            let strip = stixel.strip as usize;
            for sector in input.grid.sector_of(strip.saturating_sub(1))..=input.grid.sector_of(strip + 1) {
                if let Some(sector) = self.sectors.get_mut(sector) {
                    sector.limit(distance_m, end);
                }
            }
        }
    }
}

impl FreeSector {
    /// Ends the range at a distance, if it is not shorter.
    fn limit(&mut self, distance_m: f64, end: FreeEnd) {
        if distance_m < self.far_m {
            (self.far_m, self.end) = (distance_m, end);
        }
    }
}

/// Whether enough of a cell is known to be ground at the road's height.
fn is_ground(cell: &RoadCell) -> bool {
    f32::from(cell.level) >= MIN_GROUND_SHARE * f32::from(cell.all)
        && f32::from(cell.level) >= MIN_CELL_PIXELS
}

/// The first cell in which some of the sectors show ground ([`MIN_START_SHARE`]): nearer is a bonnet, or what is too near to
/// be matched.
fn common_start(grid: &GroundGrid) -> Option<usize> {
    let first_visible = (0..grid.bins()).find(|&bin| grid.expected(bin) >= MIN_CELL_PIXELS)?;
    let latest_m = MAX_START_RATIO * grid.near_m(first_visible);
    let is_start = |bin: &usize| {
        let count = |test: fn(&RoadCell) -> bool| {
            (0..grid.sectors()).filter(|&sector| test(&grid.road_sector(sector)[*bin])).count()
        };
        count(is_ground) as f64 >= MIN_START_SHARE * count(|cell| cell.all > 0).max(1) as f64
    };
    (first_visible..grid.bins()).take_while(|&bin| grid.near_m(bin) <= latest_m).find(is_start)
}

/// The range of distances of a sector in which the ground was measured at the road's height, and why it ends.
fn known_ground(input: &SectorInput<'_>, sector: usize, start: usize) -> (f64, f64, FreeEnd) {
    let (cells, raised) = (input.grid.road_sector(sector), input.raised.sector(sector));
    let is_free = |bin: usize| !raised[bin] && is_ground(&cells[bin]);
    let last_start = (start + MAX_BRIDGED_CELLS).min(cells.len() - 1);
    let Some(start) = (start..=last_start).find(|&bin| is_free(bin)) else {
        return (0.0, 0.0, FreeEnd::Unknown);
    };
    let (mut end, mut bin, mut reason) = (start + 1, start + 1, FreeEnd::Unknown);
    while bin < cells.len() && bin - end <= MAX_BRIDGED_CELLS {
        if raised[bin] {
            reason = FreeEnd::Edge;
            break;
        }
        if is_free(bin) {
            end = bin + 1;
        }
        bin += 1;
    }
    // Of a cell that the image cuts off, less than its nearest ground is seen.
    let is_cut = input.grid.expected(start) < input.grid.expected((start + 1).min(cells.len() - 1));
    (input.grid.near_m(start + usize::from(is_cut)), input.grid.near_m(end), reason)
}

/// Distance at which the ray with this slope crosses the edge of the road on a side.
fn edge_distance_m(edges: &Edges, side: usize, slope: f64) -> Option<f64> {
    edges.windows(2).find_map(|pair| {
        let [a, b] = [pair[0][side]?, pair[1][side]?]
            .map(|edge| (f64::from(edge.lateral_m), f64::from(edge.distance_m)));
        let [from, to] = [a, b].map(|(lateral, distance)| lateral - slope * distance);
        if from * to > 0.0 || from == to {
            return None;
        }
        Some(a.1 + (b.1 - a.1) * from / (from - to))
    })
}
