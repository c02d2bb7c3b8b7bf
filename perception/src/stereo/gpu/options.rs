//! Options of a matcher on a GPU.

use core::time::Duration;

/// Which adapter is taken, and how long it may take.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct GpuOptions {
    /// Part of the adapter's name, in any case; empty takes the fastest kind there is.
    pub adapter: String,
    /// Whether a driver that computes on the CPU will do. One that is named always does.
    pub software: bool,
    /// A frame that is not finished in this time means that the device hangs.
    pub patience: Duration,
}

impl Default for GpuOptions {
    fn default() -> Self {
        Self { adapter: String::new(), software: false, patience: Duration::from_secs(2) }
    }
}
