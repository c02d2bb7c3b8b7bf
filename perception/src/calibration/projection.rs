//! Uncertainty of projection: by how many pixels a calibration may err where it says that a point appears, over the image and
//! with the distance of the point.
//!
//! A point has a fixed place relative to the boards that were seen. A calibration that errs has wrong lenses and, to fit the same
//! corners, wrong poses of the boards. Where boards were, both errors nearly cancel each other; farther away and towards borders that
//! no board reached they do not. The mean of the boards' poses says where the point is (the "mean-pcam" method of mrcal: D. Kogan, NASA/JPL, 2021).

use super::bundle::{Problem, Solution};
use super::camera::{Camera, Lens};
use super::pose::{Pose, cross};
use nalgebra::{DMatrix, Matrix2, Matrix3, Matrix6, SMatrix, Vector2, Vector3};

/// Distance of a point that stands for infinity, in metres.
const FAR_M: f64 = 1e6;

/// Uncertainty of where two calibrated cameras see a point.
#[derive(Clone, Debug)]
pub struct ProjectionUncertainty {
    cameras: [Camera; 2],
    between: Pose,
    lens: Lens,
    /// Of the shared parameters.
    covariance: DMatrix<f64>,
    /// What a step of the shared parameters does to the mean of the boards: rotation about the origin, and translation.
    turn: DMatrix<f64>,
    shift: DMatrix<f64>,
    /// Positions of the boards, and covariance of their own poses for known cameras.
    boards: Vec<(Vector3<f64>, Matrix6<f64>)>,
}

impl ProjectionUncertainty {
    /// Of a solution for two cameras, with the covariance of its shared parameters; `noise` is the variance of a corner coordinate
    /// in px². `None` if a board's pose is not determined.
    pub fn new(
        problem: &Problem<'_>,
        solution: &Solution,
        covariance: DMatrix<f64>,
        noise: f64,
    ) -> Option<Self> {
        let state = &solution.state;
        let (count, n) = (state.boards.len() as f64, covariance.nrows());
        let (mut turn, mut shift) = (DMatrix::zeros(3, n), DMatrix::zeros(3, n));
        let mut boards = Vec::with_capacity(state.boards.len());
        for (view, board) in state.boards.iter().enumerate() {
            let (response, own) = problem.own_response(state, view)?;
            let (rotation, translation) = (response.rows(0, 3), response.rows(3, 3));
            let position = board.translation_m;
            turn += rotation / count;
            // A board turns about its own position.
            shift += (cross(&position) * rotation + translation) / count;
            boards.push((position, own.fixed_view::<6, 6>(0, 0) * noise));
        }
        let cameras = [state.cameras[0], state.cameras[1]];
        Some(Self {
            cameras,
            between: state.between,
            lens: problem.free.lens,
            covariance,
            turn,
            shift,
            boards,
        })
    }

    /// Standard deviation in pixels, in the worst direction, of where camera `side` (0 left, 1 right) sees a point that is seen at
    /// `pixel`, at a distance in metres (infinite too). `None` where the lens model shows nothing.
    pub fn sigma_px(&self, side: usize, pixel: Vector2<f64>, distance_m: f64) -> Option<f64> {
        let camera = &self.cameras[side];
        let ray = camera.undistort(pixel)?.push(1.0).normalize();
        let seen = ray * distance_m.min(FAR_M);
        let projection = camera.project_with_derivatives(&seen)?;
        let n = self.lens.parameters();
        let mut slopes = Slopes::zeros(self.covariance.nrows());
        slopes.columns_mut(side * n, n).copy_from(&projection.by_parameters.columns(0, n));
        // In the left camera's coordinates, in which the boards are.
        let (point, by_point) = if side == 0 {
            (seen, projection.by_point)
        } else {
            let turned = seen - self.between.translation_m;
            let mut between = slopes.columns_mut(2 * n, 6);
            between.columns_mut(0, 3).copy_from(&(projection.by_point * -cross(&turned)));
            between.columns_mut(3, 3).copy_from(&projection.by_point);
            let to_right: Matrix3<f64> = *self.between.rotation.matrix();
            (self.between.inverse().apply(&seen), projection.by_point * to_right)
        };
        slopes += by_point * (-cross(&point) * &self.turn + &self.shift);
        let shared = &slopes * &self.covariance * slopes.transpose();
        let mut variance = Matrix2::from_fn(|r, c| shared[(r, c)]);
        for (position, own) in &self.boards {
            let mut by_pose = SMatrix::<f64, 2, 6>::zeros();
            by_pose.fixed_columns_mut::<3>(0).copy_from(&(by_point * -cross(&(point - position))));
            by_pose.fixed_columns_mut::<3>(3).copy_from(&by_point);
            variance += by_pose * own * by_pose.transpose() / (self.boards.len() as f64).powi(2);
        }
        Some(variance.symmetric_eigenvalues().max().max(0.0).sqrt())
    }

