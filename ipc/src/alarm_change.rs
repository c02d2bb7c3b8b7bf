//! The last changes of the alarm's level: part of `status`, so that a reader that was away, or was overtaken by newer frames,
//! learns of each.

use crate::alarm::{Faults, LEVELS, RULES};
use crate::obstacles::AlarmRecord;
use crate::range::{ANY_U32, AnyBytes, CLOCK_NS, COUNT, Each, FLAG, Nested, PADDING, ranges, within};
use bytemuck::{Pod, Zeroable};

/// Number of changes that are kept: the alarm holds its level for a second by default, so they reach back at least eight
/// seconds, and minutes as a rule.
pub const KEPT: usize = 16;

/// The alarm of a frame in which its level changed: the fields of [`AlarmRecord`] without road, path and space.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct AlarmChangeRecord {
    /// Number of the frame in its run; where the scheduler has withdrawn a result, that of the withdrawn frame.
    pub sequence: u64,
    /// Its source time, in ns.
    pub source_ns: u64,
    /// Distance of the nearest obstacle in the path, in metres; infinite if there is none.
    pub nearest_m: f64,
    /// Time to collision, in seconds; infinite if the distance does not decrease.
    pub time_to_collision_s: f64,
    /// Deceleration that stops the vehicle in time, in m/s²; 0 if none is required.
    pub required_deceleration_m_s2: f64,
    /// Gap between the object and the path, in metres; infinite if there is none.
    pub clearance_m: f64,
    /// Class of the object, padded with zeros.
    pub class: [u8; 16],
    /// The new level: an index into [`LEVELS`].
    pub level: u32,
    /// The rule that raised it: an index into [`RULES`]; 0 = none.
    pub rule: u32,
    /// The track that caused it, from 1; 0 = none.
    pub track: u32,
    /// The track that it is about, from 1; 0 = none.
    pub object: u32,
    /// Self-checks that failed: bits of [`Faults`].
    pub faults: u32,
    /// 1 if the level is only held.
    pub held: u32,
    /// 1 if the scheduler has withdrawn the frame's result, so that the alarm is off.
    pub withdrawn: u32,
    /// Padding; 0.
    pub reserved: u32,
}

ranges! {
    AlarmChangeRecord as "status: change of the alarm" {
        sequence: COUNT,
        source_ns: CLOCK_NS,
        nearest_m: crate::obstacles::NEAREST_M,
        time_to_collision_s: crate::obstacles::COLLISION_S,
        required_deceleration_m_s2: crate::obstacles::DECELERATION_M_S2,
        clearance_m: crate::obstacles::CLEARANCE_M,
        class: AnyBytes,
        level: within(0, LEVELS.len() as u32 - 1),
        rule: within(0, RULES.len() as u32 - 1),
        track: ANY_U32,
        object: ANY_U32,
        faults: within(0, Faults::ALL.0),
        held: FLAG,
        withdrawn: FLAG,
        reserved: PADDING,
    }
}

impl AlarmChangeRecord {
    /// The change that an alarm is.
    pub fn new(sequence: u64, source_ns: u64, alarm: &AlarmRecord, withdrawn: bool) -> Self {
        Self {
            sequence,
            source_ns,
            nearest_m: alarm.nearest_m,
            time_to_collision_s: alarm.time_to_collision_s,
            required_deceleration_m_s2: alarm.required_deceleration_m_s2,
            clearance_m: alarm.clearance_m,
            class: alarm.class,
            level: alarm.level,
            rule: alarm.rule,
            track: alarm.track,
            object: alarm.object,
            faults: alarm.faults,
            held: alarm.held,
            withdrawn: u32::from(withdrawn),
            reserved: 0,
        }
    }

    /// The alarm, without road, path and space.
    pub fn alarm(&self) -> AlarmRecord {
        AlarmRecord {
            level: self.level,
            rule: self.rule,
            track: self.track,
            faults: self.faults,
            changed: 1,
            object: self.object,
            held: self.held,
            nearest_m: self.nearest_m,
            time_to_collision_s: self.time_to_collision_s,
            required_deceleration_m_s2: self.required_deceleration_m_s2,
            clearance_m: self.clearance_m,
            class: self.class,
            ..AlarmRecord::default()
        }
    }
}

/// The last changes.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct AlarmChanges {
    /// Number of changes since the daemon started; the last [`KEPT`] of them are here.
    pub total: u64,
    /// The changes; the one with the number n, from 0, is at n modulo [`KEPT`].
    pub kept: [AlarmChangeRecord; KEPT],
}

ranges! {
    AlarmChanges as "status: changes of the alarm" {
        total: COUNT,
        kept: Each(Nested),
    }
}

impl AlarmChanges {
    /// Adds a change; the oldest gives way.
    pub fn push(&mut self, change: AlarmChangeRecord) {
        self.kept[(self.total % KEPT as u64) as usize] = change;
        self.total = self.total.saturating_add(1);
    }

    /// The kept changes with their numbers, the oldest first.
    pub fn iter(&self) -> impl Iterator<Item = (u64, &AlarmChangeRecord)> {
        let first = self.total.saturating_sub(KEPT as u64);
        (first..self.total).map(|number| (number, &self.kept[(number % KEPT as u64) as usize]))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::range::Ranged;

    #[test]
    fn the_last_changes_are_kept_in_order() {
        let mut changes = AlarmChanges::default();
        assert_eq!(changes.iter().count(), 0);
        for sequence in 0..20 {
            let alarm = AlarmRecord { level: 1 + (sequence % 3) as u32, ..AlarmRecord::off(Faults::NONE) };
            changes.push(AlarmChangeRecord::new(sequence, sequence, &alarm, false));
        }
        let kept: Vec<_> = changes.iter().map(|(number, change)| (number, change.sequence)).collect();
        assert_eq!((kept[0], kept[KEPT - 1], kept.len()), ((4, 4), (19, 19), KEPT));
        assert!(changes.check().is_ok());
        for (field, wrong) in changes.invalid() {
            assert!(wrong.check().is_err(), "{field}");
        }
    }

    #[test]
    fn a_change_holds_what_is_said_of_an_alarm() {
        let alarm = AlarmRecord {
            level: 3,
            rule: 2,
            track: 7,
            changed: 1,
            object: 7,
            time_to_collision_s: 1.5,
            ..AlarmRecord::off(Faults::NONE)
        };
        let change = AlarmChangeRecord::new(5, 6, &alarm, false);
        assert_eq!(change.alarm(), alarm);
        assert_eq!(change.alarm().reason(), "1.5 s to collision");
    }
}
