//! Calibration of synthetic views with known cameras, boards and faults.

use super::verdict::Grade;
use super::*;
use nalgebra::{Rotation3, Vector2, Vector3};

pub(super) const SIZE: (usize, usize) = (640, 480);

pub(super) struct Bench {
    pub board: Board,
    pub cameras: [Camera; 2],
    pub between: Pose,
    pub poses: Vec<Pose>,
    /// Ratio of the printed length to the nominal length along the rows.
    stretch: f64,
    /// Bend at its corners, in metres.
    bend_m: f64,
}

impl Bench {
    pub fn new(views: usize, seed: u64) -> Self {
        let mut random = fastrand::Rng::with_seed(seed);
        let mut between = |low: f64, high: f64| low + (high - low) * random.f64();
        let poses = (0..views)
            .map(|i| {
                let away = between(0.45, 0.95);
                // Tilts in all directions in turn; positions all over the image.
                let way = i as f64 * 2.4;
                let tilt = between(0.2, 0.7);
                let turn = Vector3::new(tilt * way.cos(), tilt * way.sin(), between(-0.4, 0.4));
                let reach = 0.62 * away - 0.16;
                Pose {
                    rotation: Rotation3::new(turn),
                    translation_m: Vector3::new(
                        between(-reach, reach) + 0.06,
                        between(-reach, reach) * 0.7,
                        away,
                    ),
                }
            })
            .collect();
        let left = Camera {
            distortion: Distortion::BrownConrady([-0.28, 0.09, 0.0011, -0.0004, 0.0, 0.0, 0.0, 0.0]),
            ..Camera::pinhole(533.5, 533.2, 331.0, 236.0)
        };
        let right = Camera { cx_px: 325.0, cy_px: 245.0, fx_px: 536.9, fy_px: 536.4, ..left };
        let between = Pose {
            rotation: Rotation3::new(Vector3::new(0.0066, 0.0042, -0.0037)),
            translation_m: Vector3::new(-0.12, 0.0011, -0.0009),
        };
        let board = Board::new(9, 6, 0.025).unwrap();
        Self { board, cameras: [left, right], between, poses, stretch: 1.0, bend_m: 0.0 }
    }

    /// Corners with Gaussian noise.
    pub fn pairs(&self, noise_px: f64, seed: u64) -> Vec<Pair> {
        let mut random = fastrand::Rng::with_seed(seed);
        let mut noise = move || {
            let (a, b) = (random.f64().max(1e-12), random.f64());
            let r = noise_px * (-2.0 * a.ln()).sqrt();
            let t = std::f64::consts::TAU * b;
            Vector2::new(r * t.cos(), r * t.sin())
        };
        let points = self.board.points_m();
        let reach = points[0].norm();
        self.poses
            .iter()
            .map(|pose| {
                let mut sides = [0, 1].map(|side| {
                    let pose = if side == 0 { *pose } else { pose.then(&self.between) };
                    let corner = |p: &Vector2<f64>| {
                        let z = self.bend_m * (p.y / reach).powi(2);
                        let point = pose.apply(&Vector3::new(p.x * self.stretch, p.y, z));
                        self.cameras[side].project(&point).unwrap() + noise()
                    };
                    points.iter().map(corner).map(Some).collect::<Vec<_>>()
                });
                let right = std::mem::take(&mut sides[1]);
                Pair { left: std::mem::take(&mut sides[0]), right }
            })
            .collect()
    }

    fn calibrate(&self, pairs: &[Pair]) -> StereoCalibration {
        calibrate(&self.board, SIZE, pairs, Lens::Radial2, Crop::Valid).unwrap()
    }
}

fn verdict(c: &StereoCalibration) -> Verdict {
    let names: Vec<String> = (0..c.views.len()).map(|i| format!("view{i}")).collect();
    judge(c, &names)
}

fn says(verdict: &Verdict, words: &str) -> bool {
    verdict.reasons.iter().any(|r| r.text.contains(words))
}

#[test]
fn exact_corners_give_exact_cameras() {
    let bench = Bench::new(12, 1);
    let c = bench.calibrate(&bench.pairs(0.0, 1));
    for side in 0..2 {
        for (a, b) in c.cameras[side].parameters().iter().zip(bench.cameras[side].parameters()) {
            assert!((a - b).abs() < 1e-4, "{:?}", c.cameras[side]);
        }
    }
    assert!((c.between.translation_m - bench.between.translation_m).norm() < 1e-7);
    assert!(c.rms_px < 1e-4 && c.vertical_mean_px < 1e-4);
}

