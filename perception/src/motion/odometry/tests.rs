//! Odometry in a street that is rendered by ray casting: road, house fronts, an end wall, and a thing that moves.

use super::*;

const WIDTH: usize = 320;
const HEIGHT: usize = 240;
const RIG: Rig = Rig { focal_px: 300.0, baseline_m: 0.3, cx_px: 160.0, cy_px: 110.0 };
const PERIOD_S: f64 = 0.08;
const CAMERA_HEIGHT_M: f64 = 1.3;

/// A vertical rectangle across the view that moves by itself.
#[derive(Clone, Copy)]
struct Mover {
    z_m: f64,
    left_m: f64,
    right_m: f64,
}

/// Brightness at a place of a surface: waves of many lengths, without those that a pixel cannot resolve.
fn texture(a: f64, b: f64, pixel_m: f64, seed: f64) -> f64 {
    let mut sum = 128.0;
    let mut length_m = 4.0;
    let mut k = seed;
    while length_m > 2.5 * pixel_m && length_m > 0.05 {
        let turn = 2.4 * k;
        let along = (a * turn.cos() + b * turn.sin()) / length_m;
        let across = (b * turn.cos() - a * turn.sin()) / length_m;
        sum += 14.0
            * (std::f64::consts::TAU * along + k).sin()
            * (std::f64::consts::TAU * across + 2.0 * k).cos();
        length_m *= 0.72;
        k += 1.0;
    }
    sum
}

struct Street {
    noise: f64,
    random: fastrand::Rng,
}

impl Street {
    /// Left image and disparity map for a camera.
    fn render(&mut self, camera: &Pose, mover: Option<Mover>) -> (Vec<u8>, Vec<u16>) {
        let (mut left, mut map) = (vec![0; WIDTH * HEIGHT], vec![0; WIDTH * HEIGHT]);
        let o = camera.translation_m;
        for y in 0..HEIGHT {
            for x in 0..WIDTH {
                let ray = [(x as f64 - RIG.cx_px) / RIG.focal_px, (y as f64 - RIG.cy_px) / RIG.focal_px, 1.0];
                let d = camera.rotate(ray);
                // Depth along the ray of each surface, its seed, and the two axes of its texture.
                let mut hits = [
                    ((CAMERA_HEIGHT_M - o[1]) / d[1], 1.0, [0, 2]),
                    ((-6.0 - o[0]) / d[0], 2.0, [1, 2]),
                    ((7.0 - o[0]) / d[0], 3.0, [1, 2]),
                    ((80.0 - o[2]) / d[2], 4.0, [0, 1]),
                    (f64::INFINITY, 5.0, [0, 1]),
                ];
                if let Some(m) = mover {
                    let t = (m.z_m - o[2]) / d[2];
                    let across = o[0] + t * d[0];
                    if (m.left_m..=m.right_m).contains(&across) && o[1] + t * d[1] > -2.5 {
                        hits[4].0 = t;
                    }
                }
                let nearest = hits.into_iter().filter(|h| h.0 > 0.1).min_by(|a, b| a.0.total_cmp(&b.0));
                let Some((t, seed, axes)) = nearest else { continue };
                let mut p: [f64; 3] = std::array::from_fn(|k| o[k] + t * d[k]);
                if let Some(m) = mover.filter(|_| seed == 5.0) {
                    p[0] -= m.left_m;
                }
                let value = texture(p[axes[0]], p[axes[1]], t / RIG.focal_px, seed);
                let noise = self.noise * (self.random.f64() + self.random.f64() - 1.0) * 2.4;
                left[y * WIDTH + x] = (value + noise).round().clamp(0.0, 255.0) as u8;
                let error = 0.2 * (self.random.f64() + self.random.f64() - 1.0);
                map[y * WIDTH + x] = (256.0 * (RIG.disparity_px(t) + error)).clamp(0.0, 65_535.0) as u16;
            }
        }
        (left, map)
    }

    fn new(seed: u64, noise: f64) -> Self {
        Self { noise, random: fastrand::Rng::with_seed(seed) }
    }
}

fn update(odometry: &mut Odometry, (left, map): &(Vec<u8>, Vec<u16>), elapsed_s: f64) -> OdometryResult {
    let left = GreyView::new(left, WIDTH, HEIGHT, WIDTH).unwrap();
    let map = DisparityView::new(map, WIDTH, HEIGHT).unwrap();
    odometry.update(left, map, elapsed_s)
}

