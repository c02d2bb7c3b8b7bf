//! Start values: two cameras from corners alone, for refinement by least squares.

use super::bundle::{Free, HUBER_PX, Problem, RIGID, Shape, Solution, State, View};
use super::camera::{Camera, Distortion, Lens};
use super::homography;
use super::pose::{Pose, median};
use nalgebra::{Matrix3, Vector2};

/// Estimates two cameras from all views, assuming flat boards: homographies, closed form, each camera alone, both
/// together.
pub fn solve(board: &[Vector2<f64>], views: &[View], size: (usize, usize), lens: Lens) -> Option<Solution> {
    let free = Free { lens, cameras: true, stretch: false, bend: false };
    let mut sides = Vec::new();
    for side in 0..2 {
        let own: Vec<View> = views.iter().map(|v| View { corners: vec![v.corners[side].clone()] }).collect();
        sides.push(alone(board, &own, size, lens)?.state);
    }
    let (left, right) = (&sides[0], &sides[1]);
    let ways: Vec<Pose> = left.boards.iter().zip(&right.boards).map(|(l, r)| l.inverse().then(r)).collect();
    let state = State {
        cameras: vec![left.cameras[0], right.cameras[0]],
        between: median(&ways)?,
        boards: left.boards.clone(),
        ..left.clone()
    };
    Problem { board, views, free, huber_px: HUBER_PX, shift_cost: RIGID }.solve(state)
}

fn homography(board: &[Vector2<f64>], corners: &[Option<Vector2<f64>>]) -> Option<Matrix3<f64>> {
    let pairs = board.iter().zip(corners).filter_map(|(p, c)| Some((*p, (*c)?)));
    let (from, to): (Vec<_>, Vec<_>) = pairs.unzip();
    homography::fit(&from, &to)
}

/// The pose of a board relative to a known first camera, from its corners.
pub fn board_pose(board: &[Vector2<f64>], view: &View, camera: &Camera) -> Option<Pose> {
    let straight: Vec<_> = view.corners[0].iter().map(|c| c.and_then(|c| camera.undistort(c))).collect();
    let plain = Camera::pinhole(1.0, 1.0, 0.0, 0.0);
    homography::pose(&homography(board, &straight)?, &plain)
}

/// Half of the horizontal field of view of the fisheye lenses that are tried, in radians: 40 to 180 degrees in all.
const FISHEYE_HALF_ANGLES_RAD: [f64; 6] = [1.05, 0.8, 1.3, 0.6, 1.57, 0.35];

/// Cameras to begin with, each with the poses of the boards, the most likely first.
fn starts(
    board: &[Vector2<f64>],
    views: &[View],
    size: (usize, usize),
    lens: Lens,
) -> Option<Vec<(Camera, Vec<Pose>)>> {
    if lens == Lens::Fisheye {
        // Straight lines are bent too much for homographies from the pixels: equidistant lenses without further distortion.
        let (width, height) = (size.0 as f64, size.1 as f64);
        let cameras = FISHEYE_HALF_ANGLES_RAD.map(|half| {
            let focal = 0.5 * width / half;
            let plain = Camera::pinhole(focal, focal, 0.5 * (width - 1.0), 0.5 * (height - 1.0));
            Camera { distortion: Distortion::Equidistant([0.0; 4]), ..plain }
        });
        let with_poses = |camera: Camera| {
            Some((camera, views.iter().map(|v| board_pose(board, v, &camera)).collect::<Option<_>>()?))
        };
        return Some(cameras.into_iter().filter_map(with_poses).collect());
    }
    let homographies: Vec<Matrix3<f64>> =
        views.iter().map(|v| homography(board, &v.corners[0])).collect::<Option<_>>()?;
    let with_poses = |camera: Camera| {
        Some((camera, homographies.iter().map(|h| homography::pose(h, &camera)).collect::<Option<_>>()?))
    };
    Some(homography::starts(&homographies, size.0, size.1).into_iter().filter_map(with_poses).collect())
}

/// Estimates one camera from its views.
fn alone(board: &[Vector2<f64>], views: &[View], size: (usize, usize), lens: Lens) -> Option<Solution> {
    let free = Free { lens, cameras: true, stretch: false, bend: false };
    let problem = Problem { board, views, free, huber_px: HUBER_PX, shift_cost: RIGID };
    let corners = views.iter().flat_map(|v| &v.corners[0]).flatten().count();
    let mut best: Option<Solution> = None;
    for (camera, boards) in starts(board, views, size, lens)? {
        let start = State {
            cameras: vec![camera],
            between: Pose::identity(),
            shape: Shape::FLAT,
            boards,
            shifts: vec![Vector2::zeros(); views.len()],
        };
        if let Some(solution) = problem.solve(start)
            && is_plausible(&solution.state.cameras[0], size)
            && best.as_ref().is_none_or(|b| solution.cost < b.cost)
        {
            // Nearly always all start values converge to the same solution: stop at the first good one.
            let done = solution.cost < corners as f64;
            best = Some(solution);
            if done {
                break;
            }
        }
    }
    best
}

fn is_plausible(camera: &Camera, size: (usize, usize)) -> bool {
    let larger = size.0.max(size.1) as f64;
    let focal = 0.1 * larger..50.0 * larger;
    camera.parameters().iter().all(|v| v.is_finite())
        && focal.contains(&camera.fx_px)
        && focal.contains(&camera.fy_px)
}
