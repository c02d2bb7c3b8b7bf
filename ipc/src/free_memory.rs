//! What happens when /dev/shm is full.
//!
//! iceoryx2 sets the size of a file in /dev/shm with `ftruncate`, which allocates no page, and then writes to the
//! mapping. If no page is left, the kernel ends the process with SIGBUS. Its small files are therefore allocated while
//! their size is set (see [`ftruncate`]), so that creating a port fails with an error. So that readers can join even
//! then, the scheduler keeps a file of allocated pages, the [`Cushion`], which a reader shortens when it finds no page.

use crate::error::IpcError;
use crate::instance::Instance;
use crate::run_files::{RunPrefix, SHM, create_own, is_name_of_run, open_own};
use rustix::fd::{AsRawFd, BorrowedFd};
use rustix::fs::{FallocateFlags, OFlags, fallocate, fstat, stat, statvfs, unlink};
use rustix::io::Errno;
use std::cell::Cell;
use std::ffi::c_int;
use std::fmt;
use std::fs::File;
use std::io;
use std::path::PathBuf;

/// Maximum size of a file that is allocated while its size is set, in bytes. Ports, connections and listeners take less;
/// message pools take more, and are allocated by [`crate::bus::Bus::reserve`] or page by page.
const MAX_ALLOCATED_BYTES: u64 = 64 << 10;

/// Number of pages that a reader takes at most: the viewer has one connection to each of the five publishers of its four
/// services, and four listeners; each takes less than a page of 4 KiB. The rest is for publishers that are restarted.
const READER_PAGES: u64 = 12;

/// Number of pages that one port takes at most: a connection to each of five publishers, and a listener.
const PORT_PAGES: u64 = 6;

/// Number of readers that find room although /dev/shm is full: two viewers and a recorder, as many as have places.
const READERS: u64 = 3;

thread_local! {
    /// Whether a file of this thread was refused for lack of memory since [`take_refusal`].
    static REFUSED: Cell<bool> = const { Cell::new(false) };
}

/// Replaces the function of the C library in this program: as ftruncate(2), but a file of a run (`lookout.…` in /dev/shm)
/// of at most `MAX_ALLOCATED_BYTES` also gets its pages. If there are none left, the file is removed, because its creator would leave it
/// behind half made, and the error is ENOSPC.
///
/// A library has no other place to say this: iceoryx2 writes to the file before the call that created it returns.
// SAFETY: the signature is that of POSIX, and so is the contract.
#[unsafe(no_mangle)]
pub extern "C" fn ftruncate(file: c_int, bytes: libc::off_t) -> c_int {
    if file < 0 {
        return fail(Errno::BADF);
    }
    // SAFETY: the caller owns the descriptor during this call; of a closed one every use below returns EBADF.
    let file = unsafe { BorrowedFd::borrow_raw(file) };
    let Ok(bytes) = u64::try_from(bytes) else { return fail(Errno::INVAL) };
    // A system call of its own: it does not come back to this function.
    if let Err(error) = rustix::fs::ftruncate(file, bytes) {
        return fail(error);
    }
    // Other files are not ours to remove: the client library brings this function into other programs.
    let Some(path) = (1..=MAX_ALLOCATED_BYTES).contains(&bytes).then(|| path_of_run(file)).flatten() else {
        return 0;
    };
    match fallocate(file, FallocateFlags::empty(), 0, bytes) {
        Err(Errno::NOSPC) => {
            REFUSED.set(true);
            let _ = unlink(&path);
            fail(Errno::NOSPC)
        }
        // A file system that cannot allocate is no worse than before.
        _ => 0,
    }
}

/// Sets `errno`; returns what a C function returns then.
pub(crate) fn fail(error: Errno) -> c_int {
    // SAFETY: the address of this thread's errno is always valid.
    unsafe { *libc::__errno_location() = error.raw_os_error() };
    -1
}

/// Path of an open file, if it is one of a run.
fn path_of_run(file: BorrowedFd<'_>) -> Option<PathBuf> {
    let is_shared_memory =
        matches!((fstat(file), stat(SHM)), (Ok(file), Ok(folder)) if file.st_dev == folder.st_dev);
    if !is_shared_memory {
        return None;
    }
    let path = std::fs::read_link(format!("/proc/self/fd/{}", file.as_raw_fd())).ok()?;
    is_name_of_run(path.file_name()?).then_some(path)
}

/// Free space in /dev/shm.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FreeMemory {
    /// Free bytes.
    pub bytes: u64,
    /// All bytes.
    pub total_bytes: u64,
    /// Number of files that can still be created; `None` without a limit.
    pub files: Option<u64>,
}

impl FreeMemory {
    /// What is free now; `None` if the system does not say.
    pub fn now() -> Option<Self> {
        let stat = statvfs(SHM).ok()?;
        Some(Self {
            bytes: stat.f_bavail.saturating_mul(stat.f_frsize),
            total_bytes: stat.f_blocks.saturating_mul(stat.f_frsize),
            // Without limits both are 0.
            files: (stat.f_files > 0).then_some(stat.f_favail),
        })
    }

    /// Whether no file of one page can be created.
    pub fn is_full(&self) -> bool {
        self.bytes == 0 && self.total_bytes > 0 || self.files == Some(0)
    }
}

impl fmt::Display for FreeMemory {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { bytes, total_bytes, files } = self;
        write!(f, "{bytes} of {total_bytes} bytes are free")?;
        match files {
            Some(files) if *files < READER_PAGES => write!(f, ", and room for {files} more files"),
            _ => Ok(()),
        }
    }
}

