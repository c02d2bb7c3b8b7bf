//! Whether the vehicle's body will meet an obstacle in the strip that it sweeps.
//!
//! Input: an [`Obstacle`] with its motion over ground, and the [`SweptPath`]. Output: an [`Encounter`]: when the vehicle
//! arrives along the arc, and the probability that the obstacle then overlaps the strip.
//!
//! One noise model: the offset of the obstacle from the path at the time of arrival is normally distributed. Its
//! variance is that of the measured place, of the obstacle's own motion until then, and of the path. An obstacle is in the
//! way if an overlap is probable (`IN_THE_WAY`).
//!
//! Where a moving thing will be is predicted twice: straight on over ground, and along the path with the offset's rate,
//! as traffic in a bend does. As in [`super::path`] both must agree before a thing that is outside counts, or one that is
//! inside does not.

use crate::motion::path::{AlongPath, SweptPath};
use crate::motion::planar::Planar;
use crate::tracking::filter::ground::{GroundMotion, Movement};
use crate::tracking::filter::{TimeToCollision, braking_seconds};
use crate::tracking::parameters::{WANDER_NOISE, WANDER_TIME_S};

/// An obstacle in the axes of the camera.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Obstacle {
    /// Centre of its front: to the right and forward, in metres.
    pub place_m: Planar,
    /// Width of its front, in metres.
    pub width_m: f64,
    /// Closing speed along the axis, in m/s.
    pub closing_m_s: f64,
    /// Time to collision along the axis, if it approaches significantly; with its braking, if it brakes.
    pub time_to_collision: Option<TimeToCollision>,
    /// Motion over ground.
    pub ground: GroundMotion,
}

/// How the vehicle meets an obstacle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Encounter {
    /// Arc length from the camera to the obstacle, in metres.
    pub distance_m: f64,
    /// Arc length from the vehicle's front to the obstacle, in metres, not below [`MIN_GAP_M`].
    pub gap_m: f64,
    /// Speed at which that length decreases until the vehicle arrives, in m/s; negative if it does not.
    pub closing_m_s: f64,
    /// Time until the gap is 0; `None` if it does not decrease significantly.
    pub time_to_collision: Option<TimeToCollision>,
    /// Probability that the obstacle overlaps the strip, now and when the vehicle arrives.
    pub probability_now: f64,
    /// See `probability_now`.
    pub probability_then: f64,
    /// Probability then of a thing in the middle of the path, known as well.
    pub probability_most: f64,
    /// Gap between the obstacle and the strip when the vehicle arrives, in metres; negative if they overlap: by so much it
    /// would have to be farther aside. That of the prediction that decides.
    pub clearance_m: f64,
}

/// From this probability on an obstacle is in the strip, and one beside the strip in the way,
const IN_THE_WAY: f64 = 0.65;
/// and one that is in the strip, or that already raised a level: unless it more probably will have left.
const STILL_IN_THE_WAY: f64 = 0.5;
/// What comes from beside must be so near the middle of the path that this share of the largest probability is reached, which it
/// would have there: what is well measured and passes by half a metre is then not in the way.
const ENTERING_SHARE: f64 = 0.8;
/// Standard deviation of the sides of a box, in metres, beyond that of its centre.
const SIDE_SIGMA_M: f64 = 0.1;
/// Longest prediction, in seconds; later nothing is urgent.
const MAX_PREDICTION_S: f64 = 6.0;
/// Speed along the path below which nothing arrives, in m/s.
const MIN_CLOSING_M_S: f64 = 0.1;
/// Smallest gap to the front, in metres: what is beside the front has been reached.
pub const MIN_GAP_M: f64 = 0.1;
/// What traffic in a bend may change of its lateral acceleration, as a share of that with which it follows our path: it may
/// go straight on, follow us, or turn more.
const BEND_SHARE: f64 = 0.5;
/// Largest lateral acceleration with which traffic follows a bend, in m/s²: what would need more to follow our path does not, as
/// the oncoming car across whose lane we turn.
const MAX_FOLLOWING_M_S2: f64 = 4.0;
/// Step of the numerical derivative, in seconds.
const STEP_S: f64 = 0.1;

impl Encounter {
    /// Whether the vehicle would collide with the obstacle. `is_held`: it already raised a level.
    pub fn is_in_the_way(&self, is_held: bool) -> bool {
        let stays = is_held || self.probability_now >= IN_THE_WAY;
        let enters = IN_THE_WAY.max(ENTERING_SHARE * self.probability_most);
        self.probability_then >= if stays { STILL_IN_THE_WAY } else { enters }
    }

