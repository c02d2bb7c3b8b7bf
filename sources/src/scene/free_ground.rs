//! Ground truth of the free ground, by column of the left image.

use super::truth::{FIRST_OBJECT, FreeGround, ROAD, RoadTruth};
use super::view::Pose;
use perception::rig::Rig;

/// What hangs higher above the road blocks nothing, in metres: the vehicle drives below it.
const CLEARANCE_M: f64 = 2.2;

impl FreeGround {
    /// Free ground by the owner and the disparity of each pixel.
    pub fn new(
        owner: &[u16],
        disparity_px: &[f32],
        width: usize,
        rig: &Rig,
        pose: &Pose,
        road: &RoadTruth,
    ) -> Self {
        let scale = rig.focal_px * rig.baseline_m;
        let height = owner.len() / width.max(1);
        let mut free = Self { free_m: vec![0.0; width], blocked_m: vec![f32::INFINITY; width] };
        let [right, down, ahead] = pose.axes();
        for x in 0..width {
            let mut is_unbroken = true;
            for y in (0..height).rev() {
                let i = y * width + x;
                if owner[i] == 0 {
                    break;
                }
                let z = scale / f64::from(disparity_px[i]);
                if owner[i] < FIRST_OBJECT {
                    is_unbroken &= owner[i] == ROAD;
                    if is_unbroken {
                        free.free_m[x] = z as f32;
                    }
                    continue;
                }
                is_unbroken = false;
                let (dx, dy) = ((x as f64 - rig.cx_px) / rig.focal_px, (y as f64 - rig.cy_px) / rig.focal_px);
                let axis = |k: usize| (right[k] * dx + down[k] * dy + ahead[k]) * z;
                if pose.height_m() + axis(1) - road.height_m(axis(2)) < CLEARANCE_M {
                    free.blocked_m[x] = z as f32;
                    break;
                }
            }
            free.free_m[x] = free.free_m[x].min(free.blocked_m[x]);
        }
        free
    }
}
