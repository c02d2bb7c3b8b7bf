//! The daemon's status as JSON: `lookout status --json`, the viewer and recordings.

use crate::alarm_tally::alarm_times;
use crate::frame_record::{alarm_line, alarm_object, motion_line};
use crate::stages::vehicle_record::reading;
use messages::alarm::{level_name, rule_name};
use messages::alarm_change::AlarmChangeRecord;
use messages::device::DeviceRecord;
use messages::heat::HeatRecord;
use messages::motion::VehicleRecord;
use messages::realtime::Privilege;
use messages::status::StatusRecord;
use perception::stereo::device::STAGES;
use serde::{Deserialize, Serialize};
use sources::recording::VehicleLine;
use std::collections::BTreeMap;
use tools::reporting::alarm_times::AlarmTimes;
use tools::reporting::motion::MotionLine;
use tools::reporting::record::{AlarmLine, AlarmObject, tidy, tidy_finite};
use tools::reporting::space::centimetres;

/// The status as JSON.
#[derive(Serialize)]
pub struct StatusJson {
    pid: u32,
    state: &'static str,
    reason: String,
    source: &'static str,
    uptime_s: f64,
    frames: u64,
    latency_p50_ms: f32,
    latency_p99_ms: f32,
    alarm: &'static str,
    alarm_rule: Option<&'static str>,
    alarm_reason: String,
    alarm_object: Option<AlarmObject>,
    alarm_times: AlarmTimes,
    alarm_changes: Vec<AlarmChangeJson>,
    alarms: u64,
    obstacles: u32,
    nearest_m: Option<f64>,
    /// How far a lane of the vehicle's width straight ahead is known to be free; `None` if no ground is.
    free_ahead_m: Option<f64>,
    boundaries: u32,
    deadline: DeadlineJson,
    source_time: SourceTimeJson,
    motion: MotionLine,
    /// `None` if the vehicle reports nothing.
    vehicle: Option<VehicleLine>,
    pacing: PacingJson,
    calibration: CalibrationJson,
    heat: HeatJson,
    /// `None` if stereo matching runs on the CPU.
    device: Option<DeviceJson>,
    processes: Vec<ProcessJson>,
}

/// A change of the alarm's level: what a reader that has not got its frame can know of it.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct AlarmChangeJson {
    /// Number of the frame in its run.
    pub sequence: u64,
    /// Source time in seconds.
    pub time_s: f64,
    /// Whether the frame's result was withdrawn, so that the alarm is off.
    pub withdrawn: bool,
    /// The alarm, as in the frame.
    pub alarm: AlarmLine,
}

impl From<&AlarmChangeRecord> for AlarmChangeJson {
    fn from(change: &AlarmChangeRecord) -> Self {
        Self {
            sequence: change.sequence,
            time_s: tidy(change.source_ns as f64 * 1e-9),
            withdrawn: change.withdrawn == 1,
            alarm: alarm_line(&change.alarm()),
        }
    }
}

#[derive(Serialize)]
struct DeadlineJson {
    deadline_ms: Option<f64>,
    age_ms: f64,
    late: u64,
    late_in_a_row: u64,
}

#[derive(Serialize)]
struct SourceTimeJson {
    gaps: u64,
    steps_back: u64,
    repeats: u64,
    dropped_obstacles: u64,
}

#[derive(Serialize)]
struct PacingJson {
    rate_hz: Option<f64>,
    wanted_hz: f64,
    follows: bool,
    slowest: Option<&'static str>,
    slowest_ms: f64,
}

#[derive(Serialize)]
struct CalibrationJson {
    state: &'static str,
    cause: &'static str,
    text: String,
    remedy: &'static str,
    offset_px: f32,
    across_px: f32,
    down_px: f32,
    typical_px: f32,
    total_px: f32,
    sigma_px: f32,
    lost: f32,
    lost_max: f32,
    distance_error: f32,
    corrected_px: f32,
    moved_px: f32,
    moved: bool,
}

#[derive(Serialize)]
struct DeviceJson {
    adapter: String,
    driver: String,
    lost: bool,
    text: String,
    /// Time of each GPU stage in the last frame; empty if the device has no timestamps.
    stages_ms: BTreeMap<&'static str, f32>,
}

impl DeviceJson {
    fn new(device: &DeviceRecord) -> Option<Self> {
        (device.state != 0).then(|| Self {
            adapter: device.adapter(),
            driver: device.driver(),
            lost: device.is_lost(),
            text: device.describe(),
            stages_ms: STAGES.into_iter().zip(device.times_ms().iter().copied()).collect(),
        })
    }
}

#[derive(Serialize)]
struct ProcessJson {
    role: &'static str,
    state: String,
    pid: u32,
    core: Option<u32>,
    restarts: u32,
    frames: u64,
    skipped: u64,
    refused: u64,
    rate_hz: f32,
    p50_ms: f32,
    p99_ms: f32,
    cpu_percent: f32,
    private_bytes: u64,
    shared_bytes: u64,
    allocations: u64,
    priority: u32,
    memory_locked: bool,
    prefaulted: bool,
    privileges_refused: Vec<&'static str>,
    log_dropped: u64,
}

