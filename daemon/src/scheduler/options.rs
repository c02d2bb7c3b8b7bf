//! Options, outcome and errors of a run.

use super::board::BoardError;
use super::collector::FrameTrace;
use crate::input::InputError;
use crate::stages::stage::SetupError;
use messages::bus::IpcError;
use messages::instance::InstanceError;
use perception::stereo::MatcherError;
use std::path::PathBuf;
use std::time::Duration;
use thiserror::Error;
use tools::reporting::summary::RunSummary;

/// Why the daemon cannot run.
#[derive(Debug, Error)]
pub enum RunError {
    /// The source cannot be opened.
    #[error(transparent)]
    Input(#[from] InputError),
    /// Another daemon runs the instance, or there is too little shared memory.
    #[error(transparent)]
    Instance(#[from] InstanceError),
    /// Shared memory cannot be used.
    #[error(transparent)]
    Ipc(#[from] IpcError),
    /// A required real-time privilege was refused.
    #[error(transparent)]
    Refused(#[from] crate::realtime::Refused),
    /// The frames cannot be matched.
    #[error("{source_name}: {error}")]
    Frames {
        /// The source.
        source_name: String,
        /// The cause.
        error: MatcherError,
    },
    /// The frames are larger than messages allow.
    #[error(
        "{source_name}: {width}x{height} pixels: messages hold images of up to {most} pixels a side: scale them down"
    )]
    Side {
        /// The source.
        source_name: String,
        /// Width in pixels.
        width: usize,
        /// Height in pixels.
        height: usize,
        /// Maximum width and height in pixels.
        most: u32,
    },
    /// A stage cannot be configured.
    #[error(transparent)]
    Setup(#[from] SetupError),
    /// The run cannot be recorded.
    #[error(transparent)]
    Record(#[from] tools::recording::RecordError),
    /// Results cannot be written.
    #[error(transparent)]
    Output(#[from] tools::reporting::output::OutputError),
    /// The launch document cannot be serialised.
    #[error("the configuration cannot be passed to the stages: {0}: use paths of valid UTF-8")]
    Launch(#[from] toml::ser::Error),
    /// The board is too hot, or lacks a required sensor or clock.
    #[error(transparent)]
    Board(#[from] BoardError),
    /// Signal handlers or /proc.
    #[error("{0}")]
    System(#[from] std::io::Error),
}

/// When a run ends without a signal.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ends {
    /// Never: failures make it degraded.
    Never,
    /// At the end of the source, or when a stage is given up.
    WithSource,
    /// This long after the first result, at the end of the source, or when a stage is given up.
    After(Duration),
}

/// Options of a run.
#[derive(Clone, Debug)]
pub struct RunOptions {
    /// Whether to process every frame, one at a time.
    pub lockstep: bool,
    /// Maximum number of pairs; `None` = unlimited.
    pub limit: Option<u64>,
    /// Folder for the results; `None` = not written.
    pub out: Option<PathBuf>,
    /// File for a recording of the run; `None` = not recorded.
    pub record: Option<PathBuf>,
    /// When to end.
    pub ends: Ends,
}

/// Outcome of a run.
#[derive(Clone, Debug)]
pub struct RunOutcome {
    /// Its summary.
    pub summary: RunSummary,
    /// Times of each frame; empty unless the run ends with [`Ends::After`].
    pub traces: Vec<FrameTrace>,
    /// Reason for its failure; `None` if it succeeded.
    pub failure: Option<String>,
    /// Whether a signal ended it.
    pub was_stopped: bool,
}
