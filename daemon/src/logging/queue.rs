//! The way of log lines out of the process: a queue that never makes the writer of a line wait.

use rustix::fs::{OFlags, fcntl_setfl};
use std::io::{self, PipeReader, PipeWriter, Read, Write};
use std::sync::OnceLock;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};
use tracing_subscriber::fmt::MakeWriter;

/// A line that is longer is cut: the kernel takes up to this many bytes whole or not at all (PIPE_BUF).
const LONGEST_LINE: usize = 4096;

/// How long a process that ends waits for its last lines to be written.
const LAST_WORDS: Duration = Duration::from_secs(1);

/// Lines on their way to standard error: a pipe of this process's own, which takes a line at once or
/// not at all, and a thread without priority that empties it. So a terminal that is stopped or a
/// journal that is busy costs lines, which are counted, and never time.
struct Queue {
    pipe: PipeWriter,
    queued: AtomicU64,
    written: AtomicU64,
    dropped: AtomicU64,
    /// Dropped lines that were spoken of.
    said: AtomicU64,
}

static QUEUE: OnceLock<Queue> = OnceLock::new();

/// Lines of this process that were dropped so far.
pub fn dropped() -> u64 {
    QUEUE.get().map_or(0, |queue| queue.dropped.load(Ordering::Relaxed))
}

/// Waits until all lines are written, but not for ever.
pub fn finish() {
    let Some(queue) = QUEUE.get() else { return };
    let start = Instant::now();
    while queue.written.load(Ordering::Acquire) < queue.queued.load(Ordering::Acquire)
        && start.elapsed() < LAST_WORDS
    {
        std::thread::sleep(Duration::from_millis(1));
    }
}

impl Queue {
    fn open() -> io::Result<(Self, PipeReader)> {
        let (reader, pipe) = io::pipe()?;
        fcntl_setfl(&pipe, OFlags::NONBLOCK)?;
        let zero = || AtomicU64::new(0);
        Ok((Self { pipe, queued: zero(), written: zero(), dropped: zero(), said: zero() }, reader))
    }

    /// Puts a line in, if there is room.
    fn put(&self, line: &[u8]) -> bool {
        let fits = matches!((&self.pipe).write(line), Ok(length) if length == line.len());
        if fits {
            self.queued.fetch_add(line.len() as u64, Ordering::Release);
        }
        fits
    }

    fn line(&self, line: &[u8]) {
        let whole = line.len() <= LONGEST_LINE;
        let put = if whole {
            self.put(line)
        } else {
            let mut cut = [b'\n'; LONGEST_LINE];
            cut[..LONGEST_LINE - 1].copy_from_slice(&line[..LONGEST_LINE - 1]);
            self.put(&cut)
        };
        if !put {
            self.dropped.fetch_add(1, Ordering::Relaxed);
            return;
        }
        // There is room again.
        let (dropped, said) = (self.dropped.load(Ordering::Relaxed), self.said.load(Ordering::Relaxed));
        if dropped > said {
            let mut text = [0; 80];
            let mut rest = &mut text[..];
            let _ = writeln!(rest, "{} lines of the log were dropped", dropped - said);
            let left = rest.len();
            if self.put(&text[..text.len() - left]) {
                self.said.store(dropped, Ordering::Relaxed);
            }
        }
    }
}

/// Writes what comes out of the pipe.
fn drain(mut reader: PipeReader, queue: &Queue, mut buffer: Vec<u8>) {
    loop {
        match reader.read(&mut buffer) {
            Ok(0) | Err(_) => return,
            Ok(length) => {
                // Where it cannot be written there is nobody to be told.
                let _ = io::stderr().write_all(&buffer[..length]);
                queue.written.fetch_add(length as u64, Ordering::Release);
            }
        }
    }
}

/// Where lines go: through the queue, or straight to standard error.
#[derive(Clone, Copy)]
pub struct Output(Option<&'static Queue>);

impl<'a> MakeWriter<'a> for Output {
    type Writer = Self;

    fn make_writer(&'a self) -> Self {
        *self
    }
}

impl Output {
    /// Through the queue.
    pub(super) fn queued() -> Self {
        Self(queue())
    }

    /// Straight to standard error.
    pub fn direct() -> Self {
        Self(None)
    }

    /// Writes a line, which ends with a line break.
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

/// Starts the queue and its thread; `None` when the system gives none.
fn queue() -> Option<&'static Queue> {
    if QUEUE.get().is_none() {
        let (queue, reader) = Queue::open().ok()?;
        let queue = QUEUE.get_or_init(|| queue);
        // Made here: a thread that allocates gets 64 MiB of address space for a heap of its own.
        let buffer = vec![0; 16 * LONGEST_LINE];
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
    fn a_full_queue_drops_lines_counts_them_and_says_so_when_there_is_room() {
        let (queue, mut reader) = Queue::open().unwrap();
        let line = [b'x'; 1000];
        // Nobody reads: it fills up and goes on at once.
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
        // A line that is too long is cut, so that it stays whole in the pipe.
        queue.line(&[b'y'; 3 * LONGEST_LINE]);
        let length = reader.read(&mut text).unwrap();
        assert_eq!((length, text[length - 1]), (LONGEST_LINE, b'\n'));
    }
}
