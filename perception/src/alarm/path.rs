//! Whether an obstacle is in the vehicle's way.
//!
//! The way is a straight strip before the vehicle: neither its yaw nor the road's bend is known. What a
//! turning vehicle sees moves sideways by itself, and a place drawn on along a straight line is then off
//! by up to a half. So both are asked, all of the movement and half of it, and only what both say counts:
//! an obstacle in the strip stays in the way unless both say that it will have left, one beside it
//! counts only when both say that it will have come.

/// An obstacle's place and movement across the view, in metres right of the vehicle's axis.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct LateralMotion {
    /// Its middle.
    pub lateral_m: f64,
    /// Speed to the right, in m/s.
    pub speed_m_s: f64,
    /// One standard deviation of the speed.
    pub speed_sigma_m_s: f64,
    /// Its width.
    pub width_m: f64,
}

/// Where an obstacle is, seen from the vehicle's path.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PathRelation {
    /// In the path.
    Inside,
    /// In the path, and gone from it by the time that the vehicle is there.
    Leaving,
    /// Not in the path, but in it by then.
    Entering,
    /// Outside it.
    Outside,
}

impl PathRelation {
    /// Whether the vehicle would meet it.
    pub fn is_in_the_way(self) -> bool {
        matches!(self, Self::Inside | Self::Entering)
    }
}

/// Movement is believed as far as it exceeds this many of its standard deviations.
const SIGNIFICANT_SIGMAS: f64 = 2.0;

/// Nothing is foreseen farther than this, in seconds.
const MAX_PREDICTION_S: f64 = 3.0;

impl LateralMotion {
    /// Where it is for a vehicle with a path `path_width_m` wide that is there in `arrival_s` seconds;
    /// `None` when it does not come nearer.
    pub fn path_relation(&self, path_width_m: f64, arrival_s: Option<f64>) -> PathRelation {
        let reach = (path_width_m + self.width_m) / 2.0;
        let is_inside = |lateral_m: f64| lateral_m.abs() < reach;
        let now = is_inside(self.lateral_m);
        let significant = (self.speed_m_s.abs() - SIGNIFICANT_SIGMAS * self.speed_sigma_m_s).max(0.0);
        let shift_m = significant.copysign(self.speed_m_s) * arrival_s.unwrap_or(0.0).min(MAX_PREDICTION_S);
        let then = [self.lateral_m + shift_m, self.lateral_m + shift_m / 2.0].map(is_inside);
        match (now, then) {
            (true, [false, false]) => PathRelation::Leaving,
            (true, _) => PathRelation::Inside,
            (false, [true, true]) => PathRelation::Entering,
            (false, _) => PathRelation::Outside,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn motion(lateral_m: f64, speed_m_s: f64) -> LateralMotion {
        LateralMotion { lateral_m, speed_m_s, speed_sigma_m_s: 0.1, width_m: 1.8 }
    }

    #[test]
    fn a_place_counts_the_whole_width() {
        // A car 1.8 m wide touches a path 2.4 m wide from 2.1 m on.
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
    fn what_will_have_left_does_not_count_and_what_comes_does() {
        // Cuts out to the right with 2 m/s: after 3 s even half of that is out of the path.
        assert_eq!(motion(1.0, 2.0).path_relation(2.4, Some(3.0)), PathRelation::Leaving);
        assert_eq!(motion(1.0, 2.0).path_relation(2.4, Some(0.5)), PathRelation::Inside);
        assert_eq!(
            motion(1.0, 2.0).path_relation(2.4, None),
            PathRelation::Inside,
            "never met: where it is counts"
        );
        // A walker from the left, reached in 2.5 s.
        let walker = LateralMotion { width_m: 0.6, ..motion(-2.5, 1.6) };
        assert_eq!(walker.path_relation(2.4, Some(2.5)), PathRelation::Entering);
        assert_eq!(walker.path_relation(2.4, Some(0.3)), PathRelation::Outside);
        // Crosses from one side of the path to the other: half the way is in it.
        assert_eq!(
            LateralMotion { width_m: 0.6, ..motion(-1.0, 1.6) }.path_relation(2.4, Some(2.5)),
            PathRelation::Inside
        );
    }

    #[test]
    fn an_unsure_movement_changes_nothing() {
        let unsure = LateralMotion { speed_sigma_m_s: 1.5, ..motion(1.0, 2.0) };
        assert_eq!(unsure.path_relation(2.4, Some(3.0)), PathRelation::Inside);
        let unsure = LateralMotion { speed_sigma_m_s: 1.5, ..motion(-4.0, 2.0) };
        assert_eq!(unsure.path_relation(2.4, Some(2.0)), PathRelation::Outside);
    }

    #[test]
    fn a_bend_brings_nothing_into_the_path() {
        // A post 4 m left of a road with a radius of 110 m, on either side, seen by a vehicle at 10 m/s.
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
