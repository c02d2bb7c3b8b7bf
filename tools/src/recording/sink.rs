//! What goes into which file: lengths, the ring before an alarm, the disk's free space.

use super::file::McapFile;
use super::ring::Ring;
use super::storage::Storage;
use super::topic::{ImageForm, Message, Topic};
use mcap::McapError;
use serde::Serialize;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use thiserror::Error;

/// Bounds of a recording.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Limits {
    /// A new file after this many bytes.
    pub split_bytes: Option<u64>,
    /// A new file after this time.
    pub split_ns: Option<u64>,
    /// The recording ends when fewer bytes are free.
    pub min_free_bytes: u64,
    /// Only what is around alarms is recorded.
    pub ring: Option<RingLimits>,
}

/// The ring before an alarm.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RingLimits {
    /// How much is kept from before it.
    pub before_ns: u64,
    /// How much is recorded after the last frame of it.
    pub after_ns: u64,
    /// The most memory that it takes.
    pub bytes: usize,
}

/// What a recording says of itself at its start: a file's rig and period are exact in it.
pub type About = BTreeMap<String, String>;

/// What a sink takes.
#[derive(Clone, Debug, PartialEq)]
pub enum Item {
    /// A message.
    Message(Message),
    /// The alarm is on, at this time.
    Alarm {
        /// Nanoseconds since 1970.
        time_ns: u64,
    },
}

/// Why a recording ends early.
#[derive(Debug, Error)]
pub enum RecordError {
    /// A file is there already.
    #[error("{}: is there already: give another name with -o, or remove it", path.display())]
    Exists {
        /// The file.
        path: PathBuf,
    },
    /// Too little room.
    #[error(
        "{}: the recording has ended: {free_mb} MB are free, {min_mb} MB must stay (--min-free-mb): make room, or \
         record elsewhere", path.display()
    )]
    Space {
        /// The file.
        path: PathBuf,
        /// Free megabytes.
        free_mb: u64,
        /// Megabytes that must stay free.
        min_mb: u64,
    },
    /// It cannot be written.
    #[error("{}: the recording has ended: {reason}: what was written until then can be replayed", path.display())]
    Write {
        /// The file.
        path: PathBuf,
        /// Why.
        reason: String,
    },
    /// The disk cannot follow.
    #[error(
        "{}: the recording has ended: the disk did not follow for {seconds} s: record fewer topics, --jpeg, or to a \
         faster disk", path.display()
    )]
    Slow {
        /// The file.
        path: PathBuf,
        /// How long.
        seconds: u64,
    },
}

/// What was recorded.
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
    /// Messages that were lost, by service.
    pub lost: BTreeMap<String, u64>,
}

/// See the module.
pub struct Sink {
    storage: Box<dyn Storage>,
    path: PathBuf,
    form: ImageForm,
    limits: Limits,
    about: About,
    file: Option<McapFile>,
    /// The last messages of topics that each file begins with.
    latched: BTreeMap<Topic, Message>,
    ring: Option<Ring>,
    /// With a ring: until when messages go straight to the file.
    open_until_ns: u64,
    is_short: bool,
    report: Report,
}

impl Sink {
    /// A sink that writes `path`, or, when it may need several files, `path` with numbers: `a.mcap`
    /// becomes `a_0001.mcap`.
    ///
    /// # Errors
    /// When the file is there already, or its disk has too little room.
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
            open_until_ns: 0,
            is_short: false,
            report: Report::default(),
        };
        if !sink.is_numbered() && sink.storage.exists(path) {
            return Err(RecordError::Exists { path: path.to_owned() });
        }
        sink.check_space(path)?;
        Ok(sink)
    }

    /// What was recorded so far.
    pub fn report(&self) -> Report {
        let mut report = self.report.clone();
        if let Some(file) = &self.file {
            report.bytes += file.bytes();
            report.messages += file.messages;
        }
        report
    }

    /// Whether the ring had to let go of messages for want of memory.
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
        // Files of an earlier recording stay.
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
        RecordError::Write { path: self.current(), reason: error_text(error) }
    }

    fn check_space(&self, path: &Path) -> Result<(), RecordError> {
        // A system that does not tell is no reason not to record.
        let Ok(free) = self.storage.free_bytes(path) else { return Ok(()) };
        if free >= self.limits.min_free_bytes {
            return Ok(());
        }
        let (free_mb, min_mb) = (free >> 20, self.limits.min_free_bytes >> 20);
        Err(RecordError::Space { path: path.to_owned(), free_mb, min_mb })
    }

    /// Takes an item.
    ///
    /// # Errors
    /// When the recording must end; [`Self::finish`] then closes it as well as it can.
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
        // The images of a frame stay together.
        if let Some(file) = &self.file
            && message.topic != Topic::RightImage
            && message.topic != Topic::Pair
        {
            let is_long = self.limits.split_bytes.is_some_and(|most| file.bytes() >= most)
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

    /// Starts a file that stands alone; `first` is about to be written.
    fn open(&mut self, first: &Message) -> Result<(), RecordError> {
        let path = self.next_path();
        self.check_space(&path)?;
        self.report.files.push(path.clone());
        let created = McapFile::create(self.storage.as_ref(), &path, self.form, &self.about);
        let mut file = created.map_err(|error| {
            // Nothing is there.
            self.report.files.pop();
            RecordError::Write { path, reason: error_text(error) }
        })?;
        for message in self.latched.values().filter(|m| m.topic != first.topic) {
            let message = Message { time_ns: first.time_ns, ..message.clone() };
            file.write(&message).map_err(|error| self.write_error(error))?;
        }
        self.file = Some(file);
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

    /// Counts messages that were lost; the file says so in its stream and at its end.
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
    /// When it cannot be written to its end.
    pub fn finish(&mut self, reason: &str) -> Result<Report, RecordError> {
        self.close(reason)?;
        Ok(self.report.clone())
    }
}

fn error_text(error: McapError) -> String {
    match error {
        McapError::Io(error) => error.to_string(),
        other => other.to_string(),
    }
}
