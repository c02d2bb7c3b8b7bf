//! `status`: scheduler → all readers. The state of the daemon, once a second. New subscribers receive the last one.

use crate::calibration::CalibrationRecord;
use crate::deadline::{DeadlineRecord, PacingRecord};
use crate::device::DeviceRecord;
use crate::header::{Header, Kind, MessageError, get_text, put_text, record};
use crate::heat::HeatRecord;
use crate::realtime::RealtimeRecord;
use crate::rig::RigRecord;
use crate::pipeline::Role;
use crate::source_time::SourceTimeRecord;
use crate::typed::Message;
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
    /// Alarm level of the last result: an index into [`crate::alarm::LEVELS`]; 0 = off if there is no valid result.
    pub alarm: u32,
    /// The rule that raised it: an index into [`crate::alarm::RULES`]; 0 = none.
    pub alarm_rule: u32,
    /// Self-checks that failed: bits of [`crate::alarm::Faults`]; not 0 while the alarm is off.
    pub alarm_faults: u32,
    /// Number of times that the level `alarm` was entered.
    pub alarms: u32,
    /// Number of confirmed obstacles in the last result.
    pub obstacles: u32,
    /// Time since the daemon started, in ns.
    pub uptime_ns: u64,
    /// Number of results.
    pub frames: u64,
    /// Distance of the nearest obstacle in the path, in metres; infinite if there is none.
    pub nearest_m: f64,
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
    /// Reason for the state, padded with zeros; may be empty.
    pub reason: [u8; 192],
    /// One entry per process, in the order of [`Role::ALL`].
    pub process: [ProcessRecord; Role::COUNT],
}

impl StatusRecord {
    /// Names of the states, indexed by their numbers.
    pub const STATES: [&str; 4] = ["starting", "running", "degraded", "stopping"];

    /// A status without processes; all counts are zero.
    pub fn empty() -> Self {
        Self { heat: HeatRecord::empty(), ..Self::zeroed() }
    }

    /// Sets the reason for the state, truncated to its field.
    pub fn set_reason(&mut self, text: &str) {
        put_text(&mut self.reason, text);
    }

    /// Reason for the state.
    pub fn reason(&self) -> String {
        get_text(&self.reason)
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
/// If the header or the length is invalid.
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