/// The next camera of a vehicle with a speed and a yaw rate.
fn next(camera: &Pose, speed_m_s: f64, yaw_rate_rad_s: f64, elapsed_s: f64) -> Pose {
    let turn = Pose::from_rotation_vector([0.0, -yaw_rate_rad_s * elapsed_s, 0.0]);
    camera.after(&Pose { translation_m: [0.0, 0.0, speed_m_s * elapsed_s], ..turn })
}

/// Distance of two cameras, in metres.
fn distance_m(a: &Pose, b: &Pose) -> f64 {
    let d: [f64; 3] = std::array::from_fn(|k| a.translation_m[k] - b.translation_m[k]);
    d.iter().map(|v| v * v).sum::<f64>().sqrt()
}

/// Drives for some frames; returns the drift in per cent, the error of the angle in rad, and how often it was known.
fn drive(seed: u64, noise: f64, frames: usize, speed: impl Fn(usize) -> (f64, f64)) -> (f64, f64, usize) {
    let mut street = Street::new(seed, noise);
    let mut odometry = Odometry::new(RIG, WIDTH, HEIGHT);
    let (mut camera, mut way_m, mut known) = (Pose::IDENTITY, 0.0, 0);
    update(&mut odometry, &street.render(&camera, None), 0.0);
    for k in 0..frames {
        let (speed_m_s, yaw_rate) = speed(k);
        camera = next(&camera, speed_m_s, yaw_rate, PERIOD_S);
        way_m += speed_m_s * PERIOD_S;
        let result = update(&mut odometry, &street.render(&camera, None), PERIOD_S);
        known += usize::from(matches!(result, OdometryResult::Known(_)));
    }
    let error = camera.inverse().after(&odometry.pose());
    (100.0 * distance_m(&camera, &odometry.pose()) / way_m, error.angle_rad(), known)
}

#[test]
fn a_straight_drive_and_a_bend_are_measured() {
    for (name, speed) in [
        ("straight", (|_| (10.0, 0.0)) as fn(usize) -> (f64, f64)),
        ("bend", |k| (8.0, 0.25 * (k as f64 / 8.0).sin())),
        ("braking", |k| ((12.0 - 0.4 * k as f64).max(0.0), 0.0)),
    ] {
        let (drift, angle, known) = drive(1, 2.0, 30, speed);
        println!("{name}: drift {drift:.2} %, {angle:.4} rad, known {known} of 30");
        assert!(known >= 29 && drift < 1.5 && angle < 0.004, "{name}: {drift} %, {angle} rad, {known}");
    }
}

#[test]
fn noise_makes_it_less_exact_and_it_says_so() {
    let mut sigmas = Vec::new();
    for noise in [1.0, 9.0] {
        let mut street = Street::new(2, noise);
        let mut odometry = Odometry::new(RIG, WIDTH, HEIGHT);
        let mut camera = Pose::IDENTITY;
        update(&mut odometry, &street.render(&camera, None), 0.0);
        let (mut worst, mut sigma) = (0.0_f64, 0.0_f64);
        for k in 0..15 {
            camera = next(&camera, 9.0, 0.0, PERIOD_S);
            if let OdometryResult::Known(e) = update(&mut odometry, &street.render(&camera, None), PERIOD_S)
                && k > 2
            {
                let stated = e.covariance[(2, 2)].sqrt();
                worst = worst.max((e.motion.translation_m[2] - 9.0 * PERIOD_S).abs());
                sigma = sigma.max(stated);
            }
        }
        println!("noise {noise}: worst error along {worst:.4} m, stated deviation {sigma:.4} m");
        assert!(sigma > 0.0 && worst < 12.0 * sigma, "{worst} {sigma}");
        sigmas.push(sigma);
    }
    assert!(sigmas[1] > 1.2 * sigmas[0], "{sigmas:?}");
}