#[test]
fn who_says_that_the_cameras_expose_together_gets_no_motion_of_the_board() {
    let bench = Bench::new(14, 3);
    let pairs = bench.pairs(0.1, 5);
    let simultaneous =
        calibrate_simultaneous(&bench.board, SIZE, &pairs, Lens::Radial2, Crop::Valid).unwrap();
    assert!((simultaneous.corner_sigma_px - 0.1).abs() < 0.01, "{}", simultaneous.corner_sigma_px);
    let far = |of: &ProjectionUncertainty| of.far_sigma_px(0, SIZE).unwrap().1;
    assert!(far(&simultaneous.projection) > 0.7 * far(&simultaneous.independent));
    // A board that moves between the exposures is taken for errors of its corners then.
    let mut moved = pairs;
    for (i, pair) in moved.iter_mut().enumerate() {
        let by = Vector2::new(0.0, if i % 2 == 0 { 0.15 } else { -0.15 });
        pair.right.iter_mut().flatten().for_each(|corner| *corner += by);
    }
    let apart = bench.calibrate(&moved);
    let together = calibrate_simultaneous(&bench.board, SIZE, &moved, Lens::Radial2, Crop::Valid).unwrap();
    assert!((apart.corner_sigma_px - 0.1).abs() < 0.015, "{}", apart.corner_sigma_px);
    assert!(together.corner_sigma_px > 1.1 * apart.corner_sigma_px, "{}", together.corner_sigma_px);
}

#[test]
fn parameters_lie_within_their_stated_uncertainty() {
    let (mut squares, mut count) = (0.0, 0);
    let mut worst = 0.0_f64;
    for seed in 0..12 {
        let bench = Bench::new(16, 100 + seed);
        let c = bench.calibrate(&bench.pairs(0.15, seed));
        let verdict = verdict(&c);
        assert_eq!(verdict.grade, Grade::Good, "seed {seed}: {verdict:?}");
        let mut check = |estimate: f64, truth: f64, sigma: f64| {
            let z = (estimate - truth) / sigma;
            squares += z * z;
            count += 1;
            worst = worst.max(z.abs());
        };
        for side in 0..2 {
            let (p, q) = (c.cameras[side].parameters(), bench.cameras[side].parameters());
            for k in 0..8 {
                check(p[k], q[k], c.uncertainty.cameras[side][k]);
            }
        }
        let (a, b) = (c.between.rotation_vector(), bench.between.rotation_vector());
        let (s, t) = (c.between.translation_m, bench.between.translation_m);
        for k in 0..3 {
            check(a[k], b[k], c.uncertainty.rotation_rad[k]);
            check(s[k], t[k], c.uncertainty.translation_m[k]);
        }
        check(s.norm(), t.norm(), c.uncertainty.baseline_m);
    }
    // One standard deviation on average. Of 276 values, one may reach 4.
    let rms = (squares / f64::from(count)).sqrt();
    assert!((0.6..1.35).contains(&rms) && worst < 4.5, "{rms} {worst}");
}

#[test]
fn a_bent_board_is_reported_and_does_not_bias_the_cameras() {
    let mut bench = Bench::new(16, 5);
    bench.bend_m = 0.0015;
    let c = bench.calibrate(&bench.pairs(0.1, 5));
    assert!((c.shape.bend_m[2] - 0.0015).abs() < 2e-4, "{:?}", c.shape);
    let z = (c.cameras[0].fx_px - bench.cameras[0].fx_px) / c.uncertainty.cameras[0][0];
    assert!(z.abs() < 4.0, "{z}");
}

#[test]
fn a_shifted_view_is_reported() {
    for by in [Vector2::new(0.0, 0.5), Vector2::new(0.0, -0.5), Vector2::new(0.5, 0.5)] {
        let bench = Bench::new(16, 3);
        let mut pairs = bench.pairs(0.1, 3);
        pairs[7].right.iter_mut().flatten().for_each(|c| *c += by);
        let c = bench.calibrate(&pairs);
        let verdict = verdict(&c);
        assert!(verdict.grade > Grade::Good && says(&verdict, "view7 was left out"), "{verdict:?}");
        assert!(c.views.iter().enumerate().all(|(i, v)| v.fault.is_some() == (i == 7)));
        assert!((c.views[7].shift_px - by).norm() < 0.2, "{:?}", c.views[7].shift_px);
    }
}

