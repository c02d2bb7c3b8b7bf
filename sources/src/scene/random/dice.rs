//! Random choices by a seed, the same on every machine.

use crate::scene::texture::{hash, unit};

/// A sequence of random choices.
#[derive(Clone, Debug)]
pub struct Dice {
    key: u64,
    count: u64,
}

impl Dice {
    /// The choices of a seed for a purpose: each purpose has its own, so that a change of one leaves the others.
    pub fn new(seed: u64, purpose: &str) -> Self {
        let key =
            purpose.bytes().fold(hash(seed ^ 0x7a11_5eed), |key, byte| hash(key ^ u64::from(byte) << 17));
        Self { key, count: 0 }
    }

    /// A number in [0, 1).
    fn unit(&mut self) -> f64 {
        self.count += 1;
        unit(self.key ^ hash(self.count))
    }

    /// A number between two, in steps of 1 cm, 1 cm/s and so on.
    pub fn between(&mut self, from: f64, to: f64) -> f64 {
        ((from + (to - from) * self.unit()) * 100.0).round() / 100.0
    }

    /// Whether something happens that has this probability.
    pub fn chance(&mut self, probability: f64) -> bool {
        self.unit() < probability
    }

    /// A whole number from `from` to `to`, both included.
    pub fn whole(&mut self, from: usize, to: usize) -> usize {
        from + ((to - from + 1) as f64 * self.unit()) as usize
    }

    /// One of these.
    pub fn pick<T: Copy>(&mut self, choices: &[T]) -> T {
        choices[((choices.len() as f64 * self.unit()) as usize).min(choices.len() - 1)]
    }

    /// One of these, by weight.
    pub fn weighted<T: Copy>(&mut self, choices: &[(T, f64)]) -> T {
        let all: f64 = choices.iter().map(|(_, weight)| weight).sum();
        let mut left = self.unit() * all;
        for (choice, weight) in choices {
            left -= weight;
            if left < 0.0 {
                return *choice;
            }
        }
        choices[choices.len() - 1].0
    }
}
