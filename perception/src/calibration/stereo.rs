//! Calibration of a camera pair from corners: selection of views, bundle adjustment, rectification and quality
//! figures.

use super::board::Board;
use super::bundle::{Free, HUBER_PX, Problem, RIGID, Shape, Solution, State, View};
use super::camera::{Camera, Lens};
use super::grid::Places;
use super::pose::Pose;
use super::prediction::offsets;
use super::projection::ProjectionUncertainty;
use super::rectification::{Crop, Rectification, RectificationError};
use super::rejection::{VIEW_CERTAINTY, corner_variance, reject_corners, view_faults};
use super::start;
use super::uncertainty::Uncertainty;
use nalgebra::{Vector2, Vector3};
use thiserror::Error;

pub use super::rejection::{MOVED_PX, ViewFault};

/// Minimum number of views of a calibration.
pub const MIN_VIEWS: usize = 4;
/// Minimum number of views for estimating the bend of the board.
const MIN_VIEWS_TO_BEND: usize = 8;
/// Corners of a view that must not be rejected in either image.
const MIN_CORNERS_LEFT: usize = 6;
/// Ratio of corner variance to shift variance above which shifts are disabled.
const RIGID_RATIO: f64 = 20.0;

/// The corners of a board in both images of a pair, in the board's order, in pixels; `None` where an image does not show them.
#[derive(Clone, Debug, PartialEq)]
pub struct Pair {
    /// In the left image.
    pub left: Places,
    /// In the right image.
    pub right: Places,
}

/// Errors of [`calibrate`].
#[derive(Clone, Copy, Debug, Error, PartialEq)]
pub enum CalibrationError {
    /// Too few views.
    #[error("{given} pairs show the board, at least {MIN_VIEWS} are needed (10 to 30 are good)")]
    TooFew {
        /// Number of views given, or left after rejection.
        given: usize,
    },
    /// The problem has no unique solution.
    #[error(
        "the views do not determine the cameras because they are too similar: tilt the board by 20 to 45 degrees in all directions, near and far"
    )]
    Undetermined,
    /// The cameras cannot be rectified.
    #[error(transparent)]
    Rectification(#[from] RectificationError),
}

/// Results for one view.
#[derive(Clone, Debug)]
pub struct ViewReport {
    /// Why it was rejected; `None` if it was used.
    pub fault: Option<ViewFault>,
    /// Root mean square residual in the left and the right image, with one board pose for both, in pixels.
    pub rms_px: [f64; 2],
    /// Offset of the board in the right image relative to the prediction from all other used views, in pixels.
    pub shift_px: Vector2<f64>,
    /// Whether that offset exceeds [`MOVED_PX`] horizontally or vertically and is significant.
    pub moved: bool,
    /// Rejected corners: side and index.
    pub rejected: Vec<(usize, usize)>,
    /// Observed minus projected corners for both images, in pixels; `None` where an image does not show them.
    pub residuals_px: [Places; 2],
    /// Row in the left minus row in the right rectified image for each corner, in pixels; `None` where one of the images does not
    /// show it.
    pub vertical_px: Vec<Option<f64>>,
    /// Angle between the normal of the board and the optical axis of the left camera, in radians.
    pub tilt_rad: f64,
    /// Direction of the tilt: direction of the board's normal in the image, in radians.
    pub tilt_direction_rad: f64,
    /// Distance of the board's centre from the left camera, in metres.
    pub distance_m: f64,
}

