//! Renders boxes on a flat road for one camera of the rig, with exact depth.

use super::texture::{Texture, hash};
use perception::rig::Rig;

/// An upright box in the world: x right of the rig's axis, z ahead of the rig, metres.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Block {
    /// Left and right side.
    pub x_m: (f64, f64),
    /// Height above the road of its lower and upper side.
    pub up_m: (f64, f64),
    /// Near and far side.
    pub z_m: (f64, f64),
    /// Mean grey of its faces.
    pub grey: f32,
    /// What its faces look like.
    pub look: Look,
    /// Which part of the pattern its faces show; one for each block, for ever.
    pub pattern: f32,
}

/// What the faces of a block look like.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Look {
    /// Rows of dark windows.
    Building,
    /// Rear window, lamps and a bumper.
    Vehicle,
    /// Nothing but texture.
    Plain,
}

/// What one camera sees.
pub struct Camera<'a> {
    /// The rig.
    pub rig: &'a Rig,
    /// Image size in pixels.
    pub size: (usize, usize),
    /// Metres right of the left camera.
    pub x_m: f64,
    /// Height above the road.
    pub height_m: f64,
    /// How far the vehicle has driven, which moves the road's texture.
    pub travelled_m: f64,
    /// Seed of the sensor noise of this image.
    pub noise_seed: u64,
}

/// Distance beyond which everything is sky.
const FARTHEST_M: f64 = 250.0;

/// Writes grey values and, per pixel, the distance along z (infinite for the sky).
pub fn render(camera: &Camera<'_>, texture: &Texture, blocks: &[Block], grey: &mut [u8], depth: &mut [f32]) {
    let (width, height) = camera.size;
    road_and_sky(camera, texture, grey, depth);
    for block in blocks {
        draw_block(camera, texture, block, grey, depth);
    }
    // Sensor noise, ±2 grey levels, of its own in each image.
    for y in 0..height {
        for x in (0..width).step_by(8) {
            let mut bits = hash(camera.noise_seed ^ ((y as u64) << 32 | x as u64));
            for value in &mut grey[y * width + x..y * width + (x + 8).min(width)] {
                *value = (i32::from(*value) + (bits % 5) as i32 - 2).clamp(0, 255) as u8;
                bits >>= 8;
            }
        }
    }
}

fn road_and_sky(camera: &Camera<'_>, texture: &Texture, grey: &mut [u8], depth: &mut [f32]) {
    let (width, height) = camera.size;
    let rig = camera.rig;
    for y in 0..height {
        let row = &mut grey[y * width..(y + 1) * width];
        let depths = &mut depth[y * width..(y + 1) * width];
        let below = y as f64 - rig.cy_px;
        let z = camera.height_m * rig.focal_px / below;
        if below <= 0.0 || z > FARTHEST_M {
            depths.fill(f32::INFINITY);
            let light = 190.0 + 25.0 * (-below / height as f64) as f32;
            for (x, value) in row.iter_mut().enumerate() {
                // Clouds, infinitely far: the same in both cameras.
                let cloud = texture.sample(x as f32 * 0.25, y as f32 * 0.5, 1.0) - 128.0;
                *value = (light + 0.35 * cloud).clamp(0.0, 255.0) as u8;
            }
            continue;
        }
        depths.fill(z as f32);
        let metres_per_px = z / rig.focal_px;
        let along = z + camera.travelled_m;
        // A pixel of the road is much longer than wide; the texture is filtered for the mean.
        let footprint_m = (metres_per_px * metres_per_px * z / camera.height_m).sqrt();
        let (fine, coarse) = (1.0 / 0.012, 1.0 / 0.09);
        let dashes = (along / 6.0).rem_euclid(2.0) < 1.0;
        for (x, value) in row.iter_mut().enumerate() {
            let across = (x as f64 - rig.cx_px) * metres_per_px + camera.x_m;
            let sample = |per_m: f64| {
                texture.sample(
                    (across * per_m) as f32,
                    ((along * per_m) % 65_536.0) as f32,
                    (footprint_m * per_m) as f32,
                ) - 128.0
            };
            let mut v = 95.0 + 0.55 * sample(fine) + 0.5 * sample(coarse);
            let beside = (across.abs() - 5.25).abs() < 0.07 || (dashes && (across.abs() - 1.75).abs() < 0.07);
            if beside {
                v += 90.0;
            } else if across.abs() > 5.6 {
                v -= 25.0;
            }
            *value = v.clamp(0.0, 255.0) as u8;
        }
    }
}

