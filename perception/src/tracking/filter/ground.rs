//! The filter of one obstacle in axes that turn with the camera, with speeds over ground.
//!
//! Input: the displacement of the camera since the last frame and the rates that its motion adds
//! ([`crate::motion::planar`]). A standing thing then has no speed, whatever the vehicle does, and whether a thing moves
//! can be tested ([`Movement`]). What is known to stand closes with the own speed, which is known better than that of any
//! thing: its time to collision is that of the state under the condition that it stands.

use super::Estimate;
use super::estimate::{Covariance, VX, VZ, X, Z, slopes};
use crate::motion::planar::{OwnRates, Planar, PlanarStep};
use crate::tracking::parameters::{
    INITIAL_CLOSING_SIGMA_M_S, MAX_STANDING_SIGMA_M_S, MAX_STANDING_SIGMA_SHARE, MAX_TRAFFIC_TANGENT,
    MAX_WALKER_M_S, MOVING_CHI2, STANDING_ACROSS_M_S, STANDING_CHI2, STANDING_SIDES_PER_S,
    STANDING_SPEED_M_S, WALKER_SIGMA_M_S, WALKING_M_S,
};
use nalgebra::{Matrix2, Matrix4, Vector4};

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

/// Pairs of place to the right, place forward, speed to the right and speed forward of which the correlations are told.
pub const CORRELATED: [[usize; 2]; 6] = [[0, 1], [0, 2], [0, 3], [1, 2], [1, 3], [2, 3]];

/// Motion of an obstacle over ground, along the camera's axes.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct GroundMotion {
    /// Speed to the right and forward, in m/s; 0 if it stands.
    pub speed_m_s: Planar,
    /// Its standard deviation, in m/s.
    pub speed_sigma_m_s: Planar,
    /// Standard deviation of the place to the right and forward, in metres.
    pub place_sigma_m: Planar,
    /// Correlations of the errors of place and speed ([`CORRELATED`]), -1 to 1.
    pub correlations: [f64; 6],
    /// Whether it stands or moves.
    pub movement: Movement,
}

impl GroundMotion {
    /// Covariance of place to the right, place forward, speed to the right and speed forward.
    pub fn covariance(&self) -> Matrix4<f64> {
        let ([x, z], [vx, vz]) = (self.place_sigma_m, self.speed_sigma_m_s);
        let sigmas = Matrix4::from_diagonal(&[x, z, vx, vz].into());
        let mut correlations = Matrix4::identity();
        for ([i, k], correlation) in CORRELATED.into_iter().zip(self.correlations) {
            (correlations[(i, k)], correlations[(k, i)]) = (correlation, correlation);
        }
        sigmas * correlations * sigmas
    }

    /// The same with this covariance.
    #[must_use]
    pub fn with_covariance(self, covariance: &Matrix4<f64>) -> Self {
        let [x, z, vx, vz] = [0, 1, 2, 3].map(|i| covariance[(i, i)].max(0.0).sqrt());
        let sigmas = [x, z, vx, vz];
        let correlations = CORRELATED.map(|[i, k]| {
            let both = sigmas[i] * sigmas[k];
            if both > 0.0 { (covariance[(i, k)] / both).clamp(-1.0, 1.0) } else { 0.0 }
        });
        Self { place_sigma_m: [x, z], speed_sigma_m_s: [vx, vz], correlations, ..self }
    }
}

impl Estimate {
    /// The speeds of a new obstacle, of which nothing is known, are those over ground: it may stand.
    pub fn start_over_ground(&mut self, rates: &OwnRates) {
        self.own_rate = rates.at(self.place_m());
        self.p[(VZ, VZ)] = self.p[(VZ, VZ)].max(self.unknown_closing_m_s().powi(2));
    }

    /// Standard deviation of a closing speed of which nothing is known, in m/s: who comes towards us, or drives ahead, is about as fast as
    /// we are. Things beside the way are not on it.
    pub(super) fn unknown_closing_m_s(&self) -> f64 {
        let is_ahead = self.state[X].abs() <= MAX_TRAFFIC_TANGENT * self.state[Z];
        INITIAL_CLOSING_SIGMA_M_S.max(if is_ahead { self.own_rate[1].abs() } else { 0.0 })
    }

