//! Other daemons of this machine, as far as this user can tell: for texts, when a reader does not find what it asked for.

use crate::instance::{Instance, InstanceError, SERVICE_DIRECTORY};
use crate::user;
use rustix::process::geteuid;
use std::fs::DirEntry;
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};

/// Maximum number of entries of a folder that are examined, and thus of instances that are named.
const MAX_EXAMINED: usize = 256;

/// Longest name of an instance that is told, in bytes: twice that of `instance.name`.
const MAX_NAME: usize = 32;

/// A folder of daemons that belongs to another user.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ForeignFolder {
    /// The base folder.
    pub path: PathBuf,
    /// User id of its owner.
    pub owner: u32,
    /// Names of the instances that run in it; empty where this user may not look inside.
    pub names: Vec<String>,
}

impl std::fmt::Display for ForeignFolder {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let (user, path) = (user::told(self.owner), self.path.display());
        match &self.names[..] {
            [] => write!(f, "user {user} runs daemons in {path}"),
            names => write!(f, "user {user} runs {} in {path}", names.join(", ")),
        }
    }
}

/// Other daemons than the one that was asked for.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Neighbours {
    /// The name that was asked for.
    pub asked: String,
    /// Names of those in the same base folder.
    pub names: Vec<String>,
    /// Folders of other users.
    pub foreign: Vec<ForeignFolder>,
}

impl Neighbours {
    /// Looks beside an instance, in the folder of the systemd service and in the default folders of other users.
    pub fn of(instance: &Instance) -> Self {
        let base = instance.directory().parent().unwrap_or(Path::new("/"));
        let mut names = running(base);
        names.retain(|name| name != instance.name());
        let user = geteuid().as_raw();
        let mut candidates = vec![PathBuf::from(SERVICE_DIRECTORY)];
        let temporary = entries(&std::env::temp_dir());
        candidates.extend(temporary.filter(|entry| default_owner(entry).is_some()).map(|entry| entry.path()));
        let is_served = |owner| processes_of(owner).next().is_some();
        let foreign = candidates.into_iter().filter(|path| path != base).filter_map(|path| {
            let metadata = std::fs::symlink_metadata(&path).ok().filter(std::fs::Metadata::is_dir)?;
            let owner = metadata.uid();
            // Whoever may look inside knows; for others a process has to show that it is no folder of a dead daemon.
            let may_look = std::fs::read_dir(&path).is_ok();
            let names = running(&path);
            let runs = if may_look { !names.is_empty() } else { is_served(owner) };
            (owner != user && runs).then_some(ForeignFolder { path, owner, names })
        });
        let mut foreign: Vec<_> = foreign.collect();
        foreign.sort_by(|a, b| a.path.cmp(&b.path));
        names.sort();
        Self { asked: instance.name().to_owned(), names, foreign }
    }
}

/// What is said of them after the text that an instance does not run.
impl std::fmt::Display for Neighbours {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        if !self.names.is_empty() {
            write!(f, " (running: {})", self.names.join(", "))?;
        }
        for folder in &self.foreign {
            write!(f, "; {folder}: see it with sudo -u {} lookout status", user::for_sudo(folder.owner))?;
            let is_asked = folder.names.is_empty() || folder.names.contains(&self.asked);
            let name = if is_asked { &self.asked } else { &folder.names[0] };
            if !name.is_empty() && name != DEFAULT_NAME {
                write!(f, " --instance {name}")?;
            }
        }
        Ok(())
    }
}

/// The error of a reader that finds an instance not running; it names those that are.
pub fn absent(instance: &Instance) -> InstanceError {
    let others = Neighbours::of(instance).to_string();
    InstanceError::NotRunning { name: instance.name().to_owned(), others }
}

/// Name of an instance where nothing sets another (`instance.name`).
pub const DEFAULT_NAME: &str = "lookout";

fn entries(folder: &Path) -> impl Iterator<Item = DirEntry> + use<> {
    std::fs::read_dir(folder).into_iter().flatten().take(MAX_EXAMINED).flatten()
}

/// The user whose default folder an entry of the temporary folder is. Anybody can create a folder of that name there,
/// so it has to belong to that user.
fn default_owner(entry: &DirEntry) -> Option<u32> {
    let name = entry.file_name().into_string().ok()?;
    let owner: u32 = name.strip_prefix("lookout-")?.parse().ok()?;
    (std::fs::symlink_metadata(entry.path()).ok()?.uid() == owner).then_some(owner)
}

/// Names of the instances that run in a base folder.
fn running(base: &Path) -> Vec<String> {
    let is_plain = |c: char| c.is_ascii_alphanumeric() || matches!(c, '-' | '_');
    let names = entries(base).filter_map(|entry| entry.file_name().into_string().ok());
    names
        .filter(|name| name.len() <= MAX_NAME && name.chars().all(is_plain))
        .filter(|name| !base.as_os_str().is_empty() && Instance::new(name, base).is_running())
        .collect()
}

/// Process ids of this program that a user runs; none where /proc hides them.
fn processes_of(owner: u32) -> impl Iterator<Item = u32> {
    let processes = std::fs::read_dir("/proc").into_iter().flatten().flatten();
    processes.filter_map(move |entry| {
        let pid: u32 = entry.file_name().to_str()?.parse().ok()?;
        let is_theirs = entry.metadata().ok()?.uid() == owner;
        let name = is_theirs.then(|| std::fs::read_to_string(entry.path().join("comm")).ok())??;
        name.starts_with("lookout").then_some(pid)
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::instance::InstanceLock;

    #[test]
    fn instances_that_run_beside_one_are_named_and_others_are_not() {
        let folder = tempfile::tempdir().unwrap();
        let asked = Instance::new("asked", folder.path());
        assert_eq!(Neighbours::of(&asked).names, Vec::<String>::new());
        let front = Instance::new("front", folder.path());
        let _lock = InstanceLock::take(&front).unwrap();
        std::fs::create_dir(folder.path().join("dead")).unwrap();
        std::fs::write(folder.path().join("dead/lock"), "1\n").unwrap();
        std::fs::create_dir(folder.path().join("odd;name")).unwrap();
        assert_eq!(Neighbours::of(&asked).names, ["front"]);
        assert_eq!(Neighbours::of(&front).names, Vec::<String>::new());
    }

    #[test]
    fn daemons_of_other_users_come_with_the_command_that_shows_them() {
        let folder = |names: &[&str]| ForeignFolder {
            path: "/run/lookout".into(),
            owner: 4_000_000_001,
            names: names.iter().map(|&name| name.to_owned()).collect(),
        };
        let asked = |asked: &str, foreign: ForeignFolder| {
            Neighbours { asked: asked.to_owned(), names: vec![], foreign: vec![foreign] }.to_string()
        };
        let text = |foreign: ForeignFolder| asked(DEFAULT_NAME, foreign);
        let hidden = "; user 4000000001 runs daemons in /run/lookout: see it with sudo -u '#4000000001' lookout status";
        assert_eq!(text(folder(&[])), hidden);
        assert!(text(folder(&["lookout"])).ends_with(" lookout status"));
        assert!(text(folder(&["rear"])).ends_with(" lookout status --instance rear"));
        // The one that was asked for, where it may be there.
        let ending = " lookout status --instance front";
        assert!(asked("front", folder(&[])).ends_with(ending));
        assert!(asked("front", folder(&["front", "rear"])).ends_with(ending));
        assert!(asked("front", folder(&["rear"])).ends_with(" --instance rear"));
    }
}
