//! Static points on a thing measure its speed over ground: zero-velocity updates.
//!
//! The inliers of odometry are static points of the scene. Where several lie on a thing, at its distance, the thing is static, too; the
//! error of its speed is the smallest one that would have moved them visibly. The box does not matter: that of a parked car
//! that leaves the picture, or of a fence of which each frame shows another part, moves; the points on it do not. Where they contradict
//! the image of a thing that moves, several frames have to agree ([`super::track::Track::may_rest`]).

use super::parameters::{
    STANDING_SPEED_M_S, STATIC_GATE_PX, STATIC_GATE_SHARE, STATIC_MARGINS, STATIC_MAX_DEPTH_M,
    STATIC_MIN_POINTS, STATIC_MOVING_SHARE, STATIC_TOLERANCE_PX,
};
use crate::motion::planar::Planar;
use crate::motion::scene_point::ScenePoint;
use crate::region::Region;
use crate::rig::Rig;

/// Standard deviation with which the speed of a sighted thing to the right and forward is known to be 0, in m/s; `None` where the
/// points do not tell. `elapsed_s`: time since the frame before.
pub(super) fn speed_sigma_m_s(
    region: &Region,
    points: &[ScenePoint],
    rig: &Rig,
    elapsed_s: f64,
) -> Option<Planar> {
    let scale = rig.focal_px * rig.baseline_m;
    let gate_px = STATIC_GATE_PX + STATIC_GATE_SHARE * region.disparity_px;
    // Where the gate is deep, points of the background pass it, too.
    if gate_px * region.distance_m * region.distance_m > STATIC_MAX_DEPTH_M * scale || elapsed_s <= 0.0 {
        return None;
    }
    let b = &region.bounds;
    let [x, y, width, height] = [b.x, b.y, b.width, b.height].map(f64::from);
    let (side_px, foot_px) = (STATIC_MARGINS[0] * width, STATIC_MARGINS[1] * height);
    let is_on_it = |point: &&ScenePoint| {
        let [column, row] = point.at_px;
        (x + side_px..x + width - side_px).contains(&column)
            && (y..y + height - foot_px).contains(&row)
            && (scale / point.distance_m.max(0.1) - region.disparity_px).abs() <= gate_px
    };
    let (mut fixed, mut moving) = (0_u32, 0_u32);
    // Sums of the squared displacements of a point for 1 m/s, in px.
    let mut displacement = [0.0; 2];
    for point in points.iter().filter(is_on_it) {
        if !point.is_static {
            moving += 1;
            continue;
        }
        fixed += 1;
        let [column, row] = point.at_px;
        let step = elapsed_s / point.distance_m.max(0.1);
        displacement[0] += (rig.focal_px * step).powi(2);
        displacement[1] += ((column - rig.cx_px).powi(2) + (row - rig.cy_px).powi(2)) * step * step;
    }
    if fixed < STATIC_MIN_POINTS || f64::from(moving) > STATIC_MOVING_SHARE * f64::from(fixed) {
        return None;
    }
    let sigma_m_s = |sum: f64| STATIC_TOLERANCE_PX / (sum / f64::from(fixed)).sqrt().max(1e-9);
    Some(displacement.map(|sum| sigma_m_s(sum).hypot(STANDING_SPEED_M_S)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::outline::Outline;
    use crate::region::PixelBox;

    const RIG: Rig = Rig { focal_px: 984.0, baseline_m: 0.537, cx_px: 696.0, cy_px: 240.0 };

    /// A thing 10 m away whose box is 200 px wide and 100 px high.
    fn thing(distance_m: f64) -> Region {
        Region {
            bounds: PixelBox { x: 300, y: 200, width: 200, height: 100 },
            disparity_px: RIG.disparity_px(distance_m),
            disparity_sigma_px: 0.1,
            distance_m,
            lateral_m: 0.0,
            width_m: 2.0,
            height_m: 1.0,
            inset_m: [0.0; 2],
            is_hidden: [false; 2],
            goes_on: [false; 2],
            outline: Outline::default(),
            pixels: 100,
            confidence: 0.9,
            evidence: 5.0,
        }
    }

    fn points(count: usize, at_px: [f64; 2], distance_m: f64, is_static: bool) -> Vec<ScenePoint> {
        (0..count)
            .map(|k| ScenePoint { at_px: [at_px[0] + 10.0 * k as f64, at_px[1]], distance_m, is_static })
            .collect()
    }

    fn sigma(points: &[ScenePoint]) -> Option<Planar> {
        speed_sigma_m_s(&thing(10.0), points, &RIG, 0.1)
    }

    #[test]
    fn points_on_a_thing_tell_its_speed_as_exactly_as_their_motion_would_be_seen() {
        let [across, along] = sigma(&points(4, [350.0, 240.0], 10.1, true)).expect("they tell");
        // 1 m/s across moves a point by 9.8 px in a frame, along by 3.3 px.
        assert!((0.4..0.45).contains(&across) && (0.45..0.6).contains(&along), "{across} {along}");
        let mut narrow = thing(10.0);
        narrow.bounds.x = 650;
        let ahead = points(4, [680.0, 238.0], 10.0, true);
        let [across, along] = speed_sigma_m_s(&narrow, &ahead, &RIG, 0.1).expect("they tell");
        assert!(across < 0.45 && along > 4.0, "straight ahead: {across} {along}");
    }

    #[test]
    fn what_is_not_on_the_thing_tells_nothing_of_it() {
        assert!(sigma(&points(3, [350.0, 240.0], 10.0, true)).is_some());
        assert_eq!(sigma(&points(2, [350.0, 240.0], 10.0, true)), None, "too few");
        assert_eq!(sigma(&points(4, [350.0, 240.0], 12.0, true)), None, "the wall behind");
        assert_eq!(sigma(&points(4, [350.0, 295.0], 10.0, true)), None, "the ground at its foot");
        assert_eq!(sigma(&points(2, [301.0, 240.0], 10.0, true)), None, "at its side");
        let far = thing(60.0);
        assert_eq!(speed_sigma_m_s(&far, &points(4, [350.0, 240.0], 60.0, true), &RIG, 0.1), None);
        let mut mixed = points(4, [350.0, 240.0], 10.0, true);
        mixed.extend(points(2, [350.0, 220.0], 10.0, false));
        assert_eq!(sigma(&mixed), None, "some of them move");
        assert_eq!(sigma(&points(4, [350.0, 240.0], 10.0, false)), None);
    }
}
