//! Least squares over cameras and boards: Levenberg–Marquardt with exact derivatives.
//!
//! Every board's six numbers touch only its own corners, so they are eliminated board by board
//! (Schur complement) and only the cameras' numbers, some two dozen, are solved for at once. The same
//! elimination leaves what the uncertainty of the cameras needs.

use super::camera::{Camera, Lens, MOST_PARAMETERS};
use super::pose::{Pose, cross};
use nalgebra::{DMatrix, DVector, Matrix2x3, Matrix3, SMatrix, SVector, Vector2, Vector3};

type Matrix6 = SMatrix<f64, 6, 6>;
type Vector6 = SVector<f64, 6>;
/// Derivatives of a pixel by a board's rotation and shift.
type ByPose = SMatrix<f64, 2, 6>;

const ROUNDS: usize = 60;

/// One board as the cameras saw it.
#[derive(Clone, Debug)]
pub struct View {
    /// For each camera its corners in the board's order, in pixels; a corner that does not count is
    /// `None`, a camera that did not see the board has an empty list.
    pub corners: Vec<Vec<Option<Vector2<f64>>>>,
}

/// What is estimated besides the boards' poses.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Free {
    /// The coefficients of the lenses.
    pub lens: Lens,
    /// Whether the cameras' parameters are free at all.
    pub cameras: bool,
    /// Whether the board may be longer along its rows than its squares say.
    pub stretch: bool,
}

/// Cameras, boards and how they stand.
#[derive(Clone, Debug)]
pub struct State {
    /// One camera, or two.
    pub cameras: Vec<Camera>,
    /// From the first camera's coordinates to the second's; unused with one camera.
    pub between: Pose,
    /// Length of the board along its rows over what its squares say.
    pub stretch: f64,
    /// From each board to the first camera.
    pub boards: Vec<Pose>,
}

/// What one board says of the cameras, its own pose eliminated.
#[derive(Clone, Debug)]
pub struct Share {
    /// Its part of the information matrix, in 1/px².
    pub information: DMatrix<f64>,
    /// Its part of the gradient.
    pub gradient: DVector<f64>,
}

/// A solved problem.
#[derive(Clone, Debug)]
pub struct Solution {
    /// The estimate.
    pub state: State,
    /// Squared residuals, summed, robust weights included, in px².
    pub cost: f64,
    /// What each view says, at the estimate.
    pub shares: Vec<Share>,
    /// Rounds that were needed.
    pub rounds: usize,
}

/// Corners of a board seen by cameras.
#[derive(Clone, Copy, Debug)]
pub struct Problem<'a> {
    /// The board's corners, in metres.
    pub board: &'a [Vector2<f64>],
    /// What was seen.
    pub views: &'a [View],
    /// What is estimated.
    pub free: Free,
    /// Residuals above this many pixels count less (Huber); infinite for plain least squares.
    pub huber_px: f64,
}

/// The normal equations of one view.
struct Normal {
    global: DMatrix<f64>,
    mixed: DMatrix<f64>,
    own: Matrix6,
    global_right: DVector<f64>,
    own_right: Vector6,
    cost: f64,
}

