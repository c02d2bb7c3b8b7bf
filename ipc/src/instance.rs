//! An instance of the daemon on this machine: its name, its folder, its lock and its shared memory.
//!
//! The scheduler locks `<directory>/<name>/lock` while it runs; the file names the current run for readers. The
//! service registry is `<directory>/<name>/bus`. All files of a run in /dev/shm start with a prefix of its own, and the
//! run holds a lock on its mark there ([`crate::run_files`]). So files of dead runs are distinguished from those of live
//! ones, independent of names and folders, and no other file is removed.

use crate::node_counter;
use crate::run_files::{Inventory, RunMark, RunPrefix, SHM, open_regular, sweep_dead_runs};
use crate::user;
use rustix::fs::{FlockOperation, Mode, OFlags, fchmod, flock, open, statvfs};
use rustix::io::Errno;
use rustix::process::geteuid;
use std::fs::{DirBuilder, File, Metadata};
use std::io::{self, Read, Seek, Write};
use std::os::unix::fs::{DirBuilderExt, MetadataExt};
use std::path::{Path, PathBuf};
use std::time::Duration;
use thiserror::Error;

/// Folder of the systemd service (`RuntimeDirectory=lookout`).
pub(crate) const SERVICE_DIRECTORY: &str = "/run/lookout";

/// Maximum length of a socket's path on Linux, without its terminating zero.
const MAX_SOCKET_PATH: usize = 107;

/// Number of characters that iceoryx2 appends to folder and prefix in the name of a socket.
const SOCKET_TAIL: usize = 46;

/// Third line of the lock file if its run created the base folder, and so has to remove it.
const CREATED_BASE: &str = "made its base folder";

/// Maximum number of bytes that are read of a lock file.
const MAX_LOCK_BYTES: u64 = 4096;

/// Mode of the folders that are created: members of the group may look inside.
const FOLDER_MODE: u32 = 0o750;

/// Bits of a mode that let others write.
const WRITABLE_BY_OTHERS: u32 = 0o022;

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
        "no daemon named \"{name}\" is running: start one with lookout run, or name another with --instance{others}"
    )]
    NotRunning {
        /// Its name.
        name: String,
        /// Text on others that run; empty if there are none.
        others: String,
    },
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
        "the daemon \"{name}\" runs as user {}, this is user {}: only its own user can use its folder and \
         shared memory",
        user::told(*owner),
        user::told(*user)
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

    /// The file in which `lookout can` tells the state of its bus. It is removed with the run.
    pub fn can_out_path(&self) -> PathBuf {
        self.directory.join("can_out")
    }

    /// The folder of the service registry.
    pub fn bus_directory(&self) -> PathBuf {
        self.directory.join("bus")
    }

    /// Prefix of the shared memory of the current run; `None` if there is no run.
    pub fn prefix(&self) -> Option<RunPrefix> {
        let lock = open_regular(&self.lock_path(), OFlags::RDONLY).ok()?;
        read_lock(&lock).lines().nth(1).and_then(RunPrefix::parse)
    }

    /// Process id of the daemon that holds the lock; `None` if there is no run.
    pub fn process(&self) -> Option<u32> {
        std::fs::read_to_string(self.lock_path()).ok()?.lines().next()?.parse().ok()
    }

    /// Files in /dev/shm of the current run.
    pub fn shared_memory(&self) -> Vec<PathBuf> {
        self.prefix().map_or_else(Vec::new, |prefix| prefix.files())
    }

    /// Memory that these files take, in bytes: allocated pages only.
    pub fn shared_bytes(&self) -> u64 {
        self.shared_memory().iter().filter_map(|p| std::fs::metadata(p).ok()).map(|m| m.blocks() * 512).sum()
    }

    /// Whether a daemon holds the lock of this instance.
    pub fn is_running(&self) -> bool {
        let Ok(file) = open_regular(&self.lock_path(), OFlags::RDONLY) else { return false };
        flock(&file, FlockOperation::NonBlockingLockShared) == Err(Errno::WOULDBLOCK)
    }

    fn lock_path(&self) -> PathBuf {
        self.directory.join("lock")
    }

    /// Creates the folder, and checks the length of its path and that nobody else can change what lies in it. Returns
    /// whether the base folder was created.
    fn prepare(&self) -> Result<bool, InstanceError> {
        let length = self.bus_directory().as_os_str().len() + 1 + RunPrefix::LENGTH + SOCKET_TAIL;
        if length > MAX_SOCKET_PATH {
            let path = self.directory.clone();
            return Err(InstanceError::TooLong { path, excess: length - MAX_SOCKET_PATH });
        }
        let base = self.directory.parent().unwrap_or(Path::new("/"));
        check_trusted(base)?;
        let created_base = !base.exists();
        DirBuilder::new().recursive(true).mode(FOLDER_MODE).create(base).map_err(io_error(base))?;
        // In /tmp another user could have created it first.
        if self.is_default && !is_own_folder(base) {
            return Err(InstanceError::Foreign { path: base.to_owned() });
        }
        match DirBuilder::new().mode(FOLDER_MODE).create(&self.directory) {
            Err(error) if error.kind() != io::ErrorKind::AlreadyExists => {
                Err(io_error(&self.directory)(error))
            }
            _ if is_own_folder(&self.directory) => Ok(created_base),
            _ => Err(InstanceError::Foreign { path: self.directory.clone() }),
        }
    }
}

