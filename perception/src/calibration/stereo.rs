//! Two cameras from the boards that both saw: the whole way from corners to a rectified pair, with
//! what it is worth.

use super::bundle::{Free, HUBER_PX, Problem, RIGID, Shape, Solution, State, View};
use super::camera::{Camera, Lens};
use super::finder::Board;
use super::pose::Pose;
use super::prediction::offsets;
use super::rectification::{Crop, Rectification, RectificationError};
use super::start;
use super::uncertainty::Uncertainty;
use nalgebra::{Vector2, Vector3};
use thiserror::Error;

/// Least views with which two cameras can be solved for.
pub const MIN_VIEWS: usize = 4;
/// Views from which on the board's bend is estimated.
const MIN_VIEWS_TO_BEND: usize = 8;
/// Squared ratio of corner noise to the views' shifts above which the shifts are taken for none.
const STEADY: f64 = 20.0;
/// A view is left out when its second picture is off by more than these many robust deviations …
const VIEW_DEVIATIONS: f64 = 3.0;
/// … and than [`MOVED_PX`], or, whatever the deviation, than this across and down …
const VIEW_LIMITS_PX: [f64; 2] = [0.7, 0.32];
/// … provided that this is so many deviations of where the other views foretell it, both ways together.
const VIEW_CERTAINTY: f64 = 4.0;
/// A view that is farther off than this, across or down, is nearer to half a pixel than to none: it is
/// named, left out or not.
pub const MOVED_PX: f64 = 0.25;
/// Corners farther off than these many robust deviations and this many pixels are left out.
const CORNER_LIMITS: (f64, f64) = (6.0, 0.6);

/// The same board in both pictures of a pair: corners in the same order, in pixels.
#[derive(Clone, Debug, PartialEq)]
pub struct Pair {
    /// In the left picture.
    pub left: Vec<Vector2<f64>>,
    /// In the right picture.
    pub right: Vec<Vector2<f64>>,
}

/// Why corners do not give a pair of cameras.
#[derive(Clone, Copy, Debug, Error, PartialEq)]
pub enum CalibrationError {
    /// Too few views.
    #[error("{given} pairs show the board, at least {MIN_VIEWS} are needed (10 to 30 are good)")]
    TooFew {
        /// Views that were given, or left.
        given: usize,
    },
    /// No solution.
    #[error(
        "the views do not determine the cameras: they are too alike; tilt the board by 20 to 45 degrees in all directions, near and far"
    )]
    Undetermined,
    /// The cameras cannot be rectified.
    #[error(transparent)]
    Rectification(#[from] RectificationError),
}

/// Why a view was left out.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ViewFault {
    /// Its corners do not fit: root mean square, in pixels.
    Misfit(f64),
    /// Its right picture is off against the others, in pixels.
    Shifted(Vector2<f64>),
}

/// What became of a view.
#[derive(Clone, Debug)]
pub struct ViewReport {
    /// Why it was left out, if it was.
    pub fault: Option<ViewFault>,
    /// Root mean square residual in the left and the right picture, one board pose for both, in px.
    pub rms_px: [f64; 2],
    /// How far the board in the right picture is off against all other views that are used, in pixels.
    pub shift_px: Vector2<f64>,
    /// Whether that is more than [`MOVED_PX`], across or down, and certainly so.
    pub moved: bool,
    /// Corners left out: side and index.
    pub rejected: Vec<(usize, usize)>,
    /// Seen less expected, for both pictures, in pixels.
    pub residuals_px: [Vec<Vector2<f64>>; 2],
    /// Row in the left less row in the right rectified picture, for every corner, in pixels.
    pub vertical_px: Vec<f64>,
    /// Angle between the board's and the left camera's axis, in radians.
    pub tilt_rad: f64,
    /// Which way the board is tilted: direction of its axis in the picture, in radians.
    pub tilt_direction_rad: f64,
    /// Distance of the board's middle from the left camera, in metres.
    pub distance_m: f64,
}

