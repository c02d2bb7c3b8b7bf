//! Curvature of the vehicle's path from speed and yaw rate.
//!
//! Yaw rate over speed is the curvature of the rear axle's path. Its error grows as the speed falls, and at walking pace
//! it is noise; the driver's hands move slowly. The curvature is therefore filtered: a random walk that follows the
//! steering, corrected by each measurement with its own error. Below [`MIN_SPEED_M_S`] the last curvature is kept, with
//! an error that grows.

use super::Motion;
use super::body::Body;
use super::path::{EdgesAhead, MAX_CURVATURE_PER_M, STEERING_M_S2, SweptPath};
use crate::road::edge_curve::EdgeCurve;

/// Speed from which the curvature is measured, in m/s: below it an error of 0.005 rad/s is more than a radius of 300 m.
pub const MIN_SPEED_M_S: f64 = 1.5;

/// Largest standard deviation of the curvature, in 1/m: nothing is known but the turning circle.
const MAX_SIGMA_PER_M: f64 = MAX_CURVATURE_PER_M / 2.0;

/// Arc length from the rear axle from which the path follows the road's edges, in metres ahead of the camera: nearer, the
/// wheels already decide.
const EDGES_FROM_M: f64 = 3.0;
/// Memory of the road's curvature, in seconds: its noise must not swing the path, and a road bends within seconds.
const ROAD_MEMORY_S: f64 = 0.4;
/// Standard deviation of what a driver changes of the lateral acceleration to follow a road, in m/s².
const FOLLOWING_M_S2: f64 = 1.0;
/// Error of the road's curvature beyond that of its edges, in 1/m: a road is no parabola.
const ROAD_SIGMA_PER_M: f64 = 0.003;
/// Road and own path agree within this many standard deviations; else the vehicle leaves the road.
const AGREEMENT_SIGMAS: f64 = 3.0;

/// Yaw rate of a driver's steady corrections on a straight road, in rad/s, and of the road's own unevenness: they are over
/// before the vehicle is there.
const CORRECTIONS_RAD_S: f64 = 0.03;

/// The part of a yaw rate that lasts, in rad/s: nearly nothing of a correction, nearly all of a bend.
fn lasting_rad_s(yaw_rate_rad_s: f64) -> f64 {
    let square = yaw_rate_rad_s * yaw_rate_rad_s;
    yaw_rate_rad_s * square / (square + CORRECTIONS_RAD_S * CORRECTIONS_RAD_S)
}

/// Yaw acceleration of a driver's corrections, in rad/s²; more begins or ends a turn.
const CORRECTING_RAD_S2: f64 = 0.15;
/// For how long a turn goes on to begin, in seconds.
const TURNING_IN_S: f64 = 0.4;

/// What the yaw rate will change by, in rad/s, as a turn begins or ends.
fn coming_rad_s(motion: &Motion) -> f64 {
    let acceleration = motion.yaw_acceleration_rad_s2;
    let turning_in = (acceleration.abs() - CORRECTING_RAD_S2).max(0.0);
    turning_in.copysign(acceleration) * TURNING_IN_S
}

/// Whether a turn begins: the yaw rate grows faster than by a driver's corrections.
fn is_turning_in(motion: &Motion) -> bool {
    coming_rad_s(motion) * motion.yaw_rate_rad_s > 0.0
}

/// Filters the curvature; start anew after a gap.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct CurvatureFilter {
    curvature_per_m: f64,
    /// Variance; `None` before the first measurement.
    variance: Option<f64>,
    /// Smoothed curvature of the road ahead, while its edges are seen.
    road_per_m: Option<f64>,
}