/// One image of a view is shifted in one of four directions. Exactly this view is reported, and it is rejected if
/// there are enough views.
#[test]
fn a_shift_of_half_a_pixel_in_one_view_is_always_reported() {
    let mut tries = 0;
    for seed in 0..8 {
        for (views, noise_px) in [(12, 0.1), (16, 0.1), (24, 0.05), (24, 0.15)] {
            let bench = Bench::new(views, 200 + seed);
            let clean = bench.pairs(noise_px, seed);
            let mut random = fastrand::Rng::with_seed(seed);
            for quarter in 0..4 {
                let (view, side) = (random.usize(..views), random.usize(..2));
                let (sin, cos) = (f64::from(quarter) * std::f64::consts::FRAC_PI_2).sin_cos();
                let by = 0.5 * Vector2::new(cos, sin);
                let mut pairs = clean.clone();
                let corners = if side == 0 { &mut pairs[view].left } else { &mut pairs[view].right };
                corners.iter_mut().flatten().for_each(|c| *c += by);
                let c = bench.calibrate(&pairs);
                let verdict = verdict(&c);
                let context = format!("seed {seed}, {views} views, view {view}, side {side}, {by:?}");
                assert!(verdict.grade > Grade::Good, "{context}: {verdict:?}");
                assert!(says(&verdict, &format!("view{view} ")), "{context}: {verdict:?}");
                let moved: Vec<usize> = (0..views).filter(|i| c.views[*i].moved).collect();
                assert_eq!(moved, [view], "{context}: {verdict:?}");
                let left_out: Vec<usize> = (0..views).filter(|i| c.views[*i].fault.is_some()).collect();
                assert!(left_out == moved || views == 12, "{context}: {verdict:?}");
                tries += 1;
            }
        }
    }
    assert_eq!(tries, 128);
}

#[test]
fn views_without_a_fault_are_kept() {
    let (mut left_out, mut views) = (0, 0);
    for seed in 0..24 {
        let bench = Bench::new(29, 300 + seed);
        // Corners with more noise than those of real images.
        let c = bench.calibrate(&bench.pairs([0.05, 0.15, 0.3][seed as usize % 3], seed));
        left_out += c.views.iter().filter(|v| v.fault.is_some() || v.moved).count();
        views += c.views.len();
    }
    assert!(left_out == 0, "{left_out} of {views} views were left out or named for nothing");
}

/// Motion of boards between the exposures is reported, with the views where it exceeds a quarter of a pixel.
#[test]
fn hand_held_boards_are_not_good() {
    for seed in 0..8 {
        let bench = Bench::new(24, 400 + seed);
        let mut pairs = bench.pairs(0.05, seed);
        let mut random = fastrand::Rng::with_seed(seed);
        let mut moved_by = Vec::new();
        for pair in &mut pairs {
            let mut moved = || 0.4 * (random.f64() + random.f64() + random.f64() - 1.5);
            let by = Vector2::new(moved(), moved());
            moved_by.push(by);
            pair.right.iter_mut().flatten().for_each(|c| *c += by);
        }
        let c = bench.calibrate(&pairs);
        let verdict = verdict(&c);
        assert_eq!(verdict.grade, Grade::Usable, "seed {seed}: {verdict:?}");
        assert!(says(&verdict, "varying from view to view"), "seed {seed}: {verdict:?}");
        for (i, (view, by)) in c.views.iter().zip(&moved_by).enumerate() {
            // The position of the others is itself uncertain by about a tenth of a pixel.
            assert!(view.moved || by.amax() < 0.4, "seed {seed}, view {i}, {by:?}: {:?}", view.shift_px);
            assert!(!view.moved || by.amax() > 0.1, "seed {seed}, view {i}, {by:?}: {:?}", view.shift_px);
        }
    }
}

#[test]
fn a_stretched_board_lowers_the_grade() {
    for stretch in [1.01, 0.99] {
        let mut bench = Bench::new(16, 4);
        bench.stretch = stretch;
        let c = bench.calibrate(&bench.pairs(0.1, 4));
        let verdict = verdict(&c);
        assert_eq!(verdict.grade, Grade::Redo, "{verdict:?}");
        assert!(says(
            &verdict,
            if stretch > 1.0 { "longer along its rows" } else { "shorter along its rows" }
        ));
        assert!((c.shape.stretch - stretch).abs() < 0.003);
    }
}

