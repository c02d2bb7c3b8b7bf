//! The filters of one obstacle in axes that turn with the camera, with speeds over ground.
//!
//! Input: the displacement of the camera since the last frame and the rates that its motion adds
//! ([`crate::motion::planar`]). A standing thing then has no speed, whatever the vehicle does, and whether a thing moves
//! can be tested ([`Movement`]). What is known to stand closes with the own speed, which is known better than that of any
//! thing: its time to collision is that of the state under the condition that it stands.

use super::{ConstantVelocityFilter, DistanceFilter, LateralFilter, MIN_DISTANCE_M, TimeToCollision};
use crate::motion::planar::{OwnRates, Planar, PlanarStep};
use crate::tracking::parameters::{
    MAX_STANDING_SIGMA_M_S, MAX_STANDING_SIGMA_SHARE, MOVING_CHI2, STANDING_CHI2, STANDING_SPEED_M_S,
};

/// Whether an obstacle moves over ground.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[repr(u32)]
pub enum Movement {
    /// The own motion is unknown, or the measurements do not tell.
    #[default]
    Unknown = 0,
    /// It stands.
    Standing = 1,
    /// It moves.
    Moving = 2,
}

/// Motion of an obstacle over ground, along the camera's axes.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct GroundMotion {
    /// Speed to the right and forward, in m/s; 0 if it stands.
    pub speed_m_s: Planar,
    /// Its standard deviation, in m/s.
    pub speed_sigma_m_s: Planar,
    /// Standard deviation of the place to the right and forward, in metres.
    pub place_sigma_m: Planar,
    /// Whether it stands or moves.
    pub movement: Movement,
}

impl ConstantVelocityFilter {
    /// Makes the speed one over ground; `own` is the rate of a standing point with its standard deviation.
    fn begin_over_ground(&mut self, own_rate: f64, own_sigma: f64) {
        self.speed -= own_rate;
        self.own_rate = own_rate;
        self.p[2] += own_sigma * own_sigma;
    }

    /// Makes the speed one relative to the camera.
    fn end_over_ground(&mut self) {
        (self.speed, self.own_rate) = (self.rate(), 0.0);
    }
}

impl DistanceFilter {
    /// Closing speed of a standing thing at this place, in m/s; 0 while the own motion is unknown.
    pub fn own_closing_m_s(&self) -> f64 {
        -self.filter.own_rate
    }

    /// Time to collision under the condition that the speed over ground is 0. The thing closes with the own speed, whose
    /// standard deviation is `own_sigma_m_s`; `None` if that is not significant (two standard deviations).
    pub fn standing_time_to_collision(&self, own_sigma_m_s: f64) -> Option<TimeToCollision> {
        let [a, b, c] = self.filter.p;
        let closing = self.own_closing_m_s();
        if closing <= 2.0 * own_sigma_m_s {
            return None;
        }
        let distance = (self.filter.position - b / c * self.filter.speed).max(MIN_DISTANCE_M);
        let seconds = distance / closing;
        let variance = (a - b * b / c).max(0.0) + (seconds * own_sigma_m_s).powi(2);
        Some(TimeToCollision { seconds, sigma_s: variance.sqrt() / closing })
    }
}

/// Distance and lateral position of one obstacle.
pub struct Filters<'a> {
    /// Distance and speed along the axis.
    pub longitudinal: &'a mut DistanceFilter,
    /// Lateral position and speed.
    pub lateral: &'a mut LateralFilter,
}

