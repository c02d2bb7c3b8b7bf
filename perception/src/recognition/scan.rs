//! Sliding-window detection over several scales, like OpenCV's detector: the same windows, the same steps, the
//! same hits.

use super::cascade::{Cascade, Features};
use super::integral::{Layout, Plane, TiltedRows};
use super::program::{self, Grid, HaarPlanes, HaarTest, LbpTest, Program};
use super::resize::Resizer;
use crate::image::GreyView;
use crate::simd::{LANES, Level};

/// A window that passed all stages, in pixels of the scanned image.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Window {
    /// Left column.
    pub x: i32,
    /// Top row.
    pub y: i32,
    /// Width.
    pub width: i32,
    /// Height.
    pub height: i32,
}

/// Which window sizes are scanned.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Sizes {
    /// The cascade's own size times powers of `growth`, as far as it lies in the range; the size closest to
    /// `min_px` if none does. This is OpenCV's rule.
    Range {
        /// Minimum width and height of a window, in pixels; 0 for no limit.
        min_px: u32,
        /// Maximum width and height, in pixels; 0 for no limit.
        max_px: u32,
        /// Ratio of consecutive sizes, greater than 1.
        growth: f64,
    },
    /// Two sizes around an expected size: smaller and larger by √`growth`.
    Around {
        /// Expected width of the window, in pixels.
        width_px: f64,
        /// Ratio of the two sizes, greater than 1.
        growth: f64,
    },
}

/// Smallest window of the paper, in pixels.
pub const DEFAULT_MIN_PX: u32 = 30;
/// Largest window of the paper, in pixels.
pub const DEFAULT_MAX_PX: u32 = 90;
/// Factor from one window size to the next of the paper.
pub const DEFAULT_GROWTH: f64 = 1.3;

impl Default for Sizes {
    /// The paper's sizes: 30 to 90 px, ratio 1.3.
    fn default() -> Self {
        Self::Range { min_px: DEFAULT_MIN_PX, max_px: DEFAULT_MAX_PX, growth: DEFAULT_GROWTH }
    }
}

/// Minimum ratio of consecutive sizes; smaller values are raised to it.
pub const MIN_GROWTH: f64 = 1.01;

/// Minimum scale of an expected window relative to the cascade's; below 1 the image is enlarged.
pub(super) const MIN_SCALE: f64 = 0.6;

/// The cascade in its layouts for window steps of one and two columns, with its integral images.
#[derive(Debug)]
enum Engine {
    /// LBP cascades whose block sums fit into 16 bits.
    Narrow { programs: [Program<LbpTest<u16>>; 2], sums: Plane<u16> },
    /// All other LBP cascades.
    Wide { programs: [Program<LbpTest<u32>>; 2], sums: Plane<u32> },
    /// Haar cascades.
    Haar {
        programs: [Program<HaarTest>; 2],
        sums: Plane<u32>,
        squares: Plane<u32>,
        /// Present if a feature is tilted.
        tilted: Option<(Plane<u32>, TiltedRows)>,
    },
}

/// Scans images up to a maximum size, with memory allocated once.
#[derive(Debug)]
pub struct Scanner {
    level: Level,
    /// Width and height of the cascade's window.
    window: (i32, i32),
    /// Maximum width and height of an image.
    limit: (usize, usize),
    layouts: [Layout; 2],
    engine: Engine,
    resizer: Resizer,
    scales: Vec<f32>,
    places: Vec<(u32, u32)>,
    hits: Vec<Window>,
    max_hits: usize,
}

/// Rounds like OpenCV: half to even.
fn round(value: f64) -> i32 {
    value.round_ties_even() as i32
}

/// A length times a scale in single precision, as OpenCV computes it.
fn scaled(length: i32, scale: f32) -> i32 {
    round(f64::from(length as f32 * scale))
}

impl Scanner {
    /// A scanner for images of up to `width` × `height` pixels that stops after `max_hits` hits; with
    /// `usize::MAX` it finds all hits, and its memory grows as needed.
    pub fn new(cascade: &Cascade, width: usize, height: usize, max_hits: usize) -> Self {
        Self::at_level(cascade, width, height, max_hits, Level::best())
    }

