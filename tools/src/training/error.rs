//! Errors of training.

use thiserror::Error;

/// Why training cannot go on. The text names the file or value and the remedy.
#[derive(Debug, Error)]
pub enum TrainError {
    /// The pictures.
    #[error("{0}")]
    Data(String),
    /// A picture cannot be read.
    #[error(transparent)]
    Source(#[from] sources::SourceError),
    /// A picture or report cannot be written.
    #[error(transparent)]
    Picture(#[from] crate::reporting::picture::PictureError),
}
