//! Uncertainty of a calibration.
//!
//! The corners of one view have common errors (a board that moves or bends, light, the lens model), so the usual
//! covariance, which assumes independent corners, is too small by a factor of two or three. Here the views are
//! left out one by one (a linearised jackknife: each view's share of the information matrix is known from the
//! solution), and the larger of both estimates is used.

use super::bundle::{Solution, State};
use super::camera::{Camera, Lens, MAX_PARAMETERS};
use super::pose::Pose;
use nalgebra::{DMatrix, DVector, SVector, Vector2};

/// Standard deviations of a calibration.
#[derive(Clone, Debug)]
pub struct Uncertainty {
    /// Of the parameters of both cameras, in the order of [`Camera::parameters`]; 0 for parameters that were not
    /// estimated.
    pub cameras: [[f64; MAX_PARAMETERS]; 2],
    /// Of the rotation vector between the cameras (about x, y, z), in radians.
    pub rotation_rad: [f64; 3],
    /// Of the translation between the cameras, in metres.
    pub translation_m: [f64; 3],
    /// Of the baseline, in metres.
    pub baseline_m: f64,
    /// Of the row in the right image that corresponds to a point at infinity in the left image, in pixels:
    /// maximum over the image.
    pub row_px: f64,
    /// Of the disparity of a point at infinity, in pixels: maximum over the middle half of the image.
    pub disparity_px: f64,
}

/// The cameras and their relative pose after a parameter step.
fn stepped(state: &State, lens: Lens, step: &DVector<f64>) -> ([Camera; 2], Pose) {
    let n = lens.parameters();
    let moved = |side: usize| {
        let mut p = state.cameras[side].parameters();
        for k in 0..n {
            p[k] += step[side * n + k];
        }
        state.cameras[side].with_parameters(&p)
    };
    let turn = SVector::<f64, 6>::from_fn(|i, _| step[2 * n + i]);
    ([moved(0), moved(1)], state.between.stepped(&turn))
}

/// The pixel of the right camera that shows the point at infinity seen at a pixel of the left camera.
fn far(cameras: &[Camera; 2], between: &Pose, pixel: Vector2<f64>) -> Option<Vector2<f64>> {
    let ray = cameras[0].undistort(pixel)?.push(1.0);
    cameras[1].project(&(between.rotation * ray))
}

impl Uncertainty {
    /// The covariance of the shared parameters if the errors of all corners were independent; `noise` is the variance of a corner
    /// coordinate in px². `None` if the views do not determine all parameters.
    pub fn independent(solution: &Solution, noise: f64) -> Option<DMatrix<f64>> {
        Some(solution.information()?.cholesky()?.inverse() * noise)
    }

    /// The covariance of the shared parameters; `noise` is the variance of a corner coordinate in px². `None` if
    /// the views do not determine all parameters.
    pub fn covariance(solution: &Solution, noise: f64) -> Option<DMatrix<f64>> {
        let information = solution.information()?;
        let independent = Self::independent(solution, noise)?;
        let (n, views) = (information.nrows(), solution.shares.len() as f64);
        let mut steps = Vec::with_capacity(solution.shares.len());
        for share in &solution.shares {
            steps.push((&information - &share.information).cholesky()?.solve(&share.gradient));
        }
        let mean = steps.iter().fold(DVector::zeros(n), |sum, s| sum + s) / views;
        let mut covariance = DMatrix::zeros(n, n);
        for step in &steps {
            let d = step - &mean;
            covariance.ger((views - 1.0) / views, &d, &d, 1.0);
        }
        // Never less than for independent corners.
        let grown: Vec<f64> =
            (0..n).map(|i| (independent[(i, i)] / covariance[(i, i)].max(1e-300)).max(1.0).sqrt()).collect();
        if grown.iter().any(|g| *g > 1e3) {
            return Some(independent);
        }
        for i in 0..n {
            for j in 0..n {
                covariance[(i, j)] *= grown[i] * grown[j];
            }
        }
        Some(covariance)
    }

    /// The standard deviations of a solution for two cameras with images of `size`, from [`Uncertainty::covariance`].
    pub fn new(solution: &Solution, covariance: &DMatrix<f64>, lens: Lens, size: (usize, usize)) -> Self {
        let n = lens.parameters();
        let sigma = |i: usize| covariance[(i, i)].max(0.0).sqrt();
        let mut cameras = [[0.0; MAX_PARAMETERS]; 2];
        for (side, camera) in cameras.iter_mut().enumerate() {
            for (k, s) in camera.iter_mut().enumerate().take(n) {
                *s = sigma(side * n + k);
            }
        }
        let state = &solution.state;
        let variance = |slope: &DVector<f64>| (slope.transpose() * covariance * slope)[0].max(0.0);
        let mut baseline = DVector::zeros(covariance.nrows());
        let t = state.between.translation_m;
        for k in 0..3 {
            baseline[2 * n + 3 + k] = t[k] / t.norm();
        }
        // Numerical derivatives of the pixels of points at infinity, with steps of 0.01 standard deviations.
        let (own, between) = ([state.cameras[0], state.cameras[1]], state.between);
        let (mut row_px, mut disparity_px) = (0.0_f64, 0.0_f64);
        for i in 0..15 {
            let (column, line) = (i % 5, i / 5);
            let pixel = Vector2::new(
                size.0 as f64 * (0.1 + 0.2 * column as f64),
                size.1 as f64 * (0.15 + 0.35 * line as f64),
            );
            let Some(here) = far(&own, &between, pixel) else { continue };
            let (mut across, mut down) =
                (DVector::zeros(covariance.nrows()), DVector::zeros(covariance.nrows()));
            for k in 0..2 * n + 6 {
                let h = (0.01 * sigma(k)).max(1e-12);
                let mut step = DVector::zeros(covariance.nrows());
                step[k] = h;
                let (cameras, between) = stepped(state, lens, &step);
                let Some(there) = far(&cameras, &between, pixel) else { continue };
                across[k] = (there.x - here.x) / h;
                down[k] = (there.y - here.y) / h;
            }
            row_px = row_px.max(variance(&down).sqrt());
            if (1..4).contains(&column) {
                disparity_px = disparity_px.max(variance(&across).sqrt());
            }
        }
        Self {
            cameras,
            rotation_rad: [0, 1, 2].map(|k| sigma(2 * n + k)),
            translation_m: [3, 4, 5].map(|k| sigma(2 * n + k)),
            baseline_m: variance(&baseline).sqrt(),
            row_px,
            disparity_px,
        }
    }
}
