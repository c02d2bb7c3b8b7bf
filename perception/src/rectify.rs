//! Image remapping by a precomputed table: rectification of camera frames.
//!
//! Input is an 8-bit grey image, output an image of the same size. Each output pixel is the bilinear
//! interpolation of four source pixels at a position rounded to 1/32 px, in integer arithmetic. This is the
//! arithmetic of OpenCV's fixed-point maps (`cv::remap` with `CV_16SC2`), so results are bit-identical.
//!
//! A rectification map is smooth, so eight neighbouring output pixels nearly always lie in a source window of
//! 3 rows × 16 columns. Such a group takes three loads and three byte shuffles instead of 32 loads. Groups that
//! do not fit (image borders, discontinuous maps) are processed pixel by pixel.
//!
//! ```
//! use lookout_perception::image::GreyImage;
//! use lookout_perception::rectify::Remap;
//! use lookout_perception::simd::Level;
//!
//! let source = GreyImage::from_vec((0..64 * 32).map(|i| (i % 64 * 3) as u8).collect(), 64, 32)?;
//! // Output pixel (x, y) shows the source at (x + 0.5, y); positions outside are black.
//! let table = Remap::new(Level::best(), 64, 32, |x, y| Some((x as f64 + 0.5, y as f64)));
//! let mut output = GreyImage::new(64, 32);
//! table.apply(source.view(), output.as_mut_slice())?;
//! assert_eq!(output.view().at(10, 5), 32); // between 30 and 33, rounded
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

use crate::calibration::{Camera, Rectification};
use crate::image::{GreyImage, GreyView};
use crate::simd::{LANES, Lanes, Level, RemapTile, Simd, kernel};
use nalgebra::Vector2;
use thiserror::Error;

/// Sub-pixel steps to which source positions are rounded.
pub const STEPS: i32 = 32;
/// Output pixels that share a source window.
const GROUP: usize = 8;
/// Columns of a source window.
const WINDOW: usize = 16;

/// A group that is processed pixel by pixel.
#[derive(Clone, Copy, Debug)]
struct Single {
    /// Index of the first output pixel.
    at: usize,
    /// Number of pixels.
    count: usize,
    /// Source positions of the pixels.
    positions: [Position; GROUP],
}

/// Upper left source pixel and the fractions in 1/32 px.
#[derive(Clone, Copy, Debug, Default)]
struct Position {
    x: i32,
    y: i32,
    fx: u8,
    fy: u8,
}

/// The size of an image differs from that of the table.
#[derive(Clone, Copy, Debug, Error, PartialEq, Eq)]
#[error("the image has {}x{} pixels, the rectification expects {}x{}", given.0, given.1, expected.0, expected.1)]
pub struct RemapError {
    given: (usize, usize),
    expected: (usize, usize),
}

/// A remapping table for images of one size.
#[derive(Clone, Debug)]
pub struct Remap {
    level: Level,
    width: usize,
    height: usize,
    /// Output rows in tiles of 32 pixels.
    tiles: Vec<RemapTile>,
    singles: Vec<Single>,
}

#[inline(always)]
fn remap_row<S: Simd>(s: S, source: &[u8], stride: usize, tiles: &[RemapTile], out: &mut [u8]) {
    let mut chunks = out.chunks_exact_mut(LANES);
    let mut tiles = tiles.iter();
    let mut lanes = Lanes::ZERO;
    for (chunk, tile) in (&mut chunks).zip(&mut tiles) {
        s.remap(source, stride, tile, &mut lanes);
        chunk.copy_from_slice(&lanes.0);
    }
    let rest = chunks.into_remainder();
    if let Some(tile) = tiles.next() {
        s.remap(source, stride, tile, &mut lanes);
        rest.copy_from_slice(&lanes.0[..rest.len()]);
    }
}

kernel! { fn run_row(source: &[u8], stride: usize, tiles: &[RemapTile], out: &mut [u8]) = remap_row }

impl Remap {
    /// The table for one side (0 left, 1 right) of a rectified pair.
    pub fn rectifying(cameras: &[Camera; 2], rectification: &Rectification, side: usize) -> Self {
        let (width, height) = rectification.size;
        Self::new(Level::best(), width, height, |x, y| {
            rectification.source(cameras, side, Vector2::new(x as f64, y as f64)).map(|p| (p.x, p.y))
        })
    }

