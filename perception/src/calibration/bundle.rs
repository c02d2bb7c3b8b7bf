//! Bundle adjustment of cameras and boards: Levenberg–Marquardt with analytic derivatives.
//!
//! The pose parameters of a board affect only its own corners, so they are eliminated board by board (Schur
//! complement), and only the camera parameters, about two dozen, are solved for jointly. The reduced matrices
//! also give the uncertainty of the cameras.

use super::camera::{Camera, Lens, MAX_PARAMETERS};
use super::pose::{Pose, cross};
use nalgebra::{DMatrix, DVector, Matrix2x3, Matrix3, SMatrix, SVector, Vector2, Vector3};

/// Threshold of Huber's loss in pixels, used until outlier corners are rejected.
pub(super) const HUBER_PX: f64 = 0.7;

/// Number of a view's own parameters: rotation and translation of the board, and shift of the second image.
const OWN: usize = 8;
/// Symmetric matrix over a view's own parameters.
pub type OwnMatrix = SMatrix<f64, OWN, OWN>;
type OwnVector = SVector<f64, OWN>;

/// Maximum number of iterations.
const ROUNDS: usize = 60;
/// Weight of the prior on the squared coefficients of the rational lens, in px².
const PRIOR_COST: f64 = 0.3;

/// Observed corners of one view.
#[derive(Clone, Debug)]
pub struct View {
    /// For each camera the corners in the board's order, in pixels; rejected corners are `None`. The list of a
    /// camera that did not see the board is empty.
    pub corners: Vec<Vec<Option<Vector2<f64>>>>,
}

/// The parameters that are estimated besides the poses of the boards.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Free {
    /// The distortion coefficients.
    pub lens: Lens,
    /// Whether camera parameters are estimated.
    pub cameras: bool,
    /// Whether a stretch of the board along its rows is estimated.
    pub stretch: bool,
    /// Whether a bend of the board is estimated.
    pub bend: bool,
}

impl Free {
    /// Number of shape parameters.
    fn shape(&self) -> usize {
        usize::from(self.stretch) + if self.bend { 3 } else { 0 }
    }
}

/// Deviation of a board from its ideal plane pattern.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Shape {
    /// Ratio of its length along the rows to the nominal length.
    pub stretch: f64,
    /// Bend out of the plane, in metres: coefficients of x², x·y and y² with coordinates in units of half the
    /// board's diagonal.
    pub bend_m: [f64; 3],
}

impl Shape {
    /// A flat board with square squares.
    pub const FLAT: Shape = Shape { stretch: 1.0, bend_m: [0.0; 3] };

    /// Position of a corner in board coordinates, and its derivatives with respect to the bend coefficients.
    fn place(&self, p: &Vector2<f64>, inverse_reach: f64) -> (Vector3<f64>, [f64; 3]) {
        let (x, y) = (p.x * inverse_reach, p.y * inverse_reach);
        let lift = [x * x, x * y, y * y];
        let z = lift.iter().zip(self.bend_m).map(|(l, b)| l * b).sum();
        (Vector3::new(p.x * self.stretch, p.y, z), lift)
    }
}

/// All estimated quantities.
#[derive(Clone, Debug)]
pub struct State {
    /// One camera, or two.
    pub cameras: Vec<Camera>,
    /// Transformation from the first camera's to the second camera's coordinates; unused with one camera.
    pub between: Pose,
    /// The board's shape.
    pub shape: Shape,
    /// Transformation from each board to the first camera.
    pub boards: Vec<Pose>,
    /// Shift of each board in the second camera's image, in pixels: hand-held boards move between the
    /// exposures.
    pub shifts: Vec<Vector2<f64>>,
}

/// Contribution of one view to the shared parameters, with its own pose eliminated.
#[derive(Clone, Debug)]
pub struct Share {
    /// Contribution to the information matrix, in 1/px².
    pub information: DMatrix<f64>,
    /// Contribution to the gradient.
    pub gradient: DVector<f64>,
}

