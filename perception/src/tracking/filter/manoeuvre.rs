//! Acceleration of a thing while it manoeuvres.
//!
//! A filter of variable dimension (Bar-Shalom and Birmingham, 1982): a thing has a constant speed until its innovations are
//! biased, that is, until it brakes or accelerates. From then on the acceleration is a third state, correlated in time
//! (Singer, 1970): it decays within [`MANOEUVRE_TIME_S`], and what is not known of it is [`MANOEUVRE_SIGMA_M_S2`]. When it is
//! found, the manoeuvre has gone on for [`MANOEUVRE_LAG_S`]: place and speed are then wrong by what that acceleration has made
//! of them, and the covariances say so, so that the next measurements correct all three. When the acceleration is known to be
//! small again, or remains doubtful, the third state is dropped.

use super::acceleration::{Acceleration, braking_seconds};
use super::{ConstantVelocityFilter, DistanceFilter, TimeToCollision};
use crate::tracking::parameters::{
    MANOEUVRE_LAG_S, MANOEUVRE_SIGMA_M_S2, MANOEUVRE_TIME_S, MAX_BRAKING_M_S2, STEADY_M_S2,
};

impl ConstantVelocityFilter {
    /// Begins or ends the estimation of the acceleration, as the innovations tell.
    pub(super) fn follow_manoeuvre(&mut self) {
        let found = self.acceleration;
        if !found.is_estimated() {
            // Where the speed is not known, it explains the innovations; and outliers are no acceleration.
            let lag_m_s = MANOEUVRE_LAG_S * MANOEUVRE_SIGMA_M_S2;
            let is_known = self.p[2] < lag_m_s * lag_m_s && self.outliers.frames == 0;
            if self.is_manoeuvring() && is_known {
                self.begin_manoeuvre();
            }
            return;
        }
        let is_steady = found.value.abs() + found.sigma() < STEADY_M_S2;
        let is_doubtful = found.seconds > MANOEUVRE_TIME_S && found.value.abs() < 2.0 * found.sigma();
        if (is_steady || is_doubtful) && !self.is_manoeuvring() {
            self.acceleration = Acceleration::default();
        }
    }

    /// A manoeuvre that began [`MANOEUVRE_LAG_S`] ago.
    fn begin_manoeuvre(&mut self) {
        let (t, f) = (MANOEUVRE_LAG_S, MANOEUVRE_SIGMA_M_S2 * MANOEUVRE_SIGMA_M_S2);
        let half = t * t / 2.0;
        self.p = [self.p[0] + half * half * f, self.p[1] + half * t * f, self.p[2] + t * t * f];
        self.acceleration = Acceleration { value: 0.0, p: [half * f, t * f, f], seconds: 0.0 };
    }

    /// Predicts what the acceleration adds `t` seconds ahead; constant speed is predicted by the caller, after this.
    pub(super) fn predict_acceleration(&mut self, t: f64) {
        if !self.acceleration.is_estimated() {
            return;
        }
        let (half, kept) = (t * t / 2.0, (-t / MANOEUVRE_TIME_S).exp());
        let Acceleration { value, p: [d, e, f], seconds } = self.acceleration;
        // The caller's prediction adds t · speed, so that the place gets half here and half there.
        self.position -= half * value;
        self.speed += t * value;
        let [a, b, c] = self.p;
        // F P Fᵀ of the transition (position − h·a, speed + t·a).
        let (da, ea) = (d - half * f, e + t * f);
        self.p = [
            a - 2.0 * half * d + half * half * f,
            b + t * d - half * e - half * t * f,
            c + 2.0 * t * e + t * t * f,
        ];
        // The caller's prediction moves place by t · speed, and with it the covariance of the place.
        let unknown = MANOEUVRE_SIGMA_M_S2 * MANOEUVRE_SIGMA_M_S2 * (1.0 - kept * kept);
        self.acceleration = Acceleration {
            value: kept * value,
            p: [kept * (da + t * ea), kept * ea, kept * kept * f + unknown],
            seconds: seconds + t,
        };
    }

