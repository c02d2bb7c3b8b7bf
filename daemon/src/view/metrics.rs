//! The Prometheus metrics, one declaration each: to add a metric, add an entry to [`METRICS`].

use super::board::Reading;
use super::history::Sample;
use super::hub::Hub;
use super::prometheus::{self, Kind, Samples};
use messages::alarm::LEVELS;
use messages::calibration::CalibrationState;
use messages::motion::{MotionRecord, SOURCES, health};
use messages::status::{ProcessRecord, StatusRecord};
use std::sync::atomic::{AtomicU64, Ordering};

/// Source of the metrics' values.
struct Source<'a> {
    /// The last status of the daemon; `None` while no daemon runs.
    status: Option<&'a StatusRecord>,
    /// The last sample of the history, for sensors.
    second: Option<&'a Sample>,
    /// Counters of the viewer itself.
    hub: &'a Hub,
}

/// One metric.
struct Metric {
    /// Name, without the prefix `lookout_`.
    name: &'static str,
    kind: Kind,
    help: &'static str,
    /// Reads the samples; adds none if the metric does not apply.
    read: fn(&Source<'_>, &mut Samples),
}

const fn gauge(name: &'static str, help: &'static str, read: fn(&Source<'_>, &mut Samples)) -> Metric {
    Metric { name, kind: Kind::Gauge, help, read }
}

const fn counter(name: &'static str, help: &'static str, read: fn(&Source<'_>, &mut Samples)) -> Metric {
    Metric { name, kind: Kind::Counter, help, read }
}

/// All metrics, in the order of the page.
#[rustfmt::skip]
const METRICS: &[Metric] = &[
    gauge("up", "Whether the daemon is running.", |s, out| out.one(flag(s.status.is_some()))),
    gauge("build_info", "Version of the viewer.", |_, out| {
        out.labelled(&[("version", env!("CARGO_PKG_VERSION"))], 1.0);
    }),
    gauge("state", "State of the daemon: 1 for the current one.", |s, out| status(s, |status| {
        out.one_of("state", &StatusRecord::STATES, status.state.min(3) as usize);
    })),
    gauge("alarm", "Level of the alarm: 1 for the current one.", |s, out| status(s, |status| {
        out.one_of("level", &LEVELS, status.alarm.level.min(3) as usize);
    })),
    counter("alarms_total", "Times that the level alarm was entered.", |s, out| status(s, |status| out.one(status.alarms as f64))),
    gauge("uptime_seconds", "Time since the daemon started.", |s, out| status(s, |status| {
        out.one(status.uptime_ns as f64 * 1e-9);
    })),
    counter("frames_total", "Frames with a result.", |s, out| status(s, |status| out.one(status.frames as f64))),
    gauge("obstacles", "Confirmed obstacles in the last frame.", |s, out| status(s, |status| {
        out.one(status.obstacles.into());
    })),
    gauge("nearest_in_path_meters", "Distance of the nearest obstacle in the path.", |s, out| status(s, |status| {
        if status.alarm.nearest_m.is_finite() {
            out.one(status.alarm.nearest_m);
        }
    })),
    gauge("alarm_clearance_meters", "Gap between the alarm's object and the path; negative: they overlap.", |s, out| status(s, |status| {
        if status.alarm.object > 0 && status.alarm.clearance_m.is_finite() {
            out.one(status.alarm.clearance_m);
        }
    })),
    counter("alarm_frames_total", "Frames by level of the alarm.", |s, out| status(s, |status| {
        for (level, frames) in LEVELS.iter().zip(status.alarm_time.frames) {
            out.labelled(&[("level", level)], frames as f64);
        }
    })),
    counter("alarm_seconds_total", "Source time by level of the alarm.", |s, out| status(s, |status| {
        for (level, ns) in LEVELS.iter().zip(status.alarm_time.ns) {
            out.labelled(&[("level", level)], ns as f64 * 1e-9);
        }
    })),
    counter("alarm_off_frames_total", "Frames with the alarm off, by reason; a frame may have several.", |s, out| status(s, |status| {
        for (reason, frames, _) in status.alarm_time.reasons() {
            out.labelled(&[("reason", reason)], frames as f64);
        }
    })),
    gauge("motion_known", "Whether the own motion is known; without it the path is straight.", |s, out| status(s, |status| {
        out.one(flag(status.motion.is_known()));
    })),
    gauge("motion_source", "What the own motion is known from: 1 for each source of the last result.", |s, out| status(s, |status| {
        for (_, name) in SOURCES {
            out.labelled(&[("source", name)], flag(status.motion.sources().any(|source| source == name)));
        }
    })),
    gauge("motion_disagree", "Whether odometry and the vehicle's bus disagree.", |s, out| status(s, |status| {
        out.one(flag(status.motion.is_known() && status.motion.has(health::DISAGREE)));
    })),
    gauge("speed_meters_per_second", "Own speed, forwards positive.", |s, out| motion(s, out, |m| m.speed_m_s)),
    gauge("speed_sigma_meters_per_second", "Standard deviation of the own speed.", |s, out| {
        motion(s, out, |m| m.speed_sigma_m_s);
    }),
    gauge("acceleration_meters_per_second_squared", "Own acceleration.", |s, out| motion(s, out, |m| m.acceleration_m_s2)),
    gauge("yaw_rate_radians_per_second", "Own yaw rate, to the left positive.", |s, out| motion(s, out, |m| m.yaw_rate_rad_s)),
    gauge("yaw_rate_sigma_radians_per_second", "Standard deviation of the own yaw rate.", |s, out| {
        motion(s, out, |m| m.yaw_rate_sigma_rad_s);
    }),
    gauge("latency_seconds", "Latency from capture to obstacles, since the start.", |s, out| status(s, |status| {
        out.labelled(&[("quantile", "0.5")], f64::from(status.latency_p50_ms) * 1e-3);
        out.labelled(&[("quantile", "0.99")], f64::from(status.latency_p99_ms) * 1e-3);
    })),
    counter("source_time_faults_total", "What was wrong with the time of the source, by kind.", |s, out| status(s, |status| {
        for (kind, count) in status.source_time.counts() {
            out.labelled(&[("kind", kind)], count as f64);
        }
    })),
    gauge("calibration", "State of the calibration: 1 for the current one.", |s, out| status(s, |status| {
        let states = CalibrationState::ALL;
        let holds = states.iter().position(|state| *state == status.calibration.state()).unwrap_or(1);
        out.one_of("state", &states.map(CalibrationState::name), holds);
    })),
    gauge("calibration_lost_matches_ratio", "Share of matches lost because rows differ.", |s, out| status(s, |status| {
        out.one(status.calibration.lost.into());
    })),
    gauge("calibration_correction_pixels", "Offset by which the rows of the right picture are shifted.", |s, out| status(s, |status| {
        out.one(status.calibration.corrected_px.into());
    })),
    gauge("calibration_moved_pixels", "Change of the row offset since the start.", |s, out| status(s, |status| {
        out.one(status.calibration.moved_px.into());
    })),
    gauge("calibration_offset_pixels", "Typical vertical offset between the pictures after correction.", |s, out| status(s, |status| {
        out.one(status.calibration.typical_px.into());
    })),
    gauge("process_up", "Whether the process is running.", |s, out| each(s, out, |p| flag(p.pid > 0))),
    counter("process_frames_total", "Frames finished.", |s, out| each(s, out, |p| p.frames as f64)),
    counter("process_skipped_frames_total", "Frames replaced by newer ones before the process read them.", |s, out| {
        each(s, out, |p| p.skipped as f64);
    }),
    counter("process_refused_messages_total", "Messages that failed a check of the process.", |s, out| {
        each(s, out, |p| p.refused as f64);
    }),
    counter("process_restarts_total", "Restarts of the process.", |s, out| each(s, out, |p| p.restarts.into())),
    gauge("process_frame_rate_hertz", "Frames per second, over the last second.", |s, out| {
        each(s, out, |p| p.rate_hz.into());
    }),
    gauge("process_cpu_ratio", "Processor time as a share of one core, over the last second.", |s, out| {
        each(s, out, |p| f64::from(p.cpu_percent) * 0.01);
    }),
    gauge("process_private_memory_bytes", "Resident private memory.", |s, out| {
        each(s, out, |p| p.private_bytes as f64);
    }),
    gauge("process_shared_memory_bytes", "Resident shared memory.", |s, out| each(s, out, |p| p.shared_bytes as f64)),
    gauge("process_frame_seconds", "Work per frame, since the start.", |s, out| {
        for (role, p) in s.status.into_iter().flat_map(StatusRecord::processes) {
            for (quantile, ms) in [("0.5", p.p50_ms), ("0.99", p.p99_ms)] {
                out.labelled(&[("process", role.name()), ("quantile", quantile)], f64::from(ms) * 1e-3);
            }
        }
    }),
    gauge("temperature_celsius", "Temperature of each sensor.", |s, out| sensors(s, out, |second| &second.temperatures)),
    gauge("frequency_hertz", "Clocks of processors and devices.", |s, out| sensors(s, out, |second| &second.clocks)),
    gauge("viewer_clients", "Open pages.", |s, out| out.one(s.hub.clients() as f64)),
    counter("viewer_frames_total", "Frames that could be shown.", |s, out| count(out, &s.hub.counters.frames)),
    counter("viewer_incomplete_frames_total", "Results whose images were replaced before they were read.", |s, out| {
        count(out, &s.hub.counters.incomplete);
    }),
    counter("viewer_refused_messages_total", "Messages that failed a check of the viewer.", |s, out| {
        count(out, &s.hub.counters.refused);
    }),
    counter("viewer_sent_messages_total", "Messages sent to pages.", |s, out| count(out, &s.hub.counters.sent)),
    counter("viewer_sent_bytes_total", "Bytes sent to pages.", |s, out| count(out, &s.hub.counters.sent_bytes)),
    counter("viewer_turned_away_total", "Requests turned away.", |s, out| count(out, &s.hub.counters.turned_away)),
    counter("viewer_slow_clients_total", "Pages disconnected because they did not read.", |s, out| {
        count(out, &s.hub.counters.too_slow);
    }),
];

fn flag(holds: bool) -> f64 {
    f64::from(u8::from(holds))
}

fn status(source: &Source<'_>, read: impl FnOnce(&StatusRecord)) {
    if let Some(status) = source.status {
        read(status);
    }
}

/// One sample while the own motion is known.
fn motion(source: &Source<'_>, out: &mut Samples, value: fn(&MotionRecord) -> f64) {
    if let Some(status) = source.status.filter(|status| status.motion.is_known()) {
        out.one(value(&status.motion));
    }
}

/// One sample for each process.
fn each(source: &Source<'_>, out: &mut Samples, value: fn(&ProcessRecord) -> f64) {
    for (role, process) in source.status.into_iter().flat_map(StatusRecord::processes) {
        out.labelled(&[("process", role.name())], value(process));
    }
}

fn sensors(source: &Source<'_>, out: &mut Samples, readings: fn(&Sample) -> &[Reading]) {
    for reading in source.second.into_iter().flat_map(readings) {
        out.labelled(&[("sensor", &reading.name)], reading.value);
    }
}

fn count(out: &mut Samples, counter: &AtomicU64) {
    out.one(counter.load(Ordering::Relaxed) as f64);
}

/// The page with all metrics. Without a daemon it has `up 0` and the metrics of the viewer.
pub fn text(status: Option<&StatusRecord>, second: Option<&Sample>, hub: &Hub) -> String {
    let source = Source { status, second, hub };
    let mut page = String::new();
    for metric in METRICS {
        let mut samples = Samples::default();
        (metric.read)(&source, &mut samples);
        prometheus::write(&mut page, metric.name, metric.kind, metric.help, &samples);
    }
    page
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::view::board::{Reading, Readings};
    use crate::view::history::History;
    use messages::obstacles::AlarmRecord;
    use messages::pipeline::Role;
    use std::collections::{HashMap, HashSet};

    /// Reads the text format as Prometheus does; gives the kind and the samples of each family.
    fn parse(text: &str) -> HashMap<String, (String, Vec<(String, f64)>)> {
        let mut families: HashMap<String, (String, Vec<(String, f64)>)> = HashMap::new();
        let (mut current, mut helped) = (String::new(), HashSet::new());
        assert!(text.ends_with('\n'), "the last line must end");
        for line in text.lines() {
            if let Some(rest) = line.strip_prefix("# HELP ") {
                let (name, help) = rest.split_once(' ').expect("a help has a text");
                assert!(!help.trim().is_empty() && helped.insert(name.to_owned()), "help twice: {name}");
            } else if let Some(rest) = line.strip_prefix("# TYPE ") {
                let (name, kind) = rest.split_once(' ').expect("a type has a kind");
                assert!(helped.contains(name), "{name} has no help");
                assert!(matches!(kind, "gauge" | "counter"), "{line}");
                assert_eq!(kind == "counter", name.ends_with("_total"), "{name} is a {kind}");
                assert!(families.insert(name.to_owned(), (kind.to_owned(), Vec::new())).is_none(), "{name}");
                current = name.to_owned();
            } else {
                let (series, value) = line.rsplit_once(' ').expect("a sample has a value");
                let (name, labels) = series.split_once('{').map_or((series, ""), |(n, l)| (n, l));
                assert_eq!(name, current, "samples stand below their type");
                let fit = |c: char| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '_';
                assert!(name.chars().all(fit), "{name}");
                assert!(labels.is_empty() || labels.ends_with('}'), "{line}");
                for pair in labels.trim_end_matches('}').split(',').filter(|p| !p.is_empty()) {
                    let (key, value) = pair.split_once('=').expect("a label has a value");
                    assert!(key.chars().all(fit) && value.starts_with('"') && value.ends_with('"'), "{pair}");
                }
                let value: f64 = value.parse().expect("a number");
                let samples = &mut families.get_mut(name).expect("its type came first").1;
                assert!(samples.iter().all(|(l, _)| l != labels), "{line} twice");
                samples.push((labels.to_owned(), value));
            }
        }
        for (name, (_, samples)) in &families {
            assert!(!samples.is_empty(), "{name} has no samples");
            let words = ["_ms", "_percent", "_mb", "_kb", "_mhz", "_milliseconds"];
            assert!(words.iter().all(|unit| !name.contains(unit)), "{name} is in no base unit");
        }
        families
    }

    fn status() -> StatusRecord {
        let mut status = StatusRecord::empty();
        (status.state, status.processes, status.frames, status.latency_p50_ms) = (1, 2, 77, 20.0);
        status.alarm = AlarmRecord { level: 3, object: 4, clearance_m: -0.5, ..status.alarm };
        (status.alarm_time.frames, status.alarm_time.off_frames[0]) = ([5, 60, 0, 12], 5);
        (status.process[0].role, status.process[1].role) = (0, Role::Stereo as u32);
        status.process[1].cpu_percent = 50.0;
        status
    }

    #[test]
    fn the_page_follows_the_format() {
        let hub = Hub::new();
        let mut history = History::default();
        let reading = Reading { name: "a \"b\"\\".into(), value: 48.5 };
        let board = Readings { temperatures: vec![reading], clocks: Vec::new() };
        history.second(&status(), board, 0.0);
        let families = parse(&text(Some(&status()), history.last(), &hub));
        let value = |name: &str, label: &str| {
            let samples = &families[&format!("lookout_{name}")].1;
            samples.iter().find(|(l, _)| l.contains(label)).expect(name).1
        };
        assert_eq!((value("up", ""), value("frames_total", "")), (1.0, 77.0));
        assert_eq!((value("alarm", "alarm"), value("alarm", "clear")), (1.0, 0.0));
        assert_eq!((value("alarm_clearance_meters", ""), value("alarm_frames_total", "clear")), (-0.5, 60.0));
        assert_eq!(value("alarm_off_frames_total", "no road seen"), 5.0);
        assert_eq!(value("process_cpu_ratio", "stereo"), 0.5);
        assert!((value("latency_seconds", "0.5") - 0.02).abs() < 1e-9);
        assert_eq!(value("temperature_celsius", r#"sensor="a \"b\"\\""#), 48.5);
        assert!(!families.contains_key("lookout_nearest_in_path_meters"), "infinite is absent");
        assert_eq!((value("motion_known", ""), value("motion_source", "bus_speed")), (0.0, 0.0));
        assert!(!families.contains_key("lookout_speed_meters_per_second"), "unknown is absent");
        let mut moving = status();
        moving.motion =
            MotionRecord { speed_m_s: 9.5, yaw_rate_rad_s: -0.125, health: 7, ..MotionRecord::default() };
        let families = parse(&text(Some(&moving), history.last(), &hub));
        let value = |name: &str, label: &str| {
            let samples = &families[&format!("lookout_{name}")].1;
            samples.iter().find(|(l, _)| l.contains(label)).expect(name).1
        };
        assert_eq!((value("motion_known", ""), value("motion_source", "odometry")), (1.0, 1.0));
        assert_eq!((value("motion_source", "bus_speed"), value("motion_source", "bus_yaw_rate")), (1.0, 0.0));
        assert_eq!(value("speed_meters_per_second", ""), 9.5);
        assert_eq!(value("yaw_rate_radians_per_second", ""), -0.125);
    }

    #[test]
    fn without_a_daemon_up_is_zero() {
        let families = parse(&text(None, None, &Hub::new()));
        assert_eq!(families["lookout_up"].1, [(String::new(), 0.0)]);
        assert!(!families.contains_key("lookout_frames_total"));
        assert!(families.contains_key("lookout_viewer_clients"));
    }

    /// The metrics that a page does not name in backticks. `…` stands for the rest, which the same line names:
    /// `lookout_process_…{process}` with `up`, `lookout_speed_sigma_…` with `lookout_speed_meters_per_second`.
    fn undocumented(page: &str) -> Vec<&'static str> {
        let name = |text: &str| text.split('{').next().unwrap_or_default().to_owned();
        let line = |line: &str| line.split('`').skip(1).step_by(2).map(name).collect::<Vec<_>>();
        let lines: Vec<Vec<String>> = page.lines().map(line).collect();
        let has = |metric: &str, line: &[String]| {
            let ends = |other: &str, end: &str| other.starts_with("lookout_") && other.ends_with(end);
            let rest = |end: &str| line.iter().any(|other| other == end || ends(other, &format!("_{end}")));
            line.iter().filter_map(|shown| shown.strip_prefix("lookout_")).any(|shown| {
                let begin = shown.strip_suffix('…');
                shown == metric || begin.and_then(|begin| metric.strip_prefix(begin)).is_some_and(rest)
            })
        };
        let names = METRICS.iter().map(|metric| metric.name);
        names.filter(|name| !lines.iter().any(|line| has(name, line))).collect()
    }

    #[test]
    fn every_metric_is_documented() {
        let page = include_str!("../../../docs/viewer.md");
        let missing = undocumented(page);
        assert!(missing.is_empty(), "docs/viewer.md does not name: {missing:#?}");
        // The check can fail.
        assert_eq!(undocumented(&page.replace("`lookout_up`", "")), ["up"]);
        assert_eq!(undocumented("").len(), METRICS.len());
    }
}
