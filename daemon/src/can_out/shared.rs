//! What the threads of CAN out share.

use std::sync::{Mutex, MutexGuard, PoisonError};
use tools::can_out::{LinkReport, Values};

/// The newest values, and the state of the bus.
#[derive(Debug, Default)]
pub struct Shared {
    values: Mutex<Values>,
    report: Mutex<LinkReport>,
}

impl Shared {
    /// What the daemon last said.
    pub fn values(&self) -> MutexGuard<'_, Values> {
        self.values.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// What is told of the bus.
    pub fn report(&self) -> MutexGuard<'_, LinkReport> {
        self.report.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
