//! Boundaries, raised ground and free space in constructed disparity maps.

use super::boundary::{Boundary, Side};
use super::sectors::{FreeEnd, FreeSector};
use crate::depth::DepthView;
use crate::detection::stixel_use::StixelUse;
use crate::motion::Motion;
use crate::motion::body::Body;
use crate::motion::planar::PlanarStep;
use crate::region::Region;
use crate::rig::Rig;
use crate::scene::{SceneDetector, SceneParameters};
use crate::stereo::DisparityView;

const SIZE: (usize, usize) = (640, 480);
const RIG: Rig = Rig { focal_px: 600.0, baseline_m: 0.2, cx_px: 320.0, cy_px: 200.0 };
const CAMERA_HEIGHT_M: f64 = 1.3;
const BODY: Body =
    Body { width_m: 1.8, front_m: 1.7, camera_right_m: 0.0, rear_axle_m: 1.6, camera_yaw_rad: 0.0 };

/// A box on the road: left and right side, near and far end, bottom and top, in metres.
#[derive(Clone, Copy)]
struct Solid([f64; 6]);

impl Solid {
    /// Distance at which the ray through (right, down) a metre ahead enters it.
    fn entry_m(&self, right: f64, down: f64) -> Option<f64> {
        let Self([left, end, near, far, bottom, top]) = *self;
        let mut range = (near, far);
        // Within a slab: from ≤ slope · z ≤ to.
        for (slope, from, to) in [(right, left, end), (down, CAMERA_HEIGHT_M - top, CAMERA_HEIGHT_M - bottom)]
        {
            if slope.abs() < 1e-12 {
                if from > 0.0 || to < 0.0 {
                    return None;
                }
                continue;
            }
            let (a, b) = (from / slope, to / slope);
            range = (range.0.max(a.min(b)), range.1.min(a.max(b)));
        }
        (range.0 <= range.1 && range.0 > 0.0).then_some(range.0)
    }
}

/// A car with a bonnet, a cabin and a boot, its rear left corner here.
fn car(left: f64, near: f64) -> [Solid; 2] {
    let right = left + 1.75;
    [
        Solid([left, right, near, near + 4.3, 0.0, 0.9]),
        Solid([left + 0.1, right - 0.1, near + 0.7, near + 2.9, 0.0, 1.45]),
    ]
}

/// Disparities of a road with these things.
fn map(solids: &[Solid], seed: u64) -> Vec<u16> {
    let mut random = fastrand::Rng::with_seed(seed);
    let mut out = vec![0; SIZE.0 * SIZE.1];
    for (i, out) in out.iter_mut().enumerate() {
        let right = ((i % SIZE.0) as f64 - RIG.cx_px) / RIG.focal_px;
        let down = ((i / SIZE.0) as f64 - RIG.cy_px) / RIG.focal_px;
        let road = if down > 0.0 { CAMERA_HEIGHT_M / down } else { f64::INFINITY };
        let nearest = solids.iter().filter_map(|solid| solid.entry_m(right, down)).fold(road, f64::min);
        let disparity_px = RIG.disparity_px(nearest) + 0.3 * random.f64() - 0.15;
        *out = if disparity_px > 0.5 { (256.0 * disparity_px) as u16 } else { 0 };
    }
    out
}

/// What one frame gives.
struct Seen {
    boundaries: Vec<Boundary>,
    regions: Vec<Region>,
    free: Vec<FreeSector>,
    uses: Vec<(StixelUse, [f64; 2])>,
}

fn detector(confirm: bool) -> SceneDetector {
    let mut parameters = SceneParameters::default();
    parameters.regions.confirm = confirm;
    SceneDetector::new(parameters, RIG, SIZE.0, SIZE.1, 128)
}

