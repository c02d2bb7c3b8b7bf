//! Writer of one MCAP file.

use super::storage::{Counted, Medium};
use super::topic::{ImageForm, Message, Topic};
use mcap::records::{MessageHeader, Metadata};
use mcap::{McapError, WriteOptions, Writer};
use std::collections::BTreeMap;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

/// Size of a chunk, in bytes: the most that a truncated file loses.
const CHUNK_BYTES: u64 = 2 << 20;

/// Maximum duration of a chunk, in nanoseconds.
const CHUNK_NS: u64 = 1_000_000_000;

/// An MCAP file that is being written.
pub struct McapFile {
    writer: Writer<Counted>,
    form: ImageForm,
    channels: BTreeMap<Topic, u16>,
    bytes: Arc<AtomicU64>,
    /// Bytes of messages in the chunk that is being assembled.
    pending_bytes: u64,
    /// Bytes of the schemas, which the end of the file repeats.
    schema_bytes: u64,
    first_ns: Option<u64>,
    chunk_ns: u64,
    /// Number of messages written.
    pub messages: u64,
}

impl McapFile {
    /// Starts a file; `about` becomes its first record after the header.
    pub fn start(
        medium: Box<dyn Medium>,
        form: ImageForm,
        about: &BTreeMap<String, String>,
    ) -> Result<Self, McapError> {
        let (medium, bytes) = Counted::new(medium);
        let mut writer = WriteOptions::new()
            // Camera images hardly compress: lz4 reduces them by half a percent.
            .compression(None)
            .chunk_size(Some(CHUNK_BYTES))
            // A chunk is assembled in memory and written at once, with its length: only the end of the file can
            // be incomplete.
            .disable_seeking(true)
            .library(concat!("lookout ", env!("CARGO_PKG_VERSION")))
            .create(medium)?;
        let name = sources::recording::ABOUT.to_owned();
        writer.write_metadata(&Metadata { name, metadata: about.clone() })?;
        let channels = BTreeMap::new();
        let file = Self {
            writer,
            form,
            channels,
            bytes,
            pending_bytes: 0,
            schema_bytes: 0,
            first_ns: None,
            chunk_ns: 0,
            messages: 0,
        };
        Ok(file)
    }

    /// Number of bytes written so far.
    pub fn bytes(&self) -> u64 {
        self.bytes.load(Ordering::Relaxed)
    }

    /// Upper bound of the size that the file would have if it ended now, in bytes.
    pub fn size_if_ended(&self) -> u64 {
        /// Upper bound of what a message needs beside its data, with its places in the index.
        const MESSAGE_BYTES: u64 = 64;
        /// Upper bound of summary, statistics and footer.
        const END_BYTES: u64 = 4096;
        let overhead = END_BYTES + self.schema_bytes + MESSAGE_BYTES * self.messages;
        self.bytes().saturating_add(self.pending_bytes).saturating_add(overhead)
    }

    /// Time from the first message to `time_ns`, in nanoseconds.
    pub fn age_ns(&self, time_ns: u64) -> u64 {
        self.first_ns.map_or(0, |first| time_ns.saturating_sub(first))
    }

    /// Adds a message. Returns whether a chunk has been flushed to the disk.
    pub fn write(&mut self, message: &Message) -> Result<bool, McapError> {
        let channel = match self.channels.get(&message.topic) {
            Some(&channel) => channel,
            None => {
                let schema = message.topic.schema(self.form);
                self.schema_bytes += schema.data().len() as u64;
                let id = self.writer.add_schema(schema.name(), schema.encoding(), schema.data())?;
                let name = message.topic.name();
                let channel =
                    self.writer.add_channel(id, name, schema.message_encoding(), &BTreeMap::new())?;
                self.channels.insert(message.topic, channel);
                channel
            }
        };
        // Before the first message of a frame, so that its images are in the same chunk.
        let is_due = self.first_ns.is_some() && message.time_ns.saturating_sub(self.chunk_ns) >= CHUNK_NS;
        if is_due {
            self.writer.flush()?;
            self.pending_bytes = 0;
        }
        if is_due || self.first_ns.is_none() {
            self.chunk_ns = message.time_ns;
        }
        self.first_ns.get_or_insert(message.time_ns);
        let header = MessageHeader {
            channel_id: channel,
            sequence: message.sequence,
            log_time: message.time_ns,
            publish_time: message.time_ns,
        };
        let written = self.bytes.load(Ordering::Relaxed);
        self.writer.write_to_known_channel(&header, &message.data)?;
        // A chunk that is full is written, with all that was pending.
        let is_written = self.bytes.load(Ordering::Relaxed) != written;
        self.pending_bytes = if is_written { 0 } else { self.pending_bytes + message.data.len() as u64 };
        self.messages += 1;
        Ok(is_due)
    }

    /// Completes the file with the metadata `summary`, the index and the end magic. Returns its size in bytes.
    pub fn finish(mut self, summary: &BTreeMap<String, String>) -> Result<u64, McapError> {
        let name = sources::recording::SUMMARY.to_owned();
        self.writer.write_metadata(&Metadata { name, metadata: summary.clone() })?;
        self.writer.finish()?;
        use std::io::Write as _;
        self.writer.into_inner().flush()?;
        Ok(self.bytes.load(Ordering::Relaxed))
    }
}