/// A calibrated camera pair.
#[derive(Clone, Debug)]
pub struct StereoCalibration {
    /// Left and right camera.
    pub cameras: [Camera; 2],
    /// The distortion model.
    pub lens: Lens,
    /// Transformation from the left to the right camera's coordinates.
    pub between: Pose,
    /// The shape of the board. The stretch is estimated separately and does not affect the cameras.
    pub shape: Shape,
    /// Half the diagonal of the board, in metres.
    pub board_reach_m: f64,
    /// Standard deviation of the stretch.
    pub stretch_sigma: f64,
    /// Standard deviations of the parameters.
    pub uncertainty: Uncertainty,
    /// Uncertainty of where the cameras see a point.
    pub projection: ProjectionUncertainty,
    /// The same if the errors of all corners were independent, as other programs state it.
    pub independent: ProjectionUncertainty,
    /// Standard deviation of a corner's coordinate, in pixels.
    pub corner_sigma_px: f64,
    /// The rectified pair.
    pub rectification: Rectification,
    /// Root mean square reprojection error over the used views, with one board pose for both images, in pixels.
    pub rms_px: f64,
    /// The same for the left and the right images separately.
    pub rms_sides_px: [f64; 2],
    /// Robust standard deviation of the boards' offsets in the right image, horizontally and vertically, over all
    /// views without misfit, in pixels.
    pub shift_sigma_px: Vector2<f64>,
    /// Mean absolute vertical error of rectified corners over the used views, in pixels.
    pub vertical_mean_px: f64,
    /// The same on held-out views (two-fold cross-validation): each half of the views is tested with the cameras
    /// from the other half. `None` with fewer than 8 views.
    pub vertical_heldout_px: Option<f64>,
    /// Cameras and their relative pose from the even and from the odd views.
    pub halves: Option<[([Camera; 2], Pose); 2]>,
    /// Results for all views, in their order.
    pub views: Vec<ViewReport>,
    /// Share of the cells of an 8 × 6 grid over each image that contain corners.
    pub coverage: [f64; 2],
}

/// Calibrates two cameras from images of one board; `size` is the width and height of the images in pixels.
///
/// # Errors
/// If there are too few views, they do not determine the cameras, or the pair cannot be rectified.
pub fn calibrate(
    board: &Board,
    size: (usize, usize),
    pairs: &[Pair],
    lens: Lens,
    crop: Crop,
) -> Result<StereoCalibration, CalibrationError> {
    solve(board, size, pairs, lens, crop, Model { selective: true, is_rigid: false })
}

/// [`calibrate`] for cameras that expose at the same moment: the board has not moved between the pictures of a pair.
///
/// # Errors
/// As [`calibrate`].
pub fn calibrate_simultaneous(
    board: &Board,
    size: (usize, usize),
    pairs: &[Pair],
    lens: Lens,
    crop: Crop,
) -> Result<StereoCalibration, CalibrationError> {
    solve(board, size, pairs, lens, crop, Model { selective: true, is_rigid: true })
}

/// [`calibrate`] without rejection of views, for comparison with calibrations that use all views.
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
    solve(board, size, pairs, lens, crop, Model { selective: false, is_rigid: false })
}

/// What is assumed of the views.
#[derive(Clone, Copy)]
struct Model {
    /// Whether views that do not fit are left out.
    selective: bool,
    /// Whether the board rests between the two exposures of a pair.
    is_rigid: bool,
}

/// The used views with their estimate, and what was rejected.
struct Selection {
    /// Indices of the used views.
    used: Vec<usize>,
    /// All views, without rejected corners.
    views: Vec<View>,
    /// Why views were rejected; for all views.
    faults: Vec<Option<ViewFault>>,
    /// Rejected corners of all views: side and index.
    rejected: Vec<Vec<(usize, usize)>>,
    /// The estimate from the used views.
    state: State,
}

/// Bundle adjustment of both cameras, all poses and, with enough views, the bend of the board.
fn adjust(
    points: &[Vector2<f64>],
    lens: Lens,
    views: &[View],
    state: State,
    shift_cost: f64,
    huber_px: f64,
) -> Result<Solution, CalibrationError> {
    let free = Free { lens, cameras: true, stretch: false, bend: views.len() >= MIN_VIEWS_TO_BEND };
    let problem = Problem { board: points, views, free, huber_px, shift_cost };
    problem.solve(state).ok_or(CalibrationError::Undetermined)
}

