//! Obstacle regions: connected occupancy becomes boxes with a distance.

use super::Tilt;
use super::occupancy::{CELL_COLUMNS, Occupancy};
use super::profile::RoadProfile;
use crate::rig::Rig;

/// A box in the image, in pixels.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct PixelBox {
    /// Left column.
    pub x: u32,
    /// Top row.
    pub y: u32,
    /// Width.
    pub width: u32,
    /// Height.
    pub height: u32,
}

impl PixelBox {
    /// Shared area ÷ joint area, 0 to 1.
    pub fn overlap(&self, other: &PixelBox) -> f64 {
        let span =
            |a: u32, al: u32, b: u32, bl: u32| f64::from((a + al).min(b + bl).saturating_sub(a.max(b)));
        let shared =
            span(self.x, self.width, other.x, other.width) * span(self.y, self.height, other.y, other.height);
        let area = |b: &PixelBox| f64::from(b.width) * f64::from(b.height);
        let joint = area(self) + area(other) - shared;
        if joint > 0.0 { shared / joint } else { 0.0 }
    }
}

/// Something that stands on the road, or beside it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Region {
    /// Where it is in the left image.
    pub bounds: PixelBox,
    /// Disparity of its near side, in pixels.
    pub disparity_px: f64,
    /// One standard deviation of that, in pixels.
    pub disparity_sigma_px: f64,
    /// Distance of its near side along z, in metres.
    pub distance_m: f64,
    /// Middle of the box, metres right of the camera axis.
    pub lateral_m: f64,
    /// Width of the box at that distance, in metres.
    pub width_m: f64,
    /// Height of the box at that distance, in metres.
    pub height_m: f64,
    /// Obstacle pixels.
    pub pixels: u32,
}

/// What makes a region.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RegionParameters {
    /// What reaches less than this above the road is road, in metres.
    pub least_height_m: f64,
    /// What is higher than this above the road is not in the way, in metres.
    pub greatest_height_m: f64,
    /// Nothing is reported farther away, in metres.
    pub greatest_distance_m: f64,
    /// Regions narrower than this are noise, in metres.
    pub least_width_m: f64,
    /// Depth that one region may span, in metres: a long hedge is cut into pieces.
    pub depth_span_m: f64,
    /// Regions of fewer pixels are noise.
    pub least_pixels: u32,
    /// At most this many regions are kept, nearest first.
    pub greatest_count: usize,
}

impl Default for RegionParameters {
    fn default() -> Self {
        Self {
            least_height_m: 0.3,
            greatest_height_m: 3.0,
            greatest_distance_m: 60.0,
            least_width_m: 0.25,
            depth_span_m: 4.5,
            least_pixels: 60,
            greatest_count: 64,
        }
    }
}

/// Regions that are measured before the nearest are chosen.
const CAPACITY: usize = 512;

/// Groups occupied cells, with memory allocated once.
#[derive(Debug)]
pub struct RegionFinder {
    parameters: RegionParameters,
    visited: Vec<bool>,
    stack: Vec<(u32, u32)>,
    members: Vec<(u32, u32)>,
    /// Pixels by disparity cell of the region at hand.
    by_depth: Vec<u32>,
    regions: Vec<Region>,
}

impl RegionFinder {
    /// A workspace for the given grid.
    pub fn new(parameters: RegionParameters, grid: &Occupancy) -> Self {
        let cells = grid.columns() * grid.depths();
        Self {
            visited: vec![false; cells],
            stack: Vec::with_capacity(cells),
            members: Vec::with_capacity(cells),
            by_depth: vec![0; grid.depths()],
            regions: Vec::with_capacity(CAPACITY),
            parameters,
        }
    }

    /// Groups the cells of `grid`; the regions are sorted, nearest first, and beyond the greatest
    /// count the farthest are left out. `size` is the image's width and height.
    pub fn find(
        &mut self,
        grid: &Occupancy,
        road: &RoadProfile,
        tilt: Tilt,
        rig: &Rig,
        size: (usize, usize),
    ) -> &[Region] {
        self.visited.fill(false);
        self.regions.clear();
        for depth in (0..grid.depths()).rev() {
            for column in 0..grid.columns() {
                if !self.visited[column * grid.depths() + depth] && self.occupied(grid, rig, column, depth) {
                    self.gather(grid, rig, column, depth);
                    if let Some(region) = self.measure(grid, road, tilt, rig, size)
                        && self.regions.len() < CAPACITY
                    {
                        self.regions.push(region);
                    }
                }
            }
        }
        // The seed is the nearest stray cell; what counts is where the region stands.
        self.regions.sort_unstable_by(|a, b| {
            b.disparity_px.total_cmp(&a.disparity_px).then(a.bounds.x.cmp(&b.bounds.x))
        });
        self.regions.truncate(self.parameters.greatest_count);
        &self.regions
    }

    /// Whether enough stands in a cell: half the least height, in rows at that disparity.
    fn occupied(&self, grid: &Occupancy, rig: &Rig, column: usize, depth: usize) -> bool {
        if grid.cell(column, depth).pixels == 0 {
            return false;
        }
        let disparity = Occupancy::disparity_px(depth);
        let rows = 0.5 * self.parameters.least_height_m * disparity / rig.baseline_m;
        grid.rows_standing(column, depth) >= rows.max(2.0)
    }

