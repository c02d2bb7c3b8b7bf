//! Errors that prevent the report of a soak.

use messages::bus::IpcError;
use std::path::{Path, PathBuf};
use std::process::ExitStatus;
use std::time::Duration;
use thiserror::Error;

/// Why there is no report.
#[derive(Debug, Error)]
pub enum SoakError {
    /// The configuration of the daemon cannot be written.
    #[error("the configuration of the daemon cannot be written: {0}")]
    Config(String),
    /// A file or process failed.
    #[error("{}: {source}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// The error.
        source: std::io::Error,
    },
    /// Shared memory cannot be used.
    #[error(transparent)]
    Ipc(#[from] IpcError),
    /// The daemon ended unexpectedly: its exit status, and the end of its log.
    #[error("the daemon ended unexpectedly ({0}); {1}")]
    Ended(ExitStatus, String),
    /// The daemon does not open its shared memory, or publishes no results; with the end of its log.
    #[error("the daemon publishes no results; {0}")]
    Silent(String),
    /// The daemon did not stop in time.
    #[error("the daemon did not stop within {0:?} of SIGTERM and was killed")]
    Endless(Duration),
    /// A signal came before there was anything to report.
    #[error("stopped by a signal before the first result")]
    Stopped,
}

impl SoakError {
    /// Adds the path to an I/O error.
    pub(super) fn io(path: &Path) -> impl FnOnce(std::io::Error) -> Self {
        let path = path.to_owned();
        move |source| Self::Io { path, source }
    }
}
