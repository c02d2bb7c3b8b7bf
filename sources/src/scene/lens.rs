//! Lens effects: water drops, glare of a low sun, halos of lamps. Each lens has its own.

use super::texture::{hash, unit};
use super::view::Camera;

/// Block size of the downsampled image that blur is computed on, in pixels.
const COARSE: usize = 8;

/// Frames for which a drop stays on the lens.
const DROP_FRAMES: u64 = 20;

/// Glare of a low sun in the field of view.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Glare {
    /// Direction of the sun: metres right and down per metre ahead.
    pub at: (f64, f64),
    /// Brightness at its centre, in grey levels.
    pub strength: f32,
}

/// Effects of both lenses.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Lens {
    /// Drops on each lens.
    pub drops: u32,
    /// Share of the light scattered by a film of water, 0 to 1.
    pub film: f32,
    /// Glare of the sun.
    pub glare: Option<Glare>,
    /// Share of the overexposed light that forms halos.
    pub halo: f32,
}

/// Buffers of the downsampled image.
#[derive(Debug, Default)]
pub struct Coarse {
    pixels: Vec<f32>,
    spare: Vec<f32>,
    columns: usize,
    rows: usize,
}

impl Coarse {
    /// Computes the mean of `value` over each block of `light`.
    fn shrink(&mut self, camera: &Camera, light: &[f32], value: impl Fn(f32) -> f32) {
        let (width, height) = camera.size;
        (self.columns, self.rows) = (width.div_ceil(COARSE), height.div_ceil(COARSE));
        self.pixels.clear();
        for row in 0..self.rows {
            for column in 0..self.columns {
                let (mut sum, mut count) = (0.0, 0.0);
                for y in row * COARSE..((row + 1) * COARSE).min(height) {
                    for v in
                        &light[y * width + column * COARSE..y * width + ((column + 1) * COARSE).min(width)]
                    {
                        sum += value(*v);
                        count += 1.0;
                    }
                }
                self.pixels.push(sum / count);
            }
        }
    }

    /// Box-blurs the downsampled image.
    fn blur(&mut self) {
        let (columns, rows) = (self.columns, self.rows);
        self.spare.clear();
        for y in 0..rows {
            for x in 0..columns {
                let at = |dx: isize, dy: isize| {
                    let (x, y) = (
                        x.saturating_add_signed(dx).min(columns - 1),
                        y.saturating_add_signed(dy).min(rows - 1),
                    );
                    self.pixels[y * columns + x]
                };
                let cross = at(-1, 0) + at(1, 0) + at(0, -1) + at(0, 1);
                let corners = at(-1, -1) + at(1, -1) + at(-1, 1) + at(1, 1);
                self.spare.push(0.25 * at(0, 0) + 0.125 * cross + 0.0625 * corners);
            }
        }
        std::mem::swap(&mut self.pixels, &mut self.spare);
    }

    /// Interpolated value at a position of the full image, in its pixels.
    fn at(&self, x: f32, y: f32) -> f32 {
        let place = |v: f32, most: usize| {
            let v = ((v + 0.5) / COARSE as f32 - 0.5).clamp(0.0, (most - 1) as f32);
            let whole = v as usize;
            (whole, (whole + 1).min(most - 1), v - whole as f32)
        };
        let ((x0, x1, a), (y0, y1, b)) = (place(x, self.columns), place(y, self.rows));
        let row = |y: usize| {
            let (p, q) = (self.pixels[y * self.columns + x0], self.pixels[y * self.columns + x1]);
            p + (q - p) * a
        };
        let (top, low) = (row(y0), row(y1));
        top + (low - top) * b
    }
}

impl Lens {
    /// Applies the lens effects to one camera's `light`. `seed` identifies the lens.
    pub fn apply(&self, camera: &Camera, seed: u64, frame: u64, light: &mut [f32], coarse: &mut Coarse) {
        if self.halo > 0.0 {
            self.halo(camera, light, coarse);
        }
        if let Some(glare) = self.glare {
            Self::glare(camera, glare, seed, light);
        }
        if self.drops > 0 || self.film > 0.0 {
            coarse.shrink(camera, light, |v| v.min(400.0));
            if self.film > 0.0 {
                coarse.blur();
                self.film(camera, light, coarse);
            }
            for k in 0..u64::from(self.drops) {
                Self::drop(camera, hash(seed ^ k << 4), frame, light, coarse);
            }
        }
    }

    fn halo(&self, camera: &Camera, light: &mut [f32], coarse: &mut Coarse) {
        coarse.shrink(camera, light, |v| (v - 235.0).max(0.0));
        (0..3).for_each(|_| coarse.blur());
        let width = camera.size.0;
        for (i, v) in light.iter_mut().enumerate() {
            *v += self.halo * coarse.at((i % width) as f32, (i / width) as f32);
        }
    }

    fn film(&self, camera: &Camera, light: &mut [f32], coarse: &Coarse) {
        let width = camera.size.0;
        for (i, v) in light.iter_mut().enumerate() {
            *v += self.film * (coarse.at((i % width) as f32, (i / width) as f32) - *v);
        }
    }

