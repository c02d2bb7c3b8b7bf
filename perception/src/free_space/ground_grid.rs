//! Heights above the road in a grid of directions and distances, as the camera sees the ground.
//!
//! Input: the disparities of the strips ([`crate::detection::stixels`]) and the road's surface. Output: for each sector (some
//! strips) and each range of distances the number of pixels near the ground, the mean of their heights and its spread.
//! Ground, at the road's height or at another one, has one height in a cell; what stands has many.

use super::limits::{BORDER_PX, LEVEL_SIGMAS, MAX_GROUND_M, MAX_LEVEL_M};
use super::road_view::RoadView;
use crate::detection::stixels::Stixels;
use crate::rig::Rig;
use crate::road::heights::{BATCH, PixelBatch};
use crate::road::surface::RoadSurface;

/// Maximum number of sectors.
pub const MAX_SECTORS: usize = 128;

/// Nearest and farthest distance of the grid, in metres.
pub const RANGE_M: (f64, f64) = (2.0, 62.0);

/// Ratio of the far to the near end of a cell. It bounds what can stand unseen in a cell behind which the ground is seen:
/// 7 % of the camera's height.
pub const CELL_RATIO: f64 = 1.075;

/// Entries per px of disparity in the table of cells.
const ENTRIES_PER_PX: usize = 32;

/// Pixels near the ground in a cell.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Cell {
    /// Number of pixels (of strips).
    pub count: f32,
    sum_m: f32,
    square_m2: f32,
}

impl Cell {
    /// Mean height above the road, in metres.
    pub fn mean_m(&self) -> f32 {
        self.sum_m / self.count.max(1.0)
    }

    /// Standard deviation of the heights, in metres.
    pub fn spread_m(&self) -> f32 {
        (self.square_m2 / self.count.max(1.0) - self.mean_m().powi(2)).max(0.0).sqrt()
    }
}

/// Pixels of the image rows in which the road would be seen in a cell, if nothing stood there.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct RoadCell {
    /// Number of pixels (of strips).
    pub all: u16,
    /// Number of those at the disparity of the road.
    pub level: u16,
}

/// The grid of a frame; memory is allocated once.
#[derive(Debug)]
pub struct GroundGrid {
    cells: Vec<Cell>,
    road_cells: Vec<RoadCell>,
    /// Largest difference from the disparity of the road by row, in px.
    tolerance_px: Vec<f32>,
    /// Cell of each disparity; `bins` for none.
    bin_of: Vec<u8>,
    /// Number of pixels of a cell that is all ground.
    expected: Vec<f32>,
    bins: usize,
    sectors: usize,
    sector_strips: usize,
    rig: Rig,
}

impl GroundGrid {
    /// An empty grid for these stixels.
    pub fn new(rig: Rig, stixels: &Stixels) -> Self {
        let (strips, height) = (stixels.strips(), stixels.height());
        let bins = ((RANGE_M.1 / RANGE_M.0).ln() / CELL_RATIO.ln()) as usize;
        let bin_of = (0..256 * ENTRIES_PER_PX).map(|i| {
            let distance_m = rig.distance_m((i as f64 + 0.5) / ENTRIES_PER_PX as f64);
            let bin = (distance_m / RANGE_M.0).ln() / CELL_RATIO.ln();
            if bin >= 0.0 && bin < bins as f64 { bin as u8 } else { bins as u8 }
        });
        let sector_strips = strips.div_ceil(MAX_SECTORS).max(1);
        let sectors = strips.div_ceil(sector_strips);
        Self {
            cells: vec![Cell::default(); sectors * bins],
            road_cells: vec![RoadCell::default(); sectors * bins],
            tolerance_px: vec![0.0; height],
            bin_of: bin_of.collect(),
            expected: vec![0.0; bins],
            bins,
            sectors,
            sector_strips,
            rig,
        }
    }

    /// Number of sectors, from the left.
    pub fn sectors(&self) -> usize {
        self.sectors
    }

    /// Strips of a sector.
    pub fn sector_strips(&self) -> usize {
        self.sector_strips
    }

    /// The sector of a strip.
    pub fn sector_of(&self, strip: usize) -> usize {
        strip / self.sector_strips
    }

    /// Number of cells of a sector, from near to far.
    pub fn bins(&self) -> usize {
        self.bins
    }

    /// The cells of a sector, from near to far.
    pub fn sector(&self, sector: usize) -> &[Cell] {
        &self.cells[sector * self.bins..(sector + 1) * self.bins]
    }

    /// The road's pixels in the cells of a sector, from near to far.
    pub fn road_sector(&self, sector: usize) -> &[RoadCell] {
        &self.road_cells[sector * self.bins..(sector + 1) * self.bins]
    }

