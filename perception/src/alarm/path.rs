//! Whether an obstacle is in the vehicle's way.
//!
//! The way is a straight strip before the vehicle: neither its yaw nor the road's bend is known. What a
//! turning vehicle sees moves sideways by itself, and a place drawn on along a straight line is then off
//! by up to a half. So both are asked, all of the movement and half of it, and only what both say counts:
//! an obstacle in the strip stays in the way unless both say that it will have left, one beside it
//! counts only when both say that it will have come.

/// An obstacle's place and movement across the view, in metres right of the vehicle's axis.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Course {
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
pub enum Place {
    /// In the path.
    In,
    /// In the path, and gone from it by the time that the vehicle is there.
    Leaving,
    /// Not in the path, but in it by then.
    Coming,
    /// Beside it.
    Beside,
}

impl Place {
    /// Whether the vehicle would meet it.
    pub fn is_in_the_way(self) -> bool {
        matches!(self, Self::In | Self::Coming)
    }
}

/// Movement is believed as far as it exceeds this many of its standard deviations.
const SURE_SIGMAS: f64 = 2.0;

/// Nothing is foreseen farther than this, in seconds.
const FORESIGHT_S: f64 = 3.0;

impl Course {
    /// Where it is for a vehicle with a path `path_width_m` wide that is there in `arrival_s` seconds;
    /// `None` when it does not come nearer.
    pub fn place(&self, path_width_m: f64, arrival_s: Option<f64>) -> Place {
        let reach = (path_width_m + self.width_m) / 2.0;
        let is_in = |lateral_m: f64| lateral_m.abs() < reach;
        let now = is_in(self.lateral_m);
        let sure = (self.speed_m_s.abs() - SURE_SIGMAS * self.speed_sigma_m_s).max(0.0);
        let way_m = sure.copysign(self.speed_m_s) * arrival_s.unwrap_or(0.0).min(FORESIGHT_S);
        let then = [self.lateral_m + way_m, self.lateral_m + way_m / 2.0].map(is_in);
        match (now, then) {
            (true, [false, false]) => Place::Leaving,
            (true, _) => Place::In,
            (false, [true, true]) => Place::Coming,
            (false, _) => Place::Beside,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn course(lateral_m: f64, speed_m_s: f64) -> Course {
        Course { lateral_m, speed_m_s, speed_sigma_m_s: 0.1, width_m: 1.8 }
    }

    #[test]
    fn a_place_counts_the_whole_width() {
        // A car 1.8 m wide touches a path 2.4 m wide from 2.1 m on.
        for (lateral, expected) in
            [(0.0, Place::In), (2.0, Place::In), (-2.2, Place::Beside), (3.5, Place::Beside)]
        {
            assert_eq!(course(lateral, 0.0).place(2.4, Some(2.0)), expected, "{lateral} m");
        }
        assert!(Place::In.is_in_the_way() && !Place::Leaving.is_in_the_way());
    }

    #[test]
    fn what_will_have_left_does_not_count_and_what_comes_does() {
        // Cuts out to the right with 2 m/s: after 3 s even half of that is out of the path.
        assert_eq!(course(1.0, 2.0).place(2.4, Some(3.0)), Place::Leaving);
        assert_eq!(course(1.0, 2.0).place(2.4, Some(0.5)), Place::In);
        assert_eq!(course(1.0, 2.0).place(2.4, None), Place::In, "never met: where it is counts");
        // A walker from the left, reached in 2.5 s.
        let walker = Course { width_m: 0.6, ..course(-2.5, 1.6) };
        assert_eq!(walker.place(2.4, Some(2.5)), Place::Coming);
        assert_eq!(walker.place(2.4, Some(0.3)), Place::Beside);
        // Crosses from one side of the path to the other: half the way is in it.
        assert_eq!(Course { width_m: 0.6, ..course(-1.0, 1.6) }.place(2.4, Some(2.5)), Place::In);
    }

    #[test]
    fn an_unsure_movement_changes_nothing() {
        let unsure = Course { speed_sigma_m_s: 1.5, ..course(1.0, 2.0) };
        assert_eq!(unsure.place(2.4, Some(3.0)), Place::In);
        let unsure = Course { speed_sigma_m_s: 1.5, ..course(-4.0, 2.0) };
        assert_eq!(unsure.place(2.4, Some(2.0)), Place::Beside);
    }

    #[test]
    fn a_bend_brings_nothing_into_the_path() {
        // A post 4 m left of a road with a radius of 110 m, on either side, seen by a vehicle at 10 m/s.
        for bend in [-1.0 / 110.0, 1.0 / 110.0] {
            for z in [35.0, 28.0, 20.0, 10.0] {
                let lateral_m = -4.0 + bend * z * z / 2.0;
                let speed_m_s = -bend * z * 10.0;
                let post = Course { lateral_m, speed_m_s, speed_sigma_m_s: 0.3, width_m: 0.3 };
                assert!(!post.place(2.4, Some(z / 10.0)).is_in_the_way(), "{bend} {z}: {post:?}");
            }
        }
    }
}
