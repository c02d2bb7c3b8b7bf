//! Sleeping until a message comes, a time is reached or a signal arrives.
//!
//! The library's wait set allocates at each wake-up, so the listeners' descriptors are waited for
//! directly. That also closes a gap: a notification that is sent while a listener is emptied can lose its
//! byte in the socket while it stays marked as sent, and then no later one wakes anybody. Listeners are
//! therefore emptied until they have nothing more to tell before the process sleeps.

use crate::error::IpcError;
use crate::port::Subscriber;
use iceoryx2::prelude::FileDescriptorBased;
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::fd::BorrowedFd;
use rustix::io::Errno;
use std::time::Duration;

/// What to do next.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Next {
    /// Sleep, at most this long.
    Wait(Duration),
    /// Leave the loop.
    Stop,
}

/// Calls `step` at once, and again whenever one of the subscribers is notified, the time that it
/// asked for has passed or a signal has arrived, until it says [`Next::Stop`]. The process sleeps
/// in between. `step` must take all messages that it wants to see: a notification that comes
/// while it runs wakes it again, but one message may stand for several notifications.
///
/// # Errors
/// When the subscribers cannot be waited for, or `step` fails.
pub fn run<E: From<IpcError>>(
    subscribers: &[&Subscriber],
    step: impl FnMut() -> Result<Next, E>,
) -> Result<(), E> {
    run_with(subscribers, None, step)
}

/// As [`run`]; wakes also while `other` can be read, which `step` has to empty.
///
/// # Errors
/// As [`run`].
pub fn run_with<E: From<IpcError>>(
    subscribers: &[&Subscriber],
    other: Option<BorrowedFd<'_>>,
    mut step: impl FnMut() -> Result<Next, E>,
) -> Result<(), E> {
    let mut descriptors: Vec<PollFd<'_>> = subscribers
        .iter()
        .map(|subscriber| descriptor(subscriber))
        .chain(other)
        .map(|fd| PollFd::from_borrowed_fd(fd, PollFlags::IN))
        .collect();
    loop {
        let timeout = match step()? {
            Next::Wait(timeout) => timeout,
            Next::Stop => return Ok(()),
        };
        if take_notifications(subscribers)? {
            continue;
        }
        let timeout =
            Timespec { tv_sec: timeout.as_secs().min(86_400) as i64, tv_nsec: timeout.subsec_nanos().into() };
        match poll(&mut descriptors, Some(&timeout)) {
            // A signal: its handler has run, step looks at what it left.
            Ok(_) | Err(Errno::INTR) => {}
            Err(error) => return Err(IpcError::new("wait for", "messages", error).into()),
        }
        // The message comes first, its notification is taken after it: that saves its reader two calls.
    }
}

fn descriptor(subscriber: &Subscriber) -> BorrowedFd<'_> {
    // SAFETY: the listener owns the descriptor and is borrowed as long as the result.
    unsafe { BorrowedFd::borrow_raw(subscriber.listener.file_descriptor().native_handle()) }
}

/// Empties the listeners; what they were notified of is found in the subscribers. Gives whether there
/// was anything.
fn take_notifications(subscribers: &[&Subscriber]) -> Result<bool, IpcError> {
    let mut any = false;
    for subscriber in subscribers {
        let count = subscriber
            .listener
            .try_wait(|_| {})
            .map_err(|e| IpcError::new("listen to", subscriber.name, e))?;
        any |= count > 0;
    }
    Ok(any)
}
