//! A sink on its own thread.

use super::sink::{Item, RecordError, Report, Sink};
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

/// Maximum number of bytes in the queue.
const MAX_WAITING_BYTES: u64 = 64 << 20;

/// Time for which the queue may stay full before the recording ends, in nanoseconds.
const PATIENCE_NS: u64 = 10_000_000_000;

/// Time limit for completing the file.
const END_PATIENCE: Duration = Duration::from_secs(10);

/// Outcome of offering an item.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Offer {
    /// The item is in the queue.
    Taken,
    /// The queue is full.
    Refused,
    /// The recording has ended: [`Recorder::finish`] returns the reason.
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

/// Handle of the thread that writes a recording.
pub struct Recorder {
    jobs: Option<Sender<Job>>,
    outcome: Receiver<Result<Report, RecordError>>,
    shared: Arc<Shared>,
    path: PathBuf,
    /// Time since which the queue has been full, in nanoseconds of the caller's clock.
    full_since_ns: Option<u64>,
}

impl Recorder {
    /// Starts the thread. `path` is for error messages.
    pub fn start(mut sink: Sink, path: PathBuf) -> Self {
        let (jobs, queue) = channel::<Job>();
        let (result_sender, outcome) = channel();
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
            // The receiver may be gone.
            let _ = result_sender.send(result);
        });
        Self { jobs: Some(jobs), outcome, shared, path, full_since_ns: None }
    }

    fn send(&self, job: Job) -> Offer {
        match &self.jobs {
            Some(jobs) if jobs.send(job).is_ok() => Offer::Taken,
            _ => Offer::Over,
        }
    }

    /// Offers an item without blocking; `now_ns` is the time of any monotonic clock.
    pub fn offer(&mut self, item: Item, now_ns: u64) -> Offer {
        let bytes = if let Item::Message(message) = &item { message.data.len() as u64 } else { 0 };
        let waiting = self.shared.waiting_bytes.load(Ordering::Relaxed);
        // An empty queue accepts a message of any size.
        if waiting > 0 && waiting + bytes > MAX_WAITING_BYTES {
            self.full_since_ns.get_or_insert(now_ns);
            return Offer::Refused;
        }
        self.full_since_ns = None;
        self.shared.waiting_bytes.fetch_add(bytes, Ordering::Relaxed);
        self.send(Job::Item(item))
    }

    /// Counts lost messages.
    pub fn lost(&self, service: &'static str, count: u64, time_ns: u64) -> Offer {
        self.send(Job::Lost { service, count, time_ns })
    }

    /// Whether the recording has ended: [`Self::finish`] returns the reason.
    pub fn is_over(&self) -> bool {
        self.shared.is_over.load(Ordering::Relaxed)
    }

    /// Whether the queue has been full for too long.
    pub fn is_stuck(&self, now_ns: u64) -> bool {
        self.full_since_ns.is_some_and(|since| now_ns.saturating_sub(since) >= PATIENCE_NS)
    }

    /// Summary of what has been written so far.
    pub fn report(&self) -> Report {
        self.shared.report.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// Whether the ring buffer had to drop messages because of its memory limit.
    pub fn is_short(&self) -> bool {
        self.shared.is_short.load(Ordering::Relaxed)
    }

    /// Ends the recording: writes the rest of the queue and closes the file.
    ///
    /// # Errors
    /// If the recording ended early, or the disk is too slow to complete it.
    pub fn finish(mut self, reason: &str) -> Result<Report, RecordError> {
        let is_stuck = self.full_since_ns.is_some();
        if let Some(jobs) = self.jobs.take() {
            // If the thread has ended already, `outcome` holds the reason.
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
            // The first error is returned, whether or not the file can be closed.
            let _ = sink.finish(&error.to_string());
            Err(error)
        }
    }
}
