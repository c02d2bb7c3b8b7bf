//! One running daemon on this machine: its name, its folder, its lock and its shared memory.

use rustix::fs::{FlockOperation, flock, statvfs};
use std::fs::{File, OpenOptions};
use std::io::{self, Read, Seek, Write};
use std::os::unix::fs::{DirBuilderExt, MetadataExt};
use std::path::{Path, PathBuf};
use thiserror::Error;

/// Where shared memory lives on Linux.
const SHM: &str = "/dev/shm";

/// Names an instance; owns nothing.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Instance {
    name: String,
    directory: PathBuf,
}

/// Why an instance cannot be started.
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
    /// Its folder or shared memory cannot be used.
    #[error("{}: {source}: give a folder that this user may write with instance.directory", path.display())]
    Io {
        /// What was opened.
        path: PathBuf,
        /// Why it failed.
        source: io::Error,
    },
    /// Too little shared memory.
    #[error(
        "{SHM} has {free} bytes free, the message pools need {needed}: enlarge it \
         (mount -o remount,size=…), or lower stereo.disparities or the image size"
    )]
    Memory {
        /// Bytes that are free.
        free: u64,
        /// Bytes that the pools need.
        needed: u64,
    },
}

impl Instance {
    /// The instance `name`. An empty `directory` takes `$RUNTIME_DIRECTORY` (set by systemd), else
    /// a folder of this user's under /tmp.
    pub fn new(name: &str, directory: &Path) -> Self {
        let base = if !directory.as_os_str().is_empty() {
            directory.to_owned()
        } else if let Some(runtime) = std::env::var_os("RUNTIME_DIRECTORY").filter(|d| !d.is_empty()) {
            PathBuf::from(runtime)
        } else {
            std::env::temp_dir().join(format!("lookout-{}", rustix::process::getuid().as_raw()))
        };
        Self { name: name.to_owned(), directory: base.join(name) }
    }

    /// Its name.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Its folder, which only this instance uses.
    pub fn directory(&self) -> &Path {
        &self.directory
    }

    /// What all its shared memory starts with. The double underscore keeps "a" apart from "a_b".
    pub fn prefix(&self) -> String {
        format!("lookout_{}__", self.name)
    }

    /// Files in shared memory that belong to it.
    pub fn shared_memory(&self) -> Vec<PathBuf> {
        let prefix = self.prefix();
        let Ok(entries) = std::fs::read_dir(SHM) else { return Vec::new() };
        entries
            .flatten()
            .map(|entry| entry.path())
            .filter(|path| {
                path.file_name().is_some_and(|n| n.as_encoded_bytes().starts_with(prefix.as_bytes()))
            })
            .collect()
    }

    /// Bytes of all of them.
    pub fn shared_bytes(&self) -> u64 {
        self.shared_memory().iter().filter_map(|path| std::fs::metadata(path).ok()).map(|m| m.len()).sum()
    }

    /// Whether a daemon holds this instance.
    pub fn is_running(&self) -> bool {
        let Ok(file) = File::open(self.lock_path()) else { return false };
        flock(&file, FlockOperation::NonBlockingLockShared).is_err()
    }

    fn lock_path(&self) -> PathBuf {
        self.directory.join("lock")
    }
}

/// The right to run an instance: held by the scheduler while it lives. Taking it removes what an
/// earlier run left behind, dropping it removes everything that is left.
#[derive(Debug)]
pub struct InstanceLock {
    instance: Instance,
    file: File,
    /// Remains of an earlier run that were removed.
    pub stale: usize,
}

