//! Why a command failed.

use crate::host::HostError;
use thiserror::Error;

/// Why a command failed; one line (or one per fault) for the user.
#[derive(Debug, Error)]
pub enum CommandError {
    /// The configuration.
    #[error("the configuration cannot be used\n{0}")]
    Config(#[from] config::ConfigErrors),
    /// The daemon.
    #[error(transparent)]
    Run(#[from] crate::scheduler::RunError),
    /// The rooms in one process.
    #[error(transparent)]
    Pipeline(#[from] crate::in_process::PipelineError),
    /// A stage.
    #[error(transparent)]
    Stage(#[from] HostError),
    /// An image.
    #[error(transparent)]
    Source(#[from] sources::SourceError),
    /// A scene.
    #[error(transparent)]
    Scene(#[from] sources::scene::file::SceneError),
    /// A data set with truth.
    #[error(transparent)]
    Truth(#[from] sources::truth::TruthError),
    /// A matcher.
    #[error("{0}")]
    Matcher(#[from] perception::stereo::MatcherError),
    /// Matching.
    #[error(transparent)]
    Match(#[from] perception::stereo::MatchError),
    /// Pixels.
    #[error(transparent)]
    Image(#[from] perception::image::ImageError),
    /// A picture.
    #[error(transparent)]
    Picture(#[from] tools::reporting::picture::PictureError),
    /// A calibration's report.
    #[error(transparent)]
    Report(#[from] tools::calibration::report::ReportError),
    /// Training.
    #[error(transparent)]
    Train(#[from] tools::training::TrainError),
    /// Results.
    #[error(transparent)]
    Output(#[from] tools::reporting::output::OutputError),
    /// A recording.
    #[error(transparent)]
    Record(#[from] tools::recording::RecordError),
    /// Two runs that cannot be compared.
    #[error(transparent)]
    Compare(#[from] tools::evaluation::compare::CompareError),
    /// Shared memory.
    #[error(transparent)]
    Ipc(#[from] messages::bus::IpcError),
    /// An instance.
    #[error(transparent)]
    Instance(#[from] messages::instance::InstanceError),
    /// A room.
    #[error(transparent)]
    Setup(#[from] crate::stages::stage::SetupError),
    /// A soak.
    #[error(transparent)]
    Soak(#[from] crate::soak::SoakError),
    /// JSON.
    #[error("the result cannot be written as JSON: {0}")]
    Json(#[from] serde_json::Error),
    /// Clocks.
    #[error(transparent)]
    Clock(#[from] crate::scheduler::clocks::ClockError),
    /// Anything else, in words.
    #[error("{0}")]
    Other(String),
}
