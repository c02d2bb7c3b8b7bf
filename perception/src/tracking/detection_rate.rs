//! How often what is there is seen: the detection probability of the present conditions.
//!
//! In the sun nearly every look shows an obstacle, in heavy rain every second one does. What a missed sighting tells depends on
//! that, so it is measured on the tracks that probably exist: the share of their visible parts that was seen, over some
//! seconds.

use super::parameters::{
    DETECTION_PROBABILITY, DETECTION_PROBABILITY_BOUNDS, DETECTION_PROBABILITY_LOOKS,
    DETECTION_PROBABILITY_TIME_S,
};

/// Measures the detection probability.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct DetectionRate {
    /// Looks that should have shown something, and those that did; older ones count less.
    expected: f64,
    seen: f64,
}

impl DetectionRate {
    /// Lets older looks count less.
    pub fn age(&mut self, elapsed_s: f64) {
        let kept = (-elapsed_s / DETECTION_PROBABILITY_TIME_S).exp();
        (self.expected, self.seen) = (kept * self.expected, kept * self.seen);
    }

    /// Adds a look at something of which this share should be seen, 0 to 1.
    pub fn look(&mut self, share: f64, is_seen: bool) {
        self.expected += share;
        self.seen += if is_seen { share } else { 0.0 };
    }

    /// Probability that what is there is seen.
    pub fn probability(&self) -> f64 {
        let prior = DETECTION_PROBABILITY * DETECTION_PROBABILITY_LOOKS;
        let (least, most) = DETECTION_PROBABILITY_BOUNDS;
        ((prior + self.seen) / (DETECTION_PROBABILITY_LOOKS + self.expected)).clamp(least, most)
    }

    /// Evidence of a look that does not show what should be seen: the logarithm of how probable that is, if it is there.
    pub fn miss_evidence(&self) -> f64 {
        (1.0 - self.probability()).ln()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_miss_tells_much_where_all_is_seen_and_little_in_the_rain() {
        let evidence = |seen_of_ten: u32| {
            let mut rate = DetectionRate::default();
            for look in 0..1000_u32 {
                rate.age(0.02);
                rate.look(1.0, look % 10 < seen_of_ten);
            }
            rate.miss_evidence()
        };
        let start = DetectionRate::default().miss_evidence();
        assert!((start - crate::detection::MIN_EVIDENCE).abs() < 0.1, "{start}");
        assert!(evidence(10) < -2.0 && evidence(4) > -0.7, "{} {}", evidence(10), evidence(4));
        assert!(evidence(0) < -0.2, "bounded: {}", evidence(0));
        let mut rate = DetectionRate::default();
        (0..100).for_each(|_| rate.look(1.0, true));
        rate.age(60.0);
        assert!((rate.miss_evidence() - start).abs() < 0.01, "forgotten after a minute");
    }
}