/// Whether it is a folder of this process's user that no other user can write.
fn is_private(metadata: &Metadata) -> bool {
    metadata.is_dir() && metadata.uid() == geteuid().as_raw() && metadata.mode() & WRITABLE_BY_OTHERS == 0
}

/// Whether it is a private folder, not a link to one.
fn is_own_folder(path: &Path) -> bool {
    std::fs::symlink_metadata(path).is_ok_and(|m| is_private(&m))
}

/// Checks that no other user can replace what lies in a folder: it, the folders above it and the links on its path
/// belong to this user or root, and where everybody may write, names can be removed by their owners alone (the sticky
/// bit). What does not exist yet is not checked.
///
/// # Errors
/// [`InstanceError::Foreign`] with the first folder or link that somebody else can change.
pub fn check_trusted(path: &Path) -> Result<(), InstanceError> {
    const WRITABLE_BY_ALL: u32 = 0o002;
    const STICKY: u32 = 0o1000;
    // In a user namespace root's files may belong to another number.
    let root = std::fs::metadata("/").map_or(0, |m| m.uid());
    let trusted = [0, root, geteuid().as_raw()];
    let is_foreign = |m: Metadata| {
        let replaceable = m.is_dir() && m.mode() & WRITABLE_BY_ALL != 0 && m.mode() & STICKY == 0;
        !trusted.contains(&m.uid()) || replaceable
    };
    // From the root on: nothing behind a foreign link is examined.
    let ancestors: Vec<&Path> = path.ancestors().filter(|path| !path.as_os_str().is_empty()).collect();
    for path in ancestors.into_iter().rev() {
        // The link itself, then where it leads to.
        let foreign = |metadata: io::Result<Metadata>| metadata.is_ok_and(is_foreign);
        if foreign(std::fs::symlink_metadata(path)) || foreign(std::fs::metadata(path)) {
            return Err(InstanceError::Foreign { path: path.to_owned() });
        }
    }
    Ok(())
}

/// Text of a lock file; empty if it cannot be read.
fn read_lock(lock: &File) -> String {
    let mut text = String::new();
    match lock.take(MAX_LOCK_BYTES).read_to_string(&mut text) {
        Ok(_) => text,
        Err(_) => String::new(),
    }
}

