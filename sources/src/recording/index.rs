//! Index of an MCAP file: where its messages are. It is built from the records themselves, not from the summary
//! at the end of the file, which a truncated recording does not have.

use super::{RecordingError, lengths};
use crate::foreign;
use crate::limits::{
    MAX_CHUNK_BYTES, MAX_CHUNK_MESSAGES, MAX_CHUNKS, MAX_DESCRIPTION_BYTES, MAX_KEPT_BYTES, MAX_MESSAGES,
    MAX_TOPICS,
};
use mcap::read::parse_record;
use mcap::records::{Record, op};
use mcap::sans_io::linear_reader::{LinearReadEvent, LinearReader, LinearReaderOptions};
use perception::excerpt::{REASON_CHARS, VALUE_CHARS, excerpt};
use prost::bytes::Bytes;
use std::collections::BTreeMap;
use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

/// Bytes of the opcode and the length before each record.
const RECORD_HEAD: u64 = 9;

/// Error of a record that [`lengths::fit`] rejects.
const LONGER: &str = "a length in a record reaches beyond its end";

/// The truncated part at the end of a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Cut {
    /// Offset of the first incomplete record, in bytes.
    pub at: u64,
    /// Number of bytes from there to the end of the file.
    pub bytes: u64,
}

/// A topic of a file: an MCAP channel and its schema.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Channel {
    /// Name of the topic.
    pub topic: String,
    /// Encoding of its messages: `protobuf`, `cdr`, `json`.
    pub encoding: String,
    /// Name of the message type.
    pub schema: String,
}

/// A message as the file holds it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Stored {
    /// Channel identifier of its topic.
    pub channel: u16,
    /// Log time, in nanoseconds.
    pub time_ns: u64,
    /// The encoded message.
    pub data: Bytes,
}

/// A record with messages: a chunk, or a single message outside of chunks.
#[derive(Clone, Debug)]
struct Place {
    opcode: u8,
    at: u64,
    length: u64,
    /// Channel identifier and log time of each message.
    messages: Vec<(u16, u64)>,
}

/// The records of a file that hold messages, and its topics and metadata.
#[derive(Debug)]
pub struct Index {
    path: PathBuf,
    file: File,
    channels: BTreeMap<u16, Channel>,
    schemas: BTreeMap<u16, String>,
    places: Vec<Place>,
    metadata: BTreeMap<String, BTreeMap<String, String>>,
    /// Number of messages of all places.
    messages: usize,
    /// Bytes of all names and metadata.
    kept_bytes: usize,
    /// The truncated part, if there is one.
    pub cut: Option<Cut>,
}

impl Index {
    /// Reads the heads of all records. A truncated file is read up to its last complete chunk.
    ///
    /// # Errors
    /// If the file cannot be read, is not an MCAP file, or a record before its end is damaged.
    pub fn open(path: &Path) -> Result<Self, RecordingError> {
        let io = |source| RecordingError::Io { path: path.to_owned(), source };
        let mut file = File::open(path).map_err(io)?;
        let size = file.metadata().map_err(io)?.len();
        let mut magic = [0; 8];
        if file.read_exact(&mut magic).is_err() || magic != *mcap::MAGIC {
            let explanation = foreign::explain(path)
                .unwrap_or_else(|| "give a recording of `lookout record`, or a ROS 2 bag in MCAP".into());
            return Err(RecordingError::Foreign { path: path.to_owned(), explanation });
        }
        let mut index = Self {
            path: path.to_owned(),
            file,
            channels: BTreeMap::new(),
            schemas: BTreeMap::new(),
            places: Vec::new(),
            metadata: BTreeMap::new(),
            messages: 0,
            kept_bytes: 0,
            cut: None,
        };
        index.scan(size)?;
        Ok(index)
    }

    fn io(&self, source: std::io::Error) -> RecordingError {
        RecordingError::Io { path: self.path.clone(), source }
    }

