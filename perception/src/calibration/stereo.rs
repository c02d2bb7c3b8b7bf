//! Two cameras from the boards that both saw.

use super::bundle::{Free, Problem, Solution, State, View};
use super::camera::{Camera, Lens};
use super::homography;
use super::pose::{Pose, median};
use nalgebra::{Matrix3, Vector2};

/// Residuals above this many pixels count less while it is not known which corners are wrong.
const HUBER_PX: f64 = 0.7;

/// Two cameras before all boards, from nothing: homographies, the closed form, each camera alone,
/// both together.
pub fn solve(board: &[Vector2<f64>], views: &[View], size: (usize, usize), lens: Lens) -> Option<Solution> {
    let free = Free { lens, cameras: true, stretch: false };
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
        stretch: 1.0,
        boards: left.boards.clone(),
    };
    let robust = Problem { board, views, free, huber_px: HUBER_PX };
    robust.solve(state)
}

/// One camera before its boards.
fn alone(board: &[Vector2<f64>], views: &[View], size: (usize, usize), lens: Lens) -> Option<Solution> {
    let homographies: Vec<Matrix3<f64>> = views
        .iter()
        .map(|v| {
            let pairs = board.iter().zip(&v.corners[0]).filter_map(|(p, c)| Some((*p, (*c)?)));
            let (from, to): (Vec<_>, Vec<_>) = pairs.unzip();
            homography::fit(&from, &to)
        })
        .collect::<Option<_>>()?;
    let free = Free { lens, cameras: true, stretch: false };
    let problem = Problem { board, views, free, huber_px: HUBER_PX };
    let mut best: Option<Solution> = None;
    for camera in homography::starts(&homographies, size.0, size.1) {
        let Some(boards) = homographies.iter().map(|h| homography::pose(h, &camera)).collect() else {
            continue;
        };
        let start = State { cameras: vec![camera], between: Pose::identity(), stretch: 1.0, boards };
        if let Some(solution) = problem.solve(start)
            && sane(&solution.state.cameras[0], size)
            && best.as_ref().is_none_or(|b| solution.cost < b.cost)
        {
            best = Some(solution);
            // All starts lead to the same place nearly always: the first good one will do.
            let corners: usize = views.iter().map(|v| v.corners[0].len()).sum();
            if best.as_ref().is_some_and(|b| b.cost < corners as f64) {
                break;
            }
        }
    }
    best
}

fn sane(camera: &Camera, size: (usize, usize)) -> bool {
    let larger = size.0.max(size.1) as f64;
    camera.parameters().iter().all(|v| v.is_finite())
        && (0.1 * larger..50.0 * larger).contains(&camera.fx_px)
        && (0.1 * larger..50.0 * larger).contains(&camera.fy_px)
}
