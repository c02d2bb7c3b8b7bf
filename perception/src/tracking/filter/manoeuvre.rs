//! Acceleration of a thing while it manoeuvres.
//!
//! A filter of variable dimension (Bar-Shalom and Birmingham, 1982): a thing has a constant speed until the innovations of its
//! distance are biased, that is, until it brakes or accelerates. From then on the acceleration is a state, correlated in time
//! (Singer, 1970): it decays within [`MANOEUVRE_TIME_S`], and what is not known of it is [`MANOEUVRE_SIGMA_M_S2`]. When it is
//! found, the manoeuvre has gone on for [`MANOEUVRE_LAG_S`]: place and speed are then wrong by what that acceleration has made
//! of them, and the covariances say so, so that the next measurements correct all three. When the acceleration is known to be
//! small again, or remains doubtful, the state is dropped.

use super::{AZ, TrackFilter, VZ, Z, slopes};
use crate::tracking::parameters::{
    MANOEUVRE_LAG_S, MANOEUVRE_SIGMA_M_S2, MANOEUVRE_TIME_S, MAX_BRAKING_M_S2, STEADY_M_S2,
};

impl TrackFilter {
    /// Begins or ends the estimation of the acceleration, as the innovations tell. Returns which share of it is kept after `t` seconds.
    pub(super) fn follow_manoeuvre(&mut self, t: f64) -> f64 {
        let kept = (-t / MANOEUVRE_TIME_S).exp();
        let Some(seconds) = self.manoeuvre_s else {
            // Where the speed is not known, it explains the innovations; and outliers are no acceleration.
            let lag_m_s = MANOEUVRE_LAG_S * MANOEUVRE_SIGMA_M_S2;
            let is_known = self.p[(VZ, VZ)] < lag_m_s * lag_m_s && !self.along.is_outlier();
            if self.along.are_biased() && is_known {
                self.begin_manoeuvre();
                self.manoeuvre_s = Some(t);
            }
            return kept;
        };
        let (size, sigma) = (self.state[AZ].abs(), self.sigma(AZ));
        let is_doubtful = seconds > MANOEUVRE_TIME_S && size < 2.0 * sigma;
        if (size + sigma < STEADY_M_S2 || is_doubtful) && !self.along.are_biased() {
            self.end_manoeuvre();
        } else {
            self.manoeuvre_s = Some(seconds + t);
        }
        kept
    }

    /// A manoeuvre that began [`MANOEUVRE_LAG_S`] ago.
    fn begin_manoeuvre(&mut self) {
        let t = MANOEUVRE_LAG_S;
        let made = slopes([(Z, t * t / 2.0), (VZ, t), (AZ, 1.0)]);
        self.p += made * made.transpose() * (MANOEUVRE_SIGMA_M_S2 * MANOEUVRE_SIGMA_M_S2);
    }

    /// Drops the acceleration.
    pub(super) fn end_manoeuvre(&mut self) {
        self.manoeuvre_s = None;
        self.state[AZ] = 0.0;
        self.forget(AZ, 0.0);
    }

    /// Adds what becomes unknown of an acceleration of which this share is kept.
    pub(super) fn add_unknown_acceleration(&mut self, kept: f64) {
        if self.manoeuvre_s.is_some() {
            self.p[(AZ, AZ)] += MANOEUVRE_SIGMA_M_S2 * MANOEUVRE_SIGMA_M_S2 * (1.0 - kept * kept);
        }
    }

    /// Acceleration of the thing away from the camera, over ground where the own motion is known, with its standard deviation,
    /// in m/s²; `None` unless it manoeuvres.
    pub fn acceleration_m_s2(&self) -> Option<(f64, f64)> {
        self.manoeuvre_s.map(|_| (self.state[AZ], self.sigma(AZ)))
    }

