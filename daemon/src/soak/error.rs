//! Why there is no report of a soak.

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
    /// A file or process.
    #[error("{}: {source}", path.display())]
    Io {
        /// Which.
        path: PathBuf,
        /// Why it failed.
        source: std::io::Error,
    },
    /// Shared memory.
    #[error(transparent)]
    Ipc(#[from] IpcError),
    /// The daemon has ended by itself.
    #[error("the daemon has ended by itself ({0}); {1}")]
    Ended(ExitStatus, String),
    /// The daemon does not open its shared memory, or no result comes.
    #[error("the daemon brings nothing; {0}")]
    Silent(String),
    /// The daemon does not stop.
    #[error("the daemon did not stop within {0:?} of SIGTERM and was killed")]
    Endless(Duration),
    /// A signal came before there was anything to report.
    #[error("stopped by a signal before the first result")]
    Stopped,
}

impl SoakError {
    /// Of a file or process.
    pub(super) fn io(path: &Path) -> impl FnOnce(std::io::Error) -> Self {
        let path = path.to_owned();
        move |source| Self::Io { path, source }
    }
}
