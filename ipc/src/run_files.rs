//! The files of a run in /dev/shm: their names, the mark that tells live runs from dead ones, and their removal.
//!
//! /dev/shm is writable by every user, so nothing there is trusted by its name: only regular files of this user count,
//! they are opened without following links and without waiting, and created only where nothing exists.

use rustix::fs::{FlockOperation, Mode, OFlags, fchmod, flock, open};
use rustix::rand::{GetRandomFlags, getrandom};
use std::ffi::OsStr;
use std::fs::{File, Metadata};
use std::io::{self, Write};
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};

/// Where shared memory lives on Linux.
pub(crate) const SHM: &str = "/dev/shm";

/// Start of the names of all files of all runs.
const NAME: &str = "lookout.";

/// Number of random characters in the prefix of a run.
const RANDOM_CHARACTERS: usize = 12;

/// The random characters: 32 of them, so that each carries 5 bits of a random byte.
const ALPHABET: &[u8; 32] = b"abcdefghijklmnopqrstuvwxyz234567";

/// Name of a run's mark, after its prefix.
const MARK: &str = "run";

/// Start of the names of all files of a run, `lookout.<12 random characters>.`. The 60 random bits keep other users
/// from creating a file before the run does.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RunPrefix(String);

impl RunPrefix {
    /// Number of bytes of each prefix.
    pub(crate) const LENGTH: usize = NAME.len() + RANDOM_CHARACTERS + 1;

    /// A new prefix.
    ///
    /// # Errors
    /// If the system has no random numbers.
    pub(crate) fn new() -> io::Result<Self> {
        let mut bytes = [0_u8; RANDOM_CHARACTERS];
        // The kernel returns up to 256 bytes at once.
        getrandom(&mut bytes, GetRandomFlags::empty())?;
        let random: String = bytes.iter().map(|b| char::from(ALPHABET[usize::from(b % 32)])).collect();
        Ok(Self(format!("{NAME}{random}.")))
    }

    /// The prefix that `text` is, if it has exactly the form of one.
    pub(crate) fn parse(text: &str) -> Option<Self> {
        let random = text.strip_prefix(NAME)?.strip_suffix('.')?;
        let is_random = random.len() == RANDOM_CHARACTERS && random.bytes().all(|b| ALPHABET.contains(&b));
        is_random.then(|| Self(text.to_owned()))
    }

    /// Its text.
    pub fn as_str(&self) -> &str {
        &self.0
    }

    /// Its random characters, which no other run has.
    pub fn id(&self) -> &str {
        &self.0[NAME.len()..Self::LENGTH - 1]
    }

    /// Path of the run's file with this name after the prefix.
    pub(crate) fn path(&self, name: &str) -> PathBuf {
        Path::new(SHM).join(format!("{}{name}", self.0))
    }

    /// Files of this user that belong to the run.
    pub fn files(&self) -> Vec<PathBuf> {
        files(&self.0)
    }

    /// Files of the run that last as long as the process that maps them: the mark, and of what this process has mapped
    /// the pools of its publishers and the services that it has opened. Connections come and go with their readers.
    pub(crate) fn lasting_files(&self) -> Vec<PathBuf> {
        const LASTING: [&str; 2] = [".data", ".dynamic"];
        let start = self.path("").into_os_string().into_string().unwrap_or_default();
        let maps = std::fs::read_to_string("/proc/self/maps").unwrap_or_default();
        // Address, permissions, offset, device, inode, path: proc_pid_maps(5).
        let mapped = maps.lines().filter_map(|line| line.split_ascii_whitespace().nth(5));
        let lasting = |path: &&str| path.starts_with(&start) && LASTING.iter().any(|end| path.ends_with(end));
        mapped.filter(lasting).map(PathBuf::from).chain([self.path(MARK)]).collect()
    }

    /// Whether the run still has its mark.
    pub(crate) fn has_mark(&self) -> bool {
        std::fs::symlink_metadata(self.path(MARK)).is_ok_and(|m| is_own_file(&m))
    }

