use super::*;
use crate::motion::body::Body;
use crate::motion::path::EdgesAhead;

fn path(curvature_per_m: f64, speed_m_s: f64) -> SweptPath {
    SweptPath {
        curvature_per_m,
        curvature_sigma_per_m: 0.005 / speed_m_s.max(1.5),
        speed_m_s,
        speed_sigma_m_s: 0.1,
        body: Body::default(),
        edges: None,
        is_turning_in: false,
    }
}

fn car(place_m: Planar, speed_m_s: Planar, closing_m_s: f64) -> Obstacle {
    let stands = speed_m_s == [0.0; 2];
    Obstacle {
        place_m,
        width_m: 1.8,
        outline: Outline::default(),
        closing_m_s,
        time_to_collision: (closing_m_s > 0.0)
            .then(|| TimeToCollision { seconds: place_m[1] / closing_m_s, sigma_s: 0.1 }),
        ground: GroundMotion {
            speed_m_s,
            speed_sigma_m_s: [0.3, 0.5],
            place_sigma_m: [0.1, 0.3],
            correlations: [0.0; 6],
            movement: if stands { Movement::Standing } else { Movement::Moving },
        },
    }
}

fn meets(path: &SweptPath, obstacle: &Obstacle) -> bool {
    encounter(path, obstacle).is_in_the_way(false)
}

#[test]
fn the_distribution_is_that_of_the_tables() {
    for (sigmas, expected) in [(0.0, 0.5), (1.0, 0.841_344_75), (-1.96, 0.024_997_9), (3.0, 0.998_650_1)] {
        assert!((normal_cdf(sigmas) - expected).abs() < 1e-7, "{sigmas}");
    }
}

#[test]
fn a_standing_car_counts_where_the_body_will_be() {
    // A bend to the left with a radius of 60 m at 11 m/s.
    let bend = path(1.0 / 60.0, 11.0);
    for arc_m in [12.0, 16.0, 20.0] {
        let at = |offset_m: f64| car(bend.place(arc_m, offset_m), [0.0; 2], 11.0);
        assert!(meets(&bend, &at(0.0)), "in our lane, {arc_m} m");
        assert!(!meets(&bend, &at(2.6)) && !meets(&bend, &at(-2.6)), "beside, {arc_m} m");
        let found = encounter(&bend, &at(0.0));
        let ttc = found.time_to_collision.unwrap();
        // The front is 1.7 m ahead of the camera, which is 1.6 m ahead of the axle.
        assert!((ttc.seconds - (arc_m - 1.6 - 1.7) / 11.0).abs() < 0.1, "{ttc:?}");
        assert!((found.gap_m - (arc_m - 1.6 - 1.7)).abs() < 0.2, "{found:?}");
        assert!((found.distance_m - (arc_m - 1.6)).abs() < 0.2, "{found:?}");
    }
    // Straight ahead, beyond the outer edge of the bend.
    assert!(!meets(&bend, &car([0.5, 24.0], [0.0; 2], 11.0)));
    assert!(meets(&path(0.0, 11.0), &car([0.5, 24.0], [0.0; 2], 11.0)));
}

/// A car that is parked along the outer edge of a bend to the left, its side 1 m from ours: its near corner is on the edge, the side
/// runs away along the road, the rear to the outside.
#[test]
fn a_car_that_is_parked_along_a_bend_is_not_as_wide_as_long() {
    let bend = path(1.0 / 40.0, 11.0);
    for arc_m in [10.0, 14.0, 18.0] {
        let half_m = 0.9;
        let [corner, far, rear] = [(0.0, half_m + 1.0), (4.0, half_m + 1.0), (0.0, half_m + 2.8)]
            .map(|(ahead_m, offset_m)| bend.place(arc_m + ahead_m, offset_m));
        let ends = [far[0].min(rear[0]).min(corner[0]), rear[0].max(far[0]).max(corner[0])];
        let whole = Obstacle {
            place_m: [(ends[0] + ends[1]) / 2.0, corner[1]],
            width_m: ends[1] - ends[0],
            ..car(corner, [0.0; 2], 11.0)
        };
        let outline = Outline {
            face_inset_m: [corner[0] - ends[0], ends[1] - corner[0]],
            end_depth_m: [far[1] - corner[1], (rear[1] - corner[1]).max(0.0)],
            ..Outline::default()
        };
        let (flat, seen) = (encounter(&bend, &whole), encounter(&bend, &Obstacle { outline, ..whole }));
        assert!((seen.clearance_m - 1.0).abs() < 0.3, "{arc_m} m: {seen:?}");
        assert!((seen.gap_m - (arc_m - 1.6 - 1.7)).abs() < 0.2, "{arc_m} m: {seen:?}");
        assert!(flat.clearance_m < seen.clearance_m - 0.5, "{arc_m} m: {flat:?}");
        // In the middle of our lane it is in the way, whatever its outline.
        let middle = Obstacle { place_m: [whole.place_m[0] - 2.5, whole.place_m[1]], outline, ..whole };
        assert!(encounter(&bend, &middle).is_in_the_way(false), "{arc_m} m");
    }
}

