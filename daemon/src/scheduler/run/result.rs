//! The last result, and taking it back when it does not hold any more.
//!
//! A message on `obstacles` stays readable after the stage that sent it has died, and for whoever comes
//! late. So the scheduler has a place of its own on that service: when a stage that frames pass is away,
//! or results have stopped, it sends one message that says "off", has no obstacles, and withdraws what
//! was said before. The first result after that speaks for itself.

use messages::alarm::{self, Faults};
use messages::bus::IpcError;
use messages::clock::monotonic_ns;
use messages::header::{Header, Kind};
use messages::obstacles::{self, AlarmRecord, Newest};
use messages::port::{Publisher, Sample};

/// What the last result said.
#[derive(Clone, Copy, Debug)]
pub(super) struct LastResult {
    pub(super) alarm: AlarmRecord,
    pub(super) confirmed: u32,
    header: Header,
    at_ns: u64,
}

/// See the module.
#[derive(Debug)]
pub(super) struct Results {
    publisher: Publisher,
    newest: Newest,
    /// `None` once it does not hold any more.
    last: Option<LastResult>,
    /// A result says nothing about the road this long after it came.
    stale_ns: u64,
}

impl Results {
    pub(super) fn new(publisher: Publisher, stale_ns: u64) -> Self {
        Self { publisher, newest: Newest::default(), last: None, stale_ns }
    }

    /// Whether a message is one of the scheduler's own.
    pub(super) fn is_own(&self, sample: &Sample) -> bool {
        sample.is_from(&self.publisher)
    }

    /// Takes in a result of the last stage. Gives whether it is newer than all before.
    pub(super) fn take(&mut self, header: Header, message: &obstacles::Obstacles<'_>) -> bool {
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

    /// What holds now, if anything does.
    pub(super) fn last(&self) -> Option<&LastResult> {
        self.last.as_ref()
    }

    /// Late comers are told, too.
    pub(super) fn refresh(&self) -> Result<(), IpcError> {
        self.publisher.refresh()
    }

    /// Takes the last result back when frames do not pass, or none has come for long: for `stale_ns`, and
    /// three periods of a slow source. Gives why, when there was something to take back.
    pub(super) fn withdraw_stale(
        &mut self,
        frames_pass: bool,
        period_ns: u64,
        now: u64,
    ) -> Result<Option<Faults>, IpcError> {
        let patience_ns = self.stale_ns.max(period_ns.saturating_mul(3));
        let Some(last) = self.last else { return Ok(None) };
        if frames_pass && now.saturating_sub(last.at_ns) < patience_ns {
            return Ok(None);
        }
        self.last = None;
        let faults = Self::faults(frames_pass);
        let off = AlarmRecord {
            level: alarm::OFF,
            faults: faults.0,
            changed: u32::from(last.alarm.level != alarm::OFF),
            nearest_m: f64::INFINITY,
            time_to_collision_s: f64::INFINITY,
            ..AlarmRecord::default()
        };
        let mut loan = self.publisher.loan(obstacles::payload_bytes(0))?;
        *loan.header_mut() = last.header.forward(Kind::Obstacles);
        loan.header_mut().withdraws = 1;
        // The payload is as long as that needs.
        if let Err(error) = obstacles::write(loan.payload_mut(), off, &[]) {
            tracing::error!(%error, "the alarm could not be taken back");
            return Ok(Some(faults));
        }
        tracing::debug!(sequence = last.header.sequence, frames_pass, "the last result is taken back");
        self.publisher.send(loan)?;
        Ok(Some(faults))
    }

    /// Why nothing holds: a stage is away, or no result has come.
    pub(super) fn faults(frames_pass: bool) -> Faults {
        if frames_pass { Faults::STALE } else { Faults::STAGE }
    }
}
