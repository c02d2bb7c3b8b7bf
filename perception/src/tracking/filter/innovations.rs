//! What the innovations of one measured quantity tell: outliers, steps and bias.

use crate::tracking::parameters::{CUSUM_DECAY, CUSUM_THRESHOLD, OUTLIER_SIGMAS, STEP_FRAMES};

/// Smallest variance of a measurement, in m².
const MIN_NOISE: f64 = 1e-8;

/// Consecutive outliers of the same sign.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct OutlierRun {
    first: f64,
    last: f64,
    frames: u8,
    /// Number of the last outliers that agree with each other.
    similar: u8,
}

impl OutlierRun {
    /// Adds an outlier; two agree if they differ by less than `tolerance`.
    fn with(self, innovation: f64, tolerance: f64) -> Self {
        if self.frames == 0 || self.last * innovation < 0.0 {
            return Self { first: innovation, last: innovation, frames: 1, similar: 1 };
        }
        let is_similar = (innovation - self.last).abs() < tolerance;
        Self {
            first: self.first,
            last: innovation,
            frames: self.frames.saturating_add(1),
            similar: if is_similar { self.similar.saturating_add(1) } else { 1 },
        }
    }
}

/// What to do with a measurement.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Judgement {
    /// Correct the state by it, with this variance: that of an outlier is larger, so that a single bad frame has little effect.
    Measurement { noise: f64 },
    /// Several outliers that agree are a step of what is measured: set the place, keep the speed. Several that grow mean another
    /// speed, of which nothing is known.
    Step { noise: f64, grows: bool },
}

/// The innovations of one measured quantity.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Innovations {
    /// CUSUM statistic of the normalised innovations, with exponential forgetting.
    cusum: f64,
    outliers: OutlierRun,
}

impl Innovations {
    /// Takes in an innovation of which the state explains `variance` and the measurement `noise`.
    pub fn judge(&mut self, innovation: f64, variance: f64, noise: f64) -> Judgement {
        let mut noise = noise.max(MIN_NOISE);
        let sigmas = innovation / (variance + noise).sqrt();
        if sigmas.abs() > OUTLIER_SIGMAS {
            self.outliers = self.outliers.with(innovation, 2.0 * (2.0 * noise).sqrt());
            let grows = innovation.abs() - self.outliers.first.abs() > OUTLIER_SIGMAS * noise.sqrt();
            if self.outliers.frames >= STEP_FRAMES && grows || self.outliers.similar >= STEP_FRAMES {
                *self = Self::default();
                return Judgement::Step { noise, grows };
            }
            noise = (innovation / OUTLIER_SIGMAS).powi(2) * sigmas.abs() / OUTLIER_SIGMAS;
        } else {
            self.outliers = OutlierRun::default();
        }
        self.cusum = CUSUM_DECAY * self.cusum + sigmas.clamp(-OUTLIER_SIGMAS, OUTLIER_SIGMAS);
        Judgement::Measurement { noise }
    }

    /// Whether the CUSUM test detects a bias.
    pub fn are_biased(&self) -> bool {
        self.cusum.abs() > CUSUM_THRESHOLD
    }

    /// Whether the last measurement was an outlier.
    pub fn is_outlier(&self) -> bool {
        self.outliers.frames > 0
    }
}
