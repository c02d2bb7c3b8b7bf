//! Counts for how many frames, and for how long in source time, the alarm was in each level, and why it was off.

use messages::alarm::{Faults, LEVELS, OFF};
use messages::alarm_change::{AlarmChangeRecord, AlarmChanges};
use messages::alarm_time::AlarmTimeRecord;
use messages::obstacles::AlarmRecord;
use perception::frame_clock::MAX_STEP_NS;
use tools::reporting::alarm_times::{AlarmTimes, LevelTime, OffReason};
use tools::reporting::record::tidy;

/// The alarm since the last result.
#[derive(Clone, Copy, Debug)]
struct Now {
    sequence: u64,
    source_ns: u64,
    level: u32,
    faults: u32,
    /// The result no longer holds: the scheduler has withdrawn it.
    is_withdrawn: bool,
}

/// The counts. A level lasts until the next frame, or until the scheduler withdraws it.
#[derive(Clone, Copy, Debug, Default)]
pub struct AlarmTally {
    record: AlarmTimeRecord,
    changes: AlarmChanges,
    now: Option<Now>,
}

impl AlarmTally {
    /// Adds the alarm of a frame with its source time in ns. A frame that is repeated after a stage died counts once.
    pub fn add(&mut self, sequence: u64, source_ns: u64, alarm: &AlarmRecord) {
        if let Some(now) = self.now {
            if now.sequence == sequence {
                return;
            }
            let step_ns = source_ns.saturating_sub(now.source_ns);
            // In a gap of the recording there was no alarm; while a result was missing, it was off.
            if step_ns <= MAX_STEP_NS || now.is_withdrawn {
                count(&mut self.record.ns, &mut self.record.off_ns, now.level, now.faults, step_ns);
            }
        }
        // Before the first result the alarm is off.
        if self.now.map_or(OFF, |now| now.level) != alarm.level {
            self.changes.push(AlarmChangeRecord::new(sequence, source_ns, alarm, false));
        }
        count(&mut self.record.frames, &mut self.record.off_frames, alarm.level, alarm.faults, 1);
        self.now =
            Some(Now { sequence, source_ns, level: alarm.level, faults: alarm.faults, is_withdrawn: false });
    }

    /// The last result does not hold any more because of these self-checks: the alarm is off until the next one.
    pub fn withdraw(&mut self, faults: Faults) {
        if let Some(now) = &mut self.now {
            if now.level != OFF {
                let off = AlarmRecord::off(faults);
                self.changes.push(AlarmChangeRecord::new(now.sequence, now.source_ns, &off, true));
            }
            (now.level, now.faults, now.is_withdrawn) = (OFF, faults.0, true);
        }
    }

    /// The last changes of the level.
    pub fn changes(&self) -> AlarmChanges {
        self.changes
    }

    /// The counts so far.
    pub fn record(&self) -> AlarmTimeRecord {
        self.record
    }
}

/// Adds to the count of a level, and of the self-checks that failed if it is off.
fn count(levels: &mut [u64; LEVELS.len()], checks: &mut [u64], level: u32, faults: u32, add: u64) {
    if let Some(sum) = levels.get_mut(level as usize) {
        *sum = sum.saturating_add(add);
    }
    if level == OFF {
        for (_, sum) in checks.iter_mut().enumerate().filter(|(bit, _)| (faults >> bit) & 1 == 1) {
            *sum = sum.saturating_add(add);
        }
    }
}

/// The counts for `summary.json` and the status.
pub fn alarm_times(record: &AlarmTimeRecord) -> AlarmTimes {
    let time = |frames: u64, ns: u64| LevelTime { frames, seconds: tidy(ns as f64 * 1e-9) };
    let [off, clear, warning, alarm] = std::array::from_fn(|i| time(record.frames[i], record.ns[i]));
    let reason =
        |(reason, frames, ns): (&str, u64, u64)| OffReason { reason: reason.into(), time: time(frames, ns) };
    AlarmTimes { off, clear, warning, alarm, off_reasons: record.reasons().map(reason).collect() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use messages::alarm::CLEAR;

    fn add(tally: &mut AlarmTally, sequence: u64, at_ms: u64, alarm: AlarmRecord) {
        tally.add(sequence, at_ms * 1_000_000, &alarm);
    }

    #[test]
    fn frames_and_time_are_those_of_each_level() {
        let mut tally = AlarmTally::default();
        let clear = AlarmRecord { level: CLEAR, ..AlarmRecord::default() };
        let off = AlarmRecord::off(Faults::DARK.and(Faults::NO_ROAD));
        add(&mut tally, 0, 0, off);
        add(&mut tally, 1, 100, AlarmRecord::off(Faults::NO_ROAD));
        add(&mut tally, 1, 100, AlarmRecord::off(Faults::NO_ROAD));
        add(&mut tally, 2, 200, clear);
        // A gap of the recording, then a step back: neither is time of a level.
        add(&mut tally, 3, 5_200, clear);
        add(&mut tally, 4, 5_000, AlarmRecord { level: 3, ..clear });
        add(&mut tally, 5, 5_250, clear);
        let times = alarm_times(&tally.record());
        assert_eq!(times.off, LevelTime { frames: 2, seconds: 0.2 });
        assert_eq!((times.clear.frames, times.clear.seconds), (3, 0.0));
        assert_eq!(times.alarm, LevelTime { frames: 1, seconds: 0.25 });
        let reasons: Vec<(&str, u64, f64)> =
            times.off_reasons.iter().map(|r| (&r.reason[..], r.time.frames, r.time.seconds)).collect();
        assert_eq!(reasons, [("the picture is too dark", 1, 0.1), ("no road seen", 2, 0.2)]);
    }

    #[test]
    fn without_results_the_alarm_is_off() {
        let mut tally = AlarmTally::default();
        tally.withdraw(Faults::STALE);
        let clear = AlarmRecord { level: CLEAR, ..AlarmRecord::default() };
        add(&mut tally, 0, 0, clear);
        tally.withdraw(Faults::STAGE);
        add(&mut tally, 40, 4_000, clear);
        add(&mut tally, 41, 4_100, clear);
        let times = alarm_times(&tally.record());
        assert_eq!((times.off.frames, times.off.seconds), (0, 4.0));
        assert_eq!((times.clear.frames, times.clear.seconds), (3, 0.1));
        assert_eq!(times.off_reasons[0].reason, "a stage is not running");
        let changes: Vec<_> =
            tally.changes().iter().map(|(_, c)| (c.sequence, c.level, c.withdrawn)).collect();
        assert_eq!(changes, [(0, CLEAR, 0), (0, OFF, 1), (40, CLEAR, 0)]);
    }
}
