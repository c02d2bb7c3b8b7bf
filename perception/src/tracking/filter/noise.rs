//! Random part of the error of one thing's measured distances.
//!
//! The error that detection states has a systematic part, which is the same in each frame: the steps of the matcher, and which part of
//! the thing is its near side. It shifts the distance and hardly changes a speed. The random part is often much smaller, as for the rear
//! of a car that is followed; for a hedge it is nearly the whole. It is estimated from the residuals (adaptive measurement noise:
//! Mehra, 1972), as a share of the stated variance.

use crate::tracking::parameters::{MIN_NOISE_SHARE, NOISE_SHARE_TIME_S};

/// Random error of one thing's measured distances.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct MeasurementNoise {
    /// Variance of the random error as a share of the stated variance, [`MIN_NOISE_SHARE`] to 1.
    share: f64,
    /// Time since the last measurement, in seconds.
    elapsed_s: f64,
}

impl Default for MeasurementNoise {
    /// As stated.
    fn default() -> Self {
        Self { share: 1.0, elapsed_s: 0.0 }
    }
}

impl MeasurementNoise {
    /// Standard deviation of the random error, given the stated standard deviation, in its unit.
    pub fn sigma(self, stated: f64) -> f64 {
        stated * self.share.sqrt()
    }

    /// So much time passes, in seconds.
    pub fn wait(&mut self, elapsed_s: f64) {
        self.elapsed_s += elapsed_s.max(0.0);
    }

    /// Takes in the square of what a measurement differs from the corrected state, plus the variance of that state, as a share of
    /// the stated variance. Its expected value is the share of the random error.
    pub fn observe(&mut self, squared: f64) {
        let gain = 1.0 - (-self.elapsed_s / NOISE_SHARE_TIME_S).exp();
        self.elapsed_s = 0.0;
        let share = self.share + gain * (squared - self.share);
        // A comparison with NaN is false: nothing is learned of it.
        if share >= 0.0 {
            self.share = share.clamp(MIN_NOISE_SHARE, 1.0);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_share_follows_the_scatter_within_its_bounds() {
        let settled = |squared: f64| {
            let mut noise = MeasurementNoise::default();
            for _ in 0..100 {
                noise.wait(0.08);
                noise.observe(squared);
            }
            noise.sigma(2.0) / 2.0
        };
        assert!((settled(0.49) - 0.7).abs() < 0.01);
        assert_eq!((settled(0.0), settled(9.0)), (MIN_NOISE_SHARE.sqrt(), 1.0));
        let mut noise = MeasurementNoise::default();
        noise.wait(0.08);
        noise.observe(f64::NAN);
        assert_eq!(noise, MeasurementNoise::default());
    }
}
