//! Whether an obstacle is in the path of the vehicle.
//!
//! The path is a straight strip ahead of the vehicle; its yaw rate and the curvature of the road are unknown.
//! In a turning vehicle, static objects appear to move sideways, and linear extrapolation overestimates their
//! displacement by up to a factor of two. Two predictions are therefore made, with the full and with half the
//! lateral movement, and both must agree: an obstacle in the path counts unless both predict that it will
//! have left, and one outside counts only if both predict that it will have entered.

/// Lateral position and motion of an obstacle, relative to the vehicle's axis.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct LateralMotion {
    /// Centre, in metres right of the axis.
    pub lateral_m: f64,
    /// Speed to the right, in m/s.
    pub speed_m_s: f64,
    /// Standard deviation of the speed, in m/s.
    pub speed_sigma_m_s: f64,
    /// Width, in metres.
    pub width_m: f64,
}

/// Relation of an obstacle to the path of the vehicle.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PathRelation {
    /// In the path.
    Inside,
    /// In the path now, but no longer when the vehicle arrives.
    Leaving,
    /// Not in the path now, but when the vehicle arrives.
    Entering,
    /// Outside the path.
    Outside,
}

impl PathRelation {
    /// Whether the vehicle would collide with the obstacle.
    pub fn is_in_the_way(self) -> bool {
        matches!(self, Self::Inside | Self::Entering)
    }
}

/// Lateral speed counts as far as it exceeds this many standard deviations.
const SIGNIFICANT_SIGMAS: f64 = 2.0;

/// Largest prediction time, in seconds.
const MAX_PREDICTION_S: f64 = 3.0;

impl LateralMotion {
    /// Relation to a path `path_width_m` metres wide for a vehicle that arrives in `arrival_s` seconds;
    /// `None` if the obstacle does not approach.
    pub fn path_relation(&self, path_width_m: f64, arrival_s: Option<f64>) -> PathRelation {
        let is_inside = |lateral_m: f64| self.gap_m(path_width_m, lateral_m) < 0.0;
        let now = is_inside(self.lateral_m);
        match (now, self.predictions(arrival_s).map(is_inside)) {
            (true, [false, false]) => PathRelation::Leaving,
            (true, _) => PathRelation::Inside,
            (false, [true, true]) => PathRelation::Entering,
            (false, _) => PathRelation::Outside,
        }
    }

    /// Gap to the path on arrival, in metres; negative if the obstacle overlaps it. That of the prediction that decides: in
    /// the path the one with the smaller gap, outside the one with the larger.
    pub fn clearance_m(&self, path_width_m: f64, arrival_s: Option<f64>) -> f64 {
        let [full, half] = self.predictions(arrival_s).map(|lateral_m| self.gap_m(path_width_m, lateral_m));
        if self.gap_m(path_width_m, self.lateral_m) < 0.0 { full.min(half) } else { full.max(half) }
    }

    /// Where its centre will be on arrival, with its full and with half its lateral movement.
    fn predictions(&self, arrival_s: Option<f64>) -> [f64; 2] {
        let significant = (self.speed_m_s.abs() - SIGNIFICANT_SIGMAS * self.speed_sigma_m_s).max(0.0);
        let shift_m = significant.copysign(self.speed_m_s) * arrival_s.unwrap_or(0.0).min(MAX_PREDICTION_S);
        [self.lateral_m + shift_m, self.lateral_m + shift_m / 2.0]
    }

