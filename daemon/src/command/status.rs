//! `lookout status`.

use super::dashboard::Dashboard;
use super::status_heat::HeatJson;
use super::{CommandError, load, say};
use crate::cli::Status;
use messages::alarm::{Faults, level_name, rule_name};
use messages::bus::Bus;
use messages::calibration::CalibrationState;
use messages::device::DeviceRecord;
use messages::instance::{Instance, InstanceError};
use messages::pipeline::Role;
use messages::realtime::Privilege;
use messages::service;
use messages::status::{self, StatusRecord};
use messages::wait::{self, Next};
use perception::stereo::device::STAGES;
use serde::Serialize;
use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};
use std::collections::BTreeMap;
use std::fmt::Write;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// How long a daemon may take to answer.
const PATIENCE: Duration = Duration::from_secs(5);

pub fn run(args: &Status, log: Option<&str>) -> Result<(), CommandError> {
    let config = load(&args.config, log, "status", Some("error"))?;
    let instance = Instance::find(&config.instance.name, &config.instance.directory);
    let absent = || CommandError::from(InstanceError::NotRunning(instance.name().to_owned()));
    let (owner, user) = (instance.owner(), rustix::process::geteuid().as_raw());
    if let Some(owner) = owner.filter(|&owner| owner != user) {
        return Err(CommandError::Other(format!(
            "the daemon \"{}\" belongs to user {owner}, this is user {user}: shared memory is its own; \
             try: sudo -u '#{owner}' lookout status",
            instance.name()
        )));
    }
    if !instance.is_running() {
        return Err(absent());
    }
    // Leaves properly, so that nothing of it stays in the daemon's shared memory.
    let stop = Arc::new(AtomicBool::new(false));
    for signal in [SIGINT, SIGTERM, SIGHUP] {
        signal_hook::flag::register(signal, Arc::clone(&stop))
            .map_err(|e| CommandError::Other(format!("cannot catch signals: {e}")))?;
    }
    let bus = Bus::join(&instance)?;
    let statuses = bus.subscriber(&service::STATUS)?;
    let mut heard = Instant::now();
    let mut dashboard = (args.watch && !args.json).then(|| Dashboard::open(instance.name()));
    let (mut shown, mut ended) = (false, false);
    wait::run::<CommandError>(&[&statuses], || {
        while let Some(sample) = statuses.receive()? {
            let Ok(status) = status::view(sample.header(), sample.payload()) else { continue };
            heard = Instant::now();
            match (&mut dashboard, args.json, args.watch) {
                (Some(dashboard), ..) => dashboard.show(&status)?,
                (None, true, true) => say(serde_json::to_string(&StatusJson::new(&status))?)?,
                (None, true, false) => say(serde_json::to_string_pretty(&StatusJson::new(&status))?)?,
                (None, false, _) => say(table(instance.name(), &status))?,
            }
            shown = true;
            if !args.watch {
                return Ok(Next::Stop);
            }
        }
        if stop.load(Ordering::Relaxed) {
            return Ok(Next::Stop);
        }
        if heard.elapsed() > PATIENCE || (shown && !instance.is_running()) {
            ended = true;
            return Ok(Next::Stop);
        }
        Ok(Next::Wait(Duration::from_millis(200)))
    })?;
    // Gives the terminal back.
    drop(dashboard);
    match (shown, ended) {
        (true, true) => {
            eprintln!("lookout: the daemon has ended");
            Ok(())
        }
        (true, false) => Ok(()),
        (false, _) => Err(absent()),
    }
}

/// The status as programs read it.
#[derive(Serialize)]
pub struct StatusJson {
    pid: u32,
    state: &'static str,
    reason: String,
    uptime_s: f64,
    frames: u64,
    latency_p50_ms: f32,
    latency_p99_ms: f32,
    alarm: &'static str,
    alarm_rule: Option<&'static str>,
    alarm_reason: Option<String>,
    alarms: u32,
    obstacles: u32,
    nearest_m: Option<f64>,
    deadline: DeadlineJson,
    pacing: PacingJson,
    calibration: CalibrationJson,
    heat: HeatJson,
    /// None where the CPU matches.
    device: Option<DeviceJson>,
    processes: Vec<ProcessJson>,
}

#[derive(Serialize)]
struct DeadlineJson {
    deadline_ms: Option<f64>,
    age_ms: f64,
    late: u64,
    late_in_a_row: u64,
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
    text: String,
    offset_px: f32,
    across_px: f32,
    down_px: f32,
    worst_px: f32,
    sigma_px: f32,
    bound_px: f32,
    corrected_px: f32,
}

#[derive(Serialize)]
struct DeviceJson {
    adapter: String,
    driver: String,
    lost: bool,
    text: String,
    /// Time of each stage of the last frame on the device; empty where it has no timestamps.
    stages_ms: BTreeMap<&'static str, f32>,
}

