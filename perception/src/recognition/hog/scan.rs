//! Sliding-window detection over several scales, like OpenCV's `HOGDescriptor::detectMultiScale`.

use super::block::{BLOCK, BLOCK_STRIDE, blocks, window_sum};
use super::gradient::{CellRow, cell_weights};
use super::model::HogModel;
use super::{BINS, CELL};
use crate::image::GreyView;
use crate::recognition::resize::Resizer;
use crate::recognition::scan::{MIN_GROWTH, MIN_SCALE, Sizes, Window};
use crate::simd::Level;

/// Maximum number of scales: OpenCV's default.
const MAX_SCALES: usize = 64;

/// A window with its score.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ScoredWindow {
    /// The window, in pixels of the scanned image; with padding it may reach beyond it.
    pub window: Window,
    /// Sum of products and bias: the distance from the SVM's plane, positive for objects.
    pub score: f32,
}

/// Scans images up to a maximum size, with memory allocated once.
#[derive(Debug)]
pub struct HogScanner {
    level: Level,
    model: HogModel,
    weights: [[f32; 2 * CELL]; 2],
    /// Maximum width and height of an image, scaled.
    limit: (usize, usize),
    /// Reflected pixels to the left and right of the scaled image, and above and below it.
    padding: (usize, usize),
    resizer: Resizer,
    cells: CellRow,
    sums: [Vec<f32>; 2],
    blocks: Vec<f32>,
    scales: Vec<f64>,
    hits: Vec<ScoredWindow>,
    max_hits: usize,
}

/// The nearest integer; halves go to the even one, as in OpenCV.
fn round(value: f64) -> i32 {
    value.round_ties_even() as i32
}

/// Number of pixels, at least 0.
fn pixels(value: f64) -> usize {
    usize::try_from(round(value)).unwrap_or(0)
}

impl HogScanner {
    /// A scanner for images of up to `width` × `height` pixels with OpenCV's `padding` (multiples of a cell are used, as
    /// there). It returns at most `max_hits` windows of an image; `usize::MAX` for all.
    pub fn new(model: HogModel, width: usize, height: usize, padding: usize, max_hits: usize) -> Self {
        let padding = padding.next_multiple_of(CELL);
        let cells = |px: usize| (px + 2 * padding) / CELL;
        let (across, down) = (cells(width), cells(height));
        let sums = || vec![0.0; 2 * BINS * across * CELL];
        Self {
            level: Level::best(),
            model,
            weights: cell_weights(),
            limit: (width, height),
            padding: (padding, padding),
            resizer: Resizer::new(width, height),
            cells: CellRow::new(across * CELL),
            sums: [sums(), sums()],
            blocks: vec![0.0; across * down * BLOCK_STRIDE],
            scales: Vec::with_capacity(MAX_SCALES),
            hits: Vec::with_capacity(if max_hits == usize::MAX { 0 } else { max_hits }),
            max_hits,
        }
    }

    /// The same on another instruction set.
    #[must_use]
    pub fn with_level(mut self, level: Level) -> Self {
        self.level = level;
        self
    }

    /// Chooses the scales: how many pixels of the image a pixel of the window has.
    fn choose_scales(&mut self, sizes: Sizes, width: usize, height: usize) {
        self.scales.clear();
        let (window_width, window_height) = self.model.window();
        let (image_width, image_height) = (width as f64, height as f64);
        match sizes {
            Sizes::Range { min_px, max_px, growth } => {
                let mut scale = 1.0;
                for _ in 0..MAX_SCALES {
                    if pixels(image_width / scale) < window_width
                        || pixels(image_height / scale) < window_height
                    {
                        break;
                    }
                    let side = pixels(window_width as f64 * scale);
                    if side >= min_px as usize && (max_px == 0 || side <= max_px as usize) {
                        self.scales.push(scale);
                    }
                    scale *= growth.max(MIN_GROWTH);
                }
            }
            Sizes::Around { width_px, growth } => {
                let half = growth.max(MIN_GROWTH).sqrt();
                let expected = width_px / window_width as f64;
                // Padded windows must fit into the padded image, and scaled images into the memory.
                let without_margin = |px: usize, padding: usize| (px - (2 * padding).min(px - 1)) as f64;
                let greatest = (image_width / without_margin(window_width, self.padding.0))
                    .min(image_height / without_margin(window_height, self.padding.1));
                let least = MIN_SCALE
                    .max(image_width / (self.limit.0 as f64 + 0.4))
                    .max(image_height / (self.limit.1 as f64 + 0.4));
                for scale in [expected / half, expected * half] {
                    let scale = scale.min(greatest).max(least);
                    if scale <= greatest * 1.000_001 && !self.scales.contains(&scale) {
                        self.scales.push(scale);
                    }
                }
            }
        }
    }

