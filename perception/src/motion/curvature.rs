//! Curvature of the vehicle's path from speed and yaw rate.
//!
//! Yaw rate over speed is the curvature of the rear axle's path. Its error grows as the speed falls, and at walking pace
//! it is noise; the driver's hands move slowly. The curvature is therefore filtered: a random walk that follows the
//! steering, corrected by each measurement with its own error. Below [`MIN_SPEED_M_S`] the last curvature is kept, with
//! an error that grows.

use super::Motion;
use super::body::Body;
use super::path::{EdgesAhead, MAX_CURVATURE_PER_M, STEERING_M_S2, SweptPath};

/// Speed from which the curvature is measured, in m/s: below it an error of 0.005 rad/s is more than a radius of 300 m.
pub const MIN_SPEED_M_S: f64 = 1.5;

/// Largest standard deviation of the curvature, in 1/m: nothing is known but the turning circle.
const MAX_SIGMA_PER_M: f64 = MAX_CURVATURE_PER_M / 2.0;

/// Filters the curvature; start anew after a gap.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct CurvatureFilter {
    curvature_per_m: f64,
    /// Variance; `None` before the first measurement.
    variance: Option<f64>,
}

impl CurvatureFilter {
    /// The path at this motion, `elapsed_s` seconds after the last call.
    pub fn update(
        &mut self,
        motion: &Motion,
        elapsed_s: f64,
        body: Body,
        edges: Option<EdgesAhead>,
    ) -> SweptPath {
        let speed = motion.speed_m_s.abs().max(MIN_SPEED_M_S);
        let walk = STEERING_M_S2 / (speed * speed);
        let highest = MAX_SIGMA_PER_M * MAX_SIGMA_PER_M;
        let before = self.variance.map_or(highest, |v| (v + walk * walk * elapsed_s.max(0.0)).min(highest));
        self.variance = Some(before);
        // Backwards the same wheel angle turns the other way, and the path behind is no path ahead.
        if motion.speed_m_s >= MIN_SPEED_M_S {
            let measured = motion.yaw_rate_rad_s / motion.speed_m_s;
            let noise =
                (motion.yaw_rate_sigma_rad_s / speed).hypot(measured * motion.speed_sigma_m_s / speed);
            let noise = (noise * noise).max(1e-12);
            let gain = before / (before + noise);
            self.curvature_per_m += gain * (measured - self.curvature_per_m);
            self.variance = Some((1.0 - gain) * before);
        }
        self.curvature_per_m = self.curvature_per_m.clamp(-MAX_CURVATURE_PER_M, MAX_CURVATURE_PER_M);
        let path = SweptPath {
            curvature_per_m: self.curvature_per_m,
            curvature_sigma_per_m: self.variance.unwrap_or(highest).sqrt(),
            speed_m_s: motion.speed_m_s,
            speed_sigma_m_s: motion.speed_sigma_m_s,
            body,
            edges,
        };
        // At rest nothing is swept: what comes straight to the body counts, wherever the wheels point.
        if path.is_at_rest() {
            return SweptPath { curvature_per_m: 0.0, curvature_sigma_per_m: 0.0, edges: None, ..path };
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
