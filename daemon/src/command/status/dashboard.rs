//! `lookout status --watch`: a full screen that is redrawn every second on a terminal, otherwise one line each.

use crate::command::error::CommandError;
use crate::frame_record::alarm_object;
use crate::printable::Printable;
use messages::alarm::{ALARM, CLEAR, level_name};
use messages::calibration::CalibrationState;
use messages::pipeline::Role;
use messages::status::{ProcessRecord, StatusRecord};
use std::collections::VecDeque;
use std::io::{self, IsTerminal, Write};
use tools::reporting::record::level_words;

/// Number of seconds in the curves.
const KEPT: usize = 120;

/// Columns, if the terminal does not report its size.
const COLUMNS: usize = 100;

/// Block characters for the curves, from low to high.
const BARS: [char; 8] = ['▁', '▂', '▃', '▄', '▅', '▆', '▇', '█'];

/// Colour of a line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Tone {
    Plain,
    Faint,
    Good,
    Warn,
    Bad,
}

/// The screen and the values that its curves show.
pub struct Dashboard {
    name: String,
    rates: VecDeque<f64>,
    drops: VecDeque<f64>,
    cpu: VecDeque<f64>,
    dropped: Option<u64>,
    is_screen: bool,
    has_colour: bool,
    last: String,
}

impl Dashboard {
    /// Switches to full screen, if standard output is a terminal.
    pub fn open(name: &str) -> Self {
        let is_screen = io::stdout().is_terminal();
        if is_screen {
            // Alternate screen without a cursor; the terminal's contents are restored at the end.
            put("\x1b[?1049h\x1b[?25l");
        }
        Self::new(name, is_screen, is_screen && std::env::var_os("NO_COLOR").is_none())
    }

    fn new(name: &str, is_screen: bool, has_colour: bool) -> Self {
        let empty = || VecDeque::with_capacity(KEPT);
        Self {
            name: name.to_owned(),
            rates: empty(),
            drops: empty(),
            cpu: empty(),
            dropped: None,
            is_screen,
            has_colour,
            last: String::new(),
        }
    }

    /// Shows a status, and the line of what sends it on a CAN bus.
    ///
    /// # Errors
    /// If standard output cannot be written.
    pub fn show(&mut self, status: &StatusRecord, can_out: Option<&str>) -> Result<(), CommandError> {
        self.take(status);
        if !self.is_screen {
            return crate::command::console::say(self.line(status));
        }
        let (columns, rows) = size();
        let mut text = String::from("\x1b[?2026h\x1b[H");
        for (tone, line) in self.lines(status, can_out, columns).into_iter().take(rows.saturating_sub(1)) {
            let cut: String = line.chars().take(columns).collect();
            text += &self.coloured(tone, &cut);
            text += "\x1b[K\r\n";
        }
        text += "\x1b[J\x1b[?2026l";
        put(&text);
        self.last = super::table::table(&self.name, status);
        Ok(())
    }

    fn take(&mut self, status: &StatusRecord) {
        let keep = |list: &mut VecDeque<f64>, value: f64| {
            if list.len() == KEPT {
                list.pop_front();
            }
            list.push_back(value);
        };
        let stages = status.processes().filter(|(role, _)| Role::STAGES.contains(role));
        let dropped = stages.map(|(_, p)| p.skipped).sum();
        keep(&mut self.rates, rate(status));
        keep(&mut self.cpu, cpu(status));
        let before = self.dropped.replace(dropped).unwrap_or(dropped);
        keep(&mut self.drops, dropped.saturating_sub(before) as f64);
    }

    fn coloured(&self, tone: Tone, text: &str) -> String {
        let code = match tone {
            Tone::Plain => return text.to_owned(),
            Tone::Faint => 2,
            Tone::Good => 32,
            Tone::Warn => 33,
            Tone::Bad => 31,
        };
        if self.has_colour { format!("\x1b[{code}m{text}\x1b[0m") } else { text.to_owned() }
    }

    /// One line for a log.
    fn line(&self, status: &StatusRecord) -> String {
        let reason = Printable(status.reason()).to_string();
        let because = if reason.is_empty() { String::new() } else { format!(" ({reason})") };
        format!(
            "{}: {}{because}, {:.1} fps, p50 {:.0} ms, p99 {:.0} ms, {}, {} obstacles, {} dropped, CPU {:.0} %, {} restarts",
            self.name,
            status.state_name(),
            rate(status),
            status.latency_p50_ms,
            status.latency_p99_ms,
            alarm(status),
            status.obstacles,
            self.dropped.unwrap_or(0),
            cpu(status),
            status.processes().map(|(_, p)| p.restarts).sum::<u32>(),
        )
    }

