//! Errors of training.

use thiserror::Error;

/// Errors of training. The text names the file or value and the remedy.
#[derive(Debug, Error)]
pub enum TrainError {
    /// Unsuitable images or parameters.
    #[error("{0}")]
    Data(String),
    /// An image cannot be read.
    #[error(transparent)]
    Source(#[from] sources::SourceError),
    /// An image or report cannot be written.
    #[error(transparent)]
    Picture(#[from] crate::reporting::picture::PictureError),
}