impl Filters<'_> {
    /// The speeds of a new obstacle, of which nothing is known, are those over ground: it may stand.
    pub fn start(&mut self, rates: &OwnRates) {
        let (x, z) = (&mut self.lateral.filter, &mut self.longitudinal.filter);
        [x.own_rate, z.own_rate] = rates.at([x.position, z.position]);
    }

    /// Makes speeds relative to the camera those over ground.
    pub fn begin(&mut self, rates: &OwnRates) {
        let (x, z) = (&mut self.lateral.filter, &mut self.longitudinal.filter);
        let place = [x.position, z.position];
        let (own, sigma) = (rates.at(place), rates.sigma_at(place));
        x.begin_over_ground(own[0], sigma[0]);
        z.begin_over_ground(own[1], sigma[1]);
    }

    /// Measures speeds to the right and forward of 0, with these standard deviations in m/s.
    pub fn zero_velocity_update(&mut self, [across, along]: Planar) {
        self.lateral.filter.measure_speed(0.0, across);
        let filter = &mut self.longitudinal.filter;
        filter.measure_speed(0.0, along);
        filter.position = filter.position.max(MIN_DISTANCE_M);
    }

    /// Makes speeds over ground those relative to the camera.
    pub fn end(&mut self) {
        self.longitudinal.filter.end_over_ground();
        self.lateral.filter.end_over_ground();
    }

    /// Predicts the place after `elapsed_s` seconds in which the camera moves by `step`. The speeds are over ground. Both
    /// axes mix, as they turn; the correlation that comes of it, small at the angle of one step, is left out.
    pub fn predict(&mut self, step: &PlanarStep, rates: &OwnRates, elapsed_s: f64) {
        let (noise, lateral_noise) = (self.longitudinal.process_noise(), self.lateral.process_noise());
        let (x, z) = (&mut self.lateral.filter, &mut self.longitudinal.filter);
        z.predict(elapsed_s, noise);
        x.predict(elapsed_s, lateral_noise);
        // So far in the axes of the frame before.
        let added = step.variance_m2([x.position, z.position]);
        [x.position, z.position] = step.place([x.position, z.position]);
        [x.speed, z.speed] = step.direction([x.speed, z.speed]);
        let (same, other) = step.shares();
        let (px, pz) = (x.p, z.p);
        x.p = std::array::from_fn(|i| same * px[i] + other * pz[i]);
        z.p = std::array::from_fn(|i| same * pz[i] + other * px[i]);
        x.p[0] += added[0];
        z.p[0] += added[1];
        z.position = z.position.max(MIN_DISTANCE_M);
        [x.own_rate, z.own_rate] = rates.at([x.position, z.position]);
    }

    /// Whether the obstacle moves, with speeds over ground; `before` remains where the measurements do not tell.
    /// `aspect_m_s`: speed that a standing thing seems to have because another side of it comes into view.
    pub fn movement(&self, before: Movement, aspect_m_s: f64) -> Movement {
        let (x, z) = (&self.lateral.filter, &self.longitudinal.filter);
        let sigmas = [x, z].map(ConstantVelocityFilter::speed_sigma);
        let part =
            |speed: f64, sigma: f64| (speed / sigma.hypot(STANDING_SPEED_M_S).hypot(aspect_m_s)).powi(2);
        let chi2 = part(x.speed, sigmas[0]) + part(z.speed, sigmas[1]);
        let most_along = MAX_STANDING_SIGMA_M_S.max(MAX_STANDING_SIGMA_SHARE * z.own_rate.abs());
        if chi2 > MOVING_CHI2 {
            Movement::Moving
        } else if chi2 < STANDING_CHI2 && sigmas[0] < MAX_STANDING_SIGMA_M_S && sigmas[1] < most_along {
            Movement::Standing
        } else {
            before
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::motion::Motion;
    use crate::motion::body::Body;

    /// Focal length × baseline, px·m.
    const SCALE: f64 = 105.5;
    const PERIOD_S: f64 = 0.08;

    /// Follows a thing that moves over ground with this velocity, from a place, while the vehicle drives a bend. Returns
    /// the filters with the speeds over ground in the axes of the camera at the end, and the true ones.
    fn follow(
        seed: u64,
        from: [f64; 2],
        velocity: [f64; 2],
    ) -> (DistanceFilter, LateralFilter, [f64; 2], Movement) {
        let mut random = fastrand::Rng::with_seed(seed);
        let mut normal = || (0..12).map(|_| random.f64()).sum::<f64>() - 6.0;
        let truth = Motion { speed_m_s: 8.0, yaw_rate_rad_s: 0.3, ..Motion::default() };
        let body = Body::default();
        let exact = PlanarStep::of(&truth, &body, PERIOD_S);
        let (mut place, mut velocity) = (from, velocity);
        let measure = |place: [f64; 2], noise: f64| SCALE / place[1] + 0.12 * noise;
        let mut longitudinal = DistanceFilter::new(SCALE, measure(place, normal()), 0.12);
        let mut lateral = LateralFilter::new(place[0] + 0.1 * normal(), 0.1);
        let mut movement = Movement::Unknown;
        for frame in 0..20 {
            let motion = Motion {
                speed_m_s: 8.0 + 0.1 * normal(),
                speed_sigma_m_s: 0.1,
                yaw_rate_rad_s: 0.3 + 0.005 * normal(),
                yaw_rate_sigma_rad_s: 0.005,
                ..truth
            };
            let (step, rates) = (PlanarStep::of(&motion, &body, PERIOD_S), OwnRates::of(&motion, &body));
            let mut filters = Filters { longitudinal: &mut longitudinal, lateral: &mut lateral };
            if frame == 0 {
                filters.start(&rates);
            }
            filters.predict(&step, &rates, PERIOD_S);
            place = exact.place([place[0] + velocity[0] * PERIOD_S, place[1] + velocity[1] * PERIOD_S]);
            velocity = exact.direction(velocity);
            filters.longitudinal.update(measure(place, normal()), 0.12);
            filters.lateral.update(place[0] + 0.1 * normal(), 0.1);
            movement = filters.movement(movement, 0.0);
        }
        (longitudinal, lateral, velocity, movement)
    }

    #[test]
    fn in_a_bend_a_standing_thing_stands_and_a_walker_walks() {
        for (velocity, expected) in [
            ([0.0, 0.0], Movement::Standing),
            ([-2.0, 0.0], Movement::Moving),
            ([0.0, -5.0], Movement::Moving),
        ] {
            let (mut right, mut worst) = (0, 0.0_f64);
            for seed in 0..40 {
                let (longitudinal, lateral, truth, movement) = follow(seed, [4.0, 26.0], velocity);
                worst = worst.max((lateral.speed_m_s() - truth[0]).abs() / lateral.speed_sigma_m_s());
                worst = worst
                    .max((longitudinal.speed_m_s() - truth[1]).abs() / longitudinal.filter.speed_sigma());
                right += i32::from(movement == expected);
            }
            println!(
                "{velocity:?} m/s, seeds 0 to 39: {right} of 40 {expected:?}, worst speed error {worst:.1} deviations"
            );
            assert!(worst < 5.0 && right >= 36, "{velocity:?}: {right} of 40, {worst}");
        }
    }

    #[test]
    fn a_standing_thing_closes_with_the_own_speed() {
        let (longitudinal, _, _, _) = follow(1, [0.0, 26.0], [0.0, 0.0]);
        let free = longitudinal.time_to_collision().unwrap();
        let standing = longitudinal.standing_time_to_collision(0.1).unwrap();
        let truth = longitudinal.distance_m() / longitudinal.own_closing_m_s();
        assert!((standing.seconds - truth).abs() < 0.1 * truth, "{standing:?} {truth}");
        assert!(standing.sigma_s < 0.5 * free.sigma_s, "{standing:?} {free:?}");
    }

    #[test]
    fn speeds_over_ground_and_relative_ones_are_the_same_motion() {
        let mut longitudinal = DistanceFilter::new(SCALE, SCALE / 20.0, 0.1);
        let mut lateral = LateralFilter::new(2.0, 0.1);
        for frame in 1..8 {
            longitudinal.predict(PERIOD_S);
            longitudinal.update(SCALE / (20.0 - 0.5 * f64::from(frame)), 0.1);
            lateral.predict(PERIOD_S);
            lateral.update(2.0 + 0.1 * f64::from(frame), 0.1);
        }
        let (before, closing) = (lateral.speed_m_s(), longitudinal.closing_m_s());
        let motion = Motion { speed_m_s: 9.0, yaw_rate_rad_s: 0.2, ..Motion::default() };
        let rates = OwnRates::of(&motion, &Body::default());
        let mut filters = Filters { longitudinal: &mut longitudinal, lateral: &mut lateral };
        filters.begin(&rates);
        assert!((filters.longitudinal.closing_m_s() - closing).abs() < 1e-12);
        assert!((filters.longitudinal.speed_m_s() + closing).abs() > 1.0);
        filters.end();
        assert!((filters.longitudinal.closing_m_s() - closing).abs() < 1e-12);
        assert!((filters.lateral.speed_m_s() - before).abs() < 1e-12);
        assert_eq!(filters.longitudinal.own_closing_m_s(), 0.0);
    }
}
