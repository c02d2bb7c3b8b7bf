//! Shading: from the surfaces that samples see to grey values.

use super::light::Light;
use super::material::{Hit, Look, Style};
use super::texture::Texture;
use super::view::{Camera, Patch, SAMPLES, Surface, View};
use perception::rig::Rig;

/// Computes the grey values of a scene's pixels.
#[derive(Debug)]
pub struct Painter {
    /// The texture of all surfaces.
    pub texture: Texture,
    /// Surface style of the road.
    pub style: Style,
    /// Lighting.
    pub light: Light,
    /// Camera axes (right, down, ahead) in the world, where the vehicle turns: the clouds stand still. On a straight road
    /// they are fixed in the image.
    pub to_world: Option<[[f32; 3]; 3]>,
}

/// Columns and rows of the clouds' texture for each rad on a straight road, and around the vehicle where it turns: there
/// the repeating texture closes, twice its 256 texels.
const CLOUDS: (f32, f32, f32) = (90.0, 210.0, 512.0 / std::f32::consts::TAU);

/// The direction of the ray (`dx`, `dy`, 1) in the world, by the camera's axes there: rad to the right, and how far below the
/// horizon, as tangent.
#[inline]
fn direction(axes: &[[f32; 3]; 3], dx: f32, dy: f32) -> (f32, f32) {
    let [x, y, z] = [0, 1, 2].map(|k| axes[0][k] * dx + axes[1][k] * dy + axes[2][k]);
    (x.atan2(z), -y / (x * x + z * z).sqrt().max(1e-3))
}

/// Shadows and lamp light on the ground along one row.
#[derive(Debug, Default)]
pub struct Shade {
    /// 0 = sunlit, 1 = in full shadow.
    pub shadow: Vec<f32>,
    /// Added lamp light.
    pub pool: Vec<f32>,
}

/// Minimum width of a penumbra on the ground, in metres.
const PENUMBRA_M: f64 = 0.06;

impl Shade {
    /// Buffers for rows of `width` pixels.
    pub fn new(width: usize) -> Self {
        Self { shadow: vec![0.0; width], pool: vec![0.0; width] }
    }

    /// Computes the shadows and lamp light of row `y`, where `depth` (1/z) shows that nothing occludes the
    /// ground. The contrast of a shade's material is the shadow's strength, its glow the lamp's light.
    pub fn row(&mut self, camera: &Camera, shades: &mut View, surfaces: &[Surface], y: usize, depth: &[f32]) {
        self.shadow.fill(0.0);
        self.pool.fill(0.0);
        let rig = camera.rig;
        let dy = (y as f64 - rig.cy_px) / rig.focal_px;
        let width = camera.size.0;
        shades.spans(y, |patch, from, to| {
            let material = surfaces[patch.surface as usize].material;
            let middle = ((from + to) * 0.5).clamp(0.0, width as f64);
            let near = patch.inverse_z((middle - rig.cx_px) / rig.focal_px, dy).max(0.0);
            let per_m = rig.focal_px * near;
            let soft = if material.glow > 0.0 { (to - from) * 0.45 } else { PENUMBRA_M * per_m }.max(1.0);
            let first = (from - soft).floor().clamp(0.0, width as f64) as usize;
            let last = (to + soft).ceil().clamp(0.0, width as f64) as usize;
            for x in first..last {
                let at = x as f64;
                // Behind a crest other ground is shaded.
                let here = patch.inverse_z((at - rig.cx_px) / rig.focal_px, dy);
                if f64::from(depth[x]) > 1.15 * here {
                    continue;
                }
                let share =
                    ((at - from) / soft + 0.5).clamp(0.0, 1.0) * ((to - at) / soft + 0.5).clamp(0.0, 1.0);
                if material.glow > 0.0 {
                    self.pool[x] += material.glow * share as f32;
                } else {
                    self.shadow[x] = self.shadow[x].max(material.contrast * share as f32);
                }
            }
        });
    }
}

/// One row of one camera's image.
pub struct Row<'a> {
    /// The camera.
    pub camera: &'a Camera,
    /// The camera's patches.
    pub view: &'a View,
    /// The surfaces of the patches.
    pub surfaces: &'a [Surface],
    /// Shadows and lamp light.
    pub shade: &'a Shade,
    /// Reflections on a wet road.
    pub mirror: Option<Mirror<'a>>,
    /// Index of the row.
    pub y: usize,
}

/// The mirrored world that a wet road reflects, in one row.
#[derive(Clone, Copy)]
pub struct Mirror<'a> {
    /// Patches of the mirrored world.
    pub view: &'a View,
    /// The surfaces of the patches.
    pub surfaces: &'a [Surface],
    /// Patch number that each pixel would see at its centre.
    pub seen: &'a [u32],
}