impl StatusJson {
    /// Converts a status message.
    pub fn new(status: &StatusRecord) -> Self {
        Self {
            pid: status.pid,
            state: status.state_name(),
            reason: status.reason(),
            source: status.source_name(),
            uptime_s: status.uptime_ns as f64 * 1e-9,
            frames: status.frames,
            latency_p50_ms: status.latency_p50_ms,
            latency_p99_ms: status.latency_p99_ms,
            alarm: level_name(status.alarm.level),
            alarm_rule: rule_name(status.alarm.rule),
            alarm_reason: status.alarm.reason(),
            alarm_object: alarm_object(&status.alarm),
            alarm_times: alarm_times(&status.alarm_time),
            alarm_changes: status.alarm_changes.iter().map(|(_, change)| change.into()).collect(),
            alarms: status.alarms,
            obstacles: status.obstacles,
            nearest_m: tidy_finite(status.alarm.nearest_m),
            free_ahead_m: status.alarm.space.free_ahead_m(status.alarm.path_half_width_m).map(centimetres),
            boundaries: status.alarm.space.boundaries,
            deadline: DeadlineJson {
                deadline_ms: (status.deadline.deadline_ns > 0)
                    .then_some(status.deadline.deadline_ns as f64 * 1e-6),
                age_ms: status.deadline.age_ns as f64 * 1e-6,
                late: status.deadline.late,
                late_in_a_row: status.deadline.late_in_a_row,
            },
            source_time: SourceTimeJson {
                gaps: status.source_time.gaps,
                steps_back: status.source_time.steps_back,
                repeats: status.source_time.repeats,
                dropped_obstacles: status.source_time.dropped_obstacles,
            },
            motion: motion_line(&status.motion),
            vehicle: (status.vehicle != VehicleRecord::default()).then(|| reading(&status.vehicle).into()),
            pacing: PacingJson {
                rate_hz: (status.pacing.rate_hz > 0.0).then_some(status.pacing.rate_hz),
                wanted_hz: status.pacing.wanted_hz,
                follows: status.pacing.follows == 1,
                slowest: (status.pacing.slowest_ms > 0.0).then(|| status.pacing.slowest_name()),
                slowest_ms: status.pacing.slowest_ms,
            },
            calibration: CalibrationJson {
                state: status.calibration.state().name(),
                cause: status.calibration.cause().name(),
                text: status.calibration.to_string(),
                remedy: status.calibration.remedy(),
                offset_px: status.calibration.offset_px,
                across_px: status.calibration.across_px,
                down_px: status.calibration.down_px,
                typical_px: status.calibration.typical_px,
                total_px: status.calibration.total_px,
                sigma_px: status.calibration.sigma_px,
                lost: status.calibration.lost,
                lost_max: status.calibration.lost_max,
                distance_error: status.calibration.distance_error,
                corrected_px: status.calibration.corrected_px,
                moved_px: status.calibration.moved_px,
                moved: status.calibration.has_moved(),
            },
            heat: HeatJson::new(&status.heat),
            device: DeviceJson::new(&status.device),
            processes: status
                .processes()
                .map(|(role, p)| ProcessJson {
                    role: role.name(),
                    state: p.state(),
                    pid: p.pid,
                    core: u32::try_from(p.core).ok(),
                    restarts: p.restarts,
                    frames: p.frames,
                    skipped: p.skipped,
                    refused: p.refused,
                    rate_hz: p.rate_hz,
                    p50_ms: p.p50_ms,
                    p99_ms: p.p99_ms,
                    cpu_percent: p.cpu_percent,
                    private_bytes: p.private_bytes,
                    shared_bytes: p.shared_bytes,
                    allocations: p.allocations,
                    priority: p.realtime.priority,
                    memory_locked: p.realtime.has(Privilege::MemoryLock),
                    prefaulted: p.realtime.has(Privilege::Prefault),
                    privileges_refused: p.realtime.refusals().collect(),
                    log_dropped: p.realtime.log_dropped,
                })
                .collect(),
        }
    }
}

/// Temperatures, the rung of the thermal ladder, and clocks.
#[derive(Serialize)]
pub struct HeatJson {
    watched: bool,
    rung: &'static str,
    reason: String,
    frame_rate_share: f32,
    clocks_share: f32,
    zones: Vec<ZoneJson>,
    clocks: Vec<ClockJson>,
}

#[derive(Serialize)]
struct ZoneJson {
    name: String,
    celsius: f32,
    projected: bool,
}

#[derive(Serialize)]
struct ClockJson {
    name: String,
    wanted_mhz: f32,
    read_mhz: Option<f32>,
}

impl HeatJson {
    /// Converts the heat part of a status message.
    pub fn new(heat: &HeatRecord) -> Self {
        let zone = |z: &messages::heat::ZoneRecord| ZoneJson {
            name: z.name(),
            celsius: z.celsius,
            projected: z.projected == 1,
        };
        let clock = |c: &messages::heat::ClockRecord| ClockJson {
            name: c.name(),
            wanted_mhz: c.wanted_mhz,
            read_mhz: (c.read_mhz > 0.0).then_some(c.read_mhz),
        };
        Self {
            watched: heat.watched == 1,
            rung: heat.rung_name(),
            reason: heat.reason(),
            frame_rate_share: heat.frame_rate_share,
            clocks_share: heat.clocks_share,
            zones: heat.zones().iter().map(zone).collect(),
            clocks: heat.clocks().iter().map(clock).collect(),
        }
    }
}
