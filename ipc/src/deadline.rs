//! Ages and deadlines of frames, and the rate of the source: part of `report` and `status`.

use crate::pipeline::Role;
use crate::range::{CLOCK_NS, COUNT, FLAG, MAX_MS, MAX_RATE_HZ, ranges, within};
use bytemuck::{Pod, Zeroable};
use std::fmt;

/// Age of the last frame and number of late frames.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
pub struct DeadlineRecord {
    /// Deadline from capture to obstacles (`pacing.deadline_ms`), in ns; 0 = none.
    pub deadline_ns: u64,
    /// Age of the last frame when the stage had finished it, in ns since its capture.
    pub age_ns: u64,
    /// Number of frames that were older than the deadline when the stage had finished them: in a report since the
    /// stage started, in a status since the daemon started and at the last stage.
    pub late: u64,
    /// Number of late frames in a row, up to the last frame; 0 if that was in time.
    pub late_in_a_row: u64,
}

ranges! {
    DeadlineRecord as "deadline" {
        deadline_ns: CLOCK_NS,
        age_ns: CLOCK_NS,
        late: COUNT,
        late_in_a_row: COUNT,
    }
}

impl DeadlineRecord {
    /// Counts a frame that was captured and finished at these times, in ns of CLOCK_MONOTONIC. Another process has
    /// written the capture time, so it may have any value: one after `end_ns` gives the age 0.
    pub fn finished(&mut self, capture_ns: u64, end_ns: u64) {
        self.age_ns = end_ns.saturating_sub(capture_ns);
        if self.deadline_ns > 0 && self.age_ns > self.deadline_ns {
            self.late = self.late.saturating_add(1);
            self.late_in_a_row = self.late_in_a_row.saturating_add(1);
        } else {
            self.late_in_a_row = 0;
        }
    }
}

impl fmt::Display for DeadlineRecord {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "age {:.0} ms", self.age_ns as f64 * 1e-6)?;
        if self.deadline_ns > 0 {
            write!(f, " of {:.0} ms, {} late", self.deadline_ns as f64 * 1e-6, self.late)?;
        }
        Ok(())
    }
}

/// Rate of the source at live rate, and what limits it: part of `status`. All zeros in lock-step.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct PacingRecord {
    /// Current target rate, in frames per second.
    pub rate_hz: f64,
    /// Configured rate (`source.fps`, or that of the source), in frames per second.
    pub wanted_hz: f64,
    /// 90th percentile of the slowest stage's work, in milliseconds; 0 until it is known.
    pub slowest_ms: f64,
    /// [`Role`] of the slowest stage as a number; 0 until it is known.
    pub slowest: u32,
    /// 1 if the rate is adapted to the slowest stage (`pacing.follow`), else 0.
    pub follows: u32,
}

ranges! {
    PacingRecord as "pacing" {
        rate_hz: within(0.0, MAX_RATE_HZ),
        wanted_hz: within(0.0, MAX_RATE_HZ),
        slowest_ms: within(0.0, MAX_MS as f64),
        slowest: within(0, Role::COUNT as u32 - 1),
        follows: FLAG,
    }
}

impl PacingRecord {
    /// Name of the slowest stage; "unknown" for an unknown number.
    pub fn slowest_name(&self) -> &'static str {
        u8::try_from(self.slowest).ok().and_then(Role::from_raw).map_or("unknown", Role::name)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn late_frames_are_counted_in_all_and_in_a_row() {
        let mut record = DeadlineRecord { deadline_ns: 100, ..DeadlineRecord::default() };
        for (capture, end, late, row) in
            [(0, 100, 0, 0), (0, 101, 1, 1), (50, 200, 2, 2), (u64::MAX, 5, 2, 0), (0, 500, 3, 1)]
        {
            record.finished(capture, end);
            assert_eq!((record.late, record.late_in_a_row), (late, row), "{capture} to {end}");
        }
        let mut free = DeadlineRecord::default();
        free.finished(0, u64::MAX);
        assert_eq!((free.late, free.age_ns), (0, u64::MAX));
    }
}
