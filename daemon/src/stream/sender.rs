//! Sends the newest line to one reader, whenever it can take one.

use super::latest::{Latest, Seen};
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::fd::BorrowedFd;
use rustix::io::Errno;
use std::io;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// Period of checking whether to stop, and whether the reader has gone.
const CHECK_PERIOD: Duration = Duration::from_millis(250);

/// Bytes of one write: what a pipe takes without blocking once it is ready (PIPE_BUF in pipe(7)).
const CHUNK: usize = 4096;

/// Time to complete a line that was begun before the end: the last line should be whole.
const GRACE: Duration = Duration::from_millis(500);

/// How many lines a reader gets, and how long it may take to read them.
#[derive(Clone, Copy, Debug, Default)]
pub struct Terms {
    /// Minimum time between two lines.
    pub period: Option<Duration>,
    /// Number of lines.
    pub limit: Option<u64>,
    /// Longest time without reading a byte of a line, and for reading a whole line; `None` = any.
    pub patience: Option<(Duration, Duration)>,
}

/// Why sending has ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum End {
    /// It was stopped.
    Stopped,
    /// The reader has gone.
    Gone,
    /// The reader does not read.
    TooSlow,
    /// All lines were sent.
    Complete,
}

/// Sends lines to `reader` until the first of these ends.
///
/// # Errors
/// If the lines cannot be written for another reason than that the reader has gone.
pub fn run(reader: BorrowedFd<'_>, latest: &Latest, terms: &Terms, stop: &AtomicBool) -> io::Result<End> {
    let _reader = latest.reader();
    let mut seen = Seen::default();
    let (mut sent, mut due) = (0, Instant::now());
    loop {
        if stop.load(Ordering::Relaxed) {
            return Ok(End::Stopped);
        }
        if is_gone(reader)? {
            return Ok(End::Gone);
        }
        let early = due.saturating_duration_since(Instant::now());
        if !early.is_zero() {
            std::thread::sleep(early.min(CHECK_PERIOD));
            continue;
        }
        let Some(line) = latest.next(&mut seen, CHECK_PERIOD) else { continue };
        if let Some(end) = send(reader, line.as_bytes(), terms.patience, stop)? {
            return Ok(end);
        }
        sent += 1;
        if terms.limit == Some(sent) {
            return Ok(End::Complete);
        }
        if let Some(period) = terms.period {
            due = (due + period).max(Instant::now());
        }
    }
}

/// Sends a line; returns why it could not.
fn send(
    reader: BorrowedFd<'_>,
    mut line: &[u8],
    patience: Option<(Duration, Duration)>,
    stop: &AtomicBool,
) -> io::Result<Option<End>> {
    let (begin, length) = (Instant::now(), line.len());
    let (mut moved, mut stopped) = (begin, None);
    while !line.is_empty() {
        if stop.load(Ordering::Relaxed) {
            let since = *stopped.get_or_insert_with(Instant::now);
            if line.len() == length || since.elapsed() > GRACE {
                return Ok(Some(End::Stopped));
            }
        }
        if patience.is_some_and(|(stall, whole)| moved.elapsed() > stall || begin.elapsed() > whole) {
            return Ok(Some(End::TooSlow));
        }
        let events = events(reader, PollFlags::OUT, CHECK_PERIOD / 5)?;
        if !events.contains(PollFlags::OUT) {
            if events.is_empty() {
                continue;
            }
            return Ok(Some(End::Gone));
        }
        match rustix::io::write(reader, &line[..line.len().min(CHUNK)]) {
            Ok(bytes) => {
                line = &line[bytes..];
                moved = Instant::now();
            }
            Err(Errno::AGAIN | Errno::INTR) => {}
            Err(Errno::PIPE | Errno::CONNRESET) => return Ok(Some(End::Gone)),
            Err(error) => return Err(error.into()),
        }
    }
    Ok(None)
}

/// Whether the other end is closed.
fn is_gone(reader: BorrowedFd<'_>) -> io::Result<bool> {
    Ok(!events(reader, PollFlags::empty(), Duration::ZERO)?.is_empty())
}

