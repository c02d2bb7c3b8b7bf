use super::estimate::{VX, VZ, Z};
use super::*;

/// Focal length × baseline of the paper's rig, px·m.
const SCALE: f64 = 105.5;
const PERIOD_S: f64 = 0.08;

/// Normalised estimation error squared (NEES) of distance and closing speed against the true values; its
/// expected value is 2 for a consistent filter.
fn nees_of(filter: &Estimate, distance_m: f64, closing_m_s: f64) -> f64 {
    let [a, b, c] = [(Z, Z), (Z, VZ), (VZ, VZ)].map(|i| filter.p[i]);
    let (dz, dv) = (filter.state[Z] - distance_m, filter.state[VZ] + closing_m_s);
    (c * dz * dz - 2.0 * b * dz * dv + a * dv * dv) / (a * c - b * b)
}

/// A filter of something ahead at this disparity, in px.
fn ahead(disparity_px: f64, sigma_px: f64) -> TrackFilter {
    TrackFilter::new(SCALE, (disparity_px, sigma_px), (0.0, 0.1))
}

/// A normally distributed random number.
fn normal(random: &mut fastrand::Rng) -> f64 {
    (-2.0 * (1.0 - random.f64()).ln()).sqrt() * (std::f64::consts::TAU * random.f64()).cos()
}

/// Simulates an approach. Returns the mean NEES and the largest error of the time to collision from 2.5 s
/// down, relative and in standard deviations.
fn approach(seed: u64, from_m: f64, closing: f64, sigma_px: f64) -> (f64, f64, f64) {
    let mut random = fastrand::Rng::with_seed(seed);
    let mut z = from_m;
    let measure = |z: f64, random: &mut fastrand::Rng| SCALE / z + sigma_px * normal(random);
    let mut filter = ahead(measure(z, &mut random), sigma_px);
    let (mut nees, mut frames, mut worst, mut most) = (0.0, 0, 0.0_f64, 0.0_f64);
    loop {
        z -= closing * PERIOD_S;
        if z < 3.0 {
            return (nees / f64::from(frames), worst, most);
        }
        filter.predict(PERIOD_S);
        filter.measure_disparity(measure(z, &mut random), sigma_px);
        nees += nees_of(&filter, z, closing);
        frames += 1;
        let truth = z / closing;
        if let Some(ttc) = filter.time_to_collision().filter(|_| truth <= 2.5) {
            worst = worst.max((ttc.seconds - truth).abs() / truth);
            most = most.max((ttc.seconds - truth).abs() / ttc.sigma_s);
        }
    }
}

#[test]
fn the_filter_is_consistent() {
    for (from_m, closing, sigma_px) in [(60.0, 14.0, 0.12), (30.0, 5.0, 0.12), (60.0, 25.0, 0.15)] {
        let runs = 200;
        let results: Vec<_> = (0..runs).map(|s| approach(s, from_m, closing, sigma_px)).collect();
        let nees = results.iter().map(|r| r.0).sum::<f64>() / runs as f64;
        let sorted = |of: &dyn Fn(&(f64, f64, f64)) -> f64| {
            let mut all: Vec<f64> = results.iter().map(of).collect();
            all.sort_unstable_by(f64::total_cmp);
            all
        };
        let (worst, most) = (sorted(&|r| r.1), sorted(&|r| r.2));
        println!(
            "{from_m} m at {closing} m/s, {sigma_px} px, seeds 0 to 199: NEES {nees:.2} (2 expected), worst \
             TTC error of a run from 2.5 s down: median {:.1} %, 95 % {:.1} %; in stated deviations {:.1}, {:.1}",
            100.0 * worst[100],
            100.0 * worst[190],
            most[100],
            most[190]
        );
        // Below 2, as the process noise allows for accelerations that these runs do not have; above 2 at
        // 25 m/s, which is twice the initial standard deviation.
        assert!((0.8..3.0).contains(&nees), "NEES {nees}");
        assert!(most[190] < 3.5, "{}", most[190]);
    }
}

