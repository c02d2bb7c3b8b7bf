//! Classification of a track, accumulated over several runs of the recogniser.

/// Bound of the log-odds in either direction: a probability of 0.982. Looks at the same object from nearly the same place
/// are not independent, so their sum would claim more; and a class that turns out wrong is left after a few looks.
pub const MAX_LOG_ODDS: f64 = 4.0;

/// Number of classifications after which the class of a track counts as known.
pub(super) const MIN_CLASSIFICATIONS: u32 = 3;

/// Accumulated classification of a track.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Classification {
    /// Log-odds of the class, bounded.
    pub(super) log_odds: f64,
    pub(super) count: u32,
    /// Frames since the last classification.
    pub(super) frames_since: u32,
}

impl Classification {
    /// Nothing is known but how frequent the class is, in log-odds.
    pub(super) fn new(prior: f64) -> Self {
        Self { log_odds: bounded(prior), count: 0, frames_since: 0 }
    }

    /// Probability of the class if it is more likely than not, and something was looked at; else `None`.
    pub fn probability(&self) -> Option<f64> {
        // Rounding may leave a sum of votes that cancel beside zero.
        (self.count > 0 && self.log_odds > 1e-9).then(|| 1.0 / (1.0 + (-self.log_odds).exp()))
    }

    /// Adds the evidence of a look, in log-odds.
    pub(super) fn add(&mut self, evidence: f64) {
        self.log_odds = bounded(self.log_odds + evidence);
        self.count = self.count.saturating_add(1);
        self.frames_since = 0;
    }
}

fn bounded(log_odds: f64) -> f64 {
    log_odds.clamp(-MAX_LOG_ODDS, MAX_LOG_ODDS)
}
