//! How the bus does, for `lookout status`: a file in the instance's folder that the sending process holds locked.

use messages::instance::Instance;
use rustix::fs::{FlockOperation, Mode, OFlags, flock, open};
use rustix::io::Errno;
use serde::{Deserialize, Serialize};
use std::fs::File;
use std::io::{self, Read};
use std::os::unix::fs::MetadataExt;
use std::path::Path;
use std::time::Duration;
use tools::can_out::LinkReport;

/// Maximum number of bytes that are read of the file.
const MAX_BYTES: u64 = 4096;

/// How often a file that is just being written is read again, and how often a lock that a reader holds is tried.
const TRIES: u32 = 20;

/// Pause between two tries.
const PAUSE: Duration = Duration::from_millis(10);

/// What the file holds.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct CanOutState {
    /// The interface.
    pub interface: String,
    /// The process that sends.
    pub pid: u32,
    /// State and counts.
    #[serde(flatten)]
    pub report: LinkReport,
}

impl CanOutState {
    /// One line of text.
    pub fn line(&self) -> String {
        let Self { interface, report, .. } = self;
        let state = serde_json::to_value(report.state).unwrap_or_default();
        let mut line = format!(
            "CAN out: {interface} {}, {} cycles ({} confirmed), {} frames dropped",
            state.as_str().unwrap_or("unknown").replace('_', " "),
            report.cycles,
            report.confirmed,
            report.dropped
        );
        if !report.reason.is_empty() {
            line.push_str(": ");
            line.push_str(&report.reason);
        }
        line
    }
}

/// The state of the process that sends for an instance; `None` if there is none.
pub fn read(instance: &Instance) -> Option<CanOutState> {
    for _ in 0..TRIES {
        let file = open_file(&instance.can_out_path(), OFlags::RDONLY).ok()?;
        match flock(&file, FlockOperation::NonBlockingLockShared) {
            Err(Errno::WOULDBLOCK) => {}
            // Nobody holds it: the process has ended.
            _ => return None,
        }
        let mut text = String::new();
        file.take(MAX_BYTES).read_to_string(&mut text).ok()?;
        if let Ok(state) = serde_json::from_str(&text) {
            return Some(state);
        }
        std::thread::sleep(PAUSE);
    }
    None
}

/// The file, open and locked.
#[cfg(any(feature = "can", test))]
#[derive(Debug)]
pub struct StateFile(File);

#[cfg(any(feature = "can", test))]
impl StateFile {
    /// Creates the file of an instance whose folder exists, and locks it.
    ///
    /// # Errors
    /// `WouldBlock` if another process holds it.
    pub fn create(instance: &Instance) -> io::Result<Self> {
        let path = instance.can_out_path();
        for _ in 0..TRIES {
            let file = open_file(&path, OFlags::RDWR | OFlags::CREATE)?;
            match flock(&file, FlockOperation::NonBlockingLockExclusive) {
                Ok(()) => return Ok(Self(file)),
                // It may only be a reader that tests whether it is locked.
                Err(Errno::WOULDBLOCK) => std::thread::sleep(PAUSE),
                Err(error) => return Err(error.into()),
            }
        }
        Err(io::ErrorKind::WouldBlock.into())
    }

    /// Replaces what it holds.
    ///
    /// # Errors
    /// If it cannot be written.
    pub fn write(&self, state: &CanOutState) -> io::Result<()> {
        use std::os::unix::fs::FileExt;
        let text = serde_json::to_vec(state)?;
        self.0.write_all_at(&text, 0)?;
        self.0.set_len(text.len() as u64)
    }
}

/// Opens a regular file of this user, without following a link.
fn open_file(path: &Path, flags: OFlags) -> io::Result<File> {
    let flags = flags | OFlags::NOFOLLOW | OFlags::NONBLOCK | OFlags::CLOEXEC;
    let file = File::from(open(path, flags, Mode::RUSR | Mode::WUSR)?);
    let metadata = file.metadata()?;
    if metadata.is_file() && metadata.uid() == rustix::process::geteuid().as_raw() {
        Ok(file)
    } else {
        Err(io::Error::new(io::ErrorKind::PermissionDenied, "not a regular file of this user"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use tools::can_out::LinkState;

    #[test]
    fn a_state_is_read_while_its_process_holds_it() {
        let folder = tempfile::tempdir().unwrap();
        let instance = Instance::new("car", folder.path());
        std::fs::create_dir(instance.directory()).unwrap();
        assert_eq!(read(&instance), None);
        let file = StateFile::create(&instance).unwrap();
        let report = LinkReport { reason: "x".repeat(300), ..LinkReport::default() };
        let long = CanOutState { interface: "can0".into(), pid: 7, report };
        file.write(&long).unwrap();
        assert_eq!(read(&instance), Some(long.clone()));
        let report = LinkReport { state: LinkState::BusOff, cycles: 3, ..LinkReport::default() };
        let short = CanOutState { report, ..long };
        file.write(&short).unwrap();
        assert_eq!(read(&instance), Some(short.clone()));
        assert_eq!(short.line(), "CAN out: can0 bus off, 3 cycles (0 confirmed), 0 frames dropped");
        let other = StateFile::create(&instance);
        assert_eq!(other.unwrap_err().kind(), io::ErrorKind::WouldBlock, "one process an instance");
        drop(file);
        assert_eq!(read(&instance), None, "the process has ended");
        std::fs::remove_file(instance.can_out_path()).unwrap();
        std::os::unix::fs::symlink("/etc/passwd", instance.can_out_path()).unwrap();
        assert!(read(&instance).is_none() && StateFile::create(&instance).is_err());
    }
}
