//! The side of a thing that runs away from the camera belongs to it.
//!
//! The side of a near car is seen at a shallow angle: disparity changes by several px from column to column, the matcher leaves
//! gaps, and the side comes apart into regions of its own behind the near face. On the ground they lie within the
//! rectangle that the thing covers: as wide as its face, and as long as such a thing may be. They are joined with it.
//!
//! Far away depth does not tell a side from what stands behind the thing, and nothing is joined.

use super::stixels::STRIP_COLUMNS;
use crate::outline::BODY_LENGTH_M;
use crate::region::Region;
use crate::rig::Rig;

/// A thing is at most [`BODY_LENGTH_M`] long, and this many times its width.
const LENGTH_BY_WIDTH: f64 = 3.0;
/// Smallest difference of disparity that this length makes where sides are joined, in px.
const MIN_DEPTH_PX: f64 = 0.75;
/// Share of the width of a side that lies within the thing.
const INSIDE_SHARE: f64 = 0.7;
/// Bounds of how far a side may reach beyond the thing, in metres: the error of its place, and a mirror or an open door. Between them it
/// is half of the thing's width: who comes out from behind a wall that is seen edge on is no side of it.
const MARGIN_M: (f64, f64) = (0.1, 0.25);
/// Largest gap between the boxes of a thing and its side, in px: two strips.
const MAX_GAP_PX: u32 = 2 * STRIP_COLUMNS as u32;
/// A side is at most this much higher than the thing, as a share of its height; nor does it reach as much below its foot.
const HEIGHT_SHARE: f64 = 0.15;
/// Evidence from which a thing has sides.
const MIN_OWNER_EVIDENCE: f64 = 3.0;

/// Joins the sides of things with them. The regions are then sorted, nearest first.
pub(super) fn join_sides(regions: &mut Vec<Region>, rig: &Rig) {
    regions
        .sort_unstable_by(|a, b| b.disparity_px.total_cmp(&a.disparity_px).then(a.bounds.x.cmp(&b.bounds.x)));
    let mut near = 0;
    while near < regions.len() {
        let thing = regions[near];
        let depth_px = thing.disparity_px - rig.disparity_px(thing.distance_m + BODY_LENGTH_M);
        let has_sides = depth_px >= MIN_DEPTH_PX && thing.evidence > MIN_OWNER_EVIDENCE;
        let mut far = near + 1;
        while has_sides && far < regions.len() {
            if is_side(&regions[far], &regions[near]) {
                let side = regions.remove(far);
                regions[near].join(&side, rig);
            } else {
                far += 1;
            }
        }
        near += 1;
    }
}

