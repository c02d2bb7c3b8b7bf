//! Tests of things that the border of the picture cuts, seen from a vehicle whose motion is known.

use super::*;
use crate::outline::Outline;
use crate::region::PixelBox;

const RIG: Rig = Rig { focal_px: 879.0, baseline_m: 0.12, cx_px: 320.0, cy_px: 240.0 };
const SIZE: (usize, usize) = (640, 480);
const PERIOD_S: f64 = 0.08;
const OWN_M_S: f64 = 11.0;

fn normal(random: &mut fastrand::Rng) -> f64 {
    (0..12).map(|_| random.f64()).sum::<f64>() - 6.0
}

/// What both pictures show of a thing between two places beside the axis, in metres; `None` if nothing. On the left the right
/// picture misses as many columns as the disparity.
fn sighting(random: &mut fastrand::Rng, distance_m: f64, sides_m: [f64; 2]) -> Option<Region> {
    let disparity_px = RIG.disparity_px(distance_m);
    let column = |m: f64| RIG.cx_px + RIG.focal_px * m / distance_m + 2.0 * (random.f64() - 0.5);
    let [left, right] = sides_m.map(column).map(|px| px.clamp(disparity_px, 640.0));
    let bounds = PixelBox { x: left as u32, y: 190, width: (right - left) as u32, height: 100 };
    let measured_px = disparity_px + 0.1 * normal(random);
    let distance_m = RIG.focal_px * RIG.baseline_m / measured_px;
    (bounds.width > 12).then(|| Region {
        bounds,
        disparity_px: measured_px,
        disparity_sigma_px: 0.1,
        distance_m,
        lateral_m: RIG.lateral_m((left + right) / 2.0, distance_m),
        width_m: (right - left) * distance_m / RIG.focal_px,
        height_m: 1.5,
        inset_m: [0.0; 2],
        is_hidden: [false; 2],
        goes_on: [false; 2],
        outline: Outline::default(),
        pixels: bounds.width * bounds.height,
        confidence: 0.9,
        evidence: 3.5,
    })
}

/// A tracker and its time.
struct Drive {
    tracker: Tracker,
    random: fastrand::Rng,
    frame: u64,
    /// Whether something nearer hides what is beyond the left and the right side of what is seen.
    is_hidden: [bool; 2],
    /// Whether its surface goes on there.
    goes_on: [bool; 2],
}

impl Drive {
    fn new(seed: u64) -> Self {
        let tracker = Tracker::new(TrackerParameters::default(), RIG, SIZE);
        Self {
            tracker,
            random: fastrand::Rng::with_seed(seed),
            frame: 0,
            is_hidden: [false; 2],
            goes_on: [false; 2],
        }
    }

    /// The track of the only thing after this frame, if it is seen.
    fn see(&mut self, distance_m: f64, sides_m: [f64; 2]) -> Option<Track> {
        self.see_with(&[], distance_m, sides_m)
    }

    /// The same where odometry has found these points.
    fn see_with(&mut self, points: &[ScenePoint], distance_m: f64, sides_m: [f64; 2]) -> Option<Track> {
        self.see_turning(0.0, points, distance_m, sides_m)
    }

    /// The same while the vehicle turns with this yaw rate, in rad/s.
    fn see_turning(
        &mut self,
        yaw_rate_rad_s: f64,
        points: &[ScenePoint],
        distance_m: f64,
        sides_m: [f64; 2],
    ) -> Option<Track> {
        let seen = sighting(&mut self.random, distance_m, sides_m);
        let sightings: Vec<Region> = seen
            .into_iter()
            .map(|region| Region { is_hidden: self.is_hidden, goes_on: self.goes_on, ..region })
            .collect();
        let motion = Motion {
            speed_m_s: OWN_M_S,
            speed_sigma_m_s: 0.1,
            yaw_rate_rad_s,
            yaw_rate_sigma_rad_s: 0.003,
            ..Motion::default()
        };
        let time_ns = self.frame * (PERIOD_S * 1e9) as u64;
        self.frame += 1;
        let frame = Frame { motion: Some(motion), points, ..Frame::new(time_ns, &sightings) };
        let tracks = self.tracker.follow(&frame);
        tracks.first().copied().filter(|_| !sightings.is_empty())
    }
}

