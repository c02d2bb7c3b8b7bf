//! Sleeping until a message comes, a time is reached or a signal arrives.

use crate::bus::IpcError;
use crate::port::Subscriber;
use iceoryx2::prelude::*;
use iceoryx2::waitset::WaitSetRunResult;
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
/// When the wait set cannot be used, or `step` fails.
pub fn run<E: From<IpcError>>(
    subscribers: &[&Subscriber],
    mut step: impl FnMut() -> Result<Next, E>,
) -> Result<(), E> {
    // A signal must reach our own handlers, which signal-hook installs.
    let set = WaitSetBuilder::new()
        .signal_handling_mode(SignalHandlingMode::Disabled)
        .create::<ipc::Service>()
        .map_err(|e| IpcError::new("create", "wait set", e))?;
    let mut guards = Vec::with_capacity(subscribers.len());
    for subscriber in subscribers {
        let guard = set
            .attach_notification(&subscriber.listener)
            .map_err(|e| IpcError::new("wait for", subscriber.name, e))?;
        guards.push(guard);
    }
    loop {
        let timeout = match step()? {
            Next::Wait(timeout) => timeout,
            Next::Stop => return Ok(()),
        };
        let drain = |id: WaitSetAttachmentId<ipc::Service>| {
            for (guard, subscriber) in guards.iter().zip(subscribers) {
                if id.has_event_from(guard) {
                    // Only empties the listener, or the wait set would wake at once again; what
                    // it was notified of is found in the subscriber.
                    let _ = subscriber.listener.try_wait(|_| {});
                }
            }
            CallbackProgression::Continue
        };
        let result: Result<WaitSetRunResult, _> = set.wait_and_process_once_with_timeout(drain, timeout);
        if let Err(error) = result {
            return Err(IpcError::new("wait in", "wait set", error).into());
        }
    }
}