/// Two calibrated cameras.
#[derive(Clone, Debug)]
pub struct StereoCalibration {
    /// Left and right camera.
    pub cameras: [Camera; 2],
    /// Which coefficients were estimated.
    pub lens: Lens,
    /// From the left camera's coordinates to the right one's.
    pub between: Pose,
    /// The board's shape, with the stretch as estimated last (it does not enter the cameras).
    pub shape: Shape,
    /// Half the board's diagonal, in metres.
    pub board_reach_m: f64,
    /// Standard deviation of the stretch.
    pub stretch_sigma: f64,
    /// Standard deviations.
    pub uncertainty: Uncertainty,
    /// The rectified pair.
    pub rectification: Rectification,
    /// Root mean square reprojection error, one board pose for both pictures, used views, in px.
    pub rms_px: f64,
    /// The same for each picture alone.
    pub rms_sides_px: [f64; 2],
    /// Robust standard deviation, across and down, of how far boards are off in the right picture, of
    /// all views that fit in themselves.
    pub shift_sigma_px: Vector2<f64>,
    /// Mean vertical error of rectified corners, used views, in pixels.
    pub vertical_mean_px: f64,
    /// The same on views that took no part: half of the views gives the cameras for the other half.
    /// `None` with fewer than 8 views.
    pub vertical_heldout_px: Option<f64>,
    /// Cameras and their relative pose from every second view, from the first and from the second on.
    pub halves: Option<[([Camera; 2], Pose); 2]>,
    /// What became of the views, in their order.
    pub views: Vec<ViewReport>,
    /// Share of an 8 × 6 grid over each picture in which corners were seen.
    pub coverage: [f64; 2],
}

/// Calibrates two cameras from pictures of `size` of one board.
///
/// # Errors
/// When there are too few views, when they leave the cameras open or cannot be rectified.
pub fn calibrate(
    board: &Board,
    size: (usize, usize),
    pairs: &[Pair],
    lens: Lens,
    crop: Crop,
) -> Result<StereoCalibration, CalibrationError> {
    solve(board, size, pairs, lens, crop, true)
}

/// [`calibrate`] with every view, those that contradict the others too: what its figures are then, for a
/// comparison with those who leave none out.
///
/// # Errors
/// As [`calibrate`].
pub fn calibrate_all(
    board: &Board,
    size: (usize, usize),
    pairs: &[Pair],
    lens: Lens,
    crop: Crop,
) -> Result<StereoCalibration, CalibrationError> {
    solve(board, size, pairs, lens, crop, false)
}

