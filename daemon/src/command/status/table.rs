//! The status of the daemon as a text table.

use crate::alarm_tally::alarm_times;
use crate::frame_record::alarm_object;
use crate::printable::Printable;
use messages::alarm::level_name;
use messages::calibration::CalibrationState;
use messages::heat::HeatRecord;
use messages::status::StatusRecord;
use perception::stereo::device::STAGES;
use std::fmt::Write;
use tools::reporting::record::level_words;

/// The level of the alarm, its reason and its object.
fn alarm_text(status: &StatusRecord) -> String {
    let object = alarm_object(&status.alarm).map_or(String::new(), |object| format!(", {object}"));
    Printable(format!("{}: {}{object}", level_words(level_name(status.alarm.level)), status.alarm.reason()))
        .to_string()
}

/// Frame rate and deadline, and for each process the privileges that were refused; empty if there is nothing.
fn pace_lines(status: &StatusRecord) -> String {
    let mut out = String::new();
    let p = &status.pacing;
    if p.rate_hz > 0.0 {
        let _ = write!(out, "pacing: {:.1} fps of {:.1} requested", p.rate_hz, p.wanted_hz);
        if p.slowest_ms > 0.0 {
            let _ =
                write!(out, "; slowest stage: {}, 90th percentile {:.1} ms", p.slowest_name(), p.slowest_ms);
        }
        let _ = writeln!(out, "; {}", status.deadline);
    }
    if status.source_time != messages::source_time::SourceTimeRecord::default() {
        let _ = writeln!(out, "time of the source: {}", status.source_time);
    }
    if status.vehicle != messages::motion::VehicleRecord::default() {
        let _ = writeln!(out, "vehicle: {}", status.vehicle);
    }
    for (role, process) in status.processes() {
        if process.realtime.refused != 0 {
            let _ = writeln!(out, "{role}: {}", process.realtime);
        }
    }
    out
}

/// The status as text: a summary and a table of processes.
pub fn table(name: &str, status: &StatusRecord) -> String {
    let mut out = String::new();
    let reason = Printable(status.reason()).to_string();
    let because = if reason.is_empty() { String::new() } else { format!(" ({reason})") };
    let calibration = match status.calibration.state() {
        CalibrationState::Off => String::new(),
        _ => format!("calibration: {}\n", status.calibration),
    };
    let device = match status.device.describe() {
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
            format!("stereo device: {words}{times}\n")
        }
    };
    // The reason of a clear alarm has it already.
    let nearest = if status.alarm.nearest_m.is_finite() && status.alarm.rule > 0 {
        format!(", nearest in the path {:.1} m", status.alarm.nearest_m)
    } else {
        String::new()
    };
    let _ = writeln!(
        out,
        "{name}: {}{because}, up {:.0} s; {} frames, end to end p50 {:.0} ms, p99 {:.0} ms\n\
         {}{nearest}; {} obstacles, {} alarms since start\n{}\n{}\n{}{calibration}{device}{}",
        status.state_name(),
        status.uptime_ns as f64 * 1e-9,
        status.frames,
        status.latency_p50_ms,
        status.latency_p99_ms,
        alarm_text(status),
        status.obstacles,
        status.alarms,
        alarm_times(&status.alarm_time),
        status.motion,
        pace_lines(status),
        heat_lines(&status.heat),
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

/// Temperatures and clocks; empty if neither is monitored.
fn heat_lines(heat: &HeatRecord) -> String {
    let mut out = String::new();
    if heat.watched == 1 {
        let _ = write!(out, "heat: {}", heat.rung_name());
        for zone in heat.zones() {
            let mark = if zone.projected == 1 { " (cannot be read; projected)" } else { "" };
            let _ = write!(out, ", {} {:.1} °C{mark}", zone.name(), zone.celsius);
        }
        out.push('\n');
    }
    if !heat.clocks().is_empty() {
        out.push_str("clocks:");
        for (i, clock) in heat.clocks().iter().enumerate() {
            let comma = if i > 0 { "," } else { "" };
            let _ = write!(out, "{comma} {} {:.0} MHz", clock.name(), clock.wanted_mhz);
            if clock.read_mhz != clock.wanted_mhz {
                let _ = write!(out, " (reads {:.0})", clock.read_mhz);
            }
        }
        out.push('\n');
    }
    out
}
