//! Where the board should stand in a view's second picture, as all other views say.
//!
//! A board's pose takes up any shift of one picture alone. Two cameras before one board leave no such
//! freedom: a shift down is seen against the epipolar lines, one across against the board's size. The
//! view itself has pulled the cameras its way, so the cameras are taken from the others: the step that
//! they take without it is known from the solution (its share of the information and the gradient).

use super::bundle::{Problem, Solution};
use nalgebra::{Matrix2, Vector2};

/// What a cost of shifts is that costs nothing, and keeps the equations definite.
const FREE: f64 = 1e-3;

/// A view's second picture against all other views.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Offset {
    /// Seen less expected, in pixels.
    pub shift_px: Vector2<f64>,
    /// Standard deviation from the noise of the corners, in this view and in the others; infinite
    /// where the others leave the cameras open.
    pub sigma_px: Vector2<f64>,
}

impl Offset {
    /// How many standard deviations it is, both ways together.
    pub fn deviations(&self) -> f64 {
        self.shift_px.component_div(&self.sigma_px).norm()
    }
}

/// The offset of each view of a solution. `noise` is the variance of a coordinate of a corner, in px².
pub fn offsets(problem: &Problem<'_>, solution: &Solution, noise: f64) -> Vec<Offset> {
    let loose = Problem { shift_cost: FREE, ..*problem };
    let information = solution.shares.iter().map(|s| &s.information).sum::<nalgebra::DMatrix<f64>>();
    (0..problem.views.len())
        .map(|v| {
            let state = &solution.state;
            let open = Offset { shift_px: state.shifts[v], sigma_px: Vector2::repeat(f64::INFINITY) };
            let share = &solution.shares[v];
            let Some(others) = (&information - &share.information).cholesky() else { return open };
            let Some((_, own)) = loose.pose_of(state, v, state.boards[v]) else { return open };
            let Some((response, variance)) = loose.shift_response(state, v) else { return open };
            // The others' gradient is this view's, reversed: all of them together are at rest.
            let step = -others.solve(&share.gradient);
            let by_step = &response * step;
            let by_noise = &response * others.inverse() * response.transpose();
            let covariance = (Matrix2::from_fn(|r, c| by_noise[(r, c)]) + variance) * noise;
            Offset {
                shift_px: own + Vector2::new(by_step[0], by_step[1]),
                sigma_px: covariance.diagonal().map(|v| v.max(0.0).sqrt()),
            }
        })
        .collect()
}
