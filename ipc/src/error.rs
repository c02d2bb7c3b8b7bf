//! Errors of operations on shared memory.

use std::fmt;
use thiserror::Error;

/// A failed operation on shared memory: what was tried, on which service, instance or file, and the reason.
#[derive(Clone, Debug, Error, PartialEq, Eq)]
#[error("shared memory: cannot {action} \"{name}\": {reason}")]
pub struct IpcError {
    action: &'static str,
    name: String,
    reason: String,
    is_full: bool,
}

impl IpcError {
    pub(crate) fn new(action: &'static str, name: &str, reason: impl fmt::Debug) -> Self {
        Self { action, name: name.to_owned(), reason: format!("{reason:?}"), is_full: false }
    }

    /// The error of an operation for which /dev/shm has no room; `reason` says that.
    pub(crate) fn full(action: &'static str, name: &str, reason: String) -> Self {
        Self { action, name: name.to_owned(), reason, is_full: true }
    }

    /// Whether /dev/shm is full.
    pub fn is_full(&self) -> bool {
        self.is_full
    }
}
