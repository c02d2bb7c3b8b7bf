//! Storage of recordings: the disk, or a replacement in tests.

use std::fs::{File, OpenOptions};
use std::io::{self, Seek, Write};
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

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
}

/// The disk.
#[derive(Clone, Copy, Debug, Default)]
pub struct Disk;

/// A file whose `flush` waits for the disk.
struct DiskFile(File);

impl Write for DiskFile {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.0.write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        match self.0.sync_data() {
            // Pipes and devices cannot be synchronised.
            Err(error) if error.kind() == io::ErrorKind::InvalidInput => Ok(()),
            result => result,
        }
    }
}

impl Seek for DiskFile {
    fn seek(&mut self, to: io::SeekFrom) -> io::Result<u64> {
        self.0.seek(to)
    }
}

impl Storage for Disk {
    fn create(&self, path: &Path) -> io::Result<Box<dyn Medium>> {
        let file = OpenOptions::new().write(true).create_new(true).open(path)?;
        Ok(Box::new(DiskFile(file)))
    }

    fn exists(&self, path: &Path) -> bool {
        path.exists()
    }

    fn free_bytes(&self, path: &Path) -> io::Result<u64> {
        let folder = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
        let stat = rustix::fs::statvfs(folder)?;
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
