//! A queue of log lines that never blocks the thread that logs.

use rustix::fs::{OFlags, fcntl_setfl};
use std::io::{self, PipeReader, PipeWriter, Read, Write};
use std::sync::OnceLock;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};
use tracing_subscriber::fmt::MakeWriter;

/// Maximum length of a line in bytes; longer lines are truncated. The kernel writes up to this many bytes to a pipe
/// atomically (PIPE_BUF).
const MAX_LINE: usize = 4096;

/// Maximum time that a process waits at its end for its last lines to be written.
const FINISH_TIMEOUT: Duration = Duration::from_secs(1);

/// The queue: a non-blocking pipe within this process, which accepts a whole line or nothing, and a thread without
/// real-time priority that copies it to standard error. If a terminal is stopped or the journal is busy, lines are
/// dropped and counted.
struct Queue {
    pipe: PipeWriter,
    /// Bytes that were put into the pipe.
    queued: AtomicU64,
    /// Bytes that were copied to standard error.
    written: AtomicU64,
    /// Number of dropped lines.
    dropped: AtomicU64,
    /// Number of dropped lines that the log has reported.
    reported: AtomicU64,
}

static QUEUE: OnceLock<Queue> = OnceLock::new();

/// Number of lines of this process that were dropped so far.
pub fn dropped() -> u64 {
    QUEUE.get().map_or(0, |queue| queue.dropped.load(Ordering::Relaxed))
}

/// Waits until all lines are written, for at most [`FINISH_TIMEOUT`].
pub fn finish() {
    let Some(queue) = QUEUE.get() else { return };
    let start = Instant::now();
    while queue.written.load(Ordering::Acquire) < queue.queued.load(Ordering::Acquire)
        && start.elapsed() < FINISH_TIMEOUT
    {
        std::thread::sleep(Duration::from_millis(1));
    }
}

impl Queue {
    fn open() -> io::Result<(Self, PipeReader)> {
        let (reader, pipe) = io::pipe()?;
        fcntl_setfl(&pipe, OFlags::NONBLOCK)?;
        let zero = || AtomicU64::new(0);
        Ok((Self { pipe, queued: zero(), written: zero(), dropped: zero(), reported: zero() }, reader))
    }

    /// Puts a line into the pipe. Returns false if it is full.
    fn put(&self, line: &[u8]) -> bool {
        let fits = matches!((&self.pipe).write(line), Ok(length) if length == line.len());
        if fits {
            self.queued.fetch_add(line.len() as u64, Ordering::Release);
        }
        fits
    }

    fn line(&self, line: &[u8]) {
        let put = if line.len() <= MAX_LINE {
            self.put(line)
        } else {
            let mut truncated = [b'\n'; MAX_LINE];
            truncated[..MAX_LINE - 1].copy_from_slice(&line[..MAX_LINE - 1]);
            self.put(&truncated)
        };
        if !put {
            self.dropped.fetch_add(1, Ordering::Relaxed);
            return;
        }
        // The pipe has room again: report the lines that were dropped since the last report.
        let dropped = self.dropped.load(Ordering::Relaxed);
        let reported = self.reported.load(Ordering::Relaxed);
        if dropped > reported {
            let mut text = [0; 80];
            let mut rest = &mut text[..];
            let _ = writeln!(rest, "{} lines of the log were dropped", dropped - reported);
            let left = rest.len();
            if self.put(&text[..text.len() - left]) {
                self.reported.store(dropped, Ordering::Relaxed);
            }
        }
    }
}

/// Copies the pipe to standard error.
fn drain(mut reader: PipeReader, queue: &Queue, mut buffer: Vec<u8>) {
    loop {
        match reader.read(&mut buffer) {
            Ok(0) | Err(_) => return,
            Ok(length) => {
                // An error of standard error cannot be reported anywhere.
                let _ = io::stderr().write_all(&buffer[..length]);
                queue.written.fetch_add(length as u64, Ordering::Release);
            }
        }
    }
}

/// Output of log lines: the queue, or standard error directly.
#[derive(Clone, Copy)]
pub struct Output(Option<&'static Queue>);

impl<'a> MakeWriter<'a> for Output {
    type Writer = Self;

    fn make_writer(&'a self) -> Self {
        *self
    }
}

impl Output {
    /// Output through the queue.
    pub(super) fn queued() -> Self {
        Self(queue())
    }

    /// Output to standard error directly.
    pub fn direct() -> Self {
        Self(None)
    }

    /// Writes a line, which has to end with a line break.
    pub fn line(&self, line: &[u8]) {
        match self.0 {
            Some(queue) => queue.line(line),
            None => {
                let _ = io::stderr().write_all(line);
            }
        }
    }
}

impl Write for Output {
    fn write(&mut self, line: &[u8]) -> io::Result<usize> {
        match self.0 {
            Some(queue) => queue.line(line),
            None => io::stderr().write_all(line)?,
        }
        Ok(line.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

/// Starts the queue and its thread; `None` if the system refuses a pipe or a thread.
fn queue() -> Option<&'static Queue> {
    if QUEUE.get().is_none() {
        let (queue, reader) = Queue::open().ok()?;
        let queue = QUEUE.get_or_init(|| queue);
        // Allocated here, because a thread that allocates gets an arena of 64 MiB of address space.
        let buffer = vec![0; 16 * MAX_LINE];
        std::thread::Builder::new()
            .name("log".into())
            .stack_size(256 << 10)
            .spawn(move || drain(reader, queue, buffer))
            .ok()?;
    }
    QUEUE.get()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_full_queue_drops_and_counts_lines_and_reports_them_once_there_is_room() {
        let (queue, mut reader) = Queue::open().unwrap();
        let line = [b'x'; 1000];
        // Nobody reads: the queue fills up without blocking.
        for _ in 0..200 {
            queue.line(&line);
        }
        let dropped = queue.dropped.load(Ordering::Relaxed);
        assert!((100..200).contains(&dropped), "{dropped} of 200 lines dropped");
        let mut text = vec![0; 128 << 10];
        let length = reader.read(&mut text).unwrap();
        assert_eq!(length as u64, (200 - dropped) * 1000);
        queue.line(b"again\n");
        let length = reader.read(&mut text).unwrap();
        let got = String::from_utf8_lossy(&text[..length]).into_owned();
        assert_eq!(got, format!("again\n{dropped} lines of the log were dropped\n"));
        // A line that is too long is truncated, so that it is written atomically.
        queue.line(&[b'y'; 3 * MAX_LINE]);
        let length = reader.read(&mut text).unwrap();
        assert_eq!((length, text[length - 1]), (MAX_LINE, b'\n'));
    }
}