#[test]
fn an_outline_reaches_no_farther_into_the_path_than_the_whole_width_at_the_near_side() {
    // Beside a bend to the right, the left end said to be 4 m behind the near side: there it would be in the path.
    let bend = path(-1.0 / 40.0, 11.0);
    let beside = car(bend.place(14.0, 2.6), [0.0; 2], 11.0);
    let deep = Obstacle {
        outline: Outline { face_inset_m: [0.5, 0.0], end_depth_m: [4.0, 0.0], ..Outline::default() },
        ..beside
    };
    let (flat, deep) = (encounter(&bend, &beside), encounter(&bend, &deep));
    assert!((flat.clearance_m - deep.clearance_m).abs() < 1e-9, "{flat:?} {deep:?}");
    assert!((flat.gap_m - deep.gap_m).abs() < 0.3, "{flat:?} {deep:?}");
}

#[test]
fn passing_clearance_is_no_encounter() {
    let straight = path(0.0, 8.0);
    for distance_m in [3.0, 6.0, 10.0, 15.0, 20.0] {
        // Half a body, half a car, and half a metre between them.
        assert!(!meets(&straight, &car([2.3, distance_m], [0.0; 2], 8.0)), "{distance_m}");
        assert!(meets(&straight, &car([1.2, distance_m], [0.0; 2], 8.0)), "{distance_m}");
    }
}

#[test]
fn a_walker_counts_if_he_is_in_the_strip_when_we_are_there() {
    let straight = path(0.0, 8.0);
    let walker = |x: f64, across: f64| Obstacle { width_m: 0.6, ..car([x, 14.0], [across, 0.0], 8.0) };
    // Our front, 1.7 m ahead of the camera, arrives in 1.54 s.
    assert!(meets(&straight, &walker(-2.5, 1.5)));
    assert!(!meets(&straight, &walker(-2.5, -1.5)));
    assert!(!meets(&straight, &walker(0.8, 2.5)), "has left");
    assert!(!meets(&straight, &walker(-6.0, 1.0)), "comes later");
}

#[test]
fn a_change_of_course_is_bounded() {
    // At first a random walk of the speed,
    let walk = |seconds: f64| LATERAL_PROCESS_NOISE * seconds.powi(3) / 3.0;
    for seconds in [1e-4, 1e-3, 0.05] {
        assert!((wander_m2(seconds) / walk(seconds) - 1.0).abs() < 0.05, "{seconds}");
    }
    // later a speed across of 0.67 m/s, kept for the time in which it is forgotten.
    assert!(wander_m2(2.5) < walk(2.5) / 2.0 && wander_m2(2.5) > 0.5, "{}", wander_m2(2.5));
    let rate = wander_m2(21.0) - wander_m2(20.0);
    assert!((rate - LATERAL_PROCESS_NOISE * WANDER_TIME_S * WANDER_TIME_S).abs() < 1e-3, "{rate}");
}

#[test]
fn who_walks_ahead_in_our_path_is_in_the_way_in_time_for_a_warning() {
    // 20 km/h towards a walker with 5 km/h: 2.8 s from the front.
    let straight = path(0.0, 5.6);
    let ahead = |x: f64| {
        let walker = car([x, 1.7 + 2.8 * 4.2], [0.0, 1.4], 4.2);
        let ground = GroundMotion { speed_sigma_m_s: [0.35, 0.3], ..walker.ground };
        Obstacle { width_m: 0.5, ground, ..walker }
    };
    assert!(meets(&straight, &ahead(0.0)) && !meets(&straight, &ahead(2.0)));
    let found = encounter(&straight, &ahead(0.0)).time_to_collision.unwrap();
    assert!((found.seconds - 2.8).abs() < 0.05, "{found:?}");
    // Beside the front he has been reached.
    let beside = encounter(&straight, &Obstacle { place_m: [0.0, 1.0], ..ahead(0.0) });
    assert!(beside.gap_m == MIN_GAP_M && beside.time_to_collision.unwrap().seconds < 0.1, "{beside:?}");
}

