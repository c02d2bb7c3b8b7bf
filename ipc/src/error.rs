//! Why shared memory cannot be used.

use std::fmt;
use thiserror::Error;

/// Why shared memory cannot be used.
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
