//! What comes of making a video.

use std::io;
use std::path::PathBuf;
use thiserror::Error;

/// What was written.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Video {
    /// Pictures in the file.
    pub pictures: u64,
    /// Playing time in seconds.
    pub seconds: f64,
    /// Frames of the run beyond the capacity of the file: a GIF has at most `MAX_PICTURES` pictures.
    pub left_out: u64,
}

/// Why a video cannot be made.
#[derive(Debug, Error)]
pub enum VideoError {
    /// The name of the file has none of the known extensions.
    #[error("{}: give a file that ends in .gif, .mp4, .mkv or .webm", .0.display())]
    Extension(PathBuf),
    /// No program for this format.
    #[error(
        "{}: {reason}: install ffmpeg (Debian: apt install ffmpeg), or give a file that ends in .gif, which needs no \
         other program", path.display()
    )]
    NoProgram {
        /// The video.
        path: PathBuf,
        /// What was not found.
        reason: String,
    },
    /// A file cannot be read or written.
    #[error("{}: {source}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// The cause.
        source: io::Error,
    },
    /// A line of `obstacles.jsonl` or an overlay is damaged.
    #[error("{}: {reason}: run the replay again", path.display())]
    Damaged {
        /// The file.
        path: PathBuf,
        /// The cause.
        reason: String,
    },
    /// The run has no frames.
    #[error("{}: no frame was written, so there is no video", .0.display())]
    Empty(PathBuf),
    /// The program failed.
    #[error(
        "{program}: {reason}: the video was not written; a file that ends in .gif needs no other program"
    )]
    Failed {
        /// Name of the program.
        program: String,
        /// Its last words.
        reason: String,
    },
}