    /// Corrects the acceleration by an innovation of this variance; `with` is its covariance with the acceleration, and `state`
    /// those with position and speed.
    pub(super) fn correct_acceleration(&mut self, innovation: f64, spread: f64, state: [f64; 2], with: f64) {
        if !self.acceleration.is_estimated() {
            return;
        }
        let gain = with / spread;
        let Acceleration { value, p: [d, e, f], .. } = &mut self.acceleration;
        *value += gain * innovation;
        (*d, *e) = (*d - gain * state[0], *e - gain * state[1]);
        *f = (*f - gain * with).max(1e-6);
    }
}

impl DistanceFilter {
    /// Acceleration of the thing away from the camera, over ground where the own motion is known, with its standard deviation,
    /// in m/s²; `None` unless it manoeuvres.
    pub fn acceleration_m_s2(&self) -> Option<(f64, f64)> {
        let found = &self.filter.acceleration;
        found.is_estimated().then(|| (found.value, found.sigma()))
    }

    /// With how much it brakes, in m/s², less the part of the estimate that may be noise: its square exceeds that of the true
    /// one by the variance. 0 if it does not brake.
    fn braking_m_s2(&self) -> f64 {
        let (found, braking) = (&self.filter.acceleration, -self.filter.acceleration.value);
        let noise = if braking > 0.0 { found.p[2] / braking } else { 0.0 };
        (braking - noise).clamp(0.0, MAX_BRAKING_M_S2)
    }

    /// Seconds until the distance is 0 if it goes on braking until it stands; `None` if it does not come to that.
    pub(super) fn seconds_to_collision(&self) -> Option<f64> {
        let (z, closing, braking) = (self.filter.position, self.closing_m_s(), self.braking_m_s2());
        if braking <= 0.0 {
            return (closing > 0.0).then(|| z / closing);
        }
        let seconds = braking_seconds(z, closing, braking);
        // What drives ahead stops, and does not come back.
        let stops_s = if self.filter.speed > 0.0 { self.filter.speed / braking } else { f64::INFINITY };
        if seconds <= stops_s {
            return Some(seconds);
        }
        let left_m = z - closing * stops_s - braking * stops_s * stops_s / 2.0;
        let then = closing + braking * stops_s;
        (then > 0.0).then(|| stops_s + left_m / then)
    }
}

impl TimeToCollision {
    /// By how much the closing speed must grow for this time at a distance, in m/s²; 0 if it need not.
    pub fn braking_m_s2(&self, distance_m: f64, closing_m_s: f64) -> f64 {
        let seconds = self.seconds.max(1e-3);
        (2.0 * (distance_m - closing_m_s * seconds) / (seconds * seconds)).clamp(0.0, MAX_BRAKING_M_S2)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

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
        let mut filter = DistanceFilter::new(SCALE, SCALE / at(0.0), 0.18);
        let frames = ((2.0 + at_s) / PERIOD_S) as i32;
        let mut since = 0.0;
        for frame in 1..=frames {
            since = (f64::from(frame) * PERIOD_S - 2.0).max(0.0);
            filter.predict(PERIOD_S);
            filter.update(SCALE / at(since) + 0.1 * normal(&mut random), 0.18);
            // Every fifth frame the pictures tell the mean closing speed of the last 0.4 s.
            if frame % 5 == 0 {
                let before = (since - 0.4).max(0.0);
                let mean = (at(before) - at(since)) / 0.4;
                let rate = crate::tracking::image_motion::ScaleRate {
                    per_s: mean / at(since) + 0.01 * normal(&mut random),
                    sigma_per_s: 0.012,
                    interval_s: 0.4,
                };
                filter.update_scale_rate(rate);
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
        let mut filter = DistanceFilter::new(SCALE, SCALE / 20.0, 0.1);
        filter.filter.own_rate = -10.0;
        filter.filter.speed = 10.0;
        filter.filter.acceleration = Acceleration { value: -5.0, p: [0.0, 0.0, 1e-12], seconds: 1.0 };
        // It stops after 2 s and 10 m; of the 30 m until there we then have 10 m left, at 10 m/s.
        let seconds = filter.seconds_to_collision().unwrap();
        assert!((seconds - 3.0).abs() < 1e-3, "{seconds}");
        let ttc = TimeToCollision { seconds: 2.0, sigma_s: 0.1 };
        assert!((ttc.braking_m_s2(10.0, 0.0) - 5.0).abs() < 1e-9);
        assert_eq!(ttc.braking_m_s2(10.0, 6.0), 0.0);
    }
}
