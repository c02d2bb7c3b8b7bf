//! Scheduling delay of a process: time it was runnable but not running, sampled from the kernel's counters.

use std::collections::VecDeque;

/// Maximum number of samples: several seconds, longer than a frame waits to be judged.
const MAX_SAMPLES: usize = 2048;

/// Samples of one stage's process.
#[derive(Clone, Debug, Default)]
pub struct Delays {
    /// Time, and the total delay until then.
    readings: VecDeque<(u64, u64)>,
}

impl Delays {
    /// Adds a sample. A decreasing total means a new process.
    pub fn add(&mut self, at_ns: u64, total_ns: u64) {
        if self.readings.back().is_some_and(|&(_, last)| total_ns < last) {
            self.readings.clear();
        }
        if self.readings.len() >= MAX_SAMPLES {
            self.readings.pop_front();
        }
        self.readings.push_back((at_ns, total_ns));
    }

    /// Upper bound of the scheduling delay between two times: from the last sample before to the first after.
    /// `None` without samples around them.
    pub fn between_ns(&self, from_ns: u64, to_ns: u64) -> Option<u64> {
        let after = self.readings.partition_point(|&(at, _)| at < to_ns);
        let before = self.readings.partition_point(|&(at, _)| at <= from_ns).checked_sub(1)?;
        let (_, end) = self.readings.get(after)?;
        let (_, begin) = self.readings.get(before)?;
        Some(end.saturating_sub(*begin))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_wait_is_found_between_the_readings_about_it() {
        let mut delays = Delays::default();
        assert_eq!(delays.between_ns(0, 10), None);
        for (at, total) in [(10, 5), (20, 5), (30, 12), (40, 12), (50, 13)] {
            delays.add(at, total);
        }
        assert_eq!(delays.between_ns(10, 20), Some(0));
        assert_eq!(delays.between_ns(22, 28), Some(7));
        assert_eq!(delays.between_ns(15, 45), Some(8));
        assert_eq!(delays.between_ns(31, 39), Some(0));
        // Nothing is known outside the samples.
        assert_eq!((delays.between_ns(5, 20), delays.between_ns(40, 60)), (None, None));
        // A new process starts from zero.
        delays.add(60, 1);
        assert_eq!(delays.between_ns(10, 60), None);
        for i in 0..10_000 {
            delays.add(100 + i, i);
        }
        assert_eq!(delays.readings.len(), MAX_SAMPLES);
        assert_eq!(delays.between_ns(10_000, 10_050), Some(50));
    }
}