fn detect(detector: &mut SceneDetector, map: &[u16]) -> Seen {
    let confidence = vec![255; map.len()];
    let view = DisparityView::new(map, SIZE.0, SIZE.1).unwrap();
    let scene = detector.detect(DepthView::new(view, &confidence).unwrap());
    let (boundaries, regions, free) =
        (scene.boundaries.to_vec(), scene.regions.to_vec(), scene.free.to_vec());
    let places = detector.stixels().list().iter().map(|stixel| super::place(stixel, &RIG));
    let uses = detector.uses().iter().copied().zip(places).collect();
    Seen { boundaries, regions, free, uses }
}

/// One frame without memory.
fn see(solids: &[Solid]) -> Seen {
    detect(&mut detector(false), &map(solids, 1))
}

/// The sector in the direction of a place.
fn sector(free: &[FreeSector], lateral_m: f64, distance_m: f64) -> FreeSector {
    let slope = lateral_m / distance_m;
    *free.iter().find(|sector| sector.left_slope <= slope && slope < sector.right_slope).unwrap()
}

const WALL: Solid = Solid([5.0, 5.3, 2.0, 60.0, 0.0, 1.6]);

#[test]
fn a_wall_is_one_boundary_with_height_and_error() {
    for (wall, side) in [(WALL, Side::Right), (Solid([-4.8, -4.5, 2.0, 60.0, 0.0, 1.6]), Side::Left)] {
        let seen = see(&[wall]);
        let [boundary] = &seen.boundaries[..] else { panic!("{:?}", seen.boundaries) };
        assert_eq!(boundary.side, side);
        assert!(boundary.length_m() > 15.0, "{} m", boundary.length_m());
        let truth = if side == Side::Right { 5.0 } else { -4.5 };
        let near = || boundary.points().iter().filter(|p| p.distance_m < 25.0);
        assert!(near().count() >= 5);
        for point in near() {
            let error = (point.lateral_m - truth).abs();
            assert!(error < 3.0 * point.sigma_m + 0.12 && point.sigma_m < 0.3, "{point:?}");
            assert!((point.height_m - 1.6).abs() < 0.2, "{point:?}");
        }
        // Most of what stands on the ground near it belongs to it.
        let near = || seen.uses.iter().filter(|(_, [_, distance_m])| *distance_m < 25.0);
        let own = near().filter(|(stixel_use, _)| *stixel_use == StixelUse::Boundary).count();
        assert!(10 * own >= 9 * near().count(), "{own} of {}", near().count());
    }
}

#[test]
fn a_guard_rail_above_the_ground_is_a_boundary() {
    let seen = see(&[Solid([3.0, 3.1, 2.0, 60.0, 0.45, 0.8])]);
    let [rail] = &seen.boundaries[..] else { panic!("{:?}", seen.boundaries) };
    let near = rail.points().iter().filter(|p| (6.0..18.0).contains(&p.distance_m));
    for point in near.clone() {
        assert!((point.lateral_m - 3.0).abs() < 0.15 && (point.height_m - 0.8).abs() < 0.15, "{point:?}");
    }
    assert!(near.count() >= 4);
}

#[test]
fn parked_cars_in_a_row_are_no_boundary() {
    for gap_m in [0.9, 1.3] {
        let cars: Vec<Solid> = (0..9).flat_map(|i| car(2.6, 4.0 + f64::from(i) * (4.3 + gap_m))).collect();
        let seen = see(&cars);
        assert_eq!(seen.boundaries, [], "gaps of {gap_m} m");
        assert!(
            seen.regions.iter().filter(|region| region.distance_m < 20.0).count() >= 2,
            "{:?}",
            seen.regions
        );
    }
}

#[test]
fn long_vehicles_beside_and_ahead_are_no_boundary() {
    for bus in [
        Solid([2.2, 4.7, 5.0, 17.0, 0.0, 3.0]),
        Solid([-4.7, -2.2, 4.0, 20.5, 0.3, 2.9]),
        Solid([-1.2, 1.3, 9.0, 21.0, 0.0, 3.0]),
        // Across the way at a junction.
        Solid([-8.0, 8.0, 14.0, 16.5, 0.3, 2.9]),
    ] {
        let seen = see(&[bus]);
        assert_eq!(seen.boundaries, [], "{:?}", bus.0);
        assert!(!seen.regions.is_empty(), "{:?}", bus.0);
    }
}

