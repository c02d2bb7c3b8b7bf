//! The system calls of real time: priority, locked memory, memory that is there before it is used.

use rustix::mm::{MlockAllFlags, mlockall};
use rustix::process::{Resource, Rlimit, getrlimit, setrlimit};
use rustix::thread::{CapabilitySet, capabilities};
use std::io;

/// Stack that is touched beforehand, in bytes: more than any stage uses.
const STACK_BYTES: usize = 256 << 10;

/// The least and the greatest priority that is asked for. Above them the kernel's own threads run:
/// interrupts, watchdogs.
pub const PRIORITIES: std::ops::RangeInclusive<u32> = 10..=55;

/// Puts this thread under SCHED_FIFO. Processes and threads that it starts begin under the usual
/// time-sharing again (SCHED_RESET_ON_FORK).
///
/// # Errors
/// When `priority` is out of [`PRIORITIES`], or the process may not (CAP_SYS_NICE or RLIMIT_RTPRIO).
pub fn set_fifo(priority: u32) -> io::Result<()> {
    if !PRIORITIES.contains(&priority) {
        return Err(io::Error::new(io::ErrorKind::InvalidInput, format!("priority {priority}")));
    }
    // SAFETY: all zeros is a value of this plain C structure.
    let mut parameters: libc::sched_param = unsafe { std::mem::zeroed() };
    parameters.sched_priority = priority as libc::c_int;
    let policy = libc::SCHED_FIFO | libc::SCHED_RESET_ON_FORK;
    // SAFETY: the structure lives through the call, which only reads it; 0 is the calling thread.
    match unsafe { libc::sched_setscheduler(0, policy, &raw const parameters) } {
        -1 => Err(io::Error::last_os_error()),
        _ => Ok(()),
    }
}

/// The SCHED_FIFO priority that this thread has, as the kernel says; 0 = another policy.
pub fn fifo_priority() -> u32 {
    // SAFETY: all zeros is a value of this plain C structure.
    let mut parameters: libc::sched_param = unsafe { std::mem::zeroed() };
    // SAFETY: takes no pointer; 0 is the calling thread.
    let policy = unsafe { libc::sched_getscheduler(0) };
    // SAFETY: the structure lives through the call, which fills it.
    let known = unsafe { libc::sched_getparam(0, &raw mut parameters) } == 0;
    if known && policy & !libc::SCHED_RESET_ON_FORK == libc::SCHED_FIFO {
        parameters.sched_priority.unsigned_abs()
    } else {
        0
    }
}

/// Has the kernel end this process when a real-time thread of it runs for `microseconds` without once
/// sleeping (RLIMIT_RTTIME): a stage that spins must not take its core along.
///
/// # Errors
/// When the limit cannot be lowered.
pub fn limit_realtime(microseconds: u64) -> io::Result<()> {
    // First SIGXCPU, which tells why; should that be caught, SIGKILL. Both are looked at by ticks of the
    // kernel, several milliseconds apart, so they must not be close together.
    let limit = Rlimit { current: Some(microseconds), maximum: Some(microseconds + 1_000_000) };
    Ok(setrlimit(Resource::Rttime, limit)?)
}

/// Locks all memory of this process, now and later, as it is touched: nothing of it is paged out, and
/// nothing is made resident that nobody uses.
///
/// # Errors
/// When the process may not: it needs CAP_IPC_LOCK, or RLIMIT_MEMLOCK without limit. Within a limit it
/// is refused, too: memory that is asked for later would not be had, which ends a process.
pub fn lock_memory() -> io::Result<()> {
    let may = capabilities(None).is_ok_and(|sets| sets.effective.contains(CapabilitySet::IPC_LOCK));
    if let (false, Some(bytes)) = (may, getrlimit(Resource::Memlock).current) {
        let text = format!("no CAP_IPC_LOCK, and RLIMIT_MEMLOCK is {bytes} bytes");
        return Err(io::Error::new(io::ErrorKind::PermissionDenied, text));
    }
    Ok(mlockall(MlockAllFlags::CURRENT | MlockAllFlags::FUTURE | MlockAllFlags::ONFAULT)?)
}

/// Touches the stack below this frame, so that no page of it has to be found while a frame is worked on.
#[inline(never)]
pub fn prefault_stack() {
    let mut stack = [0_u8; STACK_BYTES];
    for page in stack.chunks_mut(4096) {
        page[0] = std::hint::black_box(1);
    }
    std::hint::black_box(&stack);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn priorities_beyond_the_range_are_refused_before_the_kernel_is_asked() {
        for priority in [0, 9, 56, 99, u32::MAX] {
            assert_eq!(set_fifo(priority).unwrap_err().kind(), io::ErrorKind::InvalidInput, "{priority}");
        }
    }

    #[test]
    fn a_granted_priority_is_read_back_and_not_inherited() {
        // A thread of its own: the others of this test program stay as they are.
        std::thread::scope(|scope| {
            scope.spawn(|| match set_fifo(12) {
                Ok(()) => {
                    assert_eq!(fifo_priority(), 12);
                    let child = std::thread::spawn(fifo_priority).join().unwrap();
                    assert_eq!(child, 0, "what it starts begins at normal priority");
                }
                Err(error) => {
                    println!("refused here: {error}");
                    assert_eq!(fifo_priority(), 0);
                }
            });
        });
        prefault_stack();
    }
}