/// Adjusts and rejects corners and, if the model is selective, views, until nothing more is rejected.
fn select(
    points: &[Vector2<f64>],
    mut views: Vec<View>,
    mut state: State,
    lens: Lens,
    model: Model,
) -> Result<Selection, CalibrationError> {
    let shift_cost = if model.is_rigid { RIGID } else { 1.0 };
    let mut used: Vec<usize> = (0..views.len()).collect();
    let mut faults: Vec<Option<ViewFault>> = vec![None; views.len()];
    let mut rejected = vec![Vec::new(); views.len()];
    let mut sigma = [0.0; 2];
    for _ in 0..12 {
        let chosen: Vec<View> = used.iter().map(|&i| views[i].clone()).collect();
        let solution = adjust(points, lens, &chosen, state, shift_cost, HUBER_PX)?;
        let free = Free { lens, cameras: true, stretch: false, bend: chosen.len() >= MIN_VIEWS_TO_BEND };
        let problem = Problem { board: points, views: &chosen, free, huber_px: HUBER_PX, shift_cost };
        let mut again = reject_corners(&problem, &solution.state, &used, &mut views, &mut rejected);
        let mut new_faults = if model.selective {
            view_faults(&problem, &solution, &mut sigma)
        } else {
            vec![None; chosen.len()]
        };
        // Of what is left of a view with most corners rejected no pose can be found.
        for (fault, &i) in new_faults.iter_mut().zip(&used) {
            let left = views[i].corners.iter().map(|side| side.iter().flatten().count()).min();
            if fault.is_none() && left < Some(MIN_CORNERS_LEFT) {
                *fault = Some(ViewFault::Misfit(f64::INFINITY));
            }
        }
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
    Ok(Selection { used, views, faults, rejected, state })
}

/// The final adjustment, with the weight of shifts estimated from the boards' motion between the exposures.
fn adjust_with_shifts(
    points: &[Vector2<f64>],
    lens: Lens,
    views: &[View],
    state: State,
) -> Result<(Solution, f64), CalibrationError> {
    let mut shift_cost = 1.0;
    let mut solution = adjust(points, lens, views, state, shift_cost, f64::INFINITY)?;
    for _ in 0..2 {
        let noise = corner_variance(&solution, views, shift_cost);
        let moved =
            solution.state.shifts.iter().map(Vector2::norm_squared).sum::<f64>() / (2 * views.len()) as f64;
        // Corners of one view have common errors, so the weight of shifts is at least 1.
        let cost = (noise / moved.max(1e-12)).max(1.0);
        shift_cost = if cost > RIGID_RATIO { RIGID } else { cost };
        solution = adjust(points, lens, views, solution.state, shift_cost, f64::INFINITY)?;
        if shift_cost == RIGID {
            break;
        }
    }
    Ok((solution, shift_cost))
}

/// Reports of all views, used or rejected, as the final cameras see them.
fn view_reports(
    points: &[Vector2<f64>],
    all: &[View],
    selection: &mut Selection,
    solution: &Solution,
    lens: Lens,
    rectification: &Rectification,
) -> Result<Vec<ViewReport>, CalibrationError> {
    let cameras = [solution.state.cameras[0], solution.state.cameras[1]];
    let used = &selection.used;
    let mut boards = vec![Pose::identity(); all.len()];
    for (&i, pose) in used.iter().zip(&solution.state.boards) {
        boards[i] = *pose;
    }
    for i in (0..all.len()).filter(|i| !used.contains(i)) {
        // Without a pose it has no residuals.
        boards[i] = start::board_pose(points, &all[i], &cameras[0]).unwrap_or_else(Pose::identity);
    }
    let whole = State { boards, shifts: vec![Vector2::zeros(); all.len()], ..solution.state.clone() };
    let free = Free { lens, cameras: false, stretch: false, bend: false };
    let rigid = Problem { board: points, views: all, free, huber_px: HUBER_PX, shift_cost: RIGID };
    let loose = Problem { shift_cost: 1e-3, ..rigid };
    let mut reports = Vec::with_capacity(all.len());
    for i in 0..all.len() {
        let mut report = view_report(&rigid, &loose, &whole, i, rectification, &cameras);
        report.fault = selection.faults[i];
        report.moved = matches!(report.fault, Some(ViewFault::Shifted(_)));
        report.rejected = std::mem::take(&mut selection.rejected[i]);
        reports.push(report);
    }
    Ok(reports)
}

/// Error figures over the used views.
struct Errors {
    /// See [`StereoCalibration::rms_px`].
    rms_px: f64,
    /// See [`StereoCalibration::rms_sides_px`].
    rms_sides_px: [f64; 2],
    /// See [`StereoCalibration::vertical_mean_px`].
    vertical_mean_px: f64,
}

fn errors(reports: &[ViewReport], used: &[usize], corners: usize) -> Errors {
    let (mut sums, mut counts, mut vertical) = ([0.0; 2], [0; 2], (0.0, 0));
    for &i in used {
        let report = &reports[i];
        let counted = |k: usize| !report.rejected.iter().any(|r| r.1 == k);
        for k in (0..corners).filter(|&k| counted(k)) {
            for side in 0..2 {
                if let Some(residual) = report.residuals_px[side][k] {
                    sums[side] += residual.norm_squared();
                    counts[side] += 1;
                }
            }
            if let Some(rows) = report.vertical_px[k] {
                vertical.0 += rows.abs();
                vertical.1 += 1;
            }
        }
    }
    let root = |sum: f64, count: i32| (sum / f64::from(count.max(1))).sqrt();
    Errors {
        rms_px: root(sums[0] + sums[1], counts[0] + counts[1]),
        rms_sides_px: [0, 1].map(|side| root(sums[side], counts[side])),
        vertical_mean_px: vertical.0 / f64::from(vertical.1.max(1)),
    }
}

fn solve(
    board: &Board,
    size: (usize, usize),
    pairs: &[Pair],
    lens: Lens,
    crop: Crop,
    model: Model,
) -> Result<StereoCalibration, CalibrationError> {
    if pairs.len() < MIN_VIEWS {
        return Err(CalibrationError::TooFew { given: pairs.len() });
    }
    let points = board.points_m();
    let all: Vec<View> =
        pairs.iter().map(|p| View { corners: vec![p.left.clone(), p.right.clone()] }).collect();
    let flat = start::solve(&points, &all, size, lens).ok_or(CalibrationError::Undetermined)?;
    let mut selection = select(&points, all.clone(), flat.state, lens, model)?;
    let chosen: Vec<View> = selection.used.iter().map(|&i| selection.views[i].clone()).collect();
    let state = selection.state.clone();
    let (solution, shift_cost) = if model.is_rigid {
        (adjust(&points, lens, &chosen, state, RIGID, f64::INFINITY)?, RIGID)
    } else {
        adjust_with_shifts(&points, lens, &chosen, state)?
    };
    let cameras = [solution.state.cameras[0], solution.state.cameras[1]];
    let between = solution.state.between;
    let rectification = Rectification::new(&cameras, &between, size, crop)?;
    let noise = corner_variance(&solution, &chosen, shift_cost);
    let covariance = Uncertainty::covariance(&solution, noise).ok_or(CalibrationError::Undetermined)?;
    let uncertainty = Uncertainty::new(&solution, &covariance, lens, size);
    let (stretch, stretch_sigma) = stretch(&points, &chosen, lens, shift_cost, &solution);

    let mut reports = view_reports(&points, &all, &mut selection, &solution, lens, &rectification)?;
    // A used view has influenced the cameras, so its offset is predicted from the others.
    let free = Free { lens, cameras: true, stretch: false, bend: chosen.len() >= MIN_VIEWS_TO_BEND };
    let problem = Problem { board: &points, views: &chosen, free, huber_px: f64::INFINITY, shift_cost };
    for (&i, offset) in selection.used.iter().zip(offsets(&problem, &solution, noise)) {
        reports[i].shift_px = offset.shift_px;
        reports[i].moved = offset.shift_px.amax() > MOVED_PX && offset.deviations() > VIEW_CERTAINTY;
    }
    let Errors { rms_px, rms_sides_px, vertical_mean_px } = errors(&reports, &selection.used, points.len());
    let spread = |axis: usize| {
        let whole = reports.iter().filter(|r| !matches!(r.fault, Some(ViewFault::Misfit(_))));
        let mut sizes: Vec<f64> = whole.map(|r| r.shift_px[axis].abs()).collect();
        sizes.sort_unstable_by(f64::total_cmp);
        1.4826 * sizes[sizes.len() / 2]
    };
    let shift_sigma_px = Vector2::new(spread(0), spread(1));
    let (halves, vertical_heldout_px) = held_out(&chosen, &solution.state, size, &|views, state| {
        adjust(&points, lens, views, state, shift_cost, f64::INFINITY).ok()
    });
    let projection = ProjectionUncertainty::new(&problem, &solution, covariance, noise)
        .ok_or(CalibrationError::Undetermined)?;
    let independent = Uncertainty::independent(&solution, noise).ok_or(CalibrationError::Undetermined)?;
    let independent = ProjectionUncertainty::new(&problem, &solution, independent, noise)
        .ok_or(CalibrationError::Undetermined)?;
    Ok(StereoCalibration {
        cameras,
        lens,
        between,
        shape: Shape { stretch, ..solution.state.shape },
        board_reach_m: points.iter().map(|p| p.norm()).fold(0.0, f64::max),
        stretch_sigma,
        uncertainty,
        projection,
        independent,
        corner_sigma_px: noise.sqrt(),
        rectification,
        rms_px,
        rms_sides_px,
        shift_sigma_px,
        vertical_mean_px,
        vertical_heldout_px,
        halves,
        coverage: [0, 1].map(|side| coverage(&chosen, side, size)),
        views: reports,
    })
}

/// The stretch of the board, estimated jointly with all other parameters, and its standard deviation.
fn stretch(
    points: &[Vector2<f64>],
    views: &[View],
    lens: Lens,
    shift_cost: f64,
    solution: &Solution,
) -> (f64, f64) {
    // With few views bend and stretch of a board cannot be separated.
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

/// Largest angle to the axis of the rectified camera, across or down, at which rows are compared, as its tangent: 50 degrees. Farther
/// out, where a fisheye lens still sees, rectified pixels are stretched, and errors of the corners with them.
const ROWS_TO: f64 = 1.192;

/// The rectified row of a corner; `None` where rows are not compared.
fn compared_row(
    rectification: &Rectification,
    cameras: &[Camera; 2],
    side: usize,
    corner: Vector2<f64>,
) -> Option<f64> {
    let (place, rig) = (rectification.rectified(cameras, side, corner)?, &rectification.rig);
    let from_axis = Vector2::new(place.x - rig.cx_px, place.y - rig.cy_px) / rig.focal_px;
    (from_axis.amax() <= ROWS_TO).then_some(place.y)
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
    let sides = rigid.residuals(&own, view);
    let rms = |r: &Places| {
        let seen = r.iter().flatten();
        (seen.clone().map(Vector2::norm_squared).sum::<f64>() / seen.count().max(1) as f64).sqrt()
    };
    let corners = &rigid.views[view].corners;
    let row =
        |side: usize, k: usize| corners[side][k].and_then(|p| compared_row(rectification, cameras, side, p));
    let pose = own.boards[view];
    let axis = pose.rotation * Vector3::z();
    ViewReport {
        fault: None,
        moved: false,
        rms_px: [rms(&sides[0]), rms(&sides[1])],
        shift_px,
        rejected: Vec::new(),
        vertical_px: (0..rigid.board.len()).map(|k| Some(row(0, k)? - row(1, k)?)).collect(),
        residuals_px: [sides[0].clone(), sides[1].clone()],
        tilt_rad: axis.x.hypot(axis.y).atan2(axis.z.abs()),
        tilt_direction_rad: (axis.y * axis.z.signum()).atan2(axis.x * axis.z.signum()),
        distance_m: pose.translation_m.norm(),
    }
}

type Halves = [([Camera; 2], Pose); 2];

/// Cameras from each half of the views, and the mean vertical error of the respective other half.
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
                let rows =
                    [(0, left), (1, right)].map(|(s, p)| compared_row(&rectification, &cameras, s, *p));
                if let [Some(l), Some(r)] = rows {
                    sum += (l - r).abs();
                    count += 1;
                }
            }
        }
        halves.push((cameras, between));
    }
    let halves = <[_; 2]>::try_from(halves).ok();
    (halves, (count > 0).then(|| sum / f64::from(count)))
}

/// Share of the cells of an 8 × 6 grid over the image that contain corners.
fn coverage(views: &[View], side: usize, size: (usize, usize)) -> f64 {
    let mut cells = [false; 48];
    for corner in views.iter().flat_map(|v| &v.corners[side]).flatten() {
        let cell =
            |v: f64, size: usize, n: usize| ((v * n as f64 / size as f64).max(0.0) as usize).min(n - 1);
        cells[cell(corner.y, size.1, 6) * 8 + cell(corner.x, size.0, 8)] = true;
    }
    cells.iter().filter(|c| **c).count() as f64 / 48.0
}
