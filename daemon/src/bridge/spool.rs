//! Events and their pictures on the disk: they wait there until they were sent, survive the bridge, and are read again on
//! request. Bounded: the oldest give way.
//!
//! A file is an entry. Its name is `<entry>-<event>.json`, or `<entry>-<event>-<frame>.jpg`; entries are numbered in the
//! order in which they were made. The file `sent` holds the number up to which they were sent.

use rustix::fs::{FlockOperation, flock};
use std::collections::VecDeque;
use std::fs::File;
use std::io::{self, Write};
use std::path::{Path, PathBuf};

/// Digits of an entry's number in a name, so that names sort by it.
const DIGITS: usize = 12;

/// Name of the file with the number of the last entry that was sent.
const SENT: &str = "sent";

/// Name of the file that the process holds locked.
const LOCK: &str = "lock";

/// An event, or a picture of one.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Entry {
    /// Its number, from 1.
    pub number: u64,
    /// Number of the event, from 1.
    pub event: u64,
    /// Number of the frame, for a picture.
    pub frame: Option<u64>,
    bytes: u64,
    /// The content, where the disk did not take it.
    content: Option<Vec<u8>>,
}

impl Entry {
    fn name(&self) -> String {
        let Self { number, event, .. } = self;
        match self.frame {
            None => format!("{number:0DIGITS$}-{event}.json"),
            Some(frame) => format!("{number:0DIGITS$}-{event}-{frame}.jpg"),
        }
    }

    fn parse(name: &str, bytes: u64) -> Option<Self> {
        let (stem, kind) = name.rsplit_once('.')?;
        let mut numbers = stem.split('-').map(|text| text.parse::<u64>().ok());
        let (number, event) = (numbers.next()??, numbers.next()??);
        let frame = match (kind, numbers.next()) {
            ("json", None) => None,
            ("jpg", Some(frame)) => Some(frame?),
            _ => return None,
        };
        numbers.next().is_none().then_some(Self { number, event, frame, bytes, content: None })
    }
}

/// The events on the disk.
#[derive(Debug)]
pub struct Spool {
    folder: PathBuf,
    entries: VecDeque<Entry>,
    bytes: u64,
    max_bytes: u64,
    last_entry: u64,
    last_event: u64,
    /// Entries that were removed before they were sent, by this process.
    lost: u64,
    sent: u64,
    is_failing: bool,
    _lock: File,
}

impl Spool {
    /// Opens a folder, which is created if needed.
    ///
    /// # Errors
    /// If it cannot be used, or another process uses it.
    pub fn open(folder: &Path, max_bytes: u64) -> io::Result<Self> {
        std::fs::create_dir_all(folder)?;
        let lock = File::create(folder.join(LOCK))?;
        flock(&lock, FlockOperation::NonBlockingLockExclusive)?;
        let mut entries = Vec::new();
        for file in std::fs::read_dir(folder)? {
            let file = file?;
            if let Some(entry) =
                file.file_name().to_str().and_then(|name| Entry::parse(name, file.metadata().ok()?.len()))
            {
                entries.push(entry);
            }
        }
        entries.sort_by_key(|entry| entry.number);
        let sent = std::fs::read_to_string(folder.join(SENT)).unwrap_or_default();
        let sent = sent.trim().parse().unwrap_or(0);
        // Events that were removed leave their number in the file.
        let last_entry = entries.last().map_or(0, |entry| entry.number).max(sent);
        let last_event = entries.iter().map(|entry| entry.event).max().unwrap_or(0);
        let mut spool = Self {
            folder: folder.to_owned(),
            bytes: entries.iter().map(|entry| entry.bytes).sum(),
            entries: entries.into(),
            max_bytes,
            last_entry,
            last_event,
            lost: 0,
            sent,
            is_failing: false,
            _lock: lock,
        };
        spool.shrink();
        Ok(spool)
    }

    /// Adds an event; `content` makes its text from its number. Returns the number.
    pub fn add_event(&mut self, content: impl FnOnce(u64) -> Vec<u8>) -> u64 {
        self.last_event += 1;
        let event = self.last_event;
        self.add(event, None, content(event));
        event
    }

    /// Adds a picture of an event.
    pub fn add_picture(&mut self, event: u64, frame: u64, jpeg: Vec<u8>) {
        self.add(event, Some(frame), jpeg);
    }

    fn add(&mut self, event: u64, frame: Option<u64>, content: Vec<u8>) {
        self.last_entry += 1;
        let bytes = content.len() as u64;
        let mut entry = Entry { number: self.last_entry, event, frame, bytes, content: None };
        if let Err(error) = self.write(&entry.name(), &content) {
            if !self.is_failing {
                tracing::warn!(%error, folder = %self.folder.display(), "events are kept in memory alone");
            }
            self.is_failing = true;
            entry.content = Some(content);
        } else {
            self.is_failing = false;
        }
        self.bytes += bytes;
        self.entries.push_back(entry);
        self.shrink();
    }

