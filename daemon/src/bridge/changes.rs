//! Which changes of the alarm are new: each comes in its frame, if that was not overtaken, and in the status, which has the
//! last ones, so several times.

use crate::status_json::AlarmChangeJson;
use messages::alarm::{OFF, level_name};

/// Number of changes that are remembered: several times as many as a status has.
const REMEMBERED: usize = 4 * messages::alarm_change::KEPT;

/// The changes of a run so far.
#[derive(Clone, Debug, Default)]
pub struct Changes {
    run: String,
    /// Frame and level, in the order of frames.
    seen: Vec<(u64, String)>,
}

impl Changes {
    /// Whether a change is new; the level before it, in this case.
    pub fn is_new(&mut self, run: &str, change: &AlarmChangeJson) -> Option<String> {
        if self.run != run {
            *self = Self { run: run.into(), seen: Vec::new() };
        }
        let level = &change.alarm.level;
        let same = |(sequence, known): &(u64, String)| (*sequence, known) == (change.sequence, level);
        if self.seen.iter().any(same) {
            return None;
        }
        let place = self.seen.iter().rposition(|(sequence, _)| *sequence <= change.sequence);
        let before = place.map_or(level_name(OFF), |place| &self.seen[place].1).to_owned();
        // The scheduler may have seen the change a frame later than this process.
        if before == *level {
            return None;
        }
        self.seen.insert(place.map_or(0, |place| place + 1), (change.sequence, level.clone()));
        if self.seen.len() > REMEMBERED {
            self.seen.remove(0);
        }
        Some(before)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use tools::reporting::record::AlarmLine;

    fn change(sequence: u64, level: &str) -> AlarmChangeJson {
        let alarm = AlarmLine { level: level.into(), ..AlarmLine::default() };
        AlarmChangeJson { sequence, time_s: 0.0, withdrawn: false, alarm }
    }

    #[test]
    fn each_change_is_new_once() {
        let mut changes = Changes::default();
        let mut new = |run: &str, sequence, level: &str| changes.is_new(run, &change(sequence, level));
        assert_eq!(new("a", 0, "clear").as_deref(), Some("off"));
        // Frame 12 was overtaken, frame 14 was not.
        assert_eq!(new("a", 14, "clear"), None, "no change that is known");
        assert_eq!(new("a", 12, "alarm").as_deref(), Some("clear"));
        assert_eq!(new("a", 14, "clear").as_deref(), Some("alarm"));
        // The status has them again, and has seen one later.
        for (sequence, level) in [(0, "clear"), (12, "alarm"), (15, "clear")] {
            assert_eq!(new("a", sequence, level), None, "{sequence}");
        }
        // Withdrawn, and the same frame again in the status.
        assert_eq!(new("a", 14, "off").as_deref(), Some("clear"));
        assert_eq!(new("a", 14, "clear"), None);
        assert_eq!(new("a", 14, "off"), None);
        assert_eq!(new("b", 14, "off"), None, "a run begins with the alarm off");
        assert_eq!(new("b", 14, "clear").as_deref(), Some("off"));
    }

    #[test]
    fn memory_is_bounded() {
        let mut changes = Changes::default();
        for sequence in 0..1000 {
            let level = ["clear", "alarm"][sequence as usize % 2];
            assert!(changes.is_new("a", &change(sequence, level)).is_some());
        }
        assert_eq!(changes.seen.len(), REMEMBERED);
    }
}
