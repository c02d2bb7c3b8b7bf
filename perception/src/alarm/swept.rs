//! Whether the vehicle's body will meet an obstacle in the strip that it sweeps.
//!
//! Input: an [`Obstacle`] with its motion over ground, and the [`SweptPath`]. Output: an [`Encounter`]: when the vehicle
//! arrives along the arc, and the probability that the obstacle then overlaps the strip.
//!
//! One noise model: the offset of the obstacle from the path at the time of arrival is normally distributed. Its
//! variance is that of the measured place and speed, which err together, of the time of arrival, of what the obstacle
//! changes until then, and of the path. An obstacle is in the way if an overlap is probable (`IN_THE_WAY`).
//!
//! Where a moving thing will be is predicted twice: straight on over ground, and along the path with the offset's rate,
//! as traffic in a bend does. As in [`super::path`] both must agree before a thing that is outside counts, or one that is
//! inside does not.

use crate::motion::path::{AlongPath, SweptPath};
use crate::motion::planar::Planar;
use crate::outline::Outline;
use crate::tracking::filter::ground::{GroundMotion, Movement};
use crate::tracking::filter::{TimeToCollision, braking_seconds};
use crate::tracking::parameters::{LATERAL_PROCESS_NOISE, WANDER_TIME_S};
use nalgebra::Vector4;

/// An obstacle in the axes of the camera.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Obstacle {
    /// Centre of its front: to the right and forward, in metres.
    pub place_m: Planar,
    /// Width of its front, in metres.
    pub width_m: f64,
    /// Its outline.
    pub outline: Outline,
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
    /// Whether a person or rider moves, and more of the variance of the offset is that of the own path than of their place.
    pub is_path_in_doubt: bool,
    /// Gap between the obstacle and the strip when the vehicle arrives, in metres; negative if they overlap: by so much it
    /// would have to be farther aside. That of the prediction that decides.
    pub clearance_m: f64,
    /// The same now.
    pub clearance_now_m: f64,
}

/// From this probability on an obstacle is in the strip, and one beside the strip in the way,
const IN_THE_WAY: f64 = 0.65;
/// and one that is in the strip, or that already raised a level: unless it more probably will have left.
const STILL_IN_THE_WAY: f64 = 0.5;
/// What comes from beside must be so near the middle of the path that this share of the largest probability is reached, which it
/// would have there: what is well measured and passes by half a metre is then not in the way.
const ENTERING_SHARE: f64 = 0.8;
/// From this probability on, it surely is: its place is known well enough.
const SURELY: f64 = 0.95;
/// Where the own path is in doubt, as in a turn whose end only the driver knows, a warning for people and riders who move into it is raised
/// from this probability on; an alarm is not.
const PATH_IN_DOUBT: f64 = 0.3;
/// They are at most so fast, in m/s: not traffic across whose lane we turn;
const MAX_RIDER_M_S: f64 = 7.0;
/// and at most so wide, in metres: a bicycle from the side, not the front of a house that seems to move.
const MAX_RIDER_M: f64 = 2.2;
/// Standard deviation of the sides of a box, in metres, beyond that of its centre.
const SIDE_SIGMA_M: f64 = 0.1;
/// Longest prediction, in seconds; later nothing is urgent.
const MAX_PREDICTION_S: f64 = 6.0;
/// Speed along the path below which nothing arrives, in m/s.
const MIN_CLOSING_M_S: f64 = 0.1;
/// Largest speed across as a share of the closing speed that counts: what crosses faster is there before or after.
const MAX_WAY: f64 = 3.0;
/// Smallest gap to the front, in metres: what is beside the front has been reached.
pub const MIN_GAP_M: f64 = 0.1;
/// What traffic in a bend may change of its lateral acceleration, as a share of that with which it follows our path: it may
/// go straight on, follow us, or turn more.
const BEND_SHARE: f64 = 0.5;
/// Largest lateral acceleration with which traffic follows a bend, in m/s²: what would need more to follow our path does not, as
/// the oncoming car across whose lane we turn.
const MAX_FOLLOWING_M_S2: f64 = 4.0;
/// Traffic keeps to its lane: what drives along our path at least this fast, in m/s, with at most this sine of the angle between
/// both (15°), has a speed across of this standard deviation, in m/s, before it is measured. A lane change reaches 1 m/s.
const MIN_TRAFFIC_M_S: f64 = 5.0;
/// See [`MIN_TRAFFIC_M_S`].
const MAX_TRAFFIC_SINE: f64 = 0.26;
/// See [`MIN_TRAFFIC_M_S`].
const TRAFFIC_ACROSS_SIGMA_M_S: f64 = 0.7;
/// Process noise of the speed across of traffic that keeps to its lane, as a share of [`LATERAL_PROCESS_NOISE`]: half of a walker's standard
/// deviation.
const LANE_WANDER_SHARE: f64 = 0.25;
/// Most secants by which the arrival is found, and an error of it that is small enough, in metres.
const MAX_SECANTS: usize = 8;
/// See [`MAX_SECANTS`].
const ARRIVAL_ERROR_M: f64 = 0.05;
/// Step of the numerical derivative, in seconds.
const STEP_S: f64 = 0.1;

