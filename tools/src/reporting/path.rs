//! The vehicle's path as the alarm sees it: in the record of a frame, and in pictures.

use crate::reporting::tidy::tidy;
use perception::motion::path::SweptPath;
use perception::rig::Rig;
use serde::{Deserialize, Serialize};

/// The path of a frame. Curvature is positive to the left; positions are right and forward of the left camera, on the
/// road, from near to far.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct PathLine {
    /// Whether it follows from the vehicle's motion; else it is straight.
    pub known: bool,
    /// Curvature at the vehicle; `null` for a straight path.
    pub curvature_per_m: Option<f64>,
    /// Standard deviation of the curvature.
    pub curvature_sigma_per_m: Option<f64>,
    /// Left edge of the strip that the vehicle's body will sweep: right, forward.
    pub left_m: Vec<[f64; 2]>,
    /// Right edge, point by point beside those of the left one.
    pub right_m: Vec<[f64; 2]>,
    /// Standard deviation of the strip's position across at each of the points.
    pub sigma_m: Vec<f64>,
}

/// Time for which the path is drawn ahead of the vehicle's front, in seconds: by default a warning by time to collision looks less far ahead.
const LENGTH_S: f64 = 3.0;
/// Smallest and largest length, in metres: the bounds of a rig's range.
const LENGTHS_M: [f64; 2] = [60.0, 100.0];
/// Step between two points, in metres.
const STEP_M: f64 = 4.0;

/// Largest change of heading along the drawn path, in rad: a strip that turns back would cover itself.
const MAX_HEADING_RAD: f64 = 1.4;

/// Column and row of points on the road, where the road's profile has them: a place at a distance lies in the row whose
/// disparity belongs to it.
pub(super) fn on_road(rig: &Rig, profile_px: &[f32], points: &[[f64; 2]]) -> Vec<(f64, f64)> {
    points
        .iter()
        .filter(|[_, z]| *z > 0.0)
        .filter_map(|&[x, z]| {
            let row = row_of(profile_px, rig.focal_px * rig.baseline_m / z)?;
            Some((rig.cx_px + rig.focal_px * x / z, row))
        })
        .collect()
}

/// Six decimals: a curvature of 0.0001 is a radius of 10 km.
fn round(per_m: f64) -> f64 {
    if per_m.is_finite() { (per_m * 1e6).round() / 1e6 } else { 0.0 }
}

/// Row in which the road has a disparity, between two rows; `None` where no rows enclose it. The profile rises downwards,
/// and is 0 above the road.
fn row_of(profile_px: &[f32], disparity_px: f64) -> Option<f64> {
    let pair = profile_px.windows(2).enumerate().rev().find(|(_, pair)| {
        let (upper, lower) = (f64::from(pair[0]), f64::from(pair[1]));
        upper > 0.0 && upper <= disparity_px && disparity_px <= lower && upper < lower
    });
    let (row, pair) = pair?;
    let (upper, lower) = (f64::from(pair[0]), f64::from(pair[1]));
    Some(row as f64 + (disparity_px - upper) / (lower - upper))
}

impl PathLine {
    /// The strip that the body sweeps along a path, from its front on.
    pub fn new(path: &SweptPath, known: bool) -> Self {
        let front_m = path.body.rear_axle_m + path.body.front_m;
        let mut line = Self {
            known,
            curvature_per_m: known.then(|| round(path.curvature_per_m)),
            curvature_sigma_per_m: known.then(|| round(path.curvature_sigma_per_m)),
            ..Self::default()
        };
        let length_m = (LENGTH_S * path.speed_m_s).clamp(LENGTHS_M[0], LENGTHS_M[1]);
        for step in 0..=(length_m / STEP_M) as u32 {
            let arc_m = front_m + STEP_M * f64::from(step);
            let centre = path.along(path.place(arc_m, 0.0));
            if centre.heading_rad.abs() > MAX_HEADING_RAD {
                break;
            }
            let [left_m, right_m] = path.reach_m(arc_m);
            // Centimetres: strips are drawn, not computed with.
            let tidied =
                |offset_m: f64| path.place(arc_m, offset_m).map(|m| tidy((m * 100.0).round() / 100.0));
            line.left_m.push(tidied(-left_m));
            line.right_m.push(tidied(right_m));
            line.sigma_m.push(tidy((path.sigma_m(arc_m) * 100.0).round() / 100.0));
        }
        line
    }

