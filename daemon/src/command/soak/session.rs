//! Helpers of all kinds of soak.

use crate::command::error::CommandError;
use crate::soak::Progress;
use config::Config;
use std::path::Path;
use std::time::Duration;
use tools::soak::report::Setting;

/// The configuration with the source at a rate, and that setting in the list.
pub fn at_rate(config: &Config, settings: &[Setting], fps: f64, why: &'static str) -> (Config, Vec<Setting>) {
    let mut config = config.clone();
    config.source.fps = fps;
    let mut settings = settings.to_vec();
    settings.push(Setting { key: "source.fps", value: format!("{fps:.4}"), why });
    (config, settings)
}

/// Minutes as a duration.
pub fn time(minutes: f64) -> Duration {
    Duration::from_secs_f64(minutes * 60.0)
}

/// A line that shows the progress.
pub fn line(p: &Progress) -> String {
    let clock = |s: f64| format!("{}:{:02}", (s / 60.0) as u64, s as u64 % 60);
    let at = match (p.measured_s, p.planned_s) {
        (s, _) if s < 0.0 => "warming up".to_owned(),
        (s, Some(all)) => format!("{} of {}", clock(s), clock(all)),
        (s, None) => clock(s),
    };
    let faults = match p.faults {
        [0, _] => String::new(),
        [made, failed] => format!(", {made} faults ({failed} failed, longest {:.2} s)", p.next_result_s),
    };
    format!(
        "{at:>16}  {} frames, {} dropped, p50 {:.1} ms, p99 {:.1} ms, {:.1} MB{faults}",
        p.frames,
        p.dropped,
        p.latency_ms[0],
        p.latency_ms[1],
        p.memory_bytes as f64 * 1e-6
    )
}

/// Writes a file.
pub fn save(path: &Path, text: &str) -> Result<(), CommandError> {
    std::fs::write(path, text)
        .map_err(|e| CommandError::Other(format!("{}: {e}: give another folder with --out", path.display())))
}