    /// Removes all files of the run and returns their number. The mark is removed last, so that the next sweep
    /// completes an interrupted removal.
    pub(crate) fn remove_files(&self) -> usize {
        let mark = self.path(MARK);
        let mut files = self.files();
        files.sort_by_key(|file| *file == mark);
        files.iter().filter(|file| std::fs::remove_file(file).is_ok()).count()
    }
}

/// Whether a file in /dev/shm has the name of a run's file.
pub(crate) fn is_name_of_run(name: &OsStr) -> bool {
    name.as_encoded_bytes().starts_with(NAME.as_bytes())
}

/// Files of this user in /dev/shm that belong to any run.
pub fn files_of_all_runs() -> Vec<PathBuf> {
    files(NAME)
}

fn files(start: &str) -> Vec<PathBuf> {
    let Ok(entries) = std::fs::read_dir(SHM) else { return Vec::new() };
    let ours = |path: &PathBuf| {
        path.file_name().is_some_and(|n| n.as_encoded_bytes().starts_with(start.as_bytes()))
            && std::fs::symlink_metadata(path).is_ok_and(|m| is_own_file(&m))
    };
    entries.flatten().map(|entry| entry.path()).filter(ours).collect()
}

/// Whether it is a regular file that belongs to this user.
pub(crate) fn is_own_file(metadata: &Metadata) -> bool {
    metadata.is_file() && metadata.uid() == rustix::process::geteuid().as_raw()
}

/// Opens a regular file; a FIFO does not block, and a link is not followed.
///
/// # Errors
/// If it cannot be opened, or it is something else (`PermissionDenied`).
pub(crate) fn open_regular(path: &Path, flags: OFlags) -> io::Result<File> {
    open_if(path, flags, Metadata::is_file, "not a regular file")
}

/// As [`open_regular`], and only if the file belongs to this user.
///
/// # Errors
/// As [`open_regular`].
pub(crate) fn open_own(path: &Path, flags: OFlags) -> io::Result<File> {
    open_if(path, flags, is_own_file, "not a regular file of this user")
}

fn open_if(path: &Path, flags: OFlags, is: fn(&Metadata) -> bool, what: &'static str) -> io::Result<File> {
    let flags = flags | OFlags::NOFOLLOW | OFlags::NONBLOCK | OFlags::CLOEXEC;
    let file = File::from(open(path, flags, Mode::empty())?);
    // Examined when it is open, so that it cannot be replaced in between.
    if is(&file.metadata()?) { Ok(file) } else { Err(io::Error::new(io::ErrorKind::PermissionDenied, what)) }
}

/// Creates a file that only this user may read and write.
///
/// # Errors
/// If it cannot be created, in particular if anything has this name, even a link.
pub(crate) fn create_own(path: &Path) -> io::Result<File> {
    let flags = OFlags::RDWR | OFlags::CREATE | OFlags::EXCL | OFlags::NOFOLLOW | OFlags::CLOEXEC;
    let mode = Mode::RUSR | Mode::WUSR;
    let file = File::from(open(path, flags, mode)?);
    // The file mode creation mask may have taken more away.
    fchmod(&file, mode)?;
    Ok(file)
}

/// The locked mark of a live run.
#[derive(Debug)]
pub(crate) struct RunMark {
    /// Held open, and so locked.
    _file: File,
}

impl RunMark {
    /// Creates the mark of a run and locks it. Its content, the name of the instance, is for people.
    ///
    /// # Errors
    /// The file that cannot be created, written or renamed, and why.
    pub(crate) fn create(prefix: &RunPrefix, instance: &str) -> Result<Self, (PathBuf, io::Error)> {
        // It is locked before it gets its final name, because a sweep treats an unlocked mark as that of a dead run.
        let (new, path) = (prefix.path("new"), prefix.path(MARK));
        let mark = || -> io::Result<File> {
            let mut file = create_own(&new)?;
            flock(&file, FlockOperation::NonBlockingLockExclusive)?;
            writeln!(file, "{instance}")?;
            std::fs::rename(&new, &path)?;
            Ok(file)
        };
        Ok(Self { _file: mark().map_err(|error| (path.clone(), error))? })
    }
}