#[test]
fn a_lorry_that_crosses_a_standing_view_is_not_own_motion() {
    let mut street = Street::new(3, 2.0);
    let mut odometry = Odometry::new(RIG, WIDTH, HEIGHT);
    let camera = Pose::IDENTITY;
    update(&mut odometry, &street.render(&camera, None), 0.0);
    let mut worst = 0.0_f64;
    let mut known = 0;
    for k in 0..30 {
        // 8 m long, 6 m away: at most 60 % of the picture's width above the road.
        let left_m = -12.0 + 6.0 * PERIOD_S * f64::from(k);
        let mover = Mover { z_m: 9.0, left_m, right_m: left_m + 6.0 };
        let result = update(&mut odometry, &street.render(&camera, Some(mover)), PERIOD_S);
        if let OdometryResult::Known(e) = result {
            known += 1;
            let moved = e.motion.translation_m.iter().fold(0.0_f64, |most, v| most.max(v.abs()));
            worst = worst.max(moved / PERIOD_S);
        }
    }
    println!("a lorry crosses: at most {worst:.3} m/s of own motion, known in {known} of 30 frames");
    assert!(known >= 25 && worst < 0.2, "{worst} m/s, {known}");
}

#[test]
fn blocked_frames_are_told_and_survived() {
    let mut street = Street::new(4, 2.0);
    let mut odometry = Odometry::new(RIG, WIDTH, HEIGHT);
    let mut camera = Pose::IDENTITY;
    assert_eq!(update(&mut odometry, &street.render(&camera, None), 0.0), OdometryResult::First);
    let dark = (vec![3; WIDTH * HEIGHT], vec![0; WIDTH * HEIGHT]);
    let mut results = Vec::new();
    for k in 0..40 {
        camera = next(&camera, 8.0, 0.0, PERIOD_S);
        let is_dark = (10..12).contains(&k) || (20..30).contains(&k);
        let frame = if is_dark { dark.clone() } else { street.render(&camera, None) };
        let result = update(&mut odometry, &frame, PERIOD_S);
        results.push(matches!(result, OdometryResult::Known(_)));
        assert!(!is_dark || !results[k], "a dark frame has no motion");
    }
    assert!(results[5..10].iter().all(|&known| known));
    // Two dark frames are bridged: the points are still there.
    assert!(results[12..20].iter().all(|&known| known), "{results:?}");
    // After 0.8 s everything is new.
    assert!(results[33..].iter().all(|&known| known), "{results:?}");
    odometry.reset();
    assert_eq!(update(&mut odometry, &dark, PERIOD_S), OdometryResult::First);
    // Hostile maps and images: nothing is known, and nothing panics.
    let wild = (vec![255; WIDTH * HEIGHT], vec![u16::MAX; WIDTH * HEIGHT]);
    for _ in 0..3 {
        assert!(matches!(update(&mut odometry, &wild, PERIOD_S), OdometryResult::Unknown(_)));
    }
}

#[test]
fn a_dropped_frame_and_a_rate_of_5_per_second_are_bridged() {
    let mut street = Street::new(5, 2.0);
    let mut odometry = Odometry::new(RIG, WIDTH, HEIGHT);
    let mut camera = Pose::IDENTITY;
    update(&mut odometry, &street.render(&camera, None), 0.0);
    let mut known = 0;
    for k in 0..20 {
        let elapsed_s = if k % 3 == 0 { 0.2 } else { PERIOD_S };
        camera = next(&camera, 7.0, 0.1, elapsed_s);
        let result = update(&mut odometry, &street.render(&camera, None), elapsed_s);
        if let OdometryResult::Known(e) = result {
            known += 1;
            assert!((e.elapsed_s - elapsed_s).abs() < 1e-9);
        }
    }
    let error = distance_m(&camera, &odometry.pose());
    println!(
        "uneven rate: {error:.3} m off after {:.1} m, known {known} of 20",
        7.0 * (7.0 * 0.2 + 13.0 * 0.08)
    );
    assert!(known == 20 && error < 0.3, "{error} m, {known}");
}

#[test]
fn an_error_that_all_disparities_have_is_found() {
    for added_px in [-0.15, 0.15] {
        let mut street = Street::new(6, 2.0);
        let mut odometry = Odometry::new(RIG, WIDTH, HEIGHT);
        let mut camera = Pose::IDENTITY;
        for k in 0..60 {
            let (left, mut map) = street.render(&camera, None);
            map.iter_mut().for_each(|d| *d = (f64::from(*d) + 256.0 * added_px).max(1.0) as u16);
            update(&mut odometry, &(left, map), if k == 0 { 0.0 } else { PERIOD_S });
            camera = next(&camera, 9.0, 0.1 * (f64::from(k) / 9.0).sin(), PERIOD_S);
        }
        let found = odometry.disparity_offset_px();
        println!("{added_px} px added to all disparities: {found:.3} px found");
        assert!((found + added_px).abs() < 0.1, "{found}");
    }
}