    /// Collects all cells that connect to the seed and are not much farther away than it.
    fn gather(&mut self, grid: &Occupancy, rig: &Rig, column: usize, depth: usize) {
        let near_m = rig.distance_m(Occupancy::disparity_px(depth));
        let far_px = rig.disparity_px(near_m + self.parameters.depth_span_m);
        let farthest = (far_px * super::occupancy::CELLS_PER_PX as f64) as usize;
        self.members.clear();
        self.stack.clear();
        self.visited[column * grid.depths() + depth] = true;
        self.stack.push((column as u32, depth as u32));
        while let Some((column, depth)) = self.stack.pop() {
            self.members.push((column, depth));
            let (column, depth) = (column as usize, depth as usize);
            // Neighbours: two columns, and a disparity step that grows with the disparity.
            let reach = 2 + depth / 24;
            let columns = column.saturating_sub(2)..(column + 3).min(grid.columns());
            let depths = depth.saturating_sub(reach).max(farthest)..(depth + reach + 1).min(grid.depths());
            for c in columns {
                for d in depths.clone() {
                    let i = c * grid.depths() + d;
                    if !self.visited[i] && self.occupied(grid, rig, c, d) {
                        self.visited[i] = true;
                        self.stack.push((c as u32, d as u32));
                    }
                }
            }
        }
    }

    fn measure(
        &mut self,
        grid: &Occupancy,
        road: &RoadProfile,
        tilt: Tilt,
        rig: &Rig,
        (width, height): (usize, usize),
    ) -> Option<Region> {
        self.by_depth.fill(0);
        let (mut left, mut right) = (u32::MAX, 0);
        let (mut top, mut bottom) = (u16::MAX, 0);
        let mut pixels = 0;
        for &(column, depth) in &self.members {
            let cell = grid.cell(column as usize, depth as usize);
            self.by_depth[depth as usize] += cell.pixels;
            pixels += cell.pixels;
            left = left.min(column);
            right = right.max(column);
            top = top.min(cell.top);
            bottom = bottom.max(cell.bottom);
        }
        if pixels < self.parameters.least_pixels {
            return None;
        }
        let (disparity_px, disparity_sigma_px) = self.near_side(grid, pixels)?;
        let distance_m = rig.distance_m(disparity_px);
        if distance_m > self.parameters.greatest_distance_m {
            return None;
        }
        let x = left * CELL_COLUMNS as u32;
        let right = ((right + 1) * CELL_COLUMNS as u32).min(width as u32);
        // The mask leaves out what is low: the box goes down to the road.
        let middle = f64::from(x + right) / 2.0;
        let levelled = tilt.level(middle, disparity_px).max(0.0) as f32;
        let foot = road.row_at(levelled).unwrap_or(f32::from(bottom)).round();
        let foot = (foot.clamp(0.0, (height - 1) as f32) as u32).max(u32::from(bottom));
        let top = u32::from(top);
        let bounds = PixelBox { x, y: top, width: right - x, height: foot + 1 - top };
        let metres = |px: u32| f64::from(px) * distance_m / rig.focal_px;
        let region = Region {
            bounds,
            disparity_px,
            disparity_sigma_px,
            distance_m,
            lateral_m: rig.lateral_m(f64::from(x) + f64::from(bounds.width) / 2.0, distance_m),
            width_m: metres(bounds.width),
            height_m: metres(bounds.height),
            pixels,
        };
        let p = &self.parameters;
        (region.width_m >= p.least_width_m && region.height_m >= p.least_height_m).then_some(region)
    }

    /// Disparity of the near side: the mean around the upper fifth of the region's disparities,
    /// so that neither its depth nor a few stray pixels move it.
    fn near_side(&self, grid: &Occupancy, pixels: u32) -> Option<(f64, f64)> {
        let mut rest = pixels / 5;
        let mut nearest = self.by_depth.len() - 1;
        for (depth, &count) in self.by_depth.iter().enumerate().rev() {
            nearest = depth;
            if count > rest {
                break;
            }
            rest -= count;
        }
        let reach = 2 + nearest / 40;
        let (mut n, mut sum, mut squares) = (0.0, 0.0, 0.0);
        for &(column, depth) in &self.members {
            let depth = depth as usize;
            let cell = grid.cell(column as usize, depth);
            if cell.pixels > 0 && depth.abs_diff(nearest) <= reach {
                let mean = cell.disparity_sum as f64 / f64::from(cell.pixels) / 256.0;
                n += f64::from(cell.pixels);
                sum += f64::from(cell.pixels) * mean;
                squares += f64::from(cell.pixels) * mean * mean;
            }
        }
        if n == 0.0 {
            return None;
        }
        let mean = sum / n;
        let variance = (squares / n - mean * mean).max(0.0);
        // Neighbouring pixels share their windows, so about one in fifty is independent; 0.15 px
        // stays for what averaging does not remove.
        Some((mean, (0.15_f64.powi(2) + variance / (n / 50.0).max(1.0)).sqrt()))
    }
}