impl DeviceJson {
    fn new(device: &DeviceRecord) -> Option<Self> {
        (device.state != 0).then(|| Self {
            adapter: device.adapter(),
            driver: device.driver(),
            lost: device.is_lost(),
            text: device.words(),
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
    /// That of a message.
    pub fn new(status: &StatusRecord) -> Self {
        Self {
            pid: status.pid,
            state: status.state_name(),
            reason: status.reason(),
            uptime_s: status.uptime_ns as f64 * 1e-9,
            frames: status.frames,
            latency_p50_ms: status.latency_p50_ms,
            latency_p99_ms: status.latency_p99_ms,
            alarm: level_name(status.alarm),
            alarm_rule: rule_name(status.alarm_rule),
            alarm_reason: (status.alarm == messages::alarm::OFF)
                .then(|| Faults(status.alarm_faults).to_string()),
            alarms: status.alarms,
            obstacles: status.obstacles,
            nearest_m: status.nearest_m.is_finite().then_some(status.nearest_m),
            deadline: DeadlineJson {
                deadline_ms: (status.deadline.deadline_ns > 0)
                    .then_some(status.deadline.deadline_ns as f64 * 1e-6),
                age_ms: status.deadline.age_ns as f64 * 1e-6,
                late: status.deadline.late,
                late_in_a_row: status.deadline.late_in_a_row,
            },
            pacing: PacingJson {
                rate_hz: (status.pacing.rate_hz > 0.0).then_some(status.pacing.rate_hz),
                wanted_hz: status.pacing.wanted_hz,
                follows: status.pacing.follows == 1,
                slowest: (status.pacing.slowest_ms > 0.0).then(|| slowest(status)),
                slowest_ms: status.pacing.slowest_ms,
            },
            calibration: CalibrationJson {
                state: status.calibration.state().name(),
                text: status.calibration.to_string(),
                offset_px: status.calibration.offset_px,
                across_px: status.calibration.across_px,
                down_px: status.calibration.down_px,
                worst_px: status.calibration.worst_px,
                sigma_px: status.calibration.sigma_px,
                bound_px: status.calibration.bound_px,
                corrected_px: status.calibration.corrected_px,
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

/// The alarm's level and why.
fn alarm_words(status: &StatusRecord) -> String {
    let level = level_name(status.alarm);
    match (status.alarm, rule_name(status.alarm_rule)) {
        (messages::alarm::OFF, _) if status.alarm_faults != 0 => {
            format!("{level}: {}", Faults(status.alarm_faults))
        }
        (_, Some(rule)) => format!("{level} ({})", rule.replace('_', " ")),
        _ => level.to_owned(),
    }
}

/// The word for the slowest stage.
fn slowest(status: &StatusRecord) -> &'static str {
    u8::try_from(status.pacing.slowest).ok().and_then(Role::from_raw).map_or("unknown", Role::name)
}

/// The pace, the deadline and what was refused, one line each where there is something to say.
fn pace_lines(status: &StatusRecord) -> String {
    let mut out = String::new();
    let p = &status.pacing;
    if p.rate_hz > 0.0 {
        let _ = write!(out, "pace: {:.1} fps of {:.1} wanted", p.rate_hz, p.wanted_hz);
        if p.slowest_ms > 0.0 {
            let _ = write!(out, "; slowest: {}, {:.1} ms for 9 of 10", slowest(status), p.slowest_ms);
        }
        let _ = writeln!(out, "; {}", status.deadline);
    }
    for (role, process) in status.processes() {
        if process.realtime.refused != 0 {
            let _ = writeln!(out, "{role}: {}", process.realtime);
        }
    }
    out
}

/// The status as a person reads it.
pub fn table(name: &str, status: &StatusRecord) -> String {
    let mut out = String::new();
    let reason = status.reason();
    let because = if reason.is_empty() { String::new() } else { format!(" ({reason})") };
    let calibration = match status.calibration.state() {
        CalibrationState::Off => String::new(),
        _ => format!("calibration: {}\n", status.calibration),
    };
    let device = match status.device.words() {
        words if words.is_empty() => words,
        words => {
            let times: Vec<String> = STAGES
                .iter()
                .zip(status.device.times_ms())
                .map(|(stage, ms)| format!("{stage} {ms:.2}"))
                .collect();
            let all: f32 = status.device.times_ms().iter().sum();
            let times = if times.is_empty() {
                times.concat()
            } else {
                format!(": {all:.1} ms ({})", times.join(", "))
            };
            format!("matches on {words}{times}\n")
        }
    };
    let nearest = if status.nearest_m.is_finite() {
        format!(", nearest in the path {:.1} m", status.nearest_m)
    } else {
        String::new()
    };
    let _ = writeln!(
        out,
        "{name}: {}{because}, up {:.0} s; {} frames, end to end p50 {:.0} ms, p99 {:.0} ms\n\
         alarm {}{nearest}; {} obstacles, {} alarms so far\n{}{calibration}{device}{}",
        status.state_name(),
        status.uptime_ns as f64 * 1e-9,
        status.frames,
        status.latency_p50_ms,
        status.latency_p99_ms,
        alarm_words(status),
        status.obstacles,
        status.alarms,
        pace_lines(status),
        super::status_heat::lines(&status.heat),
    );
    let _ = writeln!(
        out,
        "{:<12} {:<16} {:>8} {:>4} {:>6} {:>8} {:>8} {:>8} {:>7} {:>8} {:>8}",
        "process",
        "state",
        "pid",
        "core",
        "fps",
        "p50 ms",
        "p99 ms",
        "skipped",
        "CPU %",
        "RSS MiB",
        "restarts"
    );
    for (role, p) in status.processes() {
        let core = if p.core >= 0 { p.core.to_string() } else { "-".into() };
        let _ = writeln!(
            out,
            "{:<12} {:<16} {:>8} {:>4} {:>6.1} {:>8.1} {:>8.1} {:>8} {:>7.1} {:>8.1} {:>8}",
            role.name(),
            p.state(),
            p.pid,
            core,
            p.rate_hz,
            p.p50_ms,
            p.p99_ms,
            p.skipped,
            p.cpu_percent,
            p.private_bytes as f64 / (1 << 20) as f64,
            p.restarts
        );
    }
    out
}
