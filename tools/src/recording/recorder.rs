//! A sink on a thread of its own.

use super::sink::{Item, RecordError, Report, Sink};
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

/// The most bytes that wait for the disk.
const MAX_WAITING_BYTES: u64 = 64 << 20;

/// How long a disk may be too slow before the recording ends, in nanoseconds.
const PATIENCE_NS: u64 = 10_000_000_000;

/// How long the end may take.
const END_PATIENCE: Duration = Duration::from_secs(10);

/// What became of an item.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Offer {
    /// It will be written.
    Taken,
    /// Too much waits for the disk already.
    Refused,
    /// The recording has ended: [`Recorder::finish`] tells why.
    Over,
}

enum Job {
    Item(Item),
    Lost { service: &'static str, count: u64, time_ns: u64 },
    End(String),
}

struct Shared {
    waiting_bytes: AtomicU64,
    is_short: AtomicBool,
    is_over: AtomicBool,
    report: Mutex<Report>,
}

/// See the module.
pub struct Recorder {
    jobs: Option<Sender<Job>>,
    outcome: Receiver<Result<Report, RecordError>>,
    shared: Arc<Shared>,
    path: PathBuf,
    /// Since when the queue has been full, in nanoseconds of the caller's clock.
    full_since_ns: Option<u64>,
}

impl Recorder {
    /// Starts the thread. `path` is named in errors.
    pub fn start(mut sink: Sink, path: PathBuf) -> Self {
        let (jobs, queue) = channel::<Job>();
        let (tell, outcome) = channel();
        let shared = Arc::new(Shared {
            waiting_bytes: AtomicU64::new(0),
            is_short: AtomicBool::new(false),
            is_over: AtomicBool::new(false),
            report: Mutex::default(),
        });
        let own = Arc::clone(&shared);
        std::thread::spawn(move || {
            let result = write_all(&mut sink, &queue, &own);
            own.is_over.store(true, Ordering::Relaxed);
            // Nobody may be waiting any more.
            let _ = tell.send(result);
        });
        Self { jobs: Some(jobs), outcome, shared, path, full_since_ns: None }
    }

    fn send(&self, job: Job) -> Offer {
        match &self.jobs {
            Some(jobs) if jobs.send(job).is_ok() => Offer::Taken,
            _ => Offer::Over,
        }
    }

    /// Offers an item; `now_ns` is the time of any clock that goes on.
    pub fn offer(&mut self, item: Item, now_ns: u64) -> Offer {
        let bytes = if let Item::Message(message) = &item { message.data.len() as u64 } else { 0 };
        let waiting = self.shared.waiting_bytes.load(Ordering::Relaxed);
        // A single message of any size is taken.
        if waiting > 0 && waiting + bytes > MAX_WAITING_BYTES {
            self.full_since_ns.get_or_insert(now_ns);
            return Offer::Refused;
        }
        self.full_since_ns = None;
        self.shared.waiting_bytes.fetch_add(bytes, Ordering::Relaxed);
        self.send(Job::Item(item))
    }

    /// Counts messages that were lost.
    pub fn lost(&self, service: &'static str, count: u64, time_ns: u64) -> Offer {
        self.send(Job::Lost { service, count, time_ns })
    }

    /// Whether the recording has ended: [`Self::finish`] tells why.
    pub fn is_over(&self) -> bool {
        self.shared.is_over.load(Ordering::Relaxed)
    }

    /// Whether the disk has not followed for too long.
    pub fn is_stuck(&self, now_ns: u64) -> bool {
        self.full_since_ns.is_some_and(|since| now_ns.saturating_sub(since) >= PATIENCE_NS)
    }

    /// What has been written so far.
    pub fn report(&self) -> Report {
        self.shared.report.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// Whether the ring is shorter than asked, for want of memory.
    pub fn is_short(&self) -> bool {
        self.shared.is_short.load(Ordering::Relaxed)
    }

    /// Ends the recording: what waits is written, the file closed.
    ///
    /// # Errors
    /// Why it ended early, or that the disk does not come to an end.
    pub fn finish(mut self, reason: &str) -> Result<Report, RecordError> {
        let is_stuck = self.full_since_ns.is_some();
        if let Some(jobs) = self.jobs.take() {
            // It may have ended by itself: the outcome tells.
            let _ = jobs.send(Job::End(reason.to_owned()));
        }
        let slow = RecordError::Slow { path: self.path.clone(), seconds: PATIENCE_NS / 1_000_000_000 };
        match self.outcome.recv_timeout(END_PATIENCE) {
            Ok(Ok(_)) if is_stuck => Err(slow),
            Ok(result) => result,
            Err(_) => Err(slow),
        }
    }
}

fn write_all(sink: &mut Sink, queue: &Receiver<Job>, shared: &Shared) -> Result<Report, RecordError> {
    let mut ended = "the recorder was dropped".to_owned();
    let mut result = Ok(());
    while let Ok(job) = queue.recv() {
        result = match job {
            Job::End(reason) => {
                ended = reason;
                break;
            }
            Job::Item(item) => {
                let bytes = if let Item::Message(message) = &item { message.data.len() as u64 } else { 0 };
                let result = sink.take(item);
                shared.waiting_bytes.fetch_sub(bytes, Ordering::Relaxed);
                result
            }
            Job::Lost { service, count, time_ns } => sink.lost(service, count, time_ns),
        };
        if result.is_err() {
            break;
        }
        shared.is_short.store(sink.is_short(), Ordering::Relaxed);
        *shared.report.lock().unwrap_or_else(PoisonError::into_inner) = sink.report();
    }
    match result {
        Ok(()) => sink.finish(&ended),
        Err(error) => {
            // Closed as well as can be; the first reason counts.
            let _ = sink.finish(&error.to_string());
            Err(error)
        }
    }
}