/// Whether a region is the side of a nearer one, or a part of that.
fn is_side(far: &Region, near: &Region) -> bool {
    let length_m = BODY_LENGTH_M.min(LENGTH_BY_WIDTH * near.width_m);
    let behind_m = far.distance_m - near.distance_m;
    let ([left_m, right_m], [side_left_m, side_right_m]) = (near.ends_m(), far.ends_m());
    let margin_m = ((right_m - left_m) / 2.0).clamp(MARGIN_M.0, MARGIN_M.1);
    let inside_m = side_right_m.min(right_m + margin_m) - side_left_m.max(left_m - margin_m);
    let (a, b) = (&near.bounds, &far.bounds);
    let gap = a.x.saturating_sub(b.x + b.width).max(b.x.saturating_sub(a.x + a.width));
    let tolerance = HEIGHT_SHARE * f64::from(a.height);
    let above = f64::from(a.y) - f64::from(b.y);
    let below = f64::from(b.y + b.height) - f64::from(a.y + a.height);
    (0.0..=length_m).contains(&behind_m)
        && inside_m >= INSIDE_SHARE * (side_right_m - side_left_m)
        && gap <= MAX_GAP_PX
        && above <= tolerance
        && below <= tolerance
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::outline::Outline;
    use crate::region::PixelBox;

    const KITTI: Rig = Rig { focal_px: 984.0, baseline_m: 0.537, cx_px: 696.0, cy_px: 240.0 };

    /// A region between two lateral positions, at a distance, 1.4 m high.
    fn face(ends_m: [f64; 2], distance_m: f64, evidence: f64) -> Region {
        let column = |x_m: f64| (KITTI.cx_px + KITTI.focal_px * x_m / distance_m).round() as u32;
        let row = |down_m: f64| (KITTI.cy_px + KITTI.focal_px * down_m / distance_m).round() as u32;
        let (x, y) = (column(ends_m[0]), row(0.25));
        let bounds = PixelBox { x, y, width: column(ends_m[1]) - x, height: row(1.65) - y };
        Region {
            bounds,
            disparity_px: KITTI.disparity_px(distance_m),
            distance_m,
            lateral_m: (ends_m[0] + ends_m[1]) / 2.0,
            width_m: ends_m[1] - ends_m[0],
            height_m: 1.4,
            pixels: bounds.width * bounds.height,
            evidence,
            disparity_sigma_px: 0.1,
            inset_m: [0.0; 2],
            is_hidden: [false; 2],
            goes_on: [false; 2],
            outline: Outline::default(),
            confidence: 0.9,
        }
    }

    #[test]
    fn the_side_of_a_near_car_belongs_to_it() {
        // A parked car on the left, and what is seen of its right side: its door from 6 m, its front wheel from 8 m on.
        let car = face([-3.5, -1.8], 5.0, 6.0);
        let (door, wheel) = (face([-2.6, -1.8], 6.6, 5.5), face([-2.3, -1.8], 8.4, 4.0));
        let mut regions = vec![wheel, car, door];
        join_sides(&mut regions, &KITTI);
        assert_eq!(regions.len(), 1, "{regions:?}");
        let whole = regions[0];
        assert_eq!((whole.distance_m, whole.evidence), (5.0, 6.0));
        assert_eq!(whole.bounds.x + whole.bounds.width, wheel.bounds.x + wheel.bounds.width);
        // The box has its side, the thing itself is as wide as before.
        let [left_m, right_m] = whole.ends_m();
        assert!((left_m + 3.5).abs() < 0.01 && (right_m + 1.8).abs() < 0.01, "{left_m} to {right_m} m");
    }

    #[test]
    fn what_stands_beside_or_behind_a_thing_is_no_side_of_it() {
        let car = face([-3.5, -1.8], 5.0, 6.0);
        for (other, why) in [
            (face([-1.6, -1.1], 7.0, 4.0), "a walker beside its door"),
            (face([-2.6, -1.8], 9.7, 4.0), "the next car"),
            (face([-2.2, -1.8], 4.6, 4.0), "in front of it"),
            (
                Region {
                    bounds: PixelBox { y: 140, ..face([-2.3, -1.8], 8.0, 4.0).bounds },
                    ..face([-2.3, -1.8], 8.0, 4.0)
                },
                "a tree behind it",
            ),
        ] {
            let mut regions = vec![car, other];
            join_sides(&mut regions, &KITTI);
            assert_eq!(regions.len(), 2, "{why}");
        }
        // The end of a wall that is seen edge on, and who comes out from behind it.
        let mut wall = vec![face([2.4, 2.6], 4.3, 6.0), face([1.9, 2.8], 6.9, 6.0)];
        join_sides(&mut wall, &KITTI);
        assert_eq!(wall.len(), 2);
        // A walker is not as long as a car.
        let mut walkers = vec![face([1.0, 1.5], 6.0, 6.0), face([1.0, 1.5], 8.2, 6.0)];
        join_sides(&mut walkers, &KITTI);
        assert_eq!(walkers.len(), 2);
        // What may be anything has no sides.
        let mut doubtful = vec![face([-3.5, -1.8], 5.0, 1.0), face([-2.6, -1.8], 6.6, 5.5)];
        join_sides(&mut doubtful, &KITTI);
        assert_eq!(doubtful.len(), 2);
    }

    #[test]
    fn where_depth_does_not_tell_nothing_is_joined() {
        let near = Rig { baseline_m: 0.12, ..KITTI };
        let pair = || vec![face([-3.5, -1.8], 26.0, 6.0), face([-3.0, -1.8], 28.0, 6.0)];
        let (mut wide, mut narrow) = (pair(), pair());
        for region in &mut narrow {
            region.disparity_px = near.disparity_px(region.distance_m);
        }
        join_sides(&mut wide, &KITTI);
        join_sides(&mut narrow, &near);
        assert_eq!((wide.len(), narrow.len()), (1, 2));
    }
}
