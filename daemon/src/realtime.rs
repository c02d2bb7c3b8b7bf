//! What a process asks of the system before frames flow: a core, a priority, memory that stays.
//!
//! Each can be required, preferred or left alone (`[realtime]`). What is required and refused stops the
//! process with a reason; what is preferred and refused is logged, and shown in the status.

use config::Config;
use messages::bus::{Bus, IpcError};
use messages::pipeline::Role;
use messages::privilege;
use messages::realtime::{Privilege, RealtimeRecord};
use std::fmt::Display;
use std::io;
use thiserror::Error;

/// Something required was refused.
#[derive(Debug, Error)]
#[error("realtime.{key} is \"require\", but it was refused: {reason}: {remedy}, or set it to \"prefer\"", key = privilege.name())]
pub struct Refused {
    privilege: Privilege,
    reason: String,
    remedy: &'static str,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Wish {
    Off,
    Prefer,
    Require,
}

impl Wish {
    /// The word is one of a few: that was checked when the configuration was read.
    fn of(word: &str) -> Self {
        match word {
            "require" => Self::Require,
            "prefer" => Self::Prefer,
            _ => Self::Off,
        }
    }

    /// Notes what came of an attempt; a refusal of what is required is an error.
    fn note<E: Display>(
        self,
        privilege: Privilege,
        remedy: &'static str,
        result: Result<(), E>,
        record: &mut RealtimeRecord,
    ) -> Result<(), Refused> {
        match (result, self) {
            (Ok(()), _) => record.grant(privilege),
            (Err(reason), Self::Require) => {
                return Err(Refused { privilege, reason: reason.to_string(), remedy });
            }
            (Err(reason), _) => {
                record.refuse(privilege);
                tracing::warn!(%reason, "realtime.{} was refused, goes on without: {remedy}", privilege.name());
            }
        }
        Ok(())
    }
}

/// Asks for what the configuration wishes for this process, in its only thread so far that matters:
/// threads that it starts later share time as usual.
///
/// # Errors
/// When something is required and refused.
pub fn enter(config: &Config, role: Role, core: Option<usize>) -> Result<RealtimeRecord, Refused> {
    let c = &config.realtime;
    let mut record = RealtimeRecord::default();
    if let Some(core) = core {
        let result = match core_affinity::set_for_current(core_affinity::CoreId { id: core }) {
            true => Ok(()),
            false => Err(format!("core {core} cannot be had")),
        };
        let remedy = "give another core in [cores], or widen the set of cores of the service";
        Wish::of(&c.pinning).note(Privilege::Pinning, remedy, result, &mut record)?;
    }
    let lock = Wish::of(&c.memory_lock);
    if lock != Wish::Off {
        let remedy = "give the service CAP_IPC_LOCK or LimitMEMLOCK=infinity";
        lock.note(Privilege::MemoryLock, remedy, privilege::lock_memory(), &mut record)?;
    }
    let scheduling = Wish::of(&c.scheduling);
    if let (true, Some(priority)) = (scheduling != Wish::Off, priority(config, role)) {
        let remedy = "give the service CAP_SYS_NICE or LimitRTPRIO=55";
        let result = fifo(priority, c.budget_ms.unsigned_abs());
        scheduling.note(Privilege::Scheduling, remedy, result, &mut record)?;
    }
    privilege::prefault_stack();
    record.priority = privilege::fifo_priority();
    Ok(record)
}

/// The limit comes first: there is no moment in which a process may spin for ever.
fn fifo(priority: u32, budget_ms: u64) -> io::Result<()> {
    if budget_ms > 0 {
        privilege::limit_realtime(budget_ms * 1000)?;
    }
    privilege::set_fifo(priority)
}

/// Makes the message pools of this run real, if that is wished for.
///
/// # Errors
/// When it is required, and /dev/shm is full.
pub fn reserve(config: &Config, bus: &Bus, record: &mut RealtimeRecord) -> Result<(), Refused> {
    let wish = Wish::of(&config.realtime.prefault);
    if wish == Wish::Off {
        return Ok(());
    }
    let result: Result<(), IpcError> =
        bus.reserve().map(|bytes| tracing::debug!(bytes, "shared memory reserved"));
    let remedy = "enlarge /dev/shm (mount -o remount,size=…)";
    wish.note(Privilege::Prefault, remedy, result, record)
}

/// The priority of a role; `None` for what must never be in the way.
fn priority(config: &Config, role: Role) -> Option<u32> {
    let c = &config.realtime;
    let priority = match role {
        Role::Scheduler => c.priority_scheduler,
        Role::Capture => c.priority_capture,
        Role::Stereo => c.priority_stereo,
        Role::Road => c.priority_road,
        Role::Recognition => c.priority_recognition,
        Role::Writer => return None,
    };
    u32::try_from(priority).ok()
}

/// The lowest priority that a stage of frames asks for; `None` where time is shared.
pub fn lowest_priority(config: &Config) -> Option<u32> {
    let asked = Wish::of(&config.realtime.scheduling) != Wish::Off;
    Role::STAGES.into_iter().filter_map(|role| priority(config, role)).min().filter(|_| asked)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn required_and_refused_stops_preferred_and_refused_is_noted() {
        let mut record = RealtimeRecord::default();
        let refused = || Err("Operation not permitted");
        let error =
            Wish::Require.note(Privilege::Scheduling, "ask root", refused(), &mut record).unwrap_err();
        assert_eq!(
            error.to_string(),
            "realtime.scheduling is \"require\", but it was refused: Operation not permitted: ask root, \
             or set it to \"prefer\""
        );
        Wish::Prefer.note(Privilege::MemoryLock, "", refused(), &mut record).unwrap();
        Wish::Prefer.note(Privilege::Prefault, "", Ok::<(), &str>(()), &mut record).unwrap();
        assert_eq!(record.to_string(), "shared time, prefaulted; refused: memory_lock");
    }

    #[test]
    fn the_writer_has_no_priority_and_later_stages_come_first() {
        let config = config::load(None).unwrap();
        assert_eq!(priority(&config, Role::Writer), None);
        let of = |role| priority(&config, role).unwrap();
        assert!(of(Role::Scheduler) > of(Role::Capture));
        assert!(of(Role::Recognition) > of(Role::Road) && of(Role::Road) > of(Role::Stereo));
        for role in [Role::Scheduler, Role::Capture, Role::Stereo, Role::Road, Role::Recognition] {
            assert!(privilege::PRIORITIES.contains(&of(role)), "{role}");
        }
    }
}