    /// Writes a file, complete or not at all.
    fn write(&self, name: &str, content: &[u8]) -> io::Result<()> {
        let new = self.folder.join("new");
        let mut file = File::create(&new)?;
        file.write_all(content)?;
        // An event must not be lost with the power.
        file.sync_data()?;
        std::fs::rename(&new, self.folder.join(name))
    }

    /// Removes the oldest entries, but never the last.
    fn shrink(&mut self) {
        while self.bytes > self.max_bytes && self.entries.len() > 1 {
            let Some(oldest) = self.entries.pop_front() else { return };
            self.bytes -= oldest.bytes;
            self.lost += u64::from(oldest.number > self.sent);
            let _ = std::fs::remove_file(self.folder.join(oldest.name()));
        }
    }

    /// The first entry after the one with a number.
    pub fn after(&self, number: u64) -> Option<Entry> {
        let place = self.entries.partition_point(|entry| entry.number <= number);
        self.entries.get(place).cloned()
    }

    /// The content of an entry.
    ///
    /// # Errors
    /// If it cannot be read; it may have given way meanwhile.
    pub fn read(&self, entry: &Entry) -> io::Result<Vec<u8>> {
        match &entry.content {
            Some(content) => Ok(content.clone()),
            None => std::fs::read(self.folder.join(entry.name())),
        }
    }

    /// All entries, the oldest first.
    pub fn entries(&self) -> impl DoubleEndedIterator<Item = &Entry> {
        self.entries.iter()
    }

    /// Number of the entry up to which they were sent.
    pub fn sent(&self) -> u64 {
        self.sent
    }

    /// Stores that entries up to one were sent.
    pub fn set_sent(&mut self, number: u64) {
        if number > self.sent {
            self.sent = number;
            if let Err(error) = self.write(SENT, number.to_string().as_bytes()) {
                tracing::debug!(%error, "events may be sent again after a restart");
            }
        }
    }

    /// Number of the last event, entries that were lost before they were sent, and bytes.
    pub fn figures(&self) -> (u64, u64, u64) {
        (self.last_event, self.lost, self.bytes)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn event(spool: &mut Spool, size: usize) -> u64 {
        spool.add_event(|number| vec![number as u8; size])
    }

    #[test]
    fn numbers_go_on_after_a_restart() {
        let folder = tempfile::tempdir().unwrap();
        let mut spool = Spool::open(folder.path(), 1000).unwrap();
        assert!(Spool::open(folder.path(), 1000).is_err(), "one process at a time");
        assert_eq!((event(&mut spool, 10), event(&mut spool, 10)), (1, 2));
        spool.add_picture(2, 77, vec![5; 20]);
        spool.set_sent(1);
        drop(spool);
        std::fs::write(folder.path().join("other.json"), b"x").unwrap();
        let mut spool = Spool::open(folder.path(), 1000).unwrap();
        assert_eq!((spool.sent(), spool.figures()), (1, (2, 0, 40)));
        let second = spool.after(spool.sent()).unwrap();
        assert_eq!((second.event, spool.read(&second).unwrap()), (2, vec![2; 10]));
        let picture = spool.after(second.number).unwrap();
        assert_eq!((picture.event, picture.frame), (2, Some(77)));
        assert_eq!(spool.after(picture.number), None);
        assert_eq!(event(&mut spool, 10), 3);
        assert_eq!(spool.after(picture.number).map(|entry| entry.event), Some(3));
    }

    #[test]
    fn the_oldest_give_way_and_are_counted_unless_they_were_sent() {
        let folder = tempfile::tempdir().unwrap();
        let mut spool = Spool::open(folder.path(), 100).unwrap();
        for _ in 0..3 {
            event(&mut spool, 40);
        }
        assert_eq!(spool.figures(), (3, 1, 80));
        spool.set_sent(2);
        event(&mut spool, 40);
        assert_eq!(spool.figures(), (4, 1, 80));
        event(&mut spool, 500);
        assert_eq!(spool.entries().map(|entry| entry.event).collect::<Vec<_>>(), [5], "the last stays");
        // Entry 5 stands beside the lock and the number of the last that was sent.
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 3);
    }

    #[test]
    fn events_survive_a_disk_that_takes_nothing() {
        let folder = tempfile::tempdir().unwrap();
        let inner = folder.path().join("spool");
        let mut spool = Spool::open(&inner, 100).unwrap();
        std::fs::remove_dir_all(&inner).unwrap();
        assert_eq!(event(&mut spool, 10), 1);
        let entry = spool.after(0).unwrap();
        assert_eq!(spool.read(&entry).unwrap(), vec![1; 10]);
    }
}
