//! Ground beside the road at another height: lawns and pavements behind a kerb.
//!
//! A cell of the [`GroundGrid`] is raised ground if its pixels have one height above that of the road, and if the cells
//! before or behind it go on at that height: the top of a low wall does not.

use super::ground_grid::GroundGrid;
use super::surface::RoadSurface;

/// Heights of raised ground above the road, in metres: a low kerb, and the bank behind a high one.
const HEIGHT_M: std::ops::Range<f32> = 0.06..0.5;

/// Largest standard deviation of the heights in a cell, in metres: grass and camber. The face of a wall of 0.4 m has 0.12.
const MAX_SPREAD_M: f64 = 0.07;

/// Least share of a cell's pixels.
const MIN_SHARE: f32 = 0.3;

/// Least depth of raised ground, in metres: more than the top of a wall.
const MIN_DEPTH_M: f64 = 1.0;

/// Largest slope of the ground, in metres a metre.
const MAX_SLOPE: f64 = 0.15;

/// Cells with raised ground; memory is allocated once.
#[derive(Debug)]
pub struct RaisedGround {
    cells: Vec<bool>,
    bins: usize,
}

impl RaisedGround {
    /// Nothing raised, for a grid of this size.
    pub fn new(grid: &GroundGrid) -> Self {
        Self { cells: vec![false; grid.sectors() * grid.bins()], bins: grid.bins() }
    }

    /// Removes all.
    pub fn clear(&mut self) {
        self.cells.fill(false);
    }

    /// The cells of a sector that are raised ground, from near to far.
    pub fn sector(&self, sector: usize) -> &[bool] {
        &self.cells[sector * self.bins..(sector + 1) * self.bins]
    }

    /// Finds the raised ground of a grid.
    pub fn update(&mut self, grid: &GroundGrid, surface: &RoadSurface) {
        self.clear();
        for sector in 0..grid.sectors() {
            let cells = grid.sector(sector);
            let marks = &mut self.cells[sector * self.bins..(sector + 1) * self.bins];
            let is_raised = |bin: usize| {
                let cell = &cells[bin];
                let noise_m = surface.height_noise_m(grid.disparity_px(bin));
                cell.count >= (MIN_SHARE * grid.expected(bin)).max(3.0)
                    && HEIGHT_M.contains(&cell.mean_m())
                    && f64::from(cell.spread_m()) <= MAX_SPREAD_M.hypot(1.5 * noise_m)
            };
            let continues = |bin: usize| {
                let rise_m = f64::from(cells[bin].mean_m() - cells[bin - 1].mean_m());
                let noise_m = surface.height_noise_m(grid.disparity_px(bin));
                let run_m = grid.near_m(bin) - grid.near_m(bin - 1);
                rise_m.abs() <= MAX_SLOPE * run_m + MAX_SPREAD_M + noise_m
            };
            let mut bin = 0;
            while bin < self.bins {
                if !is_raised(bin) {
                    bin += 1;
                    continue;
                }
                let from = bin;
                bin += 1;
                while bin < self.bins && is_raised(bin) && continues(bin) {
                    bin += 1;
                }
                if bin - from >= 2 && grid.near_m(bin) - grid.near_m(from) >= MIN_DEPTH_M {
                    marks[from..bin].fill(true);
                }
            }
        }
    }
}
