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
}

impl IpcError {
    pub(crate) fn new(action: &'static str, name: &str, reason: impl fmt::Debug) -> Self {
        Self { action, name: name.to_owned(), reason: format!("{reason:?}") }
    }
}
