//! Errors of commands.

use crate::host::HostError;
use thiserror::Error;

/// Why a command failed. The text is one line for the user, or one per error of the configuration.
#[derive(Debug, Error)]
pub enum CommandError {
    /// The configuration is invalid.
    #[error("the configuration cannot be used\n{0}")]
    Config(#[from] config::ConfigErrors),
    /// The daemon failed.
    #[error(transparent)]
    Run(#[from] crate::scheduler::RunError),
    /// The stages in one process failed.
    #[error(transparent)]
    Pipeline(#[from] crate::in_process::PipelineError),
    /// A stage process failed.
    #[error(transparent)]
    Stage(#[from] HostError),
    /// A source of pairs, or an image, cannot be read.
    #[error(transparent)]
    Source(#[from] sources::SourceError),
    /// A scene is invalid.
    #[error(transparent)]
    Scene(#[from] sources::scene::file::SceneError),
    /// A data set with ground truth cannot be used.
    #[error(transparent)]
    Truth(#[from] sources::truth::TruthError),
    /// A matcher cannot be created.
    #[error("{0}")]
    Matcher(#[from] perception::stereo::MatcherError),
    /// A pair cannot be matched.
    #[error(transparent)]
    Match(#[from] perception::stereo::MatchError),
    /// An image's size does not fit its pixels.
    #[error(transparent)]
    Image(#[from] perception::image::ImageError),
    /// A picture cannot be written.
    #[error(transparent)]
    Picture(#[from] tools::reporting::picture::PictureError),
    /// The report of a calibration cannot be written.
    #[error(transparent)]
    Report(#[from] tools::calibration::report::ReportError),
    /// A cascade cannot be trained.
    #[error(transparent)]
    Train(#[from] tools::training::TrainError),
    /// Results cannot be written.
    #[error(transparent)]
    Output(#[from] tools::reporting::output::OutputError),
    /// A video cannot be written.
    #[error(transparent)]
    Video(#[from] tools::reporting::video::VideoError),
    /// The socket of results cannot be made.
    #[error(transparent)]
    Socket(#[from] crate::stream::socket::SocketError),
    /// A recording cannot be written.
    #[error(transparent)]
    Record(#[from] tools::recording::RecordError),
    /// Two runs that cannot be compared.
    #[error(transparent)]
    Compare(#[from] tools::evaluation::compare::CompareError),
    /// Shared memory cannot be used.
    #[error(transparent)]
    Ipc(#[from] messages::bus::IpcError),
    /// A daemon instance is not available.
    #[error(transparent)]
    Instance(#[from] messages::instance::InstanceError),
    /// A stage cannot be configured.
    #[error(transparent)]
    Setup(#[from] crate::stages::stage::SetupError),
    /// A soak failed.
    #[error(transparent)]
    Soak(#[from] crate::soak::SoakError),
    /// A result cannot be serialised.
    #[error("the result cannot be written as JSON: {0}")]
    Json(#[from] serde_json::Error),
    /// The board's clocks cannot be set.
    #[error(transparent)]
    Clock(#[from] crate::scheduler::clocks::ClockError),
    /// Reasons, one a line.
    #[error("{0}")]
    Lines(String),
    /// Any other error, as text.
    #[error("{0}")]
    Other(String),
}

impl CommandError {
    /// Whether its text has several lines: one for each error of the configuration, or the end of a daemon's log.
    pub fn has_lines(&self) -> bool {
        matches!(self, Self::Config(_) | Self::Soak(_) | Self::Lines(_))
    }
}