    /// The table in which output pixel (x, y) shows the source position `source(x, y)` in pixels; black where
    /// that is `None` or outside the image.
    pub fn new(
        level: Level,
        width: usize,
        height: usize,
        source: impl Fn(usize, usize) -> Option<(f64, f64)>,
    ) -> Self {
        let columns = width.div_ceil(LANES);
        let mut tiles = vec![RemapTile::BLACK; columns * height];
        let mut singles = Vec::new();
        for y in 0..height {
            for first in (0..width).step_by(GROUP) {
                let count = GROUP.min(width - first);
                let mut positions = [Position { x: -10, y: -10, fx: 0, fy: 0 }; GROUP];
                for (k, position) in positions.iter_mut().enumerate().take(count) {
                    let limit = |v: f64| v.is_finite() && v.abs() < 1e6;
                    if let Some((px, py)) = source(first + k, y).filter(|p| limit(p.0) && limit(p.1)) {
                        let (qx, qy) = (
                            (px * f64::from(STEPS)).round_ties_even(),
                            (py * f64::from(STEPS)).round_ties_even(),
                        );
                        let (qx, qy) = (qx as i32, qy as i32);
                        *position = Position {
                            x: qx.div_euclid(STEPS),
                            y: qy.div_euclid(STEPS),
                            fx: qx.rem_euclid(STEPS) as u8,
                            fy: qy.rem_euclid(STEPS) as u8,
                        };
                    }
                }
                let tile = &mut tiles[y * columns + first / LANES];
                if !fit_group(tile, first % LANES, &positions[..count], width, height) {
                    singles.push(Single { at: y * width + first, count, positions });
                }
            }
        }
        Self { level, width, height, tiles, singles }
    }

    /// Width and height of the images, in pixels.
    pub fn size(&self) -> (usize, usize) {
        (self.width, self.height)
    }

    /// Bytes of memory that the table holds.
    pub fn bytes(&self) -> usize {
        std::mem::size_of_val(&self.tiles[..]) + std::mem::size_of_val(&self.singles[..])
    }

    /// Remaps an image into `out`, row by row.
    ///
    /// # Errors
    /// If the image or `out` has another size than the table.
    pub fn apply(&self, source: GreyView<'_>, out: &mut [u8]) -> Result<(), RemapError> {
        let (width, height) = (self.width, self.height);
        let expected = (width, height);
        if (source.width(), source.height()) != expected {
            return Err(RemapError { given: (source.width(), source.height()), expected });
        }
        if out.len() != width * height {
            return Err(RemapError { given: (out.len() / height, height), expected });
        }
        let columns = width.div_ceil(LANES);
        for (tiles, row) in self.tiles.chunks_exact(columns).zip(out.chunks_exact_mut(width)) {
            run_row(self.level, source.bytes(), source.stride(), tiles, row);
        }
        for single in &self.singles {
            for (k, position) in single.positions[..single.count].iter().enumerate() {
                out[single.at + k] = one(&source, position);
            }
        }
        Ok(())
    }

    /// Remaps an image into a new one.
    ///
    /// # Errors
    /// If the image has another size than the table.
    pub fn applied(&self, source: GreyView<'_>) -> Result<GreyImage, RemapError> {
        let mut out = GreyImage::new(self.width, self.height);
        self.apply(source, out.as_mut_slice())?;
        Ok(out)
    }
}

/// One output pixel; source pixels outside the image are black.
fn one(source: &GreyView<'_>, position: &Position) -> u8 {
    let at = |x: i32, y: i32| -> i32 {
        let inside = x >= 0 && y >= 0 && (x as usize) < source.width() && (y as usize) < source.height();
        if inside { i32::from(source.at(x as usize, y as usize)) } else { 0 }
    };
    let (x, y, fx, fy) = (position.x, position.y, i32::from(position.fx), i32::from(position.fy));
    let upper = at(x, y) * (STEPS - fx) + at(x + 1, y) * fx;
    let lower = at(x, y + 1) * (STEPS - fx) + at(x + 1, y + 1) * fx;
    ((upper * (STEPS - fy) + lower * fy + 512) >> 10) as u8
}

/// Stores a group in a tile from pixel `at` on; returns false if it does not fit into one window.
fn fit_group(tile: &mut RemapTile, at: usize, positions: &[Position], width: usize, height: usize) -> bool {
    if width < WINDOW || height < 3 {
        return false;
    }
    let span = |f: fn(&Position) -> i32| {
        let values = positions.iter().map(f);
        (values.clone().min().unwrap_or(0), values.max().unwrap_or(0))
    };
    let ((x0, x1), (y0, y1)) = (span(|p| p.x), span(|p| p.y));
    if x0 < 0 || y0 < 0 || x1 + 1 >= width as i32 || y1 + 1 >= height as i32 {
        return false;
    }
    let (left, top) = ((x0 as usize).min(width - WINDOW), (y0 as usize).min(height - 3));
    if x1 as usize + 1 >= left + WINDOW || y1 as usize > top + 1 {
        return false;
    }
    // A window farther out does not fit into the tile's numbers.
    let (Ok(window_x), Ok(window_y)) = (u16::try_from(left), u16::try_from(top)) else { return false };
    tile.windows[at / GROUP] = [window_x, window_y];
    for (k, p) in positions.iter().enumerate() {
        let column = (p.x as usize - left) as u8;
        tile.pairs[at + k] = [column, column + 1];
        tile.across[at + k] = p.fx;
        // The highest bit selects the second and third row of the window.
        tile.down[at + k] = p.fy | if p.y as usize > top { 0x80 } else { 0 };
    }
    true
}

