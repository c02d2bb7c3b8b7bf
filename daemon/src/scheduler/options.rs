//! How the daemon runs, what came of it, and why it cannot.

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
    /// No input.
    #[error(transparent)]
    Input(#[from] InputError),
    /// Another daemon, or no room in memory.
    #[error(transparent)]
    Instance(#[from] InstanceError),
    /// Shared memory cannot be used.
    #[error(transparent)]
    Ipc(#[from] IpcError),
    /// Something that real time needs was required and refused.
    #[error(transparent)]
    Refused(#[from] crate::realtime::Refused),
    /// The frames cannot be matched.
    #[error("{source_name}: {error}")]
    Frames {
        /// The source.
        source_name: String,
        /// Why.
        error: MatcherError,
    },
    /// A side of the frames is longer than messages allow.
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
        /// The most.
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
    /// The stages cannot be told what to do.
    #[error("a path of the configuration is not text: {0}")]
    Launch(#[from] serde_json::Error),
    /// The board is too hot, or lacks what is required of it.
    #[error(transparent)]
    Board(#[from] BoardError),
    /// Signals or /proc.
    #[error("{0}")]
    System(#[from] std::io::Error),
}

/// When a run ends by itself.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ends {
    /// Never: it runs until it is stopped, degraded if need be.
    Never,
    /// When the source does, or a stage is given up.
    WithSource,
    /// This long after the first result, or as above.
    After(Duration),
}

/// How to run.
#[derive(Clone, Debug)]
pub struct RunOptions {
    /// Every frame, one at a time.
    pub lockstep: bool,
    /// At most this many pairs.
    pub limit: Option<u64>,
    /// Where to write results.
    pub out: Option<PathBuf>,
    /// Where to record the run.
    pub record: Option<PathBuf>,
    /// When to end.
    pub ends: Ends,
}

/// What a run came to.
#[derive(Clone, Debug)]
pub struct RunOutcome {
    /// Its figures.
    pub summary: RunSummary,
    /// Times frame by frame, of a run that ends after a set time.
    pub traces: Vec<FrameTrace>,
    /// Why it failed, if it did.
    pub failure: Option<String>,
    /// Whether a signal ended it.
    pub was_stopped: bool,
}