    /// Nearest distance of a cell, in metres.
    pub fn near_m(&self, bin: usize) -> f64 {
        RANGE_M.0 * CELL_RATIO.powi(bin as i32)
    }

    /// Cell of a disparity in px; `None` outside of the grid.
    pub fn bin(&self, disparity_px: f64) -> Option<usize> {
        let bin = *self.bin_of.get((disparity_px * ENTRIES_PER_PX as f64) as usize)?;
        (usize::from(bin) < self.bins).then_some(bin.into())
    }

    /// Number of pixels of a cell that is all ground.
    pub fn expected(&self, bin: usize) -> f32 {
        self.expected[bin]
    }

    /// Disparity of the middle of a cell, in px.
    pub fn disparity_px(&self, bin: usize) -> f64 {
        self.rig.disparity_px(self.near_m(bin) * CELL_RATIO.sqrt())
    }

    /// Fills the grid with the strips of a map.
    pub fn fill(&mut self, stixels: &Stixels, road: RoadView<'_>) {
        self.cells.fill(Cell::default());
        self.road_cells.fill(RoadCell::default());
        self.expect(road.surface, stixels.height());
        for (tolerance, &road_px) in self.tolerance_px.iter_mut().zip(road.profile_px).skip(road.top) {
            // What a difference in height is in disparity.
            let noise_px = road.surface.noise_px();
            let level_px = MAX_LEVEL_M * noise_px / road.surface.height_noise_m(f64::from(road_px)).max(1e-6);
            *tolerance = level_px.hypot(LEVEL_SIGMAS * noise_px) as f32;
        }
        for strip in 0..stixels.strips() {
            self.add_strip(strip, stixels.depths(strip), road);
            self.add_road(strip, stixels.depths(strip), road);
        }
    }

    /// Computes how many pixels each cell has where all of it is ground, in images with this number of rows.
    fn expect(&mut self, surface: &RoadSurface, height: usize) {
        let row = |distance_m: f64| {
            let row = surface.row_at(self.rig.cx_px, self.rig.disparity_px(distance_m));
            row.clamp(0.0, height as f32)
        };
        let sector_strips = self.sector_strips as f32;
        let mut near_m = RANGE_M.0;
        for expected in &mut self.expected {
            let rows = row(near_m) - row(near_m * CELL_RATIO);
            *expected = if rows.is_finite() { rows.max(0.0) * sector_strips } else { 0.0 };
            near_m *= CELL_RATIO;
        }
    }

    /// Counts the pixels of a strip that are at the disparity of the road.
    fn add_road(&mut self, strip: usize, depths: &[u16], road: RoadView<'_>) {
        let cells = &mut self.road_cells[strip / self.sector_strips * self.bins..][..self.bins];
        let column = Stixels::column(strip) as f32;
        let tilt_px = -road.surface.tilt().levelled_px(Stixels::column(strip), 0.0) as f32;
        let rows = depths.iter().zip(road.profile_px).zip(&self.tolerance_px).skip(road.top);
        for ((&d, &profile_px), &tolerance_px) in rows {
            let road_px = profile_px + tilt_px;
            let bin = self.bin_of.get((road_px * ENTRIES_PER_PX as f32) as usize).copied().unwrap_or(u8::MAX);
            if let Some(cell) = cells.get_mut(usize::from(bin)) {
                cell.all += 1;
                let in_right = column - road_px >= BORDER_PX;
                cell.level +=
                    u16::from(in_right && d > 0 && (f32::from(d) / 256.0 - road_px).abs() <= tolerance_px);
            }
        }
    }

    /// Adds the heights of the disparities of a strip (1/256 px, row by row).
    fn add_strip(&mut self, strip: usize, depths: &[u16], road: RoadView<'_>) {
        let x_px = Stixels::column(strip) as f32;
        let cells = &mut self.cells[strip / self.sector_strips * self.bins..][..self.bins];
        let mut pixels = PixelBatch::default();
        let mut heights_m = [0.0; BATCH];
        for from in (road.top..depths.len()).step_by(BATCH) {
            pixels.clear();
            for y in from..(from + BATCH).min(depths.len()) {
                pixels.push(x_px, y as f32, depths[y], depths[y] > 0);
            }
            road.surface.heights_m(&pixels, &mut heights_m);
            for (&d, &height) in pixels.disparity.iter().zip(&heights_m).take(pixels.count()) {
                let bin = self.bin_of[usize::from(d) * ENTRIES_PER_PX / 256];
                // This form of the comparison rejects NaN.
                if height.abs() < MAX_GROUND_M
                    && let Some(cell) = cells.get_mut(usize::from(bin))
                {
                    cell.count += 1.0;
                    cell.sum_m += height as f32;
                    cell.square_m2 += (height * height) as f32;
                }
            }
        }
    }
}
