//! A Kalman filter over disparity and its rate.
//!
//! It runs in disparity space because there the noise of stereo is even; distance noise grows with
//! the square of the distance.

/// State and covariance of (disparity in px, rate in px/s).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DisparityFilter {
    disparity: f64,
    rate: f64,
    /// Covariance: disparity², disparity·rate, rate².
    p: [f64; 3],
}

/// First guess of the rate's spread, as a share of the disparity per second: 0.7/s is 14 m/s of
/// closing speed at 20 m.
const RATE_SHARE: f64 = 0.7;

/// Spread of changes of the rate, as a share of the disparity per s²: a braking of 5 m/s² at
/// 20 m is 0.25.
const AGILITY_SHARE: f64 = 0.25;

/// Below this, in px, nothing is told from infinity.
const LEAST_DISPARITY: f64 = 0.05;

impl DisparityFilter {
    /// Starts at a first measurement.
    pub fn new(disparity_px: f64, sigma_px: f64) -> Self {
        let rate_sigma = RATE_SHARE * disparity_px;
        Self { disparity: disparity_px, rate: 0.0, p: [sigma_px * sigma_px, 0.0, rate_sigma * rate_sigma] }
    }

    /// Moves on by `elapsed_s` seconds at constant closing speed: z falls evenly, so d = f·B/z
    /// grows faster and faster. With s = ḋ·t/d and u = 1 − s: d ← d/u, ḋ ← ḋ/u².
    pub fn predict(&mut self, elapsed_s: f64) {
        let t = elapsed_s;
        let (d, rate) = (self.disparity, self.rate);
        // Half the distance in one step: nearer than that the model ends.
        let s = (rate * t / d).clamp(-1.0, 0.5);
        let u = 1.0 - s;
        self.disparity = (d / u).max(LEAST_DISPARITY);
        self.rate = rate / (u * u);
        // Jacobian rows of (d, ḋ).
        let (j00, j01) = ((1.0 - 2.0 * s) / (u * u), t / (u * u));
        let (j10, j11) = (-2.0 * rate * rate * t / (d * d * u * u * u), (1.0 + s) / (u * u * u));
        let [a, b, c] = self.p;
        let q = (AGILITY_SHARE * self.disparity).powi(2);
        self.p = [
            j00 * j00 * a + 2.0 * j00 * j01 * b + j01 * j01 * c + q * t.powi(4) / 4.0,
            j00 * j10 * a + (j00 * j11 + j01 * j10) * b + j01 * j11 * c + q * t.powi(3) / 2.0,
            j10 * j10 * a + 2.0 * j10 * j11 * b + j11 * j11 * c + q * t * t,
        ];
    }

    /// Takes in a measurement with its standard deviation.
    pub fn update(&mut self, disparity_px: f64, sigma_px: f64) {
        let [a, b, c] = self.p;
        let spread = a + (sigma_px * sigma_px).max(1e-6);
        let (gain, rate_gain) = (a / spread, b / spread);
        let surprise = disparity_px - self.disparity;
        self.disparity = (self.disparity + gain * surprise).max(LEAST_DISPARITY);
        self.rate += rate_gain * surprise;
        self.p = [(1.0 - gain) * a, (1.0 - gain) * b, c - rate_gain * b];
    }

    /// Disparity, in pixels, above zero.
    pub fn disparity_px(&self) -> f64 {
        self.disparity
    }

    /// One standard deviation of the disparity, in pixels.
    pub fn sigma_px(&self) -> f64 {
        self.p[0].max(0.0).sqrt()
    }

    /// Change of the disparity, in pixels per second; above zero while it comes nearer.
    pub fn rate_px_s(&self) -> f64 {
        self.rate
    }

    /// One standard deviation of the rate, in pixels per second.
    pub fn rate_sigma_px_s(&self) -> f64 {
        self.p[2].max(0.0).sqrt()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_constant_closing_speed_is_learned_without_lag() {
        // The paper's rig: f·B = 105.5 px·m; from 45 m at 15 m/s to 4 m.
        let disparity = |z: f64| 105.5 / z;
        let mut filter = DisparityFilter::new(disparity(45.0), 0.15);
        let mut z = 45.0;
        while z > 4.0 {
            z -= 15.0 * 0.08;
            filter.predict(0.08);
            filter.update(disparity(z), 0.15);
            if z < 15.0 {
                let ttc = filter.disparity_px() / filter.rate_px_s();
                assert!((ttc - z / 15.0).abs() < 0.1 * z / 15.0, "{ttc} s at {z} m");
                assert!((105.5 / filter.disparity_px() - z).abs() < 0.1, "at {z} m");
            }
        }
    }

    #[test]
    fn what_stands_still_has_no_rate() {
        let mut filter = DisparityFilter::new(5.0, 0.2);
        for i in 0..60 {
            filter.predict(0.08);
            filter.update(5.0 + if i % 2 == 0 { 0.1 } else { -0.1 }, 0.2);
        }
        assert!(filter.rate_px_s().abs() < 0.2 && filter.sigma_px() < 0.2, "{filter:?}");
    }

    #[test]
    fn the_uncertainty_grows_without_measurements_and_stays_sound() {
        let mut filter = DisparityFilter::new(5.0, 0.2);
        filter.update(5.0, 0.0);
        let before = filter.sigma_px();
        for _ in 0..1000 {
            filter.predict(0.5);
        }
        assert!(filter.sigma_px() > before);
        assert!(filter.disparity_px() > 0.0);
        filter.update(3.0, 0.2);
        assert!(filter.disparity_px().is_finite() && filter.sigma_px().is_finite());
    }
}