#[test]
fn an_oncoming_car_does_not_follow_our_turn() {
    // We turn left with a radius of 14.8 m at 20 km/h; it comes straight on with 45 km/h and 0.9 s later is where we then are.
    let turn = path(1.0 / 14.8, 5.6);
    let meeting = turn.place(1.6 + 1.7 + 0.9 * 5.6, 0.0);
    let oncoming = car([meeting[0], meeting[1] + 0.9 * 12.5], [0.0, -12.5], 18.0);
    let found = encounter(&turn, &oncoming);
    assert!(found.clearance_m < -0.5, "{found:?}");
    // Our turn is not well known as far as the car is now, but it is as far as where it will be.
    let doubtful = SweptPath { curvature_sigma_per_m: 0.01, ..turn };
    assert!(doubtful.sigma_m(doubtful.along(oncoming.place_m).arc_m) > 1.5);
    assert!(encounter(&doubtful, &oncoming).is_in_the_way(false));
    // It could not follow our turn at its speed; with 25 km/h it could.
    let along = turn.along(oncoming.place_m);
    assert!(following_m_s2(&turn, &oncoming.ground, &along) > MAX_FOLLOWING_M_S2);
    let slow = GroundMotion { speed_m_s: [0.0, -7.0], ..oncoming.ground };
    assert!(following_m_s2(&turn, &slow, &along) < MAX_FOLLOWING_M_S2);
}

#[test]
fn what_comes_from_afar_in_a_turn_is_met_when_and_where_both_are() {
    // A turn of 14.8 m to the left, across the path of a car that comes with 60 km/h. From afar its place along the arc
    // moves otherwise than near.
    let turn = path(1.0 / 14.8, 5.56);
    for seconds in [0.6, 0.9, 1.2] {
        let front_m = turn.body.rear_axle_m + turn.body.front_m + turn.speed_m_s * seconds;
        let meeting = turn.place(front_m, 0.0);
        let speed_m_s = [-3.3, -16.3];
        let place = [meeting[0] - speed_m_s[0] * seconds, meeting[1] - speed_m_s[1] * seconds];
        let found = encounter(&turn, &car(place, speed_m_s, 22.0));
        let ttc = found.time_to_collision.expect("it approaches");
        assert!((ttc.seconds - seconds).abs() < 0.12, "{seconds} s: {ttc:?}");
        assert!(found.clearance_m < -1.0 && found.is_in_the_way(false), "{seconds} s: {found:?}");
    }
}

#[test]
fn what_only_comes_near_in_a_tight_turn_arrives_when_it_is_nearest() {
    let turn = path(1.0 / 9.8, 5.3);
    let found = encounter(&turn, &car([-2.1, 39.5], [-3.4, -13.7], 19.0));
    let ttc = found.time_to_collision.expect("it approaches");
    assert!((1.5..3.2).contains(&ttc.seconds), "{ttc:?}");
}

#[test]
fn what_is_followed_arrives_as_slowly_as_it_closes() {
    let found = encounter(&path(0.0, 10.0), &car([0.0, 21.7], [0.0, 9.0], 1.0));
    let ttc = found.time_to_collision.expect("it approaches");
    assert!((ttc.seconds - 20.0).abs() < 0.5 && (found.closing_m_s - 1.0).abs() < 0.05, "{found:?}");
}

#[test]
fn who_is_well_measured_and_passes_closely_is_not_in_the_way() {
    // A bicycle crosses with 3.8 m/s and is in the strip when we arrive, or its rear wheel's last third of a metre is.
    let straight = path(0.0, 11.0);
    let crossing = |late_m: f64| {
        let bicycle = car([-1.5 * 3.8 - late_m, 1.7 + 1.5 * 11.0], [3.8, 0.0], 11.0);
        let ground = GroundMotion { speed_sigma_m_s: [0.2, 0.3], ..bicycle.ground };
        encounter(&straight, &Obstacle { ground, ..bicycle })
    };
    let (middle, rim) = (crossing(0.0), crossing(1.45));
    assert!(middle.is_in_the_way(false) && rim.clearance_m < -0.3, "{rim:?}");
    assert!(rim.probability_then >= IN_THE_WAY - 0.05 && !rim.is_in_the_way(false), "{rim:?}");
}

