//! Attaching to the shared memory of a running daemon.

use crate::command::error::CommandError;
use config::Config;
use messages::bus::{Bus, IpcError};
use messages::instance::{Instance, InstanceError};
use messages::neighbours::{DEFAULT_NAME, absent};
use messages::silence;
use messages::user;
use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

/// A connection to a running daemon. Dropping it frees its places in shared memory.
pub struct Attached {
    /// Access to the daemon's services.
    pub bus: Bus,
    /// The daemon.
    pub instance: Instance,
    /// Set by SIGINT, SIGTERM and SIGHUP.
    pub stop: Arc<AtomicBool>,
}

/// Attaches to the daemon that the configuration names. `subcommand` is the caller's name, for a hint.
///
/// # Errors
/// If no such daemon runs, it belongs to another user, or /dev/shm is full.
pub fn attach(config: &Config, subcommand: &str) -> Result<Attached, CommandError> {
    let instance = Instance::find(&config.instance.name, &config.instance.directory);
    check_owner(&instance, subcommand)?;
    if !instance.is_running() {
        return Err(absent(&instance).into());
    }
    let stop = stop_on_signals()?;
    let bus = Bus::join(&instance).map_err(|error| cannot_join(&instance, error))?;
    Ok(Attached { bus, instance, stop })
}

/// The error of a reader that cannot join a running daemon. If /dev/shm is full, it also says what is known of the
/// daemon without joining it.
pub fn cannot_join(instance: &Instance, error: IpcError) -> CommandError {
    if !error.is_full() {
        return error.into();
    }
    let (name, bytes) = (instance.name(), instance.shared_bytes());
    let process = silence::process(instance);
    CommandError::Other(format!(
        "the daemon \"{name}\" is running ({process}, {bytes} bytes in /dev/shm), but it cannot be read: {error}"
    ))
}

/// The error of a reader that gets no message from a daemon.
pub fn silent(instance: &Instance) -> CommandError {
    match silence::reason(instance) {
        None => absent(instance).into(),
        Some(reason) => CommandError::Other(reason),
    }
}

/// Checks that the daemon belongs to this user, who alone can read its shared memory.
///
/// # Errors
/// If it does not; with a hint how to run `subcommand` as its user.
pub fn check_owner(instance: &Instance, subcommand: &str) -> Result<(), CommandError> {
    instance.check_owner().map_err(|error| match error {
        InstanceError::OtherUser { owner, .. } => {
            let instance = if instance.name() == DEFAULT_NAME {
                String::new()
            } else {
                format!(" --instance {}", instance.name())
            };
            let sudo = user::for_sudo(owner);
            CommandError::Other(format!("{error}; try: sudo -u {sudo} lookout {subcommand}{instance}"))
        }
        error => error.into(),
    })
}

/// A flag that SIGINT, SIGTERM and SIGHUP set, so that a command can end in order: a process that is
/// killed while attached leaves its places in the daemon's shared memory occupied until they are swept.
///
/// # Errors
/// If a handler cannot be installed.
pub fn stop_on_signals() -> Result<Arc<AtomicBool>, CommandError> {
    let stop = Arc::new(AtomicBool::new(false));
    for signal in [SIGINT, SIGTERM, SIGHUP] {
        signal_hook::flag::register(signal, Arc::clone(&stop))
            .map_err(|e| CommandError::Other(format!("cannot catch signals: {e}")))?;
    }
    Ok(stop)
}