#[test]
fn a_static_object_has_no_closing_speed() {
    let mut false_times = 0;
    for seed in 0..50 {
        let mut random = fastrand::Rng::with_seed(seed);
        let mut filter = ahead(5.0, 0.15);
        for _ in 0..60 {
            filter.predict(PERIOD_S);
            filter.measure_disparity(5.0 + 0.15 * normal(&mut random), 0.15);
        }
        assert!(filter.closing_m_s().abs() < 1.5, "seed {seed}: {}", filter.closing_m_s());
        false_times += u32::from(filter.time_to_collision().is_some_and(|t| t.seconds < 10.0));
    }
    assert!(false_times <= 3, "{false_times} of 50");
}

#[test]
fn an_outlier_has_little_effect_and_a_lasting_change_is_followed() {
    let mut filter = ahead(SCALE / 20.0, 0.12);
    for _ in 0..20 {
        filter.predict(PERIOD_S);
        filter.measure_disparity(SCALE / 20.0, 0.12);
    }
    let before = filter;
    filter.predict(PERIOD_S);
    filter.measure_disparity(SCALE / 14.0, 0.12);
    assert!((filter.distance_m() - before.distance_m()).abs() < 0.3, "{filter:?}");
    assert!(filter.closing_m_s() < 1.0, "{filter:?}");
    // From now on the car ahead brakes with 6 m/s².
    let (mut z, mut v) = (20.0, 0.0);
    let mut filter = before;
    for _ in 0..15 {
        v += 6.0 * PERIOD_S;
        z -= v * PERIOD_S;
        filter.predict(PERIOD_S);
        filter.measure_disparity(SCALE / z, 0.12);
    }
    let lag = v - filter.closing_m_s();
    println!("after 1.2 s of braking at 6 m/s²: {v:.1} m/s, filter {:.1}", filter.closing_m_s());
    assert!(lag.abs() < 0.3 * v, "{lag} of {v}");
}

#[test]
fn a_sudden_stop_does_not_overshoot() {
    let (mut overshot, mut worst_speed) = (Vec::new(), 0.0_f64);
    for (closing, stop_m) in [(4.0, 4.0), (4.0, 8.0), (8.0, 8.0), (8.0, 12.0)] {
        for seed in 0..50 {
            let mut random = fastrand::Rng::with_seed(seed);
            let mut measure = |z: f64| SCALE / z + 0.12 * normal(&mut random);
            let mut z = stop_m + 20.0;
            let mut filter = ahead(measure(z), 0.12);
            let (mut frames, mut least) = (0, f64::INFINITY);
            while frames < 12 {
                if z > stop_m {
                    z -= closing * PERIOD_S;
                } else {
                    frames += 1;
                }
                filter.predict(PERIOD_S);
                filter.measure_disparity(measure(z), 0.12);
                least = least.min(filter.distance_m() - z);
            }
            overshot.push(-least / (closing * PERIOD_S));
            worst_speed = worst_speed.max(filter.closing_m_s().abs());
        }
    }
    overshot.sort_unstable_by(f64::total_cmp);
    println!(
        "a stop in one frame: overshot by {:.1} frames' way (median), {:.1} (most); a second later {worst_speed:.2} m/s at most",
        overshot[100], overshot[199]
    );
    // Two outliers are down-weighted, the third resets the state.
    assert!(overshot[100] < 2.5 && overshot[199] < 5.5, "{overshot:?}");
    assert!(worst_speed < 1.5, "{worst_speed}");
}

