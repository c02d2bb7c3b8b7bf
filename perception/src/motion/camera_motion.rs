//! Motion of the camera from points in space and their places in the image: RANSAC over three points, then robust least
//! squares over all.

use super::pose::Pose;
use crate::rig::Rig;
use nalgebra::{Matrix6, Vector6};

/// A point and where it is seen.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Observation {
    /// The point, in the frame of the camera before, in metres.
    pub point_m: [f64; 3],
    /// By how much the point moves for 1 px less of its disparity, in metres.
    pub depth_slope_m: [f64; 3],
    /// Standard deviation of its disparity, in px.
    pub disparity_sigma_px: f64,
    /// Where it is seen now: column and row, in px.
    pub at_px: [f64; 2],
    /// Standard deviation of each of them, in px.
    pub sigma_px: f64,
    /// Result: squared normalised error, 2 in the mean.
    pub error: f64,
    /// Result: whether it agrees with the motion.
    pub is_inlier: bool,
}

/// The estimated motion.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CameraMotion {
    /// From the camera before to the camera now.
    pub pose: Pose,
    /// Covariance of translation (m) and rotation vector (rad), each x, y, z, in the frame of the camera now.
    pub covariance: Matrix6<f64>,
    /// Number of observations that agree.
    pub inliers: usize,
    /// Variance of the errors in units of the expected one.
    pub variance_factor: f64,
    /// Error that all disparities have in common, in px, and its information (inverse variance): with too small
    /// disparities, far points move more than near ones let expect.
    pub disparity_offset_px: (f64, f64),
}

/// Squared normalised error above which an observation is an outlier: one in 10,000 of those with two degrees of freedom.
const MAX_ERROR: f64 = 18.4;
/// The same while hypotheses are compared, as three points determine the motion less exactly.
const MAX_HYPOTHESIS_ERROR: f64 = 40.0;
/// Median of the squared normalised error of two degrees of freedom.
const MEDIAN_ERROR: f64 = 1.386;
/// Number of hypotheses at most; and the probability that one of them is free of outliers, from which on it is enough.
const MAX_HYPOTHESES: usize = 80;
const ENOUGH: f64 = 0.999;
/// Iterations for a hypothesis, and for the result.
const HYPOTHESIS_STEPS: usize = 4;
const MAX_STEPS: usize = 12;
/// Shape of the robust weight (Geman and McClure): the squared error at which it is a quarter.
const ROBUST: f64 = 6.0;
/// Steps below this end the iteration: squared, in m and rad.
const FINAL_STEP: f64 = 1e-14;

/// Finds the motion that most observations agree with, beginning with `predicted`. `is_plausible` judges a motion. The
/// same observations give the same result.
pub fn estimate(
    rig: &Rig,
    observations: &mut [Observation],
    predicted: Pose,
    is_plausible: impl Fn(&Pose) -> bool,
) -> Option<CameraMotion> {
    if observations.len() < 3 {
        return None;
    }
    let start = best_hypothesis(rig, observations, predicted, &is_plausible);
    let mut pose = start;
    let mut factor = 1.0;
    let mut normal = Matrix6::zeros();
    for step in 0..MAX_STEPS {
        factor = rate(rig, observations, &pose);
        let (matrix, vector) =
            normal_equations(rig, observations.iter(), &pose, |o| weight(o.error / factor));
        let change = solve(matrix, vector)?;
        pose = moved(&pose, &change);
        normal = matrix;
        if step > 0 && change.norm_squared() < FINAL_STEP {
            break;
        }
    }
    if !is_plausible(&pose) {
        return None;
    }
    factor = rate(rig, observations, &pose).max(factor.min(1.0));
    let mut inliers = 0;
    for observation in observations.iter_mut() {
        observation.is_inlier = observation.error <= MAX_ERROR * factor;
        inliers += usize::from(observation.is_inlier);
    }
    let covariance = normal.try_inverse()? * factor;
    let disparity_offset_px = common_offset(rig, observations, &pose, &normal, factor);
    Some(CameraMotion { pose, covariance, inliers, variance_factor: factor, disparity_offset_px })
}

