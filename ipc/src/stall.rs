//! A bound for every wait inside iceoryx2.
//!
//! iceoryx2 waits without limit for some states of its files in shared memory, which only a process of the same user
//! can cause: a truncated file, garbage in its structures. A thread that waits there hears neither a signal flag nor a
//! timeout of ours. So each call into iceoryx2 runs inside a `Guard`, and one thread of the process ends it if a call
//! has not returned for [`LIMIT`]. A stage is then restarted by its scheduler, a scheduler by systemd.

use std::cell::Cell;
use std::io;
use std::sync::OnceLock;
use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering};
use std::time::Duration;

/// Longest time of a call: a thousand times what the slowest, joining a run on a loaded board, was seen to take.
pub const LIMIT: Duration = Duration::from_secs(6);

/// Time between two examinations.
const TICK: Duration = Duration::from_secs(1);

/// Number of threads that are watched independently. More threads share slots, and a stall of one of them may then be
/// noticed only when the others are idle.
const SLOTS: usize = 16;

/// Stack of the watching thread, in bytes. It is small because `realtime.memory_lock` locks all of it.
const STACK_BYTES: usize = 128 << 10;

/// Exit code of a process that was ended.
const EXIT_CODE: i32 = 1;

/// What a guarded call does, for the message.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Call {
    Join,
    Sweep,
    Open,
    Loan,
    Send,
    Receive,
    Connect,
    Listen,
    Leave,
}

impl Call {
    const ALL: [Self; 9] = [
        Self::Join,
        Self::Sweep,
        Self::Open,
        Self::Loan,
        Self::Send,
        Self::Receive,
        Self::Connect,
        Self::Listen,
        Self::Leave,
    ];

    fn name(self) -> &'static str {
        match self {
            Self::Join => "joining the run",
            Self::Sweep => "removing the ports of dead processes",
            Self::Open => "opening a service",
            Self::Loan => "loaning a message",
            Self::Send => "sending a message",
            Self::Receive => "receiving a message",
            Self::Connect => "connecting subscribers",
            Self::Listen => "listening",
            Self::Leave => "leaving the run",
        }
    }
}

/// Per slot: 0 outside a call, else a serial number of the call (upper bits) and 1 + [`Call`] (lower 8 bits).
static CALLS: [AtomicU64; SLOTS] = [const { AtomicU64::new(0) }; SLOTS];

static NEXT_SLOT: AtomicUsize = AtomicUsize::new(0);

type Report = fn(&str);

static REPORT: OnceLock<Report> = OnceLock::new();

thread_local! {
    static SLOT: usize = NEXT_SLOT.fetch_add(1, Ordering::Relaxed) % SLOTS;

    /// Whether this thread is inside a call: its slot may be another thread's, too.
    static INSIDE: Cell<bool> = const { Cell::new(false) };
}

/// The thread is inside a call as long as this lives.
pub(crate) struct Guard(());

impl Guard {
    /// Marks the begin of a call.
    pub(crate) fn enter(call: Call) -> Self {
        let slot = SLOT.with(|slot| *slot);
        // Only this thread writes to its slot, so the serial number needs no atomic addition.
        let serial = CALLS[slot].load(Ordering::Relaxed) >> 8;
        CALLS[slot].store(((serial + 1) << 8) | (call as u64 + 1), Ordering::Relaxed);
        INSIDE.set(true);
        Self(())
    }
}

impl Drop for Guard {
    fn drop(&mut self) {
        leave();
    }
}

/// Whether this thread is inside a call into iceoryx2.
pub(crate) fn is_inside_call() -> bool {
    INSIDE.get()
}

/// Marks the end of this thread's call.
fn leave() {
    // A thread-local without a destructor of its own is accessible as long as the thread lives.
    let slot = SLOT.with(|slot| *slot);
    CALLS[slot].fetch_and(!0xff, Ordering::Relaxed);
    INSIDE.set(false);
}

/// First field of a struct whose other fields call iceoryx2 while they are dropped: marks the begin of that call.
#[derive(Debug)]
pub(crate) struct DropBegins;

impl Drop for DropBegins {
    fn drop(&mut self) {
        std::mem::forget(Guard::enter(Call::Leave));
    }
}

