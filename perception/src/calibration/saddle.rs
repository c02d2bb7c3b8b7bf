//! Detects saddle points of the brightness, where four squares meet, and the two edges that cross there.

use super::plane::Plane;
use nalgebra::Vector2;
use std::f64::consts::PI;

/// Standard deviation of the blur before the search, in pixels.
pub const SIGMA_PX: f32 = 1.4;
/// Radii of the rings on which the sectors are sampled, in pixels.
const RINGS: [f64; 2] = [5.0, 3.2];
/// Samples on half a ring.
const HALF: usize = 20;
/// Minimum of half the difference between bright and dark, in grey levels.
const MIN_CONTRAST: f64 = 3.5;
/// Minimum share of the ring's variation that is point-symmetric.
const MIN_SYMMETRY: f64 = 0.7;

/// A candidate for a corner of a board.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Saddle {
    /// Position in pixels.
    pub position: Vector2<f64>,
    /// Curvature of the blurred brightness, in grey levels per pixel².
    pub strength: f32,
    /// Direction modulo π of the edge from dark to bright with increasing angle (from x to y).
    pub rising: f64,
    /// Direction modulo π of the edge from bright to dark.
    pub falling: f64,
}

/// The angle between two directions modulo π, 0 to π/2.
pub fn between(a: f64, b: f64) -> f64 {
    let d = (a - b).rem_euclid(PI);
    d.min(PI - d)
}

impl Saddle {
    /// Whether `other` can be a neighbouring corner of the same board: its edges have the same directions with
    /// bright and dark exchanged.
    pub fn fits_beside(&self, other: &Saddle, tolerance: f64) -> bool {
        between(self.rising, other.falling) < tolerance && between(self.falling, other.rising) < tolerance
    }
}

/// The directions of the edges around a position, if exactly two edges cross there like those of a board.
fn edges(plane: &Plane, centre: Vector2<f64>, radius: f64) -> Option<(f64, f64)> {
    let mut values = [0.0_f64; 2 * HALF];
    for (i, value) in values.iter_mut().enumerate() {
        let angle = PI * i as f64 / HALF as f64;
        *value = f64::from(plane.sample(centre + radius * Vector2::new(angle.cos(), angle.sin()))?);
    }
    let mean = values.iter().sum::<f64>() / values.len() as f64;
    let (low, high) = values.iter().fold((f64::MAX, f64::MIN), |(l, h), &v| (l.min(v), h.max(v)));
    if high - low < 2.0 * MIN_CONTRAST {
        return None;
    }
    let (mut all, mut both) = (0.0, 0.0);
    // Averaging opposite samples cancels brightness gradients.
    let mut w = [0.0_f64; HALF];
    for i in 0..HALF {
        let (a, b) = (values[i] - mean, values[i + HALF] - mean);
        all += a * a + b * b;
        both += 2.0 * a * b;
        w[i] = 0.5 * (a + b);
    }
    if both < MIN_SYMMETRY * all {
        return None;
    }
    let (mut rising, mut falling) = (None, None);
    for i in 0..HALF {
        let (a, b) = (w[i], w[(i + 1) % HALF]);
        if (a < 0.0) == (b < 0.0) {
            continue;
        }
        let angle = PI * (i as f64 + a / (a - b)) / HALF as f64;
        let edge = if a < 0.0 { &mut rising } else { &mut falling };
        if edge.replace(angle).is_some() {
            return None;
        }
    }
    let (rising, falling) = (rising?, falling?);
    (between(rising, falling) > 0.35).then_some((rising, falling))
}

/// Saddle points of an image that was blurred by [`SIGMA_PX`], the strongest first, at most `max_count`.
pub fn find(blurred: &Plane, max_count: usize) -> Vec<Saddle> {
    let (width, height) = (blurred.width(), blurred.height());
    // A saddle point of minimum contrast under this blur has a mixed derivative of 0.64·contrast/σ².
    let least = (0.3 * MIN_CONTRAST as f32 / (SIGMA_PX * SIGMA_PX)).powi(2);
    let mut response = vec![0.0_f32; width * height];
    for y in 1..height - 1 {
        let (a, b, c) = (blurred.row(y - 1), blurred.row(y), blurred.row(y + 1));
        let out = &mut response[y * width + 1..(y + 1) * width - 1];
        for (i, o) in out.iter_mut().enumerate() {
            let (left, x, right) = (i, i + 1, i + 2);
            let xx = b[left] + b[right] - 2.0 * b[x];
            let yy = a[x] + c[x] - 2.0 * b[x];
            let xy = 0.25 * (a[left] + c[right] - a[right] - c[left]);
            *o = xy * xy - xx * yy;
        }
    }
    const REACH: usize = 2;
    let mut peaks = Vec::new();
    for y in 4..height.saturating_sub(4) {
        for x in 4..width.saturating_sub(4) {
            let value = response[y * width + x];
            if value < least {
                continue;
            }
            let is_peak = (y - REACH..=y + REACH).all(|v| {
                let row = &response[v * width + x - REACH..=v * width + x + REACH];
                row.iter().enumerate().all(|(i, &r)| {
                    // Of equal neighbours the first in scan order counts.
                    let before = v < y || (v == y && i < REACH);
                    r < value || (!before && r <= value)
                })
            });
            if is_peak {
                peaks.push((value, x, y));
            }
        }
    }
    peaks.sort_unstable_by(|a, b| b.0.total_cmp(&a.0));
    peaks.truncate(max_count);
    let mut found = Vec::new();
    for (value, x, y) in peaks {
        let Some(position) = stationary(blurred, x, y) else { continue };
        let Some((rising, falling)) = RINGS.iter().find_map(|&r| edges(blurred, position, r)) else {
            continue;
        };
        found.push(Saddle { position, strength: value.sqrt(), rising, falling });
    }
    found
}