fn draw_block(camera: &Camera<'_>, texture: &Texture, block: &Block, grey: &mut [u8], depth: &mut [f32]) {
    let (width, height) = camera.size;
    let rig = camera.rig;
    let near = block.z_m.0.max(0.3);
    let far = block.z_m.1;
    if far <= near {
        return;
    }
    // The image rectangle that the block may cover.
    let (mut x0, mut x1, mut y0, mut y1) = (f64::MAX, f64::MIN, f64::MAX, f64::MIN);
    for z in [near, far] {
        for x in [block.x_m.0, block.x_m.1] {
            let u = rig.cx_px + (x - camera.x_m) * rig.focal_px / z;
            (x0, x1) = (x0.min(u), x1.max(u));
        }
        for up in [block.up_m.0, block.up_m.1] {
            let v = rig.cy_px + (camera.height_m - up) * rig.focal_px / z;
            (y0, y1) = (y0.min(v), y1.max(v));
        }
    }
    let columns = x0.floor().max(0.0) as usize..(x1.ceil() + 1.0).clamp(0.0, width as f64) as usize;
    let rows = y0.floor().max(0.0) as usize..(y1.ceil() + 1.0).clamp(0.0, height as f64) as usize;
    for y in rows {
        let dy = (y as f64 - rig.cy_px) / rig.focal_px;
        for x in columns.clone() {
            let dx = (x as f64 - rig.cx_px) / rig.focal_px;
            let Some((z, face)) = hit(camera, block, near, dx, dy) else { continue };
            let i = y * width + x;
            if z as f32 >= depth[i] {
                continue;
            }
            depth[i] = z as f32;
            let up = camera.height_m - dy * z;
            let across = camera.x_m + dx * z;
            let (u, light) = match face {
                Face::Rear => (across - block.x_m.0, 0.0),
                // From its near side, so that the texture moves with the block.
                Face::Side => (z - block.z_m.0, -22.0),
                Face::Top => (across - block.x_m.0, 25.0),
            };
            grey[i] = shade(block, face, u, up, light, z / rig.focal_px, texture);
        }
    }
}

#[derive(Clone, Copy, PartialEq)]
enum Face {
    Rear,
    Side,
    Top,
}

/// Distance and face where the ray (dx, dy, 1) from the camera meets the block first.
fn hit(camera: &Camera<'_>, block: &Block, near: f64, dx: f64, dy: f64) -> Option<(f64, Face)> {
    let mut enter = (near, Face::Rear);
    let mut leave = block.z_m.1;
    let down = (camera.height_m - block.up_m.1, camera.height_m - block.up_m.0);
    let side = (block.x_m.0 - camera.x_m, block.x_m.1 - camera.x_m);
    for (slope, (low, high), face) in [(dx, side, Face::Side), (dy, down, Face::Top)] {
        if slope.abs() < 1e-12 {
            if low > 0.0 || high < 0.0 {
                return None;
            }
            continue;
        }
        let (a, b) = (low / slope, high / slope);
        if a.min(b) > enter.0 {
            enter = (a.min(b), face);
        }
        leave = leave.min(a.max(b));
    }
    (enter.0 < leave).then_some(enter)
}

