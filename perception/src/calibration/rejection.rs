//! Rejection of outliers: corners that do not fit, and views that are inconsistent with the others.

use super::bundle::{Problem, RIGID, Solution, State, View};
use super::prediction::offsets;
use nalgebra::Vector2;

/// A view is rejected if the offset of its right image exceeds this number of robust standard deviations, but at
/// least [`MOVED_PX`] and at most [`VIEW_LIMITS_PX`]; it must also be significant ([`VIEW_CERTAINTY`]).
const VIEW_DEVIATIONS: f64 = 3.0;
/// Upper bound of the rejection limit, horizontally and vertically, in pixels.
const VIEW_LIMITS_PX: [f64; 2] = [0.7, 0.32];
/// Minimum norm of a rejected offset, in standard deviations of its prediction from the other views.
pub(super) const VIEW_CERTAINTY: f64 = 4.0;
/// Offset of a right image above which the view is reported, whether rejected or not, in pixels: it is closer to
/// half a pixel than to zero.
pub const MOVED_PX: f64 = 0.25;
/// Corners are rejected if their residual exceeds this number of robust standard deviations and of pixels.
const CORNER_LIMITS: (f64, f64) = (6.0, 0.6);

/// Why a view was rejected.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ViewFault {
    /// Its corners do not fit the model: root mean square residual, in pixels.
    Misfit(f64),
    /// Its right image is shifted relative to the prediction from the other views, in pixels.
    Shifted(Vector2<f64>),
}

/// Variance of a corner coordinate, in px².
pub(super) fn corner_variance(solution: &Solution, views: &[View], shift_cost: f64) -> f64 {
    let shifts = solution.state.shifts.iter().map(Vector2::norm_squared).sum::<f64>() * shift_cost;
    let seen: usize = views.iter().flat_map(|v| &v.corners).flatten().flatten().count();
    let globals = solution.shares.first().map_or(0, |s| s.gradient.len());
    // The pose of a board and, unless it rests, its motion.
    let own = if shift_cost < RIGID { 8 } else { 6 };
    let free = (2 * seen).saturating_sub(globals + own * views.len()).max(1);
    (solution.cost - if shift_cost < RIGID { shifts } else { 0.0 }).max(1e-12) / free as f64
}

/// Rejects outlier corners; returns whether there were any.
pub(super) fn reject_corners(
    problem: &Problem<'_>,
    state: &State,
    used: &[usize],
    views: &mut [View],
    rejected: &mut [Vec<(usize, usize)>],
) -> bool {
    let residuals: Vec<_> = (0..used.len())
        .map(|v| {
            let mut r = problem.residuals(state, v);
            // The shift of the view is not an error of its corners.
            r[1].iter_mut().flatten().for_each(|r| *r -= state.shifts[v]);
            r
        })
        .collect();
    let mut sizes: Vec<f64> = residuals.iter().flatten().flatten().flatten().map(Vector2::norm).collect();
    if sizes.is_empty() {
        return false;
    }
    sizes.sort_unstable_by(f64::total_cmp);
    // The median norm of a vector of two normal components is 1.1774 standard deviations.
    let limit = CORNER_LIMITS.1.max(CORNER_LIMITS.0 * sizes[sizes.len() / 2] / 1.1774);
    let mut any = false;
    for (&i, sides) in used.iter().zip(&residuals) {
        for (side, corners) in sides.iter().enumerate() {
            for (k, r) in corners.iter().enumerate() {
                if r.is_some_and(|r| r.norm() > limit) {
                    views[i].corners[side][k] = None;
                    rejected[i].push((side, k));
                    any = true;
                }
            }
        }
    }
    any
}

/// Views that are inconsistent with the others. `scatter` is the robust standard deviation of the views' shifts; it
/// never decreases when views are rejected, so that the iteration terminates.
pub(super) fn view_faults(
    problem: &Problem<'_>,
    solution: &Solution,
    scatter: &mut [f64; 2],
) -> Vec<Option<ViewFault>> {
    let (n, state) = (problem.views.len(), &solution.state);
    let middle = |mut values: Vec<f64>| {
        values.sort_unstable_by(f64::total_cmp);
        values.get(n / 2).copied().unwrap_or(0.0)
    };
    let misfits: Vec<f64> = (0..n)
        .map(|v| {
            let residuals = problem.residuals(state, v);
            let left = residuals[0].iter().flatten().map(|r| r.norm_squared());
            let right = residuals[1].iter().flatten().map(|r| (r - state.shifts[v]).norm_squared());
            let (sum, count) = left.chain(right).fold((0.0, 0), |(s, c), r| (s + r, c + 1));
            (sum / f64::from(count.max(1))).sqrt()
        })
        .collect();
    let misfit_limit = (4.0 * middle(misfits.clone())).max(0.6);
    let offsets = offsets(problem, solution, corner_variance(solution, problem.views, problem.shift_cost));
    for (axis, sigma) in scatter.iter_mut().enumerate() {
        let sizes = offsets.iter().map(|o| o.shift_px[axis].abs()).collect();
        *sigma = sigma.max(1.4826 * middle(sizes));
    }
    let sigma = *scatter;
    let mut found: Vec<(f64, usize, ViewFault)> = Vec::new();
    for v in 0..n {
        if misfits[v] > misfit_limit {
            found.push((misfits[v], v, ViewFault::Misfit(misfits[v])));
        }
    }
    // While some views have a misfit, the shifts of the others are not reliable.
    if found.is_empty() {
        for v in 0..n {
            let shift = offsets[v].shift_px;
            let limit = |axis: usize| (VIEW_DEVIATIONS * sigma[axis]).clamp(MOVED_PX, VIEW_LIMITS_PX[axis]);
            let excess = (0..2).map(|a| shift[a].abs() / limit(a)).fold(0.0, f64::max);
            if excess > 1.0 && offsets[v].deviations() > VIEW_CERTAINTY {
                found.push((excess, v, ViewFault::Shifted(shift)));
            }
        }
    }
    // One bad view makes others look bad: reject the worst first, and shifted views nearly one by one.
    let most = if misfits.iter().any(|m| *m > misfit_limit) { n / 6 } else { n / 20 };
    found.sort_unstable_by(|a, b| b.0.total_cmp(&a.0));
    let mut faults = vec![None; n];
    for (_, v, fault) in found.into_iter().take(most.max(1)) {
        faults[v] = Some(fault);
    }
    faults
}
