//! Image disturbances of a real rig, applied to the right image only, to test the robustness of a matcher.

use std::str::FromStr;

/// A disturbance of an 8-bit grey image.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Disturbance {
    /// Different exposure: every value × `factor`.
    Gain {
        /// Positive.
        factor: f64,
    },
    /// Different response curve: 255 × (value ÷ 255)^`exponent`.
    Gamma {
        /// Positive; below 1 brightens.
        exponent: f64,
    },
    /// Gaussian noise, reproducible.
    Noise {
        /// Standard deviation in grey levels.
        sigma: f64,
        /// Seed of the noise.
        seed: u64,
    },
    /// Defocus: a Gaussian blur.
    Blur {
        /// Standard deviation in px.
        sigma_px: f64,
    },
    /// Misalignment: the content moves up by part of a row, linearly interpolated.
    Vertical {
        /// 0 to 1 px.
        shift_px: f64,
    },
}

/// Rounds to a grey level.
fn level(value: f64) -> u8 {
    value.round().clamp(0.0, 255.0) as u8
}

impl Disturbance {
    /// The names accepted by the parser.
    pub const NAMES: [&str; 5] = ["gain", "gamma", "noise", "blur", "vertical"];

    /// Name of the disturbance.
    pub fn name(self) -> &'static str {
        match self {
            Self::Gain { .. } => "gain",
            Self::Gamma { .. } => "gamma",
            Self::Noise { .. } => "noise",
            Self::Blur { .. } => "blur",
            Self::Vertical { .. } => "vertical",
        }
    }

    /// The disturbed image: `width` × `height` values, row-major.
    ///
    /// # Panics
    /// When the image is empty or has another size.
    pub fn apply(self, image: &[u8], width: usize, height: usize) -> Vec<u8> {
        assert!(width > 0 && image.len() == width * height && height > 0);
        match self {
            Self::Gain { factor } => image.iter().map(|&v| level(f64::from(v) * factor)).collect(),
            Self::Gamma { exponent } => {
                image.iter().map(|&v| level(255.0 * (f64::from(v) / 255.0).powf(exponent))).collect()
            }
            Self::Noise { sigma, seed } => image
                .iter()
                .enumerate()
                .map(|(i, &v)| level(f64::from(v) + sigma * normal(seed, i as u64)))
                .collect(),
            Self::Blur { sigma_px } => blur(image, width, height, sigma_px),
            Self::Vertical { shift_px } => (0..image.len())
                .map(|i| {
                    // The last row is replicated below the image.
                    let below = if i + width < image.len() { i + width } else { i };
                    level(f64::from(image[i]) * (1.0 - shift_px) + f64::from(image[below]) * shift_px)
                })
                .collect(),
        }
    }
}

/// Parses a name. Strengths are those that a robust matcher should tolerate: gain 0.7, gamma 0.6, noise of
/// 5 grey levels, blur of 1 px, half a row.
impl FromStr for Disturbance {
    type Err = String;

    fn from_str(name: &str) -> Result<Self, String> {
        Ok(match name {
            "gain" => Self::Gain { factor: 0.7 },
            "gamma" => Self::Gamma { exponent: 0.6 },
            "noise" => Self::Noise { sigma: 5.0, seed: 1 },
            "blur" => Self::Blur { sigma_px: 1.0 },
            "vertical" => Self::Vertical { shift_px: 0.5 },
            _ => return Err(format!("no disturbance \"{name}\": give one of {}", Self::NAMES.join(", "))),
        })
    }
}

/// A standard normal value, determined by seed and index (Box and Muller).
fn normal(seed: u64, index: u64) -> f64 {
    let uniform = |k: u64| {
        let key = seed.wrapping_mul(0x9e37_79b9_7f4a_7c15).wrapping_add(2 * index + k + 1);
        let bits = sources::scene::texture::hash(key.wrapping_mul(0x9e37_79b9_7f4a_7c15)) >> 11;
        // In (0, 1], so that the logarithm is finite.
        (bits as f64 + 1.0) / (1_u64 << 53) as f64
    };
    (-2.0 * uniform(0).ln()).sqrt() * (std::f64::consts::TAU * uniform(1)).cos()
}

/// A separable Gaussian truncated at three standard deviations, with replicated borders.
fn blur(image: &[u8], width: usize, height: usize, sigma_px: f64) -> Vec<u8> {
    let radius = (3.0 * sigma_px).ceil() as i64;
    let weight = |k: i64| (-0.5 * (k as f64 / sigma_px).powi(2)).exp();
    let total: f64 = (-radius..=radius).map(weight).sum();
    let kernel: Vec<(i64, f64)> = (-radius..=radius).map(|k| (k, weight(k) / total)).collect();
    let clamp = |at: i64, side: usize| at.clamp(0, side as i64 - 1) as usize;
    let rows: Vec<f64> = (0..image.len())
        .map(|i| {
            let (x, start) = ((i % width) as i64, i - i % width);
            kernel.iter().map(|&(k, w)| w * f64::from(image[start + clamp(x + k, width)])).sum()
        })
        .collect();
    (0..image.len())
        .map(|i| {
            let (x, y) = (i % width, (i / width) as i64);
            level(kernel.iter().map(|&(k, w)| w * rows[clamp(y + k, height) * width + x]).sum())
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn apply(name: &str, image: &[u8], width: usize) -> Vec<u8> {
        name.parse::<Disturbance>().unwrap().apply(image, width, image.len() / width)
    }

    #[test]
    fn names_lead_back_to_themselves() {
        for name in Disturbance::NAMES {
            assert_eq!(name.parse::<Disturbance>().unwrap().name(), name);
        }
        assert!("fog".parse::<Disturbance>().unwrap_err().contains("gain, gamma"));
    }

    #[test]
    fn each_does_what_it_says() {
        assert_eq!(apply("gain", &[0, 100, 255], 3), [0, 70, 179]);
        // 255 × (64 ÷ 255)^0.6 = 111.2.
        assert_eq!(apply("gamma", &[0, 64, 255], 3), [0, 111, 255]);
        assert_eq!(apply("vertical", &[10, 20, 30, 40, 50, 60], 2), [20, 30, 40, 50, 50, 60]);
        let mut spot = vec![0; 11 * 11];
        spot[5 * 11 + 5] = 255;
        let blurred = apply("blur", &spot, 11);
        // The centre of a Gaussian of 1 px has 0.3991² of the total; one pixel off: × exp(−1/2).
        assert_eq!((blurred[5 * 11 + 5], blurred[5 * 11 + 6], blurred[4 * 11 + 5]), (41, 25, 25));
        assert_eq!(apply("blur", &[77; 30], 6), [77; 30]);
    }

    #[test]
    fn noise_is_normal_and_the_same_every_time() {
        let image = vec![128; 40_000];
        let noisy = apply("noise", &image, 200);
        assert_eq!(noisy, apply("noise", &image, 200));
        let values: Vec<f64> = noisy.iter().map(|&v| f64::from(v) - 128.0).collect();
        let mean = values.iter().sum::<f64>() / values.len() as f64;
        let variance = values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / values.len() as f64;
        assert!(mean.abs() < 0.1 && (variance.sqrt() - 5.0).abs() < 0.1, "{mean} {variance}");
        let near = values.iter().filter(|v| v.abs() < 5.5).count() as f64 / values.len() as f64;
        assert!((near - 0.729).abs() < 0.02, "{near}");
        // Neighbouring values are uncorrelated.
        let product = values.windows(2).map(|p| p[0] * p[1]).sum::<f64>() / values.len() as f64;
        assert!(product.abs() < 0.4, "{product}");
    }
}