#[cfg(test)]
mod tests {
    use super::*;

    fn noise(width: usize, height: usize, seed: u64) -> GreyImage {
        let mut random = fastrand::Rng::with_seed(seed);
        GreyImage::from_vec((0..width * height).map(|_| random.u8(..)).collect(), width, height).unwrap()
    }

    /// Maps to be tried: nothing, shifts, turns, enlarging, shrinking, tearing, far outside.
    fn place(kind: usize, x: f64, y: f64) -> Option<(f64, f64)> {
        match kind {
            0 => Some((x, y)),
            1 => Some((x + 0.5, y - 1.25)),
            2 => Some((0.98 * x - 0.17 * y + 3.0, 0.17 * x + 0.98 * y - 5.0)),
            3 => Some((0.4 * x + 7.3, 0.4 * y + 2.1)),
            4 => Some((2.7 * x - 31.0, 2.7 * y - 20.0)),
            5 => (!(x as usize).is_multiple_of(5)).then_some((x + 11.0 * (y % 3.0), y * 1.3 - 4.0)),
            6 => Some((-x, 1e9)),
            _ => Some((f64::NAN, y)),
        }
    }

    #[test]
    fn every_level_equals_the_reference_bit_for_bit() {
        for (width, height) in [(64, 40), (97, 33), (640, 24), (16, 3), (15, 9), (33, 2), (1, 1)] {
            let image = noise(width, height, 3);
            for kind in 0..8 {
                let expected: Vec<u8> = (0..width * height)
                    .map(|i| {
                        let p = place(kind, (i % width) as f64, (i / width) as f64);
                        let Some((px, py)) = p.filter(|p| p.0.abs() < 1e6 && p.1.abs() < 1e6) else {
                            return 0;
                        };
                        let (qx, qy) =
                            ((px * 32.0).round_ties_even() as i32, (py * 32.0).round_ties_even() as i32);
                        let at = |x: i32, y: i32| {
                            let inside = (0..width as i32).contains(&x) && (0..height as i32).contains(&y);
                            if inside { i32::from(image.view().at(x as usize, y as usize)) } else { 0 }
                        };
                        let (x, y, fx, fy) = (qx >> 5, qy >> 5, qx & 31, qy & 31);
                        let sum = at(x, y) * (32 - fx) * (32 - fy)
                            + at(x + 1, y) * fx * (32 - fy)
                            + at(x, y + 1) * (32 - fx) * fy
                            + at(x + 1, y + 1) * fx * fy;
                        ((sum + 512) >> 10) as u8
                    })
                    .collect();
                for level in Level::available() {
                    let map = Remap::new(level, width, height, |x, y| place(kind, x as f64, y as f64));
                    let out = map.applied(image.view()).unwrap();
                    assert!(out.as_slice() == expected, "{width}x{height}, map {kind}, {}", level.name());
                }
            }
        }
    }

    #[test]
    fn windows_beyond_16_bits_are_remapped_too() {
        // Wider, and higher, than a tile's numbers reach.
        for (width, height) in [(66_000, 3), (16, 66_000)] {
            let image = noise(width, height, 5);
            for level in Level::available() {
                let map = Remap::new(level, width, height, |x, y| Some((x as f64, y as f64)));
                assert!(map.applied(image.view()).unwrap() == image, "{width}x{height}, {}", level.name());
            }
        }
    }

    #[test]
    fn padded_rows_work_and_wrong_sizes_are_refused() {
        let wide = noise(100, 40, 4);
        let view = wide.view().crop(20, 5, 64, 30).unwrap();
        let map = Remap::new(Level::best(), 64, 30, |x, y| place(2, x as f64, y as f64));
        let tight =
            GreyImage::from_vec((0..30).flat_map(|y| view.row(y)).copied().collect(), 64, 30).unwrap();
        assert_eq!(map.applied(view).unwrap(), map.applied(tight.view()).unwrap());
        let error = map.applied(wide.view()).unwrap_err();
        assert!(error.to_string().contains("100x40"), "{error}");
        assert!(map.apply(view, &mut [0; 9]).is_err());
    }
}
