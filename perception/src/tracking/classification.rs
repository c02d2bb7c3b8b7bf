//! Classification of a track, accumulated over several runs of the recogniser.

use crate::recognition::MAX_CLASSES;

/// Bound of the log-odds in either direction: a probability of 0.982. Looks at the same object from nearly the same place
/// are not independent, so their sum would claim more; and a class that turns out wrong is left after a few looks.
pub const MAX_LOG_ODDS: f64 = 4.0;

/// Number of classifications after which the class of a track counts as known.
pub(super) const MIN_CLASSIFICATIONS: u32 = 3;

/// Accumulated classification of a track.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Classification {
    /// Log-odds of each class of the recogniser, bounded.
    pub(super) log_odds: [f64; MAX_CLASSES],
    pub(super) count: u32,
    /// Frames since the last classification.
    pub(super) frames_since: u32,
}

impl Classification {
    /// Nothing is known but how frequent each class is, in log-odds.
    pub(super) fn new(prior: f64) -> Self {
        Self { log_odds: [bounded(prior); MAX_CLASSES], count: 0, frames_since: 0 }
    }

    /// Probability of a class, by its number below [`MAX_CLASSES`], if it is more likely than not, and something was looked
    /// at; else `None`.
    pub fn probability(&self, class: usize) -> Option<f64> {
        let log_odds = *self.log_odds.get(class)?;
        // Rounding may leave a sum of votes that cancel beside zero.
        (self.count > 0 && log_odds > 1e-9).then(|| 1.0 / (1.0 + (-log_odds).exp()))
    }

    /// Adds the evidence of a look for each class, in log-odds.
    pub(super) fn add(&mut self, evidence: [f64; MAX_CLASSES]) {
        for (log_odds, evidence) in self.log_odds.iter_mut().zip(evidence) {
            *log_odds = bounded(*log_odds + evidence);
        }
        self.count = self.count.saturating_add(1);
        self.frames_since = 0;
    }
}

fn bounded(log_odds: f64) -> f64 {
    log_odds.clamp(-MAX_LOG_ODDS, MAX_LOG_ODDS)
}
