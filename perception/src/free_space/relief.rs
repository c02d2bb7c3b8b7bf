//! What stands before a boundary: stixels that are within the error of the boundary one by one, but together are not.

use super::boundary::Meeting;
use super::curve::RayStixel;
use super::limits::{RELIEF_M, RELIEF_SIGMAS};

/// How far the stixels of some strips stand before a boundary, across it.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Relief {
    /// Sum over the rows, in metres, and their number.
    sum_m: f64,
    rows: f64,
    /// Sum of the variances of the strips, in m², and their number.
    variance_m2: f64,
    strips: f64,
}

impl Relief {
    /// Of the stixels of a strip at a boundary, each with its number of rows.
    pub fn of(stixels: impl Iterator<Item = (RayStixel, u16)>, boundary: &Meeting) -> Self {
        // An inverse distance that is off by Δw is off by this many times as many metres across the boundary.
        let across_m2 = boundary.line_m * boundary.distance_m;
        stixels.fold(Self::default(), |sum, (ray, rows)| Self {
            sum_m: sum.sum_m + f64::from(rows) * (ray.inverse_m - 1.0 / boundary.distance_m) * across_m2,
            rows: sum.rows + f64::from(rows),
            variance_m2: (ray.sigma * across_m2).powi(2),
            strips: 1.0,
        })
    }

    /// Of several strips together.
    pub fn sum(strips: &[Self]) -> Self {
        strips.iter().fold(Self::default(), |a, b| Self {
            sum_m: a.sum_m + b.sum_m,
            rows: a.rows + b.rows,
            variance_m2: a.variance_m2 + b.variance_m2,
            strips: a.strips + b.strips,
        })
    }

    /// Whether something stands before the boundary: more than its roughness and the noise explain.
    pub fn stands_before(&self) -> bool {
        if self.rows == 0.0 {
            return false;
        }
        let mean_m = self.sum_m / self.rows;
        mean_m > RELIEF_M && mean_m * self.strips > RELIEF_SIGMAS * self.variance_m2.sqrt()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Of five strips beside a wall 5 m to the right, seen 15 m ahead, the stixels of which are this much nearer across it.
    fn relief(before_m: f64, sigma: f64) -> Relief {
        let wall = Meeting { distance_m: 15.0, height_m: 3.0, sigma_m: 0.05, line_m: 5.0, is_oblique: true };
        let ray = RayStixel { inverse_m: 1.0 / 15.0 + before_m / (5.0 * 15.0), sigma };
        Relief::sum(&[Relief::of([(ray, 40), (ray, 20)].into_iter(), &wall); 5])
    }

    #[test]
    fn a_person_stands_before_a_wall_and_a_window_frame_does_not() {
        assert!(relief(0.5, 0.001).stands_before());
        assert!(!relief(0.15, 0.0001).stands_before(), "its roughness");
        assert!(!relief(-0.5, 0.001).stands_before(), "behind it");
        assert!(!relief(0.5, 0.02).stands_before(), "noise");
        assert!(!Relief::sum(&[Relief::default(); 5]).stands_before(), "nothing is seen");
    }
}