#[test]
fn a_camera_that_moved_between_views_lowers_the_grade() {
    let bench = Bench::new(18, 6);
    let mut after = Bench::new(18, 6);
    let pitch = Pose {
        rotation: Rotation3::new(Vector3::new(0.1_f64.to_radians(), 0.0, 0.0)),
        translation_m: Vector3::zeros(),
    };
    after.between = after.between.then(&pitch);
    let (before, after) = (bench.pairs(0.1, 6), after.pairs(0.1, 6));
    // From one view on, alternating, and for the last three views only.
    for (moved, words) in [
        (&(|i: usize| i >= 9) as &dyn Fn(usize) -> bool, "moved against each other"),
        (&|i: usize| i % 2 == 1, "varying from view to view"),
        (&|i: usize| i >= 15, "was left out"),
    ] {
        let pairs: Vec<Pair> =
            (0..18).map(|i| if moved(i) { after[i].clone() } else { before[i].clone() }).collect();
        let verdict = match calibrate(&bench.board, SIZE, &pairs, Lens::Radial2, Crop::Valid) {
            Ok(c) => verdict(&c),
            Err(error) => Verdict::redo(error.to_string()),
        };
        assert!(verdict.grade > Grade::Good, "{verdict:?}");
        assert!(says(&verdict, words), "{words}: {verdict:?}");
    }
}

#[test]
fn swapped_cameras_are_reported() {
    let bench = Bench::new(12, 7);
    let pairs: Vec<Pair> =
        bench.pairs(0.1, 7).into_iter().map(|p| Pair { left: p.right, right: p.left }).collect();
    let error = calibrate(&bench.board, SIZE, &pairs, Lens::Radial2, Crop::Valid).unwrap_err();
    assert!(matches!(error, CalibrationError::Rectification(RectificationError::Swapped { .. })), "{error}");
}

#[test]
fn an_upside_down_camera_is_told_from_swapped_cameras() {
    let bench = Bench::new(12, 7);
    let turned = |corners: &Places| -> Places {
        corners
            .iter()
            .map(|c| c.map(|c| Vector2::new(SIZE.0 as f64 - 1.0, SIZE.1 as f64 - 1.0) - c))
            .collect()
    };
    for (left_is_turned, right_is_turned, expected) in
        [(true, false, "the left camera is upside down"), (false, true, "the right camera is upside down")]
    {
        for slant in [0.0, 0.5, -0.5] {
            // Rolled by less or more than half a turn, too.
            let mut bench = Bench::new(12, 7);
            bench.between.rotation = Rotation3::new(Vector3::z() * slant) * bench.between.rotation;
            let turn = |p: Pair| Pair {
                left: if left_is_turned { turned(&p.left) } else { p.left },
                right: if right_is_turned { turned(&p.right) } else { p.right },
            };
            let pairs: Vec<Pair> = bench.pairs(0.1, 7).into_iter().map(turn).collect();
            let error = calibrate(&bench.board, SIZE, &pairs, Lens::Radial2, Crop::Valid).unwrap_err();
            assert!(error.to_string().starts_with(expected), "{slant}: {error}");
        }
    }
    // Both: the geometry of swapped cameras.
    let both = bench.pairs(0.1, 7).into_iter();
    let both: Vec<Pair> = both.map(|p| Pair { left: turned(&p.left), right: turned(&p.right) }).collect();
    let error = calibrate(&bench.board, SIZE, &both, Lens::Radial2, Crop::Valid).unwrap_err();
    assert!(matches!(error, CalibrationError::Rectification(RectificationError::Swapped { .. })), "{error}");
    assert!(error.to_string().contains("or both cameras are upside down"), "{error}");
}

#[test]
fn wrong_corners_are_rejected() {
    let bench = Bench::new(14, 8);
    let mut pairs = bench.pairs(0.1, 8);
    pairs[2].left[10] = pairs[2].left[10].map(|c| c + Vector2::new(3.0, -1.0));
    pairs[5].right[50] = pairs[5].right[50].map(|c| c + Vector2::new(-2.0, 2.0));
    let c = bench.calibrate(&pairs);
    assert_eq!(c.views[2].rejected, [(0, 10)]);
    assert_eq!(c.views[5].rejected, [(1, 50)]);
    assert!(c.rms_px < 0.16, "{}", c.rms_px);
    // A pair whose images were taken at different times.
    let mut pairs = bench.pairs(0.1, 8);
    pairs[3].right = pairs[4].right.clone();
    let c = bench.calibrate(&pairs);
    assert!(matches!(c.views[3].fault, Some(ViewFault::Misfit(_))), "{:?}", c.views[3].fault);
}