#[test]
fn a_house_is_a_boundary_and_no_row_of_boxes_and_a_bus_of_that_length_is_none() {
    let side = |height_m| see(&[Solid([4.2, 8.0, 9.0, 16.0, 0.0, height_m])]);
    let (house, bus) = (side(7.0), side(3.2));
    let [boundary] = &house.boundaries[..] else { panic!("{:?}", house.boundaries) };
    assert_eq!(boundary.side, Side::Right);
    assert_eq!(house.regions, [], "its front");
    assert_eq!(bus.boundaries, []);
    assert!(!bus.regions.is_empty());
}

#[test]
fn who_stands_before_a_wall_is_seen() {
    let person = Solid([4.2, 4.7, 11.8, 12.1, 0.0, 1.75]);
    let seen = see(&[WALL, person]);
    let near: Vec<_> = seen.regions.iter().filter(|region| region.distance_m < 25.0).collect();
    let [region] = near[..] else { panic!("{:?}", seen.regions) };
    assert!((region.distance_m - 11.8).abs() < 0.3 && (region.lateral_m - 4.45).abs() < 0.2, "{region:?}");
    assert!(region.width_m < 0.9, "{region:?}");
}

#[test]
fn a_pole_on_a_lawn_is_no_part_of_it() {
    let lawn = Solid([2.6, 30.0, 0.5, 60.0, 0.0, 0.2]);
    let pole = Solid([3.4, 3.7, 9.0, 9.3, 0.0, 4.0]);
    let seen = see(&[lawn, pole]);
    // Of the lawn's corner at the border of the picture something is left.
    let is_inside = |region: &&Region| region.bounds.x + region.bounds.width < 600;
    let near: Vec<_> =
        seen.regions.iter().filter(is_inside).filter(|region| region.distance_m < 12.0).collect();
    let [region] = near[..] else { panic!("{:?}", seen.regions) };
    assert!((region.distance_m - 9.0).abs() < 0.3 && region.width_m < 0.6, "{region:?}");
}

#[test]
fn a_wall_across_the_path_stays_an_obstacle_there() {
    let seen = see(&[Solid([-12.0, 12.0, 15.0, 15.4, 0.0, 1.2])]);
    let [boundary] = &seen.boundaries[..] else { panic!("{:?}", seen.boundaries) };
    assert_eq!(boundary.side, Side::Across);
    let in_path = |region: &&Region| region.lateral_m.abs() < 1.0 && (region.distance_m - 15.0).abs() < 0.7;
    let obstacle = seen.regions.iter().find(in_path).unwrap_or_else(|| panic!("{:?}", seen.regions));
    assert!(obstacle.width_m > 2.4, "it fills the path: {obstacle:?}");
    assert!(sector(&seen.free, 0.0, 10.0).far_m < 15.1);
}

#[test]
fn a_person_before_a_rail_is_no_part_of_it() {
    let rail = Solid([-9.0, 9.0, 9.0, 9.1, 0.0, 0.8]);
    let person = Solid([4.0, 4.5, 8.8, 9.1, 0.0, 1.75]);
    let seen = see(&[rail, person]);
    assert_eq!(seen.boundaries.len(), 1, "{:?}", seen.boundaries);
    let own = |(stixel_use, [lateral_m, _]): &&(StixelUse, [f64; 2])| {
        (4.05..4.45).contains(lateral_m) && stixel_use.is_free()
    };
    let of_rail = |(stixel_use, [lateral_m, _]): &&(StixelUse, [f64; 2])| {
        !(3.5..5.0).contains(lateral_m) && *stixel_use == StixelUse::Boundary
    };
    assert!(seen.uses.iter().any(|stixel| own(&stixel)), "{:?}", seen.uses);
    assert!(seen.uses.iter().filter(of_rail).count() > 50, "{:?}", seen.uses);
}

