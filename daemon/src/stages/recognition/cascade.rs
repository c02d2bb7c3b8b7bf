//! Loading of the configured cascade.

use crate::stages::whole_number::whole;
use config::Config;
use perception::recognition::xml;
use perception::recognition::{CascadeRecogniser, RecogniserParameters, Sizes};
use sources::bounded_file;
use sources::limits::CASCADE;
use std::borrow::Cow;
use std::path::{Path, PathBuf};
use thiserror::Error;

/// Why the configured cascade cannot be used.
#[derive(Debug, Error)]
pub enum CascadeError {
    /// The file cannot be read.
    #[error(
        "recognition.cascade: {}: {source}: give an OpenCV cascade XML, vehicle for the one that ships \
         (not in a build without the feature models), or \"\" for none",
        path.display()
    )]
    File {
        /// The file.
        path: PathBuf,
        /// The cause.
        source: std::io::Error,
    },
    /// The file is not a cascade.
    #[error("recognition.cascade: {}: {source}", path.display())]
    Content {
        /// The file.
        path: PathBuf,
        /// The cause.
        source: xml::CascadeError,
    },
}

/// The XML of a cascade that ships with the daemon, by its name. It is not part of the program and has its own licence:
/// see models/README.md.
fn shipped(name: &Path) -> Option<&'static str> {
    #[cfg(feature = "models")]
    if name == Path::new("vehicle") {
        return Some(include_str!("../../../../models/vehicle.xml"));
    }
    let _ = name;
    None
}

/// The XML of a cascade: of one that ships, by its name, or of a file.
///
/// # Errors
/// If the file cannot be read, or is too large.
pub fn text(path: &Path) -> std::io::Result<Cow<'static, str>> {
    match shipped(path) {
        Some(text) => Ok(Cow::Borrowed(text)),
        None => bounded_file::read_text(path, &CASCADE).map(Cow::Owned),
    }
}

/// The recogniser with the configured cascade, for crops of up to `width` × `height` pixels; `None` if
/// `recognition.cascade` is empty.
///
/// # Errors
/// If the cascade cannot be read.
pub fn recogniser(
    config: &Config,
    width: usize,
    height: usize,
) -> Result<Option<CascadeRecogniser>, CascadeError> {
    let c = &config.recognition;
    if c.cascade.as_os_str().is_empty() {
        return Ok(None);
    }
    let path = || c.cascade.clone();
    let text = text(&c.cascade).map_err(|source| CascadeError::File { path: path(), source })?;
    let cascade = xml::read(&text).map_err(|source| CascadeError::Content { path: path(), source })?;
    let parameters = RecogniserParameters {
        sizes: Sizes::Range {
            min_px: whole(c.window_min_px),
            max_px: whole(c.window_max_px),
            growth: c.growth,
        },
        growth: c.growth,
        window_m: c.window_m,
        min_neighbours: whole(c.neighbours_min),
    };
    Ok(Some(CascadeRecogniser::new(&cascade, parameters, width, height)))
}
