//! `status`: scheduler → all readers. The state of the daemon, once a second. New subscribers receive the last one.

use crate::calibration::CalibrationRecord;
use crate::deadline::{DeadlineRecord, PacingRecord};
use crate::device::DeviceRecord;
use crate::header::{Header, Kind, MessageError, get_text, put_text, record};
use crate::heat::HeatRecord;
use crate::motion::{MotionRecord, VehicleRecord};
use crate::realtime::RealtimeRecord;
use crate::rig::RigRecord;
use crate::alarm::Faults;
use crate::alarm_change::AlarmChanges;
use crate::alarm_time::AlarmTimeRecord;
use crate::pipeline::Role;
use crate::source_time::SourceTimeRecord;
use crate::range::{
    ANY_U32, AnyBytes, CLOCK_NS, COUNT, Each, MAX_PID, MAX_RATE_HZ, MS, Nested, ranges, within,
};
use crate::typed::Message;
use super::obstacles::{AlarmRecord, MAX_COUNT as MAX_OBSTACLES};
use bytemuck::{Pod, Zeroable};

/// Number of frames after which a stage must have allocated all its memory.
pub const WARM_FRAMES: u64 = 50;

/// State of one process.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct ProcessRecord {
    /// [`Role`] as a number.
    pub role: u32,
    /// Process id; 0 if it is not running.
    pub pid: u32,
    /// Core that it is pinned to; −1 = none.
    pub core: i32,
    /// Number of restarts since the daemon started.
    pub restarts: u32,
    /// Number of frames finished since the daemon started.
    pub frames: u64,
    /// Number of frames that newer ones overtook before the stage took them, since the daemon started.
    pub skipped: u64,
    /// Number of messages that failed their check, since the daemon started.
    pub refused: u64,
    /// Processor time since the last status, in percent of one core.
    pub cpu_percent: f32,
    /// Frames per second since the last status.
    pub rate_hz: f32,
    /// Median of the work per frame, in milliseconds.
    pub p50_ms: f32,
    /// 99th percentile of the work per frame, in milliseconds.
    pub p99_ms: f32,
    /// Private resident memory, in bytes; 0 if it is not running.
    pub private_bytes: u64,
    /// Resident shared memory, in bytes; 0 if it is not running.
    pub shared_bytes: u64,
    /// Number of heap allocations for frames after the first [`WARM_FRAMES`] of each process; expected to be 0.
    pub allocations: u64,
    /// Real-time privileges of the process.
    pub realtime: RealtimeRecord,
    /// Name of its state, padded with zeros: `waiting to start`, `starting`, `running`, `ending`, `ended`, `given up`.
    pub state: [u8; 24],
}

/// Maximum number of a core.
const MAX_CORE: i32 = 65_535;

/// Maximum processor time of a process, in percent of one core: all of [`MAX_CORE`].
const MAX_CPU_PERCENT: f32 = 100.0 * MAX_CORE as f32;

ranges! {
    ProcessRecord as "status: process" {
        role: within(0, Role::COUNT as u32 - 1),
        pid: within(0, MAX_PID),
        core: within(-1, MAX_CORE),
        restarts: ANY_U32,
        frames: COUNT,
        skipped: COUNT,
        refused: COUNT,
        cpu_percent: within(0.0, MAX_CPU_PERCENT),
        rate_hz: within(0.0, MAX_RATE_HZ as f32),
        p50_ms: MS,
        p99_ms: MS,
        private_bytes: COUNT,
        shared_bytes: COUNT,
        allocations: COUNT,
        realtime: Nested,
        state: AnyBytes,
    }
}

/// State of the daemon.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct StatusRecord {
    /// Process id of the scheduler.
    pub pid: u32,
    /// Number of valid entries of `process`.
    pub processes: u32,
    /// 0 = starting, 1 = running, 2 = degraded (see `reason`), 3 = stopping: an index into [`Self::STATES`].
    pub state: u32,
    /// Number of confirmed obstacles in the last result.
    pub obstacles: u32,
    /// Where the frames come from: 0 = cameras, 1 = recorded pairs, 2 = a synthetic scene: an index into [`Self::SOURCES`].
    pub source: u64,
    /// Time since the daemon started, in ns.
    pub uptime_ns: u64,
    /// Number of results.
    pub frames: u64,
    /// Number of times that the level `alarm` was entered.
    pub alarms: u64,
    /// The alarm of the last result; off if there is no valid result.
    pub alarm: AlarmRecord,
    /// Frames and time in each level of the alarm, and why it was off.
    pub alarm_time: AlarmTimeRecord,
    /// The last changes of the alarm's level.
    pub alarm_changes: AlarmChanges,
    /// Median of the latency from capture to obstacles, in milliseconds; 0 before the first result.
    pub latency_p50_ms: f32,
    /// 99th percentile of the latency, in milliseconds; 0 before the first result.
    pub latency_p99_ms: f32,
    /// Age of the last result, and the number of late ones.
    pub deadline: DeadlineRecord,
    /// Rate of the source; all zeros in lock-step.
    pub pacing: PacingRecord,
    /// Epipolar alignment of the cameras.
    pub calibration: CalibrationRecord,
    /// Temperatures, thermal ladder and clocks of the board.
    pub heat: HeatRecord,
    /// Frame size and rectified rig.
    pub rig: RigRecord,
    /// Device that pairs are matched on; all zeros for the CPU.
    pub device: DeviceRecord,
    /// What was wrong with the time of the source.
    pub source_time: SourceTimeRecord,
    /// The vehicle's own motion in the last result; all zeros, and so unknown, if there is none.
    pub motion: MotionRecord,
    /// What the vehicle reported at the last result; all zeros if that was withdrawn.
    pub vehicle: VehicleRecord,
    /// Reason for the state, padded with zeros; may be empty.
    pub reason: [u8; 192],
    /// One entry per process, in the order of [`Role::ALL`].
    pub process: [ProcessRecord; Role::COUNT],
}