    fn damaged(&self, at: u64, reason: impl std::fmt::Display) -> RecordingError {
        let reason = excerpt(&reason.to_string(), REASON_CHARS).into_owned();
        RecordingError::Damaged { path: self.path.clone(), at, reason }
    }

    /// Checks a count or a size against its limit.
    fn check(&self, count: u64, limit: u64, what: &str) -> Result<(), RecordingError> {
        if count <= limit {
            return Ok(());
        }
        Err(RecordingError::TooLarge { path: self.path.clone(), found: format!("{count} {what}"), limit })
    }

    fn scan(&mut self, size: u64) -> Result<(), RecordingError> {
        let mut at = mcap::MAGIC.len() as u64;
        // The last chunk, while the message index records behind it are read.
        let mut pending: Option<Place> = None;
        let mut is_whole = false;
        while !is_whole {
            let mut head = [0; RECORD_HEAD as usize];
            let has_head = size - at >= RECORD_HEAD;
            if has_head {
                self.file.seek(SeekFrom::Start(at)).map_err(|e| self.io(e))?;
                self.file.read_exact(&mut head).map_err(|e| self.io(e))?;
            }
            let [opcode, length @ ..] = head;
            let length = u64::from_le_bytes(length);
            let body_at = at + RECORD_HEAD;
            if !has_head || length > size - body_at {
                self.cut = Some(Cut { at, bytes: size - at });
                break;
            }
            if opcode == 0 {
                return Err(self.damaged(at, "no record starts here"));
            }
            if opcode != op::MESSAGE_INDEX {
                self.settle(pending.take(), false)?;
            }
            match opcode {
                op::CHUNK => pending = Some(Place { opcode, at: body_at, length, messages: Vec::new() }),
                op::MESSAGE_INDEX => {
                    if let Record::MessageIndex(index) = self.record(opcode, body_at, length)?
                        && let Some(place) = &mut pending
                    {
                        let count = place.messages.len() + index.records.len();
                        self.check(
                            count as u64,
                            MAX_CHUNK_MESSAGES as u64,
                            "messages in the index of a chunk",
                        )?;
                        let times = index.records.iter().map(|entry| (index.channel_id, entry.log_time));
                        place.messages.extend(times);
                    }
                }
                op::MESSAGE => {
                    // A message outside of chunks.
                    let place = Place { opcode, at: body_at, length, messages: Vec::new() };
                    self.settle(Some(place), true)?;
                }
                op::SCHEMA | op::CHANNEL | op::METADATA => {
                    let record = self.record(opcode, body_at, length)?;
                    self.learn(record)?;
                }
                op::FOOTER => is_whole = true,
                _ => {}
            }
            at = body_at + length;
        }
        // The index of the last chunk of a truncated file may be incomplete.
        let is_cut = self.cut.is_some();
        self.settle(pending, is_cut)
    }

    fn body(&mut self, opcode: u8, at: u64, length: u64) -> Result<Vec<u8>, RecordingError> {
        let limit = match opcode {
            // Neither LZ4 nor Zstandard makes a chunk longer by more than a sixteenth.
            op::CHUNK | op::MESSAGE => MAX_CHUNK_BYTES + MAX_CHUNK_BYTES / 16,
            // Two numbers of 8 bytes for each message.
            op::MESSAGE_INDEX => 16 * MAX_CHUNK_MESSAGES as u64 + 64,
            _ => MAX_DESCRIPTION_BYTES,
        };
        self.check(length, limit, &format!("bytes in the record at byte {at}"))?;
        let mut body = vec![0; usize::try_from(length).map_err(|e| self.damaged(at, e))?];
        self.file.seek(SeekFrom::Start(at)).map_err(|e| self.io(e))?;
        self.file.read_exact(&mut body).map_err(|e| self.io(e))?;
        Ok(body)
    }

