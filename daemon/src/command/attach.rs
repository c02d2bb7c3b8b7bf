//! Joining a running daemon from outside.

use crate::command::error::CommandError;
use config::Config;
use messages::bus::Bus;
use messages::instance::{Instance, InstanceError};
use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

/// A daemon that was joined. It is left properly when this is dropped.
pub struct Attached {
    /// The way into its shared memory.
    pub bus: Bus,
    /// The daemon.
    pub instance: Instance,
    /// Set when a signal asks this process to stop.
    pub stop: Arc<AtomicBool>,
}

/// Joins the daemon that the configuration names; `word` is this command's, for a hint.
///
/// # Errors
/// When none runs, or it belongs to another user.
pub fn attach(config: &Config, word: &str) -> Result<Attached, CommandError> {
    let instance = Instance::find(&config.instance.name, &config.instance.directory);
    let (owner, user) = (instance.owner(), rustix::process::geteuid().as_raw());
    if let Some(owner) = owner.filter(|&owner| owner != user) {
        return Err(CommandError::Other(format!(
            "the daemon \"{}\" belongs to user {owner}, this is user {user}: shared memory is its own; \
             try: sudo -u '#{owner}' lookout {word}",
            instance.name()
        )));
    }
    if !instance.is_running() {
        return Err(InstanceError::NotRunning(instance.name().to_owned()).into());
    }
    // Leaves properly, so that nothing of it stays in the daemon's shared memory.
    let stop = Arc::new(AtomicBool::new(false));
    for signal in [SIGINT, SIGTERM, SIGHUP] {
        signal_hook::flag::register(signal, Arc::clone(&stop))
            .map_err(|e| CommandError::Other(format!("cannot catch signals: {e}")))?;
    }
    Ok(Attached { bus: Bus::join(&instance)?, instance, stop })
}
