//! Sensor model: from light to the bytes of one camera.

use super::texture::hash;
use serde::Deserialize;

/// Sensor parameters; each camera of the pair has its own.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Sensor {
    /// Factor on all grey values.
    pub gain: f32,
    /// Black level, in grey levels.
    pub offset: f32,
    /// Standard deviation of the dark noise, in grey levels.
    pub noise: f32,
    /// Shot noise: standard deviation at grey value 255.
    pub shot_noise: f32,
}

impl Default for Sensor {
    fn default() -> Self {
        Self { gain: 1.0, offset: 0.0, noise: 0.8, shot_noise: 1.2 }
    }
}

/// Number of quantiles of the normal distribution.
const STEPS: usize = 256;

/// Quantiles of the normal distribution at 256 equally likely steps.
#[derive(Debug)]
pub struct Normal {
    quantiles: [f32; STEPS],
}

impl Default for Normal {
    fn default() -> Self {
        let mut quantiles = [0.0; STEPS];
        for (k, quantile) in quantiles.iter_mut().enumerate() {
            let wanted = (k as f64 + 0.5) / STEPS as f64;
            // Bisection on the distribution function, which is summed from its density.
            let below = |x: f64| {
                let steps = 400;
                let width = (x + 8.0) / f64::from(steps);
                let density = |t: f64| (-t * t / 2.0).exp() / (std::f64::consts::TAU).sqrt();
                (0..steps).map(|i| density(-8.0 + (f64::from(i) + 0.5) * width) * width).sum::<f64>()
            };
            let (mut low, mut high) = (-4.0, 4.0);
            for _ in 0..24 {
                let middle = (low + high) / 2.0;
                if below(middle) < wanted { low = middle } else { high = middle }
            }
            *quantile = ((low + high) / 2.0) as f32;
        }
        Self { quantiles }
    }
}

impl Sensor {
    /// Converts light to grey values. `seed` selects the noise; it differs between cameras and between
    /// frames.
    pub fn expose(&self, normal: &Normal, seed: u64, light: &[f32], grey: &mut [u8]) {
        let shot = self.shot_noise * self.shot_noise / 255.0;
        let dark = self.noise * self.noise;
        for ((chunk, out), k) in light.chunks(8).zip(grey.chunks_mut(8)).zip(0_u64..) {
            let mut bits = hash(seed ^ k.wrapping_mul(0x9e37_79b9_7f4a_7c15));
            for (&light, grey) in chunk.iter().zip(out) {
                let value = light * self.gain + self.offset;
                let sigma = (dark + shot * value.max(0.0)).sqrt();
                let value = value + sigma * normal.quantiles[(bits & 255) as usize];
                bits >>= 8;
                *grey = (value + 0.5).clamp(0.0, 255.0) as u8;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn noise_is_normal_and_of_its_seed() {
        let normal = Normal::default();
        let sensor = Sensor { gain: 0.9, offset: 4.0, noise: 3.0, shot_noise: 6.0 };
        let light = vec![100.0_f32; 40_000];
        let (mut a, mut b) = (vec![0; light.len()], vec![0; light.len()]);
        sensor.expose(&normal, 1, &light, &mut a);
        let mean = a.iter().map(|&v| f64::from(v)).sum::<f64>() / a.len() as f64;
        let variance = a.iter().map(|&v| (f64::from(v) - mean).powi(2)).sum::<f64>() / a.len() as f64;
        assert!((mean - 94.0).abs() < 0.1, "{mean}");
        // Rounding adds 1/12.
        let expected = 9.0 + 36.0 * 94.0 / 255.0 + 1.0 / 12.0;
        assert!((variance / expected - 1.0).abs() < 0.05, "{variance} {expected}");
        sensor.expose(&normal, 1, &light, &mut b);
        assert_eq!(a, b);
        sensor.expose(&normal, 2, &light, &mut b);
        assert_ne!(a, b);
    }
}
