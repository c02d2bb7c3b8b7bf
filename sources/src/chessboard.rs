//! Synthetic images of a calibration board seen by known cameras, to test calibration with.

use nalgebra::{Rotation3, Vector2, Vector3};
use perception::calibration::plane::Plane;
use perception::calibration::{Board, Camera, Pose};
use perception::image::GreyImage;

/// Sample points averaged per pixel: no two in one column or row, so that edges along either direction are
/// antialiased too.
const POINTS: usize = 13;

/// Imaging conditions.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Conditions {
    /// Blur, standard deviation in pixels.
    pub blur_px: f32,
    /// Noise, standard deviation in grey levels.
    pub noise: f64,
    /// Brightness of the right border relative to the left one.
    pub light: f64,
    /// Printed length along the rows relative to the nominal square size.
    pub stretch: f64,
}

impl Default for Conditions {
    fn default() -> Self {
        Self { blur_px: 0.7, noise: 2.0, light: 1.0, stretch: 1.0 }
    }
}

/// Renders a board as one camera sees it.
#[derive(Clone, Debug)]
pub struct BoardRenderer {
    board: Board,
    size: (usize, usize),
    /// Ray of each sample point of each pixel, at z = 1; `None` where the lens model has no ray.
    rays: Vec<Option<Vector2<f64>>>,
}

impl BoardRenderer {
    /// A renderer for one camera with images of `size`.
    pub fn new(camera: &Camera, size: (usize, usize), board: Board) -> Self {
        let (width, height) = size;
        let offset = |i: usize| (i as f64 + 0.5) / POINTS as f64 - 0.5;
        let mut rays = Vec::with_capacity(width * height * POINTS);
        for y in 0..height {
            for x in 0..width {
                for i in 0..POINTS {
                    let point = Vector2::new(x as f64 + offset(i), y as f64 + offset(5 * i % POINTS));
                    rays.push(camera.undistort(point));
                }
            }
        }
        Self { board, size, rays }
    }

    /// An image of the board at a pose (board to camera coordinates); `seed` selects the noise.
    pub fn picture(&self, pose: &Pose, conditions: &Conditions, seed: u64) -> GreyImage {
        let (width, height) = self.size;
        let back = pose.rotation.inverse();
        let normal = pose.rotation * Vector3::z();
        let distance = normal.dot(&pose.translation_m);
        // Beyond the print there is white paper.
        let paper = self.board.size_m() * 0.5 + Vector2::repeat(0.8 * self.board.square_m());
        let grey = |ray: &Option<Vector2<f64>>| -> f64 {
            let Some(ray) = ray else { return 0.0 };
            let ray = ray.push(1.0);
            let along = distance / normal.dot(&ray);
            let ground = 88.0 + 14.0 * (9.0 * ray.x).sin() * (7.0 * ray.y).cos();
            if !(along.is_finite() && along > 0.0) {
                return ground;
            }
            let point = back * (ray * along - pose.translation_m);
            let place = Vector2::new(point.x / conditions.stretch, point.y);
            if place.x.abs() > paper.x || place.y.abs() > paper.y {
                return ground;
            }
            if self.board.is_dark(place) { 32.0 } else { 205.0 }
        };
        let sharp: Vec<u8> = self
            .rays
            .chunks_exact(POINTS)
            .enumerate()
            .map(|(i, rays)| {
                let light = 1.0 + (conditions.light - 1.0) * (i % width) as f64 / width as f64;
                (light * rays.iter().map(grey).sum::<f64>() / POINTS as f64).clamp(0.0, 255.0) as u8
            })
            .collect();
        let mut image = GreyImage::new(width, height);
        image.as_mut_slice().copy_from_slice(&sharp);
        let blurred = if conditions.blur_px > 0.05 {
            Plane::from_view(image.view()).blurred(conditions.blur_px)
        } else {
            Plane::from_view(image.view())
        };
        let mut random = fastrand::Rng::with_seed(seed);
        for y in 0..height {
            for (pixel, value) in image.as_mut_slice()[y * width..].iter_mut().zip(blurred.row(y)) {
                // A sum of uniform numbers approximates a normal one closely enough.
                let sum: f64 = (0..6).map(|_| random.f64()).sum::<f64>() - 3.0;
                *pixel = (f64::from(*value) + sum * conditions.noise * 2.0_f64.sqrt())
                    .round()
                    .clamp(0.0, 255.0) as u8;
            }
        }
        image
    }
}