    /// Whether it is in the strip now and stays there.
    pub fn is_in_strip(&self, is_held: bool) -> bool {
        let limit = if is_held { STILL_IN_THE_WAY } else { IN_THE_WAY };
        self.is_in_the_way(is_held) && self.probability_now >= limit
    }
}

/// Probability that a normally distributed number is below `sigmas` standard deviations (Abramowitz and Stegun 26.2.17,
/// error below 1e-7).
fn normal_cdf(sigmas: f64) -> f64 {
    let t = 1.0 / (1.0 + 0.231_641_9 * sigmas.abs());
    let tail = (-sigmas * sigmas / 2.0).exp() / std::f64::consts::TAU.sqrt()
        * t
        * (0.319_381_530
            + t * (-0.356_563_782 + t * (1.781_477_937 + t * (-1.821_255_978 + t * 1.330_274_429))));
    if sigmas > 0.0 { 1.0 - tail } else { tail }
}

/// The obstacle's front along the path: its offsets from left to right, and the part nearest to the path.
#[derive(Clone, Copy, Debug)]
struct Front {
    left_m: f64,
    right_m: f64,
    nearest: AlongPath,
}

/// The front of width `width_m` centred at `place` along the path.
fn front(path: &SweptPath, place: Planar, width_m: f64) -> Front {
    let side = |share: f64| path.along([place[0] + share * width_m, place[1]]);
    let (left, right) = (side(-0.5), side(0.5));
    // Where the front crosses the path, or the side that is nearer to it. The offset changes evenly enough across.
    let span = right.offset_m - left.offset_m;
    let share = if span.abs() > 1e-9 { (-left.offset_m / span).clamp(0.0, 1.0) } else { 0.5 };
    let nearest = side(share - 0.5);
    let least = left.offset_m.min(right.offset_m).min(nearest.offset_m);
    let most = left.offset_m.max(right.offset_m).max(nearest.offset_m);
    Front { left_m: least, right_m: most, nearest }
}

/// Probability that a front overlaps the strip, if its offset has an error of `sigma_m`.
fn overlap(path: &SweptPath, front: &Front, shift_m: f64, sigma_m: f64) -> f64 {
    let [left_m, right_m] = path.reach_m(front.nearest.arc_m);
    let sigma_m = sigma_m.max(1e-3);
    let before = normal_cdf((right_m - front.left_m - shift_m) / sigma_m);
    let after = normal_cdf((-left_m - front.right_m - shift_m) / sigma_m);
    before - after
}

/// Gap between a front and the strip, in metres; negative if they overlap.
fn clearance_m(path: &SweptPath, front: &Front, shift_m: f64) -> f64 {
    let [left_m, right_m] = path.reach_m(front.nearest.arc_m);
    (front.left_m + shift_m - right_m).max(-left_m - front.right_m - shift_m)
}

/// Variance of the place across that a thing's changes of course add within `seconds`, in m². Its speed across is that of now,
/// plus an Ornstein-Uhlenbeck process that begins at 0 with the noise [`WANDER_NOISE`] and forgets within [`WANDER_TIME_S`]: at
/// first a random walk of the speed, later bounded, as nobody who walks or drives along sways ever faster.
fn wander_m2(seconds: f64) -> f64 {
    let ratio = seconds / WANDER_TIME_S;
    // A cubic from here on down is more exact than the difference of the terms.
    if ratio < 1e-3 {
        return WANDER_NOISE * seconds.powi(3) / 3.0;
    }
    let forgotten = 1.0 - (-ratio).exp();
    let forgotten_twice = 1.0 - (-2.0 * ratio).exp();
    WANDER_NOISE * WANDER_TIME_S.powi(3) * (ratio - 2.0 * forgotten + forgotten_twice / 2.0)
}

/// Lateral acceleration of a thing that follows our path at its speed, in m/s².
fn following_m_s2(path: &SweptPath, ground: &GroundMotion, along: &AlongPath) -> f64 {
    let [right_m_s, ahead_m_s] = ground.speed_m_s;
    (right_m_s * right_m_s + ahead_m_s * ahead_m_s) * path.curvature_at(along.arc_m).abs()
}