    /// Both edges in the left image, where the road is seen: column, row. Between two points there are more, because a
    /// straight line on the road is not one in the picture of a road that bends or rises.
    pub fn in_image(&self, rig: &Rig, profile_px: &[f32]) -> [Vec<(f64, f64)>; 2] {
        [&self.left_m, &self.right_m].map(|points| on_road(rig, profile_px, &finer(points)))
    }
}

/// Parts of each step of an edge in a picture.
const PARTS: u32 = 4;

/// An edge with points between its points.
pub(super) fn finer(points: &[[f64; 2]]) -> Vec<[f64; 2]> {
    let between = |pair: &[[f64; 2]], part: u32| {
        let share = f64::from(part) / f64::from(PARTS);
        std::array::from_fn(|i| pair[0][i] + share * (pair[1][i] - pair[0][i]))
    };
    let inner = points.windows(2).flat_map(|pair| (0..PARTS).map(move |part| between(pair, part)));
    inner.chain(points.last().copied()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use perception::motion::body::Body;

    const RIG: Rig = Rig { focal_px: 500.0, baseline_m: 0.2, cx_px: 320.0, cy_px: 200.0 };

    fn path(curvature_per_m: f64) -> SweptPath {
        SweptPath {
            curvature_per_m,
            curvature_sigma_per_m: 0.001,
            speed_m_s: 10.0,
            speed_sigma_m_s: 0.1,
            body: Body {
                width_m: 1.8,
                front_m: 1.7,
                camera_right_m: 0.2,
                rear_axle_m: 1.6,
                camera_yaw_rad: 0.0,
            },
            edges: None,
            is_turning_in: false,
        }
    }

    #[test]
    fn a_strip_begins_at_the_front_and_follows_the_bend() {
        let straight = PathLine::new(&path(0.0), false);
        assert_eq!((straight.left_m[0], straight.right_m[0]), ([-1.1, 1.7], [0.7, 1.7]));
        assert_eq!((straight.left_m.len(), straight.left_m[15]), (16, [-1.1, 61.7]));
        assert_eq!((straight.known, straight.curvature_per_m), (false, None));
        let fast = PathLine::new(&SweptPath { speed_m_s: 30.0, ..path(0.0) }, true);
        assert_eq!(fast.left_m.last(), Some(&[-1.1, 89.7]));
        let left = PathLine::new(&path(0.02), true);
        assert_eq!(left.curvature_per_m, Some(0.02));
        // The outer edge, on the right, lies farther from the arc than the inner one.
        let (inner, outer) = (left.left_m[3], left.right_m[3]);
        assert!(inner[0] < outer[0] && outer[0] < 0.0 && inner[1] < outer[1], "{inner:?} {outer:?}");
        assert!(left.sigma_m.windows(2).all(|pair| pair[0] < pair[1]), "{:?}", left.sigma_m);
        // A U-turn ends before it covers itself.
        let turn = PathLine::new(&path(-0.2), true);
        assert!(turn.left_m.len() < 4 && turn.left_m.len() == turn.right_m.len(), "{turn:?}");
    }

    #[test]
    fn points_lie_in_the_rows_of_their_distances() {
        // A flat road 1.25 m below the camera: disparity = 0.16 px a row below the horizon in row 200.
        let profile: Vec<f32> =
            (0..480).map(|y| if y > 210 { (y - 200) as f32 * 0.16 } else { 0.0 }).collect();
        let points = [[1.0, 10.0], [-1.0, 20.0], [0.0, 60.0], [0.0, -1.0], [0.0, 0.5]];
        let drawn = on_road(&RIG, &profile, &points);
        // 60 m is above what is seen of the road, 0.5 m is below the picture.
        assert_eq!(drawn.len(), 2);
        for ((x, y), (u, v)) in drawn.into_iter().zip([(370.0, 262.5), (295.0, 231.25)]) {
            assert!((x - u).abs() < 1e-6 && (y - v).abs() < 1e-3, "{x} {y}");
        }
        // In pictures there are points between, and none beyond the last.
        let line = PathLine { left_m: vec![[1.0, 8.0], [1.0, 12.0]], ..PathLine::default() };
        let [left, right] = line.in_image(&RIG, &profile);
        assert_eq!((left.len(), right.len()), (5, 0));
        assert!(left[2].1 > left[3].1 && (left[2].0 - 370.0).abs() < 1e-6, "{left:?}");
        assert!(on_road(&RIG, &[], &points).is_empty() && on_road(&RIG, &[3.0; 9], &points).is_empty());
    }
}
