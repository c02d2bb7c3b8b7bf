//! One running daemon on this machine: its name, its folder, its lock and its shared memory.
//!
//! `<directory>/<name>/lock` is held by the scheduler while it lives and tells readers which run is
//! on. The service registry is `<directory>/<name>/bus`. Everything in /dev/shm that a run makes
//! starts with a prefix of its own, `lookout.<process>.<generation>.`, and `<prefix>run` there is
//! held as long as the run lives: so what a dead run left is told from what a live one uses,
//! whatever their names and folders, and nothing else is ever removed.

use rustix::fs::{FlockOperation, flock, statvfs};
use rustix::io::Errno;
use std::fs::{DirBuilder, File, OpenOptions};
use std::io::{self, Read, Seek, Write};
use std::os::unix::fs::{DirBuilderExt, MetadataExt};
use std::path::{Path, PathBuf};
use std::time::Duration;
use thiserror::Error;

/// Where shared memory lives on Linux.
const SHM: &str = "/dev/shm";

/// What all our shared memory starts with.
const OWN: &str = "lookout.";

/// Where systemd puts the folder of the service.
const SERVICE_DIRECTORY: &str = "/run/lookout";

/// The longest path of a socket on Linux, less its terminating zero.
const LONGEST_SOCKET: usize = 107;

/// What the library adds to prefix and folder in the name of a socket.
const SOCKET_TAIL: usize = 46;

/// Third line of the lock when its run made the base folder, and so has to remove it.
const MADE: &str = "made its base folder";

/// How long a reader that looks at the lock may be in the way of one that takes it.
const LOCK_PATIENCE: Duration = Duration::from_millis(200);

/// Names an instance; owns nothing.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Instance {
    name: String,
    directory: PathBuf,
    /// The base folder is our own choice, of a name that anybody can guess.
    is_default: bool,
}

/// Why an instance cannot be used.
#[derive(Debug, Error)]
pub enum InstanceError {
    /// Another daemon has it.
    #[error(
        "a daemon named \"{name}\" is already running (process {pid}): stop it, or give this one another \
         name with --instance or instance.name"
    )]
    Running {
        /// Its name.
        name: String,
        /// Its process id, as it wrote it; "unknown" when it did not yet.
        pid: String,
    },
    /// There is no daemon.
    #[error(
        "no daemon named \"{0}\" is running: start one with lookout run, or name another with --instance"
    )]
    NotRunning(String),
    /// Its folder or shared memory cannot be used.
    #[error("{}: {source}: give a folder that this user may write with instance.directory", path.display())]
    Io {
        /// What was opened.
        path: PathBuf,
        /// Why it failed.
        source: io::Error,
    },
    /// Its folder belongs to somebody else.
    #[error("{}: belongs to another user, may be changed by one, or is a link: give another folder with instance.directory", path.display())]
    Foreign {
        /// The folder.
        path: PathBuf,
    },
    /// The path of a socket would be too long.
    #[error(
        "{} is {excess} characters too long for the sockets in it: shorten instance.directory or instance.name",
        path.display()
    )]
    TooLong {
        /// The folder.
        path: PathBuf,
        /// By how much.
        excess: usize,
    },
    /// Too little shared memory.
    #[error(
        "{SHM} has {free} bytes free, the message pools need {needed}: enlarge it \
         (mount -o remount,size=…), or lower the image size"
    )]
    Memory {
        /// Bytes that are free.
        free: u64,
        /// Bytes that the pools need.
        needed: u64,
    },
}

fn io_error(path: &Path) -> impl FnOnce(io::Error) -> InstanceError {
    let path = path.to_owned();
    move |source| InstanceError::Io { path, source }
}

impl Instance {
    /// The instance `name`. An empty `directory` takes `$RUNTIME_DIRECTORY` (set by systemd), else
    /// a folder of this user's under /tmp.
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

    /// The instance as a reader finds it: where it would be started from here, else where the
    /// service has it.
    pub fn find(name: &str, directory: &Path) -> Self {
        let here = Self::new(name, directory);
        if here.owner().is_some() || !directory.as_os_str().is_empty() {
            return here;
        }
        let service = Self::new(name, Path::new(SERVICE_DIRECTORY));
        if service.owner().is_some() { service } else { here }
    }

