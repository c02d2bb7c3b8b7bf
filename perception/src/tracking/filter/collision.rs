//! Time to collision: when the distance is 0, at constant closing speed or as the obstacle goes on braking.

use super::Estimate;
use super::estimate::{MIN_DISTANCE_M, VX, VZ, Z, slopes};
use crate::tracking::parameters::MAX_BRAKING_M_S2;

/// Seconds in which a distance is closed at this speed, which grows by `braking` m/s².
pub fn braking_seconds(distance_m: f64, closing_m_s: f64, braking_m_s2: f64) -> f64 {
    let root = (closing_m_s * closing_m_s + 2.0 * braking_m_s2.max(0.0) * distance_m).sqrt();
    // The form without the difference of two large numbers.
    2.0 * distance_m / (closing_m_s + root).max(1e-6)
}

/// Time to collision with its uncertainty.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TimeToCollision {
    /// Seconds until the distance is 0, at constant closing speed, or as the obstacle goes on braking.
    pub seconds: f64,
    /// Standard deviation, in seconds.
    pub sigma_s: f64,
}

impl TimeToCollision {
    /// By how much the closing speed must grow for this time at a distance, in m/s²; 0 if it need not.
    pub fn braking_m_s2(&self, distance_m: f64, closing_m_s: f64) -> f64 {
        let seconds = self.seconds.max(1e-3);
        (2.0 * (distance_m - closing_m_s * seconds) / (seconds * seconds)).clamp(0.0, MAX_BRAKING_M_S2)
    }
}

impl Estimate {
    /// Seconds until the distance is 0 if it goes on braking until it stands; `None` if it does not come to that.
    pub(super) fn seconds_to_collision(&self) -> Option<f64> {
        let (z, closing, braking) = (self.state[Z], self.closing_m_s(), self.braking_m_s2());
        if braking <= 0.0 {
            return (closing > 0.0).then(|| z / closing);
        }
        let seconds = braking_seconds(z, closing, braking);
        // What drives ahead stops, and does not come back. What does not drive ahead does not brake; while the own speed is unknown, speeds
        // are relative and tell nothing of that.
        let (ahead_m_s, is_over_ground) = (self.state[VZ], self.own_rate != [0.0; 2]);
        let stops_s = if ahead_m_s > 0.0 {
            ahead_m_s / braking
        } else if is_over_ground && ahead_m_s > -2.0 * self.sigma(VZ) {
            0.0
        } else {
            f64::INFINITY
        };
        if seconds <= stops_s {
            return Some(seconds);
        }
        let left_m = z - closing * stops_s - braking * stops_s * stops_s / 2.0;
        let then = closing + braking * stops_s;
        (then > 0.0).then(|| stops_s + left_m / then)
    }

    /// Time to collision; `None` if the obstacle does not approach significantly (two standard deviations). One that is known to
    /// brake goes on braking.
    pub fn time_to_collision(&self) -> Option<TimeToCollision> {
        let seconds = self.seconds_to_collision()?;
        let z = self.state[Z];
        // Mean until then.
        let closing = z / seconds.max(1e-6);
        if closing <= 2.0 * self.sigma(VZ) {
            return None;
        }
        // t = z/w with w = −ż: ∂t/∂z = 1/w, ∂t/∂ż = z/w².
        let slopes = slopes([(Z, 1.0 / closing), (VZ, z / (closing * closing))]);
        Some(TimeToCollision { seconds, sigma_s: self.spread(&slopes, 0.0).max(0.0).sqrt() })
    }

    /// Time to collision under the condition that the speed over ground is 0. The thing closes with the own speed, whose
    /// standard deviation is `own_sigma_m_s`; `None` if that is not significant (two standard deviations).
    pub fn standing_time_to_collision(&self, own_sigma_m_s: f64) -> Option<TimeToCollision> {
        let closing = self.own_closing_m_s();
        if closing <= 2.0 * own_sigma_m_s {
            return None;
        }
        // Conditional mean and variance of the distance.
        let speed = self.state.fixed_rows::<2>(VX);
        let with = self.p.fixed_view::<1, 2>(Z, VX);
        let gain = with * self.p.fixed_view::<2, 2>(VX, VX).try_inverse()?;
        let distance = (self.state[Z] - (gain * speed).x).max(MIN_DISTANCE_M);
        let known = (self.p[(Z, Z)] - (gain * with.transpose()).x).max(0.0);
        let seconds = distance / closing;
        let variance = known + (seconds * own_sigma_m_s).powi(2);
        Some(TimeToCollision { seconds, sigma_s: variance.sqrt() / closing })
    }
}
