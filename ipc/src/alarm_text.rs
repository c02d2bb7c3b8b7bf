//! The alarm in plain words: why it has its level.

use crate::alarm::{CLEAR, Faults, OFF, rule_name};
use crate::obstacles::AlarmRecord;

impl AlarmRecord {
    /// Why the alarm has its level: what it cannot judge by, what it sees in the path, or what calls for a warning.
    pub fn reason(&self) -> String {
        match (self.level, rule_name(self.rule)) {
            (OFF, _) => match Faults(self.faults) {
                Faults::NONE => "no result yet".into(),
                faults => faults.to_string(),
            },
            (CLEAR, _) if self.nearest_m.is_finite() => {
                format!("no danger, nearest in the path {:.1} m", self.nearest_m)
            }
            (CLEAR, _) => "nothing in the path".into(),
            _ if self.held == 1 => "held for a moment: what raised it is over or not seen".into(),
            (_, Some("time_to_collision")) if self.time_to_collision_s.is_finite() => {
                format!("{:.1} s to collision", self.time_to_collision_s)
            }
            (_, Some("deceleration")) if self.required_deceleration_m_s2 > 0.0 => {
                format!("{:.1} m/s2 of braking needed", self.required_deceleration_m_s2)
            }
            (_, Some("distance")) => "nearer than the preset distance".into(),
            (_, rule) => rule.unwrap_or("no rule").replace('_', " "),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn record(level: u32, rule: u32) -> AlarmRecord {
        AlarmRecord {
            level,
            rule,
            nearest_m: 8.25,
            time_to_collision_s: 1.55,
            required_deceleration_m_s2: 5.2,
            ..AlarmRecord::default()
        }
    }

    #[test]
    fn every_level_has_a_reason_in_words() {
        let off = AlarmRecord::off(Faults::DARK.and(Faults::NO_ROAD));
        assert_eq!(off.reason(), "the picture is too dark; no road seen");
        assert_eq!(AlarmRecord::off(Faults::NONE).reason(), "no result yet");
        assert_eq!(record(1, 0).reason(), "no danger, nearest in the path 8.2 m");
        let clear = AlarmRecord { nearest_m: f64::INFINITY, ..record(1, 0) };
        assert_eq!(clear.reason(), "nothing in the path");
        assert_eq!(record(2, 2).reason(), "1.6 s to collision");
        assert_eq!(record(3, 3).reason(), "5.2 m/s2 of braking needed");
        assert_eq!(record(3, 1).reason(), "nearer than the preset distance");
        let held = AlarmRecord { held: 1, ..record(3, 1) };
        assert!(held.reason().starts_with("held"), "{}", held.reason());
        // A rule whose value is gone still has its name.
        let gone = AlarmRecord { time_to_collision_s: f64::INFINITY, ..record(2, 2) };
        assert_eq!(gone.reason(), "time to collision");
    }
}
