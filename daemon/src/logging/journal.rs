//! Logging to the systemd journal in its native protocol. Every field of an event becomes a field of the entry, for
//! `journalctl LOOKOUT_PROCESS=stereo` and `journalctl -o json`.

use super::queue::Output;
use crate::printable::Escaping;
use std::fmt::{self, Write};
use std::os::unix::net::UnixDatagram;
use std::path::Path;
use tracing::field::{Field, Visit};
use tracing::{Event, Subscriber};
use tracing_subscriber::Layer;
use tracing_subscriber::layer::Context;

/// Socket of the journal.
const SOCKET: &str = "/run/systemd/journal/socket";

/// Maximum length of the value of a field, in bytes: the size of datagrams is limited.
const MAX_MESSAGE: usize = 32 * 1024;

/// Writes events to the journal.
pub struct Journal {
    socket: UnixDatagram,
    process: &'static str,
    /// Fallback for entries that the journal does not accept immediately.
    lines: Output,
}

impl Journal {
    /// Connects to the journal if standard error is connected to it, which `$JOURNAL_STREAM` (device and inode) tells.
    /// `None` otherwise, or if the socket does not exist; log lines then go to standard error.
    pub fn open(process: &'static str, lines: Output) -> Option<Self> {
        let stream = std::env::var("JOURNAL_STREAM").ok()?;
        let stat = rustix::fs::fstat(std::io::stderr()).ok()?;
        (stream == format!("{}:{}", stat.st_dev, stat.st_ino))
            .then(|| Self::at(Path::new(SOCKET), process, lines))?
    }

    fn at(path: &Path, process: &'static str, lines: Output) -> Option<Self> {
        let socket = UnixDatagram::unbound().ok()?;
        socket.connect(path).ok()?;
        socket.set_nonblocking(true).ok()?;
        Some(Self { socket, process, lines })
    }
}

/// Collects the fields of an event.
#[derive(Default)]
struct Fields {
    message: String,
    /// ` key=value` for each field but the message, as on a terminal.
    tail: String,
    entry: Vec<u8>,
}

impl Visit for Fields {
    fn record_debug(&mut self, field: &Field, value: &dyn fmt::Debug) {
        // Values come from outside, too, such as names of files: see [`crate::printable`].
        if field.name() == "message" {
            let _ = write!(Escaping(&mut self.message), "{value:?}");
            return;
        }
        let mut text = String::new();
        let _ = write!(Escaping(&mut text), "{value:?}");
        let _ = write!(self.tail, " {}={text}", field.name());
        put(&mut self.entry, &key(field.name()), &text);
    }

    fn record_str(&mut self, field: &Field, value: &str) {
        self.record_debug(field, &format_args!("{value}"));
    }
}

/// Name of a field in the journal, which accepts capitals, digits and `_`.
fn key(name: &str) -> String {
    let fit = |c: char| if c.is_ascii_alphanumeric() { c.to_ascii_uppercase() } else { '_' };
    let mut key = String::from("LOOKOUT_");
    // The journal accepts at most 64 characters.
    key.extend(name.trim_start_matches("r#").chars().map(fit).take(56));
    key
}

/// Appends `KEY=value`. The value has no line break.
fn put(entry: &mut Vec<u8>, key: &str, value: &str) {
    let mut end = value.len().min(MAX_MESSAGE);
    while !value.is_char_boundary(end) {
        end -= 1;
    }
    entry.extend_from_slice(key.as_bytes());
    entry.push(b'=');
    entry.extend_from_slice(&value.as_bytes()[..end]);
    entry.push(b'\n');
}

impl<S: Subscriber> Layer<S> for Journal {
    fn on_event(&self, event: &Event<'_>, _: Context<'_, S>) {
        let mut fields = Fields::default();
        event.record(&mut fields);
        let Fields { message, tail, mut entry } = fields;
        let priority = priority(*event.metadata().level());
        let message = format!("{}: {message}{tail}", self.process);
        put(&mut entry, "PRIORITY", &priority.to_string());
        put(&mut entry, "MESSAGE", &message);
        put(&mut entry, "SYSLOG_IDENTIFIER", "lookout");
        put(&mut entry, "LOOKOUT_PROCESS", self.process);
        put(&mut entry, "LOOKOUT_TARGET", event.metadata().target());
        if self.socket.send(&entry).is_err() {
            // The journal is busy or restarting. It reads standard error later.
            self.lines.line(format!("<{priority}>{message}\n").as_bytes());
        }
    }
}

/// The priority of a level, as in sd-daemon(3).
pub fn priority(level: tracing::Level) -> u8 {
    match level {
        tracing::Level::ERROR => 3,
        tracing::Level::WARN => 4,
        tracing::Level::INFO => 6,
        tracing::Level::DEBUG | tracing::Level::TRACE => 7,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::HashMap;
    use tracing_subscriber::layer::SubscriberExt;

    /// Parses an entry as the journal does.
    fn parse(mut bytes: &[u8]) -> HashMap<String, String> {
        let mut fields = HashMap::new();
        while !bytes.is_empty() {
            let end = bytes.iter().position(|&b| b == b'\n').expect("a line ends");
            let line = std::str::from_utf8(&bytes[..end]).unwrap();
            // A value with line breaks would have its length instead; there are none.
            let (key, value) = line.split_once('=').expect("a field has a value");
            let (value, rest) = (value.to_owned(), &bytes[end + 1..]);
            assert!(key.bytes().all(|b| b.is_ascii_uppercase() || b.is_ascii_digit() || b == b'_'), "{key}");
            assert!(fields.insert(key.to_owned(), value).is_none(), "{key} twice");
            bytes = rest;
        }
        fields
    }

    #[test]
    fn fields_of_events_become_fields_of_entries() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("socket");
        let receiver = UnixDatagram::bind(&path).unwrap();
        let journal = Journal::at(&path, "stereo", Output::direct()).unwrap();
        let subscriber = tracing_subscriber::registry().with(journal);
        let mut bytes = vec![0; 100_000];
        let mut next = || {
            let length = receiver.recv(&mut bytes).unwrap();
            parse(&bytes[..length])
        };
        tracing::subscriber::with_default(subscriber, || {
            tracing::warn!(p50_ms = 20.5, role = %"road", why = "two\nPRIORITY=0", "figures\u{1b}[2J");
            let fields = next();
            assert_eq!(
                fields["MESSAGE"],
                "stereo: figures\\u{1b}[2J p50_ms=20.5 role=road why=two\\nPRIORITY=0"
            );
            assert_eq!((fields["PRIORITY"].as_str(), fields["LOOKOUT_P50_MS"].as_str()), ("4", "20.5"));
            assert_eq!(
                (fields["LOOKOUT_ROLE"].as_str(), fields["LOOKOUT_WHY"].as_str()),
                ("road", "two\\nPRIORITY=0")
            );
            assert_eq!(
                (fields["LOOKOUT_PROCESS"].as_str(), fields["SYSLOG_IDENTIFIER"].as_str()),
                ("stereo", "lookout")
            );
            tracing::error!("{}", "ü".repeat(MAX_MESSAGE));
            assert!(next()["MESSAGE"].len() <= MAX_MESSAGE, "cut at a character");
        });
    }

    #[test]
    fn without_a_journal_there_is_none() {
        assert!(Journal::at(Path::new("/no/such/socket"), "x", Output::direct()).is_none());
    }
}