    /// The screen, line by line.
    fn lines(&self, status: &StatusRecord, can_out: Option<&str>, columns: usize) -> Vec<(Tone, String)> {
        let reason = Printable(status.reason()).to_string();
        let because = if reason.is_empty() { String::new() } else { format!(": {reason}") };
        let state = match status.state {
            1 => Tone::Good,
            2 => Tone::Bad,
            _ => Tone::Warn,
        };
        let alarm_tone = match status.alarm.level {
            ALARM => Tone::Bad,
            CLEAR => Tone::Good,
            _ => Tone::Warn,
        };
        let seconds = status.uptime_ns / 1_000_000_000;
        let up = format!("{}:{:02}:{:02}", seconds / 3600, seconds / 60 % 60, seconds % 60);
        let mut lines = vec![
            (state, format!("{}  {}{because}", self.name, status.state_name())),
            (
                Tone::Plain,
                format!(
                    "up {up}  {} frames  end to end p50 {:.0} ms, p99 {:.0} ms",
                    status.frames, status.latency_p50_ms, status.latency_p99_ms
                ),
            ),
            (
                alarm_tone,
                format!(
                    "{}  {} obstacles  {} alarms since start",
                    alarm(status),
                    status.obstacles,
                    status.alarms
                ),
            ),
        ];
        let motion_tone = if status.motion.is_known() { Tone::Plain } else { Tone::Warn };
        lines.push((motion_tone, status.motion.to_string()));
        match status.calibration.state() {
            CalibrationState::Off => {}
            state => {
                let tone = if state == CalibrationState::Degraded { Tone::Bad } else { Tone::Plain };
                lines.push((tone, format!("calibration {}", status.calibration)));
            }
        }
        if let Some(line) = can_out {
            lines.push((Tone::Plain, line.to_owned()));
        }
        lines.push((Tone::Plain, String::new()));
        // Room for name and value beside the curve.
        let width = columns.saturating_sub(26).min(KEPT);
        for (name, list, unit) in
            [("rate", &self.rates, "fps"), ("CPU", &self.cpu, "%"), ("dropped", &self.drops, "")]
        {
            let now = list.back().copied().unwrap_or(0.0);
            lines.push((Tone::Plain, format!("{name:<8}{} {now:>6.1} {unit}", curve(list, width))));
        }
        lines.push((Tone::Plain, String::new()));
        let head = format!(
            "{:<12} {:<10} {:>4} {:>6} {:>8} {:>8} {:>8} {:>5} {:<10} {:>8} {:>8}",
            "process",
            "state",
            "core",
            "fps",
            "p50 ms",
            "p99 ms",
            "skipped",
            "CPU %",
            "",
            "RSS MiB",
            "restarts"
        );
        lines.push((Tone::Faint, head));
        for (role, p) in status.processes() {
            let tone = if p.state() == "running" { Tone::Plain } else { Tone::Bad };
            lines.push((tone, process(role, p)));
        }
        lines.push((Tone::Plain, String::new()));
        lines.push((Tone::Faint, "Ctrl-C closes this view; the daemon keeps running".into()));
        lines
    }
}

impl Drop for Dashboard {
    fn drop(&mut self) {
        if self.is_screen {
            put("\x1b[?25h\x1b[?1049l");
            put(&self.last);
        }
    }
}

fn process(role: Role, p: &ProcessRecord) -> String {
    let core = if p.core >= 0 { p.core.to_string() } else { "-".into() };
    let filled = (f64::from(p.cpu_percent) / 10.0).round().clamp(0.0, 10.0) as usize;
    let bar = "█".repeat(filled) + &"·".repeat(10 - filled);
    format!(
        "{:<12} {:<10} {core:>4} {:>6.1} {:>8.1} {:>8.1} {:>8} {:>5.0} {bar} {:>8.1} {:>8}",
        role.name(),
        p.state(),
        p.rate_hz,
        p.p50_ms,
        p.p99_ms,
        p.skipped,
        p.cpu_percent,
        p.private_bytes as f64 / (1 << 20) as f64,
        p.restarts
    )
}

fn rate(status: &StatusRecord) -> f64 {
    let last = status.processes().find(|(role, _)| *role == Role::LAST);
    last.map_or(0.0, |(_, p)| f64::from(p.rate_hz))
}

