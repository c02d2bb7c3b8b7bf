//! What was wrong with the time of the source: part of `report` and `status`.

use crate::range::{COUNT, ranges};
use bytemuck::{Pod, Zeroable};
use std::fmt;

/// Counts of what was wrong with the time of the source, and of obstacles that meant nothing: in a report since the stage
/// started, in a status since the daemon started.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
pub struct SourceTimeRecord {
    /// Number of gaps, after which tracks and alarm started anew.
    pub gaps: u64,
    /// Number of steps back, after which tracks and alarm started anew.
    pub steps_back: u64,
    /// Number of frames with the time of the frame before, which added nothing.
    pub repeats: u64,
    /// Number of obstacles that were dropped, because their numbers were not finite or beyond what can be measured.
    pub dropped_obstacles: u64,
}

ranges! {
    SourceTimeRecord as "source time" {
        gaps: COUNT,
        steps_back: COUNT,
        repeats: COUNT,
        dropped_obstacles: COUNT,
    }
}

impl SourceTimeRecord {
    /// The names and values of all counts.
    pub fn counts(&self) -> [(&'static str, u64); 4] {
        let Self { gaps, steps_back, repeats, dropped_obstacles } = *self;
        [
            ("gap", gaps),
            ("step_back", steps_back),
            ("repeat", repeats),
            ("dropped_obstacle", dropped_obstacles),
        ]
    }

    /// The sum of both.
    #[must_use]
    pub fn plus(&self, other: &Self) -> Self {
        Self {
            gaps: self.gaps.saturating_add(other.gaps),
            steps_back: self.steps_back.saturating_add(other.steps_back),
            repeats: self.repeats.saturating_add(other.repeats),
            dropped_obstacles: self.dropped_obstacles.saturating_add(other.dropped_obstacles),
        }
    }
}

/// The counts in words; empty if all are zero.
impl fmt::Display for SourceTimeRecord {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if *self == Self::default() {
            return Ok(());
        }
        let Self { gaps, steps_back, repeats, dropped_obstacles } = self;
        write!(
            f,
            "{gaps} gaps, {steps_back} steps back, {repeats} repeats, {dropped_obstacles} obstacles dropped"
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn counts_add_up_and_are_told_in_words() {
        let one = SourceTimeRecord { gaps: 2, repeats: u64::MAX, ..SourceTimeRecord::default() };
        assert_eq!(SourceTimeRecord::default().to_string(), "");
        let two = one.plus(&one);
        assert_eq!((two.gaps, two.repeats), (4, u64::MAX));
        assert!(one.to_string().starts_with("2 gaps, 0 steps back"), "{one}");
        assert_eq!(one.counts()[0], ("gap", 2));
    }
}