#[test]
fn what_stays_at_its_bearing_is_met_however_far_away_it_is() {
    // A car from the left is at the front in 2 s. Its distance is known to 2 m, its speed along the line of sight to 2 m/s, and both
    // across it exactly.
    let straight = path(0.0, 16.7);
    let place = [-2.0 * 5.6, 1.7 + 2.0 * 16.7];
    let bearing = place[0] / place[1];
    let crossing = |correlation: f64| {
        let car = car(place, [5.6, 0.0], 16.7);
        let correlations = [correlation, 0.0, 0.0, 0.0, 0.0, correlation];
        let sigmas = [(2.0 * bearing).abs(), 2.0];
        let ground =
            GroundMotion { place_sigma_m: sigmas, speed_sigma_m_s: sigmas, correlations, ..car.ground };
        Obstacle { ground, ..car }
    };
    let (known, apart) = (crossing(-1.0), crossing(0.0));
    let across = |ground: &GroundMotion| {
        let by = Vector4::new(1.0, -bearing, 2.0, -2.0 * bearing);
        by.dot(&(ground.covariance() * by))
    };
    assert!(across(&known.ground) < 1e-9 && across(&apart.ground) > 3.0);
    let [known, apart] = [known, apart].map(|obstacle| encounter(&straight, &obstacle).probability_then);
    assert!(known > apart + 0.2, "{known} {apart}");
    // Numbers that no covariance has give no variance below 0.
    let broken = GroundMotion { correlations: [-1.0; 6], ..crossing(0.0).ground };
    let found = encounter(&straight, &Obstacle { ground: broken, ..crossing(0.0) });
    assert!(found.probability_then.is_finite());
}

#[test]
fn who_brakes_ahead_is_reached_earlier() {
    let straight = path(0.0, 16.0);
    let ahead = |seconds: f64| {
        let leader = car([0.0, 15.0], [0.0, 13.0], 3.0);
        Obstacle { time_to_collision: Some(TimeToCollision { seconds, sigma_s: 0.1 }), ..leader }
    };
    let ttc = |seconds| encounter(&straight, &ahead(seconds)).time_to_collision.unwrap().seconds;
    // At constant speed 13.3 m at 3 m/s; with 4 m/s² the camera is there after 2.09 s, the front after 1.94 s.
    assert!((ttc(5.0) - 13.3 / 3.0).abs() < 0.05, "{}", ttc(5.0));
    let seconds = braking_seconds(15.0, 3.0, 4.0);
    assert!((ttc(seconds) - braking_seconds(13.3, 3.0, 4.0)).abs() < 0.05, "{}", ttc(seconds));
    assert!(ttc(seconds) < 2.0);
}

#[test]
fn who_comes_towards_us_is_met_where_the_path_is_known() {
    let straight = path(0.0, 11.0);
    let coming = |place: Planar, speed: Planar| {
        let car = car(place, speed, 11.0 - speed[1]);
        let ground = GroundMotion { speed_sigma_m_s: [0.2, 0.5], ..car.ground };
        encounter(&straight, &Obstacle { ground, ..car })
    };
    // In 2.3 s we are 26 m on; where we would be after 60 m nobody knows.
    let found = coming([0.5, 60.0], [0.0, -14.0]);
    assert!(found.is_in_the_way(false), "{found:?}");
    assert!(!meets(&straight, &car([0.5, 60.0], [0.0; 2], 11.0)));
    assert!(!coming([3.4, 60.0], [0.0, -14.0]).is_in_the_way(false));
    // The road bends before we do, and it comes along its own lane: its heading tells.
    for curvature in [0.002, -0.002] {
        let road = SweptPath { curvature_per_m: curvature, ..straight };
        let place = road.place(60.0, -3.4);
        let heading = road.along(place).heading_rad;
        let found = coming(place, [14.0 * heading.sin(), -14.0 * heading.cos()]);
        assert!(!found.is_in_the_way(false), "{curvature}: {found:?}");
    }
}

