//! The vehicle's path as the alarm sees it: in the record of a frame, and in pictures.

use crate::reporting::overlay::OverlayInput;
use crate::reporting::record::tidy;
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
    /// Right edge.
    pub right_m: Vec<[f64; 2]>,
}

/// Rounds the points of an edge to centimetres: strips are drawn, not computed with.
pub fn edge(points: impl Iterator<Item = [f64; 2]>) -> Vec<[f64; 2]> {
    points.map(|point| point.map(|metres| tidy((metres * 100.0).round() / 100.0))).collect()
}

/// Column and row of points on the road, where the road's profile has them: a place at a distance lies in the row whose
/// disparity belongs to it.
pub fn on_road(rig: &Rig, profile_px: &[f32], points: &[[f64; 2]]) -> Vec<(f64, f64)> {
    points
        .iter()
        .filter(|[_, z]| *z > 0.0)
        .filter_map(|&[x, z]| {
            let row = row_of(profile_px, rig.focal_px * rig.baseline_m / z)?;
            Some((rig.cx_px + rig.focal_px * x / z, row))
        })
        .collect()
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
    /// Both edges in the left image, where the road is seen: column, row.
    pub fn in_image(&self, input: &OverlayInput<'_>) -> [Vec<(f64, f64)>; 2] {
        [&self.left_m, &self.right_m].map(|points| on_road(&input.rig, input.profile_px, points))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const RIG: Rig = Rig { focal_px: 500.0, baseline_m: 0.2, cx_px: 320.0, cy_px: 200.0 };

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
        assert!(on_road(&RIG, &[], &points).is_empty() && on_road(&RIG, &[3.0; 9], &points).is_empty());
    }
}