/// Variance of the offset of an obstacle after `seconds`, without that of the path.
fn variance_m2(path: &SweptPath, ground: &GroundMotion, along: &AlongPath, seconds: f64) -> f64 {
    // The offset is across the path's heading there.
    let (sine, cosine) = along.heading_rad.sin_cos();
    let across = |[right, ahead]: Planar| (cosine * right).hypot(sine * ahead);
    let place_m = across(ground.place_sigma_m).hypot(SIDE_SIGMA_M);
    if ground.movement == Movement::Standing {
        return place_m * place_m;
    }
    let moved_m = across(ground.speed_sigma_m_s) * seconds;
    let [right_m_s, ahead_m_s] = ground.speed_m_s;
    let lateral_m_s2 = (right_m_s * right_m_s + ahead_m_s * ahead_m_s) * path.curvature_at(along.arc_m).abs();
    let turned_m = BEND_SHARE * lateral_m_s2 * seconds * seconds / 2.0;
    let headed_m = path.heading_sigma_rad(along.arc_m) * ahead_m_s.hypot(right_m_s) * seconds;
    let sum_m2 = place_m * place_m + moved_m * moved_m + turned_m * turned_m + headed_m * headed_m;
    sum_m2 + wander_m2(seconds)
}

impl Obstacle {
    /// With how much it brakes, in m/s², as its time to collision says; 0 if it does not.
    fn braking_m_s2(&self) -> f64 {
        let moves = self.ground.movement != Movement::Standing;
        let measured = self.time_to_collision.filter(|_| moves);
        measured.map_or(0.0, |ttc| ttc.braking_m_s2(self.place_m[1], self.closing_m_s))
    }
}

/// How the vehicle meets an obstacle on its path.
pub fn encounter(path: &SweptPath, obstacle: &Obstacle) -> Encounter {
    let Obstacle { place_m: place, width_m, ground, .. } = *obstacle;
    let at =
        |seconds: f64| [place[0] + ground.speed_m_s[0] * seconds, place[1] + ground.speed_m_s[1] * seconds];
    let now = front(path, place, width_m);
    let camera_m = path.body.rear_axle_m;
    let distance_m = now.nearest.arc_m - camera_m;
    // What is hit is the front, so arrival is its arrival.
    let gap_m = distance_m - path.body.front_m;
    // Arc length between front and obstacle after a time; its zero is found with two secants.
    let ahead_m = |seconds: f64| {
        front(path, at(seconds), width_m).nearest.arc_m
            - camera_m
            - path.body.front_m
            - path.speed_m_s * seconds
    };
    let mut closing_m_s = (gap_m - ahead_m(STEP_S)) / STEP_S;
    let mut arrival_s = None;
    // A vehicle at rest arrives nowhere: what does not significantly come to it stays where it is.
    let may_meet = !path.is_at_rest() || obstacle.time_to_collision.is_some();
    if may_meet && gap_m > 0.0 && closing_m_s > MIN_CLOSING_M_S {
        let mut seconds = (gap_m / closing_m_s).min(MAX_PREDICTION_S);
        let mean = (gap_m - ahead_m(seconds)) / seconds;
        if mean > MIN_CLOSING_M_S && ground.movement != Movement::Standing {
            closing_m_s = mean;
            seconds = braking_seconds(gap_m, mean, obstacle.braking_m_s2()).min(MAX_PREDICTION_S);
        }
        arrival_s = Some(seconds);
    }
    let seconds = arrival_s.unwrap_or(0.0);
    let path_m = path.sigma_m(now.nearest.arc_m);
    let sigma_now = variance_m2(path, &ground, &now.nearest, 0.0).sqrt().hypot(path_m);
    let sigma_then = variance_m2(path, &ground, &now.nearest, seconds).sqrt().hypot(path_m);
    let probability_now = overlap(path, &now, 0.0, sigma_now);
    let then = front(path, at(seconds), width_m);
    let straight = overlap(path, &then, 0.0, sigma_then);
    // Across the path's heading at the obstacle.
    let (sine, cosine) = now.nearest.heading_rad.sin_cos();
    let across_m_s = cosine * ground.speed_m_s[0] + sine * ground.speed_m_s[1];
    let along_path = overlap(path, &now, across_m_s * seconds, sigma_then);
    let cannot_follow = following_m_s2(path, &ground, &now.nearest) > MAX_FOLLOWING_M_S2;
    let is_straight = cannot_follow || (probability_now >= IN_THE_WAY) == (straight >= along_path);
    let (probability_then, clearance_m) = if is_straight {
        (straight, clearance_m(path, &then, 0.0))
    } else {
        (along_path, clearance_m(path, &now, across_m_s * seconds))
    };
    let [left_m, right_m] = path.reach_m(now.nearest.arc_m);
    let half_m = (left_m + right_m + now.right_m - now.left_m) / 2.0;
    Encounter {
        distance_m,
        gap_m: gap_m.max(MIN_GAP_M),
        closing_m_s,
        time_to_collision: time_to_collision(path, obstacle, (distance_m, closing_m_s)),
        probability_now,
        probability_then,
        probability_most: 2.0 * normal_cdf(half_m / sigma_then.max(1e-3)) - 1.0,
        clearance_m,
    }
}

