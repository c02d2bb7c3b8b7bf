//! How much the measured distances of one thing really scatter.
//!
//! Detection states an error that contains what is the same in each frame: the steps of the matcher, and which part of the thing is its
//! near side. Such an error shifts the distance and hardly changes a speed. What scatters from frame to frame is often much less, as
//! of the rear of a car that is followed, and of a hedge it is as much as stated. It is estimated from the residuals (Mehra, 1972), as
//! a share of the stated variance.

use crate::tracking::parameters::{MIN_NOISE_SHARE, NOISE_SHARE_TIME_S};

/// Scatter of one thing's measured distances.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct MeasurementNoise {
    /// Share of the stated variance, [`MIN_NOISE_SHARE`] to 1.
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
    /// Standard deviation of what scatters, of a stated one.
    pub fn sigma(self, stated: f64) -> f64 {
        stated * self.share.sqrt()
    }

    /// So much time passes, in seconds.
    pub fn wait(&mut self, elapsed_s: f64) {
        self.elapsed_s += elapsed_s.max(0.0);
    }

    /// Takes in the square of what a measurement differs from the corrected state, plus the variance of that state, as a share of
    /// the stated variance. Its mean is the share that scatters.
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