impl Problem<'_> {
    /// Numbers that all views share.
    pub fn globals(&self, cameras: usize) -> usize {
        let intrinsics = if self.free.cameras { cameras * self.free.lens.parameters() } else { 0 };
        intrinsics + 6 * (cameras - 1) + usize::from(self.free.stretch)
    }

    /// Where the numbers of a camera start among the shared ones; those of the second camera's pose
    /// and the stretch follow the cameras.
    fn starts(&self, cameras: usize) -> ([usize; 2], usize, usize) {
        let each = if self.free.cameras { self.free.lens.parameters() } else { 0 };
        ([0, each], cameras * each, cameras * each + 6 * (cameras - 1))
    }

    /// Residuals of a view, camera after camera, corner after corner: seen less expected, in pixels.
    pub fn residuals(&self, state: &State, view: usize) -> Vec<Vec<Option<Vector2<f64>>>> {
        let board = &state.boards[view];
        let corners = &self.views[view].corners;
        corners
            .iter()
            .enumerate()
            .map(|(c, seen)| {
                let pose = if c == 0 { *board } else { board.then(&state.between) };
                seen.iter()
                    .zip(self.board)
                    .map(|(seen, p)| {
                        let point = pose.apply(&Vector3::new(p.x * state.stretch, p.y, 0.0));
                        Some((*seen)? - state.cameras[c].project(&point)?)
                    })
                    .collect()
            })
            .collect()
    }

    /// The normal equations of a view, into `normal`; `None` when a corner lies behind a camera.
    fn normal(&self, state: &State, view: usize) -> Option<Normal> {
        let cameras = state.cameras.len();
        let n = self.globals(cameras);
        let (camera_starts, between_start, stretch_start) = self.starts(cameras);
        let parameters = if self.free.cameras { self.free.lens.parameters() } else { 0 };
        let mut normal = Normal {
            global: DMatrix::zeros(n, n),
            mixed: DMatrix::zeros(n, 6),
            own: Matrix6::zeros(),
            global_right: DVector::zeros(n),
            own_right: Vector6::zeros(),
            cost: 0.0,
        };
        let board = &state.boards[view];
        let beside: Matrix3<f64> = *state.between.rotation.matrix();
        // A row of derivatives, dense over what a corner of this camera touches.
        const WIDEST: usize = MOST_PARAMETERS + 6 + 1;
        for (c, seen) in self.views[view].corners.iter().enumerate() {
            let (start, extra) = (camera_starts[c], if c == 0 { 0 } else { 6 });
            let count = parameters + extra + usize::from(self.free.stretch);
            let place = |k: usize| {
                if k < parameters {
                    start + k
                } else if k < parameters + extra {
                    between_start + k - parameters
                } else {
                    stretch_start
                }
            };
            let mut block = SMatrix::<f64, WIDEST, WIDEST>::zeros();
            let mut block_mixed = SMatrix::<f64, WIDEST, 6>::zeros();
            let mut block_right = SVector::<f64, WIDEST>::zeros();
            for (seen, p) in seen.iter().zip(self.board) {
                let Some(seen) = seen else { continue };
                let plane = Vector3::new(p.x * state.stretch, p.y, 0.0);
                let turned = board.rotation * plane;
                let first = turned + board.translation_m;
                let point = if c == 0 { first } else { state.between.apply(&first) };
                let projection = state.cameras[c].project_with_derivatives(&point)?;
                let residual = seen - projection.pixel;
                let size = residual.norm();
                let weight = if size > self.huber_px { self.huber_px / size } else { 1.0 };
                normal.cost += if size > self.huber_px {
                    self.huber_px * (2.0 * size - self.huber_px)
                } else {
                    size * size
                };
                // By the point in the first camera's coordinates.
                let by_first: Matrix2x3<f64> =
                    if c == 0 { projection.by_point } else { projection.by_point * beside };
                let mut by_pose = ByPose::zeros();
                by_pose.fixed_view_mut::<2, 3>(0, 0).copy_from(&-(by_first * cross(&turned)));
                by_pose.fixed_view_mut::<2, 3>(0, 3).copy_from(&by_first);
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
                if self.free.stretch {
                    let along = board.rotation * Vector3::new(p.x, 0.0, 0.0);
                    row.set_column(parameters + extra, &(by_first * along));
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
                        for b in 0..6 {
                            block_mixed[(a, b)] += value * own[b];
                        }
                    }
                }
            }
            for a in 0..count {
                let i = place(a);
                normal.global_right[i] += block_right[a];
                for b in 0..=a {
                    let j = place(b);
                    normal.global[(i, j)] += block[(a, b)];
                    if i != j {
                        normal.global[(j, i)] += block[(a, b)];
                    }
                }
                for b in 0..6 {
                    normal.mixed[(i, b)] += block_mixed[(a, b)];
                }
            }
        }
        Some(normal)
    }

    fn normals(&self, state: &State) -> Option<(Vec<Normal>, f64)> {
        let normals: Vec<Normal> =
            (0..self.views.len()).map(|v| self.normal(state, v)).collect::<Option<_>>()?;
        let cost = normals.iter().map(|n| n.cost).sum::<f64>();
        cost.is_finite().then_some((normals, cost))
    }

    /// The step that the normal equations ask for under some damping: of the shared numbers and of
    /// each board.
    fn step(&self, normals: &[Normal], n: usize, damping: f64) -> Option<(DVector<f64>, Vec<Vector6>)> {
        let mut matrix = DMatrix::<f64>::zeros(n, n);
        let mut right = DVector::<f64>::zeros(n);
        let mut inverses = Vec::with_capacity(normals.len());
        for normal in normals {
            let mut own = normal.own;
            for i in 0..6 {
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

    fn moved(&self, state: &State, global: &DVector<f64>, boards: &[Vector6]) -> State {
        let mut next = state.clone();
        let (camera_starts, between_start, stretch_start) = self.starts(state.cameras.len());
        if self.free.cameras {
            for (camera, start) in next.cameras.iter_mut().zip(camera_starts) {
                let mut p = camera.parameters();
                for k in 0..self.free.lens.parameters() {
                    p[k] += global[start + k];
                }
                *camera = Camera::from_parameters(&p);
            }
        }
        if state.cameras.len() > 1 {
            next.between = state.between.stepped(&Vector6::from_fn(|i, _| global[between_start + i]));
        }
        if self.free.stretch {
            next.stretch += global[stretch_start];
        }
        for (pose, step) in next.boards.iter_mut().zip(boards) {
            *pose = pose.stepped(step);
        }
        next
    }

    /// Solves from a start; `None` when a corner lies behind a camera there, or the views leave the
    /// numbers open.
    pub fn solve(&self, start: State) -> Option<Solution> {
        let n = self.globals(start.cameras.len());
        let mut state = start;
        let (mut normals, mut cost) = self.normals(&state)?;
        let mut damping = 1e-3;
        let mut rounds = 0;
        while rounds < ROUNDS && damping < 1e8 {
            rounds += 1;
            let Some((global, boards)) = self.step(&normals, n, damping) else {
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
        let shares = normals
            .iter()
            .map(|v| {
                let inverse = v.own.cholesky()?.inverse();
                let weighted = &v.mixed * inverse;
                Some(Share {
                    information: &v.global - &weighted * v.mixed.transpose(),
                    gradient: &v.global_right - weighted * v.own_right,
                })
            })
            .collect::<Option<Vec<_>>>()?;
        Some(Solution { state, cost, shares, rounds })
    }

    /// The pose of one board before known cameras, from a start.
    pub fn pose_of(&self, state: &State, view: usize, start: Pose) -> Option<Pose> {
        let problem = Problem {
            views: std::slice::from_ref(&self.views[view]),
            free: Free { cameras: false, stretch: false, lens: self.free.lens },
            ..*self
        };
        let mut own = State { boards: vec![start], ..state.clone() };
        let mut damping = 1e-3;
        let mut normal = problem.normal(&own, 0)?;
        for _ in 0..ROUNDS {
            let mut matrix = normal.own;
            for i in 0..6 {
                matrix[(i, i)] += damping * normal.own[(i, i)];
            }
            let step = matrix.cholesky()?.solve(&normal.own_right);
            let mut next = own.clone();
            next.boards[0] = own.boards[0].stepped(&step);
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
        Some(own.boards[0])
    }
}
