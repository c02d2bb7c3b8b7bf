//! Waiting for a message, a timeout or a signal.
//!
//! The wait set of iceoryx2 allocates at each wake-up, so this module polls the descriptors of the listeners
//! directly. That also avoids a lost wake-up: a notification that is sent while a listener is drained can lose its
//! byte in the socket while it stays marked as sent, and then no later notification wakes the reader. Listeners are
//! therefore drained until they are empty before the process sleeps.

use crate::error::IpcError;
use crate::port::Subscriber;
use crate::stall::{Call, Guard};
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

/// Calls `step` immediately, and again after each notification of a subscriber, after the timeout that `step`
/// returned, and after a signal, until it returns [`Next::Stop`]. The process sleeps in between. `step` must
/// receive all messages that it needs: a notification during `step` causes another call, but one notification may
/// stand for several messages.
///
/// # Errors
/// If the subscribers cannot be polled, or `step` fails.
pub fn run<E: From<IpcError>>(
    subscribers: &[&Subscriber],
    step: impl FnMut() -> Result<Next, E>,
) -> Result<(), E> {
    run_with(subscribers, None, step)
}

/// As [`run`], and also wakes up while `other` is readable. `step` has to drain it.
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
            // After a signal its handler has run; `step` checks the flag that it has set.
            Ok(_) | Err(Errno::INTR) => {}
            Err(error) => return Err(IpcError::new("wait for", "messages", error).into()),
        }
        // `step` receives the message first and the notification is drained after it: that saves two system calls.
    }
}

fn descriptor(subscriber: &Subscriber) -> BorrowedFd<'_> {
    // SAFETY: the listener owns the descriptor, and it is borrowed for as long as the result.
    unsafe { BorrowedFd::borrow_raw(subscriber.listener.file_descriptor().native_handle()) }
}

/// Drains the listeners. Returns whether there was a notification; the messages are in the subscribers.
fn take_notifications(subscribers: &[&Subscriber]) -> Result<bool, IpcError> {
    let _guard = Guard::enter(Call::Listen);
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
