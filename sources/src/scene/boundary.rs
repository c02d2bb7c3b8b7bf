//! Ground truth of the boundaries beside the road.

use super::truth::{BoundaryTruth, ObjectClass};
use super::world::{Present, World};

/// Farthest piece of a boundary, in metres ahead.
const FARTHEST_M: f64 = 100.0;

/// Pieces farther apart belong to two boundaries, in metres.
const GAP_M: f64 = 0.5;

/// How far the eaves of a house stand out, in metres.
pub const EAVES_M: f64 = 0.3;

impl World {
    /// The boundaries of the current frame; `pixels` gives the number of visible pixels of an instance.
    pub fn boundaries(&self, pixels: impl Fn(usize) -> u32) -> Vec<BoundaryTruth> {
        let mut found: Vec<(usize, BoundaryTruth)> = Vec::new();
        for present in &self.present {
            let instance = &self.instances()[present.instance];
            let Some(row) = instance.row.filter(|_| instance.class.is_boundary()) else { continue };
            let [near, far] = foot(present, instance.class);
            if near[1].max(far[1]) < 0.0 || near[1].min(far[1]) > FARTHEST_M {
                continue;
            }
            let seen = pixels(present.instance) > 0;
            if let Some((_, line)) = found.last_mut().filter(|(own, line)| {
                let end = line.points_m[line.points_m.len() - 1];
                *own == row && (end[0] - near[0]).hypot(end[1] - near[1]) <= GAP_M
            }) {
                line.points_m.push(far);
                line.seen.push(seen);
                line.height_m = line.height_m.max(present.size_m[1]);
            } else {
                let line = BoundaryTruth {
                    class: instance.class,
                    height_m: present.size_m[1],
                    points_m: vec![near, far],
                    seen: vec![seen],
                };
                found.push((row, line));
            }
        }
        found.into_iter().map(|(_, line)| line).collect()
    }
}

/// Both ends of the foot of the side that faces the vehicle.
fn foot(present: &Present, class: ObjectClass) -> [[f64; 2]; 2] {
    let inset = if class == ObjectClass::Building { EAVES_M } else { 0.0 };
    let half = present.size_m[0] / 2.0 - inset;
    let facing = if present.from_path_m > 0.0 { -half } else { half };
    [inset, present.size_m[2] - inset].map(|along| {
        let [x, _, z] = present.placement.place([facing, 0.0, along]);
        [x, z]
    })
}
