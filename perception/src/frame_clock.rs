//! Steps of the source time from frame to frame: the one place that decides what a step means.
//!
//! Input: the source time of each frame, in ns. Output: a [`TimeStep`]. Everything that keeps a state over frames
//! ([`crate::tracking`], [`crate::alarm`], [`crate::scene`]) follows it: a normal step is predicted over, a repeated
//! time adds nothing, and after a gap or a step back the state starts anew, as at the start of a run.
//!
//! ```
//! use lookout_perception::frame_clock::{FrameClock, TimeStep};
//!
//! let mut clock = FrameClock::default();
//! assert_eq!(clock.step(80_000_000), TimeStep::First);
//! assert_eq!(clock.step(160_000_000), TimeStep::Forward { elapsed_s: 0.08 });
//! assert!(clock.step(10_000_000_000).is_discontinuity());
//! ```

/// Longest step that filters bridge, in ns. Within a second a vehicle that brakes with 10 m/s² is 5 m from where it was
/// predicted, half of the distance at which the alarm is raised.
pub const MAX_STEP_NS: u64 = 1_000_000_000;

/// Steps below this, in ns, are the same time: half the period of the fastest source (`source.fps`, 1,000 pairs/s).
pub const MIN_STEP_NS: u64 = 500_000;

/// The time cannot be relied on while this many of the last [`HISTORY_FRAMES`] steps were not normal. One jump there and
/// back is two; with three, tracks are reset faster than they are confirmed, and silence says nothing.
const MAX_ABNORMAL_STEPS: u32 = 3;

/// Number of steps that are remembered.
pub const HISTORY_FRAMES: u32 = u8::BITS;

/// Step of the source time since the previous frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum TimeStep {
    /// There is no previous frame.
    First,
    /// A normal step of at most [`MAX_STEP_NS`].
    Forward {
        /// Its length, in seconds, above 0.
        elapsed_s: f64,
    },
    /// The time of the previous frame again, within [`MIN_STEP_NS`].
    Repeated,
    /// A step of more than [`MAX_STEP_NS`]: what has happened meanwhile is unknown.
    Gap {
        /// Its length, in seconds.
        elapsed_s: f64,
    },
    /// The time has decreased.
    Back {
        /// By how much, in seconds, above 0.
        by_s: f64,
    },
}

impl TimeStep {
    /// Whether what was known before says nothing about this frame, so that filters start anew.
    pub fn is_discontinuity(self) -> bool {
        matches!(self, Self::Gap { .. } | Self::Back { .. })
    }

    /// Time over which filters predict, in seconds, 0 to 1; 0 unless the step is normal.
    pub fn elapsed_s(self) -> f64 {
        if let Self::Forward { elapsed_s } = self { elapsed_s } else { 0.0 }
    }
}

/// Classifies the steps of the source time. All clocks that are given the same times agree.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct FrameClock {
    last_ns: Option<u64>,
    /// One bit for each of the last steps, the newest lowest: whether it was not normal.
    abnormal: u8,
}

impl FrameClock {
    /// The step to the frame at `time_ns`.
    pub fn step(&mut self, time_ns: u64) -> TimeStep {
        let seconds = |ns: u64| ns as f64 * 1e-9;
        let step = match self.last_ns {
            None => TimeStep::First,
            Some(last) if time_ns < last => TimeStep::Back { by_s: seconds(last - time_ns) },
            Some(last) if time_ns - last < MIN_STEP_NS => TimeStep::Repeated,
            Some(last) if time_ns - last > MAX_STEP_NS => {
                TimeStep::Gap { elapsed_s: seconds(time_ns - last) }
            }
            Some(last) => TimeStep::Forward { elapsed_s: seconds(time_ns - last) },
        };
        // Steps that are too short add up.
        if step != TimeStep::Repeated {
            self.last_ns = Some(time_ns);
        }
        let is_abnormal = !matches!(step, TimeStep::First | TimeStep::Forward { .. });
        self.abnormal = self.abnormal << 1 | u8::from(is_abnormal);
        step
    }

    /// Whether too many of the last steps were not normal for a result to mean anything.
    pub fn is_unreliable(&self) -> bool {
        self.abnormal.count_ones() >= MAX_ABNORMAL_STEPS
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const S: u64 = 1_000_000_000;
    const PERIOD_NS: u64 = 80_000_000;

    /// The step from one time to another.
    fn step(from_ns: u64, to_ns: u64) -> TimeStep {
        let mut clock = FrameClock::default();
        assert_eq!(clock.step(from_ns), TimeStep::First);
        clock.step(to_ns)
    }

    #[test]
    fn steps_are_normal_repeated_gaps_or_back() {
        let at = 100 * S;
        for ns in [MIN_STEP_NS, PERIOD_NS, 300_000_000, MAX_STEP_NS] {
            let step = step(at, at + ns);
            assert_eq!(step, TimeStep::Forward { elapsed_s: ns as f64 * 1e-9 });
            assert!(!step.is_discontinuity() && step.elapsed_s() > 0.0);
        }
        for ns in [0, 1, MIN_STEP_NS - 1] {
            assert_eq!(step(at, at + ns), TimeStep::Repeated);
        }
        for ns in [MAX_STEP_NS + 1, 3 * S, 10 * S, 60 * S, S * S] {
            let step = step(at, at + ns);
            assert_eq!(step, TimeStep::Gap { elapsed_s: ns as f64 * 1e-9 });
            assert!(step.is_discontinuity() && step.elapsed_s() == 0.0);
        }
        for ns in [1, 1_000_000, S, 100 * S] {
            assert_eq!(step(at, at - ns), TimeStep::Back { by_s: ns as f64 * 1e-9 });
        }
        for (from, to) in [(0, u64::MAX), (u64::MAX, 0), (u64::MAX, u64::MAX), (1 << 62, 3 << 62)] {
            assert!(step(from, to).elapsed_s() == 0.0, "{from} to {to}");
        }
    }

    #[test]
    fn short_steps_add_up() {
        let mut clock = FrameClock::default();
        let steps = [0, 200_000, 400_000, 600_000].map(|ns| clock.step(S + ns));
        assert_eq!(steps[1..3], [TimeStep::Repeated; 2]);
        assert!((steps[3].elapsed_s() - 0.0006).abs() < 1e-12, "{:?}", steps[3]);
    }

    #[test]
    fn a_time_that_stands_or_jumps_is_unreliable_until_it_runs_again() {
        let mut clock = FrameClock::default();
        let mut time = S;
        clock.step(time);
        // One jump there and back is no reason to doubt.
        for jump in [5 * S, S] {
            clock.step(jump);
            assert!(!clock.is_unreliable());
        }
        clock.step(time);
        assert!(clock.is_unreliable(), "the time stands still, after two jumps");
        let mut frames = 0;
        while clock.is_unreliable() {
            time += PERIOD_NS;
            clock.step(time);
            frames += 1;
        }
        assert!(frames <= HISTORY_FRAMES, "{frames}");
        // Steps that are all too long.
        let mut slow = Vec::new();
        for k in 1..=6 {
            clock.step(time + 2 * S * k);
            slow.push(clock.is_unreliable());
        }
        assert_eq!(slow[2..], [true; 4]);
    }
}
