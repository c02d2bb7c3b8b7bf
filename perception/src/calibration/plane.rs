//! Grey images in floating point: downsampling, upsampling and Gaussian blur.

use crate::image::GreyView;
use nalgebra::Vector2;

/// A grey image with one `f32` per pixel, row by row.
#[derive(Clone, Debug)]
pub struct Plane {
    data: Vec<f32>,
    width: usize,
    height: usize,
}

impl Plane {
    /// Converts an 8-bit image.
    pub fn from_view(view: GreyView<'_>) -> Self {
        let (width, height) = (view.width(), view.height());
        let data = (0..height).flat_map(|y| view.row(y)).map(|&v| f32::from(v)).collect();
        Self { data, width, height }
    }

    /// Width in pixels.
    pub fn width(&self) -> usize {
        self.width
    }

    /// Height in pixels.
    pub fn height(&self) -> usize {
        self.height
    }

    /// Row `y`.
    pub fn row(&self, y: usize) -> &[f32] {
        &self.data[y * self.width..(y + 1) * self.width]
    }

    /// The value of a pixel.
    pub fn at(&self, x: usize, y: usize) -> f32 {
        self.data[y * self.width + x]
    }

    /// Bilinear interpolation at a sub-pixel position; `None` outside.
    pub fn sample(&self, p: Vector2<f64>) -> Option<f32> {
        if !(p.x >= 0.0 && p.y >= 0.0 && p.x < (self.width - 1) as f64 && p.y < (self.height - 1) as f64) {
            return None;
        }
        let (x, y) = (p.x as usize, p.y as usize);
        let (fx, fy) = ((p.x - x as f64) as f32, (p.y - y as f64) as f32);
        let i = y * self.width + x;
        let (upper, lower) = (&self.data[i..i + 2], &self.data[i + self.width..i + self.width + 2]);
        let (a, b) = (upper[0] + fx * (upper[1] - upper[0]), lower[0] + fx * (lower[1] - lower[0]));
        Some(a + fy * (b - a))
    }

    /// Half the size: means of 2 × 2 pixels. `None` if a side would have less than 16 pixels.
    pub fn halved(&self) -> Option<Self> {
        let (width, height) = (self.width / 2, self.height / 2);
        if width.min(height) < 16 {
            return None;
        }
        let mut data = Vec::with_capacity(width * height);
        for y in 0..height {
            let (a, b) = (self.row(2 * y), self.row(2 * y + 1));
            data.extend(
                a.chunks_exact(2).zip(b.chunks_exact(2)).map(|(a, b)| 0.25 * (a[0] + a[1] + b[0] + b[1])),
            );
        }
        Some(Self { data, width, height })
    }

    /// Twice the size, by bilinear interpolation.
    pub fn doubled(&self) -> Self {
        let (width, height) = (2 * self.width, 2 * self.height);
        let mut data = Vec::with_capacity(width * height);
        for y in 0..height {
            // Pixel centres: two new pixels cover one old pixel.
            let near = y / 2;
            let far = if y % 2 == 0 { near.saturating_sub(1) } else { (near + 1).min(self.height - 1) };
            let (a, b) = (self.row(near), self.row(far));
            let mix = |x: usize| 0.75 * a[x] + 0.25 * b[x];
            for x in 0..width {
                let near = x / 2;
                let far = if x % 2 == 0 { near.saturating_sub(1) } else { (near + 1).min(self.width - 1) };
                data.push(0.75 * mix(near) + 0.25 * mix(far));
            }
        }
        Self { data, width, height }
    }

    /// Gaussian blur with standard deviation `sigma_px`; borders are replicated.
    pub fn blurred(&self, sigma_px: f32) -> Self {
        let radius = (2.8 * sigma_px).ceil().max(1.0) as usize;
        let mut kernel: Vec<f32> =
            (0..=radius).map(|i| (-0.5 * (i as f32 / sigma_px).powi(2)).exp()).collect();
        let sum = kernel[0] + 2.0 * kernel[1..].iter().sum::<f32>();
        kernel.iter_mut().for_each(|k| *k /= sum);
        let (width, height) = (self.width, self.height);
        let mut data = vec![0.0; width * height];
        let mut padded = vec![0.0; width + 2 * radius];
        for y in 0..height {
            // Vertically, into a padded row, then horizontally.
            let middle = &mut padded[radius..radius + width];
            for (m, v) in middle.iter_mut().zip(self.row(y)) {
                *m = kernel[0] * v;
            }
            for (i, k) in kernel.iter().enumerate().skip(1) {
                let (above, below) = (self.row(y.saturating_sub(i)), self.row((y + i).min(height - 1)));
                for ((m, a), b) in middle.iter_mut().zip(above).zip(below) {
                    *m += k * (a + b);
                }
            }
            let (first, last) = (padded[radius], padded[radius + width - 1]);
            padded[..radius].fill(first);
            padded[radius + width..].fill(last);
            let out = &mut data[y * width..(y + 1) * width];
            for (o, v) in out.iter_mut().zip(&padded[radius..]) {
                *o = kernel[0] * v;
            }
            for (i, k) in kernel.iter().enumerate().skip(1) {
                for ((o, a), b) in out.iter_mut().zip(&padded[radius - i..]).zip(&padded[radius + i..]) {
                    *o += k * (a + b);
                }
            }
        }
        Self { data, width, height }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ramp(width: usize, height: usize) -> Plane {
        let data = (0..width * height).map(|i| (i % width) as f32 + 2.0 * (i / width) as f32).collect();
        Plane { data, width, height }
    }

    #[test]
    fn scaling_keeps_a_slope_where_it_is() {
        let plane = ramp(40, 34);
        let at = |plane: &Plane, x, y| plane.sample(Vector2::new(x, y)).unwrap();
        assert!((at(&plane, 10.25, 7.5) - 25.25).abs() < 1e-4);
        // Pixel x of half the size covers 2x and 2x + 1.
        let half = plane.halved().unwrap();
        assert!((at(&half, 5.0, 4.0) - at(&plane, 10.5, 8.5)).abs() < 1e-4);
        let double = plane.doubled();
        assert!((at(&double, 20.5, 16.5) - at(&plane, 10.0, 8.0)).abs() < 1e-4);
        assert!((at(&plane.blurred(1.5), 20.0, 16.0) - 52.0).abs() < 1e-3);
        assert_eq!(plane.sample(Vector2::new(39.0, 3.0)), None);
        assert!(ramp(31, 40).halved().is_none());
    }
}
