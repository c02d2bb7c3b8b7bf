//! Corner detection: the smaller eigenvalue of the structure tensor (Shi and Tomasi, "Good features to track", 1994), the
//! best corner of each cell of a grid.
//!
//! It works on level 1 of the pyramid: noise of single pixels makes no corner there, and it takes a quarter of the time.

use crate::image::GreyView;

/// Side of a cell, in px of the level that is searched.
pub const CELL_PX: usize = 12;

/// Half width of the window over which the structure tensor is summed, in px of that level.
const HALF: usize = 2;
const WINDOW: usize = 2 * HALF + 1;

/// Smallest eigenvalue of a corner: the gradient in its weakest direction, in grey levels per px (central difference over
/// 2 px), squared, times the pixels of the window.
const MIN_SCORE: f32 = 3.0 * 3.0 * (WINDOW * WINDOW) as f32;

/// A corner.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Corner {
    /// Column and row in the level that was searched, in px.
    pub x: u16,
    /// Row.
    pub y: u16,
    /// The smaller eigenvalue; 0 if the cell has no corner.
    pub score: f32,
}

/// Finds the best corner of each cell; memory is allocated once.
#[derive(Debug)]
pub struct CornerFinder {
    width: usize,
    height: usize,
    columns: usize,
    /// Products of gradients xx, xy, yy, for the rows of a window.
    products: [Vec<[f32; 3]>; WINDOW],
    sums: Vec<[f32; 3]>,
    cells: Vec<Corner>,
}

impl CornerFinder {
    /// A finder for images of `width` × `height` px.
    pub fn new(width: usize, height: usize) -> Self {
        let columns = width.div_ceil(CELL_PX);
        Self {
            width,
            height,
            columns,
            products: std::array::from_fn(|_| vec![[0.0; 3]; width]),
            sums: vec![[0.0; 3]; width],
            cells: vec![Corner::default(); columns * height.div_ceil(CELL_PX)],
        }
    }

    /// Number of cells.
    pub fn cells(&self) -> usize {
        self.cells.len()
    }

    /// Index of the cell at a position in px.
    pub fn cell(&self, x: f32, y: f32) -> usize {
        let index = (y.max(0.0) as usize / CELL_PX) * self.columns + x.max(0.0) as usize / CELL_PX;
        index.min(self.cells.len() - 1)
    }

    /// The best corner of each cell that `wanted` selects, at least `margin` px from the border; a corner with score 0
    /// where there is none.
    pub fn find(&mut self, image: GreyView<'_>, margin: usize, wanted: impl Fn(usize) -> bool) -> &[Corner] {
        self.cells.fill(Corner::default());
        if (image.width(), image.height()) != (self.width, self.height) {
            return &self.cells;
        }
        let margin = margin.max(HALF + 1);
        for y in 1..self.height.saturating_sub(1) {
            gradient_products(image, y, &mut self.products[y % WINDOW]);
            // The window that ends with this row.
            let Some(centre) = y.checked_sub(HALF) else { continue };
            if centre < margin || centre + margin >= self.height {
                continue;
            }
            let row = centre / CELL_PX * self.columns;
            if !(row..row + self.columns).any(&wanted) {
                continue;
            }
            for (x, sum) in self.sums.iter_mut().enumerate() {
                *sum = std::array::from_fn(|k| self.products.iter().map(|row| row[x][k]).sum());
            }
            for x in margin..self.width.saturating_sub(margin) {
                let window = &self.sums[x - HALF..=x + HALF];
                let [a, b, c]: [f32; 3] = std::array::from_fn(|k| window.iter().map(|sum| sum[k]).sum());
                let score = 0.5 * (a + c) - (0.25 * (a - c) * (a - c) + b * b).sqrt();
                let best = &mut self.cells[row + x / CELL_PX];
                if score > best.score.max(MIN_SCORE) {
                    *best = Corner { x: x as u16, y: centre as u16, score };
                }
            }
        }
        for (index, cell) in self.cells.iter_mut().enumerate() {
            if !wanted(index) {
                *cell = Corner::default();
            }
        }
        &self.cells
    }
}

fn gradient_products(image: GreyView<'_>, y: usize, out: &mut [[f32; 3]]) {
    let (above, row, below) = (image.row(y - 1), image.row(y), image.row(y + 1));
    for x in 1..row.len() - 1 {
        let dx = (f32::from(row[x + 1]) - f32::from(row[x - 1])) / 2.0;
        let dy = (f32::from(below[x]) - f32::from(above[x])) / 2.0;
        out[x] = [dx * dx, dx * dy, dy * dy];
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_corner_is_found_and_an_edge_is_not() {
        let (width, height) = (60, 48);
        // A bright square from (30, 20) to the lower right: one corner, two edges.
        let bright = |x: usize, y: usize| if x >= 30 && y >= 20 { 200 } else { 40 };
        let pixels: Vec<u8> = (0..width * height).map(|i| bright(i % width, i / width)).collect();
        let image = GreyView::new(&pixels, width, height, width).unwrap();
        let mut finder = CornerFinder::new(width, height);
        let found: Vec<Corner> =
            finder.find(image, 4, |_| true).iter().copied().filter(|c| c.score > 0.0).collect();
        assert!(!found.is_empty());
        for corner in &found {
            let off = (f32::from(corner.x) - 30.0).abs().max((f32::from(corner.y) - 20.0).abs());
            assert!(off <= 3.0, "{corner:?}");
        }
        let cell = finder.cell(30.0, 20.0);
        assert!(finder.find(image, 4, |k| k != cell).get(cell).is_some_and(|c| c.score == 0.0));
    }
}