#[test]
fn a_car_that_comes_into_view_is_as_fast_as_its_front() {
    let mut worst = 0.0_f64;
    for seed in 0..20 {
        let mut drive = Drive::new(seed);
        let mut seen = 0;
        // It drives to the left across our path with 40 km/h; its front is 2 m away from the axis at 10 m.
        for frame in 0..7 {
            let t = f64::from(frame) * PERIOD_S;
            let front_m = 2.9 - 11.1 * t;
            let Some(track) = drive.see(10.5 - OWN_M_S * t, [front_m, front_m + 4.0]) else { continue };
            seen += 1;
            if seen >= 4 {
                worst = worst.max((track.filter.speed_m_s()[0] + 11.1).abs());
                assert!(track.movement == Movement::Moving, "seed {seed}, frame {seen}: {track:?}");
                // The side that is seen, and the width as far as it is.
                let side_m = track.lateral_m() - track.front_m() / 2.0;
                assert!((side_m - front_m).abs() < 0.5, "seed {seed}: {side_m}, {front_m}");
            }
        }
        assert!(seen >= 5, "{seen}");
    }
    println!("error of the speed from the fourth sighting on: {worst:.1} m/s at most, seeds 0 to 19");
    // With errors as large as what comes into view it was 1.3 m/s.
    assert!(worst < 1.0, "{worst}");
}

/// Of a bicycle that comes out from behind a wall on the right, 1.3 m of it so far: root mean square error of the speed across, in m/s, and
/// of its front's place, in metres, and the largest jitter of its width.
fn errors_behind_a_wall(is_hidden: [bool; 2]) -> [f64; 3] {
    let (mut squares, mut jitter) = ([0.0; 2], 0.0_f64);
    for seed in 0..20 {
        let mut drive = Drive { is_hidden, ..Drive::new(seed) };
        let mut last = None;
        let front_m = |t: f64| 1.7 - 2.8 * t;
        for frame in 0..6 {
            let t = f64::from(frame) * PERIOD_S;
            last = drive.see(12.0 - OWN_M_S * t, [front_m(t), 1.9]).or(last);
        }
        let track = last.unwrap();
        let side_m = track.lateral_m() - track.front_m() / 2.0;
        squares[0] += (track.filter.speed_m_s()[0] + 2.8).powi(2) / 20.0;
        squares[1] += (side_m - front_m(5.0 * PERIOD_S)).powi(2) / 20.0;
        jitter = jitter.max(track.width_jitter);
    }
    [squares[0].sqrt(), squares[1].sqrt(), jitter]
}

#[test]
fn who_comes_out_from_behind_a_wall_is_as_fast_as_the_side_that_is_seen() {
    let (middle, side) = (errors_behind_a_wall([false; 2]), errors_behind_a_wall([false, true]));
    println!("errors of speed and side, and jitter, by the middle {middle:.2?}, by the side {side:.2?}");
    assert!(side[0] < 0.8 * middle[0] && side[1] < 0.3, "{middle:?} {side:?}");
    // A larger one keeps the alarm silent.
    assert!(side[2] < 0.4 && middle[2] > 0.4, "{middle:?} {side:?}");
}

#[test]
fn a_parked_car_that_is_passed_stands() {
    let (mut moving, mut frames) = (0, 0);
    for seed in 0..20 {
        let mut drive = Drive::new(seed);
        for frame in 0..40 {
            let near_m = 30.0 - OWN_M_S * f64::from(frame) * PERIOD_S;
            // Its inner side is rounded: half a metre of it comes into view, or does not, as the angle grows.
            let rounded_m = 0.2 * (1.6 / near_m.max(1.0)).min(1.0);
            if near_m < 3.0 {
                break;
            }
            let Some(track) = drive.see(near_m, [1.6 + rounded_m, 3.4]) else { continue };
            frames += 1;
            moving += i32::from(track.movement == Movement::Moving);
        }
    }
    println!("parked car: {moving} of {frames} frames moving, seeds 0 to 19");
    assert!(50 * moving <= frames, "{moving} of {frames}");
}

#[test]
fn what_was_seen_together_with_the_background_becomes_narrower_as_it_comes_into_view() {
    let mut drive = Drive::new(1);
    let mut last = None;
    // A motorcycle 2.1 m long comes from the left with 20 km/h; the first two sightings contain a wall behind it.
    for frame in 0..20 {
        let t = f64::from(frame) * PERIOD_S;
        let front_m = -7.5 + 5.5 * t;
        let right_m = if frame < 2 { front_m + 2.6 } else { front_m };
        last = drive.see(22.0 - 4.0 * t, [front_m - 2.1, right_m]).or(last);
    }
    let track = last.unwrap();
    assert!((1.6..2.6).contains(&track.front_m()), "{} m", track.front_m());
}

