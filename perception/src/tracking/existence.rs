//! Probability that the thing of a track exists.
//!
//! Integrated probabilistic data association (Musicki, Evans, Stankovic 1994) with evidence instead of densities: each look
//! at the place of a track multiplies the odds by a likelihood ratio. A sighting tells by its own evidence
//! ([`crate::region::Region::evidence`]) and by how well it agrees with the prediction, a look without a sighting by how much
//! of the thing should have been seen. While nobody can look, the thing may leave.
//!
//! The model of the paper takes looks as independent. Sightings of one structure are not: noise lasts, and what looks like an
//! obstacle in one frame does so in the next. Therefore a look counts by the time since the last one
//! ([`CORRELATION_S`]), and only so many independent looks are remembered ([`MEMORY_LOOKS`]): the odds are those before any
//! look, times those of the remembered looks. Everything is a rate per second; the frame rate does not matter.

use super::parameters::{BIRTH_PROBABILITY, CORRELATION_S, LEAVING_TIME_S, MAX_EVIDENCE, MEMORY_LOOKS};

/// Log-odds of a probability.
fn log_odds(probability: f64) -> f64 {
    (probability / (1.0 - probability)).ln()
}

/// Probability of existence.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Existence {
    /// Sum of the evidence of the looks that are remembered.
    evidence: f64,
}

impl Existence {
    /// After the first sighting.
    pub fn new(evidence: f64) -> Self {
        Self { evidence: evidence.min(MAX_EVIDENCE) }
    }

    /// Probability, 0 to 1.
    pub fn probability(self) -> f64 {
        1.0 / (1.0 + (-(log_odds(BIRTH_PROBABILITY) + self.evidence)).exp())
    }

    /// Whether it exists more probably than not.
    pub fn is_probable(self) -> bool {
        self.probability() >= 0.5
    }

    /// Whether less is known than before anything was seen.
    pub fn is_over(self) -> bool {
        self.evidence <= 0.0
    }

    /// Adds a look `elapsed_s` after the last one, with this evidence. `share`: how much of the thing could be seen, 0 to 1.
    pub fn look(&mut self, evidence: f64, share: f64, elapsed_s: f64) {
        let looks = share * (elapsed_s / CORRELATION_S).min(1.0);
        // Where the sum settles if all looks tell the same.
        let settled = MEMORY_LOOKS * evidence.min(MAX_EVIDENCE);
        self.evidence = settled + (self.evidence - settled) * (-looks / MEMORY_LOOKS).exp();
        self.leave((1.0 - share) * elapsed_s);
    }

    /// Nobody could look for so long, in seconds.
    fn leave(&mut self, seconds: f64) {
        if seconds > 0.0 {
            let stays = self.probability() * (-seconds / LEAVING_TIME_S).exp();
            self.evidence = log_odds(stays) - log_odds(BIRTH_PROBABILITY);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::detection::MIN_EVIDENCE;

    /// Seconds of sightings with this evidence until a probability is reached.
    fn seconds_to(probability: f64, evidence: f64, period_s: f64) -> Option<f64> {
        let mut existence = Existence::new(evidence);
        let mut seconds = 0.0;
        while existence.probability() < probability {
            existence.look(evidence, 1.0, period_s);
            seconds += period_s;
            if seconds > 20.0 {
                return None;
            }
        }
        Some(seconds)
    }

    /// Seconds without a sighting until a well known thing is given up.
    fn seconds_to_end(period_s: f64, share: f64) -> f64 {
        let mut existence = Existence::new(3.0);
        (0..40).for_each(|_| existence.look(3.0, 1.0, 0.1));
        let mut seconds = 0.0;
        while !existence.is_over() {
            existence.look(MIN_EVIDENCE, share, period_s);
            seconds += period_s;
        }
        seconds
    }

    #[test]
    fn existence_rises_and_falls_per_second_at_any_frame_rate() {
        for evidence in [1.3, 2.0, 2.6] {
            let [slow, middle, fast] =
                [0.1, 0.04, 0.01].map(|period| seconds_to(0.9, evidence, period).unwrap());
            assert!(
                (slow - fast).abs() <= 0.1 && (middle - fast).abs() <= 0.04,
                "{evidence}: {slow} {middle} {fast} s"
            );
        }
        let [slow, middle, fast] = [0.1, 0.04, 0.01].map(|period| seconds_to_end(period, 1.0));
        assert!((0.6..=1.6).contains(&fast), "{fast} s");
        assert!((slow - fast).abs() <= 0.25 && (middle - fast).abs() <= 0.15, "{slow} {middle} {fast} s");
    }

    #[test]
    fn strong_evidence_confirms_in_the_second_frame_and_never_in_the_first() {
        for period_s in [0.08, 0.1] {
            assert!(seconds_to(0.9, 50.0, period_s).unwrap() <= period_s + 1e-9);
        }
        assert!(Existence::new(1e6).probability() < 0.9);
    }

    #[test]
    fn weak_evidence_that_lasts_does_not_add_up_for_ever() {
        assert_eq!(seconds_to(0.9, 0.5, 0.1), None);
        assert_eq!(seconds_to(0.9, -1.0, 0.1), None);
        assert!(Existence::new(-1.0).is_over());
    }

    #[test]
    fn what_cannot_be_seen_stays_longer_than_what_is_missed() {
        let (missed, hidden) = (seconds_to_end(0.1, 1.0), seconds_to_end(0.1, 0.0));
        assert!(missed < 1.6 && hidden > 5.0, "{missed} {hidden} s");
        let mut existence = Existence::new(3.0);
        (0..40).for_each(|_| existence.look(3.0, 1.0, 0.1));
        (0..10).for_each(|_| existence.look(MIN_EVIDENCE, 0.0, 0.1));
        assert!(existence.probability() > 0.7, "{existence:?}");
    }
}