#[test]
fn a_sudden_stop_is_followed_within_four_frames() {
    let mut worst = 0.0_f64;
    for seed in 0..50 {
        let mut random = fastrand::Rng::with_seed(seed);
        let mut z = 14.0;
        let mut filter = ahead(SCALE / z, 0.12);
        let mut errors = Vec::new();
        for _ in 0..40 {
            z = f64::max(z - 4.0 * PERIOD_S, 6.0);
            filter.predict(PERIOD_S);
            filter.measure_disparity(SCALE / z + 0.06 * normal(&mut random), 0.12);
            errors.push((filter.distance_m() - z).abs());
        }
        // The object stands from frame 25 on; the filter has converged four frames later.
        worst = errors[28..].iter().fold(worst, |worst, &e| worst.max(e));
        assert!(filter.closing_m_s().abs() < 0.7, "seed {seed}: {}", filter.closing_m_s());
    }
    println!("worst error from four frames after the stop on, seeds 0 to 49: {worst:.2} m");
    assert!(worst < 0.3, "{worst}");
}

#[test]
fn uncertainty_grows_without_measurements_and_stays_finite() {
    let mut filter = ahead(5.0, 0.2);
    filter.measure_disparity(5.0, 0.0);
    let before = filter.place_sigma_m()[1];
    for _ in 0..1000 {
        filter.predict(0.5);
    }
    assert!(filter.place_sigma_m()[1] > before && filter.distance_m() > 0.0);
    filter.measure_disparity(0.01, 0.2);
    filter.measure_disparity(300.0, 0.2);
    assert!(filter.distance_m().is_finite() && filter.speed_sigma_m_s()[1].is_finite());
}

#[test]
fn the_lateral_speed_of_a_pedestrian_is_estimated() {
    let mut worst = 0.0_f64;
    for seed in 0..50 {
        let mut random = fastrand::Rng::with_seed(seed);
        let (mut x, z) = (-4.0, 20.0);
        let mut filter = TrackFilter::new(SCALE, (SCALE / z, 0.12), (x / z, 0.1));
        for _ in 0..25 {
            x += 1.4 * PERIOD_S;
            filter.predict(PERIOD_S);
            filter.measure_disparity(SCALE / z + 0.12 * normal(&mut random), 0.12);
            filter.measure_across([x + 0.1 * normal(&mut random), z], 0.1, true);
        }
        worst = worst.max((filter.speed_m_s()[0] - 1.4).abs());
        assert!((filter.place_m()[0] - x).abs() < 0.3, "seed {seed}");
    }
    println!("worst error of the speed across after 2 s, seeds 0 to 49: {worst:.2} m/s");
    assert!(worst < 0.8, "{worst}");
}

#[test]
fn boxes_along_a_fence_do_not_come_in_unless_they_are_one_thing() {
    // Boxes at one bearing, as noise has it nearer each time: parts of a fence 7 m to the left, or one thing that comes in.
    let speed = |is_followed: bool| {
        let mut filter = TrackFilter::new(SCALE, (SCALE / 26.0, 0.12), (-7.0 / 26.0, 0.1));
        for frame in 1..12 {
            let z = 26.0 - 1.2 * f64::from(frame);
            filter.predict(PERIOD_S);
            filter.measure_disparity(SCALE / z, 0.12);
            // What is seen of a fence is at its place; what comes in at its bearing.
            let right_m = if is_followed { -7.0 / 26.0 * z } else { -7.0 };
            filter.measure_across([right_m, z], 0.1, is_followed);
        }
        filter.speed_m_s()[0]
    };
    let (fence, thing) = (speed(false), speed(true));
    assert!(fence.abs() < 0.5 && thing > 2.5, "{fence} {thing}");
}