fn shade(
    block: &Block,
    face: Face,
    u: f64,
    up: f64,
    light: f32,
    metres_per_px: f64,
    texture: &Texture,
) -> u8 {
    let per_m = 1.0 / 0.015;
    let own = block.pattern;
    let sample = texture.sample(
        (u * per_m) as f32 + own,
        (up * per_m) as f32 + 2.0 * own,
        (metres_per_px * per_m) as f32,
    ) - 128.0;
    let mut v = block.grey + light + 0.7 * sample;
    let height = block.up_m.1 - block.up_m.0;
    let share = (up - block.up_m.0) / height;
    match (block.look, face) {
        (Look::Vehicle, Face::Rear) => {
            let width = block.x_m.1 - block.x_m.0;
            let middle = (u / width - 0.5).abs();
            if (0.58..0.92).contains(&share) && middle < 0.42 {
                v -= 55.0;
            } else if (0.4..0.52).contains(&share) && middle > 0.36 {
                v += 70.0;
            } else if share < 0.14 {
                v -= 45.0;
            } else if (0.2..0.3).contains(&share) && middle < 0.14 {
                v += 60.0;
            }
        }
        (Look::Vehicle, Face::Side) if (0.58..0.92).contains(&share) => v -= 45.0,
        (Look::Building, Face::Side | Face::Rear) => {
            let window = (u / 2.2).rem_euclid(1.0) < 0.5 && (up / 2.6).rem_euclid(1.0) > 0.45;
            if window {
                v -= 50.0;
            }
        }
        _ => {}
    }
    v.clamp(0.0, 255.0) as u8
}

#[cfg(test)]
mod tests {
    use super::*;

    const RIG: Rig = Rig { focal_px: 440.0, baseline_m: 0.12, cx_px: 160.0, cy_px: 110.0 };

    fn block(z: (f64, f64)) -> Block {
        Block { x_m: (-1.0, 1.0), up_m: (0.0, 1.5), z_m: z, grey: 120.0, look: Look::Plain, pattern: 17.0 }
    }

    fn see(x_m: f64, blocks: &[Block]) -> (Vec<u8>, Vec<f32>) {
        let camera =
            Camera { rig: &RIG, size: (320, 240), x_m, height_m: 1.2, travelled_m: 3.0, noise_seed: 7 };
        let (mut grey, mut depth) = (vec![0; 320 * 240], vec![0.0; 320 * 240]);
        render(&camera, &Texture::new(5), blocks, &mut grey, &mut depth);
        (grey, depth)
    }

    #[test]
    fn depth_is_exact_on_the_road_and_on_a_block() {
        let (_, depth) = see(0.0, &[block((10.0, 14.0))]);
        let at = |x: usize, y: usize| depth[y * 320 + x];
        assert_eq!(at(160, 120), 10.0);
        assert!((f64::from(at(20, 200)) - 1.2 * 440.0 / 90.0).abs() < 1e-4);
        assert!(at(20, 50).is_infinite());
        // Beside the block, beyond it, and above it.
        assert!(at(160 + 46, 120) > 10.0);
        assert!(at(160, 90).is_infinite());
    }

    #[test]
    fn the_right_camera_sees_the_same_surface_shifted_by_its_disparity() {
        let blocks = [block((10.0, 14.0))];
        let (left, depth) = see(0.0, &blocks);
        let (right, right_depth) = see(RIG.baseline_m, &blocks);
        let (mut compared, mut off) = (0, 0);
        for y in 0..240 {
            for x in 30..320 {
                let z = depth[y * 320 + x];
                if z.is_infinite() {
                    continue;
                }
                let at = x as f64 - RIG.disparity_px(z.into());
                let i = y * 320 + at.floor() as usize;
                // Where both see the same surface, and not an edge.
                if (right_depth[i] - z).abs() > 0.01 || (right_depth[i + 1] - z).abs() > 0.01 {
                    continue;
                }
                let share = at - at.floor();
                let seen = f64::from(right[i]) * (1.0 - share) + f64::from(right[i + 1]) * share;
                compared += 1;
                off += usize::from((seen - f64::from(left[y * 320 + x])).abs() > 14.0);
            }
        }
        assert!(compared > 20_000, "{compared}");
        assert!(off * 50 < compared, "{off} of {compared}");
    }
}
