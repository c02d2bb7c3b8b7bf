//! Predicts the position of the board in a view's right image from all other views.
//!
//! With one image, the pose of the board absorbs any shift. With two images of the same board it cannot: a
//! vertical shift shows against the epipolar lines, a horizontal one against the size of the board. The view
//! itself has influenced the estimated cameras, so they are replaced by those of the other views: the parameter
//! step without the view follows from the solution (its share of the information matrix and gradient).

use super::bundle::{Problem, Solution};
use nalgebra::{Matrix2, Vector2};

/// Shift cost that is practically zero, but keeps the normal equations positive definite.
const FREE_SHIFT_COST: f64 = 1e-3;

/// Offset of a view's right image relative to the prediction from all other views.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Offset {
    /// Observed minus predicted position, in pixels.
    pub shift_px: Vector2<f64>,
    /// Standard deviation due to the noise of the corners, in this view and in the others; infinite if the other
    /// views do not determine the cameras.
    pub sigma_px: Vector2<f64>,
}

impl Offset {
    /// Norm of the offset in standard deviations.
    pub fn deviations(&self) -> f64 {
        self.shift_px.component_div(&self.sigma_px).norm()
    }
}

/// The offset of each view of a solution. `noise` is the variance of a corner coordinate in px².
pub fn offsets(problem: &Problem<'_>, solution: &Solution, noise: f64) -> Vec<Offset> {
    let loose = Problem { shift_cost: FREE_SHIFT_COST, ..*problem };
    let information = solution.shares.iter().map(|s| &s.information).sum::<nalgebra::DMatrix<f64>>();
    (0..problem.views.len())
        .map(|v| {
            let state = &solution.state;
            let open = Offset { shift_px: state.shifts[v], sigma_px: Vector2::repeat(f64::INFINITY) };
            let share = &solution.shares[v];
            let Some(others) = (&information - &share.information).cholesky() else { return open };
            let Some((_, own)) = loose.pose_of(state, v, state.boards[v]) else { return open };
            let Some((response, covariance)) = loose.own_response(state, v) else { return open };
            // Of the shift alone.
            let (response, variance) = (response.rows(6, 2), covariance.fixed_view::<2, 2>(6, 6));
            // The gradient of the other views is the negative of this view's, as the total gradient is zero.
            let step = -others.solve(&share.gradient);
            let by_step = response * step;
            let by_noise = response * others.inverse() * response.transpose();
            let covariance = (Matrix2::from_fn(|r, c| by_noise[(r, c)]) + variance) * noise;
            Offset {
                shift_px: own + Vector2::new(by_step[0], by_step[1]),
                sigma_px: covariance.diagonal().map(|v| v.max(0.0).sqrt()),
            }
        })
        .collect()
}