    /// The user who runs it, or has run it last; `None` when its folder is not there.
    pub fn owner(&self) -> Option<u32> {
        std::fs::symlink_metadata(&self.directory).ok().map(|m| m.uid())
    }

    /// Its name.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Its folder, which only this instance uses.
    pub fn directory(&self) -> &Path {
        &self.directory
    }

    /// The folder of the service registry.
    pub fn bus_directory(&self) -> PathBuf {
        self.directory.join("bus")
    }

    /// What the shared memory of the present run starts with; `None` when there is none.
    pub fn prefix(&self) -> Option<String> {
        let text = std::fs::read_to_string(self.lock_path()).ok()?;
        let run = text.lines().nth(1)?;
        run.starts_with(OWN).then(|| run.to_owned())
    }

    /// Files in shared memory that belong to the present run.
    pub fn shared_memory(&self) -> Vec<PathBuf> {
        self.prefix().map_or_else(Vec::new, |prefix| shared_files(&prefix))
    }

    /// Bytes of memory that they take: pages that were touched, not what is reserved.
    pub fn shared_bytes(&self) -> u64 {
        self.shared_memory().iter().filter_map(|p| std::fs::metadata(p).ok()).map(|m| m.blocks() * 512).sum()
    }

    /// Whether a daemon holds this instance.
    pub fn is_running(&self) -> bool {
        let Ok(file) = File::open(self.lock_path()) else { return false };
        flock(&file, FlockOperation::NonBlockingLockShared) == Err(Errno::WOULDBLOCK)
    }

    fn lock_path(&self) -> PathBuf {
        self.directory.join("lock")
    }

    /// Makes the folder, and makes sure that it is ours and short enough.
    fn prepare(&self, prefix: &str) -> Result<bool, InstanceError> {
        let length = self.bus_directory().as_os_str().len() + 1 + prefix.len() + SOCKET_TAIL;
        if length > LONGEST_SOCKET {
            let path = self.directory.clone();
            return Err(InstanceError::TooLong { path, excess: length - LONGEST_SOCKET });
        }
        let base = self.directory.parent().unwrap_or(Path::new("/"));
        let made_base = !base.exists();
        let uid = rustix::process::getuid().as_raw();
        let mut builder = DirBuilder::new();
        builder.recursive(true).mode(0o750).create(&self.directory).map_err(io_error(&self.directory))?;
        // Where anybody may make folders, only one that nobody else can change will do.
        let safe_base = |m: std::fs::Metadata| m.is_dir() && m.uid() == uid && m.mode() & 0o022 == 0;
        if self.is_default && !std::fs::symlink_metadata(base).is_ok_and(safe_base) {
            return Err(InstanceError::Foreign { path: base.to_owned() });
        }
        let metadata = std::fs::symlink_metadata(&self.directory).map_err(io_error(&self.directory))?;
        if metadata.uid() != uid || !metadata.is_dir() {
            return Err(InstanceError::Foreign { path: self.directory.clone() });
        }
        Ok(made_base)
    }
}

/// Files in shared memory whose names start with a prefix: those of a run, or of all of them
/// (`lookout.`).
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

/// The mark of a run in shared memory.
fn mark_path(prefix: &str) -> PathBuf {
    Path::new(SHM).join(format!("{prefix}run"))
}

/// Removes all shared memory of a run, its mark last, so that a removal that is cut short is taken
/// up again. Gives how many files.
fn remove_run(prefix: &str) -> usize {
    let mark = mark_path(prefix);
    let mut files = shared_files(prefix);
    files.sort_by_key(|file| *file == mark);
    files.iter().filter(|file| std::fs::remove_file(file).is_ok()).count()
}

