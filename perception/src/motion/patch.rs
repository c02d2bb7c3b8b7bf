//! Patches of an image, and their alignment to another image: Lucas and Kanade in the inverse compositional form of Baker
//! and Matthews, with translation and a brightness offset; the change of scale is known.

use crate::image::GreyView;
use crate::simd::{Simd, kernel};

/// Width and height of the window that is aligned, in px.
pub const WINDOW: usize = 16;
/// Width and height of the stored patch: with a border for gradients and for a smaller scale.
pub const STORED: usize = WINDOW + 4;
/// Width and height of the window with a border for gradients.
const BORDERED: usize = WINDOW + 2;
const PIXELS: f32 = (WINDOW * WINDOW) as f32;

/// Range of the change of scale that a stored patch can be resampled by.
pub const SCALES: std::ops::RangeInclusive<f32> = 0.95..=1.6;

/// Largest number of iterations, and the step in px at which they end.
const MAX_ITERATIONS: usize = 8;
const FINAL_STEP_PX: f32 = 0.015;

/// Smallest eigenvalue of the normal equations per pixel, in squared grey levels per px.
const MIN_EIGENVALUE: f32 = 2.0;

/// Squares of pixels around a point of an image.
#[derive(Clone, Debug)]
pub struct Patch {
    pixels: [[u8; STORED]; STORED],
    /// The point in the patch, in px: 9 to 10.
    centre: [f32; 2],
}

impl Default for Patch {
    fn default() -> Self {
        Self { pixels: [[0; STORED]; STORED], centre: [0.0; 2] }
    }
}

impl Patch {
    /// Stores the surroundings of (`x`, `y`); `false`, and no change, if they are not all in the image.
    pub fn store(&mut self, image: GreyView<'_>, x: f32, y: f32) -> bool {
        let half = (STORED / 2 - 1) as f32;
        let (left, top) = ((x - half).floor(), (y - half).floor());
        let fits = |start: f32, side: usize| start >= 0.0 && start + STORED as f32 <= side as f32;
        if !fits(left, image.width()) || !fits(top, image.height()) {
            return false;
        }
        for (k, row) in self.pixels.iter_mut().enumerate() {
            let from = &image.row(top as usize + k)[left as usize..];
            row.copy_from_slice(&from[..STORED]);
        }
        self.centre = [x - left, y - top];
        true
    }
}

/// Place of a patch in another image.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Alignment {
    /// Column of the point, in px.
    pub x: f32,
    /// Row of the point, in px.
    pub y: f32,
    /// Mean squared difference, in squared grey levels.
    pub residual: f32,
    /// Variance of the patch, in squared grey levels.
    pub variance: f32,
    /// Whether a place was found.
    pub found: bool,
}