    fn record(&mut self, opcode: u8, at: u64, length: u64) -> Result<Record<'static>, RecordingError> {
        let body = self.body(opcode, at, length)?;
        if !lengths::fit(opcode, &body) {
            return Err(self.damaged(at, LONGER));
        }
        Ok(parse_record(opcode, &body).map_err(|e| self.damaged(at, e))?.into_owned())
    }

    /// Stores a schema, a channel or a metadata record. What is known already, as chunks repeat it, costs nothing.
    ///
    /// # Errors
    /// If there are more than the limits.
    fn learn(&mut self, record: Record<'_>) -> Result<(), RecordingError> {
        match record {
            Record::Schema { header, .. } => {
                if self.schemas.get(&header.id) != Some(&header.name) {
                    self.keep(header.name.len())?;
                    self.schemas.insert(header.id, header.name);
                }
                self.check(self.schemas.len() as u64, MAX_TOPICS as u64, "schemas")
            }
            Record::Channel(c) => {
                let schema = self.schemas.get(&c.schema_id).cloned().unwrap_or_default();
                let channel = Channel { topic: c.topic, encoding: c.message_encoding, schema };
                if self.channels.get(&c.id) != Some(&channel) {
                    self.keep(channel.topic.len() + channel.encoding.len() + channel.schema.len())?;
                    self.channels.insert(c.id, channel);
                }
                self.check(self.channels.len() as u64, MAX_TOPICS as u64, "topics")
            }
            Record::Metadata(m) => {
                let texts = m.metadata.iter().map(|(key, value)| key.len() + value.len() + 64);
                self.keep(m.name.len() + texts.sum::<usize>())?;
                self.metadata.insert(m.name, m.metadata.into_iter().collect());
                self.check(self.metadata.len() as u64, MAX_TOPICS as u64, "metadata records")
            }
            _ => Ok(()),
        }
    }

    /// Counts bytes of names and metadata.
    fn keep(&mut self, bytes: usize) -> Result<(), RecordingError> {
        self.kept_bytes = self.kept_bytes.saturating_add(bytes);
        self.check(self.kept_bytes as u64, MAX_KEPT_BYTES as u64, "bytes of names and metadata")
    }

    /// Adds a place to the index. Its messages are read if they have no index or belong to unknown topics.
    fn settle(&mut self, place: Option<Place>, read_it: bool) -> Result<(), RecordingError> {
        let Some(mut place) = place else { return Ok(()) };
        let is_known = place.messages.iter().all(|(channel, _)| self.channels.contains_key(channel));
        if read_it || place.messages.is_empty() || !is_known {
            let messages = self.read_place(&place)?;
            place.messages = messages.iter().map(|m| (m.channel, m.time_ns)).collect();
        }
        self.messages += place.messages.len();
        self.check(self.messages as u64, MAX_MESSAGES as u64, "messages")?;
        self.check(self.places.len() as u64 + 1, MAX_CHUNKS as u64, "chunks, or messages outside of chunks")?;
        self.places.push(place);
        Ok(())
    }

    fn read_place(&mut self, place: &Place) -> Result<Vec<Stored>, RecordingError> {
        let body = self.body(place.opcode, place.at, place.length)?;
        let damaged = |e: mcap::McapError| match e {
            mcap::McapError::UnsupportedCompression(name) => {
                format!(
                    "chunks are compressed with {}; lz4 and zstd can be read",
                    excerpt(&name, VALUE_CHARS)
                )
            }
            other => other.to_string(),
        };
        if !lengths::fit(place.opcode, &body) {
            return Err(self.damaged(place.at, LONGER));
        }
        let record = parse_record(place.opcode, &body).map_err(|e| self.damaged(place.at, damaged(e)))?;
        let header = match record {
            Record::Chunk { header, .. } => header,
            Record::Message { header, data } => {
                return Ok(vec![Stored {
                    channel: header.channel_id,
                    time_ns: header.log_time,
                    data: data.into_owned().into(),
                }]);
            }
            _ => return Ok(Vec::new()),
        };
        let what = format!("bytes in the chunk at byte {}, uncompressed", place.at);
        self.check(header.uncompressed_size, MAX_CHUNK_BYTES, &what)?;
        // No record of a chunk is longer than the chunk.
        let limit = header.uncompressed_size.max(place.length) as usize;
        let options = LinearReaderOptions::default()
            .with_skip_start_magic(true)
            .with_skip_end_magic(true)
            .with_prevalidate_chunk_crcs(true)
            .with_record_length_limit(limit);
        let mut reader = LinearReader::new_with_options(options);
        let mut head = vec![place.opcode];
        head.extend(place.length.to_le_bytes());
        let mut bytes = head.as_slice().chain(body.as_slice());
        let mut messages = Vec::new();
        while let Some(event) = reader.next_event() {
            match event.map_err(|e| self.damaged(place.at, damaged(e)))? {
                LinearReadEvent::ReadRequest(wanted) => {
                    let wanted = wanted.min(head.len() + body.len());
                    let got = bytes.read(reader.insert(wanted)).map_err(|e| self.io(e))?;
                    reader.notify_read(got);
                }
                // No other records are allowed in a chunk.
                LinearReadEvent::Record { opcode, .. }
                    if !matches!(opcode, op::SCHEMA | op::CHANNEL | op::MESSAGE) => {}
                LinearReadEvent::Record { data, opcode } if !lengths::fit(opcode, data) => {
                    return Err(self.damaged(place.at, LONGER));
                }
                LinearReadEvent::Record { data, opcode } => {
                    match parse_record(opcode, data).map_err(|e| self.damaged(place.at, damaged(e)))? {
                        Record::Message { header, data } => {
                            let count = messages.len() as u64 + 1;
                            self.check(count, MAX_CHUNK_MESSAGES as u64, "messages in a chunk")?;
                            messages.push(Stored {
                                channel: header.channel_id,
                                time_ns: header.log_time,
                                data: data.into_owned().into(),
                            });
                        }
                        other => self.learn(other)?,
                    }
                }
            }
        }
        Ok(messages)
    }

    /// Path of the file.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// The topic of a channel identifier.
    pub fn channel(&self, id: u16) -> Option<&Channel> {
        self.channels.get(&id)
    }

    /// Channel identifier and description of each topic.
    pub fn channels(&self) -> impl Iterator<Item = (u16, &Channel)> {
        self.channels.iter().map(|(&id, channel)| (id, channel))
    }

    /// The metadata record of a name.
    pub fn metadata(&self, name: &str) -> Option<&BTreeMap<String, String>> {
        self.metadata.get(name)
    }

    /// Number of places that hold messages: the limit of the argument of [`Self::load`].
    pub fn places(&self) -> usize {
        self.places.len()
    }

    /// Channel identifier and log time of the messages at a place.
    pub fn messages(&self, place: usize) -> &[(u16, u64)] {
        self.places.get(place).map_or(&[], |p| &p.messages)
    }

    /// Reads all messages of a place and verifies their checksum.
    ///
    /// # Errors
    /// If they cannot be read or are damaged.
    pub fn load(&mut self, place: usize) -> Result<Vec<Stored>, RecordingError> {
        let Some(place) = self.places.get(place).cloned() else { return Ok(Vec::new()) };
        self.read_place(&place)
    }

    /// All messages of a topic, in the order of the file.
    ///
    /// # Errors
    /// As [`Self::load`].
    pub fn all_of(&mut self, topic: &str) -> Result<Vec<Stored>, RecordingError> {
        let ids: Vec<u16> = self.channels().filter(|(_, c)| c.topic == topic).map(|(id, _)| id).collect();
        let mut found = Vec::new();
        for place in 0..self.places.len() {
            if self.messages(place).iter().any(|(channel, _)| ids.contains(channel)) {
                found.extend(self.load(place)?.into_iter().filter(|m| ids.contains(&m.channel)));
            }
        }
        Ok(found)
    }
}