fn cpu(status: &StatusRecord) -> f64 {
    status.processes().map(|(_, p)| f64::from(p.cpu_percent)).sum()
}

fn alarm(status: &StatusRecord) -> String {
    let level = level_words(level_name(status.alarm.level)).to_owned();
    let nearest_m = status.alarm.nearest_m;
    let nearest = if nearest_m.is_finite() { format!(", nearest {nearest_m:.1} m") } else { String::new() };
    // The reason of a clear alarm is its nearest obstacle, or that there is none.
    if status.alarm.level == CLEAR {
        return level + &nearest;
    }
    let object = alarm_object(&status.alarm).map_or(String::new(), |object| format!(", {object}"));
    Printable(format!("{level}: {}{object}{nearest}", status.alarm.reason())).to_string()
}

/// The last values as bars, the newest on the right.
fn curve(list: &VecDeque<f64>, width: usize) -> String {
    let top = list.iter().copied().fold(1e-9, f64::max);
    let bar = |v: &f64| if *v <= 0.0 { ' ' } else { BARS[((v / top * 7.0).round() as usize).min(7)] };
    let shown: String = list.iter().skip(list.len().saturating_sub(width)).map(bar).collect();
    format!("{shown:>width$}")
}

fn size() -> (usize, usize) {
    match rustix::termios::tcgetwinsize(io::stdout()) {
        Ok(size) if size.ws_col > 0 && size.ws_row > 0 => (size.ws_col.into(), size.ws_row.into()),
        _ => (COLUMNS, 50),
    }
}

/// Writes to the terminal. Errors are ignored: a closed terminal also sends SIGHUP.
fn put(text: &str) {
    let mut out = io::stdout().lock();
    let _ = out.write_all(text.as_bytes()).and_then(|()| out.flush());
}

#[cfg(test)]
mod tests {
    use super::*;
    use messages::obstacles::AlarmRecord;

    fn status(skipped: u64) -> StatusRecord {
        let mut status = StatusRecord::empty();
        (status.state, status.processes) = (2, 2);
        status.alarm = AlarmRecord { level: ALARM, rule: 1, nearest_m: 8.25, ..status.alarm };
        status.set_reason("the road stage failed");
        let process = status.process[0];
        let of = |role: Role, state: &str| {
            let mut p =
                ProcessRecord { role: role as u32, cpu_percent: 42.0, skipped, rate_hz: 12.5, ..process };
            messages::header::put_text(&mut p.state, state);
            p
        };
        status.process[0] = of(Role::Road, "waiting");
        status.process[1] = of(Role::Recognition, "running");
        status
    }

    #[test]
    fn the_screen_marks_problems() {
        let mut dashboard = Dashboard::new("front", false, true);
        dashboard.take(&status(5));
        dashboard.take(&status(8));
        let lines = dashboard.lines(&status(8), Some("CAN out: can0 active"), 80);
        let line =
            |word: &str| lines.iter().find(|(_, l)| l.contains(word)).unwrap_or_else(|| panic!("{word}"));
        assert_eq!(line("degraded: the road stage failed").0, Tone::Bad);
        assert_eq!(line("alarm raised: nearer than the preset distance, nearest 8.2 m").0, Tone::Bad);
        assert_eq!(line("own motion unknown: straight path").0, Tone::Warn);
        assert_eq!((line("waiting").0, line("recognition").0), (Tone::Bad, Tone::Plain));
        assert!(line("waiting").1.contains("████······"), "{lines:?}");
        assert_eq!(line("CAN out").0, Tone::Plain);
        // Two stages dropped three each.
        assert!(line("dropped ").1.trim_end().ends_with("6.0"), "{lines:?}");
        assert_eq!(dashboard.coloured(Tone::Bad, "x"), "\x1b[31mx\x1b[0m");
        let text = dashboard.line(&status(8));
        assert!(
            text.starts_with("front: degraded (the road stage failed), 12.5 fps") && !text.contains('\x1b')
        );
    }

    #[test]
    fn curves_scroll_and_scale() {
        let list: VecDeque<f64> = [1.0, 0.0, 4.0, 8.0].into();
        assert_eq!(curve(&list, 6), "  ▂ ▅█");
        assert_eq!(curve(&list, 2), "▅█");
        assert_eq!(curve(&VecDeque::new(), 3), "   ");
        let mut dashboard = Dashboard::new("front", false, false);
        for _ in 0..2 * KEPT {
            dashboard.take(&status(0));
        }
        assert_eq!(dashboard.rates.len(), KEPT);
    }
}
