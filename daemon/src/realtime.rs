//! Real-time privileges that a process requests before the first frame: a core, a priority, locked memory, prefaulted
//! shared memory.
//!
//! Each key of `[realtime]` is `require`, `prefer` or `off`. If a required privilege is refused, the process ends with
//! an error. If a preferred one is refused, that is logged and shown in the status.

use config::Config;
use messages::bus::{Bus, IpcError};
use messages::pipeline::Role;
use messages::privilege;
use messages::realtime::{Privilege, RealtimeRecord};
use std::fmt::Display;
use std::io;
use thiserror::Error;

/// A required privilege was refused.
#[derive(Debug, Error)]
#[error("realtime.{key} is \"require\", but it was refused: {reason}: {remedy}, or set it to \"prefer\"", key = privilege.name())]
pub struct Refused {
    privilege: Privilege,
    reason: String,
    remedy: &'static str,
}

/// Value of a key of `[realtime]`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Request {
    Off,
    Prefer,
    Require,
}

impl Request {
    /// The value of a key; the configuration has checked it.
    fn of(value: &str) -> Self {
        match value {
            "require" => Self::Require,
            "prefer" => Self::Prefer,
            _ => Self::Off,
        }
    }

    /// Records the result of a request. The refusal of a required privilege is an error.
    fn record<E: Display>(
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
                tracing::warn!(%reason, "realtime.{} was refused, continuing without it: {remedy}", privilege.name());
            }
        }
        Ok(())
    }
}

/// Requests the configured privileges for the calling thread, except prefaulting ([`reserve`]). Threads that it starts
/// later do not inherit the priority.
///
/// # Errors
/// If a required privilege is refused.
pub fn enter(config: &Config, role: Role, core: Option<usize>) -> Result<RealtimeRecord, Refused> {
    let c = &config.realtime;
    let mut record = RealtimeRecord::default();
    if let Some(core) = core {
        let result = match core_affinity::set_for_current(core_affinity::CoreId { id: core }) {
            true => Ok(()),
            false => Err(format!("core {core} is not available")),
        };
        let remedy = "give another core in [cores], or allow the service more cores";
        Request::of(&c.pinning).record(Privilege::Pinning, remedy, result, &mut record)?;
    }
    let lock = Request::of(&c.memory_lock);
    if lock != Request::Off {
        let remedy = "give the service CAP_IPC_LOCK or LimitMEMLOCK=infinity";
        lock.record(Privilege::MemoryLock, remedy, privilege::lock_memory(), &mut record)?;
    }
    let scheduling = Request::of(&c.scheduling);
    if let (true, Some(priority)) = (scheduling != Request::Off, priority(config, role)) {
        let remedy = "give the service CAP_SYS_NICE or LimitRTPRIO=55";
        let result = fifo(priority, c.budget_ms.unsigned_abs());
        scheduling.record(Privilege::Scheduling, remedy, result, &mut record)?;
    }
    privilege::prefault_stack();
    record.priority = privilege::fifo_priority();
    Ok(record)
}

/// Requests the configured core and priority for another thread of a process that has [entered](enter). A refusal is
/// logged: the work is then slower, but the same.
pub fn enter_thread(config: &Config, role: Role, core: Option<usize>) {
    if let Some(core) = core
        && !core_affinity::set_for_current(core_affinity::CoreId { id: core })
    {
        tracing::warn!(core, "a thread of {role} could not be pinned to its core");
    }
    let scheduling = Request::of(&config.realtime.scheduling);
    if let (true, Some(priority)) = (scheduling != Request::Off, priority(config, role))
        && let Err(reason) = privilege::set_fifo(priority)
    {
        // The refusal for the process itself has been reported.
        tracing::debug!(%reason, "a thread of {role} has no real-time priority");
    }
    privilege::prefault_stack();
}

/// Sets the limit of processor time before the priority, so that a real-time process can never spin without limit.
fn fifo(priority: u32, budget_ms: u64) -> io::Result<()> {
    if budget_ms > 0 {
        privilege::limit_realtime(budget_ms * 1000)?;
    }
    privilege::set_fifo(priority)
}

/// Prefaults the message pools of this run, if that is configured.
///
/// # Errors
/// If it is required, and /dev/shm is full.
pub fn reserve(config: &Config, bus: &Bus, record: &mut RealtimeRecord) -> Result<(), Refused> {
    let request = Request::of(&config.realtime.prefault);
    if request == Request::Off {
        return Ok(());
    }
    let result: Result<(), IpcError> =
        bus.reserve().map(|bytes| tracing::debug!(bytes, "shared memory reserved"));
    let remedy = "enlarge /dev/shm (mount -o remount,size=…)";
    request.record(Privilege::Prefault, remedy, result, record)
}

/// SCHED_FIFO priority of a role; `None` for a role that never has one.
fn priority(config: &Config, role: Role) -> Option<u32> {
    config.realtime.priority(role).and_then(|priority| u32::try_from(priority).ok())
}

/// The lowest configured priority of the stages; `None` if no real-time priorities are requested.
pub fn lowest_priority(config: &Config) -> Option<u32> {
    let requested = Request::of(&config.realtime.scheduling) != Request::Off;
    Role::STAGES.into_iter().filter_map(|role| priority(config, role)).min().filter(|_| requested)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_required_refusal_is_an_error_and_a_preferred_one_is_recorded() {
        let mut record = RealtimeRecord::default();
        let refused = || Err("Operation not permitted");
        let error =
            Request::Require.record(Privilege::Scheduling, "ask root", refused(), &mut record).unwrap_err();
        assert_eq!(
            error.to_string(),
            "realtime.scheduling is \"require\", but it was refused: Operation not permitted: ask root, \
             or set it to \"prefer\""
        );
        Request::Prefer.record(Privilege::MemoryLock, "", refused(), &mut record).unwrap();
        Request::Prefer.record(Privilege::Prefault, "", Ok::<(), &str>(()), &mut record).unwrap();
        assert_eq!(record.to_string(), "shared time, prefaulted; refused: memory_lock");
    }

    #[test]
    fn the_writer_has_no_priority_and_later_stages_have_higher_ones() {
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
