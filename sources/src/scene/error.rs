//! Errors of scenes.

use std::path::PathBuf;
use thiserror::Error;

/// Errors of scenes. Every text names the file, the line or the value, and the remedy.
#[derive(Debug, Error)]
pub enum SceneError {
    /// No scene with this name.
    #[error("{name}: no such scene: give a TOML file, or one of {known}")]
    Unknown {
        /// The requested name.
        name: String,
        /// The built-in scenes.
        known: String,
    },
    /// The file cannot be read.
    #[error("{}: {source}: give a TOML file (docs/scenes.md), or the name of a built-in scene", path.display())]
    Io {
        /// Path of the file.
        path: PathBuf,
        /// Cause.
        source: std::io::Error,
    },
    /// The file is not a valid scene.
    #[error("{file}{}: {reason}", line.map_or(String::new(), |line| format!(":{line}")))]
    File {
        /// The file, or the name of a built-in scene.
        file: String,
        /// Line number, from 1.
        line: Option<usize>,
        /// The fault and the remedy.
        reason: String,
    },
    /// Invalid settings after the question mark.
    #[error(
        "{name}: {setting}: give weather=NAME, seed=N or rig=paper|kitti|board, joined by &; weathers are {weathers}"
    )]
    Setting {
        /// The complete name.
        name: String,
        /// The invalid setting.
        setting: String,
        /// Names of the known weathers.
        weathers: String,
    },
    /// A setting that the text of a scene does not have.
    #[error(
        "{name}: {setting} is not part of the text of a scene: leave it out, and change the text or give it to replay"
    )]
    InText {
        /// The complete name.
        name: String,
        /// The setting.
        setting: String,
    },
}
