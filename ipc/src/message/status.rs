//! `status`: scheduler → anyone. How the daemon is doing, once a second and for late comers.

use crate::calibration::CalibrationRecord;
use crate::deadline::{DeadlineRecord, PacingRecord};
use crate::device::DeviceRecord;
use crate::header::{Header, Kind, MessageError, get_text, put_text, record};
use crate::heat::HeatRecord;
use crate::realtime::RealtimeRecord;
use crate::rig::RigRecord;
use crate::pipeline::Role;
use crate::typed::Message;
use bytemuck::{Pod, Zeroable};

/// Frames after which a stage has all the memory that it needs.
pub const WARM_FRAMES: u64 = 50;

/// One process.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct ProcessRecord {
    /// [`Role`] as a number.
    pub role: u32,
    /// Process id; 0 when it is not running.
    pub pid: u32,
    /// Core that it is pinned to, or −1.
    pub core: i32,
    /// How often it was restarted.
    pub restarts: u32,
    /// Frames finished, since the daemon started.
    pub frames: u64,
    /// Frames overtaken by newer ones, since the daemon started.
    pub skipped: u64,
    /// Messages refused, since the daemon started.
    pub refused: u64,
    /// Share of one core, in percent, over the last second.
    pub cpu_percent: f32,
    /// Frames per second over the last second.
    pub rate_hz: f32,
    /// Median time per frame, in milliseconds.
    pub p50_ms: f32,
    /// 99th percentile of that.
    pub p99_ms: f32,
    /// Resident memory of its own, in bytes.
    pub private_bytes: u64,
    /// Resident shared memory, in bytes.
    pub shared_bytes: u64,
    /// Heap allocations for frames after the first [`WARM_FRAMES`] of each process; 0 is as it should be.
    pub allocations: u64,
    /// What it got of what real time needs.
    pub realtime: RealtimeRecord,
    /// In words: running, starting, waiting to restart, given up.
    pub state: [u8; 24],
}

/// The daemon.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct StatusRecord {
    /// Process id of the scheduler.
    pub pid: u32,
    /// Processes that follow.
    pub processes: u32,
    /// 0 = starting, 1 = running, 2 = degraded (the reason says why), 3 = stopping.
    pub state: u32,
    /// Alarm level of the last frame: [`crate::alarm::LEVELS`].
    pub alarm: u32,
    /// The rule that raised it: [`crate::alarm::RULES`].
    pub alarm_rule: u32,
    /// Why it is off: [`crate::alarm::Faults`].
    pub alarm_faults: u32,
    /// Alarms that were raised so far.
    pub alarms: u32,
    /// Obstacles confirmed in the last frame.
    pub obstacles: u32,
    /// Nanoseconds since the daemon started.
    pub uptime_ns: u64,
    /// Frames that came out at the end.
    pub frames: u64,
    /// Nearest obstacle in the path, in metres; infinite when there is none.
    pub nearest_m: f64,
    /// Capture to obstacles: median, in milliseconds.
    pub latency_p50_ms: f32,
    /// 99th percentile of that.
    pub latency_p99_ms: f32,
    /// Whether results come in time.
    pub deadline: DeadlineRecord,
    /// How fast the source runs.
    pub pacing: PacingRecord,
    /// Whether the cameras still stand as they were calibrated.
    pub calibration: CalibrationRecord,
    /// How hot the board is, and how fast its clocks run.
    pub heat: HeatRecord,
    /// What the frames are, and what turns their disparities into metres.
    pub rig: RigRecord,
    /// The device that matches; zeros where the CPU does.
    pub device: DeviceRecord,
    /// Why the daemon is in its state, in words.
    pub reason: [u8; 192],
    /// One entry per process, in the order of [`Role::ALL`].
    pub process: [ProcessRecord; Role::COUNT],
}

impl StatusRecord {
    /// Names of the states, by their numbers.
    pub const STATES: [&str; 4] = ["starting", "running", "degraded", "stopping"];

    /// A status without processes; all else zero.
    pub fn empty() -> Self {
        Self { heat: HeatRecord::empty(), ..Self::zeroed() }
    }

    /// Sets the words for the state.
    pub fn set_reason(&mut self, text: &str) {
        put_text(&mut self.reason, text);
    }

    /// The words for the state.
    pub fn reason(&self) -> String {
        get_text(&self.reason)
    }

    /// The word for the state.
    pub fn state_name(&self) -> &'static str {
        Self::STATES[self.state.min(3) as usize]
    }

    /// The processes with their roles.
    pub fn processes(&self) -> impl Iterator<Item = (Role, &ProcessRecord)> {
        let count = (self.processes as usize).min(self.process.len());
        self.process[..count].iter().filter_map(|p| Some((Role::from_raw(u8::try_from(p.role).ok()?)?, p)))
    }
}

impl ProcessRecord {
    /// The word for its state.
    pub fn state(&self) -> String {
        get_text(&self.state)
    }
}

/// Bytes of the payload.
pub const PAYLOAD_BYTES: usize = size_of::<StatusRecord>();

/// Checks a message and copies its record.
///
/// # Errors
/// When the header or the length is wrong.
pub fn view(header: &Header, payload: &[u8]) -> Result<StatusRecord, MessageError> {
    header.check(Kind::Status)?;
    record(payload)
}

/// The message in types.
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