    /// Gap to the path with its centre here, in metres.
    fn gap_m(&self, path_width_m: f64, lateral_m: f64) -> f64 {
        lateral_m.abs() - (path_width_m + self.width_m) / 2.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn motion(lateral_m: f64, speed_m_s: f64) -> LateralMotion {
        LateralMotion { lateral_m, speed_m_s, speed_sigma_m_s: 0.1, width_m: 1.8 }
    }

    #[test]
    fn the_full_width_of_an_obstacle_counts() {
        // A car 1.8 m wide touches a path 2.4 m wide at less than 2.1 m.
        for (lateral, expected) in [
            (0.0, PathRelation::Inside),
            (2.0, PathRelation::Inside),
            (-2.2, PathRelation::Outside),
            (3.5, PathRelation::Outside),
        ] {
            assert_eq!(motion(lateral, 0.0).path_relation(2.4, Some(2.0)), expected, "{lateral} m");
        }
        assert!(PathRelation::Inside.is_in_the_way() && !PathRelation::Leaving.is_in_the_way());
    }

    #[test]
    fn leaving_obstacles_are_ignored_and_entering_ones_count() {
        // Cuts out to the right with 2 m/s: after 3 s it has left the path even with half the movement.
        assert_eq!(motion(1.0, 2.0).path_relation(2.4, Some(3.0)), PathRelation::Leaving);
        assert_eq!(motion(1.0, 2.0).path_relation(2.4, Some(0.5)), PathRelation::Inside);
        assert_eq!(
            motion(1.0, 2.0).path_relation(2.4, None),
            PathRelation::Inside,
            "without an arrival time the current position counts"
        );
        // A pedestrian from the left, reached in 2.5 s.
        let walker = LateralMotion { width_m: 0.6, ..motion(-2.5, 1.6) };
        assert_eq!(walker.path_relation(2.4, Some(2.5)), PathRelation::Entering);
        assert_eq!(walker.path_relation(2.4, Some(0.3)), PathRelation::Outside);
        // Crosses from one side of the path to the other: with half the movement it is in the path.
        assert_eq!(
            LateralMotion { width_m: 0.6, ..motion(-1.0, 1.6) }.path_relation(2.4, Some(2.5)),
            PathRelation::Inside
        );
    }

    #[test]
    fn the_clearance_is_the_gap_of_the_prediction_that_decides() {
        let clearance = |motion: LateralMotion, arrival_s| motion.clearance_m(2.4, arrival_s);
        let near = |a: f64, b: f64| assert!((a - b).abs() < 1e-9, "{a}, not {b}");
        near(clearance(motion(-3.0, 0.0), None), 0.9);
        near(clearance(motion(0.5, 0.0), Some(2.0)), -1.6);
        // 1.8 m/s to the right count: inside, half of the movement in 1 s; outside, what has come less near.
        near(clearance(motion(1.0, 2.0), Some(1.0)), 1.9 - 2.1);
        near(clearance(motion(-4.0, 2.0), Some(1.0)), 3.1 - 2.1);
        for (lateral, speed, arrival_s) in
            [(1.0, 2.0, 3.0), (1.0, 2.0, 0.5), (-2.5, 1.6, 2.5), (4.0, 0.0, 1.0)]
        {
            let motion = motion(lateral, speed);
            let is_in_the_way = motion.path_relation(2.4, Some(arrival_s)).is_in_the_way();
            assert_eq!(clearance(motion, Some(arrival_s)) < 0.0, is_in_the_way, "{motion:?}");
        }
    }

    #[test]
    fn an_uncertain_speed_does_not_change_the_relation() {
        let unsure = LateralMotion { speed_sigma_m_s: 1.5, ..motion(1.0, 2.0) };
        assert_eq!(unsure.path_relation(2.4, Some(3.0)), PathRelation::Inside);
        let unsure = LateralMotion { speed_sigma_m_s: 1.5, ..motion(-4.0, 2.0) };
        assert_eq!(unsure.path_relation(2.4, Some(2.0)), PathRelation::Outside);
    }

    #[test]
    fn a_bend_moves_no_roadside_object_into_the_path() {
        // A post 4 m left of a road with a radius of 110 m, in either direction, seen from a vehicle at 10
        // m/s.
        for bend in [-1.0 / 110.0, 1.0 / 110.0] {
            for z in [35.0, 28.0, 20.0, 10.0] {
                let lateral_m = -4.0 + bend * z * z / 2.0;
                let speed_m_s = -bend * z * 10.0;
                let post = LateralMotion { lateral_m, speed_m_s, speed_sigma_m_s: 0.3, width_m: 0.3 };
                assert!(!post.path_relation(2.4, Some(z / 10.0)).is_in_the_way(), "{bend} {z}: {post:?}");
            }
        }
    }
}
