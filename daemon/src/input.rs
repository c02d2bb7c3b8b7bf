//! Opens the source that the configuration names.

use config::Config;
use perception::rig::Rig;
use sources::folder::FolderSource;
use sources::recording::RecordingSource;
use sources::rectified::RectifiedSource;
use sources::scene::{Drive, Scene};
use sources::{PairSource, SourceError, calibration_file};
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

/// Opens the source, rectifying if that is configured.
///
/// # Errors
/// When it, or the rig file, cannot be opened.
pub fn open(config: &Config) -> Result<Box<dyn PairSource>, InputError> {
    let source = open_raw(config)?;
    if !config.source.rectify {
        return Ok(source);
    }
    if config.source.rig.as_os_str().is_empty() {
        return Err(InputError::NoCameras);
    }
    Ok(Box::new(RectifiedSource::new(source, config.source.rig.clone())?))
}

fn open_raw(config: &Config) -> Result<Box<dyn PairSource>, InputError> {
    let source = &config.source;
    Ok(match source.kind.as_str() {
        "folder" | "recording" if source.path.as_os_str().is_empty() => return Err(InputError::NoPath),
        "folder" => Box::new(FolderSource::open(&source.path)?),
        "recording" => {
            let recording = RecordingSource::open(&source.path)?;
            if let Some(cut) = recording.cut() {
                tracing::warn!(
                    path = %source.path.display(),
                    lost_bytes = cut.bytes,
                    "the recording was cut off: it is read up to its last whole chunk"
                );
            }
            Box::new(recording)
        }
        "camera" => Box::new(crate::cameras::source(config)?),
        _ if !source.path.as_os_str().is_empty() => {
            let scene = Scene::open(&source.path.to_string_lossy()).map_err(SourceError::from)?;
            Box::new(if source.fps > 0.0 { scene.at_rate(source.fps) } else { scene })
        }
        _ => {
            let drive = Drive::paper(source.seed.unsigned_abs());
            // A scene can be seen at any rate; its time is that of the rate.
            Box::new(if source.fps > 0.0 { drive.at_rate(source.fps) } else { drive })
        }
    })
}

/// The rig of the run: that of the configuration, else the source's own.
///
/// # Errors
/// When there is none, or its file cannot be read.
pub fn rig(config: &Config, source: &dyn PairSource) -> Result<Rig, InputError> {
    if !config.source.rig.as_os_str().is_empty() {
        return Ok(calibration_file::read(&config.source.rig, true)?);
    }
    let name = || match config.source.kind.as_str() {
        "camera" => "the cameras".to_owned(),
        _ => config.source.path.display().to_string(),
    };
    source.rig().ok_or_else(|| InputError::NoRig(name()))
}

/// Time between pairs, in nanoseconds: as configured, else the source's own.
pub fn period_ns(config: &Config, source: &dyn PairSource) -> u64 {
    if config.source.fps > 0.0 { (1e9 / config.source.fps) as u64 } else { source.period_ns() }.max(1)
}
