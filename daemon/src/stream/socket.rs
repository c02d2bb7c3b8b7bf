//! The file of the Unix socket: who may connect is who may write to it.

use config::Stream;
use messages::instance::check_trusted;
use rustix::io::Errno;
use rustix::net::{
    AddressFamily, SocketAddrUnix, SocketFlags, SocketType, bind, connect, listen, socket_with,
};
use std::fs::Permissions;
use std::io;
use std::os::unix::fs::{FileTypeExt, MetadataExt, PermissionsExt, lchown};
use std::os::unix::net::UnixListener;
use std::path::{Path, PathBuf};
use thiserror::Error;

/// Maximum length of a socket's path on Linux, without its terminating zero.
const MAX_PATH: usize = 107;

/// Connections that may wait to be accepted.
const BACKLOG: i32 = 16;

/// Where the names of groups are.
const GROUPS: &str = "/etc/group";

/// Why the socket cannot be made.
#[derive(Debug, Error)]
pub enum SocketError {
    /// None is configured.
    #[error(
        "stream.socket is empty: name the socket, for example with --set stream.socket=/run/lookout-stream/socket"
    )]
    None,
    /// Its path is too long.
    #[error("stream.socket = {}: is {excess} characters too long for a socket: give a shorter path", path.display())]
    TooLong {
        /// The path.
        path: PathBuf,
        /// Number of characters above the maximum.
        excess: usize,
    },
    /// Another user could replace it.
    #[error(
        "stream.socket = {}: another user can change {}: give a path in a folder that only root or this user can write",
        path.display(), folder.display()
    )]
    Untrusted {
        /// The path.
        path: PathBuf,
        /// The folder.
        folder: PathBuf,
    },
    /// Another process serves it.
    #[error("stream.socket = {}: another process serves it: end that, or give another path", .0.display())]
    Busy(PathBuf),
    /// The group does not exist.
    #[error("stream.group = {0}: {GROUPS} has no such group: create it (groupadd {0}), or give its number")]
    NoGroup(String),
    /// This process may not use the group.
    #[error(
        "stream.group = {0}: this process is no member of it: add its user (usermod -a -G {0} USER), or give \
         SupplementaryGroups={0} in its unit"
    )]
    NotMember(String),
    /// The system refuses.
    #[error("stream.socket = {}: {what}: {source}", path.display())]
    Io {
        /// The path.
        path: PathBuf,
        /// What failed.
        what: &'static str,
        /// The cause.
        source: io::Error,
    },
}

/// The file of a socket that this process serves; removed when dropped.
#[derive(Debug)]
pub struct SocketFile {
    path: PathBuf,
    /// Device and inode, so that nobody else's socket is removed.
    identity: (u64, u64),
}

impl Drop for SocketFile {
    fn drop(&mut self) {
        if identity(&self.path).is_ok_and(|now| now == self.identity) {
            let _ = std::fs::remove_file(&self.path);
        }
    }
}

fn identity(path: &Path) -> io::Result<(u64, u64)> {
    std::fs::symlink_metadata(path).map(|m| (m.dev(), m.ino()))
}

/// Makes the socket and listens. It appears under its name with its final group and mode.
///
/// # Errors
/// If the path, its folder or the group cannot be used.
pub fn open(settings: &Stream) -> Result<(UnixListener, SocketFile), SocketError> {
    if settings.socket.as_os_str().is_empty() {
        return Err(SocketError::None);
    }
    let io = |what| {
        let path = settings.socket.clone();
        move |source: io::Error| SocketError::Io { path, what, source }
    };
    let path = std::path::absolute(&settings.socket).map_err(io("cannot be found"))?;
    let folder = path.parent().unwrap_or(Path::new("/"));
    if let Err(messages::instance::InstanceError::Foreign { path: folder }) = check_trusted(folder) {
        return Err(SocketError::Untrusted { path, folder });
    }
    let mut new = path.clone().into_os_string();
    new.push(".new");
    let new = PathBuf::from(new);
    if let excess @ 1.. = new.as_os_str().len().saturating_sub(MAX_PATH) {
        return Err(SocketError::TooLong { path, excess });
    }
    for name in [&path, &new] {
        if is_served(name).map_err(io("cannot be examined"))? {
            return Err(SocketError::Busy(name.clone()));
        }
    }
    let group = group_id(&settings.group)?;
    // What an interrupted start has left; nobody serves it.
    let _ = std::fs::remove_file(&new);
    let socket =
        socket_with(AddressFamily::UNIX, SocketType::STREAM, SocketFlags::CLOEXEC, None).map_err(Errno::into);
    let socket = socket.map_err(io("cannot be created"))?;
    let address = SocketAddrUnix::new(&new).map_err(|e| io("is no path")(e.into()))?;
    bind(&socket, &address).map_err(|e| io("cannot be created")(e.into()))?;
    // Nobody can connect before it listens.
    let finish = || {
        if let Some(group) = group {
            lchown(&new, None, Some(group)).map_err(|source| match source.kind() {
                io::ErrorKind::PermissionDenied => SocketError::NotMember(settings.group.clone()),
                _ => io("cannot get its group")(source),
            })?;
        }
        let mode = Permissions::from_mode(u32::from_str_radix(&settings.mode, 8).unwrap_or(0o600));
        std::fs::set_permissions(&new, mode).map_err(io("cannot get its mode"))?;
        listen(&socket, BACKLOG).map_err(|e| io("cannot listen")(e.into()))?;
        let identity = identity(&new).map_err(io("cannot be examined"))?;
        std::fs::rename(&new, &path).map_err(io("cannot get its name"))?;
        Ok(SocketFile { path: path.clone(), identity })
    };
    match finish() {
        Ok(file) => Ok((UnixListener::from(socket), file)),
        Err(error) => {
            let _ = std::fs::remove_file(&new);
            Err(error)
        }
    }
}