impl Painter {
    /// Shades a row from the patches that its samples see.
    pub fn row(&self, row: &Row<'_>, seen: &[Vec<u32>], grey: &mut [f32]) {
        let [a, b, c, d] = [&seen[0], &seen[1], &seen[2], &seen[3]];
        let mut x = 0;
        while x < grey.len() {
            let number = a[x];
            if b[x] != number || c[x] != number || d[x] != number {
                grey[x] = self.edge(row, [number, b[x], c[x], d[x]], x);
                x += 1;
                continue;
            }
            let same = |x: usize| a[x] == number && b[x] == number && c[x] == number && d[x] == number;
            let mut end = x + 1;
            while end < grey.len() && same(end) {
                end += 1;
            }
            let y = row.y as f32;
            if number == 0 {
                let level = row.camera.level();
                self.sky_run(&level, x, y, &mut grey[x..end]);
            } else {
                let patch = row.view.patches[number as usize - 1];
                let surface = row.surfaces[patch.surface as usize];
                (x..end).for_each(|x| grey[x] = self.point(row, &patch, &surface, x, x as f32, y));
            }
            x = end;
        }
    }

    /// A pixel whose samples see several patches.
    #[cold]
    fn edge(&self, row: &Row<'_>, numbers: [u32; 4], x: usize) -> f32 {
        let mut grey = 0.0;
        for (k, &number) in numbers.iter().enumerate() {
            if numbers[..k].contains(&number) {
                continue;
            }
            // The mean position of a patch's samples lies on it, as it is convex.
            let (mut n, mut right, mut down) = (0.0, 0.0, 0.0);
            for (&other, (r, d)) in numbers.iter().zip(SAMPLES) {
                if other == number {
                    (n, right, down) = (n + 1.0, right + r, down + d);
                }
            }
            let (px, py) = (x as f32 + right / n, row.y as f32 + down / n);
            grey += n / 4.0
                * if number == 0 {
                    self.sky(&row.camera.level(), px, py)
                } else {
                    let patch = &row.view.patches[number as usize - 1];
                    self.lone_point(row, patch, &row.surfaces[patch.surface as usize], x, px, py)
                };
        }
        grey
    }

    /// The sky, at infinity: equal in both images.
    #[inline]
    fn sky(&self, rig: &Rig, px: f32, py: f32) -> f32 {
        let (dx, dy) =
            ((px - rig.cx_px as f32) / rig.focal_px as f32, (py - rig.cy_px as f32) / rig.focal_px as f32);
        match &self.to_world {
            Some(axes) => self.turned_sky(direction(axes, dx, dy)),
            None => self.clouded(self.texture.sample(dx * CLOUDS.0, dy * CLOUDS.1, 0.2, 0.4), dy),
        }
    }

    /// The sky `down` below the horizon (above it negative, as tangent), with a value of the clouds' texture.
    #[inline]
    fn clouded(&self, cloud: f32, down: f32) -> f32 {
        let light = &self.light;
        light.sky - light.sky_rise * down + light.clouds * cloud * (light.sky / 205.0)
    }

    /// The sky in a direction of the world.
    #[inline]
    fn turned_sky(&self, (right_rad, down): (f32, f32)) -> f32 {
        self.clouded(self.texture.sample(right_rad * CLOUDS.2, down * CLOUDS.1, 0.2, 0.4), down)
    }

    /// The sky in pixels of row `y` from column `from` on. Where the vehicle turns, directions between every 16th pixel are
    /// interpolated: they differ by less than a hundredth of a texel.
    fn sky_run(&self, rig: &Rig, from: usize, y: f32, grey: &mut [f32]) {
        let Some(axes) = &self.to_world else {
            grey.iter_mut().zip(from..).for_each(|(grey, x)| *grey = self.sky(rig, x as f32, y));
            return;
        };
        let at = |x: usize| {
            let (dx, dy) = (x as f32 - rig.cx_px as f32, y - rig.cy_px as f32);
            direction(axes, dx / rig.focal_px as f32, dy / rig.focal_px as f32)
        };
        let mut a = at(from);
        for (block, grey) in grey.chunks_mut(16).enumerate() {
            let b = at(from + 16 * block + 16);
            // Behind the vehicle's first direction the angle jumps by a full turn, as does the texture.
            let turn = b.0 - a.0;
            let turn = turn - std::f32::consts::TAU * (turn / std::f32::consts::TAU).round();
            for (k, grey) in grey.iter_mut().enumerate() {
                let share = k as f32 / 16.0;
                *grey = self.turned_sky((a.0 + share * turn, a.1 + share * (b.1 - a.1)));
            }
            a = b;
        }
    }