/// What has happened to a file descriptor, of `wanted`, errors and the end; nothing after a signal.
fn events(reader: BorrowedFd<'_>, wanted: PollFlags, timeout: Duration) -> io::Result<PollFlags> {
    let mut descriptors = [PollFd::from_borrowed_fd(reader, wanted)];
    let timeout = Timespec { tv_sec: timeout.as_secs() as i64, tv_nsec: timeout.subsec_nanos().into() };
    match poll(&mut descriptors, Some(&timeout)) {
        Ok(_) => Ok(descriptors[0].revents()),
        Err(Errno::INTR) => Ok(PollFlags::empty()),
        Err(error) => Err(error.into()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::{BufRead, BufReader, Read};
    use std::os::fd::AsFd;
    use std::os::unix::net::UnixStream;
    use std::sync::Arc;

    const LONG: Duration = Duration::from_secs(120);

    /// A sender on its own thread, and its reader.
    fn with_reader(terms: Terms, act: impl FnOnce(UnixStream, &Latest)) -> End {
        let (server, client) = UnixStream::pair().unwrap();
        server.set_nonblocking(true).unwrap();
        client.set_read_timeout(Some(LONG)).unwrap();
        let (latest, stop) = (Arc::new(Latest::default()), AtomicBool::new(false));
        std::thread::scope(|scope| {
            let sender = scope.spawn(|| run(server.as_fd(), &latest, &terms, &stop).unwrap());
            while !latest.is_read() {
                std::thread::yield_now();
            }
            act(client, &latest);
            sender.join().unwrap()
        })
    }

    #[test]
    fn the_number_of_lines_is_limited() {
        let end = with_reader(Terms { limit: Some(2), ..Terms::default() }, |client, latest| {
            let mut lines = BufReader::new(client).lines();
            latest.frame("{\"a\":1".into());
            assert_eq!(lines.next().unwrap().unwrap(), "{\"a\":1}");
            latest.frame("{\"a\":2".into());
            assert_eq!(lines.next().unwrap().unwrap(), "{\"a\":2}");
        });
        assert_eq!(end, End::Complete);
    }

    #[test]
    fn a_reader_that_goes_ends_it_also_while_there_are_no_lines() {
        assert_eq!(with_reader(Terms::default(), |client, _| drop(client)), End::Gone);
    }

    #[test]
    fn a_reader_that_stalls_is_left_and_keeps_no_publisher_waiting() {
        let patience = Some((Duration::from_millis(200), LONG));
        let end = with_reader(Terms { patience, ..Terms::default() }, |mut client, latest| {
            let long = format!("{{\"a\":\"{}\"", "x".repeat(10_000));
            let begin = Instant::now();
            while latest.is_read() && begin.elapsed() < LONG {
                latest.frame(long.clone());
            }
            // What it has got before is whole lines, and the begin of one. The sender's end stays open: reading ends without more.
            client.set_nonblocking(true).unwrap();
            let mut text = Vec::new();
            assert!(client.read_to_end(&mut text).is_err_and(|e| e.kind() == io::ErrorKind::WouldBlock));
            let mut lines: Vec<&[u8]> = text.split(|&byte| byte == b'\n').collect();
            assert!(lines.pop().is_some_and(|begin| !begin.ends_with(b"}")) && !lines.is_empty());
            assert!(lines.iter().all(|line| line.ends_with(b"\"}")));
        });
        assert_eq!(end, End::TooSlow);
    }

    #[test]
    fn lines_keep_their_distance_and_the_newest_wins() {
        let period = Some(Duration::from_millis(300));
        // Before the sender starts, from whose start the distances count.
        let begin = Instant::now();
        let end = with_reader(Terms { period, limit: Some(3), ..Terms::default() }, |client, latest| {
            let mut sent = 0;
            client.set_nonblocking(true).unwrap();
            let mut lines = BufReader::new(client);
            let mut got: Vec<u64> = Vec::new();
            let mut line = String::new();
            while got.len() < 3 && begin.elapsed() < LONG {
                sent += 1;
                latest.frame(format!("{{\"a\":{sent}"));
                std::thread::sleep(Duration::from_millis(5));
                if lines.read_line(&mut line).is_ok() && line.ends_with('\n') {
                    let value: serde_json::Value = serde_json::from_str(&line).unwrap();
                    got.push(value["a"].as_u64().unwrap());
                    line.clear();
                }
            }
            assert!(begin.elapsed() >= Duration::from_millis(600), "{:?}", begin.elapsed());
            assert!(got.len() == 3 && got.windows(2).all(|pair| pair[1] > pair[0]), "{got:?}");
        });
        assert_eq!(end, End::Complete);
    }
}