    /// Makes speeds relative to the camera those over ground.
    pub fn begin_over_ground(&mut self, rates: &OwnRates) {
        self.own_rate = rates.at(self.place_m());
        let sigmas = rates.sigma_at(self.place_m());
        for (i, speed) in [VX, VZ].into_iter().enumerate() {
            self.state[speed] -= self.own_rate[i];
            self.p[(speed, speed)] += sigmas[i] * sigmas[i];
        }
        // The acceleration was that of both.
        self.forget_acceleration();
    }

    /// Makes speeds over ground those relative to the camera.
    pub fn end_over_ground(&mut self) {
        let [across, along] = self.rate();
        (self.state[VX], self.state[VZ]) = (across, along);
        self.own_rate = [0.0; 2];
        self.forget_acceleration();
    }

    /// Predicts the state after `elapsed_s` seconds in which the camera moves by `step`. The speeds are over ground.
    pub fn predict_over_ground(&mut self, step: &PlanarStep, rates: &OwnRates, elapsed_s: f64) {
        self.advance(elapsed_s);
        // So far in the axes of the frame before.
        let before = self.place_m();
        [self.state[X], self.state[Z]] = step.place(before);
        [self.state[VX], self.state[VZ]] = step.direction(self.speed_m_s());
        // A yaw turns place and speed. The acceleration is along the axis, whichever way that turns:
        // who brakes ahead in a bend turns as we do.
        let (cosine, sine) = step.turn();
        let mut turn = Covariance::identity();
        for [right, ahead] in [[X, Z], [VX, VZ]] {
            (turn[(right, right)], turn[(right, ahead)]) = (cosine, sine);
            (turn[(ahead, right)], turn[(ahead, ahead)]) = (-sine, cosine);
        }
        self.p = turn * self.p * turn.transpose();
        let [right, both, ahead] = step.covariance_m2(before);
        self.p[(X, X)] += right;
        self.p[(Z, Z)] += ahead;
        self.p[(X, Z)] += both;
        self.p[(Z, X)] += both;
        self.bound();
        self.own_rate = rates.at(self.place_m());
    }

    /// Whether it goes across, and along no faster than a walker may.
    pub fn walks_across(&self) -> bool {
        let [across, along] = self.speed_m_s();
        let [across_sigma, along_sigma] = self.speed_sigma_m_s();
        let most_along = (2.0 * WALKER_SIGMA_M_S.hypot(along_sigma)).min(MAX_WALKER_M_S);
        across.abs() > WALKING_M_S.max(2.0 * across_sigma) && along.abs() < most_along
    }

    /// The same under the condition that it is a walker, whose speed along the axis is at most that of one.
    #[must_use]
    pub fn as_walker(mut self) -> Self {
        self.correct(&slopes([(VZ, 1.0)]), -self.state[VZ], WALKER_SIGMA_M_S * WALKER_SIGMA_M_S);
        self
    }

    /// What is known of the motion. `systematic_m`: standard deviation of the distance that the filter does not know of, in metres, which
    /// moves the place along its bearing.
    pub fn ground_motion(&self, movement: Movement, systematic_m: f64) -> GroundMotion {
        let along = Vector4::new(self.state[X] / self.state[Z], 1.0, 0.0, 0.0) * systematic_m;
        let covariance = self.p.fixed_view::<4, 4>(X, X) + along * along.transpose();
        let speed_m_s = if movement == Movement::Standing { [0.0; 2] } else { self.speed_m_s() };
        GroundMotion { speed_m_s, movement, ..GroundMotion::default() }.with_covariance(&covariance)
    }

    /// Closing speed of a standing thing at this place, in m/s; 0 while the own motion is unknown.
    pub fn own_closing_m_s(&self) -> f64 {
        -self.own_rate[1]
    }

