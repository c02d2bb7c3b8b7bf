//! Reads pairs ahead, in a thread without real-time priority. Decoding allocates and may block on a disk or a network;
//! the capture stage itself does neither and only copies complete pairs.

use crate::input;
use crate::launch::Launch;
use crate::stages::vehicle_record::{reading, record};
use messages::clock::monotonic_ns;
use messages::motion::VehicleRecord;
use rustix::event::{EventfdFlags, eventfd};
use rustix::fd::{AsFd, BorrowedFd, OwnedFd};
use sources::PairSource;
use sources::vehicle::Watch;
use std::io;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::Thread;

/// Number of pairs in memory: the last published one, which may be requested again, and the next.
const SLOTS: usize = 2;

/// One pair, or the reason why it cannot be read.
#[derive(Debug)]
pub struct Pair {
    sequence: u64,
    /// Left image, grey values row after row.
    pub left: Vec<u8>,
    /// Right image, grey values row after row.
    pub right: Vec<u8>,
    /// Source time in nanoseconds; it continues when a source repeats.
    pub source_ns: u64,
    /// What the vehicle reported, as the source knows it.
    pub vehicle: VehicleRecord,
    /// Why the pair cannot be read, if so.
    pub result: Result<(), Unread>,
    /// Time of reading, in nanoseconds.
    pub read_ns: u64,
}

/// Why a pair cannot be read.
#[derive(Clone, Debug)]
pub struct Unread {
    /// Error text with file and remedy.
    pub reason: String,
    /// Whether the source goes on with the next pair. Otherwise this one is retried.
    pub is_left_out: bool,
}

impl From<String> for Unread {
    fn from(reason: String) -> Self {
        Self { reason, is_left_out: false }
    }
}

/// Memory of a pair. `is_full` states whether the stage or the reader owns it, so the lock never blocks.
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
    /// Starts reading at the first sequence of the launch document.
    ///
    /// # Errors
    /// If the system refuses a thread or a descriptor.
    pub fn start(launch: &Launch) -> io::Result<Self> {
        let pixels = launch.frames.width * launch.frames.height;
        let slot = || Slot {
            is_full: AtomicBool::new(false),
            pair: Mutex::new(Pair {
                sequence: 0,
                left: vec![0; pixels],
                right: vec![0; pixels],
                source_ns: 0,
                vehicle: VehicleRecord::default(),
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
        // The thread is never joined: it may block in a read, and must not prevent the stage from ending.
        Ok(Self { slots, ready, thread: thread.thread().clone() })
    }

    /// A descriptor that is readable when a pair has become available.
    pub fn descriptor(&self) -> BorrowedFd<'_> {
        self.ready.as_fd()
    }

    /// Drains the descriptor.
    pub fn take_notifications(&self) {
        let _ = rustix::io::read(&self.ready, &mut [0_u8; 8]);
    }

    /// Pair `sequence`, if it is available.
    pub fn pair(&self, sequence: u64) -> Option<MutexGuard<'_, Pair>> {
        let slot = &self.slots[place(sequence)];
        let pair = slot.is_full.load(Ordering::Acquire).then(|| slot.lock())?;
        (pair.sequence == sequence).then_some(pair)
    }

    /// Releases the slot of pair `sequence` for the next pair. If the pair could not be read and is not left out, it is
    /// retried.
    pub fn release(&self, sequence: u64) {
        self.slots[place(sequence)].is_full.store(false, Ordering::Release);
        self.thread.unpark();
    }
}

fn place(sequence: u64) -> usize {
    (sequence % SLOTS as u64) as usize
}

/// The thread: fills each slot as soon as it is free, until the end of the run.
fn fill(launch: &Launch, slots: &[Slot; SLOTS], ready: &OwnedFd) {
    let mut source = None;
    let mut watch = Watch::default();
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
        // The faults of a bus are told by the thread that reads it.
        if pair.result.is_ok()
            && launch.config.vehicle.bus.is_empty()
            && let Some(text) = watch.faults(reading(&pair.vehicle).faults)
        {
            tracing::warn!(sequence, "the vehicle's motion: {text}");
        }
        match &pair.result {
            Ok(()) => sequence += 1,
            // The retry opens the source again: its folder itself may have been missing.
            Err(unread) if unread.is_left_out => sequence += 1,
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
) -> Result<(), Unread> {
    let source = match source {
        Some(source) => source,
        None => source.insert(input::open(&launch.config).map_err(|error| error.to_string())?),
    };
    let (size, expected) = (source.size(), (launch.frames.width, launch.frames.height));
    if size != expected {
        return Err(format!(
            "the source has {}x{} pixels now, the run began with {}x{}: restart the daemon",
            size.0, size.1, expected.0, expected.1
        )
        .into());
    }
    let index = match source.count() {
        Some(count) if launch.config.source.repeat => sequence % count.max(1),
        _ => sequence,
    };
    source.read(index, &mut pair.left, &mut pair.right).map_err(|error| Unread {
        reason: error.to_string(),
        is_left_out: error.is_of_one_pair() && !launch.config.source.strict,
    })?;
    let rounds_ns = (sequence - index).saturating_mul(launch.source_period_ns);
    pair.source_ns = rounds_ns.saturating_add(source.time_ns(index));
    pair.vehicle = record(&source.vehicle(index));
    Ok(())
}
