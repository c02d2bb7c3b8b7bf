//! The file with the original values of the clocks. Root reads it, and its folder may have a name that others can
//! predict: whose it is and what it is are therefore checked on the opened file, not on its path.

use super::device::Device;
use super::hertz::ClockError;
use rustix::fs::{AtFlags, Mode, OFlags, fstat, open, openat, unlinkat};
use rustix::process::geteuid;
use serde::{Deserialize, Serialize};
use std::ffi::OsStr;
use std::fs::{File, OpenOptions};
use std::io::{self, Read, Write};
use std::os::fd::OwnedFd;
use std::os::unix::fs::{MetadataExt, OpenOptionsExt};
use std::path::{Path, PathBuf};

/// Maximum size in bytes. A device takes about 100 bytes; no board has more than a few dozen clocks.
const MAX_BYTES: u64 = 64 * 1024;

/// Values of a device before they were changed.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub(super) struct Saved {
    #[serde(flatten)]
    pub(super) device: Device,
    pub(super) values: Vec<u64>,
}

/// The file with the original values of an instance's clocks.
pub fn state_file(directory: &Path) -> PathBuf {
    directory.join("clocks.json")
}

fn state(path: &Path, reason: impl ToString) -> ClockError {
    ClockError::State { path: path.to_owned(), reason: reason.to_string() }
}

/// Writes the original values atomically. No link is followed.
///
/// # Errors
/// If it cannot be written.
pub(super) fn keep(path: &Path, saved: &[Saved]) -> Result<(), ClockError> {
    let text = serde_json::to_vec(saved).map_err(|error| state(path, error))?;
    let new = path.with_extension("new");
    let write = || -> io::Result<()> {
        match std::fs::remove_file(&new) {
            Err(error) if error.kind() != io::ErrorKind::NotFound => return Err(error),
            _ => {}
        }
        OpenOptions::new().write(true).create_new(true).mode(0o600).open(&new)?.write_all(&text)?;
        std::fs::rename(&new, path)
    };
    write().map_err(|error| state(path, error))
}

/// The opened file.
pub(super) struct Kept {
    path: PathBuf,
    folder: OwnedFd,
    file: File,
}

impl Kept {
    /// Opens the file; `None` if there is none.
    ///
    /// # Errors
    /// If it is no regular file of at most [`MAX_BYTES`], or another user could have written it: it and its folder must
    /// belong to the same user, who is that of this process unless this is root, and be writable by that user only.
    pub(super) fn open(path: &Path) -> Result<Option<Self>, ClockError> {
        let fail = |reason: &str| state(path, reason);
        let (Some(folder), Some(name)) = (path.parent(), path.file_name()) else {
            return Err(fail("is not the name of a file"));
        };
        let flags = OFlags::RDONLY | OFlags::NOFOLLOW | OFlags::CLOEXEC;
        let opened = open(folder, flags | OFlags::DIRECTORY, Mode::empty())
            // Without O_NONBLOCK a named pipe would block for ever.
            .and_then(|folder| Ok((openat(&folder, name, flags | OFlags::NONBLOCK, Mode::empty())?, folder)));
        let (file, folder) = match opened.map_err(io::Error::from) {
            Ok(opened) => opened,
            Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(None),
            Err(error) => return Err(state(path, error)),
        };
        let file = File::from(file);
        let owner = fstat(&folder).map_err(|e| state(path, io::Error::from(e)))?;
        let metadata = file.metadata().map_err(|error| state(path, error))?;
        let user = geteuid();
        if owner.st_uid != user.as_raw() && !user.is_root() {
            return Err(fail("is in another user's folder"));
        }
        if !metadata.is_file()
            || metadata.uid() != owner.st_uid
            || (metadata.mode() | owner.st_mode) & 0o022 != 0
        {
            return Err(fail("is no regular file that only the owner of its folder can write"));
        }
        if metadata.len() > MAX_BYTES {
            return Err(state(path, format!("has {} bytes, at most {MAX_BYTES} are read", metadata.len())));
        }
        Ok(Some(Self { path: path.to_owned(), folder, file }))
    }

    /// The values in it.
    ///
    /// # Errors
    /// If it cannot be read, or holds something else.
    pub(super) fn read(&self) -> Result<Vec<Saved>, ClockError> {
        let mut text = Vec::new();
        // It may have grown since it was opened.
        (&self.file).take(MAX_BYTES).read_to_end(&mut text).map_err(|error| state(&self.path, error))?;
        serde_json::from_slice(&text).map_err(|error| state(&self.path, error))
    }

    /// The error of invalid content.
    pub(super) fn invalid(&self, reason: String) -> ClockError {
        state(&self.path, reason)
    }

    /// Removes the file from the folder in which it was opened.
    ///
    /// # Errors
    /// If that fails.
    pub(super) fn remove(&self) -> Result<(), ClockError> {
        let name = self.path.file_name().unwrap_or(OsStr::new(""));
        unlinkat(&self.folder, name, AtFlags::empty()).map_err(|e| state(&self.path, io::Error::from(e)))
    }
}