/// A solved problem.
#[derive(Clone, Debug)]
pub struct Solution {
    /// The estimate.
    pub state: State,
    /// Sum of squared residuals with robust weights, in px².
    pub cost: f64,
    /// Contribution of each view, at the estimate.
    pub shares: Vec<Share>,
    /// Number of iterations.
    pub rounds: usize,
}

impl Solution {
    /// Information about the shared parameters, in 1 over the squared unit of each, per px² of a corner's variance; `None` without views.
    pub fn information(&self) -> Option<DMatrix<f64>> {
        let n = self.shares.first()?.gradient.len();
        Some(self.shares.iter().fold(DMatrix::zeros(n, n), |sum, share| sum + &share.information))
    }
}

/// A bundle-adjustment problem.
#[derive(Clone, Copy, Debug)]
pub struct Problem<'a> {
    /// The board's corners, in metres.
    pub board: &'a [Vector2<f64>],
    /// The observed views.
    pub views: &'a [View],
    /// The estimated parameters.
    pub free: Free,
    /// Threshold of Huber's loss in pixels; infinite for plain least squares.
    pub huber_px: f64,
    /// Weight of the squared shift of a view: variance of a corner over variance of the shifts. [`RIGID`] disables
    /// shifts.
    pub shift_cost: f64,
}

/// Shift weight that disables shifts.
pub const RIGID: f64 = 1e12;

/// The normal equations of one view.
struct Normal {
    global: DMatrix<f64>,
    mixed: DMatrix<f64>,
    own: OwnMatrix,
    global_right: DVector<f64>,
    own_right: OwnVector,
    cost: f64,
}

