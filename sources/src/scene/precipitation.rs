//! Rain and snow: drops and flakes at positions in space that both cameras see.

use super::texture::{hash, unit};
use super::view::Camera;

/// Distance range of drops, in metres.
const RANGE_M: (f64, f64) = (0.7, 14.0);

/// Parameters of rain or snow.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Precipitation {
    /// Number of drops or flakes in the image.
    pub count: u32,
    /// Diameter in metres.
    pub diameter_m: f64,
    /// Falling speed, in m/s.
    pub fall_m_s: f64,
    /// Wind to the right, in m/s.
    pub wind_m_s: f64,
    /// Exposure time in seconds, which determines the length of streaks.
    pub exposure_s: f64,
    /// Grey value of a drop or flake.
    pub grey: f32,
    /// Opacity of a streak, 0 to 1.
    pub opacity: f32,
}

/// The motion-blurred image of one drop or flake: its ends and width in pixels, and 1/z where it starts.
struct Streak {
    from: (f64, f64),
    to: (f64, f64),
    thick: f32,
    inverse_z: f32,
}

impl Precipitation {
    /// Draws the precipitation into one camera's `light`; `depth` is 1/z of each pixel. The same `seed` gives
    /// both cameras the same drops; `speed_m_s` is the vehicle's speed.
    pub fn draw(&self, camera: &Camera, seed: u64, speed_m_s: f64, light: &mut [f32], depth: &[f32]) {
        let rig = camera.rig;
        let (width, height) = (camera.size.0 as f64, camera.size.1 as f64);
        for k in 0..u64::from(self.count) {
            let own = |n: u64| unit(hash(seed ^ k << 8) ^ n);
            // Uniform in space, so few are near. Positions cover the left image and a margin.
            let (near, far) = (RANGE_M.0.powi(3), RANGE_M.1.powi(3));
            let z = (near + (far - near) * own(0)).cbrt();
            let x = (own(1) * (width * 1.2) - 0.1 * width - rig.cx_px) * z / rig.focal_px;
            let y = (own(2) * (height * 1.1) - 0.1 * height - rig.cy_px) * z / rig.focal_px;
            let size = self.diameter_m * (0.6 + 0.8 * own(3));
            let gust = self.wind_m_s + 0.15 * self.fall_m_s * (own(4) - 0.5);
            let end = [
                x + gust * self.exposure_s,
                y + self.fall_m_s * self.exposure_s,
                (z - speed_m_s * self.exposure_s).max(0.4),
            ];
            let project = |p: [f64; 3]| {
                let p = camera.turn(p);
                (
                    rig.cx_px + (p[0] - camera.x_m) * rig.focal_px / p[2],
                    rig.cy_px + p[1] * rig.focal_px / p[2],
                )
            };
            let thick = size * rig.focal_px / z;
            let streak = Streak {
                from: project([x, y, z]),
                to: project(end),
                thick: thick as f32,
                inverse_z: (1.0 / z) as f32,
            };
            self.draw_streak(camera, &streak, light, depth);
        }
    }

    fn draw_streak(&self, camera: &Camera, streak: &Streak, light: &mut [f32], depth: &[f32]) {
        let &Streak { from, to, thick, inverse_z } = streak;
        let (width, height) = camera.size;
        let (dx, dy) = ((to.0 - from.0) as f32, (to.1 - from.1) as f32);
        let length = (dx * dx + dy * dy).sqrt();
        let radius = 0.5 * thick;
        let reach = f64::from(radius) + 1.0;
        let side = |a: f64, b: f64, most: usize| {
            let first = (a.min(b) - reach).floor().clamp(0.0, most as f64) as usize;
            first..(a.max(b) + reach).ceil().clamp(0.0, most as f64) as usize
        };
        // Streaks thinner than a pixel cover part of it; long ones cover each pixel for part of the exposure.
        let opacity = self.opacity * thick.min(1.0) * (2.0 * thick / (thick + length)).clamp(0.25, 1.0);
        let soft = radius.max(0.5);
        for y in side(from.1, to.1, height) {
            for x in side(from.0, to.0, width) {
                let i = y * width + x;
                if depth[i] > inverse_z {
                    continue;
                }
                let (px, py) = ((x as f64 - from.0) as f32, (y as f64 - from.1) as f32);
                let along = if length > 0.0 {
                    ((px * dx + py * dy) / (length * length)).clamp(0.0, 1.0)
                } else {
                    0.0
                };
                let (ox, oy) = (px - along * dx, py - along * dy);
                let off = (ox * ox + oy * oy).sqrt();
                let share = (soft + 0.5 - off).clamp(0.0, 1.0);
                light[i] += (self.grey - light[i]) * share * opacity;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use perception::rig::Rig;

    #[test]
    fn a_drop_has_the_disparity_of_its_distance() {
        let rig = Rig { focal_px: 400.0, baseline_m: 0.12, cx_px: 160.0, cy_px: 120.0 };
        let snow = Precipitation {
            count: 1,
            diameter_m: 0.03,
            fall_m_s: 0.0,
            wind_m_s: 0.0,
            exposure_s: 0.0,
            grey: 200.0,
            opacity: 1.0,
        };
        let centre = |x_m: f64, seed: u64, depth: f32| {
            let camera = Camera { rig, size: (320, 240), x_m, pitch_rad: 0.0 };
            let mut light = vec![0.0; 320 * 240];
            snow.draw(&camera, seed, 0.0, &mut light, &vec![depth; 320 * 240]);
            let sum: f32 = light.iter().sum();
            (light.iter().enumerate().map(|(i, v)| (i % 320) as f32 * v).sum::<f32>() / sum, sum)
        };
        let mut compared = 0;
        for seed in 0..40 {
            let ((left, a), (right, b)) = (centre(0.0, seed, 0.0), centre(0.12, seed, 0.0));
            if a < 300.0 || b < 0.9 * a || !(40.0..280.0).contains(&left) {
                continue;
            }
            let disparity = left - right;
            // 0.7 to 14 m.
            assert!((48.0 / 14.1..48.0 / 0.69).contains(&disparity), "{disparity}");
            // Something nearer occludes it.
            assert_eq!(centre(0.0, seed, 10.0).1, 0.0);
            compared += 1;
        }
        assert!(compared > 5, "{compared}");
    }
}