#[test]
fn a_lawn_behind_a_kerb_is_ground_and_ends_the_free_space() {
    for height_m in [0.14, 0.3] {
        let lawn = Solid([3.2, 30.0, 0.5, 60.0, 0.0, height_m]);
        let seen = see(&[lawn]);
        // Its corner at the border of the picture is left.
        let near = seen.regions.iter().filter(|region| region.distance_m < 25.0);
        assert!(near.count() <= 1, "{height_m} m: {:?}", seen.regions);
        assert_eq!(seen.boundaries, [], "{height_m} m");
        let ray = sector(&seen.free, 3.2, 9.0);
        let ends = [FreeEnd::Edge, FreeEnd::Obstacle].contains(&ray.end);
        assert!(ray.far_m > 6.5 && ray.far_m < 9.9 && ends, "{height_m} m: {ray:?}");
        assert!(sector(&seen.free, 0.0, 10.0).far_m > 25.0);
    }
}

#[test]
fn low_walls_and_bonnets_are_no_ground() {
    let low_wall = Solid([2.4, 4.6, 11.0, 11.3, 0.0, 0.45]);
    let seen = see(&[low_wall]);
    assert!(seen.uses.iter().all(|(stixel_use, [_, z])| *stixel_use != StixelUse::RaisedGround || *z > 25.0));
    assert!(seen.regions.iter().any(|region| (region.distance_m - 11.0).abs() < 0.5), "{:?}", seen.regions);
    let seen = see(&car(2.4, 8.0));
    assert!(seen.uses.iter().all(|(stixel_use, [_, z])| *stixel_use != StixelUse::RaisedGround || *z > 25.0));
}

#[test]
fn boundaries_are_confirmed_and_forgotten_in_seconds_at_any_rate() {
    // After the wall: the empty road, and a lorry that hides most of it.
    let hidden = map(&[Solid([1.5, 4.6, 3.0, 9.0, 0.0, 2.0])], 3);
    for (after, gone_s) in [(map(&[], 3), 0.05..0.55), (hidden, 1.5..2.3)] {
        forget(&map(&[WALL], 2), &after, gone_s);
    }
}

/// Checks how long it takes until a wall is a boundary, and until it is none any more after what is then seen.
fn forget(wall: &[u16], after: &[u16], gone_s: std::ops::Range<f64>) {
    for rate_hz in [10.0, 25.0] {
        let mut detector = detector(true);
        let mut frames = |map: &[u16], wanted: bool| {
            let mut elapsed_s = 0.0;
            for _ in 0..100 {
                detector.set_own_motion(Some(PlanarStep::of(&Motion::default(), &BODY, 1.0 / rate_hz)));
                detector.set_elapsed_s(1.0 / rate_hz);
                let seen = detect(&mut detector, map);
                if seen.boundaries.is_empty() != wanted {
                    return elapsed_s;
                }
                elapsed_s += 1.0 / rate_hz;
            }
            panic!("never at {rate_hz} Hz");
        };
        let until_seen = frames(wall, true);
        let until_gone = frames(after, false);
        assert!((0.2..0.35).contains(&until_seen), "{until_seen} s at {rate_hz} Hz");
        assert!(gone_s.contains(&until_gone), "{until_gone} s of {gone_s:?} at {rate_hz} Hz");
    }
}

#[test]
fn own_motion_carries_a_boundary_along() {
    let motion = Motion { speed_m_s: 12.0, ..Motion::default() };
    let mut detector = detector(true);
    // A wall across the view, 14 m wide, that comes nearer by 1.2 m a frame; the last frames do not show it.
    let mut last = None;
    for frame in 0..9 {
        let distance_m = 26.0 - 1.2 * f64::from(frame);
        let wall = Solid([2.5, 16.0, distance_m, distance_m + 0.3, 0.0, 1.2]);
        let map = if frame < 7 { map(&[wall], u64::from(frame as u32)) } else { map(&[], 9) };
        detector.set_own_motion(Some(PlanarStep::of(&motion, &BODY, 0.1)));
        detector.set_elapsed_s(0.1);
        let seen = detect(&mut detector, &map);
        if frame >= 5 {
            let [boundary] = &seen.boundaries[..] else { panic!("frame {frame}: {:?}", seen.boundaries) };
            assert_eq!(*last.get_or_insert(boundary.id), boundary.id);
            for point in boundary.points() {
                assert!((point.distance_m - distance_m).abs() < 0.6, "frame {frame}: {point:?}");
            }
        }
    }
}

