//! An instance of the daemon on this machine: its name, its folder, its lock and its shared memory.
//!
//! The scheduler locks `<directory>/<name>/lock` while it runs; the file names the current run for readers. The
//! service registry is `<directory>/<name>/bus`. All files of a run in /dev/shm start with a unique prefix,
//! `lookout.<process>.<generation>.`, and the run holds a lock on its marker `<prefix>run` there. So files of dead
//! runs are distinguished from those of live ones, independent of names and folders, and no other file is removed.

use rustix::fs::{FlockOperation, flock, statvfs};
use rustix::io::Errno;
use rustix::process::geteuid;
use std::fs::{DirBuilder, File, OpenOptions};
use std::io::{self, Read, Seek, Write};
use std::os::unix::fs::{DirBuilderExt, MetadataExt};
use std::path::{Path, PathBuf};
use std::time::Duration;
use thiserror::Error;

/// Where shared memory lives on Linux.
const SHM: &str = "/dev/shm";

/// Prefix of all shared memory of all runs.
const SHM_PREFIX: &str = "lookout.";

/// Folder of the systemd service (`RuntimeDirectory=lookout`).
const SERVICE_DIRECTORY: &str = "/run/lookout";

/// Maximum length of a socket's path on Linux, without its terminating zero.
const MAX_SOCKET_PATH: usize = 107;

/// Number of characters that iceoryx2 appends to folder and prefix in the name of a socket.
const SOCKET_TAIL: usize = 46;

/// Third line of the lock file if its run created the base folder, and so has to remove it.
const CREATED_BASE: &str = "made its base folder";

/// How long to retry the lock: a reader that tests it holds it for a moment.
const LOCK_TIMEOUT: Duration = Duration::from_millis(200);

/// Name and folder of an instance. It owns no resources.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Instance {
    name: String,
    directory: PathBuf,
    /// The base folder is the default below /tmp, whose name other users can predict.
    is_default: bool,
}

/// Why an instance cannot be used.
#[derive(Debug, Error)]
pub enum InstanceError {
    /// Another daemon runs it.
    #[error(
        "a daemon named \"{name}\" is already running (process {pid}): stop it, or give this one another \
         name with --instance or instance.name"
    )]
    Running {
        /// Its name.
        name: String,
        /// Its process id from the lock file; "unknown" if it is not written yet.
        pid: String,
    },
    /// No daemon runs it.
    #[error(
        "no daemon named \"{0}\" is running: start one with lookout run, or name another with --instance"
    )]
    NotRunning(String),
    /// Its folder or shared memory cannot be used.
    #[error("{}: {source}: give a folder that this user may write with instance.directory", path.display())]
    Io {
        /// The file or folder.
        path: PathBuf,
        /// The cause.
        source: io::Error,
    },
    /// Its folder is not safe to use.
    #[error("{}: is owned by another user, writable by others, or a link: give another folder with instance.directory", path.display())]
    Foreign {
        /// The folder.
        path: PathBuf,
    },
    /// It belongs to another user.
    #[error(
        "the daemon \"{name}\" runs as user {owner}, this is user {user}: only its own user can use its folder and \
         shared memory"
    )]
    OtherUser {
        /// Its name.
        name: String,
        /// User id of the owner of its folder.
        owner: u32,
        /// User id of this process.
        user: u32,
    },
    /// The path of its sockets would be too long.
    #[error(
        "{} is {excess} characters too long for the sockets in it: shorten instance.directory or instance.name",
        path.display()
    )]
    TooLong {
        /// The folder.
        path: PathBuf,
        /// Number of characters above the maximum.
        excess: usize,
    },
    /// Too little shared memory.
    #[error(
        "{SHM} has {free} bytes free, the message pools need {needed}: enlarge it \
         (mount -o remount,size=…), or lower the image size"
    )]
    Memory {
        /// Free bytes.
        free: u64,
        /// Bytes that the pools require.
        needed: u64,
    },
}

fn io_error(path: &Path) -> impl FnOnce(io::Error) -> InstanceError {
    let path = path.to_owned();
    move |source| InstanceError::Io { path, source }
}

impl Instance {
    /// The instance `name`. If `directory` is empty, its base folder is `$RUNTIME_DIRECTORY` (set by systemd), else
    /// `/tmp/lookout-<user id>`.
    pub fn new(name: &str, directory: &Path) -> Self {
        let mut is_default = false;
        let base = if !directory.as_os_str().is_empty() {
            directory.to_owned()
        } else if let Some(runtime) = std::env::var_os("RUNTIME_DIRECTORY").filter(|d| !d.is_empty()) {
            PathBuf::from(runtime)
        } else {
            is_default = true;
            std::env::temp_dir().join(format!("lookout-{}", rustix::process::getuid().as_raw()))
        };
        Self { name: name.to_owned(), directory: base.join(name), is_default }
    }