/// The motion of three points, of the prediction, or of all points that explains the observations best.
fn best_hypothesis(
    rig: &Rig,
    observations: &[Observation],
    predicted: Pose,
    is_plausible: &impl Fn(&Pose) -> bool,
) -> Pose {
    let mut best = (score(rig, observations, &predicted), predicted);
    let mut random = 0x9e37_79b9_7f4a_7c15_u64;
    let mut pick = || {
        // xorshift64*: any sequence will do, as long as it is always the same.
        random ^= random >> 12;
        random ^= random << 25;
        random ^= random >> 27;
        (random.wrapping_mul(0x2545_f491_4f6c_dd1d) >> 33) as usize % observations.len()
    };
    let mut needed = MAX_HYPOTHESES;
    let mut count = 0;
    while count < needed {
        count += 1;
        let chosen = [pick(), pick(), pick()];
        if chosen[0] == chosen[1] || chosen[1] == chosen[2] || chosen[0] == chosen[2] {
            continue;
        }
        let mut pose = predicted;
        let solved = (0..HYPOTHESIS_STEPS).all(|_| {
            let three = chosen.iter().map(|&k| &observations[k]);
            let (matrix, vector) = normal_equations(rig, three, &pose, |_| 1.0);
            solve(matrix, vector).map(|change| pose = moved(&pose, &change)).is_some()
        });
        if !solved || !is_plausible(&pose) {
            continue;
        }
        let found = score(rig, observations, &pose);
        if found < best.0 {
            best = (found, pose);
            let agree = observations.iter().filter(|o| error(rig, o, &pose).0 < MAX_HYPOTHESIS_ERROR).count();
            let share = agree as f64 / observations.len() as f64;
            let miss = (1.0 - share.powi(3)).clamp(1e-9, 1.0 - 1e-9);
            needed = needed.min(((1.0 - ENOUGH).ln() / miss.ln()).ceil() as usize);
        }
    }
    best.1
}

/// Sum of the squared normalised errors, each limited (MSAC).
fn score(rig: &Rig, observations: &[Observation], pose: &Pose) -> f64 {
    observations.iter().map(|o| error(rig, o, pose).0.min(MAX_HYPOTHESIS_ERROR)).sum()
}

/// Sets the errors for a motion; returns their variance in units of the expected one, by the median.
fn rate(rig: &Rig, observations: &mut [Observation], pose: &Pose) -> f64 {
    for observation in observations.iter_mut() {
        observation.error = error(rig, observation, pose).0;
    }
    let near = observations.iter().filter(|o| o.error < MAX_HYPOTHESIS_ERROR).count();
    // The median of those that are not far off, by bisection: sorting would need memory.
    let (mut low, mut high) = (0.0, MAX_HYPOTHESIS_ERROR);
    for _ in 0..20 {
        let middle = 0.5 * (low + high);
        let below = observations.iter().filter(|o| o.error < middle).count();
        if 2 * below < near { low = middle } else { high = middle }
    }
    (high / MEDIAN_ERROR).clamp(MIN_FACTOR, MAX_FACTOR)
}

/// Limits of the variance factor: a quarter to four times the expected standard deviation.
const MIN_FACTOR: f64 = 1.0 / 16.0;
const MAX_FACTOR: f64 = 16.0;

fn weight(error: f64) -> f64 {
    let ratio = 1.0 / (1.0 + error / ROBUST);
    ratio * ratio
}

/// Squared normalised error, the residual in px, the point in the camera now, and the inverse covariance of the residual
/// (xx, xy, yy).
fn error(rig: &Rig, o: &Observation, pose: &Pose) -> (f64, [f64; 2], [f64; 3], [f64; 3]) {
    let p = pose.apply(o.point_m);
    if p[2] < MIN_DEPTH_M {
        return (f64::MAX, [0.0; 2], p, [0.0; 3]);
    }
    let scale = rig.focal_px / p[2];
    let residual = [o.at_px[0] - rig.cx_px - scale * p[0], o.at_px[1] - rig.cy_px - scale * p[1]];
    let q = disparity_slope(rig, o, pose, p).map(|slope| slope * o.disparity_sigma_px);
    // (σ² I + q qᵀ)⁻¹
    let variance = o.sigma_px * o.sigma_px;
    let share = 1.0 / (variance + q[0] * q[0] + q[1] * q[1]);
    let inverse = [
        (1.0 - share * q[0] * q[0]) / variance,
        -share * q[0] * q[1] / variance,
        (1.0 - share * q[1] * q[1]) / variance,
    ];
    let [x, y] = residual;
    (inverse[0] * x * x + 2.0 * inverse[1] * x * y + inverse[2] * y * y, residual, p, inverse)
}

