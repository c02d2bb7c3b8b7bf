//! Whether results keep coming too late: a pure state machine. One late frame is chance, a run of
//! them is a state, and it takes as long a run of good ones to leave it.

/// See the module.
#[derive(Clone, Debug)]
pub struct DeadlineMonitor {
    /// Frames in a row that change the state.
    run: u64,
    /// Frames in a row that speak against the state.
    against: u64,
    is_late: bool,
}

impl DeadlineMonitor {
    /// In time, until `run` frames in a row are not.
    pub fn new(run: u64) -> Self {
        Self { run: run.max(1), against: 0, is_late: false }
    }

    /// A frame came out, in time or not. Gives whether that changed the state.
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

    /// Whether results keep coming too late.
    pub fn is_late(&self) -> bool {
        self.is_late
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_run_of_late_frames_is_a_state_and_so_is_a_run_of_good_ones() {
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