    /// With how much it brakes, in m/s², less the part of the estimate that may be noise: its square exceeds that of the true
    /// one by the variance. 0 if it does not brake.
    pub(super) fn braking_m_s2(&self) -> f64 {
        let braking = -self.state[AZ];
        let noise = if braking > 0.0 { self.p[(AZ, AZ)] / braking } else { 0.0 };
        (braking - noise).clamp(0.0, MAX_BRAKING_M_S2)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tracking::filter::{TimeToCollision, braking_seconds};

    /// Focal length × baseline of the paper's rig, px·m.
    const SCALE: f64 = 105.5;
    const PERIOD_S: f64 = 0.08;

    fn normal(random: &mut fastrand::Rng) -> f64 {
        (0..12).map(|_| random.f64()).sum::<f64>() - 6.0
    }

    /// Follows at 16.7 m/s and a second's distance a car that brakes from 1 s on. Returns the errors of the closing speed (m/s) and
    /// of the time to collision (s) at `at_s` after it began to brake, the latter as it is with braking.
    fn follow(seed: u64, braking: f64, at_s: f64) -> (f64, f64, Option<(f64, f64)>) {
        let mut random = fastrand::Rng::with_seed(seed);
        let at = |t: f64| 16.7 - braking * t * t / 2.0;
        let mut filter = TrackFilter::new(SCALE, (SCALE / at(0.0), 0.18), (0.0, 0.1));
        let frames = ((2.0 + at_s) / PERIOD_S) as i32;
        let mut since = 0.0;
        for frame in 1..=frames {
            since = (f64::from(frame) * PERIOD_S - 2.0).max(0.0);
            filter.predict(PERIOD_S);
            filter.measure_disparity(SCALE / at(since) + 0.1 * normal(&mut random), 0.18);
            // Every fifth frame the pictures tell the mean closing speed of the last 0.4 s.
            if frame % 5 == 0 {
                let before = (since - 0.4).max(0.0);
                let mean = (at(before) - at(since)) / 0.4;
                let per_s = mean / at(since) + 0.01 * normal(&mut random);
                filter.measure_scale_rate(per_s, 0.012, 0.4, 4.0);
            }
        }
        let closing = braking * since;
        // Its speed of 16.7 m/s lasts longer than these distances.
        let truth = if braking > 0.0 { braking_seconds(at(since), closing, braking) } else { f64::INFINITY };
        let found = filter.seconds_to_collision().unwrap_or(f64::INFINITY);
        (filter.closing_m_s() - closing, found - truth, filter.acceleration_m_s2())
    }

    #[test]
    fn a_car_that_brakes_is_followed_with_its_acceleration() {
        let (mut speed, mut ttc, mut manoeuvres) = (0.0, 0.0, 0);
        for seed in 0..40 {
            let (closing, seconds, found) = follow(seed, 4.0, 1.2);
            speed += closing / 40.0;
            ttc += seconds / 40.0;
            manoeuvres += i32::from(found.is_some());
        }
        println!(
            "1.2 s after it began to brake with 4 m/s²: closing {speed:+.2} m/s, time to collision {ttc:+.2} s, {manoeuvres} of 40 found"
        );
        assert!(speed.abs() < 0.8 && ttc.abs() < 0.6 && manoeuvres >= 38, "{speed} {ttc} {manoeuvres}");
    }

    #[test]
    fn a_car_that_goes_on_has_no_acceleration() {
        let found = (0..40).filter(|&seed| follow(seed, 0.0, 2.0).2.is_some()).count();
        println!("{found} of 40 manoeuvres of a car at constant speed");
        assert!(found <= 4, "{found}");
    }

    #[test]
    fn the_time_to_collision_ends_with_the_stop() {
        // 10 m ahead, both with 10 m/s, braking with 5 m/s²: 2 s until we meet, as it stops.
        assert!((braking_seconds(10.0, 0.0, 5.0) - 2.0).abs() < 1e-9);
        assert!((braking_seconds(10.0, 5.0, 0.0) - 2.0).abs() < 1e-9);
        let mut filter = TrackFilter::new(SCALE, (SCALE / 20.0, 0.1), (0.0, 0.1));
        filter.own_rate[1] = -10.0;
        filter.state[VZ] = 10.0;
        (filter.state[AZ], filter.manoeuvre_s) = (-5.0, Some(1.0));
        // It stops after 2 s and 10 m; of the 30 m until there we then have 10 m left, at 10 m/s.
        let seconds = filter.seconds_to_collision().unwrap();
        assert!((seconds - 3.0).abs() < 1e-3, "{seconds}");
        let ttc = TimeToCollision { seconds: 2.0, sigma_s: 0.1 };
        assert!((ttc.braking_m_s2(10.0, 0.0) - 5.0).abs() < 1e-9);
        assert_eq!(ttc.braking_m_s2(10.0, 6.0), 0.0);
    }
}
