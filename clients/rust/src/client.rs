//! The client: follows a daemon from run to run.

use crate::frame::Frame;
use crate::last::Last;
use crate::options::Options;
use crate::run::{CHECK_PERIOD, Found, Run};
use messages::bus::{IpcError, set_library_log_level_of_reader};
use messages::instance::{Instance, InstanceError};
use messages::rig::RigRecord;
use std::time::{Duration, Instant};
use thiserror::Error;

/// Why a daemon cannot be read.
#[derive(Debug, Error)]
pub enum ClientError {
    /// No daemon can have this name.
    #[error(
        "\"{0}\" is no name of a daemon: give the value of instance.name, 1 to 16 letters, digits, - or _"
    )]
    Name(String),
    /// The daemon belongs to another user, or its folder is not safe to use.
    #[error("{0}; other users read the socket of `lookout stream` (docs/outputs.md)")]
    NotOurs(#[source] InstanceError),
    /// Its shared memory cannot be read: it has another layout, too many readers, or /dev/shm is full.
    #[error(transparent)]
    Memory(#[from] IpcError),
}

/// Reads a daemon's results. Use it in one thread.
#[derive(Debug)]
pub struct Client {
    options: Options,
    run: Option<Run>,
    last: Option<Last>,
    rig: RigRecord,
    /// Why there are no frames.
    waits: String,
    refused: u64,
}

impl Client {
    /// A client of a daemon, which need not run yet.
    ///
    /// # Errors
    /// If no daemon can have the name.
    pub fn open(options: Options) -> Result<Self, ClientError> {
        if !options.has_valid_name() {
            return Err(ClientError::Name(options.instance));
        }
        set_library_log_level_of_reader();
        let (waits, rig) = (absent(&options.instance), RigRecord::default());
        Ok(Self { options, run: None, last: None, rig, waits, refused: 0 })
    }

    /// The newest frame that was not given before; waits for it at most `timeout`. `None` if none came, and
    /// [`Self::waits`] says why.
    ///
    /// # Errors
    /// If there is a daemon that could not be read until the timeout. A later call tries again.
    pub fn next(&mut self, timeout: Duration) -> Result<Option<Frame<'_>>, ClientError> {
        Ok(if self.advance(timeout)? { self.frame() } else { None })
    }

    /// As [`Self::next`], but the frame is read with [`Self::frame`]. Returns whether there is one.
    ///
    /// # Errors
    /// As [`Self::next`].
    pub fn advance(&mut self, timeout: Duration) -> Result<bool, ClientError> {
        let now = Instant::now();
        // A day is as good as for ever, and no sum overflows.
        let until = now.checked_add(timeout).unwrap_or(now + Duration::from_secs(86_400));
        if let Some(run) = &mut self.run {
            run.release();
        }
        loop {
            let problem = match self.take(until) {
                Ok(Found::Result(result)) => {
                    let id = self.run.as_ref().map_or("", Run::id);
                    if let Some(last) = Last::after(self.last.as_ref(), id, result.0, result.1) {
                        self.last = Some(last);
                        self.waits.clear();
                        return Ok(true);
                    }
                    None
                }
                Ok(Found::Nothing) if self.run.is_some() => return Ok(false),
                Ok(Found::Nothing) => None,
                Ok(Found::Silent(reason)) => {
                    if self.end(&reason) {
                        return Ok(true);
                    }
                    None
                }
                Ok(Found::End) => {
                    self.leave();
                    if self.end("the daemon has ended") {
                        return Ok(true);
                    }
                    self.waits = absent(&self.options.instance);
                    None
                }
                Err(error) => {
                    self.leave();
                    if self.end(&error.to_string()) {
                        return Ok(true);
                    }
                    Some(error)
                }
            };
            let left = until.saturating_duration_since(Instant::now());
            if left.is_zero() {
                return problem.map_or(Ok(false), Err);
            }
            if self.run.is_none() {
                std::thread::sleep(left.min(CHECK_PERIOD));
            }
        }
    }

    /// The frame that was found last; `None` before the first one.
    pub fn frame(&self) -> Option<Frame<'_>> {
        let run = self.run.as_ref();
        let pictures = run.and_then(Run::pictures);
        Some(self.last.as_ref()?.frame(run.map_or(&self.rig, Run::rig), pictures))
    }

    /// Why there are no frames; empty while they come.
    pub fn waits(&self) -> &str {
        &self.waits
    }

    /// Number of messages that failed their check, and were skipped.
    pub fn refused(&self) -> u64 {
        self.refused + self.run.as_ref().map_or(0, Run::refused)
    }

    /// What the daemon has next, if it runs.
    fn take(&mut self, until: Instant) -> Result<Found, ClientError> {
        if self.run.is_none() {
            // Each time, because the folder of a service appears with the daemon.
            let instance = Instance::find(&self.options.instance, &self.options.directory);
            instance.check_owner().map_err(ClientError::NotOurs)?;
            if instance.is_running() {
                // Its memory is removed when it ends, also while it is being joined.
                self.run =
                    Run::join(&instance, &self.options).or_else(|e| self.only_if_running(&instance, e))?;
                self.waits = "there is no result yet".into();
            }
        }
        let Some(run) = &mut self.run else {
            self.waits = absent(&self.options.instance);
            return Ok(Found::Nothing);
        };
        match run.next(until) {
            Ok(found) => Ok(found),
            Err(error) => {
                let instance = Instance::find(&self.options.instance, &self.options.directory);
                self.only_if_running(&instance, error).map(|_| Found::End)
            }
        }
    }

    fn only_if_running(&self, instance: &Instance, error: IpcError) -> Result<Option<Run>, ClientError> {
        if instance.is_running() { Err(error.into()) } else { Ok(None) }
    }

    fn leave(&mut self) {
        if let Some(run) = self.run.take() {
            self.refused += run.refused();
        }
    }

    /// Withdraws the last frame. Returns false if there is nothing to withdraw.
    fn end(&mut self, reason: &str) -> bool {
        self.waits = reason.into();
        self.last.as_mut().is_some_and(|last| last.end(reason))
    }
}

fn absent(name: &str) -> String {
    format!(
        "no daemon named \"{name}\" of this user is running (another user's: the socket of `lookout stream`)"
    )
}
