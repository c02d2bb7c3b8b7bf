//! Computes the ground truth of a frame from the world's geometry.

use super::Scene;
use super::truth::{FIRST_OBJECT, FreeGround, ObjectTruth, ROAD, RoadTruth, SceneTruth};
use super::view::{Camera, MIDDLE, Surface, View};
use super::world::Present;
use perception::region::PixelBox;

/// Depth buffer at the pixel centres: 1/z and the patch number from 1.
struct Map {
    view: View,
    inverse_z: Vec<f32>,
    number: Vec<u32>,
}

impl Map {
    fn new(camera: &Camera, surfaces: &[Surface]) -> Self {
        let (width, height) = camera.size;
        let mut view = View::default();
        view.project(camera, surfaces);
        let (mut depth, mut seen) = ([vec![0.0; width]], [vec![0; width]]);
        let (mut inverse_z, mut number) = (Vec::new(), Vec::new());
        // Above the first patch and below the last there is nothing.
        let rows = view.rows();
        inverse_z.resize(rows.start * width, 0.0);
        number.resize(rows.start * width, 0);
        for y in rows {
            view.row(camera, y, &MIDDLE, &mut depth, &mut seen);
            inverse_z.extend_from_slice(&depth[0]);
            number.extend_from_slice(&seen[0]);
        }
        inverse_z.resize(height * width, 0.0);
        number.resize(height * width, 0);
        Self { view, inverse_z, number }
    }
}

/// Statistics of the pixels of one object.
#[derive(Clone, Copy)]
struct PixelStats {
    pixels: u32,
    both: u32,
    nearest: f32,
    x: (u32, u32),
    y: (u32, u32),
}

/// Ground truth of each pixel, row by row, and the pixel statistics of each instance.
struct PixelTruth {
    disparity_px: Vec<f32>,
    in_both: Vec<bool>,
    owner: Vec<u16>,
    stats: Vec<PixelStats>,
}

impl Scene {
    /// The ground truth of the current state of the world.
    pub(super) fn survey(&self, index: u64) -> SceneTruth {
        let world = &self.world;
        let time_s = self.time_s(index);
        let left_camera = self.camera(false);
        let (width, height) = world.size;
        let PixelTruth { disparity_px, in_both, owner, stats } = self.pixel_truth(&left_camera);
        let mut objects: Vec<ObjectTruth> = world
            .present
            .iter()
            .filter(|present| stats[present.instance].pixels > 0)
            .map(|present| self.object_truth(present, stats[present.instance], &left_camera, time_s))
            .collect();
        objects.sort_by(|a, b| a.distance_m.total_cmp(&b.distance_m).then(a.id.cmp(&b.id)));
        let motion = world.motion(time_s);
        let road = self.road_truth(&left_camera, time_s);
        let free = FreeGround::new(&owner, &disparity_px, width, &world.rig, &world.pose(time_s), &road);
        SceneTruth {
            time_s,
            ego_speed_m_s: motion.speed_m_s,
            motion,
            width,
            height,
            disparity_px,
            in_both,
            owner,
            objects,
            road,
            boundaries: world.boundaries(|instance| stats[instance].pixels),
            free,
        }
    }

