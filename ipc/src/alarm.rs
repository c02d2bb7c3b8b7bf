//! Levels and rules of the alarm, and the self-checks that switch it off: part of `obstacles` and `status`.

use std::fmt;

/// Names of the levels, indexed by their numbers in messages.
pub const LEVELS: [&str; 4] = ["off", "clear", "warning", "alarm"];

/// The level `off`: a self-check failed, so the system cannot judge.
pub const OFF: u32 = 0;

/// The level `clear`: all self-checks pass and no rule applies.
pub const CLEAR: u32 = 1;

/// The level `alarm`.
pub const ALARM: u32 = 3;

/// Names of the rules, indexed by their numbers in messages.
pub const RULES: [&str; 4] = ["none", "distance", "time_to_collision", "deceleration"];

/// Whether an obstacle moves over ground, by number. Unknown is what the vehicle's own motion or the measurements do not
/// tell.
pub const MOVING: [&str; 3] = ["unknown", "standing", "moving"];

/// Name of a level; an unknown number counts as `off`.
pub fn level_name(level: u32) -> &'static str {
    LEVELS.get(level as usize).copied().unwrap_or(LEVELS[0])
}

/// Name of a rule; `None` for no rule or an unknown number.
pub fn rule_name(rule: u32) -> Option<&'static str> {
    RULES.get(rule as usize).copied().filter(|_| rule > 0)
}

/// Name of a state of motion; an unknown number counts as `unknown`.
pub fn moving_name(moving: u32) -> &'static str {
    MOVING.get(moving as usize).copied().unwrap_or(MOVING[0])
}

/// Self-checks that failed, one bit each. Any of them switches the alarm off.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Faults(pub u32);

impl Faults {
    /// All self-checks passed.
    pub const NONE: Self = Self(0);
    /// No road was detected.
    pub const NO_ROAD: Self = Self(1);
    /// An image is too dark.
    pub const DARK: Self = Self(1 << 1);
    /// An image is too bright.
    pub const BRIGHT: Self = Self(1 << 2);
    /// An image has no contrast: the camera is covered, fogged or out of focus.
    pub const BLOCKED: Self = Self(1 << 3);
    /// The contrast of the left and the right image differs too much.
    pub const UNLIKE: Self = Self(1 << 4);
    /// The rows of both images differ so much that matching suffers, after any correction.
    pub const CALIBRATION: Self = Self(1 << 5);
    /// The road has too little texture to be matched.
    pub const SPARSE: Self = Self(1 << 6);
    /// The frame is older than `alarm.frame_age_max_ms`.
    pub const OLD: Self = Self(1 << 7);
    /// A stage is not running.
    pub const STAGE: Self = Self(1 << 8);
    /// There has been no result for longer than `pacing.stale_ms`.
    pub const STALE: Self = Self(1 << 9);

    /// The time of the source stands still or jumps too often.
    pub const TIME: Self = Self(1 << 10);
    /// The images are no pair: swapped, the same, or with rows far apart.
    pub const PAIRING: Self = Self(1 << 11);
    /// A camera shows the same picture again while the vehicle moves.
    pub const FROZEN: Self = Self(1 << 12);
    /// All self-checks.
    pub const ALL: Self = Self((1 << DESCRIPTIONS.len()) - 1);

    /// Whether all self-checks passed.
    pub fn is_none(self) -> bool {
        self.0 == 0
    }

    /// Whether any of `other` failed.
    pub fn has(self, other: Self) -> bool {
        self.0 & other.0 != 0
    }

    /// The union of both.
    #[must_use]
    pub fn and(self, other: Self) -> Self {
        Self(self.0 | other.0)
    }

    /// Every self-check with its description, in the order of display.
    pub fn each() -> impl Iterator<Item = (Self, &'static str)> {
        DESCRIPTIONS.into_iter()
    }

    /// The descriptions of those that failed, in the order of display. A bit that this version does not know is a failed
    /// self-check, too.
    pub fn descriptions(self) -> impl Iterator<Item = &'static str> {
        let unknown = (self.0 & !Self::ALL.0 != 0).then_some("a self-check failed");
        Self::each().filter(move |(fault, _)| self.has(*fault)).map(|(_, text)| text).chain(unknown)
    }

    /// `self` if `failed`, else none.
    #[must_use]
    pub fn when(self, failed: bool) -> Self {
        if failed { self } else { Self::NONE }
    }
}

/// Description of each self-check, in the order of display.
const DESCRIPTIONS: [(Faults, &str); 13] = [
    (Faults::STAGE, "a stage is not running"),
    (Faults::STALE, "no result for too long"),
    (Faults::OLD, "the frame is too old"),
    (Faults::TIME, "the time of the source stands still, jumps, or steps by more than a second"),
    (Faults::FROZEN, "a camera shows the same picture again and again"),
    (Faults::DARK, "the picture is too dark"),
    (Faults::BRIGHT, "the picture is too bright"),
    (Faults::BLOCKED, "the picture shows nothing: is a camera covered?"),
    (Faults::UNLIKE, "left and right picture are too unlike"),
    (Faults::PAIRING, "the pictures are no pair: swapped, the same, or their rows far apart"),
    (Faults::CALIBRATION, "the rows of the pictures differ, and matches are lost: calibrate again"),
    (Faults::SPARSE, "too little texture on the road"),
    (Faults::NO_ROAD, "no road seen"),
];

impl fmt::Display for Faults {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (i, description) in self.descriptions().enumerate() {
            f.write_str(if i > 0 { "; " } else { "" })?;
            f.write_str(description)?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn faults_have_descriptions() {
        assert_eq!(Faults::NONE.to_string(), "");
        let two = Faults::NO_ROAD.and(Faults::DARK.when(true)).and(Faults::OLD.when(false));
        assert_eq!(two.to_string(), "the picture is too dark; no road seen");
        assert_eq!(two.descriptions().collect::<Vec<_>>(), ["the picture is too dark", "no road seen"]);
        assert!(two.has(Faults::NO_ROAD) && !two.has(Faults::OLD) && !two.is_none());
        assert_eq!(Faults(1 << 30).to_string(), "a self-check failed");
        for (bit, (fault, _)) in DESCRIPTIONS.iter().enumerate() {
            assert!(DESCRIPTIONS.iter().skip(bit + 1).all(|(other, _)| !fault.has(*other)), "{fault} twice");
        }
        assert_eq!((level_name(ALARM), level_name(OFF), level_name(99)), ("alarm", "off", "off"));
        assert_eq!((rule_name(2), rule_name(0), rule_name(9)), (Some("time_to_collision"), None, None));
    }
}
