//! System calls for real-time operation: scheduling policy, memory locks, prefaulting.

use rustix::mm::{MlockAllFlags, mlockall};
use rustix::process::{Resource, Rlimit, getrlimit, setrlimit};
use rustix::thread::{CapabilitySet, capabilities};
use std::io;

/// Size of the prefaulted stack in bytes; more than any stage uses.
const STACK_BYTES: usize = 256 << 10;

/// Range of SCHED_FIFO priorities that the daemon uses. Threads of the kernel (interrupts, watchdogs) run above it.
pub const PRIORITIES: std::ops::RangeInclusive<u32> = 10..=55;

/// Puts this thread under SCHED_FIFO. Processes and threads that it starts do not inherit the policy
/// (SCHED_RESET_ON_FORK).
///
/// # Errors
/// If `priority` is out of [`PRIORITIES`], or the process lacks CAP_SYS_NICE and RLIMIT_RTPRIO.
pub fn set_fifo(priority: u32) -> io::Result<()> {
    if !PRIORITIES.contains(&priority) {
        return Err(io::Error::new(io::ErrorKind::InvalidInput, format!("priority {priority}")));
    }
    // SAFETY: all zeros is a valid value of this plain C structure.
    let mut parameters: libc::sched_param = unsafe { std::mem::zeroed() };
    parameters.sched_priority = priority as libc::c_int;
    let policy = libc::SCHED_FIFO | libc::SCHED_RESET_ON_FORK;
    // SAFETY: the structure lives through the call, which only reads it; 0 is the calling thread.
    match unsafe { libc::sched_setscheduler(0, policy, &raw const parameters) } {
        -1 => Err(io::Error::last_os_error()),
        _ => Ok(()),
    }
}

/// The SCHED_FIFO priority of this thread, read from the kernel; 0 = another policy.
pub fn fifo_priority() -> u32 {
    // SAFETY: all zeros is a valid value of this plain C structure.
    let mut parameters: libc::sched_param = unsafe { std::mem::zeroed() };
    // SAFETY: the call takes no pointer; 0 is the calling thread.
    let policy = unsafe { libc::sched_getscheduler(0) };
    // SAFETY: the structure lives through the call, which fills it.
    let known = unsafe { libc::sched_getparam(0, &raw mut parameters) } == 0;
    if known && policy & !libc::SCHED_RESET_ON_FORK == libc::SCHED_FIFO {
        parameters.sched_priority.unsigned_abs()
    } else {
        0
    }
}

/// Limits the processor time that a real-time thread of this process may use without sleeping to `microseconds`
/// (RLIMIT_RTTIME). The kernel then ends the process, so that a stage that spins does not block its core.
///
/// # Errors
/// If the limit cannot be lowered.
pub fn limit_realtime(microseconds: u64) -> io::Result<()> {
    // The soft limit sends SIGXCPU, which names the cause; the hard limit sends SIGKILL, should SIGXCPU be caught.
    // The kernel checks both at its ticks, which are several milliseconds apart, so the limits need some distance.
    let limit = Rlimit { current: Some(microseconds), maximum: Some(microseconds + 1_000_000) };
    Ok(setrlimit(Resource::Rttime, limit)?)
}

/// Locks all current and future memory of this process when it is touched (MCL_ONFAULT): it is never paged out, and
/// unused pages do not become resident.
///
/// # Errors
/// Without CAP_IPC_LOCK and an unlimited RLIMIT_MEMLOCK. A finite limit is an error, too: a later allocation could
/// exceed it, which would end the process.
pub fn lock_memory() -> io::Result<()> {
    let may = capabilities(None).is_ok_and(|sets| sets.effective.contains(CapabilitySet::IPC_LOCK));
    if let (false, Some(bytes)) = (may, getrlimit(Resource::Memlock).current) {
        let text = format!("no CAP_IPC_LOCK, and RLIMIT_MEMLOCK is {bytes} bytes");
        return Err(io::Error::new(io::ErrorKind::PermissionDenied, text));
    }
    Ok(mlockall(MlockAllFlags::CURRENT | MlockAllFlags::FUTURE | MlockAllFlags::ONFAULT)?)
}

/// Touches the pages of the stack below this function, so that no page fault occurs there while a frame is processed.
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
    fn priorities_out_of_range_are_refused_without_a_system_call() {
        for priority in [0, 9, 56, 99, u32::MAX] {
            assert_eq!(set_fifo(priority).unwrap_err().kind(), io::ErrorKind::InvalidInput, "{priority}");
        }
    }

    #[test]
    fn a_granted_priority_is_read_back_and_not_inherited() {
        // In a separate thread, so that the other tests of this program keep their policy.
        std::thread::scope(|scope| {
            scope.spawn(|| match set_fifo(12) {
                Ok(()) => {
                    assert_eq!(fifo_priority(), 12);
                    let child = std::thread::spawn(fifo_priority).join().unwrap();
                    assert_eq!(child, 0, "a child thread has no real-time priority");
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
