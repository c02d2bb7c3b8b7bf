//! What is wrong while the daemon goes on: each condition by itself, with its reason.

/// Something that makes the daemon degraded. The order is that of weight: it is how reasons are told.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Condition {
    /// A stage was given up, and has not come back yet.
    GivenUp,
    /// The source cannot be read, or brings nothing.
    Source,
    /// Results come later than they may.
    Late,
    /// The board is too hot, or its sensors or clocks fail.
    Board,
    /// The cameras do not stand as they were calibrated.
    Calibration,
    /// The device that matched is lost.
    Device,
}

impl Condition {
    /// Whether it counts only while frames flow: a stage that starts anew has nothing to be late with.
    fn needs_frames(self) -> bool {
        matches!(self, Self::Late | Self::Board | Self::Calibration | Self::Device)
    }
}

/// The conditions that hold.
#[derive(Clone, Debug, Default)]
pub struct Conditions {
    holding: Vec<(Condition, String)>,
}

impl Conditions {
    /// A condition holds, for this reason, or does not (`None`). Gives whether that is new.
    pub fn set(&mut self, condition: Condition, reason: Option<&str>) -> bool {
        let place = self.holding.iter().position(|(c, _)| *c == condition);
        match (place, reason) {
            (None, None) => return false,
            (Some(place), None) => {
                self.holding.remove(place);
            }
            (Some(place), Some(reason)) => {
                let text = &mut self.holding[place].1;
                if text == reason {
                    return false;
                }
                text.clear();
                text.push_str(reason);
            }
            (None, Some(reason)) => {
                self.holding.push((condition, reason.to_owned()));
                self.holding.sort_by_key(|(c, _)| *c);
            }
        }
        true
    }

    /// Whether the daemon is degraded, while frames flow or do not.
    pub fn is_degraded(&self, frames_pass: bool) -> bool {
        self.holding.iter().any(|(c, _)| frames_pass || !c.needs_frames())
    }

    /// All reasons, the weightiest first.
    pub fn reason(&self) -> String {
        let texts: Vec<&str> = self.holding.iter().map(|(_, text)| &text[..]).collect();
        texts.join("; ")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn reasons_come_and_go_each_by_itself() {
        let mut conditions = Conditions::default();
        assert!(!conditions.set(Condition::Source, None) && !conditions.is_degraded(true));
        assert!(conditions.set(Condition::Late, Some("late")));
        assert!(conditions.is_degraded(true) && !conditions.is_degraded(false));
        assert!(conditions.set(Condition::Source, Some("a.png is missing")));
        assert!(!conditions.set(Condition::Source, Some("a.png is missing")), "nothing new");
        assert!(conditions.is_degraded(false));
        assert_eq!(conditions.reason(), "a.png is missing; late");
        assert!(conditions.set(Condition::Source, Some("b.png is missing")));
        assert!(conditions.set(Condition::Late, None));
        assert_eq!(conditions.reason(), "b.png is missing");
    }
}