kernel! {
    /// Aligns `patch`, enlarged by `scale`, to `image`, beginning at the place in `out`, which becomes the result.
    pub fn align(patch: &Patch, scale: f32, image: GreyView<'_>, out: &mut Alignment) = align_with
}

type Rows = [[f32; WINDOW]; WINDOW];

#[inline(always)]
fn align_with<S: Simd>(_: S, patch: &Patch, scale: f32, image: GreyView<'_>, out: &mut Alignment) {
    out.found = false;
    let template = resample(patch, scale);
    let mut values: Rows = [[0.0; WINDOW]; WINDOW];
    let mut dx = values;
    let mut dy = values;
    for r in 0..WINDOW {
        for c in 0..WINDOW {
            values[r][c] = template[r + 1][c + 1];
            dx[r][c] = 0.5 * (template[r + 1][c + 2] - template[r + 1][c]);
            dy[r][c] = 0.5 * (template[r + 2][c + 1] - template[r][c + 1]);
        }
    }
    let mean = sum(|r, c| values[r][c]) / PIXELS;
    let (mean_dx, mean_dy) = (sum(|r, c| dx[r][c]) / PIXELS, sum(|r, c| dy[r][c]) / PIXELS);
    // Without their means, the brightness offset drops out of the normal equations.
    for r in 0..WINDOW {
        for c in 0..WINDOW {
            values[r][c] -= mean;
            dx[r][c] -= mean_dx;
            dy[r][c] -= mean_dy;
        }
    }
    let xx = sum(|r, c| dx[r][c] * dx[r][c]);
    let xy = sum(|r, c| dx[r][c] * dy[r][c]);
    let yy = sum(|r, c| dy[r][c] * dy[r][c]);
    let variance = sum(|r, c| values[r][c] * values[r][c]) / PIXELS;
    let determinant = xx * yy - xy * xy;
    let smaller = 0.5 * (xx + yy) - (0.25 * (xx - yy) * (xx - yy) + xy * xy).sqrt();
    if smaller.is_nan() || smaller < MIN_EIGENVALUE * PIXELS {
        return;
    }
    let corner = (WINDOW as f32 - 1.0) / 2.0;
    let (mut x, mut y) = (out.x - corner, out.y - corner);
    let mut sampled: Rows = [[0.0; WINDOW]; WINDOW];
    for _ in 0..MAX_ITERATIONS {
        if !sample(image, x, y, &mut sampled) {
            return;
        }
        let offset = sum(|r, c| sampled[r][c]) / PIXELS;
        let bx = sum(|r, c| dx[r][c] * (sampled[r][c] - offset - values[r][c]));
        let by = sum(|r, c| dy[r][c] * (sampled[r][c] - offset - values[r][c]));
        let step_x = (yy * bx - xy * by) / determinant;
        let step_y = (xx * by - xy * bx) / determinant;
        x -= step_x;
        y -= step_y;
        if step_x * step_x + step_y * step_y < FINAL_STEP_PX * FINAL_STEP_PX {
            let residual = sum(|r, c| {
                let difference = sampled[r][c] - offset - values[r][c];
                difference * difference
            }) / PIXELS;
            *out = Alignment { x: x + corner, y: y + corner, residual, variance, found: true };
            return;
        }
    }
}

/// Sum over the window: lanes first, in an order that does not depend on the instruction set.
#[inline(always)]
fn sum(value: impl Fn(usize, usize) -> f32) -> f32 {
    let mut lanes = [0.0_f32; WINDOW];
    for r in 0..WINDOW {
        for (c, lane) in lanes.iter_mut().enumerate() {
            *lane += value(r, c);
        }
    }
    let mut width = WINDOW / 2;
    while width > 0 {
        for c in 0..width {
            lanes[c] += lanes[c + width];
        }
        width /= 2;
    }
    lanes[0]
}

/// The patch at another scale, bilinear.
#[inline(always)]
fn resample(patch: &Patch, scale: f32) -> [[f32; BORDERED]; BORDERED] {
    let scale = scale.clamp(*SCALES.start(), *SCALES.end());
    let place = |centre: f32, k: usize| {
        let at =
            (centre + (k as f32 - (BORDERED as f32 - 1.0) / 2.0) / scale).clamp(0.0, STORED as f32 - 1.001);
        (at as usize, at - at.floor())
    };
    let mut wide = [[0.0_f32; BORDERED]; STORED];
    let columns: [(usize, f32); BORDERED] = std::array::from_fn(|c| place(patch.centre[0], c));
    for (row, from) in wide.iter_mut().zip(&patch.pixels) {
        for (value, &(at, share)) in row.iter_mut().zip(&columns) {
            let at = at.min(STORED - 2);
            let (a, b) = (f32::from(from[at]), f32::from(from[at + 1]));
            *value = a + share * (b - a);
        }
    }
    let mut out = [[0.0_f32; BORDERED]; BORDERED];
    for (r, row) in out.iter_mut().enumerate() {
        let (at, share) = place(patch.centre[1], r);
        let at = at.min(STORED - 2);
        for (c, value) in row.iter_mut().enumerate() {
            *value = wide[at][c] + share * (wide[at + 1][c] - wide[at][c]);
        }
    }
    out
}

/// Samples the window whose first pixel is at (`x`, `y`), bilinear; `false` if it is not all in the image.
#[inline(always)]
fn sample(image: GreyView<'_>, x: f32, y: f32, out: &mut Rows) -> bool {
    let fits = |start: f32, side: usize| start >= 0.0 && start + (WINDOW as f32) + 1.0 <= side as f32;
    if !fits(x, image.width()) || !fits(y, image.height()) {
        return false;
    }
    let (left, top) = (x as usize, y as usize);
    let (ax, ay) = (x - left as f32, y - top as f32);
    let mut upper = sample_row(image, left, top, ax);
    for (r, row) in out.iter_mut().enumerate() {
        let lower = sample_row(image, left, top + r + 1, ax);
        for c in 0..WINDOW {
            row[c] = upper[c] + ay * (lower[c] - upper[c]);
        }
        upper = lower;
    }
    true
}

#[inline(always)]
fn sample_row(image: GreyView<'_>, left: usize, row: usize, share: f32) -> [f32; WINDOW] {
    let pixels = &image.row(row)[left..left + WINDOW + 1];
    let mut out = [0.0; WINDOW];
    for c in 0..WINDOW {
        let (a, b) = (f32::from(pixels[c]), f32::from(pixels[c + 1]));
        out[c] = a + share * (b - a);
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simd::Level;

    /// A smooth texture, sampled at a scale and an offset.
    fn texture(width: usize, height: usize, scale: f64, shift: [f64; 2], bright: f64) -> Vec<u8> {
        let value = |x: f64, y: f64| {
            128.0 + 40.0 * (0.31 * x + 0.12 * y).sin() + 35.0 * (0.27 * y - 0.1 * x).cos() + bright
        };
        let at = |i: usize| {
            let (x, y) = ((i % width) as f64, (i / width) as f64);
            value((x - 40.0 - shift[0]) / scale + 40.0, (y - 40.0 - shift[1]) / scale + 40.0).round() as u8
        };
        (0..width * height).map(at).collect()
    }

    #[test]
    fn a_patch_is_found_at_another_place_scale_and_brightness() {
        let (width, height) = (80, 80);
        let first = texture(width, height, 1.0, [0.0; 2], 0.0);
        let first = GreyView::new(&first, width, height, width).unwrap();
        let mut patch = Patch::default();
        assert!(patch.store(first, 40.0, 40.0));
        assert!(!patch.clone().store(first, 5.0, 40.0) && !patch.clone().store(first, 40.0, 72.0));
        let mut worst = 0.0_f32;
        for scale in [0.96, 1.0, 1.15, 1.4] {
            for shift in [[0.0, 0.0], [1.3, -0.7], [-2.4, 2.1]] {
                let second = texture(width, height, scale, shift, 12.0);
                let second = GreyView::new(&second, width, height, width).unwrap();
                let mut out = Alignment { x: 40.0, y: 40.0, ..Alignment::default() };
                align(Level::best(), &patch, scale as f32, second, &mut out);
                assert!(out.found, "{scale} {shift:?}");
                let off = (out.x - 40.0 - shift[0] as f32).hypot(out.y - 40.0 - shift[1] as f32);
                worst = worst.max(off);
                assert!(out.residual < 0.02 * out.variance, "{out:?}");
            }
        }
        println!("worst error of a patch's place: {worst:.3} px");
        assert!(worst < 0.06, "{worst}");
    }

    #[test]
    fn a_patch_without_texture_or_outside_the_image_is_not_found() {
        let flat = vec![90; 80 * 80];
        let flat = GreyView::new(&flat, 80, 80, 80).unwrap();
        let mut patch = Patch::default();
        assert!(patch.store(flat, 40.0, 40.0));
        let mut out = Alignment { x: 40.0, y: 40.0, ..Alignment::default() };
        align(Level::best(), &patch, 1.0, flat, &mut out);
        assert!(!out.found);
        let pixels = texture(80, 80, 1.0, [0.0; 2], 0.0);
        let image = GreyView::new(&pixels, 80, 80, 80).unwrap();
        assert!(patch.store(image, 40.0, 40.0));
        for x in [3.0, 77.0, -1e9, f32::NAN, f32::INFINITY] {
            let mut out = Alignment { x, y: 40.0, ..Alignment::default() };
            align(Level::best(), &patch, 1.0, image, &mut out);
            assert!(!out.found, "{x}");
        }
    }

    #[test]
    fn all_instruction_sets_agree_bit_for_bit() {
        let mut random = fastrand::Rng::with_seed(20);
        let (width, height) = (90, 70);
        for _ in 0..200 {
            let scale = 0.9 + 0.8 * random.f64();
            let pixels = texture(width, height, 1.0, [0.0; 2], 0.0);
            let noisy: Vec<u8> = pixels.iter().map(|&v| v.saturating_add(random.u8(0..9))).collect();
            let image = GreyView::new(&noisy, width, height, width).unwrap();
            let mut patch = Patch::default();
            assert!(patch.store(image, 20.0 + 40.0 * random.f32(), 20.0 + 30.0 * random.f32()));
            let start = Alignment {
                x: 20.0 + 40.0 * random.f32(),
                y: 20.0 + 30.0 * random.f32(),
                ..Alignment::default()
            };
            let mut reference = start;
            align(Level::PLAIN, &patch, scale as f32, image, &mut reference);
            for level in Level::available() {
                let mut out = start;
                align(level, &patch, scale as f32, image, &mut out);
                assert_eq!(out, reference, "{}", level.name());
            }
        }
    }
}