/// The tracks of somebody half a metre wide who stands 6 m to the left, and sets off at 4 m/s as the border of the picture cuts them;
/// once before that they are seen together with what is beside them. With each track, where they are.
fn somebody_who_sets_off(seed: u64) -> Vec<(Track, f64)> {
    let mut drive = Drive::new(seed);
    let mut tracks = Vec::new();
    for frame in 0..30 {
        let distance_m = 30.0 - OWN_M_S * PERIOD_S * f64::from(frame);
        let middle_m = -6.0 + 4.0 / OWN_M_S * (17.0 - distance_m).max(0.0);
        let seen_m = if frame == 14 { [-8.0, -4.3] } else { [middle_m - 0.25, middle_m + 0.25] };
        tracks.extend(drive.see(distance_m, seen_m).map(|track| (track, middle_m)));
    }
    tracks
}

#[test]
fn who_was_seen_as_a_whole_keeps_the_width_at_the_border() {
    for seed in 0..20 {
        let tracks = somebody_who_sets_off(seed);
        let last = tracks[tracks.len() - 1];
        let widest_m = tracks.iter().skip(4).map(|(track, _)| track.front_m()).fold(0.0, f64::max);
        assert!(widest_m < 1.0, "seed {seed}: {widest_m} m");
        assert!((last.0.lateral_m() - last.1).abs() < 0.4, "seed {seed}: {} m", last.0.lateral_m() - last.1);
    }
}

#[test]
fn a_width_that_varied_before_the_border_cut_it_is_forgotten() {
    // Fragments of a thing near the border, then its front as it comes in.
    let mut drive = Drive::new(2);
    for frame in 0..6 {
        let right_m = if frame % 2 == 0 { -4.2 } else { -2.9 };
        drive.see(18.0 - 0.8 * f64::from(frame), [-4.8, right_m]);
    }
    let varied = drive.tracker.tracks().iter().map(|t| t.width_jitter).fold(0.0, f64::max);
    let mut last = None;
    for frame in 0..10 {
        let t = f64::from(frame) * PERIOD_S;
        last = drive.see(13.2 - 10.0 * t, [-8.0, -3.0 + 4.0 * t]).or(last);
    }
    let track = last.unwrap();
    println!("width jitter {varied:.2}, then {:.2}", track.width_jitter);
    assert!(varied > 0.4 && track.width_jitter < 0.4, "{varied}, {}", track.width_jitter);
}

/// Speeds to the right and forward that a fence on the left seems to have. Each frame shows another part of it, farther to the right
/// as it comes nearer to the road, and less near than what was seen before would be.
fn speeds_of_a_fence(with_points: bool) -> ([f64; 2], Movement) {
    let mut drive = Drive::new(3);
    let mut last = None;
    for frame in 0..12 {
        let t = f64::from(frame) * PERIOD_S;
        let (near_m, right_m) = (11.0 - 6.0 * t, -3.4 + 1.6 * t);
        let column = RIG.cx_px + RIG.focal_px * (right_m - 0.25) / near_m;
        let points = [-3.0, 0.0, 3.0].map(|by_px| ScenePoint {
            at_px: [column + by_px, 230.0],
            distance_m: near_m,
            is_static: true,
        });
        let points = if with_points { &points[..] } else { &[] };
        last = drive.see_with(points, near_m, [right_m - 1.4, right_m]).or(last);
    }
    let ground = last.and_then(|track| track.ground()).expect("the own motion is known");
    (ground.speed_m_s, ground.movement)
}

#[test]
fn a_fence_whose_box_moves_stands_as_its_points_do() {
    let (without, with) = (speeds_of_a_fence(false), speeds_of_a_fence(true));
    println!("without points {without:?}, with {with:?}");
    assert!(without.1 == Movement::Moving && without.0[0] > 1.0, "the box alone moves: {without:?}");
    assert!(with.1 != Movement::Moving && with.0.iter().all(|v| v.abs() < 0.6), "{with:?}");
}