/// Last field of such a struct: marks the end of the call.
#[derive(Debug)]
pub(crate) struct DropEnds;

impl Drop for DropEnds {
    fn drop(&mut self) {
        leave();
    }
}

/// Sets what is called with the reason before the process is ended; only the first call has an effect. Without it the
/// reason goes to standard error.
pub fn set_report(report: Report) {
    let _ = REPORT.set(report);
}

/// Starts the watching thread of this process, if it does not run yet.
///
/// # Errors
/// If the thread cannot be started.
pub(crate) fn watch() -> io::Result<()> {
    static RUNNING: OnceLock<()> = OnceLock::new();
    if RUNNING.get().is_some() {
        return Ok(());
    }
    // Two threads that get here at once start two watchers, which does no harm.
    std::thread::Builder::new().name("stall".into()).stack_size(STACK_BYTES).spawn(|| {
        let mut watch = Watch::default();
        loop {
            std::thread::sleep(TICK);
            if let Some(call) = watch.tick(|slot| CALLS[slot].load(Ordering::Relaxed)) {
                end(call);
            }
        }
    })?;
    let _ = RUNNING.set(());
    Ok(())
}

/// Ends the process. Its stages end with it (`PR_SET_PDEATHSIG`).
fn end(call: Call) -> ! {
    let text = format!(
        "shared memory has not responded for {} s ({}): it was damaged or removed by another program; this process \
         ends, start it again",
        LIMIT.as_secs(),
        call.name()
    );
    match REPORT.get() {
        Some(report) => report(&text),
        None => eprintln!("{text}"),
    }
    // SAFETY: _exit(2) takes any status and does not return. exit(3) would run handlers that may wait for the stalled
    // thread.
    unsafe { libc::_exit(EXIT_CODE) }
}

/// The policy: which call has lasted too long. It counts its own ticks, because a process that was stopped and
/// continued has not stalled.
#[derive(Debug, Default)]
struct Watch {
    before: [u64; SLOTS],
    ticks: [u32; SLOTS],
}

impl Watch {
    fn tick(&mut self, value: impl Fn(usize) -> u64) -> Option<Call> {
        let limit = (LIMIT.as_nanos() / TICK.as_nanos()) as u32;
        let mut stalled = None;
        for slot in 0..SLOTS {
            let now = value(slot);
            let call = (now & 0xff) as usize;
            let goes_on = call != 0 && now == self.before[slot];
            self.ticks[slot] = if goes_on { self.ticks[slot] + 1 } else { 0 };
            self.before[slot] = now;
            if self.ticks[slot] >= limit {
                stalled = Call::ALL.get(call - 1).copied();
            }
        }
        stalled
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_one_call_that_lasts_too_long_is_a_stall() {
        let limit = LIMIT.as_secs() as usize;
        let mut watch = Watch::default();
        // The same thread makes many calls: another serial number at each tick.
        for tick in 0..10 * limit as u64 {
            assert_eq!(watch.tick(|_| (tick << 8) | 3), None);
        }
        // It is outside.
        for _ in 0..10 * limit {
            assert_eq!(watch.tick(|_| 77 << 8), None);
        }
        // It does not return from a call, while others work.
        let mut calls = (0..).map(|tick: u64| {
            watch.tick(|slot| if slot == 2 { (5 << 8) | 2 } else { (tick << 8) | (tick & 1) })
        });
        assert!(calls.by_ref().take(limit).all(|stalled| stalled.is_none()));
        assert_eq!(calls.next(), Some(Some(Call::Sweep)));
    }

    #[test]
    fn a_guard_marks_its_call_and_every_call_has_its_name() {
        let value = || CALLS[SLOT.with(|slot| *slot)].load(Ordering::Relaxed);
        let first = {
            let _guard = Guard::enter(Call::Send);
            value()
        };
        assert_eq!(Call::ALL[(first & 0xff) as usize - 1], Call::Send);
        assert_eq!(value() & 0xff, 0);
        let second = {
            let _guard = Guard::enter(Call::Send);
            value()
        };
        assert_ne!(first, second, "two calls are distinguished");
        for (i, call) in Call::ALL.into_iter().enumerate() {
            assert_eq!(call as usize, i);
        }
    }
}
