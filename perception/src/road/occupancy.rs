//! Obstacles in u-disparity: what stands on the road, counted by column and disparity.

/// Image columns in one cell.
pub const CELL_COLUMNS: usize = 4;
/// Cells per pixel of disparity.
pub const CELLS_PER_PX: usize = 2;

/// What one cell of the occupancy grid holds.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Cell {
    /// Obstacle pixels.
    pub pixels: u32,
    /// Sum of their disparities, in 1/256 px.
    pub disparity_sum: u64,
    /// Uppermost row with an obstacle pixel.
    pub top: u16,
    /// Lowest row with an obstacle pixel.
    pub bottom: u16,
}

/// The obstacle part of u-disparity (paper, H_y): cells of 4 columns × 1/2 px.
#[derive(Clone, Debug)]
pub struct Occupancy {
    cells: Vec<Cell>,
    columns: usize,
    depths: usize,
}

impl Occupancy {
    /// An empty grid for maps of `width` columns and disparities below `disparities` px.
    pub fn new(width: usize, disparities: usize) -> Self {
        let columns = width.div_ceil(CELL_COLUMNS);
        let depths = disparities * CELLS_PER_PX;
        Self { cells: vec![Cell::default(); columns * depths], columns, depths }
    }

    /// Empties all cells.
    pub fn clear(&mut self) {
        self.cells.fill(Cell::default());
    }

    /// Counts one obstacle pixel; one beyond the grid is left out.
    #[inline]
    pub fn add(&mut self, x: usize, y: usize, disparity: u16) {
        let depth = usize::from(disparity) * CELLS_PER_PX / 256;
        if depth >= self.depths || x / CELL_COLUMNS >= self.columns {
            return;
        }
        let cell = &mut self.cells[x / CELL_COLUMNS * self.depths + depth];
        if cell.pixels == 0 {
            cell.top = y as u16;
        }
        cell.pixels += 1;
        cell.disparity_sum += u64::from(disparity);
        cell.top = cell.top.min(y as u16);
        cell.bottom = cell.bottom.max(y as u16);
    }

    /// Columns of the grid.
    pub fn columns(&self) -> usize {
        self.columns
    }

    /// Disparity cells of a column; a greater index is nearer.
    pub fn depths(&self) -> usize {
        self.depths
    }

    /// One cell.
    pub fn cell(&self, column: usize, depth: usize) -> &Cell {
        &self.cells[column * self.depths + depth]
    }

    /// Disparity at the middle of a cell, in pixels.
    pub fn disparity_px(depth: usize) -> f64 {
        (depth as f64 + 0.5) / CELLS_PER_PX as f64
    }

    /// Mean height of what stands here, in image rows: pixels per column, with the neighbouring
    /// disparities, over which noise spreads a surface.
    pub fn rows_standing(&self, column: usize, depth: usize) -> f64 {
        let range = depth.saturating_sub(1)..(depth + 2).min(self.depths);
        let pixels: u32 = range.map(|d| self.cell(column, d).pixels).sum();
        f64::from(pixels) / CELL_COLUMNS as f64
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pixels_gather_in_their_cell() {
        let mut grid = Occupancy::new(10, 16);
        assert_eq!((grid.columns(), grid.depths()), (3, 32));
        grid.add(5, 30, 5 * 256 + 10);
        grid.add(4, 20, 5 * 256 + 20);
        grid.add(6, 25, 6 * 256);
        grid.add(9, 1, 16 * 256);
        let cell = grid.cell(1, 10);
        assert_eq!((cell.pixels, cell.top, cell.bottom), (2, 20, 30));
        assert_eq!(cell.disparity_sum, 2 * 5 * 256 + 30);
        assert_eq!(grid.cell(1, 12).pixels, 1);
        assert_eq!(grid.rows_standing(1, 11), 0.75);
        assert!((Occupancy::disparity_px(10) - 5.25).abs() < 1e-12);
        grid.clear();
        assert_eq!(*grid.cell(1, 10), Cell::default());
    }
}