impl Encounter {
    /// Whether the vehicle would collide with the obstacle. `is_held`: it already raised a level.
    pub fn is_in_the_way(&self, is_held: bool) -> bool {
        let stays = is_held || self.probability_now >= IN_THE_WAY;
        let enters = IN_THE_WAY.max(ENTERING_SHARE * self.probability_most);
        self.probability_then >= if stays { STILL_IN_THE_WAY } else { enters }
    }

    /// Whether it is beside the strip now, and not surely in the way.
    pub fn is_unsure(&self) -> bool {
        self.clearance_now_m > 0.0 && self.probability_then < SURELY
    }

    /// Whether a person or rider is probable enough in a path that is in doubt for a warning, but not for an alarm.
    pub fn may_be_in_the_way(&self) -> bool {
        self.is_path_in_doubt
            && self.probability_then >= PATH_IN_DOUBT.max(ENTERING_SHARE * self.probability_most)
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

/// The front of an obstacle whose middle is at `place` along the path.
fn front(path: &SweptPath, place: Planar, obstacle: &Obstacle) -> Front {
    let points = obstacle.outline.points_m(place, obstacle.width_m);
    // What is met first is the near face: where it crosses the path, or its side that is nearer to it. The offset changes evenly enough
    // across.
    let [from, to] = [points[1], points[2]];
    let [left, right] = [from, to].map(|point| path.along(point));
    let span_m = right.offset_m - left.offset_m;
    let share = if span_m.abs() > 1e-9 { (-left.offset_m / span_m).clamp(0.0, 1.0) } else { 0.5 };
    let nearest = path.along([from[0] + share * (to[0] - from[0]), from[1]]);
    let span = |points: &[Planar]| {
        points.iter().fold([f64::INFINITY, f64::NEG_INFINITY], |[least, most], &point| {
            let offset_m = path.along(point).offset_m;
            [least.min(offset_m), most.max(offset_m)]
        })
    };
    // In a bend it matters how far away an end is. Where the outline reaches farther into the path than the whole width would at the
    // near side, it is cut off: depth is measured worst at the ends.
    let half_m = obstacle.width_m / 2.0;
    let flat = span(&[-half_m, half_m].map(|side_m| [place[0] + side_m, place[1]]));
    let seen = span(&points);
    // The face belongs to both.
    let (least, most) = (flat[0].max(seen[0]), flat[1].min(seen[1]));
    Front { left_m: least.min(most), right_m: most.max(least), nearest }
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
/// plus an Ornstein-Uhlenbeck process that begins at 0 with the noise [`LATERAL_PROCESS_NOISE`] and forgets within [`WANDER_TIME_S`]: at
/// first a random walk of the speed, later bounded, as nobody who walks or drives along sways ever faster.
fn wander_m2(seconds: f64) -> f64 {
    let ratio = seconds / WANDER_TIME_S;
    // A cubic from here on down is more exact than the difference of the terms.
    if ratio < 1e-3 {
        return LATERAL_PROCESS_NOISE * seconds.powi(3) / 3.0;
    }
    let forgotten = 1.0 - (-ratio).exp();
    let forgotten_twice = 1.0 - (-2.0 * ratio).exp();
    LATERAL_PROCESS_NOISE * WANDER_TIME_S.powi(3) * (ratio - 2.0 * forgotten + forgotten_twice / 2.0)
}

/// Lateral acceleration of a thing that follows our path at its speed, in m/s².
fn following_m_s2(path: &SweptPath, ground: &GroundMotion, along: &AlongPath) -> f64 {
    let [right_m_s, ahead_m_s] = ground.speed_m_s;
    (right_m_s * right_m_s + ahead_m_s * ahead_m_s) * path.curvature_at(along.arc_m).abs()
}

/// How an obstacle may go on.
struct Course {
    ground: GroundMotion,
    /// Whether it may drive along our path.
    may_follow: bool,
    /// Whether it is traffic that keeps to its lane.
    keeps_lane: bool,
}

/// Variance of the offset of an obstacle at the arrival in `seconds`, without that of the path. `closing_m_s`: the speed with which the
/// vehicle arrives.
fn variance_m2(
    path: &SweptPath,
    course: &Course,
    along: &AlongPath,
    (seconds, closing_m_s): (f64, f64),
) -> f64 {
    let ground = &course.ground;
    // The offset is across the path's heading there.
    let (sine, cosine) = along.heading_rad.sin_cos();
    let [right_m_s, ahead_m_s] = ground.speed_m_s;
    // What is farther away, or slower to come, is met later, and farther along its way.
    let way = if closing_m_s > MIN_CLOSING_M_S {
        ((cosine * right_m_s + sine * ahead_m_s) / closing_m_s).clamp(-MAX_WAY, MAX_WAY)
    } else {
        0.0
    };
    let across = [cosine - way * sine, sine + way * cosine];
    let moved_s = if ground.movement == Movement::Standing { 0.0 } else { seconds };
    let by = Vector4::new(across[0], across[1], across[0] * moved_s, across[1] * moved_s);
    let measured_m2 = by.dot(&(ground.covariance() * by)).max(0.0) + SIDE_SIGMA_M * SIDE_SIGMA_M;
    if ground.movement == Movement::Standing {
        return measured_m2;
    }
    let wander_share = if course.keeps_lane { LANE_WANDER_SHARE } else { 1.0 };
    let mut sum_m2 = measured_m2 + wander_share * wander_m2(seconds);
    if course.may_follow {
        let turned_m = BEND_SHARE * following_m_s2(path, ground, along) * seconds * seconds / 2.0;
        let headed_m = path.heading_sigma_rad(along.arc_m) * ahead_m_s.hypot(right_m_s) * seconds;
        sum_m2 += turned_m * turned_m + headed_m * headed_m;
    }
    sum_m2
}

/// Standard deviation of the path across for what follows it from the arc length `now_m` to `arrival_m`, in metres. The heading of
/// what comes towards us tells how the road turns up to there: in doubt is our way to the meeting, and its own from where it is.
/// (A bend that is not known shifts it there by δ(s) and turns its speed by δ'(s); from there back to the meeting that is the
/// deviation from its tangent.) It drives its part in the `seconds` until then.
fn followed_sigma_m(path: &SweptPath, now_m: f64, arrival_m: f64, seconds: f64) -> f64 {
    if arrival_m < now_m {
        path.sigma_m(arrival_m).hypot(path.sigma_after_m(now_m - arrival_m, seconds))
    } else {
        path.sigma_m(now_m)
    }
}

impl Obstacle {
    /// With how much it brakes, in m/s², as its time to collision says; 0 if it does not.
    fn braking_m_s2(&self) -> f64 {
        let moves = self.ground.movement != Movement::Standing;
        let measured = self.time_to_collision.filter(|_| moves);
        measured.map_or(0.0, |ttc| ttc.braking_m_s2(self.place_m[1], self.closing_m_s))
    }
}

/// Motion of an obstacle, with what is known of traffic that drives along our path ([`MIN_TRAFFIC_M_S`]): the less its speed across is
/// known, the more it is that of a lane. What is measured to leave its lane, by two standard deviations, is not in one. Returns whether
/// it keeps to one, too.
fn as_traffic(path: &SweptPath, obstacle: &Obstacle) -> (GroundMotion, bool) {
    let ground = obstacle.ground;
    let along = path.along(obstacle.place_m);
    let (sine, cosine) = along.heading_rad.sin_cos();
    let turned = |[right, ahead]: Planar| [cosine * right + sine * ahead, cosine * ahead - sine * right];
    let [across_m_s, along_m_s] = turned(ground.speed_m_s);
    let speed_m_s = across_m_s.hypot(along_m_s);
    let covariance = ground.covariance();
    let by_speed = Vector4::new(0.0, 0.0, cosine, sine);
    let with = covariance * by_speed;
    let measured_m2 = by_speed.dot(&with).max(0.0);
    // The lane's heading is that of the path, as far as it is known there.
    let heading_rad = path.heading_sigma_rad(along.arc_m).hypot(path.curvature_sigma_per_m * along.arc_m);
    let lane_m2 = TRAFFIC_ACROSS_SIGMA_M_S.powi(2) + (heading_rad * speed_m_s).powi(2);
    let leaves = across_m_s * across_m_s > 4.0 * (lane_m2 + measured_m2);
    if speed_m_s < MIN_TRAFFIC_M_S || across_m_s.abs() > MAX_TRAFFIC_SINE * speed_m_s || leaves {
        return (ground, false);
    }
    let gain = with / (lane_m2 + measured_m2);
    let [right_m_s, ahead_m_s] = ground.speed_m_s;
    let speed_m_s = [right_m_s - gain[2] * across_m_s, ahead_m_s - gain[3] * across_m_s];
    let kept = GroundMotion { speed_m_s, ..ground }.with_covariance(&(covariance - gain * with.transpose()));
    (kept, true)
}

/// When the arc length between front and obstacle is 0, in seconds, and the mean speed at which it closes, in m/s. `gap_m` is that
/// length now, `ahead_m` after a time; `seconds` is a first guess. In a turn what comes from afar closes along the arc at first faster,
/// later slower: chords from now lead to a time after the arrival, secants between both times to it (regula falsi). What passes
/// beside a tight turn may only come near; it arrives when it is nearest. `None` if it does not come nearer.
fn arrival(gap_m: f64, mut seconds: f64, ahead_m: impl Fn(f64) -> f64) -> Option<(f64, f64)> {
    let mut before = (0.0, gap_m);
    let mut after: Option<(f64, f64)> = None;
    let between = |before: (f64, f64), after: (f64, f64)| {
        before.0 + (after.0 - before.0) * before.1 / (before.1 - after.1)
    };
    for _ in 0..MAX_SECANTS {
        let left_m = ahead_m(seconds);
        if left_m.abs() < ARRIVAL_ERROR_M {
            return Some((seconds, gap_m / seconds));
        }
        if left_m < 0.0 {
            after = Some((seconds, left_m));
        } else if left_m < before.1 {
            before = (seconds, left_m);
        } else {
            break;
        }
        let next = match after {
            Some(after) => between(before, after),
            None => gap_m * seconds / (gap_m - left_m),
        };
        if next > MAX_PREDICTION_S {
            // Later than predictions reach.
            return Some((MAX_PREDICTION_S, (gap_m - left_m) / seconds));
        }
        seconds = next;
    }
    let found_s = after.map_or(before.0, |after| between(before, after));
    (found_s > 0.0).then(|| (found_s, gap_m / found_s))
}

/// How the vehicle meets an obstacle on its path.
pub fn encounter(path: &SweptPath, obstacle: &Obstacle) -> Encounter {
    let place = obstacle.place_m;
    let (ground, keeps_lane) = as_traffic(path, obstacle);
    let at =
        |seconds: f64| [place[0] + ground.speed_m_s[0] * seconds, place[1] + ground.speed_m_s[1] * seconds];
    let now = front(path, place, obstacle);
    let camera_m = path.body.rear_axle_m;
    let distance_m = now.nearest.arc_m - camera_m;
    // What is hit is the front, so arrival is its arrival.
    let gap_m = distance_m - path.body.front_m;
    // Arc length between front and obstacle after a time.
    let ahead_m = |seconds: f64| {
        front(path, at(seconds), obstacle).nearest.arc_m
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
        if ground.movement != Movement::Standing {
            let found = arrival(gap_m, seconds, ahead_m).filter(|(_, mean)| *mean > MIN_CLOSING_M_S);
            if let Some((found_s, mean_m_s)) = found {
                closing_m_s = mean_m_s;
                let braking_m_s2 = obstacle.braking_m_s2();
                seconds = if braking_m_s2 > 0.0 {
                    braking_seconds(gap_m, mean_m_s, braking_m_s2).min(MAX_PREDICTION_S)
                } else {
                    found_s
                };
            }
        }
        arrival_s = Some(seconds);
    }
    let seconds = arrival_s.unwrap_or(0.0);
    let then = front(path, at(seconds), obstacle);
    // Whether it may follow our path, as traffic does, or can only go on as it goes.
    let may_follow = following_m_s2(path, &ground, &now.nearest) <= MAX_FOLLOWING_M_S2;
    let course = Course { ground, may_follow, keeps_lane };
    let own_m2 = |along: &AlongPath, seconds: f64| {
        let is_arrival = seconds > 0.0 && seconds < MAX_PREDICTION_S;
        let met_m_s = if is_arrival { closing_m_s } else { 0.0 };
        variance_m2(path, &course, along, (seconds, met_m_s))
    };
    let now_m = now.nearest.arc_m;
    // Where the vehicle's front then is, or what comes from there later than predictions reach.
    let arrival_m = then.nearest.arc_m.max(camera_m + path.body.front_m);
    let probability_now =
        overlap(path, &now, 0.0, own_m2(&now.nearest, 0.0).sqrt().hypot(path.sigma_m(now_m)));
    // Straight on. What comes towards us is met nearer than it is, where less is in doubt of our path.
    let straight_own_m = own_m2(&then.nearest, seconds).sqrt();
    let straight_path_m = path.sigma_m(arrival_m.min(now_m));
    let straight_sigma_m = straight_own_m.hypot(straight_path_m);
    let straight = overlap(path, &then, 0.0, straight_sigma_m);
    // Along the path, across its heading at the obstacle.
    let (sine, cosine) = now.nearest.heading_rad.sin_cos();
    let across_m_s = cosine * ground.speed_m_s[0] + sine * ground.speed_m_s[1];
    let along_sigma_m =
        own_m2(&now.nearest, seconds).sqrt().hypot(followed_sigma_m(path, now_m, arrival_m, seconds));
    let along_path = overlap(path, &now, across_m_s * seconds, along_sigma_m);
    let is_straight = !may_follow || (probability_now >= IN_THE_WAY) == (straight >= along_path);
    let (probability_then, sigma_then, clearance_m) = if is_straight {
        (straight, straight_sigma_m, clearance_m(path, &then, 0.0))
    } else {
        (along_path, along_sigma_m, clearance_m(path, &now, across_m_s * seconds))
    };
    let clearance_now_m = self::clearance_m(path, &now, 0.0);
    let is_rider = ground.movement == Movement::Moving
        && obstacle.width_m <= MAX_RIDER_M
        && ground.speed_m_s[0].hypot(ground.speed_m_s[1]) <= MAX_RIDER_M_S;
    let is_path_in_doubt = is_rider && is_straight && !keeps_lane && straight_path_m > straight_own_m;
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
        is_path_in_doubt,
        clearance_m,
        clearance_now_m,
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
mod tests;