/// Removes the shared memory of dead runs of this user, whose marks are not locked. Returns the number of files.
pub(crate) fn sweep_dead_runs() -> usize {
    let mut removed = 0;
    for path in files_of_all_runs() {
        let name = path.file_name().and_then(|n| n.to_str());
        let Some(prefix) = name.and_then(|n| n.strip_suffix(MARK)).and_then(RunPrefix::parse) else {
            continue;
        };
        let Ok(mark) = open_own(&path, OFlags::RDONLY) else { continue };
        if flock(&mark, FlockOperation::NonBlockingLockExclusive).is_ok() {
            removed += prefix.remove_files();
        }
    }
    removed
}

/// The files that a live run depends on, to detect that another program has removed one of them.
#[derive(Debug)]
pub(crate) struct Inventory {
    /// Path and inode.
    files: Vec<(PathBuf, u64)>,
}

impl Inventory {
    /// Records the files that exist now.
    pub(crate) fn take(paths: impl IntoIterator<Item = PathBuf>) -> Self {
        let inode = |path: PathBuf| std::fs::symlink_metadata(&path).ok().map(|m| (path, m.ino()));
        Self { files: paths.into_iter().filter_map(inode).collect() }
    }

    /// The first file that is gone or was replaced.
    pub(crate) fn missing(&self) -> Option<&Path> {
        let is_there = |path: &Path, inode| rustix::fs::lstat(path).is_ok_and(|s| s.st_ino == inode);
        self.files.iter().find(|(path, inode)| !is_there(path, *inode)).map(|(path, _)| path.as_path())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn prefixes_are_random_and_parsed_strictly() {
        let (a, b) = (RunPrefix::new().unwrap(), RunPrefix::new().unwrap());
        assert_ne!(a, b);
        assert_eq!(a.as_str().len(), RunPrefix::LENGTH);
        assert_eq!(RunPrefix::parse(a.as_str()), Some(a));
        for text in [
            "lookout.",
            "lookout..",
            "lookout.x.",
            "lookout.abcdefghijkl",
            "lookout.abcdefghijkL.",
            "lookout.abcdefghijk..",
            "lookout.abcdefghijk/.",
            "lookout.abcdefghijklm.",
            "Lookout.abcdefghijkl.",
            "",
        ] {
            assert_eq!(RunPrefix::parse(text), None, "{text}");
        }
    }

    #[test]
    fn nothing_but_a_regular_file_of_ours_is_opened_and_nothing_that_exists_is_created() {
        let folder = tempfile::tempdir().unwrap();
        let path = |name: &str| folder.path().join(name);
        std::fs::write(path("file"), "x").unwrap();
        std::os::unix::fs::symlink(path("file"), path("link")).unwrap();
        std::os::unix::fs::symlink(path("absent"), path("dangling")).unwrap();
        rustix::fs::mkfifoat(rustix::fs::CWD, path("fifo"), Mode::RUSR | Mode::WUSR).unwrap();
        assert!(open_own(&path("file"), OFlags::RDONLY).is_ok());
        for name in ["link", "dangling", "fifo", ".", "absent"] {
            assert!(open_own(&path(name), OFlags::RDONLY).is_err(), "{name}");
        }
        for name in ["file", "link", "dangling", "fifo"] {
            assert!(create_own(&path(name)).is_err(), "{name}");
        }
        assert!(!path("absent").exists());
        let mode = create_own(&path("new")).unwrap().metadata().unwrap().mode();
        assert_eq!(mode & 0o777, 0o600);
    }

    #[test]
    fn an_inventory_detects_removed_and_replaced_files() {
        let folder = tempfile::tempdir().unwrap();
        let paths = ["a", "b"].map(|name| folder.path().join(name));
        paths.iter().for_each(|path| std::fs::write(path, "x").unwrap());
        let inventory = Inventory::take(paths.clone());
        assert_eq!(inventory.missing(), None);
        std::fs::write(folder.path().join("c"), "x").unwrap();
        std::fs::rename(folder.path().join("c"), &paths[1]).unwrap();
        assert_eq!(inventory.missing(), Some(paths[1].as_path()));
        std::fs::remove_file(&paths[0]).unwrap();
        assert_eq!(inventory.missing(), Some(paths[0].as_path()));
    }
}
