//! Logs and keeps the changes of the alarm's level or rule in a run.

use crate::frame_record::alarm_object;
use messages::alarm::{self, Faults};
use messages::obstacles::AlarmRecord;
use tools::reporting::summary::AlarmChange;

/// Most changes, of the alarm or the calibration, that the summary of a run lists.
pub const MAX_CHANGES: usize = 100;

/// The changes so far.
#[derive(Clone, Debug, Default)]
pub struct AlarmLog {
    /// Level and rule of the last change.
    last: Option<(u32, u32)>,
    changes: Vec<AlarmChange>,
    alarms: u32,
}

impl AlarmLog {
    /// Adds the alarm of a frame.
    pub fn add(&mut self, sequence: u64, record: &AlarmRecord) {
        let now = (record.level, record.rule);
        if self.last == Some(now) {
            return;
        }
        let before = self.last.replace(now).map_or(alarm::OFF, |(level, _)| level);
        let (level, rule) = (alarm::level_name(record.level), alarm::rule_name(record.rule));
        let finite = |v: f64| v.is_finite().then_some((v * 100.0).round() / 100.0);
        let change = AlarmChange {
            sequence,
            level: level.into(),
            rule: rule.map(Into::into),
            track: (record.track > 0).then_some(record.track),
            nearest_m: finite(record.nearest_m),
            time_to_collision_s: finite(record.time_to_collision_s),
            required_deceleration_m_s2: finite(record.required_deceleration_m_s2).filter(|a| *a > 0.0),
            reason: record.reason(),
            object: alarm_object(record),
        };
        if record.level > before.max(alarm::CLEAR) || record.level == alarm::OFF {
            tracing::warn!("{change}");
        } else {
            tracing::info!("{change}");
        }
        if record.level == alarm::ALARM && before != alarm::ALARM {
            self.alarms += 1;
        }
        if self.changes.len() < MAX_CHANGES {
            self.changes.push(change);
        }
    }

    /// The alarm of frame `sequence` does not hold any more because of `faults`: it is off.
    pub fn withdraw(&mut self, sequence: u64, faults: Faults) {
        if self.last.is_some_and(|(level, _)| level != alarm::OFF) {
            self.add(sequence, &AlarmRecord::off(faults));
        }
    }

    /// The first [`MAX_CHANGES`] changes.
    pub fn changes(&self) -> &[AlarmChange] {
        &self.changes
    }

    /// How often the level became "alarm".
    pub fn alarms(&self) -> u32 {
        self.alarms
    }
}