ranges! {
    StatusRecord as "status" {
        pid: within(0, MAX_PID),
        processes: within(0, Role::COUNT as u32),
        state: within(0, Self::STATES.len() as u32 - 1),
        obstacles: within(0, MAX_OBSTACLES as u32),
        source: within(0, Self::SOURCES.len() as u64 - 1),
        uptime_ns: CLOCK_NS,
        frames: COUNT,
        alarms: COUNT,
        alarm: Nested,
        alarm_time: Nested,
        alarm_changes: Nested,
        latency_p50_ms: MS,
        latency_p99_ms: MS,
        deadline: Nested,
        pacing: Nested,
        calibration: Nested,
        heat: Nested,
        rig: Nested,
        device: Nested,
        source_time: Nested,
        motion: Nested,
        vehicle: Nested,
        reason: AnyBytes,
        process: Each(Nested),
    }
}

impl StatusRecord {
    /// Names of the states, indexed by their numbers.
    pub const STATES: [&str; 4] = ["starting", "running", "degraded", "stopping"];

    /// Names of the sources, indexed by their numbers.
    pub const SOURCES: [&str; 3] = ["cameras", "recording", "scene"];

    /// A status without processes; all counts are zero.
    pub fn empty() -> Self {
        Self { heat: HeatRecord::empty(), alarm: AlarmRecord::off(Faults::NONE), ..Self::zeroed() }
    }

    /// Sets the reason for the state, truncated to its field.
    pub fn set_reason(&mut self, text: &str) {
        put_text(&mut self.reason, text);
    }

    /// Reason for the state.
    pub fn reason(&self) -> String {
        get_text(&self.reason)
    }

    /// Name of the source; an unknown number counts as the last.
    pub fn source_name(&self) -> &'static str {
        Self::SOURCES[self.source.min(2) as usize]
    }

    /// Name of the state; an unknown number counts as the last.
    pub fn state_name(&self) -> &'static str {
        Self::STATES[self.state.min(3) as usize]
    }

    /// The valid entries of `process` with their roles.
    pub fn processes(&self) -> impl Iterator<Item = (Role, &ProcessRecord)> {
        let count = (self.processes as usize).min(self.process.len());
        self.process[..count].iter().filter_map(|p| Some((Role::from_raw(u8::try_from(p.role).ok()?)?, p)))
    }
}

impl ProcessRecord {
    /// Name of its state.
    pub fn state(&self) -> String {
        get_text(&self.state)
    }
}

/// Length of the payload in bytes.
pub const PAYLOAD_BYTES: usize = size_of::<StatusRecord>();

/// Checks a message and copies its record.
///
/// # Errors
/// If the header, the length or any field is invalid.
pub fn view(header: &Header, payload: &[u8]) -> Result<StatusRecord, MessageError> {
    header.check(Kind::Status)?;
    record(payload)
}

/// The typed message.
#[derive(Clone, Copy, Debug)]
pub struct StatusMessage;

impl Message for StatusMessage {
    const KIND: Kind = Kind::Status;
    type View<'a> = StatusRecord;

    fn view<'a>(header: &Header, payload: &'a [u8]) -> Result<Self::View<'a>, MessageError> {
        view(header, payload)
    }

    fn max_payload_bytes(_: usize, _: usize) -> usize {
        PAYLOAD_BYTES
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::range::Ranged;

    #[test]
    fn every_number_outside_its_range_is_refused() {
        let header = Header::new(Kind::Status);
        let status = StatusRecord { processes: 5, ..StatusRecord::empty() };
        assert_eq!(view(&header, bytemuck::bytes_of(&status)), Ok(status));
        let all = status.invalid();
        // Also those of the records within.
        for name in ["processes", "alarm", "alarm_time", "deadline", "pacing", "calibration", "heat", "rig", "motion", "process"] {
            assert!(all.iter().any(|(field, _)| *field == name), "{name}");
        }
        for (field, wrong) in all {
            assert!(view(&header, bytemuck::bytes_of(&wrong)).is_err(), "{field}: {wrong:?}");
        }
    }
}