/// Time until the front arrives; `None` unless the arc length decreases significantly.
fn time_to_collision(
    path: &SweptPath,
    obstacle: &Obstacle,
    (distance_m, closing_m_s): (f64, f64),
) -> Option<TimeToCollision> {
    let ground = &obstacle.ground;
    let measured = obstacle.time_to_collision;
    let (speed_sigma, relative_sigma) = match (ground.movement, measured) {
        (Movement::Standing, _) => (path.speed_sigma_m_s, 0.0),
        // Place and speed of a filter are correlated; their common error is that of its time to collision.
        (_, Some(ttc)) => (0.0, ttc.sigma_s / ttc.seconds.max(1e-3)),
        (_, None) => return None,
    };
    if closing_m_s <= (2.0 * speed_sigma).max(MIN_CLOSING_M_S) || distance_m <= 0.0 {
        return None;
    }
    let gap_m = (distance_m - path.body.front_m).max(MIN_GAP_M);
    let seconds = braking_seconds(gap_m, closing_m_s, obstacle.braking_m_s2());
    let place_s =
        if ground.movement == Movement::Standing { ground.place_sigma_m[1] / closing_m_s } else { 0.0 };
    // The common error of place and speed is that of the whole distance.
    let whole_s = seconds * distance_m / gap_m;
    let sigma_s = (seconds * speed_sigma / closing_m_s).hypot(place_s).hypot(whole_s * relative_sigma);
    Some(TimeToCollision { seconds, sigma_s })
}

#[cfg(test)]
mod tests {
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
            closing_m_s,
            time_to_collision: (closing_m_s > 0.0)
                .then(|| TimeToCollision { seconds: place_m[1] / closing_m_s, sigma_s: 0.1 }),
            ground: GroundMotion {
                speed_m_s,
                speed_sigma_m_s: [0.3, 0.5],
                place_sigma_m: [0.1, 0.3],
                movement: if stands { Movement::Standing } else { Movement::Moving },
            },
        }
    }

    fn meets(path: &SweptPath, obstacle: &Obstacle) -> bool {
        encounter(path, obstacle).is_in_the_way(false)
    }

    #[test]
    fn the_distribution_is_that_of_the_tables() {
        for (sigmas, expected) in [(0.0, 0.5), (1.0, 0.841_344_75), (-1.96, 0.024_997_9), (3.0, 0.998_650_1)]
        {
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
        let walk = |seconds: f64| WANDER_NOISE * seconds.powi(3) / 3.0;
        for seconds in [1e-4, 1e-3, 0.05] {
            assert!((wander_m2(seconds) / walk(seconds) - 1.0).abs() < 0.05, "{seconds}");
        }
        // later a speed across of 0.67 m/s, kept for the time in which it is forgotten.
        assert!(wander_m2(2.5) < walk(2.5) / 2.0 && wander_m2(2.5) > 0.5, "{}", wander_m2(2.5));
        let rate = wander_m2(21.0) - wander_m2(20.0);
        assert!((rate - WANDER_NOISE * WANDER_TIME_S * WANDER_TIME_S).abs() < 1e-3, "{rate}");
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
        // It could not follow our turn at its speed; with 25 km/h it could.
        let along = turn.along(oncoming.place_m);
        assert!(following_m_s2(&turn, &oncoming.ground, &along) > MAX_FOLLOWING_M_S2);
        let slow = GroundMotion { speed_m_s: [0.0, -7.0], ..oncoming.ground };
        assert!(following_m_s2(&turn, &slow, &along) < MAX_FOLLOWING_M_S2);
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
}