fn solve(
    board: &Board,
    size: (usize, usize),
    pairs: &[Pair],
    lens: Lens,
    crop: Crop,
    selective: bool,
) -> Result<StereoCalibration, CalibrationError> {
    if pairs.len() < MIN_VIEWS {
        return Err(CalibrationError::TooFew { given: pairs.len() });
    }
    let points = board.points_m();
    let mut views: Vec<View> = pairs
        .iter()
        .map(|p| View {
            corners: [&p.left, &p.right].map(|c| c.iter().copied().map(Some).collect()).to_vec(),
        })
        .collect();
    let all = views.clone();
    let flat = start::solve(&points, &views, size, lens).ok_or(CalibrationError::Undetermined)?;
    // Which views take part, and the estimate from them.
    let mut used: Vec<usize> = (0..views.len()).collect();
    let mut faults: Vec<Option<ViewFault>> = vec![None; views.len()];
    let mut state = flat.state;
    let mut shift_cost = 1.0;
    let mut rejected = vec![Vec::new(); views.len()];
    let mut sigma = [0.0; 2];
    let solved = |views: &[View], state: State, shift_cost: f64, huber_px: f64| {
        let bend = views.len() >= MIN_VIEWS_TO_BEND;
        let free = Free { lens, cameras: true, stretch: false, bend };
        let problem = Problem { board: &points, views, free, huber_px, shift_cost };
        problem.solve(state).ok_or(CalibrationError::Undetermined)
    };
    for _ in 0..12 {
        let chosen: Vec<View> = used.iter().map(|&i| views[i].clone()).collect();
        let solution = solved(&chosen, state, shift_cost, HUBER_PX)?;
        let free = Free { lens, cameras: true, stretch: false, bend: chosen.len() >= MIN_VIEWS_TO_BEND };
        let problem = Problem { board: &points, views: &chosen, free, huber_px: HUBER_PX, shift_cost };
        let mut again = reject_corners(&problem, &solution.state, &used, &mut views, &mut rejected);
        let new_faults =
            if selective { view_faults(&problem, &solution, &mut sigma) } else { vec![None; chosen.len()] };
        state = solution.state;
        let keep: Vec<bool> = new_faults.iter().map(Option::is_none).collect();
        for (&i, fault) in used.iter().zip(&new_faults) {
            again |= fault.is_some();
            faults[i] = *fault;
        }
        let mut next = keep.iter();
        used.retain(|_| *next.next().unwrap_or(&true));
        let mut next = keep.iter();
        state.boards.retain(|_| *next.next().unwrap_or(&true));
        let mut next = keep.iter();
        state.shifts.retain(|_| *next.next().unwrap_or(&true));
        if used.len() < MIN_VIEWS {
            return Err(CalibrationError::TooFew { given: used.len() });
        }
        if !again {
            break;
        }
    }
    let chosen: Vec<View> = used.iter().map(|&i| views[i].clone()).collect();
    // How much boards move between the exposures is estimated from what they did.
    let mut solution = solved(&chosen, state, shift_cost, f64::INFINITY)?;
    for _ in 0..2 {
        let noise = corner_variance(&solution, &chosen, shift_cost);
        let moved =
            solution.state.shifts.iter().map(Vector2::norm_squared).sum::<f64>() / (2 * chosen.len()) as f64;
        // Corners of one view have errors in common: shifts never come for free.
        let cost = (noise / moved.max(1e-12)).max(1.0);
        shift_cost = if cost > STEADY { RIGID } else { cost };
        solution = solved(&chosen, solution.state, shift_cost, f64::INFINITY)?;
        if shift_cost == RIGID {
            break;
        }
    }
    let cameras = [solution.state.cameras[0], solution.state.cameras[1]];
    let between = solution.state.between;
    let rectification = Rectification::new(&cameras, &between, size, crop)?;
    let noise = corner_variance(&solution, &chosen, shift_cost);
    let uncertainty = Uncertainty::new(&solution, lens, noise, size).ok_or(CalibrationError::Undetermined)?;
    let (stretch, stretch_sigma) = stretch(&points, &chosen, lens, shift_cost, &solution);

    // Views that were left out are shown as the final cameras see them.
    let mut boards = vec![Pose::identity(); all.len()];
    for (&i, pose) in used.iter().zip(&solution.state.boards) {
        boards[i] = *pose;
    }
    for i in (0..all.len()).filter(|i| !used.contains(i)) {
        boards[i] = start::board_pose(&points, &all[i], &cameras[0]).ok_or(CalibrationError::Undetermined)?;
    }
    let whole = State { boards, shifts: vec![Vector2::zeros(); all.len()], ..solution.state.clone() };
    let free = Free { lens, cameras: false, stretch: false, bend: false };
    let rigid = Problem { board: &points, views: &all, free, huber_px: HUBER_PX, shift_cost: RIGID };
    let loose = Problem { shift_cost: 1e-3, ..rigid };
    let mut reports = Vec::with_capacity(all.len());
    for i in 0..all.len() {
        let mut report = view_report(&rigid, &loose, &whole, i, &rectification, &cameras);
        report.fault = faults[i];
        report.moved = matches!(report.fault, Some(ViewFault::Shifted(_)));
        report.rejected = std::mem::take(&mut rejected[i]);
        reports.push(report);
    }
    // A view that is used has pulled the cameras its way.
    let free = Free { lens, cameras: true, stretch: false, bend: chosen.len() >= MIN_VIEWS_TO_BEND };
    let problem = Problem { board: &points, views: &chosen, free, huber_px: f64::INFINITY, shift_cost };
    for (&i, offset) in used.iter().zip(offsets(&problem, &solution, noise)) {
        reports[i].shift_px = offset.shift_px;
        reports[i].moved = offset.shift_px.amax() > MOVED_PX && offset.deviations() > VIEW_CERTAINTY;
    }
    let (mut sums, mut count, mut vertical) = ([0.0; 2], 0, (0.0, 0));
    for &i in &used {
        let report = &reports[i];
        let counted = |k: usize| !report.rejected.iter().any(|r| r.1 == k);
        for k in (0..points.len()).filter(|&k| counted(k)) {
            for side in 0..2 {
                sums[side] += report.residuals_px[side][k].norm_squared();
            }
            vertical.0 += report.vertical_px[k].abs();
            vertical.1 += 1;
            count += 1;
        }
    }
    let n = f64::from(count.max(1));
    let spread = |axis: usize| {
        let whole = reports.iter().filter(|r| !matches!(r.fault, Some(ViewFault::Misfit(_))));
        let mut sizes: Vec<f64> = whole.map(|r| r.shift_px[axis].abs()).collect();
        sizes.sort_unstable_by(f64::total_cmp);
        1.4826 * sizes[sizes.len() / 2]
    };
    let shift_sigma_px = Vector2::new(spread(0), spread(1));
    let (halves, vertical_heldout_px) = held_out(&chosen, &solution.state, size, &|views, state| {
        solved(views, state, shift_cost, f64::INFINITY).ok()
    });
    Ok(StereoCalibration {
        cameras,
        lens,
        between,
        shape: Shape { stretch, ..solution.state.shape },
        board_reach_m: points.iter().map(|p| p.norm()).fold(0.0, f64::max),
        stretch_sigma,
        uncertainty,
        rectification,
        rms_px: ((sums[0] + sums[1]) / (2.0 * n)).sqrt(),
        rms_sides_px: sums.map(|s| (s / n).sqrt()),
        shift_sigma_px,
        vertical_mean_px: vertical.0 / f64::from(vertical.1.max(1)),
        vertical_heldout_px,
        halves,
        coverage: [0, 1].map(|side| coverage(&chosen, side, size)),
        views: reports,
    })
}

