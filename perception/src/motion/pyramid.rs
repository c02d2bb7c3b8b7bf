//! Image pyramid: each level halves width and height by the mean of 2 × 2 pixels.
//!
//! Pixel (x, y) of level k is centred at (2^k x + (2^k − 1)/2, …) of the image, which is level 0.

use crate::image::GreyView;

/// Number of levels, with the image itself.
pub const LEVELS: usize = 4;

/// Levels 1 and above of an image; memory is allocated once.
#[derive(Debug)]
pub struct Pyramid {
    levels: Vec<Level>,
}

#[derive(Debug)]
struct Level {
    pixels: Vec<u8>,
    width: usize,
    height: usize,
}

impl Pyramid {
    /// A pyramid for images of `width` × `height` pixels. It has fewer than [`LEVELS`] levels if the image is small.
    pub fn new(width: usize, height: usize) -> Self {
        let level = |k: usize| {
            let (width, height) = (width >> k, height >> k);
            (width >= MIN_SIDE_PX && height >= MIN_SIDE_PX).then(|| Level {
                pixels: vec![0; width * height],
                width,
                height,
            })
        };
        Self { levels: (1..LEVELS).map_while(level).collect() }
    }

    /// Number of levels, with the image itself.
    pub fn count(&self) -> usize {
        self.levels.len() + 1
    }

    /// Computes all levels of an image of the size that the pyramid was made for.
    pub fn build(&mut self, image: GreyView<'_>) {
        for k in 0..self.levels.len() {
            let (below, above) = self.levels.split_at_mut(k);
            let level = &mut above[0];
            match below.last() {
                None => halve(image, level),
                Some(l) => {
                    if let Ok(view) = GreyView::new(&l.pixels, l.width, l.height, l.width) {
                        halve(view, level);
                    }
                }
            }
        }
    }

    /// Level `k` of the image that was built last, which is level 0 itself.
    pub fn level<'a>(&'a self, image: GreyView<'a>, k: usize) -> GreyView<'a> {
        let level = k.checked_sub(1).and_then(|k| self.levels.get(k));
        let view = level.and_then(|l| GreyView::new(&l.pixels, l.width, l.height, l.width).ok());
        view.unwrap_or(image)
    }
}

/// A level has at least this width and height, in px: enough for patches with their surroundings.
const MIN_SIDE_PX: usize = 40;

fn halve(from: GreyView<'_>, to: &mut Level) {
    for (y, row) in to.pixels.chunks_exact_mut(to.width).enumerate() {
        let (upper, lower) = (from.row(2 * y), from.row(2 * y + 1));
        let pairs = upper.chunks_exact(2).zip(lower.chunks_exact(2));
        for (mean, (a, b)) in row.iter_mut().zip(pairs) {
            let sum = u16::from(a[0]) + u16::from(a[1]) + u16::from(b[0]) + u16::from(b[1]);
            *mean = ((sum + 2) / 4) as u8;
        }
    }
}

/// The column or row of level `k` at column or row `px` of the image.
pub fn to_level(px: f32, k: usize) -> f32 {
    let scale = (1 << k) as f32;
    (px - (scale - 1.0) / 2.0) / scale
}

/// The column or row of the image at column or row `px` of level `k`.
pub fn from_level(px: f32, k: usize) -> f32 {
    let scale = (1 << k) as f32;
    px * scale + (scale - 1.0) / 2.0
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn levels_halve_the_image_and_keep_positions() {
        let (width, height) = (176, 97);
        let pixels: Vec<u8> = (0..width * height).map(|i| (i % width) as u8).collect();
        let image = GreyView::new(&pixels, width, height, width).unwrap();
        let mut pyramid = Pyramid::new(width, height);
        // The third halving would leave 12 rows.
        assert_eq!(pyramid.count(), 2);
        pyramid.build(image);
        let half = pyramid.level(image, 1);
        assert_eq!((half.width(), half.height()), (88, 48));
        // Brightness is the column: the mean of columns 20 and 21, rounded up.
        assert_eq!(half.row(7)[10], 21);
        assert_eq!(from_level(10.0, 1), 20.5);
        for k in 0..LEVELS {
            assert!((to_level(from_level(12.25, k), k) - 12.25).abs() < 1e-5);
        }
    }
}