impl Problem<'_> {
    /// Number of parameters that all views share.
    pub fn globals(&self, cameras: usize) -> usize {
        let intrinsics = if self.free.cameras { cameras * self.free.lens.parameters() } else { 0 };
        intrinsics + 6 * (cameras - 1) + self.free.shape()
    }

    /// Indices and values of the coefficients with a weak prior at zero.
    fn with_prior(&self, state: &State) -> Vec<(usize, f64)> {
        if !self.free.cameras || self.free.lens != Lens::Rational {
            return Vec::new();
        }
        let (starts, ..) = self.starts(state.cameras.len());
        let each = |(camera, start): (&Camera, usize)| {
            let p = camera.parameters();
            [4, 5, 8, 9, 10, 11].map(|k| (start + k, p[k]))
        };
        state.cameras.iter().zip(starts).flat_map(each).collect()
    }

    /// One over the board's half diagonal, in 1/m.
    fn inverse_reach(&self) -> f64 {
        1.0 / self.board.iter().map(|p| p.norm()).fold(1e-9, f64::max)
    }

    /// Indices of the first parameter of each camera, of the relative pose, and of the shape among the shared
    /// parameters.
    fn starts(&self, cameras: usize) -> ([usize; 2], usize, usize) {
        let each = if self.free.cameras { self.free.lens.parameters() } else { 0 };
        ([0, each], cameras * each, cameras * each + 6 * (cameras - 1))
    }

    /// Residuals of a view for each camera and corner: observed minus projected position in pixels. The shift of the
    /// second image is part of the residual.
    pub fn residuals(&self, state: &State, view: usize) -> Vec<Vec<Option<Vector2<f64>>>> {
        let board = &state.boards[view];
        let corners = &self.views[view].corners;
        let inverse_reach = self.inverse_reach();
        corners
            .iter()
            .enumerate()
            .map(|(c, seen)| {
                let pose = if c == 0 { *board } else { board.then(&state.between) };
                seen.iter()
                    .zip(self.board)
                    .map(|(seen, p)| {
                        let point = pose.apply(&state.shape.place(p, inverse_reach).0);
                        Some((*seen)? - state.cameras[c].project(&point)?)
                    })
                    .collect()
            })
            .collect()
    }

    /// The normal equations of a view; `None` if a corner lies behind a camera.
    fn normal(&self, state: &State, view: usize) -> Option<Normal> {
        let cameras = state.cameras.len();
        let n = self.globals(cameras);
        let (camera_starts, between_start, shape_start) = self.starts(cameras);
        let parameters = if self.free.cameras { self.free.lens.parameters() } else { 0 };
        let mut normal = Normal {
            global: DMatrix::zeros(n, n),
            mixed: DMatrix::zeros(n, OWN),
            own: OwnMatrix::zeros(),
            global_right: DVector::zeros(n),
            own_right: OwnVector::zeros(),
            cost: 0.0,
        };
        let board = &state.boards[view];
        let shift = state.shifts[view];
        normal.cost = self.shift_cost * shift.norm_squared();
        for k in 0..2 {
            normal.own[(6 + k, 6 + k)] = self.shift_cost;
            normal.own_right[6 + k] = -self.shift_cost * shift[k];
        }
        let beside: Matrix3<f64> = *state.between.rotation.matrix();
        // A row of derivatives, dense over the parameters that affect a corner of this camera.
        const WIDEST: usize = MAX_PARAMETERS + 6 + 4;
        let inverse_reach = self.inverse_reach();
        for (c, seen) in self.views[view].corners.iter().enumerate() {
            let (start, extra) = (camera_starts[c], if c == 0 { 0 } else { 6 });
            let count = parameters + extra + self.free.shape();
            let index = |k: usize| {
                if k < parameters {
                    start + k
                } else if k < parameters + extra {
                    between_start + k - parameters
                } else {
                    shape_start + k - parameters - extra
                }
            };
            let mut block = SMatrix::<f64, WIDEST, WIDEST>::zeros();
            let mut block_mixed = SMatrix::<f64, WIDEST, OWN>::zeros();
            let mut block_right = SVector::<f64, WIDEST>::zeros();
            for (seen, p) in seen.iter().zip(self.board) {
                let Some(seen) = seen else { continue };
                let (place, lift) = state.shape.place(p, inverse_reach);
                let turned = board.rotation * place;
                let first = turned + board.translation_m;
                let point = if c == 0 { first } else { state.between.apply(&first) };
                let projection = state.cameras[c].project_with_derivatives(&point)?;
                let residual = if c == 0 { seen - projection.pixel } else { seen - projection.pixel - shift };
                let size = residual.norm();
                let weight = if size > self.huber_px { self.huber_px / size } else { 1.0 };
                normal.cost += if size > self.huber_px {
                    self.huber_px * (2.0 * size - self.huber_px)
                } else {
                    size * size
                };
                // Derivative with respect to the point in the first camera's coordinates.
                let by_first: Matrix2x3<f64> =
                    if c == 0 { projection.by_point } else { projection.by_point * beside };
                let mut by_pose = SMatrix::<f64, 2, OWN>::zeros();
                by_pose.fixed_view_mut::<2, 3>(0, 0).copy_from(&-(by_first * cross(&turned)));
                by_pose.fixed_view_mut::<2, 3>(0, 3).copy_from(&by_first);
                if c == 1 {
                    by_pose[(0, 6)] = 1.0;
                    by_pose[(1, 7)] = 1.0;
                }
                let mut row = SMatrix::<f64, 2, WIDEST>::zeros();
                for k in 0..parameters {
                    row.set_column(k, &projection.by_parameters.column(k));
                }
                if extra > 0 {
                    let turned = beside * first;
                    let by_turn = -(projection.by_point * cross(&turned));
                    for k in 0..3 {
                        row.set_column(parameters + k, &by_turn.column(k));
                        row.set_column(parameters + 3 + k, &projection.by_point.column(k));
                    }
                }
                let mut shape = parameters + extra;
                if self.free.stretch {
                    let along = board.rotation * Vector3::new(p.x, 0.0, 0.0);
                    row.set_column(shape, &(by_first * along));
                    shape += 1;
                }
                if self.free.bend {
                    let up = by_first * (board.rotation * Vector3::z());
                    for (k, l) in lift.iter().enumerate() {
                        row.set_column(shape + k, &(up * *l));
                    }
                }
                for r in 0..2 {
                    let own = by_pose.row(r).transpose();
                    normal.own.ger(weight, &own, &own, 1.0);
                    normal.own_right += own * (weight * residual[r]);
                    for a in 0..count {
                        let value = weight * row[(r, a)];
                        if value == 0.0 {
                            continue;
                        }
                        block_right[a] += value * residual[r];
                        for b in 0..=a {
                            block[(a, b)] += value * row[(r, b)];
                        }
                        for b in 0..OWN {
                            block_mixed[(a, b)] += value * own[b];
                        }
                    }
                }
            }
            for a in 0..count {
                let i = index(a);
                normal.global_right[i] += block_right[a];
                for b in 0..=a {
                    let j = index(b);
                    normal.global[(i, j)] += block[(a, b)];
                    if i != j {
                        normal.global[(j, i)] += block[(a, b)];
                    }
                }
                for b in 0..OWN {
                    normal.mixed[(i, b)] += block_mixed[(a, b)];
                }
            }
        }
        Some(normal)
    }

    fn normals(&self, state: &State) -> Option<(Vec<Normal>, f64)> {
        let normals: Vec<Normal> =
            (0..self.views.len()).map(|v| self.normal(state, v)).collect::<Option<_>>()?;
        let prior =
            self.with_prior(state).into_iter().map(|(_, value)| PRIOR_COST * value * value).sum::<f64>();
        let cost = normals.iter().map(|n| n.cost).sum::<f64>() + prior;
        cost.is_finite().then_some((normals, cost))
    }

    /// Solves the damped normal equations: the step of the shared parameters and of each view's own
    /// parameters.
    fn step(
        &self,
        state: &State,
        normals: &[Normal],
        n: usize,
        damping: f64,
    ) -> Option<(DVector<f64>, Vec<OwnVector>)> {
        let mut matrix = DMatrix::<f64>::zeros(n, n);
        let mut right = DVector::<f64>::zeros(n);
        let mut inverses = Vec::with_capacity(normals.len());
        for normal in normals {
            let mut own = normal.own;
            for i in 0..OWN {
                own[(i, i)] += damping * normal.own[(i, i)] + 1e-12;
            }
            let inverse = own.cholesky()?.inverse();
            let weighted = &normal.mixed * inverse;
            matrix += &normal.global;
            matrix -= &weighted * normal.mixed.transpose();
            right += &normal.global_right;
            right -= weighted * normal.own_right;
            inverses.push(inverse);
        }
        // Without a prior, coefficients of the rational lens can grow without bound and cancel each other.
        for (i, value) in self.with_prior(state) {
            matrix[(i, i)] += PRIOR_COST;
            right[i] -= PRIOR_COST * value;
        }
        for i in 0..n {
            let whole: f64 = normals.iter().map(|v| v.global[(i, i)]).sum();
            matrix[(i, i)] += damping * whole + 1e-12;
        }
        let global = if n == 0 { right } else { matrix.cholesky()?.solve(&right) };
        let boards = normals
            .iter()
            .zip(&inverses)
            .map(|(v, inverse)| inverse * (v.own_right - v.mixed.transpose() * &global))
            .collect();
        Some((global, boards))
    }

    fn moved(&self, state: &State, global: &DVector<f64>, boards: &[OwnVector]) -> State {
        let mut next = state.clone();
        let (camera_starts, between_start, shape_start) = self.starts(state.cameras.len());
        if self.free.cameras {
            for (camera, start) in next.cameras.iter_mut().zip(camera_starts) {
                let mut p = camera.parameters();
                for k in 0..self.free.lens.parameters() {
                    p[k] += global[start + k];
                }
                *camera = camera.with_parameters(&p);
            }
        }
        if state.cameras.len() > 1 {
            next.between = state.between.stepped(&SVector::from_fn(|i, _| global[between_start + i]));
        }
        let mut shape = shape_start;
        if self.free.stretch {
            next.shape.stretch += global[shape];
            shape += 1;
        }
        if self.free.bend {
            for (k, bend) in next.shape.bend_m.iter_mut().enumerate() {
                *bend += global[shape + k];
            }
        }
        for (i, step) in boards.iter().enumerate() {
            next.boards[i] = state.boards[i].stepped(&step.fixed_rows::<6>(0).into_owned());
            next.shifts[i] += step.fixed_rows::<2>(6);
        }
        next
    }

    /// Solves from a start value; `None` if a corner lies behind a camera there, or the views do not determine the
    /// parameters.
    pub fn solve(&self, start: State) -> Option<Solution> {
        let n = self.globals(start.cameras.len());
        let mut state = start;
        let (mut normals, mut cost) = self.normals(&state)?;
        let mut damping = 1e-3;
        let mut rounds = 0;
        while rounds < ROUNDS && damping < 1e8 {
            rounds += 1;
            let Some((global, boards)) = self.step(&state, &normals, n, damping) else {
                damping *= 10.0;
                continue;
            };
            let next = self.moved(&state, &global, &boards);
            match self.normals(&next) {
                Some((next_normals, next_cost)) if next_cost <= cost => {
                    let gain = cost - next_cost;
                    (state, normals, cost) = (next, next_normals, next_cost);
                    let settled = gain <= 1e-10 * cost && damping < 1e-2;
                    damping = (damping * 0.1).max(1e-12);
                    if settled {
                        break;
                    }
                }
                _ => damping *= 10.0,
            }
        }
        let prior = self.with_prior(&state);
        let part = PRIOR_COST / normals.len().max(1) as f64;
        let shares = normals
            .iter()
            .map(|v| {
                let inverse = v.own.cholesky()?.inverse();
                let weighted = &v.mixed * inverse;
                let mut information = &v.global - &weighted * v.mixed.transpose();
                let mut gradient = &v.global_right - weighted * v.own_right;
                for &(i, value) in &prior {
                    information[(i, i)] += part;
                    gradient[i] -= part * value;
                }
                Some(Share { information, gradient })
            })
            .collect::<Option<Vec<_>>>()?;

        Some(Solution { state, cost, shares, rounds })
    }

    /// Derivative of a view's own parameters (rotation and translation of its board, shift of its second image; 8 rows) with respect
    /// to the shared ones, if they are re-estimated, and their covariance for known cameras and a corner variance of 1.
    pub fn own_response(&self, state: &State, view: usize) -> Option<(DMatrix<f64>, OwnMatrix)> {
        let normal = self.normal(state, view)?;
        let inverse = normal.own.cholesky()?.inverse();
        let response = -(inverse * normal.mixed.transpose());
        Some((DMatrix::from_fn(OWN, response.ncols(), |r, c| response[(r, c)]), inverse))
    }

    /// Estimates the pose of one board for known cameras, and the shift of its second image, from a start value.
    pub fn pose_of(&self, state: &State, view: usize, start: Pose) -> Option<(Pose, Vector2<f64>)> {
        let problem = Problem {
            views: std::slice::from_ref(&self.views[view]),
            free: Free { cameras: false, stretch: false, bend: false, lens: self.free.lens },
            ..*self
        };
        let mut own = State { boards: vec![start], shifts: vec![Vector2::zeros()], ..state.clone() };
        let mut damping = 1e-3;
        let mut normal = problem.normal(&own, 0)?;
        for _ in 0..ROUNDS {
            let mut matrix = normal.own;
            for i in 0..OWN {
                matrix[(i, i)] += damping * normal.own[(i, i)];
            }
            let step = matrix.cholesky()?.solve(&normal.own_right);
            let mut next = own.clone();
            next.boards[0] = own.boards[0].stepped(&step.fixed_rows::<6>(0).into_owned());
            next.shifts[0] += step.fixed_rows::<2>(6);
            match problem.normal(&next, 0) {
                Some(n) if n.cost <= normal.cost => {
                    let settled = normal.cost - n.cost <= 1e-12 * normal.cost;
                    (own, normal) = (next, n);
                    damping = (damping * 0.1).max(1e-12);
                    if settled {
                        break;
                    }
                }
                _ => {
                    damping *= 10.0;
                    if damping > 1e8 {
                        break;
                    }
                }
            }
        }
        Some((own.boards[0], own.shifts[0]))
    }
}
