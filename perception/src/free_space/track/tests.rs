//! Boundaries that are followed, from curves and looks that the tests make up.

use super::*;
use crate::motion::Motion;
use crate::motion::body::Body;

const STEP_S: f64 = 0.1;
const SPEED_M_S: f64 = 8.0;

fn step() -> PlanarStep {
    PlanarStep::of(&Motion { speed_m_s: SPEED_M_S, ..Motion::default() }, &Body::default(), STEP_S)
}

/// A straight line beside the way between two distances, in metres, seen as a whole, a point a metre.
fn line(lateral_m: f64, [from_m, to_m]: [f64; 2], height_m: f64) -> Boundary {
    let count = (to_m - from_m).round().max(1.0) as usize;
    let mut out = Boundary::default();
    // From left to right: on the left from near to far, on the right from far to near.
    for i in 0..=count {
        let share = i as f64 / count as f64;
        let share = if lateral_m < 0.0 { share } else { 1.0 - share };
        let distance_m = from_m + share * (to_m - from_m);
        let solid_m = (to_m - from_m) / count as f64;
        out.push(BoundaryPoint { lateral_m, distance_m, height_m, solid_m, sigma_m: 0.03, unseen_s: 0.0 });
    }
    out
}

/// The ends of a boundary, the nearer one first, in metres.
fn ends_m(boundary: &Boundary) -> [f64; 2] {
    let distances = boundary.points().iter().map(|point| point.distance_m);
    distances.fold([f64::INFINITY, 0.0], |[near, far], m| [near.min(m), far.max(m)])
}

/// Drives along parts that are seen in each frame, given the way so far in metres; returns the boundaries after each frame.
fn drive(
    frames: usize,
    parts: impl Fn(f64) -> Vec<Boundary>,
    look: impl Fn(&BoundaryPoint, f64) -> Look,
) -> Vec<Vec<Boundary>> {
    let mut list = TrackList::new(true);
    let frame = |frame: usize| {
        let way_m = SPEED_M_S * STEP_S * frame as f64;
        let seen = |boundary: &Boundary, i: usize| look(&boundary.points()[i], way_m);
        list.update([&[], &parts(way_m)], Some(step()), STEP_S, seen);
        list.publish(&Corridor::new(2.0, None));
        for boundary in list.boundaries() {
            let slope = |point: &BoundaryPoint| point.lateral_m / point.distance_m;
            assert!(boundary.points().is_sorted_by(|a, b| slope(a) < slope(b)), "{boundary:?}");
        }
        list.boundaries().to_vec()
    };
    (0..frames).map(frame).collect()
}

/// Part of a fence from 8 to 40 m from the start, of which 4 m are seen at a time, from 9 to 13 m ahead.
fn window(way_m: f64, lateral_m: f64, height_m: f64) -> Vec<Boundary> {
    let from_m = f64::max(9.0, 8.0 - way_m);
    let to_m = f64::min(13.0, 40.0 - way_m);
    if to_m - from_m > 2.0 { vec![line(lateral_m, [from_m, to_m], height_m)] } else { Vec::new() }
}

#[test]
fn parts_of_a_fence_make_a_boundary_as_the_vehicle_drives() {
    for lateral_m in [-5.5, 5.5] {
        let seen = drive(30, |way_m| window(way_m, lateral_m, 1.1), |_, _| Look::Seen);
        let first = seen.iter().position(|boundaries| !boundaries.is_empty()).expect("a boundary");
        // 8 m of it have been seen after 4 m of way.
        assert!((4..9).contains(&first), "{first}");
        let [boundary] = &seen[20][..] else { panic!("{:?}", seen[20]) };
        let [near_m, far_m] = ends_m(boundary);
        assert!(near_m < 2.0 && (far_m - 13.0).abs() < 0.1, "{near_m} to {far_m} m");
        assert!(boundary.points().iter().all(|point| (point.lateral_m - lateral_m).abs() < 0.05));
        let length_m = far_m - near_m;
        assert!(boundary.solid_m() <= length_m + 0.01 && boundary.solid_m() > 0.8 * length_m);
    }
}

#[test]
fn without_own_motion_parts_make_nothing() {
    let mut list = TrackList::new(true);
    for i in 0..30 {
        let part = window(0.8 * f64::from(i), 5.5, 1.1);
        list.update([&[], &part], None, STEP_S, |_, _| Look::Seen);
        list.publish(&Corridor::new(2.0, None));
        assert_eq!(list.boundaries(), []);
    }
}

#[test]
fn the_side_of_a_car_that_drives_along_makes_no_boundary() {
    // It drives ahead as fast as we do: where it was there is nothing.
    let side = |_: f64| vec![line(-3.0, [8.0, 12.0], 1.4)];
    let look =
        |point: &BoundaryPoint, _: f64| if point.distance_m < 7.9 { Look::Through } else { Look::Seen };
    assert!(drive(30, side, look).iter().all(Vec::is_empty));
    // Without that it would be one.
    assert!(!drive(30, side, |_, _| Look::Seen)[29].is_empty());
}

