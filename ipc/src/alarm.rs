//! The words of the alarm: its levels, its rules, and why it cannot judge. Part of `obstacles` and `status`.

use std::fmt;

/// Names of the levels, by their number in messages.
pub const LEVELS: [&str; 4] = ["off", "standby", "warning", "alarm"];

/// The number of the level `off`: it cannot judge.
pub const OFF: u32 = 0;

/// The number of the level `standby`: it judges, and nothing is dangerous.
pub const STANDBY: u32 = 1;

/// The number of the level `alarm`.
pub const ALARM: u32 = 3;

/// Names of the rules, by their number in messages.
pub const RULES: [&str; 4] = ["none", "distance", "time_to_collision", "deceleration"];

/// The name of a level; what is no level counts as `off`.
pub fn level_name(level: u32) -> &'static str {
    LEVELS.get(level as usize).copied().unwrap_or(LEVELS[0])
}

/// The name of a rule; `None` for none.
pub fn rule_name(rule: u32) -> Option<&'static str> {
    RULES.get(rule as usize).copied().filter(|_| rule > 0)
}

/// Self-checks that failed, each a bit: any of them turns the alarm off.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Faults(pub u32);

impl Faults {
    /// None.
    pub const NONE: Self = Self(0);
    /// No road is seen.
    pub const NO_ROAD: Self = Self(1);
    /// A picture is too dark.
    pub const DARK: Self = Self(1 << 1);
    /// A picture is too bright.
    pub const BRIGHT: Self = Self(1 << 2);
    /// A picture shows nothing: covered, fogged, out of focus.
    pub const BLOCKED: Self = Self(1 << 3);
    /// The left and the right picture are too unlike.
    pub const UNLIKE: Self = Self(1 << 4);
    /// The cameras have moved since they were calibrated.
    pub const CALIBRATION: Self = Self(1 << 5);
    /// Too little of the road can be matched.
    pub const SPARSE: Self = Self(1 << 6);
    /// The frame is too old.
    pub const OLD: Self = Self(1 << 7);
    /// A stage is not running.
    pub const STAGE: Self = Self(1 << 8);
    /// No result has come for too long.
    pub const STALE: Self = Self(1 << 9);

    /// Whether all self-checks passed.
    pub fn is_none(self) -> bool {
        self.0 == 0
    }

    /// Whether one of `other` is among these.
    pub fn has(self, other: Self) -> bool {
        self.0 & other.0 != 0
    }

    /// These and those.
    #[must_use]
    pub fn and(self, other: Self) -> Self {
        Self(self.0 | other.0)
    }

    /// These when `failed`, else none.
    #[must_use]
    pub fn when(self, failed: bool) -> Self {
        if failed { self } else { Self::NONE }
    }
}

/// The words for each bit.
const WORDS: [(Faults, &str); 10] = [
    (Faults::STAGE, "a stage is not running"),
    (Faults::STALE, "no result for too long"),
    (Faults::OLD, "the frame is too old"),
    (Faults::DARK, "the picture is too dark"),
    (Faults::BRIGHT, "the picture is too bright"),
    (Faults::BLOCKED, "the picture shows nothing: is a camera covered?"),
    (Faults::UNLIKE, "left and right picture are too unlike"),
    (Faults::CALIBRATION, "the cameras have moved: calibrate again"),
    (Faults::SPARSE, "too little texture on the road"),
    (Faults::NO_ROAD, "no road seen"),
];

impl fmt::Display for Faults {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut first = true;
        for (fault, words) in WORDS {
            if self.has(fault) {
                f.write_str(if first { "" } else { "; " })?;
                f.write_str(words)?;
                first = false;
            }
        }
        // A bit that this program does not know still means that something failed.
        if first && !self.is_none() { f.write_str("a self-check failed") } else { Ok(()) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn faults_are_told_in_words() {
        assert_eq!(Faults::NONE.to_string(), "");
        let two = Faults::NO_ROAD.and(Faults::DARK.when(true)).and(Faults::OLD.when(false));
        assert_eq!(two.to_string(), "the picture is too dark; no road seen");
        assert!(two.has(Faults::NO_ROAD) && !two.has(Faults::OLD) && !two.is_none());
        assert_eq!(Faults(1 << 30).to_string(), "a self-check failed");
        for (bit, (fault, _)) in WORDS.iter().enumerate() {
            assert!(WORDS.iter().skip(bit + 1).all(|(other, _)| !fault.has(*other)), "{fault} twice");
        }
        assert_eq!((level_name(ALARM), level_name(OFF), level_name(99)), ("alarm", "off", "off"));
        assert_eq!((rule_name(2), rule_name(0), rule_name(9)), (Some("time_to_collision"), None, None));
    }
}
