//! A network that looks at regions, with its memory.

use super::graph::{Network, Operator};
use super::layer::{Value, clip, convolve, pool};
use super::properties::ClassSize;
use super::sample::{Rectangle, Sampler};
use crate::image::GreyView;
use crate::simd::Level;

/// Added to the standard deviation of a region's grey levels before they are divided by it: less contrast is noise.
pub const MIN_CONTRAST: f32 = 8.0;

/// Classifies regions with a network; memory is allocated once.
#[derive(Clone, Debug)]
pub struct NetworkRecogniser {
    network: Network,
    level: Level,
    values: Vec<Value>,
    padded: Vec<f32>,
    sampler: Sampler,
    log_odds: Vec<f32>,
}

impl NetworkRecogniser {
    /// A recogniser for crops of at most `width` × `height` pixels.
    pub fn new(network: Network, width: usize, height: usize) -> Self {
        Self {
            level: Level::best(),
            values: network.shapes.iter().map(|&shape| Value::new(shape)).collect(),
            padded: Vec::with_capacity(network.padded),
            sampler: Sampler::new(width, height),
            log_odds: vec![0.0; network.labels().len()],
            network,
        }
    }

    /// The same on another instruction set.
    #[must_use]
    pub fn with_level(mut self, level: Level) -> Self {
        self.level = level;
        self
    }

    /// The sizes of the classes.
    pub fn sizes(&self) -> &[ClassSize] {
        self.network.sizes()
    }

    /// Names of the classes.
    pub fn labels(&self) -> &[String] {
        self.network.labels()
    }

    /// The log-odds of each class of what lies in a region of the image.
    pub fn classify(&mut self, image: GreyView<'_>, region: Rectangle) -> &[f32] {
        let from = region.grown(self.network.margin());
        let input = &mut self.values[0].numbers;
        self.sampler.sample(image, from, self.network.input(), input);
        normalise(input);
        self.run();
        let output = &self.values[self.network.output].numbers;
        log_odds(&output[..self.log_odds.len()], &mut self.log_odds);
        &self.log_odds
    }

    /// The output for an input that is normalised already, which has as many numbers as the input.
    pub fn output(&mut self, input: &[f32]) -> &[f32] {
        let own = &mut self.values[0].numbers;
        let count = own.len().min(input.len());
        own[..count].copy_from_slice(&input[..count]);
        self.run();
        &self.values[self.network.output].numbers[..self.log_odds.len()]
    }

    fn run(&mut self) {
        let Self { network, level, values, padded, .. } = self;
        for step in &network.steps {
            // A value is computed from others, or limited in its place.
            let empty = Value::new(super::layer::Shape::default());
            let mut to = std::mem::replace(&mut values[step.to], empty);
            let from = &values[step.from[0]];
            match &step.operator {
                Operator::Convolution(layer) => convolve(*level, layer, from, padded, &mut to),
                Operator::Pool(pooling, windows) => pool(*pooling, windows, from, &mut to),
                Operator::Add => {
                    let pairs = from.numbers.iter().zip(&values[step.from[1]].numbers);
                    for (out, (a, b)) in to.numbers.iter_mut().zip(pairs) {
                        *out = a + b;
                    }
                }
                Operator::Clip(range) => {
                    if step.from[0] != step.to {
                        to.numbers.copy_from_slice(&from.numbers);
                    }
                    clip(*range, &mut to.numbers);
                }
            }
            values[step.to] = to;
        }
    }
}

/// Takes the mean from grey levels and divides them by their standard deviation.
fn normalise(levels: &mut [f32]) {
    let count = levels.len().max(1) as f32;
    let mean = levels.iter().sum::<f32>() / count;
    levels.iter_mut().for_each(|v| *v -= mean);
    let variance = levels.iter().map(|v| v * v).sum::<f32>() / count;
    let scale = 1.0 / (variance.sqrt() + MIN_CONTRAST);
    levels.iter_mut().for_each(|v| *v *= scale);
}

/// The log-odds of each class from the logarithms of all, up to a common summand.
fn log_odds(logits: &[f32], out: &mut [f32]) {
    for (i, out) in out.iter_mut().enumerate() {
        let others = logits.iter().enumerate().filter(|(k, _)| *k != i).map(|(_, &v)| v);
        let most = others.clone().fold(f32::MIN, f32::max);
        let sum: f32 = others.map(|v| (v - most).exp()).sum();
        let value = logits[i] - most - sum.ln();
        *out = if value.is_finite() { value } else { 0.0 };
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn log_odds_are_those_of_the_softmax() {
        let logits = [1.0_f32, -2.0, 0.5, 3.0];
        let sum: f32 = logits.iter().map(|v| v.exp()).sum();
        let mut out = [0.0; 4];
        log_odds(&logits, &mut out);
        for (found, logit) in out.iter().zip(logits) {
            let p = logit.exp() / sum;
            assert!((found - (p / (1.0 - p)).ln()).abs() < 1e-5, "{found}");
        }
        log_odds(&[f32::NAN, 1.0], &mut out[..2]);
        assert_eq!(out[..2], [0.0, 0.0]);
    }

    #[test]
    fn light_and_contrast_do_not_matter() {
        let levels: Vec<f32> = (0..64).map(|i| ((i * 37) % 64) as f32 * 3.0).collect();
        let mut plain = levels.clone();
        normalise(&mut plain);
        let mut brighter: Vec<f32> = levels.iter().map(|v| v + 40.0).collect();
        normalise(&mut brighter);
        assert!(plain.iter().zip(&brighter).all(|(a, b)| (a - b).abs() < 1e-4));
        let mut flat = vec![90.0; 64];
        normalise(&mut flat);
        assert!(flat.iter().all(|v| *v == 0.0));
    }
}
