//! Distribution of messages to files: splitting, the ring buffer before an alarm, free space on the disk.

use super::file::McapFile;
use super::ring::Ring;
use super::storage::{Gone, Storage};
use super::topic::{ImageForm, Message, Topic};
use mcap::McapError;
use serde::Serialize;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use thiserror::Error;

/// Limits of a recording.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Limits {
    /// The most that a file may have, in bytes, unless a single frame needs more.
    pub split_bytes: Option<u64>,
    /// Time after which a new file is started, in nanoseconds.
    pub split_ns: Option<u64>,
    /// Free space on the disk below which the recording ends, in bytes.
    pub min_free_bytes: u64,
    /// If set, only the time around alarms is recorded.
    pub ring: Option<RingLimits>,
}

/// The ring buffer before an alarm.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RingLimits {
    /// Time before the alarm that is kept, in nanoseconds.
    pub before_ns: u64,
    /// Time after the last frame of the alarm that is recorded, in nanoseconds.
    pub after_ns: u64,
    /// Maximum memory of the ring buffer, in bytes.
    pub bytes: usize,
}

/// Metadata at the start of each file: the rig in full precision, and how it was recorded.
pub type About = BTreeMap<String, String>;

/// Input of a sink.
#[derive(Clone, Debug, PartialEq)]
pub enum Item {
    /// A message.
    Message(Message),
    /// The alarm is on.
    Alarm {
        /// Time of the frame, in nanoseconds since 1970.
        time_ns: u64,
    },
}

/// Bytes of a megabyte, as disks and files are measured. Memory is told in MiB.
pub const BYTES_PER_MB: u64 = 1_000_000;

/// Why a recording cannot start, or ends early.
#[derive(Debug, Error)]
pub enum RecordError {
    /// The file exists.
    #[error("{}: is there already: give another name, or remove it", path.display())]
    Exists {
        /// The file.
        path: PathBuf,
    },
    /// The disk has too little free space.
    #[error(
        "{}: the recording has ended: {free_mb} MB are free, {min_mb} MB must stay free (--min-free-mb): free \
         space, or record to another disk", path.display()
    )]
    Space {
        /// The file.
        path: PathBuf,
        /// Free megabytes.
        free_mb: u64,
        /// Megabytes that must stay free.
        min_mb: u64,
    },
    /// The file cannot be created.
    #[error(
        "{}: cannot be created: {reason}: nothing was recorded in it: give a file in a folder that exists and that this \
         user may write with -o", path.display()
    )]
    Create {
        /// The file.
        path: PathBuf,
        /// Why.
        reason: String,
    },
    /// The file can no longer be found under its name.
    #[error(
        "{}: the recording has ended: {Gone}: what was recorded in it is lost unless it was moved", path.display()
    )]
    Gone {
        /// The file.
        path: PathBuf,
    },
    /// The file cannot be written.
    #[error("{}: the recording has ended: {reason}: what was written before can be replayed", path.display())]
    Write {
        /// The file.
        path: PathBuf,
        /// Why.
        reason: String,
    },
    /// The disk is too slow.
    #[error(
        "{}: the recording has ended: the disk was too slow for {seconds} s: record fewer topics, with --jpeg, or \
         to a faster disk", path.display()
    )]
    Slow {
        /// The file.
        path: PathBuf,
        /// For how many seconds.
        seconds: u64,
    },
}

/// Summary of a recording.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Report {
    /// The files, in order.
    pub files: Vec<PathBuf>,
    /// Frames with images.
    pub frames: u64,
    /// Messages of all topics.
    pub messages: u64,
    /// Bytes of all files.
    pub bytes: u64,
    /// Number of lost messages by service.
    pub lost: BTreeMap<String, u64>,
}

/// Writes messages to one file, or to several.
pub struct Sink {
    storage: Box<dyn Storage>,
    path: PathBuf,
    form: ImageForm,
    limits: Limits,
    about: About,
    file: Option<McapFile>,
    /// Last messages of the topics that each file begins with.
    latched: BTreeMap<Topic, Message>,
    ring: Option<Ring>,
    /// Size of the current file at the last place where it could be split, in bytes; 0 before the first.
    split_place: u64,
    /// The most that a file has grown between two such places, in bytes.
    largest_frame: u64,
    /// Frames of the files before the current one.
    frames_before: u64,
    /// With a ring buffer: messages up to this time are written without it.
    open_until_ns: u64,
    is_short: bool,
    report: Report,
}

