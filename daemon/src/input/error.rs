//! Why there is no input.

use sources::SourceError;
use thiserror::Error;

/// Why there is no input.
#[derive(Debug, Error)]
pub enum InputError {
    /// The source.
    #[error(transparent)]
    Source(#[from] SourceError),
    /// A folder is wanted, but not named.
    #[error("source.kind is \"folder\" or \"recording\", but source.path is empty: name the folder or file")]
    NoPath,
    /// A camera is wanted, but not named.
    #[error(
        "source.kind is \"camera\", but camera.left or camera.right is empty: name both devices, or set \
         camera.side_by_side"
    )]
    NoCamera,
    /// Cameras of a kind that this build cannot open.
    #[error("camera.backend = \"{0}\" is not in this build: build it with --features {0}")]
    NoBackend(String),
    /// Rectification without cameras.
    #[error("source.rectify is true, but source.rig is empty: name a file of `lookout calibrate`")]
    NoCameras,
    /// Nothing tells what a disparity means in metres.
    #[error(
        "{0}: no calibration: put calib.txt or rig.toml beside the images, or name one with --rig or source.rig"
    )]
    NoRig(String),
}
