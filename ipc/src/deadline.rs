//! Whether frames come out in time: part of `report` and `status`.

use crate::pipeline::Role;
use bytemuck::{Pod, Zeroable};
use std::fmt;

/// Ages of frames against the time that they may take, from capture on. Times in nanoseconds.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
pub struct DeadlineRecord {
    /// What a frame may take from capture to obstacles; 0 = as long as it likes.
    pub deadline_ns: u64,
    /// Age of the last frame when the stage had finished with it.
    pub age_ns: u64,
    /// Frames that were older than the deadline by then, since the stage started; in `status` since the
    /// daemon did, at the end of the way.
    pub late: u64,
    /// How many of them in a row, up to the last frame; 0 when that was in time.
    pub late_in_a_row: u64,
}

impl DeadlineRecord {
    /// Takes in a frame that was captured and finished at these times. Clocks of other processes are
    /// not trusted: a frame from the future has the age 0.
    pub fn finished(&mut self, capture_ns: u64, end_ns: u64) {
        self.age_ns = end_ns.saturating_sub(capture_ns);
        if self.deadline_ns > 0 && self.age_ns > self.deadline_ns {
            self.late += 1;
            self.late_in_a_row += 1;
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

/// How fast the source runs, and why: part of `status`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct PacingRecord {
    /// Frames a second that the source is asked for; 0 in lock-step.
    pub rate_hz: f64,
    /// Frames a second that were wanted of it.
    pub wanted_hz: f64,
    /// 90th percentile of the slowest stage's work, in milliseconds; 0 while it is not known.
    pub slowest_ms: f64,
    /// [`Role`] of that stage as a number.
    pub slowest: u32,
    /// 1 when the rate follows what the stages sustain.
    pub follows: u32,
}

impl PacingRecord {
    /// Name of the slowest stage.
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