    /// The instance for a reader: as [`Self::new`] if its folder exists, else in the folder of the systemd service. A
    /// default folder that another user made counts only if the service has none either.
    pub fn find(name: &str, directory: &Path) -> Self {
        let here = Self::new(name, directory);
        let is_usable = here.owner().is_some() && !here.has_foreign_base();
        if is_usable || !directory.as_os_str().is_empty() {
            return here;
        }
        let service = Self::new(name, Path::new(SERVICE_DIRECTORY));
        if service.owner().is_some() { service } else { here }
    }

    /// User id of the owner of its folder; `None` if the folder does not exist.
    pub fn owner(&self) -> Option<u32> {
        std::fs::symlink_metadata(&self.directory).ok().map(|m| m.uid())
    }

    /// Whether the base folder is the default one, exists, and is not a folder that only this user can write. Anybody
    /// can create a folder or link of that name in /tmp.
    fn has_foreign_base(&self) -> bool {
        let base = self.directory.parent().unwrap_or(Path::new("/"));
        self.is_default && std::fs::symlink_metadata(base).is_ok_and(|m| !is_private(&m))
    }

    /// Checks that the folder of the instance, if there is one, belongs to this process's user, and that no other user
    /// can write it. Everybody who reads a file in it or attaches to its shared memory has to check this first.
    ///
    /// # Errors
    /// [`InstanceError::OtherUser`] for another user's folder, [`InstanceError::Foreign`] for one that is a link, is
    /// writable by others, or stands in their default base folder.
    pub fn check_owner(&self) -> Result<(), InstanceError> {
        if self.has_foreign_base() {
            let base = self.directory.parent().unwrap_or(Path::new("/"));
            return Err(InstanceError::Foreign { path: base.to_owned() });
        }
        let Ok(metadata) = std::fs::symlink_metadata(&self.directory) else { return Ok(()) };
        let user = geteuid().as_raw();
        if metadata.is_dir() && metadata.uid() != user {
            return Err(InstanceError::OtherUser { name: self.name.clone(), owner: metadata.uid(), user });
        }
        if is_private(&metadata) {
            Ok(())
        } else {
            Err(InstanceError::Foreign { path: self.directory.clone() })
        }
    }

    /// As [`Self::check_owner`], but root may also use another user's folder if it does not stand in the default base
    /// folder: that of the systemd service, or one that `instance.directory` names.
    ///
    /// # Errors
    /// As [`Self::check_owner`].
    pub fn check_owner_or_root(&self) -> Result<(), InstanceError> {
        match self.check_owner() {
            Err(InstanceError::OtherUser { .. }) if geteuid().is_root() && !self.is_default => Ok(()),
            result => result,
        }
    }

    /// Its name.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Its folder, which no other instance uses.
    pub fn directory(&self) -> &Path {
        &self.directory
    }

    /// The folder of the service registry.
    pub fn bus_directory(&self) -> PathBuf {
        self.directory.join("bus")
    }

    /// Prefix of the shared memory of the current run; `None` if there is no run.
    pub fn prefix(&self) -> Option<String> {
        let text = std::fs::read_to_string(self.lock_path()).ok()?;
        let run = text.lines().nth(1)?;
        run.starts_with(SHM_PREFIX).then(|| run.to_owned())
    }

    /// Files in /dev/shm of the current run.
    pub fn shared_memory(&self) -> Vec<PathBuf> {
        self.prefix().map_or_else(Vec::new, |prefix| shared_files(&prefix))
    }

    /// Memory that these files take, in bytes: allocated pages only.
    pub fn shared_bytes(&self) -> u64 {
        self.shared_memory().iter().filter_map(|p| std::fs::metadata(p).ok()).map(|m| m.blocks() * 512).sum()
    }

    /// Whether a daemon holds the lock of this instance.
    pub fn is_running(&self) -> bool {
        let Ok(file) = File::open(self.lock_path()) else { return false };
        flock(&file, FlockOperation::NonBlockingLockShared) == Err(Errno::WOULDBLOCK)
    }

    fn lock_path(&self) -> PathBuf {
        self.directory.join("lock")
    }

