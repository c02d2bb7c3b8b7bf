//! Reads pairs ahead, in a thread without priority. Decoding allocates and may wait for a disk or a
//! network; the capture stage does neither: it copies a pair that is whole.

use crate::input;
use crate::launch::Launch;
use messages::clock::monotonic_ns;
use rustix::event::{EventfdFlags, eventfd};
use rustix::fd::{AsFd, BorrowedFd, OwnedFd};
use sources::PairSource;
use std::io;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::Thread;

/// The pair that was published last, which may be asked for again, and the next.
const SLOTS: usize = 2;

/// One pair, or why it cannot be had.
#[derive(Debug)]
pub struct Pair {
    sequence: u64,
    /// Left image, row after row.
    pub left: Vec<u8>,
    /// Right image.
    pub right: Vec<u8>,
    /// Its time in the scene, in nanoseconds; a source that repeats goes on from round to round.
    pub source_ns: u64,
    /// The text names the file and the remedy.
    pub result: Result<(), String>,
    /// How long it took, in nanoseconds.
    pub read_ns: u64,
}

/// A place for a pair. Its lock is never waited for: whose turn it is stands in `is_full`.
#[derive(Debug)]
struct Slot {
    is_full: AtomicBool,
    pair: Mutex<Pair>,
}

impl Slot {
    fn lock(&self) -> MutexGuard<'_, Pair> {
        self.pair.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// The pairs of a source, read ahead.
#[derive(Debug)]
pub struct Reader {
    slots: Arc<[Slot; SLOTS]>,
    ready: Arc<OwnedFd>,
    thread: Thread,
}

impl Reader {
    /// Begins to read from the pair that the launch document names first.
    ///
    /// # Errors
    /// When the system gives no thread or descriptor.
    pub fn start(launch: &Launch) -> io::Result<Self> {
        let pixels = launch.frames.width * launch.frames.height;
        let slot = || Slot {
            is_full: AtomicBool::new(false),
            pair: Mutex::new(Pair {
                sequence: 0,
                left: vec![0; pixels],
                right: vec![0; pixels],
                source_ns: 0,
                result: Ok(()),
                read_ns: 0,
            }),
        };
        let slots = Arc::new([slot(), slot()]);
        let ready = Arc::new(eventfd(0, EventfdFlags::NONBLOCK | EventfdFlags::CLOEXEC)?);
        let thread = {
            let (slots, ready, launch) = (Arc::clone(&slots), Arc::clone(&ready), launch.clone());
            std::thread::Builder::new().name("reader".into()).spawn(move || fill(&launch, &slots, &ready))?
        };
        // Never joined: it may hang in a read for ever, and must not keep the stage from ending.
        Ok(Self { slots, ready, thread: thread.thread().clone() })
    }

    /// Can be read when a pair has become ready.
    pub fn descriptor(&self) -> BorrowedFd<'_> {
        self.ready.as_fd()
    }

    /// Empties the descriptor.
    pub fn take_notifications(&self) {
        let _ = rustix::io::read(&self.ready, &mut [0_u8; 8]);
    }

    /// Pair `sequence`, if it is there.
    pub fn pair(&self, sequence: u64) -> Option<MutexGuard<'_, Pair>> {
        let slot = &self.slots[place(sequence)];
        let pair = slot.is_full.load(Ordering::Acquire).then(|| slot.lock())?;
        (pair.sequence == sequence).then_some(pair)
    }

    /// Pair `sequence` is not needed any more: its place can be filled. One that could not be read is
    /// tried again.
    pub fn release(&self, sequence: u64) {
        self.slots[place(sequence)].is_full.store(false, Ordering::Release);
        self.thread.unpark();
    }
}

fn place(sequence: u64) -> usize {
    (sequence % SLOTS as u64) as usize
}

/// The thread: fills each place as soon as it is free, until the end.
fn fill(launch: &Launch, slots: &[Slot; SLOTS], ready: &OwnedFd) {
    let mut source = None;
    let mut sequence = launch.first_sequence;
    while launch.end_sequence.is_none_or(|end| sequence < end) {
        let slot = &slots[place(sequence)];
        while slot.is_full.load(Ordering::Acquire) {
            std::thread::park();
        }
        let begin_ns = monotonic_ns();
        let mut pair = slot.lock();
        pair.sequence = sequence;
        pair.result = read(launch, &mut source, &mut pair, sequence);
        pair.read_ns = monotonic_ns() - begin_ns;
        match pair.result {
            Ok(()) => sequence += 1,
            // Opened anew for the next try: the folder itself may have been away.
            Err(_) => source = None,
        }
        drop(pair);
        slot.is_full.store(true, Ordering::Release);
        let _ = rustix::io::write(ready, &1_u64.to_ne_bytes());
    }
}

fn read(
    launch: &Launch,
    source: &mut Option<Box<dyn PairSource>>,
    pair: &mut Pair,
    sequence: u64,
) -> Result<(), String> {
    let source = match source {
        Some(source) => source,
        None => source.insert(input::open(&launch.config).map_err(|error| error.to_string())?),
    };
    let (size, expected) = (source.size(), (launch.frames.width, launch.frames.height));
    if size != expected {
        return Err(format!(
            "the source has {}x{} pixels now, the run began with {}x{}: restart the daemon",
            size.0, size.1, expected.0, expected.1
        ));
    }
    let index = match source.count() {
        Some(count) if launch.config.source.repeat => sequence % count.max(1),
        _ => sequence,
    };
    source.read(index, &mut pair.left, &mut pair.right).map_err(|error| error.to_string())?;
    let rounds_ns = (sequence - index).saturating_mul(launch.source_period_ns);
    pair.source_ns = rounds_ns.saturating_add(source.time_ns(index));
    Ok(())
}