    /// All windows of `image` with a score above `threshold`, scale by scale, row by row.
    ///
    /// # Panics
    /// If the image is larger than the scanner's maximum size.
    pub fn scan(&mut self, image: GreyView<'_>, sizes: Sizes, threshold: f32) -> &[ScoredWindow] {
        self.hits.clear();
        self.choose_scales(sizes, image.width(), image.height());
        for i in 0..self.scales.len() {
            self.scan_scale(image, self.scales[i], threshold);
        }
        &self.hits
    }

    /// Scans one scale.
    fn scan_scale(&mut self, image: GreyView<'_>, scale: f64, threshold: f32) {
        let (width, height) = (pixels(image.width() as f64 / scale), pixels(image.height() as f64 / scale));
        if width == 0 || height == 0 {
            return;
        }
        let grid = self.fill(image, width, height);
        let (window_width, window_height) = self.model.window();
        let (across, down) = self.model.blocks();
        if grid.0 < across || grid.1 < down {
            return;
        }
        let stride = grid.0 * BLOCK_STRIDE;
        let size = (round(window_width as f64 * scale), round(window_height as f64 * scale));
        for y in 0..=grid.1 - down {
            for x in 0..=grid.0 - across {
                let mut sum = 0.0;
                let blocks = &self.blocks[y * stride + x * BLOCK_STRIDE..];
                window_sum(self.level, self.model.rows(), down, blocks, stride, &mut sum);
                let score = sum + self.model.bias();
                if score >= threshold && self.hits.len() < self.max_hits {
                    let place =
                        |cell: usize, padding: usize| round(((cell * CELL) as f64 - padding as f64) * scale);
                    let (x, y) = (place(x, self.padding.0), place(y, self.padding.1));
                    let window = Window { x, y, width: size.0, height: size.1 };
                    self.hits.push(ScoredWindow { window, score });
                }
            }
        }
    }

    /// Computes the blocks of the image scaled to `width` × `height` pixels, and returns how many there are in a row and
    /// how many rows.
    fn fill(&mut self, image: GreyView<'_>, width: usize, height: usize) -> (usize, usize) {
        let pixels = self.resizer.scale(image, width, height);
        let cells = ((width + 2 * self.padding.0) / CELL, (height + 2 * self.padding.1) / CELL);
        let columns = cells.0 * CELL;
        let grid = (cells.0.saturating_sub(1), cells.1.saturating_sub(1));
        let Ok(scaled) = GreyView::new(pixels, width, height, width) else { return (0, 0) };
        let [upper, lower] = &mut self.sums;
        upper.fill(0.0);
        for row in 0..cells.1 {
            self.cells.read(scaled, row * CELL, columns, self.padding);
            self.cells.add(self.level, upper, lower);
            if row > 0 {
                let out = &mut self.blocks[(row - 1) * grid.0 * BLOCK_STRIDE..];
                blocks(self.level, upper, columns, &self.weights, out);
            }
            std::mem::swap(upper, lower);
        }
        grid
    }

    /// The descriptor of a picture of the window's size, in OpenCV's order.
    ///
    /// # Panics
    /// If the picture has another size, or the scanner's maximum size is smaller.
    pub fn descriptor(&mut self, window: GreyView<'_>) -> Vec<f32> {
        assert_eq!((window.width(), window.height()), self.model.window(), "a picture of the window's size");
        let padding = std::mem::take(&mut self.padding);
        let (across, down) = self.fill(window, window.width(), window.height());
        self.padding = padding;
        let mut out = Vec::with_capacity(across * down * BLOCK);
        for column in 0..across {
            for row in 0..down {
                out.extend_from_slice(&self.blocks[(row * across + column) * BLOCK_STRIDE..][..BLOCK]);
            }
        }
        out
    }
}

#[cfg(test)]
mod tests;