/// The lock of an instance, held by the scheduler while it runs. Taking it removes the remains of dead runs; dropping
/// it removes everything that this run created.
#[derive(Debug)]
pub struct InstanceLock {
    instance: Instance,
    lock: File,
    _mark: RunMark,
    prefix: RunPrefix,
    inventory: Inventory,
    created_base: bool,
    /// Number of files of dead runs that were removed.
    pub stale: usize,
}

impl InstanceLock {
    /// Takes the lock of an instance and starts a new run.
    ///
    /// # Errors
    /// If another daemon runs the instance, or its folder cannot be used.
    pub fn take(instance: &Instance) -> Result<Self, InstanceError> {
        let path = instance.lock_path();
        let (mut lock, mut created_base) = open_lock(instance)?;
        // A killed run could not remove the base folder that it had created. Its prefix is erased before its memory
        // is removed, so that no reader joins it.
        created_base |= read_lock(&lock).lines().nth(2) == Some(CREATED_BASE);
        lock.set_len(0).map_err(io_error(&path))?;
        lock.rewind().map_err(io_error(&path))?;
        let mut stale = sweep_dead_runs();
        let bus = instance.bus_directory();
        if std::fs::symlink_metadata(&bus).is_ok() {
            std::fs::remove_dir_all(&bus).map_err(io_error(&bus))?;
            stale += 1;
        }
        let prefix = RunPrefix::new().map_err(io_error(Path::new(SHM)))?;
        let failed = |(path, error): (PathBuf, io::Error)| io_error(&path)(error);
        let mark = RunMark::create(&prefix, &instance.name).map_err(failed)?;
        node_counter::create(&prefix).map_err(failed)?;
        // From here on readers can join.
        let created = if created_base { CREATED_BASE } else { "" };
        lock.write_all(format!("{}\n{}\n{created}\n", std::process::id(), prefix.as_str()).as_bytes())
            .map_err(io_error(&path))?;
        let inventory = Inventory::take([]);
        Ok(Self { instance: instance.clone(), lock, _mark: mark, prefix, inventory, created_base, stale })
    }

    /// Records the files that have to stay as long as the run: lock, service registry, mark, and the shared memory that
    /// this process has mapped.
    pub fn record_files(&mut self) {
        let own = [self.instance.lock_path(), self.instance.bus_directory()];
        self.inventory = Inventory::take(self.prefix.lasting_files().into_iter().chain(own));
    }

    /// A recorded file that another program has removed or replaced. Without it no process can join any more.
    pub fn missing_file(&self) -> Option<&Path> {
        self.inventory.missing()
    }

    /// Prefix of the shared memory of this run.
    pub fn prefix(&self) -> &RunPrefix {
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
fn open_lock(instance: &Instance) -> Result<(File, bool), InstanceError> {
    let path = instance.lock_path();
    let mut retries = LOCK_TIMEOUT.as_millis() / 10;
    let mut created_base = false;
    loop {
        created_base |= instance.prepare()?;
        let lock = match open_lock_file(&path) {
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
                let pid = read_lock(&lock).lines().next().unwrap_or("unknown").to_owned();
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

/// Opens the lock file for writing, or creates it. Only this user may read it: a shared lock of another user's process
/// would keep the daemon from starting.
fn open_lock_file(path: &Path) -> io::Result<File> {
    let flags = OFlags::RDWR | OFlags::CREATE | OFlags::NOFOLLOW | OFlags::NONBLOCK | OFlags::CLOEXEC;
    let mode = Mode::RUSR | Mode::WUSR;
    let file = File::from(open(path, flags, mode)?);
    fchmod(&file, mode)?;
    Ok(file)
}

impl Drop for InstanceLock {
    /// Best effort: the next run removes whatever remains.
    fn drop(&mut self) {
        self.prefix.remove_files();
        let _ = std::fs::remove_dir_all(self.instance.bus_directory());
        let _ = std::fs::remove_file(self.instance.can_out_path());
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