#[test]
fn traffic_keeps_to_its_lane_unless_it_is_known_to_leave_it() {
    let straight = path(0.0, 11.0);
    // An oncoming car whose side passes ours by 0.5 m, and that seems to come over with 1.2 m/s.
    let found = |sigma_m_s: f64, across_m_s: f64, along_m_s: f64| {
        let car = car([-2.3, 26.0], [across_m_s, along_m_s], 11.0 - along_m_s);
        let ground = GroundMotion { speed_sigma_m_s: [sigma_m_s, 0.5], ..car.ground };
        encounter(&straight, &Obstacle { ground, ..car })
    };
    assert!(!found(1.0, 1.2, -14.0).is_in_the_way(false), "{:?}", found(1.0, 1.2, -14.0));
    assert!(found(0.1, 1.2, -14.0).is_in_the_way(false), "{:?}", found(0.1, 1.2, -14.0));
    // Who crosses is no traffic of this road.
    let clearance = |sigma_m_s| found(sigma_m_s, 4.0, -5.0).clearance_m;
    assert!((clearance(1.0) - clearance(0.1)).abs() < 1e-9);
}

#[test]
fn traffic_in_a_bend_that_begins_is_in_doubt() {
    // The road bends ahead, we do not yet: a car in the next lane there heads for where we would be without the bend.
    let edges = EdgesAhead { from_m: 4.0, curvature_per_m: 0.008 };
    let begins = SweptPath { edges: Some(edges), ..path(0.0, 11.0) };
    let bends = SweptPath { edges: Some(edges), ..path(0.008, 11.0) };
    let in_next_lane = Obstacle { width_m: 2.5, ..car([1.5, 19.0], [-1.4, 5.0], 6.0) };
    assert!(!meets(&begins, &in_next_lane));
    // Once the vehicle bends as the road does, nothing of that is in doubt.
    let straight = path(0.0, 11.0);
    assert!(begins.sigma_m(19.0) > 1.5 * straight.sigma_m(19.0));
    assert!(begins.heading_sigma_rad(19.0) > 0.1 && bends.heading_sigma_rad(19.0) == 0.0);
}

#[test]
fn the_clearance_is_the_gap_on_arrival() {
    let straight = path(0.0, 8.0);
    let clearance = |obstacle: &Obstacle| encounter(&straight, obstacle).clearance_m;
    // Half a body of 1.8 m and half a car of 1.8 m.
    for x in [-2.3, 2.3] {
        assert!((clearance(&car([x, 14.0], [0.0; 2], 8.0)) - 0.5).abs() < 1e-9, "{x}");
    }
    assert!((clearance(&car([1.2, 14.0], [0.0; 2], 8.0)) + 0.6).abs() < 1e-9);
    assert!((clearance(&car([0.0, 14.0], [0.0; 2], 8.0)) + 1.8).abs() < 1e-9);
    // A walker beside us who is before us in 1.54 s, when our front is there, and one in the strip who then has left.
    let walker = |x: f64, across: f64| Obstacle { width_m: 0.6, ..car([x, 14.0], [across, 0.0], 8.0) };
    assert!(
        (clearance(&walker(-2.5, 1.5)) + 1.2 - 0.19375).abs() < 1e-6,
        "{}",
        clearance(&walker(-2.5, 1.5))
    );
    assert!((clearance(&walker(0.8, 2.5)) - 3.44375).abs() < 1e-6, "{}", clearance(&walker(0.8, 2.5)));
    // In a bend the outer front corner swings out: less gap there than on the inner side.
    let bend = path(1.0 / 30.0, 8.0);
    let beside = |offset_m: f64| {
        encounter(&bend, &Obstacle { width_m: 0.1, ..car(bend.place(12.0, offset_m), [0.0; 2], 8.0) })
    };
    assert!(beside(2.0).clearance_m + 0.1 < beside(-2.0).clearance_m);
}

#[test]
fn traffic_that_follows_the_bend_stays_beside_us() {
    // Oncoming on the inner side of a bend to the left, and on the outer side of one to the right.
    for (curvature, offset_m) in [(1.0 / 60.0, -3.4), (-1.0 / 60.0, -3.4), (1.0 / 40.0, 3.4)] {
        let bend = path(curvature, 11.0);
        for arc_m in [15.0, 22.0, 30.0, 38.0] {
            let place = bend.place(arc_m, offset_m);
            let heading = bend.along(place).heading_rad;
            let speed = [11.0 * heading.sin(), -11.0 * heading.cos()];
            assert!(!meets(&bend, &car(place, speed, 20.0)), "{curvature} {arc_m}");
        }
    }
    // On a straight road an oncoming car that crosses over to our lane counts.
    let place = [-3.4, 33.0];
    assert!(meets(&path(0.0, 11.0), &car(place, [2.2, -11.0], 22.0)));
}