/// Whether a process listens on a socket; false where there is none.
fn is_served(path: &Path) -> io::Result<bool> {
    match std::fs::symlink_metadata(path) {
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(false),
        Err(error) => return Err(error),
        Ok(metadata) if metadata.file_type().is_socket() => {}
        Ok(_) => {
            return Err(io::Error::other(
                "there is a file that is no socket: remove it, or give another path",
            ));
        }
    }
    let flags = SocketFlags::CLOEXEC | SocketFlags::NONBLOCK;
    let probe = socket_with(AddressFamily::UNIX, SocketType::STREAM, flags, None)?;
    match connect(&probe, &SocketAddrUnix::new(path)?) {
        // Its backlog may be full.
        Ok(()) | Err(Errno::AGAIN) => Ok(true),
        Err(Errno::CONNREFUSED | Errno::NOENT) => Ok(false),
        Err(error) => Err(error.into()),
    }
}

/// Number of a group, by name or number; `None` for an empty name, which keeps the group of the process.
fn group_id(name: &str) -> Result<Option<u32>, SocketError> {
    if name.is_empty() {
        return Ok(None);
    }
    if let Ok(number) = name.parse() {
        return Ok(Some(number));
    }
    let text = std::fs::read_to_string(GROUPS).unwrap_or_default();
    match number_of(name, &text) {
        Some(number) => Ok(Some(number)),
        None => Err(SocketError::NoGroup(name.to_owned())),
    }
}

/// Number of a group in the text of a group file: `name:password:number:members`.
fn number_of(name: &str, text: &str) -> Option<u32> {
    let mut groups = text.lines().map(|line| line.split(':'));
    groups.find_map(|mut fields| (fields.next() == Some(name)).then(|| fields.nth(1)?.parse().ok()).flatten())
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::os::unix::net::UnixStream;

    fn settings(path: &Path) -> Stream {
        Stream { socket: path.to_owned(), ..Stream::default() }
    }

    #[test]
    fn the_file_has_its_mode_and_group_and_goes_with_its_server() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("socket");
        let own = std::fs::metadata(folder.path()).unwrap().gid();
        for (mode, bits) in [("0600", 0o600), ("0660", 0o660), ("0666", 0o666)] {
            let group = own.to_string();
            let (listener, file) = open(&Stream { mode: mode.into(), group, ..settings(&path) }).unwrap();
            let metadata = std::fs::symlink_metadata(&path).unwrap();
            assert!(metadata.file_type().is_socket());
            assert_eq!((metadata.mode() & 0o7777, metadata.gid()), (bits, own), "{mode}");
            UnixStream::connect(&path).unwrap();
            assert!(matches!(open(&settings(&path)), Err(SocketError::Busy(_))));
            drop((listener, file));
            assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
        }
    }

    #[test]
    fn a_socket_that_nobody_serves_is_replaced_and_other_files_are_not() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("socket");
        drop(UnixListener::bind(&path).unwrap());
        let (_listener, file) = open(&settings(&path)).unwrap();
        // Another server has taken its name: that one's file stays.
        std::fs::remove_file(&path).unwrap();
        drop(UnixListener::bind(&path).unwrap());
        drop(file);
        assert!(path.exists());
        std::fs::remove_file(&path).unwrap();
        std::fs::write(&path, b"x").unwrap();
        let error = open(&settings(&path)).unwrap_err().to_string();
        assert!(error.contains("no socket: remove it"), "{error}");
        assert_eq!(std::fs::read(&path).unwrap(), b"x");
    }

    #[test]
    fn errors_name_the_key_and_the_remedy() {
        let folder = tempfile::tempdir().unwrap();
        let error = |settings: &Stream| open(settings).unwrap_err().to_string();
        assert!(error(&Stream::default()).starts_with("stream.socket is empty: name the socket"));
        let long = folder.path().join("x".repeat(120));
        assert!(error(&settings(&long)).contains("too long for a socket"));
        let missing = folder.path().join("no/such/socket");
        assert!(error(&settings(&missing)).contains("No such file"), "{}", error(&settings(&missing)));
        let path = folder.path().join("socket");
        let group = Stream { group: "no-such-group".into(), ..settings(&path) };
        assert!(error(&group).contains("groupadd no-such-group"));
        let open_to_all = folder.path().join("open");
        std::fs::create_dir(&open_to_all).unwrap();
        std::fs::set_permissions(&open_to_all, Permissions::from_mode(0o777)).unwrap();
        assert!(error(&settings(&open_to_all.join("socket"))).contains("another user can change"));
        assert!(!path.exists());
    }

    #[test]
    fn groups_are_found_by_name_and_number() {
        let text = "root:x:0:\nlookout-readers:x:977:alice,bob\nbroken\nlookout:x:no:\n";
        assert_eq!(number_of("lookout-readers", text), Some(977));
        assert_eq!(
            (number_of("lookout", text), number_of("broken", text), number_of("bob", text)),
            (None, None, None)
        );
        assert_eq!((group_id("").unwrap(), group_id("12").unwrap()), (None, Some(12)));
    }
}
