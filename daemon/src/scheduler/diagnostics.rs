//! Conditions that make the daemon degraded, each with its reason.

/// A condition that makes the daemon degraded, in descending order of importance, which is the order of the reasons.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Condition {
    /// A stage was given up and does not run yet.
    GivenUp,
    /// The source cannot be read, or gives no pairs.
    Source,
    /// Results are late.
    Late,
    /// The board is too hot, or its sensors or clocks fail.
    Board,
    /// The epipolar alignment is degraded.
    Calibration,
    /// The device of the matcher is lost.
    Device,
}

impl Condition {
    /// Whether it counts only while frames are processed: while a stage restarts, its last value is out of date.
    fn needs_frames(self) -> bool {
        matches!(self, Self::Late | Self::Board | Self::Calibration | Self::Device)
    }
}

/// The active conditions.
#[derive(Clone, Debug, Default)]
pub struct Diagnostics {
    active: Vec<(Condition, String)>,
}

impl Diagnostics {
    /// Activates a condition with a reason, or clears it (`None`). Returns whether that changes anything.
    pub fn set(&mut self, condition: Condition, reason: Option<&str>) -> bool {
        let place = self.active.iter().position(|(c, _)| *c == condition);
        match (place, reason) {
            (None, None) => return false,
            (Some(place), None) => {
                self.active.remove(place);
            }
            (Some(place), Some(reason)) => {
                let text = &mut self.active[place].1;
                if text == reason {
                    return false;
                }
                text.clear();
                text.push_str(reason);
            }
            (None, Some(reason)) => {
                self.active.push((condition, reason.to_owned()));
                self.active.sort_by_key(|(c, _)| *c);
            }
        }
        true
    }

    /// Whether the daemon is degraded. Without `frames_pass`, conditions that need frames are ignored.
    pub fn is_degraded(&self, frames_pass: bool) -> bool {
        self.active.iter().any(|(c, _)| frames_pass || !c.needs_frames())
    }

    /// All reasons, the most important first.
    pub fn reason(&self) -> String {
        let texts: Vec<&str> = self.active.iter().map(|(_, text)| &text[..]).collect();
        texts.join("; ")
    }
}

/// Finds out that a failed source has recovered.
#[derive(Clone, Copy, Debug, Default)]
pub struct SourceRecovery {
    /// Process of the source and its number of pairs when the source failed.
    failed: Option<(u32, u64)>,
}

impl SourceRecovery {
    /// Takes a report of the source's process. Returns whether the source has recovered since it failed, once. Only a pair
    /// shows that: a source also stops failing when it ends, is restarted, or is held back.
    pub fn take(&mut self, pid: u32, pairs: u64, is_failing: bool) -> bool {
        if is_failing {
            self.failed.get_or_insert((pid, pairs));
            return false;
        }
        // A restarted process counts from zero.
        let is_over = self.failed.is_some_and(|(of, before)| pairs > if of == pid { before } else { 0 });
        if is_over {
            self.failed = None;
        }
        is_over
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_a_pair_shows_that_the_source_has_recovered() {
        let mut source = SourceRecovery::default();
        assert!(!source.take(7, 0, false) && !source.take(7, 1, false), "it never failed");
        assert!(!source.take(7, 1, true));
        assert!(!source.take(7, 1, false), "held back, or stopped: no pair came");
        // The report of the pair itself still has the old health.
        assert!(!source.take(7, 2, true) && source.take(7, 2, false));
        assert!(!source.take(7, 3, false), "said once");
        assert!(!source.take(7, 3, true) && !source.take(8, 0, false), "restarted");
        assert!(source.take(8, 1, false));
        let mut silent = SourceRecovery::default();
        assert!(!silent.take(7, 0, true) && !silent.take(7, 0, false), "stopped before the first pair");
    }

    #[test]
    fn conditions_are_set_and_cleared_independently() {
        let mut diagnostics = Diagnostics::default();
        assert!(!diagnostics.set(Condition::Source, None) && !diagnostics.is_degraded(true));
        assert!(diagnostics.set(Condition::Late, Some("late")));
        assert!(diagnostics.is_degraded(true) && !diagnostics.is_degraded(false));
        assert!(diagnostics.set(Condition::Source, Some("a.png is missing")));
        assert!(!diagnostics.set(Condition::Source, Some("a.png is missing")), "unchanged");
        assert!(diagnostics.is_degraded(false));
        assert_eq!(diagnostics.reason(), "a.png is missing; late");
        assert!(diagnostics.set(Condition::Source, Some("b.png is missing")));
        assert!(diagnostics.set(Condition::Late, None));
        assert_eq!(diagnostics.reason(), "b.png is missing");
    }
}
