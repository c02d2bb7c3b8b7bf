//! Whether results are persistently late: a pure state machine with hysteresis. `run` late frames in a row enter the
//! state, and as many frames in time leave it, so that single late frames have no effect.

/// The state machine.
#[derive(Clone, Debug)]
pub struct DeadlineMonitor {
    /// Number of frames in a row that change the state.
    run: u64,
    /// Number of frames in a row that contradict the state.
    against: u64,
    is_late: bool,
}

impl DeadlineMonitor {
    /// Starts in time.
    pub fn new(run: u64) -> Self {
        Self { run: run.max(1), against: 0, is_late: false }
    }

    /// Adds a result. Returns whether the state has changed.
    pub fn frame(&mut self, was_late: bool) -> bool {
        if was_late == self.is_late {
            self.against = 0;
            return false;
        }
        self.against += 1;
        if self.against < self.run {
            return false;
        }
        self.against = 0;
        self.is_late = was_late;
        true
    }

    /// Whether results are persistently late.
    pub fn is_late(&self) -> bool {
        self.is_late
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn runs_of_late_and_timely_frames_change_the_state() {
        let mut monitor = DeadlineMonitor::new(3);
        for late in [true, true, false, true, true] {
            assert!(!monitor.frame(late) && !monitor.is_late());
        }
        assert!(monitor.frame(true) && monitor.is_late());
        for late in [false, false, true, false, false] {
            assert!(!monitor.frame(late) && monitor.is_late());
        }
        assert!(monitor.frame(false) && !monitor.is_late());
    }
}