    /// Creates the folder, and checks its owner and the length of its path. Returns whether the base folder was created.
    fn prepare(&self, prefix: &str) -> Result<bool, InstanceError> {
        let length = self.bus_directory().as_os_str().len() + 1 + prefix.len() + SOCKET_TAIL;
        if length > MAX_SOCKET_PATH {
            let path = self.directory.clone();
            return Err(InstanceError::TooLong { path, excess: length - MAX_SOCKET_PATH });
        }
        let base = self.directory.parent().unwrap_or(Path::new("/"));
        let created_base = !base.exists();
        let uid = rustix::process::getuid().as_raw();
        let mut builder = DirBuilder::new();
        builder.recursive(true).mode(0o750).create(&self.directory).map_err(io_error(&self.directory))?;
        // In /tmp another user could have created the folder first: it must be ours and writable only by us.
        let safe_base = |m: std::fs::Metadata| m.is_dir() && m.uid() == uid && m.mode() & 0o022 == 0;
        if self.is_default && !std::fs::symlink_metadata(base).is_ok_and(safe_base) {
            return Err(InstanceError::Foreign { path: base.to_owned() });
        }
        let metadata = std::fs::symlink_metadata(&self.directory).map_err(io_error(&self.directory))?;
        if metadata.uid() != uid || !metadata.is_dir() {
            return Err(InstanceError::Foreign { path: self.directory.clone() });
        }
        Ok(created_base)
    }
}

/// Whether it is a folder of this process's user that no other user can write.
fn is_private(metadata: &std::fs::Metadata) -> bool {
    metadata.is_dir() && metadata.uid() == geteuid().as_raw() && metadata.mode() & 0o022 == 0
}

/// Files in /dev/shm whose names start with `prefix`: the prefix of a run, or `lookout.` for all runs.
pub fn shared_entries(prefix: &str) -> Vec<PathBuf> {
    shared_files(prefix)
}

fn shared_files(prefix: &str) -> Vec<PathBuf> {
    let Ok(entries) = std::fs::read_dir(SHM) else { return Vec::new() };
    let ours = |path: &PathBuf| {
        path.file_name().is_some_and(|n| n.as_encoded_bytes().starts_with(prefix.as_bytes()))
    };
    entries.flatten().map(|entry| entry.path()).filter(ours).collect()
}

/// The marker of a run in /dev/shm. A live run holds a lock on it.
fn mark_path(prefix: &str) -> PathBuf {
    Path::new(SHM).join(format!("{prefix}run"))
}

/// Removes all shared memory of a run and returns the number of files. The marker is removed last, so that the next
/// sweep completes an interrupted removal.
fn remove_run(prefix: &str) -> usize {
    let mark = mark_path(prefix);
    let mut files = shared_files(prefix);
    files.sort_by_key(|file| *file == mark);
    files.iter().filter(|file| std::fs::remove_file(file).is_ok()).count()
}

/// Removes the shared memory of dead runs, whose markers are not locked. Returns the number of files.
fn sweep_dead_runs() -> usize {
    let mut removed = 0;
    for path in shared_files(SHM_PREFIX) {
        let Some(prefix) = path.file_name().and_then(|n| n.to_str()).and_then(|n| n.strip_suffix(".run"))
        else {
            continue;
        };
        let Ok(mark) = File::open(&path) else { continue };
        if flock(&mark, FlockOperation::NonBlockingLockExclusive).is_ok() {
            removed += remove_run(&format!("{prefix}."));
        }
    }
    removed
}

/// The lock of an instance, held by the scheduler while it runs. Taking it removes the remains of dead runs; dropping
/// it removes everything that this run created.
#[derive(Debug)]
pub struct InstanceLock {
    instance: Instance,
    lock: File,
    /// The locked marker of the run.
    _mark: File,
    prefix: String,
    created_base: bool,
    /// Number of files of dead runs that were removed.
    pub stale: usize,
}

impl InstanceLock {
    /// Takes the lock of an instance. `generation` distinguishes the runs of one process.
    ///
    /// # Errors
    /// If another daemon runs the instance, or its folder cannot be used.
    pub fn take(instance: &Instance, generation: u64) -> Result<Self, InstanceError> {
        let prefix = format!("{SHM_PREFIX}{}.{:04x}.", std::process::id(), generation & 0xffff);
        let path = instance.lock_path();
        let (mut lock, mut created_base) = open_lock(instance, &prefix)?;
        // A killed run could not remove the base folder that it had created. Its prefix is erased before its memory
        // is removed, so that no reader joins it.
        let mut before = String::new();
        let known = lock.read_to_string(&mut before).is_ok();
        created_base |= known && before.lines().nth(2) == Some(CREATED_BASE);
        lock.set_len(0).map_err(io_error(&path))?;
        lock.rewind().map_err(io_error(&path))?;
        let mut stale = sweep_dead_runs();
        let bus = instance.bus_directory();
        if std::fs::symlink_metadata(&bus).is_ok() {
            std::fs::remove_dir_all(&bus).map_err(io_error(&bus))?;
            stale += 1;
        }
        let mark = create_mark(instance, &prefix)?;
        let created = if created_base { CREATED_BASE } else { "" };
        lock.write_all(format!("{}\n{prefix}\n{created}\n", std::process::id()).as_bytes())
            .map_err(io_error(&path))?;
        Ok(Self { instance: instance.clone(), lock, _mark: mark, prefix, created_base, stale })
    }

