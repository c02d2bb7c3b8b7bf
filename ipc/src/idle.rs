//! The scheduling policy SCHED_IDLE, for readers without a deadline.

use std::io;

/// Puts this thread, and all threads that it starts later, under SCHED_IDLE: they run only when no other thread is
/// runnable, and any other thread preempts them when it wakes up, whatever its niceness.
///
/// # Errors
/// If the kernel refuses.
pub fn run_when_idle() -> io::Result<()> {
    // SAFETY: all zeros is a valid value of this plain C structure, and 0 is the priority that this policy requires.
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
        assert_eq!(policy(), before, "the policy of this thread has not changed");
    }
}