    /// The same of points far away, in an image of `size`: in its middle, and the largest of positions a tenth of the image away from
    /// its borders.
    pub fn far_sigma_px(&self, side: usize, (width, height): (usize, usize)) -> Option<(f64, f64)> {
        /// Positions along a side of the image, over its length.
        const SHARES: [f64; 5] = [0.1, 0.3, 0.5, 0.7, 0.9];
        let at = |x: f64, y: f64| {
            let pixel = Vector2::new(x * (width.max(1) - 1) as f64, y * (height.max(1) - 1) as f64);
            self.sigma_px(side, pixel, f64::INFINITY)
        };
        let all = SHARES.iter().flat_map(|&x| SHARES.iter().filter_map(move |&y| at(x, y)));
        Some((at(0.5, 0.5)?, all.fold(0.0, f64::max)))
    }

    /// Median of the boards' distances from the left camera, in metres.
    pub fn board_distance_m(&self) -> f64 {
        let mut distances: Vec<f64> = self.boards.iter().map(|(position, _)| position.norm()).collect();
        distances.sort_unstable_by(f64::total_cmp);
        distances.get(distances.len() / 2).copied().unwrap_or_default()
    }
}

/// Two rows of derivatives with respect to the shared parameters.
type Slopes = nalgebra::OMatrix<f64, nalgebra::U2, nalgebra::Dyn>;

#[cfg(test)]
mod tests {
    use super::super::bundle::{Free, HUBER_PX, RIGID, View};
    use super::super::start;
    use super::super::tests::{Bench, SIZE};
    use super::*;

    const NOISE_PX: f64 = 0.2;
    const TRIALS: u64 = 150;

    /// Where a calibration sees what the true cameras see at `pixel`: by the boards, as found and as they are.
    fn seen(
        bench: &Bench,
        found: &Solution,
        side: usize,
        pixel: Vector2<f64>,
        distance_m: f64,
    ) -> Vector2<f64> {
        let ray = bench.cameras[side].undistort(pixel).unwrap().push(1.0).normalize();
        let seen = ray * distance_m;
        let point = if side == 0 { seen } else { bench.between.inverse().apply(&seen) };
        let count = bench.poses.len() as f64;
        let boards = bench.poses.iter().zip(&found.state.boards);
        let mean =
            boards.map(|(is, found)| found.apply(&is.inverse().apply(&point))).sum::<Vector3<f64>>() / count;
        let mean = if side == 0 { mean } else { found.state.between.apply(&mean) };
        found.state.cameras[side].project(&mean).unwrap()
    }

    /// Calibrations of the same views with other noise scatter as one of them says, near and far, in the middle and in a corner,
    /// through an ordinary lens and a fisheye.
    #[test]
    fn repeated_calibrations_scatter_as_stated() {
        let mut fisheye = Bench::new(14, 11);
        for camera in &mut fisheye.cameras {
            camera.distortion = super::super::Distortion::Equidistant([-0.02, 0.01, -0.006, 0.001]);
        }
        for (bench, lens) in [(Bench::new(14, 11), Lens::Radial2), (fisheye, Lens::Fisheye)] {
            let points = bench.board.points_m();
            let solutions: Vec<(Vec<View>, Solution)> = (0..TRIALS)
                .map(|seed| {
                    let pairs = bench.pairs(NOISE_PX, 1000 + seed).into_iter();
                    let views: Vec<View> = pairs.map(|p| View { corners: vec![p.left, p.right] }).collect();
                    let solution = start::solve(&points, &views, SIZE, lens).unwrap();
                    (views, solution)
                })
                .collect();
            let (views, first) = &solutions[0];
            let free = Free { lens, cameras: true, stretch: false, bend: false };
            let problem = Problem { board: &points, views, free, huber_px: HUBER_PX, shift_cost: RIGID };
            let information = first.shares.iter().map(|s| &s.information).sum::<DMatrix<f64>>();
            let covariance = information.cholesky().unwrap().inverse() * NOISE_PX.powi(2);
            let stated = ProjectionUncertainty::new(&problem, first, covariance, NOISE_PX.powi(2)).unwrap();
            let mut ratios = Vec::new();
            for side in 0..2 {
                for (x, y) in [(320.0, 240.0), (60.0, 50.0), (600.0, 300.0)] {
                    for distance_m in [0.6, 5.0, FAR_M] {
                        let pixel = Vector2::new(x, y);
                        let all: Vec<Vector2<f64>> =
                            solutions.iter().map(|(_, s)| seen(&bench, s, side, pixel, distance_m)).collect();
                        let mean = all.iter().sum::<Vector2<f64>>() / all.len() as f64;
                        let scatter =
                            all.iter().map(|p| (p - mean) * (p - mean).transpose()).sum::<Matrix2<f64>>();
                        let scatter = (scatter / (all.len() - 1) as f64).symmetric_eigenvalues().max().sqrt();
                        ratios.push(stated.sigma_px(side, pixel, distance_m).unwrap() / scatter);
                    }
                }
            }
            // 150 trials tell a standard deviation to 6 %.
            assert!(ratios.iter().all(|r| (0.8..1.25).contains(r)), "{lens:?}: {ratios:.2?}");
            // What no board was near to is the least certain.
            let sigma =
                |x: f64, distance_m: f64| stated.sigma_px(0, Vector2::new(x, 240.0), distance_m).unwrap();
            let near = stated.board_distance_m();
            assert!(sigma(320.0, FAR_M) > sigma(320.0, near) && sigma(5.0, near) > sigma(320.0, near));
            assert_eq!(sigma(320.0, f64::INFINITY), sigma(320.0, FAR_M));
        }
    }
}
