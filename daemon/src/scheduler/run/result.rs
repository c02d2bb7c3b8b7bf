//! The last result, and its withdrawal when it is out of date.
//!
//! A message on `obstacles` stays readable after the stage that sent it has died, also for new subscribers. The
//! scheduler therefore publishes on that service, too: when a stage is not running, or results have stopped, it sends
//! one message with the level `off`, without obstacles, that withdraws the earlier results. The next result replaces it.

use messages::alarm::{self, Faults};
use messages::bus::IpcError;
use messages::clock::monotonic_ns;
use messages::header::{Header, Kind};
use messages::obstacles::{self, AlarmRecord, Newest};
use messages::port::{Publisher, Sample};

/// The last result.
#[derive(Clone, Copy, Debug)]
pub(super) struct LastResult {
    pub(super) alarm: AlarmRecord,
    pub(super) confirmed: u32,
    pub(super) header: Header,
    at_ns: u64,
}

/// The last result, and the publisher that withdraws it.
#[derive(Debug)]
pub(super) struct Results {
    publisher: Publisher,
    newest: Newest,
    /// `None` before the first result and after a withdrawal.
    last: Option<LastResult>,
    /// Age from which a result is out of date, in nanoseconds.
    stale_ns: u64,
}

impl Results {
    pub(super) fn new(publisher: Publisher, stale_ns: u64) -> Self {
        Self { publisher, newest: Newest::default(), last: None, stale_ns }
    }

    /// Whether the scheduler itself has sent a message.
    pub(super) fn is_own(&self, sample: &Sample) -> bool {
        sample.is_from(&self.publisher)
    }

    /// Stores a result of the last stage. Returns whether it is newer than all earlier ones.
    pub(super) fn take(&mut self, header: Header, message: &obstacles::Obstacles) -> bool {
        let is_newer = self.newest.accepts(&header);
        if is_newer {
            self.last = Some(LastResult {
                alarm: message.alarm,
                confirmed: message.obstacles.iter().filter(|o| o.confirmed == 1).count() as u32,
                header,
                at_ns: monotonic_ns(),
            });
        }
        is_newer
    }

    /// The last result, unless it was withdrawn.
    pub(super) fn last(&self) -> Option<&LastResult> {
        self.last.as_ref()
    }

    /// Sends the last withdrawal to new subscribers.
    pub(super) fn refresh(&self) -> Result<(), IpcError> {
        self.publisher.refresh()
    }

    /// Withdraws the last result if a stage is not running (`frames_pass` is false), or if it is older than both
    /// `stale_ns` and three periods of the source. Returns the failed self-check if a result was withdrawn.
    pub(super) fn withdraw_stale(
        &mut self,
        frames_pass: bool,
        period_ns: u64,
        now: u64,
    ) -> Result<Option<Faults>, IpcError> {
        let timeout_ns = self.stale_ns.max(period_ns.saturating_mul(3));
        let Some(last) = self.last else { return Ok(None) };
        if frames_pass && now.saturating_sub(last.at_ns) < timeout_ns {
            return Ok(None);
        }
        self.last = None;
        let faults = Self::faults(frames_pass);
        let changed = u32::from(last.alarm.level != alarm::OFF);
        let off = AlarmRecord { changed, ..AlarmRecord::off(faults) };
        let mut loan = self.publisher.loan(obstacles::payload_bytes(0))?;
        *loan.header_mut() = last.header.forward(Kind::Obstacles);
        loan.header_mut().withdraws = 1;
        if let Err(error) = obstacles::write(loan.payload_mut(), off, &[]) {
            tracing::error!(%error, "the last result could not be withdrawn");
            return Ok(Some(faults));
        }
        tracing::debug!(sequence = last.header.sequence, frames_pass, "the last result is withdrawn");
        self.publisher.send(loan)?;
        Ok(Some(faults))
    }

    /// The self-check that fails without a valid result: a stage is not running, or there is no result.
    pub(super) fn faults(frames_pass: bool) -> Faults {
        if frames_pass { Faults::STALE } else { Faults::STAGE }
    }
}