/// Errors of the closing speed of what comes towards us with 25 m/s from 60 m on, after each frame (mean of 40 runs, in m/s).
fn oncoming(with_scale: bool) -> Vec<f64> {
    let mut errors = vec![0.0; 8];
    for seed in 0..40 {
        let mut random = fastrand::Rng::with_seed(seed);
        let at = |frame: usize| 60.0 - 25.0 * PERIOD_S * frame as f64;
        let mut filter = ahead(SCALE / at(0) + 0.1 * normal(&mut random), 0.15);
        filter.store_place(0.004, 0.02);
        let stored_m = at(0) * (1.0 + 0.003 * normal(&mut random));
        for (frame, error) in (1..).zip(&mut errors) {
            filter.predict(PERIOD_S);
            filter.measure_disparity(SCALE / at(frame) + 0.1 * normal(&mut random), 0.15);
            if with_scale {
                let scale = stored_m / at(frame) * (1.0 + 0.003 * normal(&mut random));
                filter.measure_scale(scale, 0.004, 0.4, 4.0);
            }
            *error += (filter.closing_m_s() - 25.0).abs() / 40.0;
        }
    }
    errors
}

#[test]
fn the_scale_tells_the_closing_speed_within_three_frames() {
    let (without, with) = (oncoming(false), oncoming(true));
    println!(
        "60 m, 25 m/s, seeds 0 to 39: errors {without:.1?} m/s by disparity, {with:.1?} m/s with the scale"
    );
    assert!(with[2] < 5.0 && with[2] < 0.5 * without[2], "{with:?} {without:?}");
}

#[test]
fn after_a_step_of_the_disparity_the_scale_still_tells_the_speed() {
    let mut filter = ahead(SCALE / 20.0, 0.1);
    for _ in 0..10 {
        filter.predict(PERIOD_S);
        filter.measure_disparity(SCALE / 20.0, 0.1);
    }
    filter.store_place(0.004, 0.02);
    // Another side of it, 5 m nearer, is seen from now on, and it comes with 4 m/s: its image grows as that of a thing at 15 m. A speed that
    // begins at once is taken for one that grows, and a little more of it is expected.
    for frame in 1..8 {
        let z = 15.0 - 4.0 * PERIOD_S * f64::from(frame);
        filter.predict(PERIOD_S);
        filter.measure_disparity(SCALE / z, 0.1);
        filter.measure_scale(15.0 / z, 0.004, 0.4, 4.0);
    }
    assert!((filter.closing_m_s() - 4.0).abs() < 0.7, "{filter:?}");
}

/// The change of the bearing of something 21 m straight ahead that has moved so far to the right, in metres.
fn change(way_m: f64, elapsed_s: f64) -> BearingChange {
    BearingChange {
        tangents: [0.0, way_m * 5.0 / SCALE],
        by_depth: way_m * 5.0 / SCALE,
        elapsed_s,
        sigma_m: 0.03,
        depth_sigma_m: 0.4,
    }
}

#[test]
fn of_a_bearing_that_contradicts_the_next_one_decides() {
    // Stands; then it seems to have moved by half a metre, and a frame later.
    let after = |ways_m: [f64; 2]| {
        let mut filter = ahead(5.0, 0.1);
        filter.store_place(0.004, 0.01);
        for frame in 1..=10 {
            let since = if frame > 5 { frame - 5 } else { frame };
            filter.predict(PERIOD_S);
            filter.measure_disparity(5.0, 0.1);
            filter.measure_bearing_change(&change(0.0, f64::from(since) * PERIOD_S));
            if frame % 5 == 0 {
                filter.store_place(0.004, 0.01);
            }
        }
        let mut elapsed_s = 0.0;
        let speeds = ways_m.map(|way_m| {
            elapsed_s += PERIOD_S;
            filter.predict(PERIOD_S);
            filter.measure_bearing_change(&change(way_m, elapsed_s));
            filter.speed_m_s()[0]
        });
        (speeds, filter.speed_sigma_m_s()[0])
    };
    let ([doubtful, wrong], _) = after([0.48, 0.0]);
    assert!((2.0..4.0).contains(&doubtful) && wrong.abs() < 0.5, "{doubtful} {wrong}");
    let ([_, moves], sigma) = after([0.48, 0.96]);
    assert!((moves - 6.0).abs() < 0.5 && sigma < 0.5, "{moves} {sigma}");
}

