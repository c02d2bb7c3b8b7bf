//! The own path: what stands in it stays an obstacle, whatever it is part of.

use super::limits::PATH_MARGIN_M;
use crate::motion::body::Planar;
use crate::motion::planar::PlanarStep;

/// Least way between two frames from which a curvature is taken, in metres: at a crawl the yaw is noise.
const MIN_WAY_M: f64 = 0.1;

/// The strip ahead that the vehicle may drive through: straight on, or along the curvature of its last step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Corridor {
    half_m: f64,
    /// Curvature to the left, in 1/m.
    curvature_per_m: f64,
}

impl Corridor {
    /// For a path of this width, after a step.
    pub fn new(path_width_m: f64, step: Option<PlanarStep>) -> Self {
        let curvature = |step: PlanarStep| {
            let [right, ahead] = step.place([0.0, 0.0]);
            let way = right.hypot(ahead);
            if way >= MIN_WAY_M { step.yaw_rad() / way } else { 0.0 }
        };
        Self {
            half_m: path_width_m / 2.0 + PATH_MARGIN_M,
            curvature_per_m: step.map_or(0.0, curvature).clamp(-0.2, 0.2),
        }
    }

    /// Whether a place, in metres right and ahead of the camera, is in the strip.
    pub fn contains(&self, [right, ahead]: Planar) -> bool {
        let bent = right + self.curvature_per_m * ahead * ahead / 2.0;
        right.abs() < self.half_m || bent.abs() < self.half_m
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::motion::Motion;
    use crate::motion::body::Body;

    #[test]
    fn the_corridor_is_the_straight_way_and_the_bent_one() {
        let straight = Corridor::new(2.4, None);
        assert!(straight.contains([1.5, 30.0]) && !straight.contains([1.7, 30.0]));
        let motion = Motion { speed_m_s: 10.0, yaw_rate_rad_s: 0.5, ..Motion::default() };
        let body =
            Body { width_m: 1.8, front_m: 1.7, camera_right_m: 0.0, rear_axle_m: 0.0, camera_yaw_rad: 0.0 };
        let bent = Corridor::new(2.4, Some(PlanarStep::of(&motion, &body, 0.1)));
        // 0.05/m: 10 m ahead the path is 2.5 m to the left.
        assert!(bent.contains([-2.5, 10.0]) && bent.contains([0.0, 10.0]) && !bent.contains([2.5, 10.0]));
    }
}