/// Whether an operation on shared memory that has just failed on this thread failed for lack of memory.
pub(crate) fn is_refused() -> bool {
    REFUSED.get() || FreeMemory::now().is_some_and(|free| free.is_full())
}

/// Whether /dev/shm may have too few pages for a port.
pub(crate) fn is_scarce() -> bool {
    FreeMemory::now().is_some_and(|free| free.total_bytes > 0 && free.bytes < PORT_PAGES * page_bytes())
}

/// Notes that /dev/shm is full, for [`take_refusal`].
pub(crate) fn note_refusal() {
    REFUSED.set(true);
}

/// Whether this thread was refused memory since the last call.
pub(crate) fn take_refusal() -> bool {
    REFUSED.take()
}

/// The error of an operation that failed for `reason`; if it failed for lack of memory, it says that, and what helps.
pub(crate) fn failure(action: &'static str, name: &str, reason: impl fmt::Debug) -> IpcError {
    if !is_refused() {
        return IpcError::new(action, name, reason);
    }
    note_refusal();
    let free = FreeMemory::now().map_or_else(String::new, |free| format!(" ({free})"));
    let bytes = READER_PAGES * page_bytes();
    IpcError::full(
        action,
        name,
        format!(
            "{SHM} is full{free}: a reader needs up to {bytes} bytes there: remove what fills it, or enlarge it \
             (mount -o remount,size=…)"
        ),
    )
}

fn page_bytes() -> u64 {
    rustix::param::page_size() as u64
}

/// Pages in /dev/shm that the scheduler keeps for readers that join when no other page is left.
#[derive(Debug)]
pub struct Cushion(File);

impl Cushion {
    fn path(prefix: &RunPrefix) -> PathBuf {
        prefix.path("cushion")
    }

    /// Size of a full cushion, in bytes.
    pub fn bytes() -> u64 {
        READERS * READER_PAGES * page_bytes()
    }

    /// Creates the cushion of the run with this prefix. It is removed with the run's other shared memory.
    ///
    /// # Errors
    /// If it cannot be created.
    pub fn create(prefix: &RunPrefix) -> io::Result<Self> {
        let cushion = Self(create_own(&Self::path(prefix))?);
        cushion.refill();
        Ok(cushion)
    }

    /// Allocates what readers have taken, if there is room again. Returns whether it is full.
    pub fn refill(&self) -> bool {
        let is_full = self.0.metadata().is_ok_and(|metadata| metadata.len() >= Self::bytes());
        // Without room the file keeps what it has.
        is_full || fallocate(&self.0, FallocateFlags::empty(), 0, Self::bytes()).is_ok()
    }

    /// Gives the pages of one reader back to the system. Returns false if there were none.
    pub(crate) fn release(instance: &Instance) -> bool {
        let Some(prefix) = instance.prefix() else { return false };
        let Ok(file) = open_own(&Self::path(&prefix), OFlags::RDWR) else { return false };
        let Ok(metadata) = file.metadata() else { return false };
        let rest = metadata.len().saturating_sub(READER_PAGES * page_bytes());
        metadata.len() > 0 && file.set_len(rest).is_ok()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A file in /dev/shm; removed at the end.
    struct Shared(PathBuf, File);

    impl Shared {
        fn new(name: &str) -> Self {
            let path = PathBuf::from(format!("{SHM}/{name}-{}", std::process::id()));
            let file = File::options().read(true).write(true).create_new(true).open(&path).unwrap();
            Self(path, file)
        }

        fn blocks(&self) -> u64 {
            std::os::unix::fs::MetadataExt::blocks(&self.1.metadata().unwrap())
        }
    }

    impl Drop for Shared {
        fn drop(&mut self) {
            let _ = std::fs::remove_file(&self.0);
        }
    }

    #[test]
    fn small_files_get_their_pages_with_their_size() {
        let small = Shared::new("lookout.test.small");
        // SAFETY: an ordinary call of the C library, which this program replaces.
        assert_eq!(unsafe { libc::ftruncate(small.1.as_raw_fd(), 300) }, 0);
        assert_eq!(small.1.metadata().unwrap().len(), 300);
        assert!(small.blocks() > 0, "no page was allocated");
        let foreign = Shared::new("of-another-program");
        // SAFETY: as above.
        assert_eq!(unsafe { libc::ftruncate(foreign.1.as_raw_fd(), 300) }, 0);
        assert_eq!((foreign.1.metadata().unwrap().len(), foreign.blocks()), (300, 0));
        let pool = Shared::new("lookout.test.pool");
        // SAFETY: as above.
        assert_eq!(unsafe { libc::ftruncate(pool.1.as_raw_fd(), 1 << 20) }, 0);
        assert_eq!((pool.1.metadata().unwrap().len(), pool.blocks()), (1 << 20, 0));
        // SAFETY: as above; a descriptor that is not open is an error.
        assert_eq!(unsafe { libc::ftruncate(-1, 300) }, -1);
        assert_eq!(io::Error::last_os_error().raw_os_error(), Some(Errno::BADF.raw_os_error()));
    }

    #[test]
    fn a_full_file_system_is_recognised() {
        let free = |bytes, files| FreeMemory { bytes, total_bytes: 1 << 20, files };
        assert!(free(0, Some(10)).is_full() && free(4096, Some(0)).is_full());
        assert!(!free(4096, Some(1)).is_full() && !free(4096, None).is_full());
        assert_eq!(free(0, Some(3)).to_string(), "0 of 1048576 bytes are free, and room for 3 more files");
    }
}