/// Variance of a coordinate of a corner, in px².
fn corner_variance(solution: &Solution, views: &[View], shift_cost: f64) -> f64 {
    let shifts = solution.state.shifts.iter().map(Vector2::norm_squared).sum::<f64>() * shift_cost;
    let seen: usize = views.iter().flat_map(|v| &v.corners).flatten().flatten().count();
    let globals = solution.shares.first().map_or(0, |s| s.gradient.len());
    let free = (2 * seen).saturating_sub(globals + 8 * views.len()).max(1);
    (solution.cost - if shift_cost < RIGID { shifts } else { 0.0 }).max(1e-12) / free as f64
}

/// Takes out corners that contradict all others; whether there were any.
fn reject_corners(
    problem: &Problem<'_>,
    state: &State,
    used: &[usize],
    views: &mut [View],
    rejected: &mut [Vec<(usize, usize)>],
) -> bool {
    let residuals: Vec<_> = (0..used.len())
        .map(|v| {
            let mut r = problem.residuals(state, v);
            // The view's own shift is no fault of its corners.
            r[1].iter_mut().flatten().for_each(|r| *r -= state.shifts[v]);
            r
        })
        .collect();
    let mut sizes: Vec<f64> = residuals.iter().flatten().flatten().flatten().map(Vector2::norm).collect();
    if sizes.is_empty() {
        return false;
    }
    sizes.sort_unstable_by(f64::total_cmp);
    // The median of the length of a vector of two normal numbers is 1.1774 deviations.
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

/// Which of the views contradict the others. `scatter` is the robust deviation of the views' shifts;
/// it does not shrink when views are left out, so that this comes to an end.
fn view_faults(problem: &Problem<'_>, solution: &Solution, scatter: &mut [f64; 2]) -> Vec<Option<ViewFault>> {
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
    // While some do not fit at all the shifts of the others mean little.
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
    // One bad view makes others look bad: the worst go first, those that are shifted nearly one by one.
    let most = if misfits.iter().any(|m| *m > misfit_limit) { n / 6 } else { n / 20 };
    found.sort_unstable_by(|a, b| b.0.total_cmp(&a.0));
    let mut faults = vec![None; n];
    for (_, v, fault) in found.into_iter().take(most.max(1)) {
        faults[v] = Some(fault);
    }
    faults
}

/// The board's stretch, estimated beside everything else, and its standard deviation.
fn stretch(
    points: &[Vector2<f64>],
    views: &[View],
    lens: Lens,
    shift_cost: f64,
    solution: &Solution,
) -> (f64, f64) {
    // A board's bend and stretch look alike in a few views.
    let bend = views.len() >= MIN_VIEWS_TO_BEND;
    let free = Free { lens, cameras: true, stretch: true, bend };
    let problem = Problem { board: points, views, free, huber_px: f64::INFINITY, shift_cost };
    let open = (1.0, f64::INFINITY);
    let Some(freed) = problem.solve(solution.state.clone()) else { return open };
    let Some(all) = Uncertainty::covariance(&freed, corner_variance(&freed, views, shift_cost)) else {
        return open;
    };
    let place = 2 * lens.parameters() + 6;
    (freed.state.shape.stretch, all[(place, place)].sqrt())
}

fn view_report(
    rigid: &Problem<'_>,
    loose: &Problem<'_>,
    state: &State,
    view: usize,
    rectification: &Rectification,
    cameras: &[Camera; 2],
) -> ViewReport {
    let mut own = state.clone();
    let shift_px = loose.pose_of(&own, view, own.boards[view]).map_or(Vector2::zeros(), |(_, s)| s);
    if let Some((pose, _)) = rigid.pose_of(&own, view, own.boards[view]) {
        own.boards[view] = pose;
    }
    let far = Vector2::repeat(f64::NAN);
    let sides: Vec<Vec<Vector2<f64>>> = rigid
        .residuals(&own, view)
        .into_iter()
        .map(|s| s.into_iter().map(|r| r.unwrap_or(far)).collect())
        .collect();
    let rms = |r: &[Vector2<f64>]| {
        (r.iter().map(Vector2::norm_squared).sum::<f64>() / r.len().max(1) as f64).sqrt()
    };
    let corners = &rigid.views[view].corners;
    let row = |side: usize, k: usize| {
        corners[side][k].and_then(|p| rectification.rectified(cameras, side, p)).map_or(f64::NAN, |p| p.y)
    };
    let pose = own.boards[view];
    let axis = pose.rotation * Vector3::z();
    ViewReport {
        fault: None,
        moved: false,
        rms_px: [rms(&sides[0]), rms(&sides[1])],
        shift_px,
        rejected: Vec::new(),
        vertical_px: (0..rigid.board.len()).map(|k| row(0, k) - row(1, k)).collect(),
        residuals_px: [sides[0].clone(), sides[1].clone()],
        tilt_rad: axis.x.hypot(axis.y).atan2(axis.z.abs()),
        tilt_direction_rad: (axis.y * axis.z.signum()).atan2(axis.x * axis.z.signum()),
        distance_m: pose.translation_m.norm(),
    }
}

type Halves = [([Camera; 2], Pose); 2];

/// Cameras from each half of the views, and the mean vertical error of the other half under them.
fn held_out(
    views: &[View],
    state: &State,
    size: (usize, usize),
    solve: &dyn Fn(&[View], State) -> Option<Solution>,
) -> (Option<Halves>, Option<f64>) {
    if views.len() < 8 {
        return (None, None);
    }
    let (mut sum, mut count) = (0.0, 0);
    let mut halves = Vec::new();
    for half in 0..2 {
        let own: Vec<usize> = (0..views.len()).filter(|i| i % 2 == half).collect();
        let chosen: Vec<View> = own.iter().map(|&i| views[i].clone()).collect();
        let start = State {
            boards: own.iter().map(|&i| state.boards[i]).collect(),
            shifts: own.iter().map(|&i| state.shifts[i]).collect(),
            ..state.clone()
        };
        let Some(solution) = solve(&chosen, start) else { return (None, None) };
        let cameras = [solution.state.cameras[0], solution.state.cameras[1]];
        let between = solution.state.between;
        let Ok(rectification) = Rectification::new(&cameras, &between, size, Crop::Valid) else {
            return (None, None);
        };
        for view in views.iter().enumerate().filter(|(i, _)| i % 2 != half).map(|(_, v)| v) {
            for (left, right) in view.corners[0].iter().zip(&view.corners[1]) {
                let (Some(left), Some(right)) = (left, right) else { continue };
                let rows = [(0, left), (1, right)].map(|(s, p)| rectification.rectified(&cameras, s, *p));
                if let [Some(l), Some(r)] = rows {
                    sum += (l.y - r.y).abs();
                    count += 1;
                }
            }
        }
        halves.push((cameras, between));
    }
    let halves = <[_; 2]>::try_from(halves).ok();
    (halves, (count > 0).then(|| sum / f64::from(count)))
}

/// Share of an 8 × 6 grid over the picture in which corners were seen.
fn coverage(views: &[View], side: usize, size: (usize, usize)) -> f64 {
    let mut cells = [false; 48];
    for corner in views.iter().flat_map(|v| &v.corners[side]).flatten() {
        let cell =
            |v: f64, size: usize, n: usize| ((v * n as f64 / size as f64).max(0.0) as usize).min(n - 1);
        cells[cell(corner.y, size.1, 6) * 8 + cell(corner.x, size.0, 8)] = true;
    }
    cells.iter().filter(|c| **c).count() as f64 / 48.0
}
