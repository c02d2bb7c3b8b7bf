//! Free space and boundaries in the record of a frame, and in pictures.

use crate::reporting::path::{finer, on_road};
use crate::reporting::tidy::tidy;
use perception::rig::Rig;
use serde::{Deserialize, Serialize};

/// A boundary beside the path: a wall, a hedge, a fence, a guard rail, the fronts of houses. Positions are right and forward
/// of the left camera, on the road.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct BoundaryLine {
    /// Number that it keeps as long as it is seen.
    pub id: u32,
    /// `left`, `right` or `across` the path.
    pub side: String,
    /// Points at its foot, from left to right as the camera sees them: right, forward.
    pub points_m: Vec<[f64; 2]>,
    /// Height above the road at each point.
    pub height_m: Vec<f64>,
    /// Standard deviation of the position across the boundary at each point.
    pub sigma_m: Vec<f64>,
}

/// Centimetres: what is drawn, and more than what is measured.
pub fn centimetres(metres: f64) -> f64 {
    tidy((metres * 100.0).round() / 100.0)
}

impl BoundaryLine {
    /// Foot and top in the left image, where the road is seen: column, row.
    pub fn in_image(&self, rig: &Rig, profile_px: &[f32]) -> [Vec<(f64, f64)>; 2] {
        let heights = self.points_m.iter().zip(&self.height_m);
        let mut lines: [Vec<(f64, f64)>; 2] = Default::default();
        for (point, height_m) in heights {
            for (x, y) in on_road(rig, profile_px, &[*point]) {
                lines[0].push((x, y));
                lines[1].push((x, y - rig.focal_px * height_m / point[1]));
            }
        }
        lines
    }
}

/// A polygon on the ground in the left image: column, row; empty if the road is not seen there.
pub fn polygon_in_image(rig: &Rig, profile_px: &[f32], corners_m: &[[f64; 2]]) -> Vec<(f64, f64)> {
    on_road(rig, profile_px, &finer(corners_m))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_boundary_stands_on_the_road_in_the_picture() {
        let rig = Rig { focal_px: 500.0, baseline_m: 0.2, cx_px: 320.0, cy_px: 200.0 };
        // The camera is 1 m above the road: a distance of 10 m lies in row 250.
        let profile: Vec<f32> = (0..480).map(|y| (0.2 * (y as f32 - 200.0)).max(0.0)).collect();
        let line = BoundaryLine {
            points_m: vec![[-2.0, 10.0], [-2.0, 20.0]],
            height_m: vec![1.0, 2.0],
            ..BoundaryLine::default()
        };
        let [foot, top] = line.in_image(&rig, &profile);
        let close = |a: (f64, f64), b: (f64, f64)| (a.0 - b.0).abs() < 0.1 && (a.1 - b.1).abs() < 0.1;
        assert!(close(foot[0], (220.0, 250.0)) && close(foot[1], (270.0, 225.0)), "{foot:?}");
        assert!(close(top[0], (220.0, 200.0)) && close(top[1], (270.0, 175.0)), "{top:?}");
    }
}
