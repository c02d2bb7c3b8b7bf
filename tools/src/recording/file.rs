//! One MCAP file while it is written.

use super::storage::{Counted, Storage};
use super::topic::{ImageForm, Message, Topic};
use mcap::records::{MessageHeader, Metadata};
use mcap::{McapError, WriteOptions, Writer};
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

/// A chunk is written when it holds this many bytes; what a cut costs is at most that.
const CHUNK_BYTES: u64 = 2 << 20;

/// And after this time, in nanoseconds.
const CHUNK_NS: u64 = 1_000_000_000;

/// See the module.
pub struct McapFile {
    writer: Writer<Counted>,
    form: ImageForm,
    channels: BTreeMap<Topic, u16>,
    bytes: Arc<AtomicU64>,
    first_ns: Option<u64>,
    chunk_ns: u64,
    /// Messages in it.
    pub messages: u64,
}

impl McapFile {
    /// Starts a file; `about` is its first record but the header.
    pub fn create(
        storage: &dyn Storage,
        path: &Path,
        form: ImageForm,
        about: &BTreeMap<String, String>,
    ) -> Result<Self, McapError> {
        let (medium, bytes) = Counted::new(storage.create(path)?);
        let mut writer = WriteOptions::new()
            // Grey levels of a camera hardly shrink: lz4 takes half a percent off them.
            .compression(None)
            .chunk_size(Some(CHUNK_BYTES))
            // A chunk is put together in memory and written at once, with its length: what is in the
            // file is whole but for its very end.
            .disable_seeking(true)
            .library(concat!("lookout ", env!("CARGO_PKG_VERSION")))
            .create(medium)?;
        let name = sources::recording::ABOUT.to_owned();
        writer.write_metadata(&Metadata { name, metadata: about.clone() })?;
        let channels = BTreeMap::new();
        let file = Self { writer, form, channels, bytes, first_ns: None, chunk_ns: 0, messages: 0 };
        Ok(file)
    }

    /// Bytes written so far.
    pub fn bytes(&self) -> u64 {
        self.bytes.load(Ordering::Relaxed)
    }

    /// Time from the first message to `time_ns`.
    pub fn age_ns(&self, time_ns: u64) -> u64 {
        self.first_ns.map_or(0, |first| time_ns.saturating_sub(first))
    }

    /// Adds a message. Gives whether a chunk has been brought to the disk.
    pub fn write(&mut self, message: &Message) -> Result<bool, McapError> {
        let channel = match self.channels.get(&message.topic) {
            Some(&channel) => channel,
            None => {
                let schema = message.topic.schema(self.form);
                let id = self.writer.add_schema(schema.name(), schema.encoding(), schema.data())?;
                let name = message.topic.name();
                let channel =
                    self.writer.add_channel(id, name, schema.message_encoding(), &BTreeMap::new())?;
                self.channels.insert(message.topic, channel);
                channel
            }
        };
        // Before the first message of a frame, so that its images stay together.
        let is_due = self.first_ns.is_some() && message.time_ns.saturating_sub(self.chunk_ns) >= CHUNK_NS;
        if is_due {
            self.writer.flush()?;
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
        self.writer.write_to_known_channel(&header, &message.data)?;
        self.messages += 1;
        Ok(is_due)
    }

    /// Ends the file with `summary`, its index and its end mark. Gives its length.
    pub fn finish(mut self, summary: &BTreeMap<String, String>) -> Result<u64, McapError> {
        let name = sources::recording::SUMMARY.to_owned();
        self.writer.write_metadata(&Metadata { name, metadata: summary.clone() })?;
        self.writer.finish()?;
        use std::io::Write as _;
        self.writer.into_inner().flush()?;
        Ok(self.bytes.load(Ordering::Relaxed))
    }
}