/// By how much the place in the image moves for 1 px less of the point's disparity.
fn disparity_slope(rig: &Rig, o: &Observation, pose: &Pose, p: [f64; 3]) -> [f64; 2] {
    let scale = rig.focal_px / p[2];
    let shift = pose.rotate(o.depth_slope_m);
    [scale * (shift[0] - p[0] / p[2] * shift[2]), scale * (shift[1] - p[1] / p[2] * shift[2])]
}

/// The error that the disparities of all inliers have in common, in px (to be added to them), and its information, with the
/// motion free: `normal` are the motion's normal equations.
fn common_offset(
    rig: &Rig,
    observations: &[Observation],
    pose: &Pose,
    normal: &Matrix6<f64>,
    factor: f64,
) -> (f64, f64) {
    let (mut information, mut sum) = (0.0, 0.0);
    let mut mixed = Vector6::zeros();
    for o in observations.iter().filter(|o| o.is_inlier) {
        let (_, residual, p, inverse) = error(rig, o, pose);
        let weight = weight(o.error / factor);
        let [xx, xy, yy] = inverse.map(|v| v * weight);
        let slope = disparity_slope(rig, o, pose, p).map(|v| -v);
        let left = [xx * slope[0] + xy * slope[1], xy * slope[0] + yy * slope[1]];
        information += left[0] * slope[0] + left[1] * slope[1];
        sum += left[0] * residual[0] + left[1] * residual[1];
        for (k, [x, y]) in motion_slopes(rig, p).into_iter().enumerate() {
            mixed[k] += left[0] * x + left[1] * y;
        }
    }
    // The motion's own residuals are balanced, so its part of the vector is zero.
    let Some(inverse) = normal.try_inverse() else { return (0.0, 0.0) };
    let remaining = information - mixed.dot(&(inverse * mixed));
    if remaining <= 1e-9 { (0.0, 0.0) } else { (sum / remaining, remaining / factor) }
}

/// Derivatives of the place in the image by translation and rotation of the camera, x, y, z each.
fn motion_slopes(rig: &Rig, p: [f64; 3]) -> [[f64; 2]; 6] {
    let scale = rig.focal_px / p[2];
    let rows = [[scale, 0.0, -scale * p[0] / p[2]], [0.0, scale, -scale * p[1] / p[2]]].map(|a| {
        // a · (ω × p) = ω · (p × a)
        let turn = [p[1] * a[2] - p[2] * a[1], p[2] * a[0] - p[0] * a[2], p[0] * a[1] - p[1] * a[0]];
        [a[0], a[1], a[2], turn[0], turn[1], turn[2]]
    });
    std::array::from_fn(|k| [rows[0][k], rows[1][k]])
}

/// Points nearer than this are not used, in metres.
const MIN_DEPTH_M: f64 = 0.3;

fn normal_equations<'a>(
    rig: &Rig,
    observations: impl Iterator<Item = &'a Observation>,
    pose: &Pose,
    weight: impl Fn(&Observation) -> f64,
) -> (Matrix6<f64>, Vector6<f64>) {
    let mut matrix = Matrix6::zeros();
    let mut vector = Vector6::zeros();
    for observation in observations {
        let (error, residual, p, inverse) = error(rig, observation, pose);
        if error == f64::MAX {
            continue;
        }
        let weight = weight(observation);
        let slopes = motion_slopes(rig, p);
        let [xx, xy, yy] = inverse.map(|v| v * weight);
        for i in 0..6 {
            let [x, y] = slopes[i];
            let left = [xx * x + xy * y, xy * x + yy * y];
            vector[i] += left[0] * residual[0] + left[1] * residual[1];
            for j in 0..=i {
                matrix[(i, j)] += left[0] * slopes[j][0] + left[1] * slopes[j][1];
            }
        }
    }
    for i in 0..6 {
        for j in i + 1..6 {
            matrix[(i, j)] = matrix[(j, i)];
        }
    }
    (matrix, vector)
}

fn solve(mut matrix: Matrix6<f64>, vector: Vector6<f64>) -> Option<Vector6<f64>> {
    // Three points may leave a direction undetermined.
    for i in 0..6 {
        matrix[(i, i)] += 1e-9 * matrix[(i, i)] + 1e-9;
    }
    let change = matrix.cholesky()?.solve(&vector);
    change.iter().all(|v| v.is_finite()).then_some(change)
}

fn moved(pose: &Pose, change: &Vector6<f64>) -> Pose {
    let turn = Pose::from_rotation_vector([change[3], change[4], change[5]]);
    Pose { translation_m: [change[0], change[1], change[2]], ..turn }.after(pose)
}