#[test]
fn static_points_on_what_moves_and_is_followed_count_when_they_persist() {
    // A car crosses to the right with 5 m/s. Speed across after eight frames, in the last of which static points lie in its box.
    let speed_m_s = |with_points: u64, is_followed: bool| {
        let mut drive = Drive::new(2);
        let mut last = None;
        for frame in 0..8 {
            let t = frame as f64 * PERIOD_S;
            let (near_m, left_m) = (14.0 - OWN_M_S * t, -2.5 + 5.0 * t);
            let column = RIG.cx_px + RIG.focal_px * (left_m + 0.9) / near_m;
            let points = [-20.0, 0.0, 20.0].map(|by_px| ScenePoint {
                at_px: [column + by_px, 230.0],
                distance_m: near_m,
                is_static: true,
            });
            drive.tracker.tracks.iter_mut().for_each(|track| track.is_followed = is_followed);
            let points = if frame + with_points >= 8 { &points[..] } else { &[] };
            last = drive.see_with(points, near_m, [left_m, left_m + 1.8]);
        }
        last.and_then(|track| track.ground()).map_or(f64::NAN, |ground| ground.speed_m_s[0])
    };
    let speeds =
        [(0, true), (2, true), (3, true), (1, false)].map(|(frames, followed)| speed_m_s(frames, followed));
    println!("speeds across {speeds:.1?}");
    assert!(
        speeds[..2].iter().all(|v| (v - 5.0).abs() < 1.0) && speeds[2..].iter().all(|v| v.abs() < 1.5),
        "{speeds:?}"
    );
}

#[test]
fn the_side_of_a_parked_car_that_is_passed_is_nothing_new() {
    // Numbers of the tracks that begin after a car 1.6 to 3.4 m to the right has come near, with slivers of this place beside the
    // axis, so far behind its near side.
    let begun_turning = |yaw_rate_rad_s: f64, has_car: bool, sides_m: [f64; 2], behind_m: f64| {
        let (mut drive, mut begun) = (Drive::new(3), 0);
        for frame in 0..34 {
            let near_m = 30.0 - OWN_M_S * f64::from(frame) * PERIOD_S;
            if has_car && near_m > 3.3 {
                drive.see(near_m, [1.6, 3.4]);
                continue;
            }
            let before = drive.tracker.next_id;
            let (yaw_rate_rad_s, sides_m) =
                if near_m > 3.3 { (0.0, [40.0, 41.0]) } else { (yaw_rate_rad_s, sides_m) };
            drive.see_turning(yaw_rate_rad_s, &[], near_m + behind_m, sides_m);
            begun += drive.tracker.next_id - before;
        }
        begun
    };
    let begun = |has_car: bool, sides_m, behind_m| begun_turning(0.0, has_car, sides_m, behind_m);
    let side_m = [1.5, 1.8];
    assert_eq!((begun(true, side_m, 2.5), begun(false, side_m, 2.5)), (0, 1), "its side");
    assert_eq!(begun(true, [-0.3, 0.3], 2.5), 1, "what is in the path");
    assert_eq!(begun(true, side_m, 6.0), 1, "what stands behind it");
    assert!(begun_turning(-0.6, true, side_m, 2.5) > 0, "in a bend it may lie in the own way");
}

/// Number of pieces of a hedge, of 20, that seem to move: the picture cuts the left side, and the right side, where it was divided, stays in
/// the same column as the vehicle drives.
fn moving_hedges(goes_on: [bool; 2]) -> usize {
    let moves = |seed: &u64| {
        let mut drive = Drive { goes_on, ..Drive::new(*seed) };
        (0..10).any(|frame| {
            let distance_m = 16.0 - OWN_M_S * f64::from(frame) * PERIOD_S;
            let left_m = -RIG.cx_px / RIG.focal_px * distance_m;
            let track = drive.see(distance_m, [left_m, 0.6 * left_m]);
            track.is_some_and(|track| track.movement == Movement::Moving)
        })
    };
    (0..20).filter(moves).count()
}

#[test]
fn a_side_where_a_surface_was_divided_tells_no_motion() {
    let (as_an_end, divided) = (moving_hedges([false; 2]), moving_hedges([false, true]));
    println!(
        "pieces of a hedge that seem to move, of 20: {as_an_end} if the division is taken for an end, else {divided}"
    );
    assert!(as_an_end >= 10 && divided == 0, "{as_an_end} {divided}");
}