#[test]
fn parked_cars_with_gaps_make_no_boundary() {
    // Their sides, 4.2 m long with a steady height, as vans have, and 1 m between them.
    let cars = |way_m: f64| {
        let ahead = (0..12).map(|i| 5.2 * f64::from(i) - way_m).filter(|near_m| (3.0..16.0).contains(near_m));
        ahead.map(|near_m| line(3.0, [near_m, near_m + 4.2], 1.9)).collect()
    };
    let seen = drive(60, cars, |_, _| Look::Seen);
    assert!(seen.iter().all(Vec::is_empty), "{:?}", seen.iter().find(|boundaries| !boundaries.is_empty()));
}

#[test]
fn a_gate_that_opens_divides_a_wall() {
    let mut list = TrackList::new(true);
    let wall = line(5.0, [5.0, 25.0], 1.2);
    for _ in 0..5 {
        list.update(
            [&[wall], &[]],
            Some(PlanarStep::of(&Motion::default(), &Body::default(), STEP_S)),
            STEP_S,
            |_, _| Look::Seen,
        );
    }
    let open = |boundary: &Boundary, i: usize| {
        let distance_m = boundary.points()[i].distance_m;
        if (16.0..19.0).contains(&distance_m) { Look::Through } else { Look::Seen }
    };
    for _ in 0..3 {
        let step = PlanarStep::of(&Motion::default(), &Body::default(), STEP_S);
        list.update([&[], &[]], Some(step), STEP_S, open);
    }
    list.publish(&Corridor::new(2.0, None));
    let [rest] = list.boundaries() else { panic!("{:?}", list.boundaries()) };
    let [near_m, far_m] = ends_m(rest);
    assert!(near_m < 5.5 && far_m < 16.0, "{near_m} to {far_m} m");
}

#[test]
fn what_is_one_gets_one_number() {
    let mut list = TrackList::new(true);
    let standing = || Some(PlanarStep::of(&Motion::default(), &Body::default(), STEP_S));
    let (near, far, whole) =
        (line(5.0, [5.0, 14.0], 1.2), line(5.0, [16.0, 25.0], 1.2), line(5.0, [5.0, 25.0], 1.2));
    for _ in 0..4 {
        list.update([&[near, far], &[]], standing(), STEP_S, |_, _| Look::Seen);
    }
    list.publish(&Corridor::new(2.0, None));
    let ids: Vec<u32> = list.boundaries().iter().map(|boundary| boundary.id).collect();
    assert_eq!(ids.len(), 2);
    for _ in 0..2 {
        list.update([&[whole], &[]], standing(), STEP_S, |_, _| Look::Seen);
    }
    list.publish(&Corridor::new(2.0, None));
    let [one] = list.boundaries() else { panic!("{:?}", list.boundaries()) };
    assert_eq!(one.id, ids.iter().copied().min().unwrap());
    // At most as many points as a boundary holds, and both ends.
    let [near_m, far_m] = ends_m(one);
    assert!(one.points().len() <= MAX_POINTS && (near_m - 5.0).abs() < 0.1 && (far_m - 25.0).abs() < 0.1);
}

#[test]
fn points_that_fall_behind_each_other_are_removed() {
    // Lateral positions 10 m ahead, the length that was seen up to them, and their errors, in metres.
    let ordered = |points: &[(f64, f64, f64)]| {
        let mut boundary = Boundary::default();
        for &(lateral_m, solid_m, sigma_m) in points {
            let [distance_m, height_m] = [10.0, 1.2];
            boundary.push(BoundaryPoint { lateral_m, distance_m, height_m, sigma_m, solid_m, unseen_s: 0.0 });
        }
        boundary.put_in_order();
        let points = boundary.points().iter();
        points.map(|point| (point.lateral_m, point.solid_m)).collect::<Vec<_>>()
    };
    let in_order = [(1.0, 0.0), (2.0, 1.0), (3.0, 1.0)];
    assert_eq!(ordered(&in_order.map(|(at, solid)| (at, solid, 0.1))), in_order);
    // The less certain of two goes; what was seen up to it goes on to the next.
    let of =
        |second, third| ordered(&[(1.0, 0.0, 0.1), (2.0, 1.0, second), (1.5, 0.5, third), (2.5, 1.0, 0.1)]);
    assert_eq!(of(0.1, 0.3), [(1.0, 0.0), (2.0, 1.0), (2.5, 0.5)]);
    assert_eq!(of(0.3, 0.1), [(1.0, 0.0), (1.5, 0.5), (2.5, 1.0)]);
    let first = [(5.0, 0.0, 0.1), (1.0, 4.0, 0.1), (2.0, 1.0, 0.1), (2.0, 0.0, 0.1), (4.0, 2.0, 0.1)];
    assert_eq!(ordered(&first), [(1.0, 0.0), (2.0, 1.0), (4.0, 2.0)]);
    // Nobody has seen what lies between the first and the last.
    assert_eq!(ordered(&[(0.0, 0.0, 0.1), (3.0, 0.0, 0.3), (1.0, 2.0, 0.1)]), [(0.0, 0.0), (1.0, 0.0)]);
    assert_eq!(ordered(&[]), []);
}
