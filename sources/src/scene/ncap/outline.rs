//! Outlines of vehicles and people on the ground plane.

use crate::scene::plan::PlanPose;

/// A rectangle on the ground plane.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Outline {
    /// Its middle and the direction of its length.
    pub middle: PlanPose,
    /// Width and length, in metres.
    pub size_m: [f64; 2],
}

impl Outline {
    /// The rectangle that reaches from `back_m` to `front_m` ahead of a pose (negative behind it).
    pub fn about(pose: PlanPose, width_m: f64, (back_m, front_m): (f64, f64)) -> Self {
        let [x_m, z_m] = pose.point(0.0, 0.5 * (back_m + front_m));
        Self { middle: PlanPose { x_m, z_m, ..pose }, size_m: [width_m, front_m - back_m] }
    }

    /// Its corners as (x, z).
    pub fn corners(&self) -> [[f64; 2]; 4] {
        let [half_width, half_length] = self.size_m.map(|side| 0.5 * side);
        [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)]
            .map(|(x, z)| self.middle.point(x * half_width, z * half_length))
    }

    /// Whether two rectangles have a point in common, by the separating axis theorem.
    pub fn touches(&self, other: &Self) -> bool {
        let is_apart = |own: &Self, other: &Self| {
            let corners = other.corners().map(|corner| own.middle.local(corner));
            (0..2).any(|axis| {
                let half = 0.5 * own.size_m[axis];
                corners.iter().all(|c| c[axis] > half) || corners.iter().all(|c| c[axis] < -half)
            })
        };
        !is_apart(self, other) && !is_apart(other, self)
    }

    /// The least distance ahead of a pose, and the least and greatest distance to its right, in metres.
    pub fn seen_from(&self, pose: &PlanPose) -> (f64, (f64, f64)) {
        let corners = self.corners().map(|corner| pose.local(corner));
        let least = |axis: usize| corners.iter().map(|c| c[axis]).fold(f64::INFINITY, f64::min);
        let most = corners.iter().map(|c| c[0]).fold(f64::NEG_INFINITY, f64::max);
        (least(1), (least(0), most))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rectangles_touch_where_they_overlap() {
        let at = |x_m: f64, z_m: f64, heading_rad: f64| PlanPose { x_m, z_m, heading_rad };
        let car = Outline::about(at(0.0, 0.0, 0.0), 1.8, (-2.7, 1.7));
        let block = |x, z, heading| Outline::about(at(x, z, heading), 1.0, (0.0, 1.0));
        assert!(car.touches(&block(0.0, 1.69, 0.0)) && !car.touches(&block(0.0, 1.71, 0.0)));
        assert!(car.touches(&block(1.39, 0.0, 0.0)) && !car.touches(&block(1.41, 0.0, 0.0)));
        // A corner of a turned one: its middle is 0.707 m from each corner.
        let turned = std::f64::consts::FRAC_PI_4;
        let diagonal = |x: f64| Outline { middle: at(x, 0.0, turned), size_m: [1.0, 1.0] };
        assert!(car.touches(&diagonal(1.6)) && !car.touches(&diagonal(1.61)));
        assert_eq!(car.seen_from(&at(0.0, 0.0, 0.0)), (-2.7, (-0.9, 0.9)));
    }
}
