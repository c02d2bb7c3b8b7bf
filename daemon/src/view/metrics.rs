//! Figures for Prometheus, in its text format: base units, counters that end in `_total`.

use super::history::Sample;
use super::hub::Hub;
use messages::alarm::LEVELS;
use messages::calibration::CalibrationState;
use messages::status::StatusRecord;
use std::fmt::{Display, Write};
use std::sync::atomic::Ordering;

/// The format's name.
pub const CONTENT_TYPE: &str = "text/plain; version=0.0.4; charset=utf-8";

const STATES: [&str; 4] = ["starting", "running", "degraded", "stopping"];

/// Writes families: a name, what it is, its values with their labels.
#[derive(Default)]
struct Page {
    text: String,
}

impl Page {
    fn family<T: Display>(
        &mut self,
        name: &str,
        kind: &str,
        help: &str,
        values: impl IntoIterator<Item = (String, T)>,
    ) {
        let mut values = values.into_iter().peekable();
        if values.peek().is_none() {
            return;
        }
        let _ = writeln!(self.text, "# HELP lookout_{name} {help}\n# TYPE lookout_{name} {kind}");
        for (labels, value) in values {
            let _ = writeln!(self.text, "lookout_{name}{labels} {value}");
        }
    }

    fn one(&mut self, name: &str, kind: &str, help: &str, value: impl Display) {
        self.family(name, kind, help, [(String::new(), value)]);
    }
}

/// Labels in braces. Values are escaped as the format wants it.
fn labels(pairs: &[(&str, &str)]) -> String {
    let escaped = |v: &str| v.replace('\\', "\\\\").replace('"', "\\\"").replace('\n', "\\n");
    let list: Vec<String> = pairs.iter().map(|(k, v)| format!("{k}=\"{}\"", escaped(v))).collect();
    format!("{{{}}}", list.join(","))
}

/// 1 for the value that holds, 0 for the others.
fn one_of<'a>(
    label: &'a str,
    names: &'a [&'a str],
    holds: usize,
) -> impl Iterator<Item = (String, u8)> + use<'a> {
    names.iter().enumerate().map(move |(i, name)| (labels(&[(label, name)]), u8::from(i == holds)))
}

/// The page. Without a daemon it says that, and what the viewer knows of itself.
pub fn text(status: Option<&StatusRecord>, second: Option<&Sample>, hub: &Hub) -> String {
    let mut page = Page::default();
    page.one("up", "gauge", "Whether the daemon is there.", u8::from(status.is_some()));
    let build = [(labels(&[("version", env!("CARGO_PKG_VERSION"))]), 1)];
    page.family("build_info", "gauge", "The version of the viewer.", build);
    if let Some(status) = status {
        daemon(&mut page, status);
        processes(&mut page, status);
    }
    if let Some(second) = second {
        let of = |readings: &[super::board::Reading]| {
            readings.iter().map(|r| (labels(&[("sensor", &r.name)]), r.value)).collect::<Vec<_>>()
        };
        page.family("temperature_celsius", "gauge", "Temperatures.", of(&second.temperatures));
        page.family("frequency_hertz", "gauge", "Clocks of processors and devices.", of(&second.clocks));
    }
    let counters = &hub.counters;
    page.one("viewer_clients", "gauge", "Pages that are open.", hub.clients());
    for (name, help, counter) in [
        ("viewer_frames_total", "Frames that could be shown.", &counters.frames),
        (
            "viewer_incomplete_frames_total",
            "Results whose images were overtaken before they were read.",
            &counters.incomplete,
        ),
        ("viewer_refused_messages_total", "Messages that failed their check.", &counters.refused),
        ("viewer_sent_messages_total", "Messages sent to pages.", &counters.sent),
        ("viewer_sent_bytes_total", "Bytes of these.", &counters.sent_bytes),
        ("viewer_turned_away_total", "Requests that were turned away.", &counters.turned_away),
        ("viewer_slow_clients_total", "Pages let go because they took nothing.", &counters.too_slow),
    ] {
        page.one(name, "counter", help, counter.load(Ordering::Relaxed));
    }
    page.text
}

