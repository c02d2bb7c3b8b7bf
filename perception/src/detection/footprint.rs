//! What the stixels of a region show of it on the ground.

use super::stixels::{STRIP_COLUMNS, Stixel};
use crate::region::{DEPTH_BLUR_PX, Footprint};
use crate::rig::Rig;

/// Smallest disparity of a stixel of a region, in px, where its place is computed.
const MIN_SIDE_PX: f64 = 0.1;

/// What stixels show of a thing on the ground: each counts at its own depth, none nearer than the near side. The near face is what is
/// as near as the blur of the matcher tells. `change_px`: by how much both images have changed the disparity of the near side, and so
/// that of all stixels.
pub(super) fn footprint<'a>(
    members: impl Iterator<Item = &'a Stixel>,
    near_px: f64,
    change_px: f64,
    rig: &Rig,
) -> Footprint {
    let nowhere = [f64::INFINITY, f64::NEG_INFINITY];
    let mut seen = Footprint { ends_m: nowhere, depth_m: [0.0; 2], face_m: nowhere };
    let near_px = near_px.max(MIN_SIDE_PX);
    let near_m = rig.distance_m(near_px);
    for stixel in members {
        let disparity_px = (f64::from(stixel.disparity_px) + change_px).clamp(MIN_SIDE_PX, near_px);
        let distance_m = rig.distance_m(disparity_px);
        let columns = [stixel.strip, stixel.strip + 1].map(|strip| f64::from(strip) * STRIP_COLUMNS as f64);
        let [first_m, end_m] = columns.map(|column| rig.lateral_m(column, distance_m));
        let is_near = near_px - disparity_px <= DEPTH_BLUR_PX;
        let depth_m = if is_near { 0.0 } else { distance_m - near_m };
        if first_m < seen.ends_m[0] {
            (seen.ends_m[0], seen.depth_m[0]) = (first_m, depth_m);
        }
        if end_m > seen.ends_m[1] {
            (seen.ends_m[1], seen.depth_m[1]) = (end_m, depth_m);
        }
        if is_near {
            seen.face_m = [seen.face_m[0].min(first_m), seen.face_m[1].max(end_m)];
        }
    }
    if seen.face_m[0] > seen.face_m[1] {
        // No stixel is as near as the side that the pixels show: nothing is known of its outline.
        Footprint { depth_m: [0.0; 2], face_m: seen.ends_m, ..seen }
    } else {
        seen
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const RIG: Rig = Rig { focal_px: 879.0, baseline_m: 0.12, cx_px: 320.0, cy_px: 240.0 };

    /// Where a point is seen that is `x` metres to the right and `z` ahead.
    fn column(x: f64, z: f64) -> f64 {
        RIG.cx_px + RIG.focal_px * x / z
    }

    /// Stixels of points on the ground: metres to the right and ahead.
    fn stixels(points: impl Iterator<Item = (f64, f64)>) -> Vec<Stixel> {
        points
            .map(|(x, z)| Stixel {
                strip: (column(x, z) / STRIP_COLUMNS as f64) as u32,
                top: 200,
                bottom: 260,
                rows: 60,
                disparity_px: RIG.disparity_px(z) as f32,
                confidence: 200.0,
                high_m: 1.4,
                low_m: 0.1,
            })
            .collect()
    }

    #[test]
    fn a_side_that_runs_away_is_where_it_is_and_not_where_the_box_is() {
        // A car on the right, its left side 1.5 m from the axis and 6 to 10 m away, its rear 1.8 m wide.
        let side = (0..=20).map(|i| (1.5, 6.0 + 0.2 * f64::from(i)));
        let rear = (0..=20).map(|i| (1.5 + 0.09 * f64::from(i), 6.0));
        let stixels = stixels(side.chain(rear));
        let Footprint { ends_m: [left_m, right_m], depth_m, face_m } =
            footprint(stixels.iter(), RIG.disparity_px(6.0), 0.0, &RIG);
        assert!((left_m - 1.5).abs() < 0.06 && (right_m - 3.3).abs() < 0.06, "{left_m} {right_m}");
        assert!(depth_m[1] == 0.0 && (face_m[1] - right_m).abs() < 1e-9, "{depth_m:?} {face_m:?}");
        let box_left_m = RIG.lateral_m(column(1.5, 10.0), 6.0);
        assert!(box_left_m < 1.0, "the box reaches to {box_left_m} m");
    }

    #[test]
    fn of_a_car_that_is_turned_a_corner_is_nearest() {
        // A corner at 2 m to the right and 8 m ahead; the rear runs away to the right, the side to the left.
        let rear = (0..=20).map(|i| (2.0 + 0.08 * f64::from(i), 8.0 + 0.04 * f64::from(i)));
        let side = (0..=20).map(|i| (2.0 - 0.09 * f64::from(i), 8.0 + 0.18 * f64::from(i)));
        let stixels = stixels(rear.chain(side));
        let Footprint { ends_m, depth_m, face_m } =
            footprint(stixels.iter(), RIG.disparity_px(8.0), 0.0, &RIG);
        let near = |a: [f64; 2], b: [f64; 2], m: f64| (a[0] - b[0]).abs() < m && (a[1] - b[1]).abs() < m;
        assert!(near(ends_m, [0.2, 3.6], 0.08), "{ends_m:?}");
        assert!(near(depth_m, [3.6, 0.8], 0.2), "{depth_m:?}");
        // What differs by less than the blur of the matcher is as near as the corner: 0.2 m here.
        assert!(near(face_m, [1.9, 2.45], 0.15), "{face_m:?}");
    }

    #[test]
    fn a_refined_disparity_moves_both_ends_to_their_place() {
        // A face from 3 to 4.8 m to the right; the matcher finds all of it 0.2 px too far, or too near.
        let face = || (0..=60).map(|i| (3.0 + 0.03 * f64::from(i), 40.0));
        for error_px in [-0.2, 0.2] {
            let mut stixels = stixels(face());
            stixels.iter_mut().for_each(|s| s.disparity_px += error_px as f32);
            let seen = footprint(stixels.iter(), RIG.disparity_px(40.0), -error_px, &RIG);
            let near = |a: f64, b: f64| (a - b).abs() < 0.2;
            assert!(near(seen.ends_m[0], 3.0) && near(seen.ends_m[1], 4.8), "{seen:?}");
            assert!(seen.depth_m == [0.0; 2] && seen.face_m == seen.ends_m, "{seen:?}");
        }
    }
}
