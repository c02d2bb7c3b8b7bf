//! How a video will be written.

use super::frames::Frames;
use super::gif;
use super::outcome::{Video, VideoError};
use super::program::Program;
use std::ffi::OsStr;
use std::path::{Path, PathBuf};

/// Extension of an animated GIF.
const GIF: &str = "gif";

/// Extensions of the formats that a program writes.
const CONTAINERS: [&str; 3] = ["mp4", "mkv", "webm"];

/// How a video will be written. Made before the run, so that a missing program is reported at once.
#[derive(Clone, Debug)]
pub struct Plan {
    path: PathBuf,
    /// `None` writes a GIF.
    program: Option<Program>,
}

impl Plan {
    /// A plan for the file `path`; `search` is the value of `PATH`.
    ///
    /// # Errors
    /// If the file's extension is not known, or no program can write it.
    pub fn new(path: &Path, search: &OsStr) -> Result<Self, VideoError> {
        let extension = path.extension().and_then(OsStr::to_str).map(str::to_ascii_lowercase);
        let path = path.to_owned();
        let program = match extension.as_deref() {
            Some(GIF) => None,
            Some(container) if CONTAINERS.contains(&container) => match Program::find(container, search) {
                Ok(program) => Some(program),
                Err(reason) => return Err(VideoError::NoProgram { path, reason }),
            },
            _ => return Err(VideoError::Extension(path)),
        };
        Ok(Self { path, program })
    }

    /// The file.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Makes the video from a results folder; `done` is called with the number of frames after each.
    ///
    /// # Errors
    /// If a file cannot be read or written, or the program fails. No incomplete file is left.
    pub fn write(&self, folder: &Path, done: &mut dyn FnMut(u64)) -> Result<Video, VideoError> {
        let frames = Frames::open(folder)?;
        // Written under another name, with the same extension, and renamed.
        let extension = self.path.extension().unwrap_or_default();
        let part = self.path.with_extension("part").with_added_extension(extension);
        let io = |source| VideoError::Io { path: self.path.clone(), source };
        let written = match &self.program {
            None => gif::write(&frames, &part, done),
            Some(program) => program.write(&frames, &part, done),
        };
        match written {
            Ok(video) => {
                std::fs::rename(&part, &self.path).map_err(io)?;
                Ok(video)
            }
            Err(error) => {
                let _ = std::fs::remove_file(&part);
                Err(error)
            }
        }
    }
}
