//! Storage of recordings: the disk, or a replacement in tests.

use std::fs::{File, OpenOptions};
use std::io::{self, Seek, Write};
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use thiserror::Error;

/// A file that is being written. `flush` makes it durable: what was written before survives a power failure.
pub trait Medium: Write + Seek + Send {}

impl<T: Write + Seek + Send> Medium for T {}

/// Creates files.
pub trait Storage: Send {
    /// Creates a new file.
    ///
    /// # Errors
    /// If it exists or cannot be created.
    fn create(&self, path: &Path) -> io::Result<Box<dyn Medium>>;

    /// Whether a file exists.
    fn exists(&self, path: &Path) -> bool;

    /// Free space for files in the file's folder, in bytes.
    ///
    /// # Errors
    /// If the system does not report it.
    fn free_bytes(&self, path: &Path) -> io::Result<u64>;

    /// Checks that files can be created in the file's folder.
    ///
    /// # Errors
    /// If it is missing, not a folder, or not writable.
    fn check_folder(&self, path: &Path) -> io::Result<()> {
        let folder = folder(path);
        if !std::fs::metadata(folder)?.is_dir() {
            return Err(io::ErrorKind::NotADirectory.into());
        }
        Ok(rustix::fs::access(folder, rustix::fs::Access::WRITE_OK)?)
    }
}

/// The folder of a file.
fn folder(path: &Path) -> &Path {
    path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

/// The disk.
#[derive(Clone, Copy, Debug, Default)]
pub struct Disk;

/// A file whose `flush` waits for the disk, and checks that the file can still be found.
struct DiskFile {
    file: File,
    /// Its absolute path.
    path: PathBuf,
}

/// The file of a recording was deleted or moved, or another one has its name.
#[derive(Debug, Error)]
#[error("the file, or its folder, was deleted, moved or replaced during the recording")]
pub struct Gone;

impl DiskFile {
    /// Checks that the path still names this file: a deleted file can be written, and is lost when it is closed.
    fn check_name(&self) -> io::Result<()> {
        let own = self.file.metadata()?;
        let is_there = std::fs::metadata(&self.path)
            .is_ok_and(|there| (there.dev(), there.ino()) == (own.dev(), own.ino()));
        if is_there { Ok(()) } else { Err(io::Error::other(Gone)) }
    }
}

impl Write for DiskFile {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.file.write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        match self.file.sync_data() {
            // Pipes and devices cannot be synchronised.
            Err(error) if error.kind() == io::ErrorKind::InvalidInput => {}
            result => result?,
        }
        self.check_name()
    }
}

impl Seek for DiskFile {
    fn seek(&mut self, to: io::SeekFrom) -> io::Result<u64> {
        self.file.seek(to)
    }
}

impl Storage for Disk {
    fn create(&self, path: &Path) -> io::Result<Box<dyn Medium>> {
        let path = std::path::absolute(path)?;
        let file = OpenOptions::new().write(true).create_new(true).open(&path)?;
        Ok(Box::new(DiskFile { file, path }))
    }

    fn exists(&self, path: &Path) -> bool {
        path.exists()
    }

    fn free_bytes(&self, path: &Path) -> io::Result<u64> {
        let stat = rustix::fs::statvfs(folder(path))?;
        Ok(stat.f_bavail.saturating_mul(stat.f_frsize))
    }
}

/// Counts the bytes written to a medium.
pub struct Counted {
    medium: Box<dyn Medium>,
    bytes: Arc<AtomicU64>,
}

impl Counted {
    /// A medium, and the counter of its bytes.
    pub fn new(medium: Box<dyn Medium>) -> (Self, Arc<AtomicU64>) {
        let bytes = Arc::new(AtomicU64::new(0));
        (Self { medium, bytes: Arc::clone(&bytes) }, bytes)
    }
}

impl Write for Counted {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let written = self.medium.write(bytes)?;
        self.bytes.fetch_add(written as u64, Ordering::Relaxed);
        Ok(written)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.medium.flush()
    }
}

impl Seek for Counted {
    fn seek(&mut self, to: io::SeekFrom) -> io::Result<u64> {
        self.medium.seek(to)
    }
}
