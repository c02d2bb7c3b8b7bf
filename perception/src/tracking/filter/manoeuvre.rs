//! Whether a thing brakes or accelerates.
//!
//! Two models are followed at the same time, at constant speed and with an acceleration; the second is the less exact one where
//! there is none. It holds once its acceleration differs from 0 by more than noise does, and as long as that is so (switching
//! between models of different dimension: Bar-Shalom and Birmingham, 1982).
//!
//! A manoeuvre begins with the speed of until then, which the first model knows better: as long as nothing tells of one, the second
//! model begins anew from time to time with what the first one says.

use super::estimate::{AZ, Model, VZ};
use super::{Estimate, TrackFilter};
use crate::tracking::parameters::{
    BRAKING_NOISE_SHARE, EXPECTED_AGAIN_S, JERK_NOISE, MANOEUVRE_SIGMAS, MAX_BRAKING_M_S2,
    MAX_MANOEUVRE_SPEED_SIGMA_M_S, STEADY_M_S2,
};

impl TrackFilter {
    /// In the coming `elapsed_s` seconds a manoeuvre may begin, or change.
    pub(super) fn expect_manoeuvre(&mut self, elapsed_s: f64) {
        let size = self.accelerating.state[AZ].abs();
        let nothing_tells = size < self.accelerating.sigma(AZ).max(STEADY_M_S2);
        if self.is_manoeuvring {
            self.accelerating.p[(AZ, AZ)] += JERK_NOISE * elapsed_s;
        } else if nothing_tells && self.begun_s >= EXPECTED_AGAIN_S {
            self.accelerating = self.steady.by(Model::Accelerating);
            self.begun_s = 0.0;
        }
        self.begun_s += elapsed_s;
    }

    /// Tells which model holds.
    #[inline(never)]
    pub(in crate::tracking) fn choose_model(&mut self) {
        let (size, sigma) = (self.accelerating.state[AZ].abs(), self.accelerating.sigma(AZ));
        if self.is_manoeuvring {
            if size + sigma < STEADY_M_S2 || size < sigma {
                self.is_manoeuvring = false;
                self.steady = self.accelerating.by(Model::Steady);
            }
        } else {
            let is_known = self.accelerating.sigma(VZ) < MAX_MANOEUVRE_SPEED_SIGMA_M_S;
            let is_significant = size > MANOEUVRE_SIGMAS * sigma && size > STEADY_M_S2;
            self.is_manoeuvring = is_significant && is_known && !self.accelerating.along.is_outlier();
        }
    }

    /// What brakes stops, and does not come back. `before_m_s`: its speed over ground before the last prediction.
    pub(super) fn stop(&mut self, before_m_s: f64) {
        let (speed_m_s, acceleration) = (self.accelerating.state[VZ], self.accelerating.state[AZ]);
        if self.is_manoeuvring && before_m_s * speed_m_s < 0.0 && before_m_s * acceleration < 0.0 {
            self.is_manoeuvring = false;
            self.accelerating.state[VZ] = 0.0;
            self.accelerating.forget_acceleration();
            self.steady = self.accelerating.by(Model::Steady);
        }
    }

    /// Acceleration of the thing away from the camera, over ground where the own motion is known, with its standard deviation,
    /// in m/s²; `None` unless it manoeuvres.
    pub fn acceleration_m_s2(&self) -> Option<(f64, f64)> {
        self.is_manoeuvring.then(|| (self.state[AZ], self.sigma(AZ)))
    }
}