    /// Prefix of the shared memory of this run.
    pub fn prefix(&self) -> &str {
        &self.prefix
    }

    /// Checks that `needed` bytes are free in /dev/shm.
    ///
    /// # Errors
    /// If they are not, or /dev/shm cannot be examined.
    pub fn check_memory(&self, needed: u64) -> Result<(), InstanceError> {
        let stat = statvfs(SHM).map_err(|e| io_error(Path::new(SHM))(e.into()))?;
        let free = stat.f_bavail.saturating_mul(stat.f_frsize);
        if free < needed { Err(InstanceError::Memory { free, needed }) } else { Ok(()) }
    }
}

/// Opens and locks the lock file of an instance. Returns it, and whether the base folder was created.
fn open_lock(instance: &Instance, prefix: &str) -> Result<(File, bool), InstanceError> {
    let path = instance.lock_path();
    let mut retries = LOCK_TIMEOUT.as_millis() / 10;
    let mut created_base = false;
    loop {
        created_base |= instance.prepare(prefix)?;
        let opened = OpenOptions::new().read(true).write(true).create(true).truncate(false).open(&path);
        let mut lock = match opened {
            Err(error) if error.kind() == io::ErrorKind::NotFound && retries > 0 => {
                // The previous holder has just removed the folder.
                retries -= 1;
                continue;
            }
            opened => opened.map_err(io_error(&path))?,
        };
        match flock(&lock, FlockOperation::NonBlockingLockExclusive) {
            Ok(()) => {}
            Err(Errno::WOULDBLOCK) if retries > 0 => {
                // It may only be a reader that tests whether a daemon is running.
                retries -= 1;
                std::thread::sleep(Duration::from_millis(10));
                continue;
            }
            Err(Errno::WOULDBLOCK) => {
                let mut text = String::new();
                let known = lock.read_to_string(&mut text).is_ok();
                let pid = text.lines().next().filter(|_| known).unwrap_or("unknown").to_owned();
                return Err(InstanceError::Running { name: instance.name.clone(), pid });
            }
            Err(error) => return Err(io_error(&path)(error.into())),
        }
        // The previous holder may have removed the file between the opening and the locking.
        let ours = lock.metadata().map_err(io_error(&path))?.ino();
        if std::fs::metadata(&path).is_ok_and(|there| there.ino() == ours) {
            return Ok((lock, created_base));
        }
    }
}

/// Creates the marker of a run and locks it.
fn create_mark(instance: &Instance, prefix: &str) -> Result<File, InstanceError> {
    // It is locked before it gets its final name, because a sweep treats an unlocked marker as that of a dead run.
    let new_path = Path::new(SHM).join(format!("{prefix}new"));
    let mark_path = mark_path(prefix);
    let mut mark = File::create(&new_path).map_err(io_error(&new_path))?;
    flock(&mark, FlockOperation::NonBlockingLockExclusive).map_err(|e| io_error(&mark_path)(e.into()))?;
    writeln!(mark, "{}", instance.name).map_err(io_error(&new_path))?;
    std::fs::rename(&new_path, &mark_path).map_err(io_error(&mark_path))?;
    Ok(mark)
}

impl Drop for InstanceLock {
    /// Best effort: the next run removes whatever remains.
    fn drop(&mut self) {
        remove_run(&self.prefix);
        let _ = std::fs::remove_dir_all(self.instance.bus_directory());
        let _ = std::fs::remove_file(self.instance.lock_path());
        let _ = std::fs::remove_dir(&self.instance.directory);
        if let (true, Some(base)) =
            (self.created_base || self.instance.is_default, self.instance.directory.parent())
        {
            // This fails if the folder is not empty.
            let _ = std::fs::remove_dir(base);
        }
        let _ = flock(&self.lock, FlockOperation::Unlock);
    }
}
