//! The last place for the processor: for readers that nobody waits for.

use std::io;

/// Has this thread, and those that it starts from now on, run when no other wants the processor (SCHED_IDLE):
/// whoever wakes up takes it from them at once, whatever its own niceness.
///
/// # Errors
/// When the kernel refuses.
pub fn run_when_idle() -> io::Result<()> {
    // SAFETY: all zeros is a value of this plain C structure, and the priority of this policy.
    let parameters: libc::sched_param = unsafe { std::mem::zeroed() };
    // SAFETY: the structure lives through the call, which only reads it; 0 is the calling thread.
    match unsafe { libc::sched_setscheduler(0, libc::SCHED_IDLE, &raw const parameters) } {
        -1 => Err(io::Error::last_os_error()),
        _ => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn threads_that_are_started_later_are_idle_too() {
        // SAFETY: takes no pointer; 0 is the calling thread.
        let policy = || unsafe { libc::sched_getscheduler(0) };
        let before = policy();
        let first = std::thread::spawn(move || {
            run_when_idle().unwrap();
            (policy(), std::thread::spawn(policy).join().unwrap())
        });
        assert_eq!(first.join().unwrap(), (libc::SCHED_IDLE, libc::SCHED_IDLE));
        assert_eq!(policy(), before, "this thread is left as it was");
    }
}