    fn glare(camera: &Camera, glare: Glare, seed: u64, light: &mut [f32]) {
        let rig = camera.level();
        let (width, height) = camera.size;
        // Dirt scatters differently on each lens.
        let strength = glare.strength * (0.85 + 0.3 * unit(seed) as f32);
        let (x, y) =
            ((rig.cx_px + glare.at.0 * rig.focal_px) as f32, (rig.cy_px + glare.at.1 * rig.focal_px) as f32);
        let scale = rig.focal_px as f32;
        let (centre_x, centre_y) = (width as f32 / 2.0, height as f32 / 2.0);
        for row in 0..height {
            let dy = row as f32 - y;
            for (column, v) in light[row * width..(row + 1) * width].iter_mut().enumerate() {
                let dx = column as f32 - x;
                let r = (dx * dx + dy * dy) / (scale * scale);
                // Disc, aureole and veiling glare.
                let disc = if r < 0.0006 { 1.5 } else { 0.0 };
                *v += strength * (disc + 0.9 / (1.0 + r / 0.004) + 0.2 / (1.0 + r / 0.12));
            }
        }
        // Ghosts: reflections of the sun between lens elements, on the line through the image centre.
        for (k, (share, size, bright)) in
            [(-0.45_f32, 0.022_f32, 0.09_f32), (-0.9, 0.05, 0.05), (0.4, 0.014, 0.1)].iter().enumerate()
        {
            let own = 0.8 + 0.4 * unit(seed ^ k as u64) as f32;
            let (gx, gy) = (centre_x + share * (x - centre_x), centre_y + share * (y - centre_y));
            let radius = size * scale;
            let rows = (gy - radius).max(0.0) as usize..((gy + radius).max(0.0) as usize).min(height);
            for row in rows {
                for column in (gx - radius).max(0.0) as usize..((gx + radius).max(0.0) as usize).min(width) {
                    let (dx, dy) = (column as f32 - gx, row as f32 - gy);
                    let inside = ((radius * radius - dx * dx - dy * dy) / (radius * 4.0)).clamp(0.0, 1.0);
                    light[row * width + column] += glare.strength * bright * own * inside;
                }
            }
        }
    }

    /// A drop shows a small, blurred, inverted image of the scene.
    fn drop(camera: &Camera, key: u64, frame: u64, light: &mut [f32], coarse: &Coarse) {
        let (width, height) = camera.size;
        let life = frame + (unit(key) * DROP_FRAMES as f64) as u64;
        let own = |n: u64| unit(hash(key ^ (life / DROP_FRAMES) << 20) ^ n) as f32;
        let scale = width as f32 / 640.0;
        let radius = scale * (4.0 + 15.0 * own(0) * own(0));
        // It slides down slightly during its life.
        let slide = 0.25 * scale * (life % DROP_FRAMES) as f32 * own(3);
        let (cx, cy) = (own(1) * width as f32, own(2) * height as f32 + slide);
        let rows = (cy - radius).max(0.0) as usize..((cy + radius + 1.0).max(0.0) as usize).min(height);
        for y in rows {
            for x in (cx - radius).max(0.0) as usize..((cx + radius + 1.0).max(0.0) as usize).min(width) {
                let (dx, dy) = ((x as f32 - cx) / radius, (y as f32 - cy) / radius);
                let off = dx * dx + dy * dy;
                if off >= 1.0 {
                    continue;
                }
                let i = y * width + x;
                let seen = coarse.at(cx - dx * radius * 5.0, cy - dy * radius * 5.0);
                // Darker at the rim.
                let seen = seen * (1.05 - 0.5 * off * off);
                let share = (3.0 * (1.0 - off)).min(0.85);
                light[i] += (seen - light[i]) * share;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use perception::rig::Rig;

    const RIG: Rig = Rig { focal_px: 400.0, baseline_m: 0.12, cx_px: 160.0, cy_px: 120.0 };

    fn seen(lens: Lens, seed: u64, frame: u64) -> Vec<f32> {
        let camera = Camera { rig: RIG, size: (320, 240), x_m: 0.0, pitch_rad: 0.0 };
        let mut light: Vec<f32> = (0..320 * 240).map(|i| if i / 320 < 120 { 200.0 } else { 80.0 }).collect();
        lens.apply(&camera, seed, frame, &mut light, &mut Coarse::default());
        light
    }

    #[test]
    fn drops_stay_for_a_while_and_differ_between_lenses() {
        let lens = Lens { drops: 12, ..Lens::default() };
        let changed = |a: &[f32], b: &[f32]| a.iter().zip(b).filter(|(a, b)| (*a - *b).abs() > 5.0).count();
        let clean = seen(Lens::default(), 1, 0);
        let (a, later, other) = (seen(lens, 1, 3), seen(lens, 1, 4), seen(lens, 2, 3));
        assert!(changed(&clean, &a) > 300, "{}", changed(&clean, &a));
        assert!(changed(&a, &later) < changed(&clean, &a) / 2);
        assert!(changed(&a, &other) > changed(&clean, &a) / 2);
        assert_eq!(a, seen(lens, 1, 3));
    }

    #[test]
    fn glare_is_strongest_at_the_sun() {
        let lens = Lens { glare: Some(Glare { at: (0.1, -0.1), strength: 200.0 }), ..Lens::default() };
        let light = seen(lens, 1, 0);
        let at = |x: usize, y: usize| light[y * 320 + x];
        assert!(at(200, 80) > 500.0 && at(200, 80) > at(230, 80) && at(230, 80) > at(310, 80));
        assert!(at(10, 230) > 80.0, "a veil over everything");
    }
}