impl Estimate {
    /// With how much it brakes, in m/s², less a part of what noise adds to it ([`BRAKING_NOISE_SHARE`]). 0 if it does not brake.
    pub(super) fn braking_m_s2(&self) -> f64 {
        let braking = -self.state[AZ];
        let noise = if braking > 0.0 { self.p[(AZ, AZ)] / braking } else { 0.0 };
        (braking - BRAKING_NOISE_SHARE * noise).clamp(0.0, MAX_BRAKING_M_S2)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::motion::Motion;
    use crate::motion::body::Body;
    use crate::motion::planar::{OwnRates, PlanarStep};
    use crate::tracking::filter::{TimeToCollision, braking_seconds};

    /// Focal length × baseline of the paper's rig, px·m.
    const SCALE: f64 = 105.5;
    const PERIOD_S: f64 = 0.08;

    fn normal(random: &mut fastrand::Rng) -> f64 {
        (0..12).map(|_| random.f64()).sum::<f64>() - 6.0
    }

    /// What is known of a car at the end.
    struct Followed {
        filter: TrackFilter,
        /// Errors of the closing speed, in m/s, and of the time to collision with braking, in seconds.
        closing_error_m_s: f64,
        ttc_error_s: f64,
        /// Whether a manoeuvre was found at any time.
        was_manoeuvring: bool,
    }

    /// Frames before the car changes its speed, and steps of its motion in each.
    const STEADY_FRAMES: i32 = 25;
    const STEPS: i32 = 8;

    /// Follows at 16.7 m/s and a second's distance a car that changes its speed: pairs of the time since then, in seconds, and of its
    /// deceleration from that on, in m/s². It begins within one frame, some of its steps late. Ends after so many more frames.
    fn follow(seed: u64, braking: &[(f64, f64)], frames: i32) -> Followed {
        let mut random = fastrand::Rng::with_seed(seed);
        let (mut distance_m, mut closing) = (16.7, 0.0);
        let mut filter = TrackFilter::new(SCALE, (SCALE / distance_m, 0.18), (0.0, 0.1));
        let step_s = PERIOD_S / f64::from(STEPS);
        let begin_s = f64::from(STEADY_FRAMES) * PERIOD_S + (seed % STEPS as u64) as f64 * step_s;
        let braking_at =
            |t: f64| braking.iter().rev().find(|from| t >= begin_s + from.0).map_or(0.0, |from| from.1);
        let (mut time_s, mut stored_m, mut was_manoeuvring) = (0.0, 0.0, false);
        for frame in 1..=STEADY_FRAMES + frames {
            for _ in 0..STEPS {
                closing += braking_at(time_s + step_s / 2.0) * step_s;
                distance_m -= closing * step_s;
                time_s += step_s;
            }
            filter.predict(PERIOD_S);
            filter.measure_disparity(SCALE / distance_m + 0.1 * normal(&mut random), 0.18);
            // Pictures are compared with that of every fifth frame.
            if frame > 5 {
                filter.measure_scale(stored_m / distance_m + 0.004 * normal(&mut random), 0.005, 0.4, 4.0);
            }
            if frame % 5 == 0 {
                filter.store_place(0.004, 0.02);
                stored_m = distance_m * (1.0 + 0.004 * normal(&mut random));
            }
            was_manoeuvring |= filter.is_manoeuvring;
        }
        // Its speed of 16.7 m/s lasts longer than these distances.
        let truth = braking_seconds(distance_m, closing, braking_at(time_s));
        let ttc_error_s = filter.seconds_to_collision().unwrap_or(f64::INFINITY) - truth;
        Followed { filter, closing_error_m_s: filter.closing_m_s() - closing, ttc_error_s, was_manoeuvring }
    }

    /// Mean of what `of` says in runs with 80 seeds.
    fn mean(braking: &[(f64, f64)], frames: i32, of: impl Fn(&Followed) -> f64) -> f64 {
        (0..80).map(|seed| of(&follow(seed, braking, frames)) / 80.0).sum()
    }

    /// 1 if it is said to brake.
    fn brakes(run: &Followed) -> f64 {
        f64::from(run.filter.acceleration_m_s2().is_some_and(|(a, _)| a < 0.0))
    }

    #[test]
    fn a_car_that_brakes_is_followed_with_its_acceleration() {
        let soon = mean(&[(0.0, 4.0)], 8, brakes);
        println!("4 m/s² from steady: {:.0} % found within 0.64 s", soon * 100.0);
        for frames in [15, 30] {
            let closing = mean(&[(0.0, 4.0)], frames, |run| run.closing_error_m_s);
            let ttc = mean(&[(0.0, 4.0)], frames, |run| run.ttc_error_s);
            println!("{frames} frames after: closing {closing:+.2} m/s, time to collision {ttc:+.2} s");
            assert!(closing.abs() < 0.12 && ttc.abs() < 0.12, "{closing} {ttc}");
            assert!(mean(&[(0.0, 4.0)], frames, brakes) > 0.95);
        }
        assert!(soon > 0.6, "{soon}");
    }

    #[test]
    fn a_manoeuvre_may_change_or_end() {
        let more = mean(&[(0.0, 2.0), (0.96, 8.0)], 22, |run| run.closing_error_m_s);
        println!("0.8 s after 2 m/s² became 8: closing {more:+.2} m/s");
        assert!(more.abs() < 0.5, "{more}");
        let ended: &[(f64, f64)] = &[(0.0, 4.0), (1.2, 0.0)];
        let (error, still) = (mean(ended, 27, |run| run.closing_error_m_s), mean(ended, 27, brakes));
        println!(
            "0.96 s after it no longer brakes: closing {error:+.2} m/s, {:.0} % still said to brake",
            still * 100.0
        );
        assert!(error.abs() < 0.1 && still < 0.1, "{error} {still}");
    }

    #[test]
    fn braking_is_found_after_a_gentle_acceleration_too() {
        let found = mean(&[(0.0, -1.0), (4.0, 5.0)], 60, brakes);
        let error = mean(&[(0.0, -1.0), (4.0, 5.0)], 60, |run| run.closing_error_m_s);
        println!(
            "5 m/s² after 4 s of 1 m/s² away: {:.0} % found within 0.8 s, closing {error:+.2} m/s",
            found * 100.0
        );
        assert!(found > 0.5 && error.abs() < 0.8, "{found} {error}");
    }

    #[test]
    fn a_car_that_goes_on_has_no_acceleration() {
        let found = mean(&[], 50, |run| f64::from(run.was_manoeuvring));
        println!("a manoeuvre of a car at constant speed, ever in 6 s: {:.1} %", found * 100.0);
        assert!(found < 0.04, "{found}");
    }

    #[test]
    fn what_brakes_stops_and_does_not_come_back() {
        let own = Motion { speed_m_s: 10.0, ..Motion::default() };
        let (step, rates) =
            (PlanarStep::of(&own, &Body::default(), PERIOD_S), OwnRates::of(&own, &Body::default()));
        for (speed_m_s, stops_m) in [(8.0, 4.0), (-8.0, -4.0)] {
            let mut filter = TrackFilter::new(SCALE, (SCALE / 40.0, 0.1), (0.0, 0.1));
            filter.start_over_ground(&rates);
            filter.is_manoeuvring = true;
            (filter.accelerating.state[VZ], filter.accelerating.state[AZ]) = (speed_m_s, -speed_m_s);
            // Unseen for 1.6 s, in which we drive 16 m.
            (0..20).for_each(|_| filter.predict_over_ground(&step, &rates, PERIOD_S));
            assert_eq!((filter.speed_m_s()[1], filter.acceleration_m_s2()), (0.0, None));
            assert!((filter.place_m()[1] - (40.0 - 16.0 + stops_m)).abs() < 0.2, "{:?}", filter.place_m());
        }
    }

    #[test]
    fn the_time_to_collision_ends_with_the_stop() {
        // 10 m ahead, both with 10 m/s, braking with 5 m/s²: 2 s until we meet, as it stops.
        assert!((braking_seconds(10.0, 0.0, 5.0) - 2.0).abs() < 1e-9);
        assert!((braking_seconds(10.0, 5.0, 0.0) - 2.0).abs() < 1e-9);
        let mut filter = TrackFilter::new(SCALE, (SCALE / 20.0, 0.1), (0.0, 0.1));
        filter.is_manoeuvring = true;
        filter.accelerating.own_rate[1] = -10.0;
        (filter.accelerating.state[VZ], filter.accelerating.state[AZ]) = (10.0, -5.0);
        filter.accelerating.p[(AZ, AZ)] = 0.0;
        // It stops after 2 s and 10 m; of the 30 m until there we then have 10 m left, at 10 m/s.
        let seconds = filter.seconds_to_collision().unwrap();
        assert!((seconds - 3.0).abs() < 1e-3, "{seconds}");
        // What crosses does not brake: 2 s at our speed, however its own is said to grow towards us.
        filter.accelerating.state[VZ] = -0.1;
        let seconds = filter.seconds_to_collision().unwrap();
        assert!((seconds - 20.0 / 10.1).abs() < 1e-3, "{seconds}");
        // What comes towards us may, and while the own speed is unknown nobody knows.
        filter.accelerating.state[VZ] = -10.0;
        filter.accelerating.p[(VZ, VZ)] = 1.0;
        let oncoming = filter.seconds_to_collision().unwrap();
        assert!((oncoming - braking_seconds(20.0, 20.0, 5.0)).abs() < 1e-3, "{oncoming}");
        (filter.accelerating.state[VZ], filter.accelerating.own_rate[1]) = (-0.1, 0.0);
        let unknown = filter.seconds_to_collision().unwrap();
        assert!((unknown - braking_seconds(20.0, 0.1, 5.0)).abs() < 1e-3, "{unknown}");
        let ttc = TimeToCollision { seconds: 2.0, sigma_s: 0.1 };
        assert!((ttc.braking_m_s2(10.0, 0.0) - 5.0).abs() < 1e-9);
        assert_eq!(ttc.braking_m_s2(10.0, 6.0), 0.0);
    }
}