/// A wall of 2.4 m, 4 m to the right, whose end comes nearer by 0.5 m a frame from 36 m on. From 18 m on a van stands beyond its
/// end, as high. Returns, for each frame from the tenth on, the distance of the wall's end and that of the boundary's, in metres.
fn pass_a_wall(is_own_motion_known: bool) -> Vec<(f64, Option<f64>)> {
    let motion = Motion { speed_m_s: 5.0, ..Motion::default() };
    let mut detector = detector(true);
    let frames = (0..50).map(|frame| {
        let end_m = 36.0 - 0.5 * frame as f64;
        let wall = Solid([4.0, 4.3, 1.0, end_m, 0.0, 2.4]);
        let van = Solid([4.0, 5.9, end_m + 0.9, end_m + 5.5, 0.0, 2.4]);
        if is_own_motion_known {
            detector.set_own_motion(Some(PlanarStep::of(&motion, &BODY, 0.1)));
        }
        detector.set_elapsed_s(0.1);
        let seen = detect(&mut detector, &map(&[wall, van][..if end_m > 18.0 { 1 } else { 2 }], frame));
        let own = seen.boundaries.iter().find(|b| b.side == Side::Right);
        let far_m = own.map(|b| b.points().iter().map(|p| p.distance_m).fold(0.0, f64::max));
        (end_m, far_m)
    });
    frames.skip(10).collect()
}

#[test]
fn a_high_wall_stays_one_until_its_last_part_is_passed_and_grows_by_nothing() {
    for (end_m, far_m) in pass_a_wall(true) {
        let far_m = far_m.unwrap_or_else(|| panic!("no wall, its end {end_m} m away"));
        assert!(far_m < end_m + 0.7 && far_m > end_m - 4.0, "{far_m} of {end_m} m");
    }
    // Without own motion it might be a lorry, and ends where it is shorter than one.
    let lost = pass_a_wall(false);
    assert!(lost.iter().any(|(end_m, far_m)| *end_m > 14.0 && far_m.is_none()), "{lost:?}");
}

#[test]
fn free_space_reaches_to_what_stands_and_finds_the_empty_road() {
    let seen = see(&[]);
    for sector in &seen.free[20..60] {
        assert!(sector.near_m < 5.0 && sector.far_m > 30.0, "{sector:?}");
    }
    // Standing things of all kinds and at all distances are never inside.
    for (lateral_m, distance_m, height_m) in
        [(0.0, 8.0, 1.4), (-2.0, 12.0, 0.5), (1.5, 20.0, 1.0), (3.0, 26.0, 1.7)]
    {
        let thing = Solid([lateral_m - 0.4, lateral_m + 0.4, distance_m, distance_m + 0.8, 0.0, height_m]);
        let seen = see(&[thing]);
        for shift in [-0.35, 0.0, 0.35] {
            let ray = sector(&seen.free, lateral_m + shift, distance_m);
            assert!(
                ray.far_m <= distance_m + 0.05 && ray.far_m > 0.8 * distance_m - 1.0,
                "{ray:?}, {distance_m} m"
            );
            assert_eq!(ray.end, FreeEnd::Obstacle);
        }
    }
}