impl InstanceLock {
    /// Takes the instance over.
    ///
    /// # Errors
    /// When another daemon runs it, or its folder cannot be written.
    pub fn take(instance: &Instance) -> Result<Self, InstanceError> {
        let io = |path: &Path| {
            let path = path.to_owned();
            move |source| InstanceError::Io { path, source }
        };
        let path = instance.lock_path();
        loop {
            std::fs::DirBuilder::new()
                .recursive(true)
                .mode(0o750)
                .create(&instance.directory)
                .map_err(io(&instance.directory))?;
            let mut file = OpenOptions::new()
                .read(true)
                .write(true)
                .create(true)
                .truncate(false)
                .open(&path)
                .map_err(io(&path))?;
            if flock(&file, FlockOperation::NonBlockingLockExclusive).is_err() {
                let mut pid = String::new();
                let read = file.read_to_string(&mut pid);
                let known = read.is_ok() && !pid.trim().is_empty();
                return Err(InstanceError::Running {
                    name: instance.name.clone(),
                    pid: if known { pid.trim().to_owned() } else { "unknown".into() },
                });
            }
            // The holder before may have removed the file while we waited for it.
            let ours = file.metadata().map_err(io(&path))?.ino();
            if std::fs::metadata(&path).is_ok_and(|there| there.ino() == ours) {
                file.set_len(0).map_err(io(&path))?;
                file.rewind().map_err(io(&path))?;
                writeln!(file, "{}", std::process::id()).map_err(io(&path))?;
                let stale = remove_all(instance);
                return Ok(Self { instance: instance.clone(), file, stale });
            }
        }
    }

    /// Checks that shared memory has room for `needed` bytes more.
    ///
    /// # Errors
    /// When it has not.
    pub fn check_memory(&self, needed: u64) -> Result<(), InstanceError> {
        let stat =
            statvfs(SHM).map_err(|e| InstanceError::Io { path: SHM.into(), source: io::Error::from(e) })?;
        let free = stat.f_bavail.saturating_mul(stat.f_frsize);
        if free < needed { Err(InstanceError::Memory { free, needed }) } else { Ok(()) }
    }
}

/// Removes shared memory and folder entries of an instance, all but the lock.
fn remove_all(instance: &Instance) -> usize {
    let mut removed = 0;
    for path in instance.shared_memory() {
        removed += usize::from(std::fs::remove_file(path).is_ok());
    }
    let Ok(entries) = std::fs::read_dir(&instance.directory) else { return removed };
    for path in entries.flatten().map(|entry| entry.path()) {
        if path == instance.lock_path() {
            continue;
        }
        let gone = if path.is_dir() { std::fs::remove_dir_all(&path) } else { std::fs::remove_file(&path) };
        removed += usize::from(gone.is_ok());
    }
    removed
}

impl Drop for InstanceLock {
    fn drop(&mut self) {
        remove_all(&self.instance);
        // Best effort: what cannot be removed now is removed by the next run.
        let _ = std::fs::remove_file(self.instance.lock_path());
        let _ = std::fs::remove_dir(&self.instance.directory);
        if let Some(base) = self.instance.directory.parent() {
            // Only when it is empty and ours.
            let _ = std::fs::remove_dir(base);
        }
        let _ = flock(&self.file, FlockOperation::Unlock);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_instance_is_held_once_and_leaves_nothing() {
        let folder = tempfile::tempdir().unwrap();
        let base = folder.path().join("run");
        let instance = Instance::new("lock-test", &base);
        assert!(!instance.is_running());
        let lock = InstanceLock::take(&instance).unwrap();
        assert_eq!(lock.stale, 0);
        assert!(instance.is_running());
        let error = InstanceLock::take(&instance).unwrap_err().to_string();
        assert!(
            error.contains("already running") && error.contains(&std::process::id().to_string()),
            "{error}"
        );
        lock.check_memory(1).unwrap();
        assert!(lock.check_memory(u64::MAX).unwrap_err().to_string().contains("/dev/shm"));
        drop(lock);
        assert!(!instance.is_running() && !base.exists());
    }

    #[test]
    fn remains_of_a_killed_run_are_removed_and_others_are_not() {
        let folder = tempfile::tempdir().unwrap();
        let instance = Instance::new("stale-test", folder.path());
        let other = Instance::new("stale-test-2", folder.path());
        let stale = Path::new(SHM).join(format!("{}left.over", instance.prefix()));
        let foreign = Path::new(SHM).join(format!("{}kept", other.prefix()));
        std::fs::write(&stale, b"x").unwrap();
        std::fs::write(&foreign, b"x").unwrap();
        std::fs::create_dir_all(instance.directory().join("services/old")).unwrap();
        let lock = InstanceLock::take(&instance).unwrap();
        assert_eq!(lock.stale, 2);
        assert!(!stale.exists() && foreign.exists());
        drop(lock);
        std::fs::remove_file(foreign).unwrap();
        assert!(folder.path().exists() || !folder.path().join("stale-test").exists());
    }
}