    /// As [`Self::new`], on a given instruction-set level.
    pub fn at_level(cascade: &Cascade, width: usize, height: usize, max_hits: usize, level: Level) -> Self {
        let layouts = [Layout::new(width, 1), Layout::new(width, 2)];
        let plane = || Plane::<u32>::new(width, height, LANES);
        let engine = match &cascade.features {
            Features::Lbp(features) => {
                let narrow =
                    features.iter().all(|f| u32::from(f.width) * u32::from(f.height) * 255 < 1 << 16);
                if narrow {
                    Engine::Narrow {
                        programs: layouts.map(|layout| Program::lbp(cascade, features, layout)),
                        sums: Plane::new(width, height, LANES),
                    }
                } else {
                    let programs = layouts.map(|layout| Program::lbp(cascade, features, layout));
                    Engine::Wide { programs, sums: plane() }
                }
            }
            Features::Haar(features) => Engine::Haar {
                programs: layouts.map(|layout| Program::haar(cascade, features, layout)),
                sums: plane(),
                squares: plane(),
                tilted: program::has_tilted(cascade).then(|| (plane(), TiltedRows::new(width))),
            },
        };
        let reserve = if max_hits == usize::MAX { 0 } else { max_hits };
        Self {
            level,
            window: (cascade.width.into(), cascade.height.into()),
            limit: (width, height),
            layouts,
            engine,
            resizer: Resizer::new(width, height),
            scales: Vec::with_capacity(1024),
            places: Vec::with_capacity(reserve),
            hits: Vec::with_capacity(reserve),
            max_hits,
        }
    }

    /// Computes the scale factors of the window.
    fn choose_scales(&mut self, sizes: Sizes, width: i32, height: i32) {
        self.scales.clear();
        let (window_width, window_height) = self.window;
        match sizes {
            Sizes::Range { min_px, max_px, growth } => {
                let side = |px: u32| i32::try_from(px).unwrap_or(i32::MAX);
                let least = side(min_px);
                let greatest = if max_px == 0 { (width, height) } else { (side(max_px), side(max_px)) };
                let mut nearest: Option<(i64, f32)> = None;
                let mut factor = 1.0_f64;
                while round(f64::from(window_width) * factor) <= width
                    && round(f64::from(window_height) * factor) <= height
                    && self.scales.len() < self.scales.capacity()
                {
                    let scale = factor as f32;
                    let (w, h) = (scaled(window_width, scale), scaled(window_height, scale));
                    if w >= least && h >= least && w <= greatest.0 && h <= greatest.1 {
                        self.scales.push(scale);
                    }
                    let away = i64::from(w - least).pow(2) + i64::from(h - least).pow(2);
                    if nearest.is_none_or(|(d, _)| away < d) {
                        nearest = Some((away, scale));
                    }
                    factor *= growth.max(MIN_GROWTH);
                }
                if self.scales.is_empty() {
                    self.scales.extend(nearest.map(|(_, scale)| scale));
                }
            }
            Sizes::Around { width_px, growth } => {
                let half = growth.max(MIN_GROWTH).sqrt();
                let expected = width_px / f64::from(window_width);
                // Windows must fit into the image, and scaled images into the memory.
                let greatest = (f64::from(width) / f64::from(window_width))
                    .min(f64::from(height) / f64::from(window_height));
                let least = MIN_SCALE
                    .max(f64::from(width) / (self.limit.0 as f64 + 0.4))
                    .max(f64::from(height) / (self.limit.1 as f64 + 0.4));
                for scale in [expected / half, expected * half] {
                    let scale = scale.min(greatest).max(least) as f32;
                    if f64::from(scale) <= greatest * 1.000_001 && !self.scales.contains(&scale) {
                        self.scales.push(scale);
                    }
                }
            }
        }
    }

