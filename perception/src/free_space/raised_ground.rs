//! Ground beside the road at another height: lawns and pavements behind a kerb.
//!
//! A cell of the [`GroundGrid`] is raised ground if its pixels have one height above that of the road, and if the cells
//! before or behind it go on at that height: the top of a low wall does not.

use super::ground_grid::GroundGrid;
use super::limits::{
    MAX_SLOPE, MAX_SPREAD_M, MIN_CELL_PIXELS, MIN_GROUND_SHARE, MIN_RAISED_DEPTH_M, RAISED_M,
};
use crate::road::surface::RoadSurface;

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
                cell.count >= (MIN_GROUND_SHARE * grid.expected(bin)).max(MIN_CELL_PIXELS)
                    && RAISED_M.contains(&cell.mean_m())
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
                if bin - from >= 2 && grid.near_m(bin) - grid.near_m(from) >= MIN_RAISED_DEPTH_M {
                    marks[from..bin].fill(true);
                }
            }
        }
    }
}