impl Sink {
    /// A sink that writes to `path`. If the limits can require several files, their names are numbered:
    /// `a.mcap` becomes `a_0001.mcap`.
    ///
    /// # Errors
    /// If the file exists, its folder cannot be written, or the disk has too little free space.
    pub fn new(
        storage: Box<dyn Storage>,
        path: &Path,
        form: ImageForm,
        limits: Limits,
        about: About,
    ) -> Result<Self, RecordError> {
        let ring = limits.ring.map(|ring| Ring::new(ring.before_ns, ring.bytes));
        let sink = Self {
            storage,
            path: path.to_owned(),
            form,
            limits,
            about,
            file: None,
            latched: BTreeMap::new(),
            ring,
            split_place: 0,
            largest_frame: 0,
            frames_before: 0,
            open_until_ns: 0,
            is_short: false,
            report: Report::default(),
        };
        if !sink.is_numbered() && sink.storage.exists(path) {
            return Err(RecordError::Exists { path: path.to_owned() });
        }
        sink.storage.check_folder(path).map_err(|error| create_error(path, &error))?;
        sink.check_space(path)?;
        Ok(sink)
    }

    /// Summary of what has been recorded so far.
    pub fn report(&self) -> Report {
        let mut report = self.report.clone();
        if let Some(file) = &self.file {
            report.bytes += file.bytes();
            report.messages += file.messages;
        }
        report
    }

    /// Whether the ring buffer had to drop messages because of its memory limit.
    pub fn is_short(&self) -> bool {
        self.is_short
    }

    fn is_numbered(&self) -> bool {
        self.limits.split_bytes.is_some() || self.limits.split_ns.is_some() || self.limits.ring.is_some()
    }

    fn next_path(&self) -> PathBuf {
        if !self.is_numbered() {
            return self.path.clone();
        }
        let stem = self.path.file_stem().unwrap_or_default().to_string_lossy();
        let number =
            |n: usize| self.path.with_file_name(format!("{stem}_{n:04}.{}", sources::recording::ENDING));
        // Files of earlier recordings are not overwritten.
        let mut n = self.report.files.len() + 1;
        while self.storage.exists(&number(n)) {
            n += 1;
        }
        number(n)
    }

    fn current(&self) -> PathBuf {
        self.report.files.last().unwrap_or(&self.path).clone()
    }

    fn write_error(&self, error: McapError) -> RecordError {
        let path = self.current();
        match error {
            McapError::Io(error) if error.get_ref().is_some_and(|inner| inner.is::<Gone>()) => {
                RecordError::Gone { path }
            }
            error => RecordError::Write { path, reason: error_text(error) },
        }
    }

    fn check_space(&self, path: &Path) -> Result<(), RecordError> {
        // Unknown free space does not prevent a recording.
        let Ok(free) = self.storage.free_bytes(path) else { return Ok(()) };
        if free >= self.limits.min_free_bytes {
            return Ok(());
        }
        let (free_mb, min_mb) = (free / BYTES_PER_MB, self.limits.min_free_bytes / BYTES_PER_MB);
        Err(RecordError::Space { path: path.to_owned(), free_mb, min_mb })
    }

    /// Processes an item.
    ///
    /// # Errors
    /// If the recording must end; [`Self::finish`] then closes the file as far as possible.
    pub fn take(&mut self, item: Item) -> Result<(), RecordError> {
        let message = match item {
            Item::Alarm { time_ns } => return self.alarm(time_ns),
            Item::Message(message) => message,
        };
        if message.topic.is_latched() {
            self.latched.insert(message.topic, message.clone());
        }
        if self.limits.ring.is_none() || message.time_ns <= self.open_until_ns {
            return self.write(&message);
        }
        if self.file.is_some() {
            self.close("the time after the alarm is over")?;
        }
        if let Some(ring) = &mut self.ring {
            self.is_short |= ring.push(message);
        }
        Ok(())
    }