impl CurvatureFilter {
    /// The path farther ahead: the weighted mean of the own curvature, which the driver may change, and the road's.
    fn edges_ahead(&self, speed: f64, sigma: f64, body: &Body, road: EdgeCurve) -> Option<EdgesAhead> {
        let own2 = sigma * sigma + (FOLLOWING_M_S2 / (speed * speed)).powi(2);
        let road2 = road.sigma_per_m * road.sigma_per_m + ROAD_SIGMA_PER_M * ROAD_SIGMA_PER_M;
        let difference = road.curvature_per_m - self.curvature_per_m;
        let curvature = self.curvature_per_m + difference * own2 / (own2 + road2);
        (difference * difference <= AGREEMENT_SIGMAS * AGREEMENT_SIGMAS * (own2 + road2)).then_some(
            EdgesAhead {
                from_m: body.rear_axle_m.max(0.0) + EDGES_FROM_M,
                curvature_per_m: curvature.clamp(-MAX_CURVATURE_PER_M, MAX_CURVATURE_PER_M),
            },
        )
    }

    /// The path at this motion, `elapsed_s` seconds after the last call; `road` is the curvature of the road ahead, if its
    /// edges are seen.
    pub fn update(
        &mut self,
        motion: &Motion,
        elapsed_s: f64,
        body: Body,
        road: Option<EdgeCurve>,
    ) -> SweptPath {
        let body = body.during(motion);
        let speed = motion.speed_m_s.abs().max(MIN_SPEED_M_S);
        let walk = STEERING_M_S2 / (speed * speed);
        let highest = MAX_SIGMA_PER_M * MAX_SIGMA_PER_M;
        let before = self.variance.map_or(highest, |v| (v + walk * walk * elapsed_s.max(0.0)).min(highest));
        self.variance = Some(before);
        // Backwards the same wheel angle turns the other way, and the path behind is no path ahead.
        if motion.speed_m_s >= MIN_SPEED_M_S {
            let measured = (lasting_rad_s(motion.yaw_rate_rad_s) + coming_rad_s(motion)) / motion.speed_m_s;
            let noise =
                (motion.yaw_rate_sigma_rad_s / speed).hypot(measured * motion.speed_sigma_m_s / speed);
            let noise = (noise * noise).max(1e-12);
            let gain = before / (before + noise);
            self.curvature_per_m += gain * (measured - self.curvature_per_m);
            self.variance = Some((1.0 - gain) * before);
        }
        self.curvature_per_m = self.curvature_per_m.clamp(-MAX_CURVATURE_PER_M, MAX_CURVATURE_PER_M);
        let sigma = self.variance.unwrap_or(highest).sqrt();
        let road = road.map(|road| {
            let gain = 1.0 - (-elapsed_s.max(0.0) / ROAD_MEMORY_S).exp();
            let before = self.road_per_m.unwrap_or(road.curvature_per_m);
            EdgeCurve { curvature_per_m: before + gain * (road.curvature_per_m - before), ..road }
        });
        self.road_per_m = road.map(|road| road.curvature_per_m);
        let path = SweptPath {
            curvature_per_m: self.curvature_per_m,
            curvature_sigma_per_m: sigma,
            speed_m_s: motion.speed_m_s,
            speed_sigma_m_s: motion.speed_sigma_m_s,
            body,
            edges: road.and_then(|road| self.edges_ahead(speed, sigma, &body, road)),
            is_turning_in: is_turning_in(motion),
        };
        // At rest nothing is swept: what comes straight to the body counts, wherever the wheels point.
        if path.is_at_rest() {
            return SweptPath {
                curvature_per_m: 0.0,
                curvature_sigma_per_m: 0.0,
                edges: None,
                is_turning_in: false,
                ..path
            };
        }
        path
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PERIOD_S: f64 = 0.1;

    fn motion(speed_m_s: f64, yaw_rate_rad_s: f64) -> Motion {
        Motion {
            speed_m_s,
            speed_sigma_m_s: 0.1,
            yaw_rate_rad_s,
            yaw_rate_sigma_rad_s: 0.005,
            ..Motion::default()
        }
    }

    #[test]
    fn the_curvature_follows_a_driver_and_states_its_error() {
        let mut random = fastrand::Rng::with_seed(3);
        let mut normal = || (0..12).map(|_| random.f64()).sum::<f64>() - 6.0;
        let mut filter = CurvatureFilter::default();
        let (mut squares, mut frames) = (0.0, 0);
        for frame in 0..200 {
            // Into a bend of 50 m and out of it, within 2 s each.
            let time = PERIOD_S * f64::from(frame);
            let truth = 0.02 * (time * 0.8).sin();
            let noisy = motion(9.0 + 0.1 * normal(), 9.0 * truth + 0.005 * normal());
            let path = filter.update(&noisy, PERIOD_S, Body::default(), None);
            if frame >= 10 {
                squares += ((path.curvature_per_m - truth) / path.curvature_sigma_per_m).powi(2);
                frames += 1;
            }
        }
        let nees = squares / f64::from(frames);
        println!("curvature of a bend of 50 m at 9 m/s: NEES {nees:.2}");
        // Above 1: a driver who keeps swinging the wheel is no random walk.
        assert!((0.3..5.0).contains(&nees), "{nees}");
    }

    #[test]
    fn the_path_follows_a_road_that_bends_and_leaves_one_that_it_turns_off() {
        let road = |curvature_per_m: f64| Some(EdgeCurve { curvature_per_m, sigma_per_m: 0.003 });
        let mut filter = CurvatureFilter::default();
        filter.update(&motion(10.0, 0.0), PERIOD_S, Body::default(), None);
        let bends = filter.update(&motion(10.0, 0.0), PERIOD_S, Body::default(), road(0.015));
        let ahead = bends.edges.unwrap();
        assert!((0.012..0.015).contains(&ahead.curvature_per_m), "{ahead:?}");
        assert!(bends.curvature_per_m.abs() < 1e-3);
        // In a junction the road goes straight on.
        for _ in 0..5 {
            filter.update(&motion(5.0, 0.6), PERIOD_S, Body::default(), None);
        }
        let turns = filter.update(&motion(8.0, 1.0), PERIOD_S, Body::default(), road(0.0));
        assert_eq!(turns.edges, None);
    }

    #[test]
    fn a_turn_begins_while_the_yaw_rate_grows() {
        let mut filter = CurvatureFilter::default();
        let mut path = |yaw_rate_rad_s, yaw_acceleration_rad_s2| {
            let motion = Motion { yaw_acceleration_rad_s2, ..motion(10.0, yaw_rate_rad_s) };
            filter.update(&motion, PERIOD_S, Body::default(), None)
        };
        for side in [1.0, -1.0] {
            assert!(path(0.05 * side, 0.3 * side).is_turning_in);
            // A correction, a steady bend, the end of one.
            assert!(!path(0.02 * side, 0.1 * side).is_turning_in);
            assert!(!path(0.3 * side, 0.0).is_turning_in);
            assert!(!path(0.2 * side, -0.3 * side).is_turning_in);
        }
        let at_rest = Motion { yaw_acceleration_rad_s2: 0.3, ..motion(0.0, 0.05) };
        assert!(!filter.update(&at_rest, PERIOD_S, Body::default(), None).is_turning_in);
    }

    #[test]
    fn at_walking_pace_noise_bends_no_path() {
        let mut filter = CurvatureFilter::default();
        for _ in 0..20 {
            filter.update(&motion(8.0, 0.0), PERIOD_S, Body::default(), None);
        }
        let driving = filter.update(&motion(8.0, 0.0), PERIOD_S, Body::default(), None);
        let mut slow = driving;
        for frame in 0..30 {
            let noise = if frame % 2 == 0 { 0.02 } else { -0.01 };
            slow = filter.update(&motion(0.8, noise), PERIOD_S, Body::default(), None);
            assert!(slow.curvature_per_m.abs() < 1e-3, "{slow:?}");
        }
        assert!(slow.curvature_sigma_per_m > 10.0 * driving.curvature_sigma_per_m);
        // At the limit of the turning circle.
        let path = CurvatureFilter::default().update(&motion(2.0, 2.0), PERIOD_S, Body::default(), None);
        assert_eq!(path.curvature_per_m, MAX_CURVATURE_PER_M);
        assert!(path.curvature_sigma_per_m.is_finite());
    }
}