    /// [`Self::point`], not inlined: for rare cases where code size matters more than speed.
    #[inline(never)]
    fn lone_point(&self, row: &Row<'_>, patch: &Patch, surface: &Surface, x: usize, px: f32, py: f32) -> f32 {
        self.point(row, patch, surface, x, px, py)
    }

    #[inline(always)]
    fn point(&self, row: &Row<'_>, patch: &Patch, surface: &Surface, x: usize, px: f32, py: f32) -> f32 {
        let rig = &row.camera.rig;
        let per_px = 1.0 / rig.focal_px as f32;
        let (dx, dy) = ((px - rig.cx_px as f32) * per_px, (py - rig.cy_px as f32) * per_px);
        let inverse = patch.inverse();
        let inverse_z = (inverse[0] as f32 * dx + inverse[1] as f32 * dy + inverse[2] as f32).max(1e-4);
        let z = 1.0 / inverse_z;
        let (z_right, z_down) = (-z * z * inverse[0] as f32 * per_px, -z * z * inverse[1] as f32 * per_px);
        let along = |g: &[f32; 3]| g[0] * dx + g[1] * dy + g[2];
        let (a, b) = (along(&patch.u), along(&patch.v));
        let change = |g: f32, along: f32, z_change: f32| (g * per_px * z + along * z_change).abs();
        let hit = Hit {
            u: a * z + patch.u_start,
            v: b * z + patch.v_start,
            span_u: change(patch.u[0], a, z_right) + 0.35 * change(patch.u[1], a, z_down),
            span_v: change(patch.v[0], b, z_right).max(change(patch.v[1], b, z_down)),
        };
        let material = &surface.material;
        let light = &self.light;
        let mut bright = light.ambient + light.sun * surface.sunlit;
        if matches!(material.look, Look::Road | Look::Grass | Look::Paving) {
            let shadow = row.shade.shadow[x];
            bright -= shadow * (0.25 * light.ambient + light.sun * surface.sunlit);
            bright += row.shade.pool[x];
        }
        if light.headlamps > 0.0 {
            let facing = patch.plane_m * inverse_z / (1.0 + dx * dx + dy * dy).sqrt();
            bright += light.lamps_at(dx, dy, z, facing);
        }
        let mut grey = material.grey(hit, &self.texture, &self.style) * bright;
        if light.lamps {
            grey += material.glow;
        }
        if matches!(material.look, Look::Road | Look::Paving) && (row.mirror.is_some() || light.sheen > 0.0) {
            grey = self.thrown_back(row, grey, patch.plane_m * inverse_z, (x, dx, dy), (px, py));
        }
        light.through_air(grey, z)
    }

    /// Grey value of the ground with its reflections of sky, lamps and objects; `steep` is approximately the sine
    /// of the viewing angle.
    #[inline(never)]
    fn thrown_back(
        &self,
        row: &Row<'_>,
        grey: f32,
        steep: f32,
        (x, dx, dy): (usize, f32, f32),
        (px, py): (f32, f32),
    ) -> f32 {
        let light = &self.light;
        let flat = (1.0 - steep).clamp(0.0, 1.0);
        let flat = flat * flat * flat * flat;
        // Puddles and rough patches follow the asphalt's texture.
        let patchy = grey - 50.0;
        let mut grey = grey;
        // Only towards a sun ahead.
        if light.sheen > 0.0 && light.towards_sun[2] > 0.05 {
            let to = light.towards_sun;
            let off = (dx - (to[0] / to[2]) as f32) / 0.16;
            grey += light.sheen * (0.8 + 0.012 * patchy).clamp(0.3, 2.0) * flat
                / (1.0 + off * off)
                / (1.0 + 12.0 * dy.max(0.0));
        }
        let Some(mirror) = row.mirror else { return grey };
        let share = self.style.wet * (0.04 + 0.62 * flat) * (0.8 + 0.006 * patchy).clamp(0.2, 1.0);
        let number = mirror.seen[x];
        let seen = if number == 0 {
            let level = row.camera.level();
            self.sky(&level, px, 2.0 * level.cy_px as f32 - py)
        } else {
            let patch = &mirror.view.patches[number as usize - 1];
            self.lone_point(row, patch, &mirror.surfaces[patch.surface as usize], x, px, py)
        };
        grey + share * (seen.min(600.0) - grey)
    }
}
