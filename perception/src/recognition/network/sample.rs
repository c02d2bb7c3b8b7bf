//! A rectangle of an image, resized to the input of a network: bilinear, and averaged where it is reduced (a triangle filter
//! as wide as the step from one pixel of the input to the next). Beyond the image its outermost pixels go on.

use crate::image::GreyView;

/// A rectangle in pixels of an image; it may reach beyond the image.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rectangle {
    /// Left end.
    pub x: f32,
    /// Upper end.
    pub y: f32,
    /// Width, above 0.
    pub width: f32,
    /// Height, above 0.
    pub height: f32,
}

impl Rectangle {
    /// The rectangle with a margin on each side, as a share of that side.
    #[must_use]
    pub fn grown(self, share: f32) -> Self {
        let (x, y) = (share * self.width, share * self.height);
        Self { x: self.x - x, y: self.y - y, width: self.width + 2.0 * x, height: self.height + 2.0 * y }
    }
}

/// First pixel and weights of a pixel of the input, along one axis.
fn taps(from: f32, step: f32, at: usize, limit: usize, weights: &mut Vec<(usize, f32)>) {
    weights.clear();
    let centre = from + (at as f32 + 0.5) * step - 0.5;
    let reach = step.max(1.0);
    let (first, last) = ((centre - reach).ceil() as i64, (centre + reach).floor() as i64);
    let mut sum = 0.0;
    for pixel in first..=last {
        let weight = 1.0 - (pixel as f32 - centre).abs() / reach;
        if weight > 0.0 {
            weights.push((pixel.clamp(0, limit as i64 - 1) as usize, weight));
            sum += weight;
        }
    }
    weights.iter_mut().for_each(|(_, weight)| *weight /= sum);
}

/// Resizes rectangles; memory is allocated once.
#[derive(Clone, Debug, Default)]
pub struct Sampler {
    weights: Vec<(usize, f32)>,
    /// A row of the rectangle's columns, summed over the rows of a row of the input.
    row: Vec<f32>,
}

/// Largest width of an image; the weights of a pixel of the input are at most twice as many.
const MAX_WIDTH: usize = 8192;

impl Sampler {
    /// A sampler for images of up to `width` × `height` pixels.
    pub fn new(width: usize, height: usize) -> Self {
        let longest = width.max(height).min(MAX_WIDTH);
        Self { weights: Vec::with_capacity(2 * longest + 4), row: Vec::with_capacity(width) }
    }

    /// Fills `out`, which has `size` (width, height), with grey levels from 0 to 255 of a rectangle. One that is much larger
    /// than any image is cut: it cannot be meant.
    pub fn sample(&mut self, image: GreyView<'_>, from: Rectangle, size: (usize, usize), out: &mut [f32]) {
        let side = |px: f32| px.clamp(f32::MIN_POSITIVE, 2.0 * MAX_WIDTH as f32);
        let step = (side(from.width) / size.0 as f32, side(from.height) / size.1 as f32);
        for (y, out) in out.chunks_exact_mut(size.0).take(size.1).enumerate() {
            taps(from.y, step.1, y, image.height(), &mut self.weights);
            self.row.clear();
            self.row.resize(image.width(), 0.0);
            for &(row, weight) in &self.weights {
                for (sum, &value) in self.row.iter_mut().zip(image.row(row)) {
                    *sum += weight * f32::from(value);
                }
            }
            for (x, out) in out.iter_mut().enumerate() {
                taps(from.x, step.0, x, image.width(), &mut self.weights);
                *out = self.weights.iter().map(|&(column, weight)| weight * self.row[column]).sum();
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::GreyImage;

    fn ramp(width: usize, height: usize) -> GreyImage {
        let pixels = (0..width * height).map(|i| (2 * (i % width) + 3 * (i / width)) as u8).collect();
        GreyImage::from_vec(pixels, width, height).unwrap()
    }

    #[test]
    fn a_plane_stays_a_plane_at_any_scale() {
        let image = ramp(40, 30);
        for (width, height) in [(4, 4), (16, 8), (32, 32)] {
            let from = Rectangle { x: 8.0, y: 6.0, width: 24.0, height: 16.0 };
            let mut out = vec![0.0; width * height];
            Sampler::new(40, 30).sample(image.view(), from, (width, height), &mut out);
            for (i, value) in out.iter().enumerate() {
                let at = |from: f32, side: f32, i: usize, n: usize| {
                    from + (i as f32 + 0.5) * side / n as f32 - 0.5
                };
                let (x, y) = (at(8.0, 24.0, i % width, width), at(6.0, 16.0, i / width, height));
                // The weights of a triangle at a broken step are not quite symmetric.
                assert!((value - (2.0 * x + 3.0 * y)).abs() < 0.1, "{width} × {height}, {i}: {value}");
            }
        }
    }

    #[test]
    fn the_outermost_pixels_go_on_beyond_the_image() {
        let image = ramp(8, 8);
        let mut out = vec![0.0; 16];
        let mut sampler = Sampler::new(8, 8);
        sampler.sample(
            image.view(),
            Rectangle { x: -50.0, y: 0.0, width: 40.0, height: 0.5 },
            (4, 4),
            &mut out,
        );
        assert!(out.iter().all(|v| v.abs() < 1.0), "{out:?}");
        sampler.sample(
            image.view(),
            Rectangle { x: 100.0, y: 100.0, width: 4.0, height: 4.0 },
            (4, 4),
            &mut out,
        );
        assert!(out.iter().all(|v| (v - 35.0).abs() < 1e-4), "{out:?}");
        // Numbers that another process may have written are no end of the stage.
        for (x, width) in [(4e9, 4e9), (-4e9, 1.0), (0.0, 0.0), (f32::NAN, f32::NAN), (0.0, f32::INFINITY)] {
            sampler.sample(image.view(), Rectangle { x, y: x, width, height: width }, (4, 4), &mut out);
            assert!(out.iter().all(|v| (0.0..=35.1).contains(v)), "{x} {width}: {out:?}");
        }
        let whole = Rectangle { x: 2.0, y: 2.0, width: 4.0, height: 2.0 }.grown(0.5);
        assert_eq!(whole, Rectangle { x: 0.0, y: 1.0, width: 8.0, height: 4.0 });
    }
}