    fn pixel_truth(&self, left_camera: &Camera) -> PixelTruth {
        let world = &self.world;
        let rig = world.rig;
        let (width, height) = world.size;
        let left = Map::new(left_camera, &world.surfaces);
        let right = Map::new(&self.camera(true), &world.surfaces);
        // The patch of each surface in the right image.
        let mut right_patch = vec![u16::MAX; world.surfaces.len()];
        for (patch, k) in right.view.patches.iter().zip(0..) {
            right_patch[patch.surface as usize] = k;
        }
        let scale = (rig.focal_px * rig.baseline_m) as f32;
        let mut disparity_px = vec![0.0; width * height];
        let mut in_both = vec![false; width * height];
        let mut owner = vec![0; width * height];
        let none = PixelStats { pixels: 0, both: 0, nearest: 0.0, x: (u32::MAX, 0), y: (u32::MAX, 0) };
        let mut stats = vec![none; world.instances().len()];
        for i in 0..width * height {
            let (x, y) = (i % width, i / width);
            if left.number[i] == 0 {
                // Sky: at infinity, so at the same pixel of the right image unless something occludes it there.
                in_both[i] = right.number[i] == 0;
                continue;
            }
            let patch = &left.view.patches[left.number[i] as usize - 1];
            disparity_px[i] = left.inverse_z[i] * scale;
            owner[i] = world.surfaces[patch.surface as usize].owner;
            // The right pixel onto which the point projects: visible there unless something nearer occludes it.
            let column = x as f64 - f64::from(disparity_px[i]);
            let nearest = column.round();
            let right_index = right_patch[patch.surface as usize];
            if nearest >= 0.0 && column <= (width - 1) as f64 && right_index != u16::MAX {
                let k = y * width + nearest as usize;
                let same_surface = &right.view.patches[usize::from(right_index)];
                let (dx, dy) = ((nearest - rig.cx_px) / rig.focal_px, (y as f64 - rig.cy_px) / rig.focal_px);
                let own = same_surface.inverse_z(dx, dy);
                in_both[i] = f64::from(right.inverse_z[k]) <= own * 1.001 + 1e-5;
            }
            if owner[i] >= FIRST_OBJECT {
                let s = &mut stats[usize::from(owner[i] - FIRST_OBJECT)];
                s.pixels += 1;
                s.both += u32::from(in_both[i]);
                s.nearest = s.nearest.max(left.inverse_z[i]);
                s.x = (s.x.0.min(x as u32), s.x.1.max(x as u32));
                s.y = (s.y.0.min(y as u32), s.y.1.max(y as u32));
            }
        }
        PixelTruth { disparity_px, in_both, owner, stats }
    }

    fn object_truth(
        &self,
        present: &Present,
        stats: PixelStats,
        left_camera: &Camera,
        time_s: f64,
    ) -> ObjectTruth {
        let world = &self.world;
        let (from, to) = world.file.road.edges_m;
        let instance = &world.instances()[present.instance];
        let id = FIRST_OBJECT + present.instance as u16;
        let half = present.size_m[0] / 2.0;
        let whole = if instance.subject { self.silhouette(left_camera, id) } else { stats.pixels };
        let step = 0.01;
        let ahead = |t: f64| world.ahead_m(instance, t);
        let across = present.across_m;
        let footprint = world.footprint(present, time_s);
        let distance_m = 1.0 / f64::from(stats.nearest);
        ObjectTruth {
            id,
            class: instance.class,
            subject: instance.subject,
            distance_m,
            lateral_m: present.lateral_m,
            width_m: present.size_m[0],
            height_m: present.size_m[1],
            along_m: footprint.along_m.unwrap_or(distance_m),
            closing_m_s: (ahead(time_s - step) - ahead(time_s + step)) / (2.0 * step),
            bounds: PixelBox {
                x: stats.x.0,
                y: stats.y.0,
                width: stats.x.1 - stats.x.0 + 1,
                height: stats.y.1 - stats.y.0 + 1,
            },
            pixels: stats.pixels,
            visible: f64::from(stats.pixels) / f64::from(whole.max(stats.pixels)),
            seen_by_both: f64::from(stats.both) / f64::from(stats.pixels),
            in_path: footprint.in_path,
            on_road: across + half > from && across - half < to,
        }
    }

    /// Pixels that an object would have without occlusion.
    fn silhouette(&self, camera: &Camera, id: u16) -> u32 {
        let own: Vec<Surface> = self.world.surfaces.iter().filter(|s| s.owner == id).copied().collect();
        Map::new(camera, &own).number.iter().filter(|&&number| number > 0).count() as u32
    }

    fn road_truth(&self, camera: &Camera, time_s: f64) -> RoadTruth {
        let world = &self.world;
        let rig = world.rig;
        let ground = &world.surfaces[..world.ground_surfaces];
        let map = Map::new(camera, ground);
        let (width, height) = world.size;
        let column = (rig.cx_px.round().max(0.0) as usize).min(width - 1);
        let rows_px = (0..height)
            .map(|y| {
                let i = y * width + column;
                let seen = (map.number[i] as usize).checked_sub(1).map(|k| map.view.patches[k].surface);
                let road = seen.is_some_and(|surface| ground[surface as usize].owner == ROAD);
                if road { map.inverse_z[i] * (rig.focal_px * rig.baseline_m) as f32 } else { 0.0 }
            })
            .collect();
        let profile_m = (0..=240).map(|k| world.road_ahead_m(time_s, f64::from(k) / 2.0)).collect();
        RoadTruth { rows_px, profile_m }
    }
}