    fn alarm(&mut self, time_ns: u64) -> Result<(), RecordError> {
        let Some(limits) = self.limits.ring else { return Ok(()) };
        self.open_until_ns = self.open_until_ns.max(time_ns.saturating_add(limits.after_ns));
        let kept: Vec<Message> = self.ring.as_mut().map(|ring| ring.drain().collect()).unwrap_or_default();
        kept.iter().try_for_each(|message| self.write(message))
    }

    fn write(&mut self, message: &Message) -> Result<(), RecordError> {
        // Files are split between frames only.
        if let Some(file) = &self.file
            && !matches!(message.topic, Topic::RightImage | Topic::Vehicle | Topic::Pair)
        {
            let size = file.size_if_ended();
            // Not the first: there are the latched messages, too.
            if self.split_place > 0 {
                self.largest_frame = self.largest_frame.max(size.saturating_sub(self.split_place));
            }
            self.split_place = size;
            // A file holds one frame at least.
            let has_frame = self.report.frames > self.frames_before;
            let is_full = |most: u64| size.saturating_add(self.largest_frame) > most;
            let is_long = (has_frame && self.limits.split_bytes.is_some_and(is_full))
                || self.limits.split_ns.is_some_and(|most| file.age_ns(message.time_ns) >= most);
            if is_long {
                self.close("continued in the next file")?;
            }
        }
        if self.file.is_none() {
            self.open(message)?;
        }
        let written = self.file.as_mut().map_or(Ok(false), |file| file.write(message));
        let is_flushed = written.map_err(|error| self.write_error(error))?;
        self.report.frames += u64::from(message.topic == Topic::Pair);
        if is_flushed {
            self.check_space(&self.current())?;
        }
        Ok(())
    }

    /// Starts a file with the latched messages; `first` is the message to be written next.
    fn open(&mut self, first: &Message) -> Result<(), RecordError> {
        let path = self.next_path();
        self.check_space(&path)?;
        let medium = self.storage.create(&path).map_err(|error| create_error(&path, &error))?;
        self.report.files.push(path);
        let started = McapFile::start(medium, self.form, &self.about);
        let mut file = started.map_err(|error| self.write_error(error))?;
        for message in self.latched.values().filter(|m| m.topic != first.topic) {
            let message = Message { time_ns: first.time_ns, ..message.clone() };
            file.write(&message).map_err(|error| self.write_error(error))?;
        }
        self.file = Some(file);
        (self.split_place, self.frames_before) = (0, self.report.frames);
        Ok(())
    }

    fn close(&mut self, reason: &str) -> Result<(), RecordError> {
        let Some(file) = self.file.take() else { return Ok(()) };
        let unfinished = file.bytes();
        self.report.messages += file.messages;
        let mut summary: BTreeMap<String, String> = self
            .report
            .lost
            .iter()
            .map(|(service, count)| (format!("lost {service}"), count.to_string()))
            .collect();
        summary.insert("frames so far".into(), self.report.frames.to_string());
        summary.insert("ended because".into(), reason.to_owned());
        let finished = file.finish(&summary);
        self.report.bytes += *finished.as_ref().unwrap_or(&unfinished);
        finished.map(|_| ()).map_err(|error| self.write_error(error))
    }

    /// Counts lost messages. The file reports them in the topic of losses and in the metadata at its end.
    ///
    /// # Errors
    /// As [`Self::take`].
    pub fn lost(&mut self, service: &str, count: u64, time_ns: u64) -> Result<(), RecordError> {
        let total = self.report.lost.entry(service.to_owned()).or_default();
        *total += count;
        let message = super::encode::loss(service, count, *total, time_ns);
        self.take(Item::Message(message))
    }

    /// Closes the last file.
    ///
    /// # Errors
    /// If it cannot be completed.
    pub fn finish(&mut self, reason: &str) -> Result<Report, RecordError> {
        self.close(reason)?;
        Ok(self.report.clone())
    }
}

fn create_error(path: &Path, error: &std::io::Error) -> RecordError {
    RecordError::Create { path: path.to_owned(), reason: error.to_string() }
}

fn error_text(error: McapError) -> String {
    match error {
        McapError::Io(error) => error.to_string(),
        other => other.to_string(),
    }
}