#[test]
fn what_is_not_known_is_not_free() {
    let mut map = map(&[], 4);
    // A dark band across the road, from 9 to 14 m, and a blind corner.
    let row = |distance_m: f64| (RIG.cy_px + CAMERA_HEIGHT_M * RIG.focal_px / distance_m) as usize;
    for y in row(14.0)..row(9.0) {
        map[y * SIZE.0..(y + 1) * SIZE.0].fill(0);
    }
    for y in 300..SIZE.1 {
        map[y * SIZE.0 + 560..(y + 1) * SIZE.0].fill(0);
    }
    let seen = detect(&mut detector(false), &map);
    let ahead = sector(&seen.free, 0.0, 10.0);
    assert!((7.5..9.7).contains(&ahead.far_m) && ahead.end == FreeEnd::Unknown, "{ahead:?}");
    for sector in &seen.free[71..] {
        assert_eq!((sector.near_m, sector.far_m), (0.0, 0.0), "{sector:?}");
    }
    let seen = detect(&mut detector(false), &vec![0; SIZE.0 * SIZE.1]);
    assert!(seen.free.iter().all(|sector| sector.far_m == 0.0) && seen.boundaries.is_empty());
}

#[test]
fn a_sliver_of_ground_is_not_free_space() {
    // Only a few columns of the near road are known, far from the rest.
    let mut map = map(&[], 5);
    for y in 240..SIZE.1 {
        map[y * SIZE.0 + 400..y * SIZE.0 + 560].fill(0);
        map[y * SIZE.0 + 572..(y + 1) * SIZE.0].fill(0);
    }
    let seen = detect(&mut detector(false), &map);
    assert!(sector(&seen.free, 0.0, 10.0).far_m > 20.0);
    assert!(seen.free[50..].iter().all(|sector| sector.far_m == 0.0), "{:?}", &seen.free[50..]);
}

#[test]
fn what_is_flush_with_a_wall_and_as_high_may_be_a_part_of_it() {
    let front = Solid([5.0, 5.3, 2.0, 60.0, 0.0, 3.4]);
    let map_of = |solids: &[Solid]| map(solids, 1);
    let map = map_of(&[front]);
    let confidence = vec![255; map.len()];
    let mut detector = detector(false);
    let scene = detector
        .detect(DepthView::new(DisparityView::new(&map, SIZE.0, SIZE.1).unwrap(), &confidence).unwrap());
    // A door case 12 to 12.6 m ahead that reaches out by this much.
    let before_m = |out_m: f64, height_m: f64| {
        let wall = scene.before_wall(&[[5.0 - out_m, 12.0], [5.0 - out_m, 12.6]], height_m)?;
        assert!(!wall.is_in_path && wall.nearest_m <= wall.reach_m);
        Some(wall.reach_m)
    };
    for out_m in [-0.25, 0.0, 0.3, 1.0] {
        let seen_m = before_m(out_m, 2.9).expect("beside the wall");
        assert!((seen_m - out_m).abs() < 0.15, "{out_m} {seen_m}");
    }
    assert_eq!(before_m(-1.0, 2.9), None, "behind it");
    assert_eq!(before_m(0.1, 1.8), None, "a person ends below its top");
    let reaches = scene.before_wall(&[[1.5, 12.0], [4.9, 12.0]], 2.9).expect("from the wall into the path");
    assert!(reaches.is_in_path && reaches.nearest_m < 0.3 && reaches.reach_m > 3.0, "{reaches:?}");
    assert_eq!(scene.before_wall(&[[-5.0, 12.0], [4.9, 12.0]], 2.9), None, "a lorry across the path");
    assert_eq!(scene.before_wall(&[[-5.0, 12.0], [-4.0, 12.0]], 2.9), None, "no wall there");
    assert_eq!(scene.before_wall(&[[4.9, 58.0], [6.5, 75.0]], 2.9), None, "beyond the end of the wall");
    // Of a wall that is not higher than vehicles nothing tells what stands before it.
    let low = see(&[WALL]);
    assert_eq!(low.boundaries.len(), 1);
    let low_map = map_of(&[WALL]);
    let view = DepthView::new(DisparityView::new(&low_map, SIZE.0, SIZE.1).unwrap(), &confidence).unwrap();
    assert_eq!(detector.detect(view).before_wall(&[[5.0, 12.0], [5.0, 12.6]], 2.9), None);
}