#[test]
fn what_is_found_again_elsewhere_has_the_speed_of_before() {
    // Seen twice, then lost for four frames, then something is 8 m nearer and 1.5 m farther to the left.
    let speeds_after = |is_found_again: bool| {
        let mut filter = TrackFilter::new(SCALE, (SCALE / 50.0, 0.1), (0.1, 0.1));
        filter.predict(PERIOD_S);
        filter.measure_disparity(SCALE / 50.0, 0.1);
        for _ in 0..5 {
            filter.predict(PERIOD_S);
        }
        let before = filter.speed_m_s();
        if is_found_again {
            filter.separate_speed();
        }
        filter.measure_disparity(SCALE / 42.0, 0.1);
        filter.measure_across([3.5, 42.0], 0.1, false);
        let after = filter.speed_m_s();
        ([after[0] - before[0], after[1] - before[1]], filter.distance_m())
    };
    let (changed, distance_m) = speeds_after(true);
    assert!(
        changed.iter().all(|v| v.abs() < 0.1) && (distance_m - 42.0).abs() < 4.0,
        "{changed:?} {distance_m}"
    );
    let (changed, _) = speeds_after(false);
    assert!(changed[0] < -1.0 && changed[1] < -4.0, "{changed:?}");
}

#[test]
fn what_scatters_less_than_stated_is_found_to_brake_earlier() {
    // At 16.7 m/s and a second's distance, braking with 4 m/s² from 1.6 s on; a part of the stated error is the same in each frame.
    let frames_until_found = |seed: u64, scatter_px: f64, offset_px: f64| {
        let mut random = fastrand::Rng::with_seed(seed);
        let at = |t: f64| 16.7 - 4.0 * t * t / 2.0;
        let mut filter = ahead(SCALE / at(0.0) + offset_px, 0.18);
        let first = (1..40).find(|&frame| {
            let since_s = (f64::from(frame) * PERIOD_S - 1.6).max(0.0);
            filter.predict(PERIOD_S);
            filter
                .measure_disparity(SCALE / at(since_s) + offset_px + scatter_px * normal(&mut random), 0.18);
            filter.choose_model();
            since_s > 0.0 && filter.acceleration_m_s2().is_some_and(|(a, _)| a < 0.0)
        });
        first.unwrap_or(40) - 20
    };
    let median = |scatter_px: f64, offset_px: f64| {
        let mut frames: Vec<i32> =
            (0..40).map(|seed| frames_until_found(seed, scatter_px, offset_px)).collect();
        frames.sort_unstable();
        frames[20]
    };
    let (steady, noisy) = (median(0.03, 0.1), median(0.18, 0.0));
    println!(
        "braking is found after {steady} frames where disparities scatter by 0.03 px, {noisy} by 0.18 px"
    );
    assert!(steady < noisy && steady <= 12, "{steady} {noisy}");
}

#[test]
fn standing_contradicts_what_is_known_to_move() {
    let filter_at = |speed_m_s: f64| {
        let mut filter = TrackFilter::new(SCALE, (SCALE / 8.0, 0.1), (0.1, 0.1));
        filter.both(|estimate| {
            (estimate.state[VX], estimate.p[(VX, VX)]) = (speed_m_s, 0.09);
            (estimate.state[VZ], estimate.p[(VZ, VZ)]) = (0.0, 0.09);
        });
        filter
    };
    let sigma_m_s = [0.4, 0.5];
    assert!(filter_at(5.6).contradicts_rest(sigma_m_s) && !filter_at(0.8).contradicts_rest(sigma_m_s));
    for (speed_m_s, most_m_s) in [(5.6, 1.0), (0.8, 0.6)] {
        let mut filter = filter_at(speed_m_s);
        filter.zero_velocity_update(sigma_m_s);
        assert!(filter.speed_m_s()[0].abs() < most_m_s, "{:?}", filter.speed_m_s());
    }
}