/// Poses suited for calibration: tilted in all directions in turn, `near_m` to `far_m` away, spread over the
/// image of a camera with this ratio of focal length to width.
pub fn poses(count: usize, (near_m, far_m): (f64, f64), focal_over_width: f64, seed: u64) -> Vec<Pose> {
    let mut random = fastrand::Rng::with_seed(seed);
    let mut between = |low: f64, high: f64| low + (high - low) * random.f64();
    (0..count)
        .map(|i| {
            let away = between(near_m, far_m);
            let way = i as f64 * 2.4;
            let tilt = between(0.25, 0.65);
            let turn = Vector3::new(tilt * way.cos(), tilt * way.sin(), between(-0.3, 0.3));
            let reach = (0.5 * away / focal_over_width - 0.19).max(0.02);
            Pose {
                rotation: Rotation3::new(turn),
                translation_m: Vector3::new(between(-reach, reach), 0.6 * between(-reach, reach), away),
            }
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use perception::calibration::{Dictionary, Distortion, Places, finder};

    /// Root mean square distance of the detected corners from their true positions, in pixels.
    fn error(studio: &BoardRenderer, camera: &Camera, pose: &Pose, conditions: &Conditions) -> f64 {
        let board = studio.board;
        let image = studio.picture(pose, conditions, 5);
        let found = finder::find(image.view(), &board)
            .unwrap_or_else(|e| panic!("{}x{} {conditions:?}: {e}", board.columns(), board.rows()));
        let expected: Vec<_> = board
            .points_m()
            .iter()
            .map(|p| camera.project(&pose.apply(&Vector3::new(p.x, p.y, 0.0))).unwrap())
            .collect();
        // Boards with a half-turn symmetry may be read either way.
        let all = finder::orders(&found.corners, &board);
        let rms = |c: &Places| {
            let off = c.iter().zip(&expected).filter_map(|(a, b)| Some(((*a)? - b).norm_squared()));
            (off.sum::<f64>() / c.iter().flatten().count() as f64).sqrt()
        };
        all.iter().map(rms).fold(f64::INFINITY, f64::min)
    }

    fn pose(x: f64, y: f64, z: f64, away: f64) -> Pose {
        Pose {
            rotation: Rotation3::new(Vector3::new(x, y, z)),
            translation_m: Vector3::new(0.01, -0.01, away),
        }
    }

    const CAMERA: Camera = Camera {
        fx_px: 533.5,
        fy_px: 533.2,
        cx_px: 331.0,
        cy_px: 236.0,
        distortion: Distortion::BrownConrady([-0.28, 0.09, 0.001, -0.0004, 0.0, 0.0, 0.0, 0.0]),
    };

    #[test]
    fn boards_are_found_under_blur_noise_tilt_and_uneven_light() {
        let board = Board::new(9, 6, 0.025).unwrap();
        let studio = BoardRenderer::new(&CAMERA, (640, 480), board);
        let base = Conditions::default();
        for (conditions, limit) in [
            (base, 0.05),
            (Conditions { blur_px: 0.0, ..base }, 0.06),
            (Conditions { blur_px: 2.0, ..base }, 0.10),
            (Conditions { blur_px: 3.0, ..base }, 0.25),
            (Conditions { noise: 10.0, ..base }, 0.12),
            (Conditions { light: 0.15, ..base }, 0.08),
            (Conditions { light: 0.15, noise: 4.0, blur_px: 1.5, ..base }, 0.25),
        ] {
            for (x, y, z) in
                [(0.0, 0.0, 0.0), (0.5, 0.3, 0.2), (-0.3, 0.7, 0.9), (0.75, -0.2, 1.6), (0.1, -0.8, 3.0)]
            {
                let rms = error(&studio, &CAMERA, &pose(x, y, z, 0.5), &conditions);
                assert!(rms < limit, "{conditions:?} {x} {y} {z}: {rms}");
            }
        }
    }

    #[test]
    fn boards_of_all_sizes_are_found() {
        let mut studio = BoardRenderer::new(&CAMERA, (640, 480), Board::new(4, 3, 0.1).unwrap());
        for (columns, rows) in
            [(3, 4), (4, 3), (5, 4), (7, 7), (8, 8), (6, 9), (9, 6), (11, 8), (13, 9), (20, 14)]
        {
            let board = Board::new(columns, rows, 0.25 / columns as f64).unwrap();
            studio.board = board;
            let rms = error(&studio, &CAMERA, &pose(0.3, 0.2, 0.1, 0.5), &Conditions::default());
            assert!(rms < 0.06, "{columns}x{rows}: {rms}");
        }
    }

    fn charuco() -> Board {
        Board::charuco((10, 7), 0.024, 0.018, Dictionary::Aruco { side: 5, count: 100 }, false).unwrap()
    }

    fn april_grid() -> Board {
        Board::april_grid((6, 4), 0.035, 0.3, 2).unwrap()
    }

    #[test]
    fn boards_with_markers_are_found_whole_and_in_part() {
        for board in [charuco(), april_grid()] {
            let studio = BoardRenderer::new(&CAMERA, (640, 480), board);
            let base = Conditions::default();
            let mut least = usize::MAX;
            for (conditions, limit) in [
                (base, 0.08),
                (Conditions { blur_px: 1.2, ..base }, 0.15),
                (Conditions { noise: 6.0, ..base }, 0.2),
                (Conditions { light: 0.3, ..base }, 0.12),
            ] {
                for (x, y, z) in [(0.0, 0.0, 0.0), (0.5, 0.3, 0.2), (-0.3, 0.6, 0.9), (0.1, -0.5, 3.0)] {
                    // The second time the board is cut off by two borders.
                    for (aside_m, share) in [(0.0, 0.9), (0.19, 0.25)] {
                        let mut pose = pose(x, y, z, 0.42);
                        pose.translation_m += Vector3::new(aside_m, 0.7 * aside_m, 0.0);
                        let rms = error(&studio, &CAMERA, &pose, &conditions);
                        let image = studio.picture(&pose, &conditions, 5);
                        let seen = finder::find(image.view(), &board).unwrap().corners;
                        let count = seen.iter().flatten().count();
                        assert!(
                            rms < limit,
                            "{:?} {conditions:?} {x} {y} {z} {aside_m}: {rms}",
                            board.pattern()
                        );
                        let needed = share * board.corners() as f64;
                        assert!(
                            count as f64 > needed,
                            "{:?} {conditions:?} {x} {y} {z}: {count}",
                            board.pattern()
                        );
                        least = least.min(count);
                    }
                }
            }
            assert!(least < board.corners() * 3 / 4, "no board was cut off: {least}");
        }
    }

    #[test]
    fn large_markers_and_april_tags_in_squares_are_found() {
        for (share, dictionary) in [(0.79, "4x4_50"), (0.75, "apriltag_36h11")] {
            let board =
                Board::charuco((7, 5), 0.032, share * 0.032, dictionary.parse().unwrap(), false).unwrap();
            let studio = BoardRenderer::new(&CAMERA, (640, 480), board);
            for (x, y, away) in [(0.0, 0.0, 0.42), (0.4, 0.3, 0.5)] {
                let rms = error(&studio, &CAMERA, &pose(x, y, 0.1, away), &Conditions::default());
                assert!(rms < 0.15, "{dictionary} {x} {y}: {rms}");
            }
        }
    }

    #[test]
    fn boards_with_markers_are_found_through_a_fisheye() {
        let camera = Camera {
            distortion: Distortion::Equidistant([-0.02, 0.01, -0.006, 0.001]),
            ..Camera::pinhole(230.0, 230.0, 322.0, 238.0)
        };
        for board in [charuco(), april_grid(), Board::new(9, 6, 0.025).unwrap()] {
            let studio = BoardRenderer::new(&camera, (640, 480), board);
            for aside_m in [0.0, 0.12] {
                let mut pose = pose(0.2, -0.3, 0.1, 0.2);
                pose.translation_m.x += aside_m;
                let rms = error(&studio, &camera, &pose, &Conditions::default());
                assert!(rms < 0.1, "{:?} {aside_m}: {rms}", board.pattern());
            }
        }
    }

    #[test]
    fn other_boards_with_markers_are_refused() {
        let studio = BoardRenderer::new(&CAMERA, (640, 480), charuco());
        let image = studio.picture(&pose(0.2, 0.2, 0.1, 0.5), &Conditions::default(), 1);
        let other = |dictionary: &str| {
            let board = Board::charuco((10, 7), 0.024, 0.018, dictionary.parse().unwrap(), false).unwrap();
            finder::find(image.view(), &board)
        };
        assert!(other("5x5_1000").is_ok(), "5x5_100 is its beginning");
        let none = Err(finder::NoBoard::Part { corners: 0 });
        assert_eq!(other("6x6_100"), none, "its markers are not read");
        assert_eq!(finder::find(image.view(), &april_grid()), none);
        assert_eq!(finder::find(GreyImage::new(640, 480).view(), &charuco()), Err(finder::NoBoard::None));
    }

    #[test]
    fn small_pictures_show_boards_too() {
        let camera = Camera { distortion: CAMERA.distortion, ..Camera::pinhole(225.0, 225.0, 135.0, 90.0) };
        let board = Board::new(9, 6, 0.025).unwrap();
        let studio = BoardRenderer::new(&camera, (270, 180), board);
        for (x, y, away) in [(0.0, 0.0, 0.45), (0.4, 0.3, 0.5), (-0.3, 0.5, 0.55), (0.2, 0.0, 0.6)] {
            let rms = error(&studio, &camera, &pose(x, y, 0.1, away), &Conditions::default());
            assert!(rms < 0.08, "{x} {y} {away}: {rms}");
        }
    }

    #[test]
    fn boards_that_are_cut_off_or_of_another_size_are_said() {
        let board = Board::new(9, 6, 0.025).unwrap();
        let studio = BoardRenderer::new(&CAMERA, (640, 480), board);
        let mut cut = pose(0.2, 0.2, 0.1, 0.5);
        cut.translation_m.x += 0.2;
        let image = studio.picture(&cut, &Conditions::default(), 1);
        let error = finder::find(image.view(), &board).unwrap_err();
        assert!(matches!(error, finder::NoBoard::Other { .. }), "{error}");
        let whole = studio.picture(&pose(0.2, 0.2, 0.1, 0.5), &Conditions::default(), 1);
        for (columns, rows) in [(8, 6), (9, 5), (10, 7), (6, 6), (7, 5)] {
            let other = Board::new(columns, rows, 0.025).unwrap();
            let error = finder::find(whole.view(), &other).unwrap_err();
            assert_eq!(error, finder::NoBoard::Other { columns: 9, rows: 6 }, "{columns}x{rows}");
        }
        let empty = GreyImage::new(640, 480);
        assert_eq!(finder::find(empty.view(), &board).unwrap_err(), finder::NoBoard::None);
        // Images too small for any board.
        for (w, h) in [(1, 1), (8, 3), (20, 17)] {
            assert!(finder::find(GreyImage::new(w, h).view(), &board).is_err());
        }
    }
}