    /// Whether the obstacle moves, with speeds over ground; `before` remains where the measurements do not tell.
    /// `aspect_m_s`: speed that a standing thing seems to have because another side of it comes into view; `width_m`: its width.
    pub fn movement(&self, before: Movement, aspect_m_s: f64, width_m: f64) -> Movement {
        let speed = self.state.fixed_rows::<2>(VX);
        let seeming_m_s = (STANDING_ACROSS_M_S + STANDING_SIDES_PER_S * width_m).min(STANDING_SPEED_M_S);
        let standing = |speed: f64| speed * speed + aspect_m_s * aspect_m_s;
        let covariance = self.p.fixed_view::<2, 2>(VX, VX)
            + Matrix2::new(standing(seeming_m_s), 0.0, 0.0, standing(STANDING_SPEED_M_S));
        let chi2 = covariance.try_inverse().map_or(0.0, |inverse| (speed.transpose() * inverse * speed).x);
        let [across_sigma, along_sigma] = self.speed_sigma_m_s();
        let most_along = MAX_STANDING_SIGMA_M_S.max(MAX_STANDING_SIGMA_SHARE * self.own_rate[1].abs());
        // Who walks is not said to stand while the errors are as large as his speed.
        let may_walk = speed[0].abs() + across_sigma / 2.0 >= WALKING_M_S + seeming_m_s.hypot(aspect_m_s);
        let is_known = across_sigma < MAX_STANDING_SIGMA_M_S && along_sigma < most_along;
        if chi2 > MOVING_CHI2 {
            Movement::Moving
        } else if chi2 < STANDING_CHI2 && is_known && !may_walk {
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
    use crate::tracking::filter::TrackFilter;
    use crate::tracking::filter::estimate::Model;

    /// Focal length × baseline, px·m.
    const SCALE: f64 = 105.5;
    const PERIOD_S: f64 = 0.08;

    /// Follows a thing that moves over ground with this velocity, from a place, while the vehicle drives a bend. Returns
    /// the filters with the speeds over ground in the axes of the camera at the end, and the true ones.
    fn follow(seed: u64, from: [f64; 2], velocity: [f64; 2]) -> (TrackFilter, [f64; 2], Movement) {
        let mut random = fastrand::Rng::with_seed(seed);
        let mut normal = || (0..12).map(|_| random.f64()).sum::<f64>() - 6.0;
        let truth = Motion { speed_m_s: 8.0, yaw_rate_rad_s: 0.3, ..Motion::default() };
        let body = Body::default();
        let exact = PlanarStep::of(&truth, &body, PERIOD_S);
        let (mut place, mut velocity) = (from, velocity);
        let measure = |place: [f64; 2], noise: f64| SCALE / place[1] + 0.12 * noise;
        let bearing = |place: [f64; 2], noise: f64| (place[0] + 0.1 * noise) / place[1];
        let first = ((measure(place, normal()), 0.12), (bearing(place, normal()), 0.1));
        let mut filter = TrackFilter::new(SCALE, first.0, first.1);
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
            if frame == 0 {
                filter.start_over_ground(&rates);
            }
            filter.predict_over_ground(&step, &rates, PERIOD_S);
            place = exact.place([place[0] + velocity[0] * PERIOD_S, place[1] + velocity[1] * PERIOD_S]);
            velocity = exact.direction(velocity);
            filter.measure_disparity(measure(place, normal()), 0.12);
            filter.measure_across([bearing(place, normal()) * place[1], place[1]], 0.1, true);
            movement = filter.movement(movement, 0.0, 0.5);
        }
        (filter, velocity, movement)
    }

    #[test]
    fn who_walks_across_is_told_as_slow_along() {
        let rates = OwnRates::of(&Motion { speed_m_s: 11.0, ..Motion::default() }, &Body::default());
        let crossing = |speed_m_s: Planar| {
            let mut filter = Estimate::new(Model::Steady, SCALE, (SCALE / 25.0, 0.1), (0.1, 0.05));
            filter.start_over_ground(&rates);
            (filter.state[VX], filter.state[VZ]) = (speed_m_s[0], speed_m_s[1]);
            (filter.p[(VX, VX)], filter.p[(VZ, VZ)]) = (0.09, 4.0);
            // What is in doubt is the speed along the line of sight.
            (filter.p[(VX, VZ)], filter.p[(VZ, VX)]) = (0.3, 0.3);
            filter
        };
        let walker = crossing([-1.0, 4.0]);
        assert!(walker.walks_across());
        let [across, along] = walker.as_walker().speed_m_s();
        assert!((1.0..2.0).contains(&along) && across < -1.1, "{across} {along}");
        assert!(walker.as_walker().speed_sigma_m_s()[1] < 1.5);
        // A motorcycle that comes towards us and of which little is known, a rider who turns off, and somebody who comes straight towards us.
        let mut young = crossing([-0.6, -12.0]);
        young.p[(VZ, VZ)] = 100.0;
        assert!(!young.walks_across());
        assert!(!crossing([-1.0, 7.0]).walks_across() && !crossing([-0.2, 1.0]).walks_across());
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
                let (filter, truth, movement) = follow(seed, [4.0, 26.0], velocity);
                let (speed, sigma) = (filter.speed_m_s(), filter.speed_sigma_m_s());
                for axis in 0..2 {
                    worst = worst.max((speed[axis] - truth[axis]).abs() / sigma[axis]);
                }
                right += i32::from(movement == expected);
            }
            println!(
                "{velocity:?} m/s, seeds 0 to 39: {right} of 40 {expected:?}, worst speed error {worst:.1} deviations"
            );
            assert!(worst < 5.0 && right >= 36, "{velocity:?}: {right} of 40, {worst}");
        }
    }

    /// What is said in 40 frames of a thing of this width that from a frame on moves across with this speed.
    fn movements(seed: u64, width_m: f64, from_frame: usize, speed_m_s: f64) -> Vec<Movement> {
        let mut random = fastrand::Rng::with_seed(seed);
        let mut normal = || (0..12).map(|_| random.f64()).sum::<f64>() - 6.0;
        let motion = Motion { speed_m_s: 10.0, speed_sigma_m_s: 0.1, ..Motion::default() };
        let body = Body::default();
        let (step, rates) = (PlanarStep::of(&motion, &body, PERIOD_S), OwnRates::of(&motion, &body));
        let mut place = [4.0, 45.0];
        let mut measure =
            |place: [f64; 2]| (SCALE / place[1] + 0.06 * normal(), place[0] / place[1] + 0.006 * normal());
        let (disparity, bearing) = measure(place);
        let mut filter = TrackFilter::new(SCALE, (disparity, 0.06), (bearing, 0.006 * place[1]));
        filter.start_over_ground(&rates);
        let mut movement = Movement::Unknown;
        let frames = (0..40).map(|frame| {
            filter.predict_over_ground(&step, &rates, PERIOD_S);
            let across_m_s = if frame < from_frame { 0.0 } else { speed_m_s };
            place = step.place([place[0] + across_m_s * PERIOD_S, place[1]]);
            let (disparity, bearing) = measure(place);
            filter.measure_disparity(disparity, 0.06);
            filter.measure_across([bearing * place[1], place[1]], 0.006 * place[1], true);
            movement = filter.movement(movement, 0.0, width_m);
            movement
        });
        frames.collect()
    }

    #[test]
    fn who_begins_to_walk_is_told_sooner_than_a_wall_whose_visible_part_changes() {
        let median = |width_m: f64| {
            let mut frames: Vec<usize> = (0..40)
                .map(|seed| {
                    let said = movements(seed, width_m, 15, -1.4);
                    said[15..].iter().position(|m| *m == Movement::Moving).unwrap_or(25)
                })
                .collect();
            frames.sort_unstable();
            frames[20]
        };
        let (person, car) = (median(0.6), median(1.8));
        println!("told to move after {person} frames of walking, a thing as wide as a car after {car}");
        assert!(person <= 11 && car > person, "{person} {car}");
    }

    #[test]
    fn who_walks_is_hardly_ever_said_to_stand_and_who_stands_is() {
        let standing = |speed_m_s: f64| {
            let said = (0..40).flat_map(|seed| movements(seed, 0.6, 0, speed_m_s));
            said.filter(|m| *m == Movement::Standing).count()
        };
        let (walks, stands) = (standing(-1.4), standing(0.0));
        println!("of 1600 frames said to stand: who walks {walks}, who stands {stands}");
        assert!(walks <= 16 && stands >= 1000, "{walks} {stands}");
    }

    #[test]
    fn a_standing_thing_closes_with_the_own_speed() {
        let (filter, _, _) = follow(1, [0.0, 26.0], [0.0, 0.0]);
        let free = filter.time_to_collision().unwrap();
        let standing = filter.standing_time_to_collision(0.1).unwrap();
        let truth = filter.distance_m() / filter.own_closing_m_s();
        assert!((standing.seconds - truth).abs() < 0.1 * truth, "{standing:?} {truth}");
        assert!(standing.sigma_s < 0.5 * free.sigma_s, "{standing:?} {free:?}");
    }

    #[test]
    fn speeds_over_ground_and_relative_ones_are_the_same_motion() {
        let mut filter = TrackFilter::new(SCALE, (SCALE / 20.0, 0.1), (0.1, 0.1));
        for frame in 1..8 {
            let (ahead, right) = (20.0 - 0.5 * f64::from(frame), 2.0 + 0.1 * f64::from(frame));
            filter.predict(PERIOD_S);
            filter.measure_disparity(SCALE / ahead, 0.1);
            filter.measure_across([right, ahead], 0.1, true);
        }
        let before = filter.rate();
        let motion = Motion { speed_m_s: 9.0, yaw_rate_rad_s: 0.2, ..Motion::default() };
        filter.begin_over_ground(&OwnRates::of(&motion, &Body::default()));
        let is_same = |rate: Planar| (rate[0] - before[0]).hypot(rate[1] - before[1]) < 1e-12;
        assert!(is_same(filter.rate()) && (filter.speed_m_s()[1] - before[1]).abs() > 1.0);
        filter.end_over_ground();
        assert!(is_same(filter.rate()) && filter.own_closing_m_s() == 0.0);
    }

    /// A cyclist crosses from the right border of the picture while the vehicle drives straight on: the line of sight is oblique, the
    /// errors of distance are those of the place across, too.
    #[test]
    fn what_comes_obliquely_has_one_error_along_the_line_of_sight() {
        let motion = Motion { speed_m_s: 12.0, speed_sigma_m_s: 0.1, ..Motion::default() };
        let body = Body::default();
        let (step, rates) = (PlanarStep::of(&motion, &body, PERIOD_S), OwnRates::of(&motion, &body));
        let velocity = [-5.0, 0.0];
        let (mut nees, mut worst) = (0.0, 0.0_f64);
        for seed in 0..40 {
            let mut random = fastrand::Rng::with_seed(seed);
            let mut normal = || (0..12).map(|_| random.f64()).sum::<f64>() - 6.0;
            let mut place = [10.0, 26.0];
            let mut measure = |place: [f64; 2]| {
                (
                    (SCALE / place[1] + 0.12 * normal(), 0.12),
                    (place[0] / place[1] + 0.003 * normal(), 0.003 * place[1]),
                )
            };
            let (disparity, bearing) = measure(place);
            let mut filter = TrackFilter::new(SCALE, disparity, bearing);
            filter.start_over_ground(&rates);
            for _ in 0..15 {
                filter.predict_over_ground(&step, &rates, PERIOD_S);
                place = step.place([place[0] + velocity[0] * PERIOD_S, place[1] + velocity[1] * PERIOD_S]);
                let (disparity, bearing) = measure(place);
                filter.measure_disparity(disparity.0, disparity.1);
                filter.measure_across([bearing.0 * place[1], place[1]], bearing.1, true);
            }
            let error = nalgebra::Vector4::new(
                filter.state[X] - place[0],
                filter.state[Z] - place[1],
                filter.state[VX] - velocity[0],
                filter.state[VZ] - velocity[1],
            );
            let inverse = filter.p.fixed_view::<4, 4>(X, X).into_owned().try_inverse().unwrap();
            nees += (error.transpose() * inverse * error).x / 40.0;
            worst = worst.max(error[2].abs());
            // The place is known better across the line of sight than along it.
            assert!(filter.p[(X, Z)] > 0.3 * (filter.p[(X, X)] * filter.p[(Z, Z)]).sqrt());
        }
        println!("a cyclist from the side: NEES {nees:.2} (4 expected), worst speed across {worst:.2} m/s");
        assert!((1.0..7.0).contains(&nees) && worst < 1.5, "{nees} {worst}");
    }
}