/// Removes what runs left that are dead: those whose mark nobody holds. Gives how many files.
fn sweep_dead_runs() -> usize {
    let mut removed = 0;
    for path in shared_files(OWN) {
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

/// The right to run an instance: held by the scheduler while it lives. Taking it removes what dead
/// runs left behind, dropping it removes everything that this one made.
#[derive(Debug)]
pub struct InstanceLock {
    instance: Instance,
    lock: File,
    /// Held as long as the run lives.
    _mark: File,
    prefix: String,
    made_base: bool,
    /// Remains of dead runs that were removed.
    pub stale: usize,
}

impl InstanceLock {
    /// Takes the instance over. `generation` tells runs of one process apart.
    ///
    /// # Errors
    /// When another daemon runs it, or its folder cannot be used.
    pub fn take(instance: &Instance, generation: u64) -> Result<Self, InstanceError> {
        let prefix = format!("{OWN}{}.{:04x}.", std::process::id(), generation & 0xffff);
        let path = instance.lock_path();
        let mut patience = LOCK_PATIENCE.as_millis() / 10;
        let mut made_base = false;
        loop {
            made_base |= instance.prepare(&prefix)?;
            let opened = OpenOptions::new().read(true).write(true).create(true).truncate(false).open(&path);
            let mut lock = match opened {
                Err(error) if error.kind() == io::ErrorKind::NotFound && patience > 0 => {
                    // The holder before has just removed the folder.
                    patience -= 1;
                    continue;
                }
                opened => opened.map_err(io_error(&path))?,
            };
            match flock(&lock, FlockOperation::NonBlockingLockExclusive) {
                Ok(()) => {}
                Err(Errno::WOULDBLOCK) if patience > 0 => {
                    // Perhaps only a reader that looks whether a daemon is there.
                    patience -= 1;
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
            // The holder before may have removed the file while we waited for it.
            let ours = lock.metadata().map_err(io_error(&path))?.ino();
            if !std::fs::metadata(&path).is_ok_and(|there| there.ino() == ours) {
                continue;
            }
            // A run that was killed could not remove the folder that it had made. Its prefix is
            // forgotten before its memory goes, so that no reader joins it.
            let mut before = String::new();
            let known = lock.read_to_string(&mut before).is_ok();
            made_base |= known && before.lines().nth(2) == Some(MADE);
            lock.set_len(0).map_err(io_error(&path))?;
            lock.rewind().map_err(io_error(&path))?;
            let mut stale = sweep_dead_runs();
            let bus = instance.bus_directory();
            if std::fs::symlink_metadata(&bus).is_ok() {
                std::fs::remove_dir_all(&bus).map_err(io_error(&bus))?;
                stale += 1;
            }
            // Held before it bears its name: a sweep takes a mark that nobody holds for a dead run's.
            let new_path = Path::new(SHM).join(format!("{prefix}new"));
            let mark_path = mark_path(&prefix);
            let mut mark = File::create(&new_path).map_err(io_error(&new_path))?;
            flock(&mark, FlockOperation::NonBlockingLockExclusive)
                .map_err(|e| io_error(&mark_path)(e.into()))?;
            writeln!(mark, "{}", instance.name).map_err(io_error(&new_path))?;
            std::fs::rename(&new_path, &mark_path).map_err(io_error(&mark_path))?;
            let made = if made_base { MADE } else { "" };
            lock.write_all(format!("{}\n{prefix}\n{made}\n", std::process::id()).as_bytes())
                .map_err(io_error(&path))?;
            return Ok(Self { instance: instance.clone(), lock, _mark: mark, prefix, made_base, stale });
        }
    }

    /// What the shared memory of this run starts with.
    pub fn prefix(&self) -> &str {
        &self.prefix
    }

    /// Checks that shared memory has room for `needed` bytes more.
    ///
    /// # Errors
    /// When it has not.
    pub fn check_memory(&self, needed: u64) -> Result<(), InstanceError> {
        let stat = statvfs(SHM).map_err(|e| io_error(Path::new(SHM))(e.into()))?;
        let free = stat.f_bavail.saturating_mul(stat.f_frsize);
        if free < needed { Err(InstanceError::Memory { free, needed }) } else { Ok(()) }
    }
}

impl Drop for InstanceLock {
    /// Best effort: what cannot be removed now is removed by the next run.
    fn drop(&mut self) {
        remove_run(&self.prefix);
        let _ = std::fs::remove_dir_all(self.instance.bus_directory());
        let _ = std::fs::remove_file(self.instance.lock_path());
        let _ = std::fs::remove_dir(&self.instance.directory);
        if let (true, Some(base)) =
            (self.made_base || self.instance.is_default, self.instance.directory.parent())
        {
            // Only when it is empty.
            let _ = std::fs::remove_dir(base);
        }
        let _ = flock(&self.lock, FlockOperation::Unlock);
    }
}
