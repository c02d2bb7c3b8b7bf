//! Follows the daemon across its runs, and keeps its newest values for the sender.

use super::Shared;
use super::state_file::{CanOutState, StateFile};
use super::values::{daemon_state, result_values};
use messages::alarm::Faults;
use messages::bus::{Bus, IpcError};
use messages::instance::Instance;
use messages::obstacles::Newest;
use messages::port::Subscriber;
use messages::silence;
use messages::wait::{self, Next};
use messages::{obstacles, service, status};
use std::io;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};
use thiserror::Error;
use tools::can_out::DaemonState;

/// Period of checking whether a daemon runs.
const CHECK_PERIOD: Duration = Duration::from_millis(250);

/// Period of telling the state of the bus.
const TELL_PERIOD: Duration = Duration::from_secs(1);

/// Why a daemon is no longer followed.
#[derive(Debug, Error)]
pub enum WatchError {
    /// Its messages cannot be read; that is tried again.
    #[error(transparent)]
    Ipc(#[from] IpcError),
    /// Another process sends for this instance.
    #[error("another lookout can sends for the daemon \"{0}\": end it, or name another instance")]
    Taken(String),
}

/// Follows an instance until `stop` is set.
pub struct Watcher {
    instance: Instance,
    interface: String,
    shared: Arc<Shared>,
    stop: Arc<AtomicBool>,
    newest: Newest,
    /// Time of the last status.
    heard: Instant,
    /// Time at which the state of the bus is told next.
    told: Option<Instant>,
    refused: u64,
}

impl Watcher {
    /// A watcher of an instance for the sender on `interface`.
    pub fn new(instance: Instance, interface: &str, shared: Arc<Shared>, stop: Arc<AtomicBool>) -> Self {
        Self {
            instance,
            interface: interface.to_owned(),
            shared,
            stop,
            newest: Newest::default(),
            heard: Instant::now(),
            told: None,
            refused: 0,
        }
    }

    /// Follows the daemon until it is stopped.
    ///
    /// # Errors
    /// If another process sends for the instance.
    pub fn run(&mut self) -> Result<(), WatchError> {
        let mut last_error = None;
        while !self.stop.load(Ordering::Relaxed) {
            let error = match self.absence() {
                Some(why) => Some(why),
                None => match self.follow() {
                    Ok(()) => None,
                    Err(error @ WatchError::Taken(_)) => return Err(error),
                    Err(error) => Some(error.to_string()),
                },
            };
            self.shared.values().daemon = Some(DaemonState::NotRunning);
            // Logged once per change: a daemon that is just starting has no services for a while.
            if error.is_some() && error != last_error {
                tracing::info!("{}", error.as_deref().unwrap_or_default());
            }
            last_error = error;
            std::thread::sleep(CHECK_PERIOD);
        }
        Ok(())
    }

    /// Why there is no daemon to follow.
    fn absence(&self) -> Option<String> {
        // The daemon that is waited for may be another user's.
        if let Err(error) = self.instance.check_owner() {
            return Some(error.to_string());
        }
        let name = self.instance.name();
        let runs = self.instance.is_running() && self.instance.prefix().is_some();
        (!runs).then(|| format!("no daemon named \"{name}\" is running: waiting for one"))
    }

    /// Follows one run to its end.
    fn follow(&mut self) -> Result<(), WatchError> {
        let prefix = self.instance.prefix();
        let bus = Bus::join(&self.instance)?;
        let results = bus.subscriber(&service::OBSTACLES)?;
        let statuses = bus.subscriber(&service::STATUS)?;
        let file = match StateFile::create(&self.instance) {
            Ok(file) => Some(file),
            Err(error) if error.kind() == io::ErrorKind::WouldBlock => {
                return Err(WatchError::Taken(self.instance.name().to_owned()));
            }
            Err(error) => {
                tracing::warn!(%error, "the state of CAN out cannot be told to lookout status");
                None
            }
        };
        self.newest = Newest::default();
        self.heard = Instant::now();
        self.told = None;
        let mut checked = Instant::now();
        tracing::info!("connected to the daemon {}", self.instance.name());
        wait::run::<WatchError>(&[&results, &statuses], || {
            if self.stop.load(Ordering::Relaxed) {
                return Ok(Next::Stop);
            }
            if checked.elapsed() >= CHECK_PERIOD {
                checked = Instant::now();
                if !self.instance.is_running() || self.instance.prefix() != prefix {
                    tracing::info!("the daemon has ended");
                    return Ok(Next::Stop);
                }
                if self.heard.elapsed() > silence::TIMEOUT {
                    self.shared.values().daemon = None;
                }
            }
            self.take_status(&statuses)?;
            self.take_result(&results)?;
            self.tell(file.as_ref());
            Ok(Next::Wait(CHECK_PERIOD))
        })
    }

    fn take_status(&mut self, statuses: &Subscriber) -> Result<(), IpcError> {
        while let Some(sample) = statuses.receive()? {
            match status::view(sample.header(), sample.payload()) {
                Ok(status) => {
                    self.heard = Instant::now();
                    let mut values = self.shared.values();
                    values.daemon = Some(daemon_state(&status));
                    values.source = u32::try_from(status.source).ok();
                }
                Err(error) => self.refused("status", &error),
            }
        }
        Ok(())
    }

    fn take_result(&mut self, results: &Subscriber) -> Result<(), IpcError> {
        while let Some(sample) = results.receive()? {
            let header = *sample.header();
            match obstacles::view(&header, sample.payload()) {
                Ok(_) if !self.newest.accepts(&header) => {}
                Ok(message) if header.withdraws == 1 => {
                    self.shared.values().withdrawn = message.alarm.faults.max(Faults::STALE.0);
                }
                Ok(message) => {
                    let result = result_values(&header, &message);
                    let mut values = self.shared.values();
                    (values.result, values.withdrawn) = (Some(result), 0);
                    // A result is a sign of life, too: the first status may come later.
                    values.daemon.get_or_insert(DaemonState::Running);
                    if values.daemon == Some(DaemonState::NotRunning) {
                        values.daemon = Some(DaemonState::Running);
                    }
                }
                Err(error) => self.refused("obstacles", &error),
            }
        }
        Ok(())
    }

    fn refused(&mut self, service: &str, error: &dyn std::fmt::Display) {
        self.refused += 1;
        if self.refused.is_power_of_two() {
            tracing::warn!(service, %error, total = self.refused, "message refused");
        }
    }

    /// Writes the state of the bus for `lookout status`, once a second.
    fn tell(&mut self, file: Option<&StateFile>) {
        if self.told.is_some_and(|at| at.elapsed() < TELL_PERIOD) {
            return;
        }
        self.told = Some(Instant::now());
        let report = self.shared.report().clone();
        let state = CanOutState { interface: self.interface.clone(), pid: std::process::id(), report };
        if let Some(Err(error)) = file.map(|file| file.write(&state)) {
            tracing::debug!(%error, "the state of CAN out is not written");
        }
    }
}