fn daemon(page: &mut Page, status: &StatusRecord) {
    let states = one_of("state", &STATES, status.state.min(3) as usize);
    page.family("state", "gauge", "What the daemon is doing: 1 for the state that holds.", states);
    let alarms = one_of("level", &LEVELS, status.alarm.min(3) as usize);
    page.family("alarm", "gauge", "The alarm: 1 for the level that holds.", alarms);
    page.one("alarms_total", "counter", "Alarms that were raised.", status.alarms);
    page.one("uptime_seconds", "gauge", "Time since the daemon started.", status.uptime_ns as f64 * 1e-9);
    page.one("frames_total", "counter", "Frames that came out at the end.", status.frames);
    page.one("obstacles", "gauge", "Confirmed obstacles in the last frame.", status.obstacles);
    let nearest = [status.nearest_m].into_iter().filter(|m| m.is_finite()).map(|m| (String::new(), m));
    page.family("nearest_in_path_meters", "gauge", "Nearest obstacle in the path.", nearest);
    let quantiles = [("0.5", status.latency_p50_ms), ("0.99", status.latency_p99_ms)];
    let seconds = quantiles.map(|(q, ms)| (labels(&[("quantile", q)]), f64::from(ms) * 1e-3));
    page.family("latency_seconds", "gauge", "Capture to obstacles, since the start.", seconds);
    let names = [
        CalibrationState::Off,
        CalibrationState::Unknown,
        CalibrationState::Good,
        CalibrationState::Degraded,
    ];
    let holds = names.iter().position(|state| *state == status.calibration.state()).unwrap_or(1);
    let names = names.map(CalibrationState::name);
    let states = one_of("state", &names, holds);
    page.family("calibration", "gauge", "What the check of the calibration says: 1 for what holds.", states);
    let worst = status.calibration.worst_px;
    page.one("calibration_offset_pixels", "gauge", "Largest vertical offset of the pictures.", worst);
}

fn processes(page: &mut Page, status: &StatusRecord) {
    let all: Vec<_> = status.processes().collect();
    let each = |value: &dyn Fn(&messages::status::ProcessRecord) -> f64| {
        all.iter().map(|(r, p)| (labels(&[("process", r.name())]), value(p))).collect::<Vec<_>>()
    };
    page.family("process_up", "gauge", "Whether it runs.", each(&|p| f64::from(u8::from(p.pid > 0))));
    page.family("process_frames_total", "counter", "Frames finished.", each(&|p| p.frames as f64));
    page.family(
        "process_skipped_frames_total",
        "counter",
        "Frames overtaken by newer ones.",
        each(&|p| p.skipped as f64),
    );
    page.family(
        "process_refused_messages_total",
        "counter",
        "Messages that failed their check.",
        each(&|p| p.refused as f64),
    );
    page.family("process_restarts_total", "counter", "Restarts.", each(&|p| f64::from(p.restarts)));
    page.family(
        "process_frame_rate_hertz",
        "gauge",
        "Frames a second, over the last second.",
        each(&|p| f64::from(p.rate_hz)),
    );
    page.family(
        "process_cpu_ratio",
        "gauge",
        "Processor time, as a share of one core, over the last second.",
        each(&|p| f64::from(p.cpu_percent) * 0.01),
    );
    page.family(
        "process_private_memory_bytes",
        "gauge",
        "Resident memory of its own.",
        each(&|p| p.private_bytes as f64),
    );
    page.family(
        "process_shared_memory_bytes",
        "gauge",
        "Resident shared memory.",
        each(&|p| p.shared_bytes as f64),
    );
    let quantiles = all.iter().flat_map(|(role, p)| {
        [("0.5", p.p50_ms), ("0.99", p.p99_ms)].map(|(quantile, ms)| {
            (labels(&[("process", role.name()), ("quantile", quantile)]), f64::from(ms) * 1e-3)
        })
    });
    page.family("process_frame_seconds", "gauge", "Time per frame, since the start.", quantiles);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::view::board::{Reading, Readings};
    use crate::view::history::History;
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
        (status.state, status.alarm, status.processes, status.frames) = (1, 3, 2, 77);
        (status.latency_p50_ms, status.nearest_m) = (20.0, f64::INFINITY);
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
        assert_eq!((value("alarm", "alarm"), value("alarm", "standby")), (1.0, 0.0));
        assert_eq!(value("process_cpu_ratio", "stereo"), 0.5);
        assert!((value("latency_seconds", "0.5") - 0.02).abs() < 1e-9);
        assert_eq!(value("temperature_celsius", r#"sensor="a \"b\"\\""#), 48.5);
        assert!(!families.contains_key("lookout_nearest_in_path_meters"), "infinite is absent");
    }

    #[test]
    fn without_a_daemon_it_says_so() {
        let families = parse(&text(None, None, &Hub::new()));
        assert_eq!(families["lookout_up"].1, [(String::new(), 0.0)]);
        assert!(!families.contains_key("lookout_frames_total"));
        assert!(families.contains_key("lookout_viewer_clients"));
    }
}