    /// All windows of `image` that pass every stage, smallest windows first.
    ///
    /// # Panics
    /// If the image is larger than the scanner's maximum size.
    pub fn scan(&mut self, image: GreyView<'_>, sizes: Sizes) -> &[Window] {
        self.hits.clear();
        self.choose_scales(sizes, image.width() as i32, image.height() as i32);
        // OpenCV splits the rows of every scale into stripes, as many as the first scale has columns / 32.
        let stripes = match (sizes, self.scales.first()) {
            (Sizes::Range { .. }, Some(&first)) => {
                let width = round((image.width() as f32 / first).into());
                Some(usize::try_from(width - self.window.0 + 1).unwrap_or(0).div_ceil(32))
            }
            _ => None,
        };
        for i in 0..self.scales.len() {
            self.scan_scale(image, self.scales[i], stripes);
        }
        &self.hits
    }

    /// Whether an image of the size of the cascade's window passes every stage.
    ///
    /// # Panics
    /// If the image is larger than the scanner's maximum size.
    pub fn passes(&mut self, window: GreyView<'_>) -> bool {
        self.hits.clear();
        self.scan_scale(window, 1.0, None);
        !self.hits.is_empty()
    }

    /// Scans one scale. Stripes consist of whole steps; OpenCV skips the rest of less than a step that rounding
    /// leaves, and so does this function.
    fn scan_scale(&mut self, image: GreyView<'_>, scale: f32, stripes: Option<usize>) {
        let width = round((image.width() as f32 / scale).into());
        let height = round((image.height() as f32 / scale).into());
        if width < self.window.0 || height < self.window.1 {
            return;
        }
        // Around an expected size a step of two pixels is always fine enough.
        let step = if scale >= 2.0 && stripes.is_some() { 1 } else { 2 };
        let layout = self.layouts[step - 1];
        let pixels = self.resizer.scale(image, width as usize, height as usize);
        let rows = (height - self.window.1) as usize + 1;
        let covered = stripes.map_or(rows, |n| (rows / step).div_ceil(n.max(1)).max(1) * n);
        let grid = Grid {
            columns: ((width - self.window.0) as usize / step) + 1,
            rows: rows.div_ceil(step).min(covered),
            down: layout.index(0, step),
            skip: true,
            max_hits: self.max_hits - self.hits.len().min(self.max_hits),
        };
        let (level, width, places) = (self.level, width as usize, &mut self.places);
        places.clear();
        match &mut self.engine {
            Engine::Narrow { programs, sums } => {
                sums.fill(layout, pixels, width, u32::from);
                program::scan_narrow(level, &programs[step - 1], sums.entries(), &grid, places);
            }
            Engine::Wide { programs, sums } => {
                sums.fill(layout, pixels, width, u32::from);
                program::scan_wide(level, &programs[step - 1], sums.entries(), &grid, places);
            }
            Engine::Haar { programs, sums, squares, tilted } => {
                sums.fill(layout, pixels, width, u32::from);
                squares.fill(layout, pixels, width, |v| u32::from(v) * u32::from(v));
                if let Some((plane, rows)) = tilted {
                    plane.fill_tilted(layout, pixels, width, rows);
                }
                let (w, h) = (self.window.0 as u16, self.window.1 as u16);
                let planes = HaarPlanes {
                    sums: sums.entries(),
                    squares: squares.entries(),
                    tilted: tilted.as_ref().map_or(&[], |(plane, _)| plane.entries()),
                    inner: program::inner_corners(w, h, layout),
                    area: (f64::from(w) - 2.0) * (f64::from(h) - 2.0),
                };
                program::scan_haar(level, &programs[step - 1], planes, &grid, places);
            }
        }
        let size = (scaled(self.window.0, scale), scaled(self.window.1, scale));
        self.hits.extend(places.iter().map(|&(column, row)| Window {
            x: scaled(column as i32 * step as i32, scale),
            y: scaled(row as i32 * step as i32, scale),
            width: size.0,
            height: size.1,
        }));
    }
}

#[cfg(test)]
mod tests;
