//! Opens the source that the configuration names.

mod cameras;
mod error;
pub mod first_pairs;
mod rectification;
pub mod rig_fit;
pub mod vehicle;

pub use cameras::check_two_cameras;
use config::Config;
pub use error::InputError;
use perception::rig::Rig;
pub use rectification::rectified;
use sources::bayer::Bayer;
use sources::calibration_file;
use sources::folder::{FolderOptions, FolderSource};
use sources::picture::Interpretation;
use sources::recording::RecordingSource;
use sources::scene::{Drive, Scene};
use sources::video::{VideoFiles, VideoSource};
use sources::{PairSource, SourceError};
use std::path::Path;

/// Opens the source, with rectification as `source.rectify` says.
///
/// # Errors
/// If the source or the rig file cannot be opened, or does not fit to the pictures.
pub fn open(config: &Config) -> Result<Box<dyn PairSource>, InputError> {
    let (source, first_time_s) = open_raw(config)?;
    let source = vehicle::with_motion(config, source, first_time_s)?;
    rectified(config, source)
}

/// The source with its pictures as they are, and the time of its first pair on the clock of files beside it, in seconds.
///
/// # Errors
/// If it cannot be opened.
pub fn open_raw(config: &Config) -> Result<(Box<dyn PairSource>, f64), InputError> {
    let source = &config.source;
    let videos = VideoFiles::named(&source.path, &source.left, &source.right);
    let opened: Box<dyn PairSource> = match source.kind.as_str() {
        "folder" | "recording" if let Some(videos) = &videos => Box::new(VideoSource::open(videos)?),
        "folder" | "recording" if source.path.as_os_str().is_empty() && !has_patterns(config) => {
            return Err(InputError::NoPath);
        }
        "folder" => {
            let folder = FolderSource::open_with(&source.path, &folder_options(config)?)?;
            let first_time_s = folder.first_time_s();
            return Ok((Box::new(folder), first_time_s));
        }
        "recording" => {
            let recording = RecordingSource::open(&source.path)?;
            if let Some(cut) = recording.cut() {
                tracing::warn!(
                    path = %source.path.display(),
                    lost_bytes = cut.bytes,
                    "the recording was cut off: it is read up to its last whole chunk"
                );
            }
            Box::new(recording.interpreted(interpretation(config))?.stale_after(vehicle::stale_s(config)))
        }
        "camera" => Box::new(cameras::source(config)?),
        _ if !source.path.as_os_str().is_empty() => {
            let scene = Scene::open(&source.path.to_string_lossy()).map_err(SourceError::from)?;
            Box::new(if source.fps > 0.0 { scene.at_rate(source.fps) } else { scene })
        }
        _ => {
            let drive = Drive::paper(source.seed.unsigned_abs());
            // A scene can be rendered at any rate; its source time follows the rate.
            Box::new(if source.fps > 0.0 { drive.at_rate(source.fps) } else { drive })
        }
    };
    Ok((opened, 0.0))
}

/// How the values of pictures become grey levels, as `source.bits` and `source.bayer` say.
pub fn interpretation(config: &Config) -> Interpretation {
    // "auto" and "none" are no numbers and no patterns.
    Interpretation { bits: config.source.bits.parse().ok(), bayer: Bayer::named(&config.source.bayer) }
}

/// Whether the pictures are named by patterns.
pub fn has_patterns(config: &Config) -> bool {
    !config.source.left.as_os_str().is_empty() || !config.source.right.as_os_str().is_empty()
}

/// How a folder is read.
///
/// # Errors
/// If only one of the two patterns is set.
pub fn folder_options(config: &Config) -> Result<FolderOptions, InputError> {
    let source = &config.source;
    let patterns = match (source.left.as_os_str().is_empty(), source.right.as_os_str().is_empty()) {
        (true, true) => None,
        (false, false) => Some((source.left.clone(), source.right.clone())),
        _ => return Err(InputError::OnePattern),
    };
    Ok(FolderOptions { patterns, interpretation: interpretation(config), is_strict: source.strict })
}

/// Tells what the user should know of the source before the first pair.
pub fn tell_notes(source: &dyn PairSource) {
    for note in source.notes() {
        tracing::warn!("{note}");
    }
}

/// The rig of the run: from `source.rig`, else that of the source.
///
/// # Errors
/// If there is none, its file cannot be read, or it is for pictures of another size.
pub fn rig(config: &Config, source: &dyn PairSource) -> Result<Rig, InputError> {
    let named = &config.source.rig;
    if named.as_os_str().is_empty() {
        let rig = source.rig().ok_or_else(|| match config.source.kind.as_str() {
            "camera" => InputError::NoRigOfCameras,
            _ => InputError::NoRig(name(config)),
        })?;
        // Scenes, recordings and rectified pictures have no such file, and know the size.
        if let Some(file) = source.rig_file()
            && calibration_file::open_for(file, source.has_colour_cameras(), source.size())
                .is_ok_and(|calibration| calibration.is_without_size())
        {
            rig_fit::check(&rig, source.size(), &file.display().to_string())?;
        }
        return Ok(rig);
    }
    let rig = named_rig(named, source.has_colour_cameras(), source.size())?;
    rectification::tell_cameras_beside(config, source);
    Ok(rig)
}

/// The rig of a named calibration for pictures of a size; tells what is doubtful of one that does not say its size.
///
/// # Errors
/// If it cannot be read, or is for pictures of another size.
pub fn named_rig(path: &Path, has_colour_cameras: bool, size: (usize, usize)) -> Result<Rig, InputError> {
    let fail = |reason: String| InputError::Rig(SourceError::Calibration { path: path.to_owned(), reason });
    let calibration = calibration_file::open_for(path, has_colour_cameras, size).map_err(InputError::Rig)?;
    let rig = calibration.rig_for(size).map_err(fail)?;
    if calibration.is_without_size() {
        rig_fit::tell_pictures_beside(path, size);
        rig_fit::check(&rig, size, &path.display().to_string())?;
    }
    Ok(rig)
}

/// What the source is called in errors.
fn name(config: &Config) -> String {
    match config.source.kind.as_str() {
        "camera" => "the cameras".to_owned(),
        "folder" if has_patterns(config) => config.source.left.display().to_string(),
        _ => config.source.path.display().to_string(),
    }
}

/// Time between pairs, in nanoseconds: from `source.fps`, else that of the source. At least 1.
pub fn period_ns(config: &Config, source: &dyn PairSource) -> u64 {
    if config.source.fps > 0.0 { (1e9 / config.source.fps) as u64 } else { source.period_ns() }.max(1)
}
