//! Reads lines from the socket of another process, and passes them on as its own.

use super::line::Fields;
use super::notice::Notice;
use super::runs::{Entry, Runs};
use super::topics::STATUS;
use serde_json::Value;
use std::io::{self, BufRead, BufReader, ErrorKind, Read};
use std::os::unix::net::UnixStream;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

/// Maximum length of a line in bytes: 128 obstacles take about 80 kB.
const MAX_LINE: u64 = 1 << 20;

/// Period of trying to connect, and of checking whether to stop.
const CHECK_PERIOD: Duration = Duration::from_millis(250);

/// Reads a socket across the restarts of its server.
pub struct Relay {
    path: PathBuf,
    runs: Runs,
    stop: Arc<AtomicBool>,
    notice: Notice,
}

impl Relay {
    /// A reader of the socket `path`.
    pub fn new(path: &Path, runs: Runs, stop: Arc<AtomicBool>) -> Self {
        Self { path: path.to_owned(), runs, stop, notice: Notice::default() }
    }

    /// Reads until it is stopped. It waits for a socket that is not there, or that nobody serves.
    ///
    /// # Errors
    /// If this user may not connect, or the file is no such socket; with the remedy.
    pub fn run(&mut self) -> Result<(), String> {
        let shown = self.path.display().to_string();
        while !self.stop.load(Ordering::Relaxed) {
            match UnixStream::connect(&self.path) {
                Ok(stream) => {
                    let result = self.read(stream);
                    if self.stop.load(Ordering::Relaxed) {
                        break;
                    }
                    let why = match result {
                        Ok(()) => format!("{shown}: lookout stream --serve has ended: waits for it"),
                        Err(error) if error.kind() == ErrorKind::InvalidData => {
                            return Err(format!("{shown}: {error}"));
                        }
                        Err(error) => format!("{shown}: {error}: connects again"),
                    };
                    self.runs.end(&why);
                    self.notice.waits(why);
                }
                Err(error) if error.kind() == ErrorKind::PermissionDenied => {
                    return Err(format!(
                        "{shown}: {error}: become a member of the group of the socket (usermod -a -G GROUP USER, then \
                         log in again)"
                    ));
                }
                Err(error) => {
                    let why = format!("{shown}: {error}: waits for lookout stream --serve");
                    self.notice.waits(why);
                }
            }
            std::thread::sleep(CHECK_PERIOD);
        }
        Ok(())
    }

    /// Reads one connection to its end.
    fn read(&mut self, stream: UnixStream) -> io::Result<()> {
        stream.set_read_timeout(Some(CHECK_PERIOD))?;
        let mut input = BufReader::new(stream);
        let mut line = Vec::new();
        while !self.stop.load(Ordering::Relaxed) {
            let left = MAX_LINE.saturating_sub(line.len() as u64);
            match input.by_ref().take(left).read_until(b'\n', &mut line) {
                Ok(_) if line.ends_with(b"\n") => {
                    self.take(&line)?;
                    line.clear();
                }
                Ok(_) if line.len() as u64 >= MAX_LINE => {
                    return Err(invalid(&format!("a line is longer than {MAX_LINE} bytes")));
                }
                // A line that was begun is lost with its server.
                Ok(0) => return Ok(()),
                Ok(_) => {}
                Err(error)
                    if matches!(
                        error.kind(),
                        ErrorKind::WouldBlock | ErrorKind::TimedOut | ErrorKind::Interrupted
                    ) => {}
                Err(error) => return Err(error),
            }
        }
        Ok(())
    }

    fn take(&mut self, line: &[u8]) -> io::Result<()> {
        let mut fields: Fields =
            serde_json::from_slice(line).map_err(|error| invalid(&format!("not a JSON object: {error}")))?;
        if let Some(why) = fields.get("refused").and_then(Value::as_str) {
            return Err(io::Error::other(why.to_owned()));
        }
        let status = fields.remove(STATUS);
        self.notice.goes_on(&format!("reads {}", self.path.display()));
        if let (Some(status), Some(run)) = (&status, fields.get("run").and_then(Value::as_str)) {
            self.runs.status(run, &status.to_string());
        }
        match Entry::parse(fields) {
            Some(entry) => {
                self.runs.publish(&entry);
                Ok(())
            }
            None if status.is_some() => Ok(()),
            None => Err(invalid("a line is none of lookout stream")),
        }
    }
}

fn invalid(why: &str) -> io::Error {
    io::Error::new(ErrorKind::InvalidData, format!("{why}: give the socket of lookout stream --serve"))
}

#[cfg(test)]
mod tests {
    use super::super::latest::{Latest, Seen};
    use super::super::topics::Topics;
    use super::*;
    use std::io::Write;

    fn relay(latest: &Arc<Latest>, topics: &[&str]) -> Relay {
        let names: Vec<String> = topics.iter().map(ToString::to_string).collect();
        let runs = Runs::new(Arc::clone(latest), Topics::of(&names));
        Relay::new(Path::new("/no/such/socket"), runs, Arc::default())
    }

    #[test]
    fn lines_pass_once_with_the_chosen_topics() {
        let latest = Arc::new(Latest::default());
        let mut relay = relay(&latest, &["alarm", "status"]);
        let _reader = latest.reader();
        let (mut server, client) = UnixStream::pair().unwrap();
        let line =
            r#"{"run":"a","sequence":1,"time_s":0.1,"withdrawn":false,"path":{},"alarm":{"level":"alarm"}}"#;
        let text =
            format!("{line}\n{line}\n{{\"run\":\"a\",\"status\":{{\"pid\":1}}}}\n{{\"run\":\"a\",\"seq");
        server.write_all(text.as_bytes()).unwrap();
        drop(server);
        relay.read(client).unwrap();
        let mut seen = Seen::default();
        let got = latest.next(&mut seen, Duration::ZERO).unwrap();
        let expected = r#"{"run":"a","sequence":1,"time_s":0.1,"withdrawn":false,"alarm":{"level":"alarm"},"status":{"pid":1}}"#;
        assert_eq!(got.trim_end(), expected);
        assert_eq!(latest.next(&mut seen, Duration::ZERO), None);
    }

    #[test]
    fn what_is_no_line_is_refused() {
        for text in ["hello\n", "{}\n", "[]\n", "{\"run\":1,\"sequence\":2}\n", "\n"] {
            let (mut server, client) = UnixStream::pair().unwrap();
            server.write_all(text.as_bytes()).unwrap();
            drop(server);
            let error = relay(&Arc::default(), &[]).read(client).unwrap_err();
            assert!(
                error.to_string().contains("give the socket of lookout stream --serve"),
                "{text}: {error}"
            );
        }
        let (mut server, client) = UnixStream::pair().unwrap();
        let flood = std::thread::spawn(move || {
            let _ = server.write_all(&vec![b'x'; 2 * MAX_LINE as usize]);
        });
        let error = relay(&Arc::default(), &[]).read(client).unwrap_err();
        assert!(error.to_string().contains("longer than 1048576 bytes"), "{error}");
        flood.join().unwrap();
        let (mut server, client) = UnixStream::pair().unwrap();
        server.write_all(b"{\"refused\":\"16 readers\"}\n").unwrap();
        let error = relay(&Arc::default(), &[]).read(client).unwrap_err();
        assert_eq!(error.to_string(), "16 readers");
    }
}
