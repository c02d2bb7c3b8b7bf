//! Options of a matcher on a GPU.

use crate::stereo::device::DEFAULT_TIMEOUT;
use core::time::Duration;

/// Choice of the adapter and its time limit.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct GpuOptions {
    /// Part of the adapter's name, case-insensitive; empty selects an adapter of the fastest kind.
    pub adapter: String,
    /// Whether a software driver is accepted. An adapter that is named is always accepted.
    pub software: bool,
    /// Time limit of a frame; after it the device counts as hung.
    pub patience: Duration,
}

impl Default for GpuOptions {
    fn default() -> Self {
        Self { adapter: String::new(), software: false, patience: DEFAULT_TIMEOUT }
    }
}