/// Views whose images were taken at different times lose all their corners; the others still give the cameras.
#[test]
fn views_without_any_corner_left_do_not_end_the_calibration() {
    let bench = Bench::new(12, 8);
    let mut pairs = bench.pairs(0.1, 8);
    for (from, to) in [(4, 3), (8, 7), (1, 10)] {
        pairs[to].right = pairs[from].right.clone();
    }
    let c = bench.calibrate(&pairs);
    let left_out: Vec<usize> = (0..12).filter(|i| c.views[*i].fault.is_some()).collect();
    // A quarter of the views is wrong: a good one may go with them.
    assert!([3, 7, 10].iter().all(|i| left_out.contains(i)) && left_out.len() <= 4, "{left_out:?}");
    assert!((c.cameras[0].fx_px - bench.cameras[0].fx_px).abs() < 2.0, "{:?}", c.cameras[0]);
    // So does one that shows too little in the right image.
    let mut pairs = bench.pairs(0.1, 8);
    for (k, corner) in pairs[5].right.iter_mut().enumerate() {
        *corner = corner.filter(|_| k % 9 < 2 && k < 18).map(|c| c + Vector2::new(9.0 * (k % 3) as f64, 0.0));
    }
    assert!(bench.calibrate(&pairs).views[5].fault.is_some());
}

#[test]
fn insufficient_views_are_not_good() {
    let bench = Bench::new(14, 9);
    let pairs = bench.pairs(0.1, 9);
    let few = calibrate(&bench.board, SIZE, &pairs[..3], Lens::Radial2, Crop::Valid);
    assert_eq!(few.unwrap_err(), CalibrationError::TooFew { given: 3 });
    // The same view repeated, with independent noise.
    let mut same = Bench::new(14, 9);
    same.poses = vec![same.poses[3]; 14];
    let alike = calibrate(&same.board, SIZE, &same.pairs(0.1, 9), Lens::Radial2, Crop::Valid);
    let verdict_of = |c: Result<StereoCalibration, CalibrationError>| match c {
        Ok(c) => verdict(&c),
        Err(error) => Verdict::redo(error.to_string()),
    };
    assert_eq!(verdict_of(alike).grade, Grade::Redo);
    // A board that never tilts.
    let mut flat = Bench::new(14, 9);
    for pose in &mut flat.poses {
        pose.rotation = Rotation3::new(Vector3::new(0.0, 0.0, pose.rotation_vector().z));
    }
    let flat = calibrate(&flat.board, SIZE, &flat.pairs(0.1, 9), Lens::Radial2, Crop::Valid);
    let verdict = verdict_of(flat);
    assert_eq!(verdict.grade, Grade::Redo, "{verdict:?}");
    assert!(says(&verdict, "tilt"), "{verdict:?}");
}

#[test]
fn all_lenses_are_recovered() {
    let mut bench = Bench::new(24, 10);
    for (lens, distortion) in [
        (Lens::Radial2, Distortion::BrownConrady([-0.4, 0.2, 0.002, -0.001, 0.0, 0.0, 0.0, 0.0])),
        (Lens::Radial3, Distortion::BrownConrady([-0.35, 0.15, 0.002, -0.001, -0.03, 0.0, 0.0, 0.0])),
        (Lens::Rational, Distortion::BrownConrady([0.3, 0.1, 0.001, -0.001, 0.01, 0.6, 0.15, 0.01])),
        (Lens::Fisheye, Distortion::Equidistant([-0.02, 0.01, -0.006, 0.001])),
    ] {
        for camera in &mut bench.cameras {
            camera.distortion = distortion;
        }
        let c = calibrate(&bench.board, SIZE, &bench.pairs(0.05, 10), lens, Crop::Valid).unwrap();
        // Compare the distortion over the valid part of the image instead of the coefficients.
        let mut off = Vec::new();
        for i in 0..63 {
            let pixel = Vector2::new(f64::from(i % 9) * 60.0 + 80.0, f64::from(i / 9) * 56.0 + 72.0);
            let ray = bench.cameras[0].undistort(pixel).unwrap_or_else(|| panic!("{lens:?} at {pixel}"));
            off.push(c.cameras[0].project(&ray.push(1.0)).unwrap() - pixel);
        }
        // A small rotation is nearly equivalent to a shift of the principal point.
        let mean = off.iter().sum::<Vector2<f64>>() / 63.0;
        let worst = off.iter().map(|o| (o - mean).norm()).fold(0.0, f64::max);
        assert!(worst < 0.5, "{lens:?}: {worst} px");
    }
}