/// The stationary point of the brightness around a pixel by second-order expansion; `None` if it is more than 1.5
/// pixels away.
fn stationary(plane: &Plane, x: usize, y: usize) -> Option<Vector2<f64>> {
    let v = |dx: usize, dy: usize| f64::from(plane.at(x + dx - 1, y + dy - 1));
    let (gx, gy) = (0.5 * (v(2, 1) - v(0, 1)), 0.5 * (v(1, 2) - v(1, 0)));
    let (xx, yy) = (v(0, 1) + v(2, 1) - 2.0 * v(1, 1), v(1, 0) + v(1, 2) - 2.0 * v(1, 1));
    let xy = 0.25 * (v(0, 0) + v(2, 2) - v(2, 0) - v(0, 2));
    let determinant = xx * yy - xy * xy;
    if determinant >= 0.0 {
        return None;
    }
    let step = Vector2::new(xy * gy - yy * gx, xy * gx - xx * gy) / determinant;
    (step.norm() < 1.5).then(|| Vector2::new(x as f64, y as f64) + step)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::GreyImage;

    /// Four sectors around (20.3, 16.8), edges at the given angles, on a brightness gradient.
    fn cross(first: f64, second: f64) -> Plane {
        let mut image = GreyImage::new(41, 33);
        for y in 0..33 {
            for x in 0..41 {
                // Antialiasing: mean of 5 × 5 points of the pixel.
                let mut bright = 0;
                for s in 0..25 {
                    let (dx, dy) = (f64::from(s % 5) * 0.2 - 0.4, f64::from(s / 5) * 0.2 - 0.4);
                    let (px, py) = (x as f64 + dx - 20.3, y as f64 + dy - 16.8);
                    let side = |a: f64| px * a.sin() - py * a.cos() > 0.0;
                    bright += u32::from(side(first) == side(second));
                }
                image.as_mut_slice()[y * 41 + x] = (30 + bright * 3 + x as u32) as u8;
            }
        }
        Plane::from_view(image.view()).blurred(SIGMA_PX)
    }

    #[test]
    fn a_crossing_is_found_with_its_edges() {
        for (first, second) in [(0.1, 1.6), (0.8, 2.2), (0.5, 1.5)] {
            let found = find(&cross(first, second), 10);
            assert_eq!(found.len(), 1, "{found:?}");
            let saddle = found[0];
            assert!((saddle.position - Vector2::new(20.3, 16.8)).norm() < 0.25, "{saddle:?}");
            let matches =
                |a: f64, b: f64| between(saddle.rising, a) < 0.2 && between(saddle.falling, b) < 0.2;
            assert!(matches(first, second) != matches(second, first), "{saddle:?}");
            let other = find(&cross(second, first), 10)[0];
            // Exchanging the edges has no effect; exchanging bright and dark does.
            assert!(!saddle.fits_beside(&other, 0.3));
            let negative = Saddle { rising: saddle.falling, falling: saddle.rising, ..saddle };
            assert!(saddle.fits_beside(&negative, 0.1));
        }
    }

    #[test]
    fn flat_and_striped_images_have_none() {
        let mut image = GreyImage::new(64, 64);
        assert!(find(&Plane::from_view(image.view()).blurred(SIGMA_PX), 10).is_empty());
        for (i, v) in image.as_mut_slice().iter_mut().enumerate() {
            *v = if (i % 64) / 8 % 2 == 0 { 20 } else { 220 };
        }
        assert!(find(&Plane::from_view(image.view()).blurred(SIGMA_PX), 10).is_empty());
    }
}