#[test]
fn at_rest_what_stands_ahead_is_in_the_way() {
    // A car ahead whose speed is noise, whether it counts as standing or not: 1.1 m of it before our body.
    let rest = SweptPath { curvature_sigma_per_m: 0.0, ..path(0.0, 0.0) };
    for movement in [Movement::Standing, Movement::Unknown, Movement::Moving] {
        for along_m_s in [0.2, 0.0, -0.15, -0.5] {
            let car = car([0.7, 9.0], [0.0, along_m_s], -along_m_s);
            let ground = GroundMotion { movement, ..car.ground };
            let found = encounter(&rest, &Obstacle { time_to_collision: None, ground, ..car });
            assert!(found.is_in_the_way(false), "{movement:?} {along_m_s}: {found:?}");
            assert!((found.clearance_m + 1.1).abs() < 1e-9, "{found:?}");
        }
    }
}

#[test]
fn what_does_not_come_nearer_has_no_time_to_collision() {
    let behind = encounter(&path(0.0, 8.0), &car([0.0, 0.0], [0.0; 2], 8.0));
    assert_eq!(behind.time_to_collision, None);
    let away = encounter(&path(0.0, 8.0), &car([0.0, 10.0], [0.0, 12.0], -4.0));
    assert!(away.time_to_collision.is_none() && away.closing_m_s < 0.0);
}

/// An oncoming car in our lane, at the edge of our path: where each drives its own part until they meet, and keeps its lane, it is
/// known to be in the way 2 s before.
#[test]
fn an_oncoming_car_in_our_lane_is_in_the_way_long_before() {
    let straight = SweptPath { curvature_sigma_per_m: 0.0004, ..path(0.0, 11.0) };
    let oncoming = car([0.8, 60.0], [0.0, -19.0], 30.0);
    let found = encounter(&straight, &oncoming);
    assert!(found.is_in_the_way(false), "{found:?}");
    // Who walks there may turn off until then.
    let slow = encounter(&straight, &car([0.8, 32.0], [0.0, -4.0], 15.0));
    assert!(slow.probability_then < found.probability_then, "{slow:?} {found:?}");
    // What the driver may change in the time of the own way is more than in that until the meeting.
    assert!(straight.sigma_after_m(38.0, 2.0) < straight.sigma_m(38.0));
    assert!((straight.sigma_after_m(38.0, 38.0 / 11.0) - straight.sigma_m(38.0)).abs() < 1e-12);
}

/// Who crosses behind a left turn of 15 m radius at 20 km/h, 1.9 s before he is met.
fn walker_in_a_turn() -> (SweptPath, Obstacle) {
    let walker = Obstacle {
        width_m: 0.6,
        ground: GroundMotion {
            speed_sigma_m_s: [0.3; 2],
            place_sigma_m: [0.05, 0.1],
            correlations: [0.0; 6],
            ..car([-2.64, 12.4], [-1.5, -0.9], 6.0).ground
        },
        ..car([-2.64, 12.4], [-1.5, -0.9], 6.0)
    };
    (path(1.0 / 15.0, 5.56), walker)
}

#[test]
fn who_walks_into_a_turn_may_be_in_the_way_while_its_end_is_not_known() {
    let (turn, walker) = walker_in_a_turn();
    let found = encounter(&turn, &walker);
    assert!(!found.is_in_the_way(false) && found.may_be_in_the_way(), "{found:?}");
    // Not what stands there, what is as fast as traffic or as wide as a house, nor on a straight road.
    let standing = GroundMotion { movement: Movement::Standing, speed_m_s: [0.0; 2], ..walker.ground };
    let fast = GroundMotion { speed_m_s: [-6.0, -5.0], ..walker.ground };
    for other in [
        Obstacle { ground: standing, ..walker },
        Obstacle { ground: fast, ..walker },
        Obstacle { width_m: 3.0, ..walker },
    ] {
        assert!(!encounter(&turn, &other).may_be_in_the_way(), "{other:?}");
    }
    for speed_m_s in [5.56, 14.0] {
        assert!(!encounter(&path(0.0, speed_m_s), &walker).may_be_in_the_way(), "{speed_m_s}");
    }
}
