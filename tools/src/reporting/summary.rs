//! The summary of a run: what `demo` and `replay` print, and `summary.json`.

use hdrhistogram::Histogram;
use serde::{Deserialize, Serialize};
use std::fmt;

/// Times of one kind, from which percentiles are taken. Memory does not grow with their number.
#[derive(Clone, Debug)]
pub struct Latency {
    histogram: Histogram<u64>,
}

impl Default for Latency {
    fn default() -> Self {
        Self::new()
    }
}

impl Latency {
    /// An empty collection, 1 µs to 1 h with three digits.
    ///
    /// # Panics
    /// Never: the bounds are constants that the library accepts.
    pub fn new() -> Self {
        let histogram = Histogram::new_with_bounds(1, 3_600_000_000, 3).expect("the bounds are sound");
        Self { histogram }
    }

    /// Adds a time in nanoseconds.
    pub fn add_ns(&mut self, ns: u64) {
        self.histogram.saturating_record((ns / 1000).max(1));
    }

    /// How many were added.
    pub fn count(&self) -> u64 {
        self.histogram.len()
    }

    /// A percentile in milliseconds; 0 when nothing was added.
    pub fn percentile_ms(&self, percentile: f64) -> f64 {
        if self.histogram.is_empty() {
            return 0.0;
        }
        self.histogram.value_at_percentile(percentile) as f64 / 1000.0
    }

    /// The usual percentiles.
    pub fn percentiles(&self) -> Percentiles {
        Percentiles {
            p50_ms: self.percentile_ms(50.0),
            p99_ms: self.percentile_ms(99.0),
            max_ms: self.percentile_ms(100.0),
        }
    }
}

/// Percentiles of a time.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Percentiles {
    /// Median.
    pub p50_ms: f64,
    /// 99th percentile.
    pub p99_ms: f64,
    /// The greatest.
    #[serde(rename = "greatest_ms")]
    pub max_ms: f64,
}

/// One process of a run.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ProcessSummary {
    /// Its role.
    pub role: String,
    /// The core that it was pinned to.
    pub core: Option<u32>,
    /// Frames that it finished.
    pub frames: u64,
    /// Frames that newer ones overtook before it took them up.
    pub skipped: u64,
    /// Messages that it refused.
    pub refused: u64,
    /// Its own work on a frame.
    pub work: Percentiles,
    /// Age of a frame when it took it up.
    pub age: Percentiles,
    /// Share of one core over the run, in percent.
    pub cpu_percent: f64,
    /// Greatest resident memory of its own.
    pub private_bytes: u64,
    /// Heap allocations for frames, once the process had all the memory that it needs.
    #[serde(default)]
    pub allocations: u64,
    /// How often it was restarted.
    pub restarts: u32,
}

/// A change of what the check of the calibration says.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct CalibrationChange {
    /// The frame that it was found in.
    pub sequence: u64,
    /// `good` or `degraded`.
    pub state: String,
    /// The same in words, with the figures.
    pub text: String,
    /// Largest offset of rows in the picture, in pixels.
    pub worst_px: f64,
    /// By how much the right picture's rows were shifted then, in pixels.
    pub corrected_px: f64,
}

/// A change of the alarm.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct AlarmChange {
    /// The frame that it came with.
    pub sequence: u64,
    /// `off`, `standby`, `warning` or `alarm`.
    pub level: String,
    /// The rule that raised it.
    pub rule: Option<String>,
    /// The track that did.
    pub track: Option<u32>,
    /// Nearest obstacle in the path.
    pub nearest_m: Option<f64>,
    /// The track's time to collision.
    pub time_to_collision_s: Option<f64>,
    /// Braking that would stop the vehicle before it.
    pub required_deceleration_m_s2: Option<f64>,
    /// Why it is off; empty otherwise.
    pub reason: String,
}

impl fmt::Display for AlarmChange {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "alarm {} at frame {}", self.level, self.sequence)?;
        if !self.reason.is_empty() {
            write!(f, ": {}", self.reason)?;
        }
        if let Some(rule) = &self.rule {
            write!(f, ": rule {}", rule.replace('_', " "))?;
        }
        if let Some(track) = self.track {
            write!(f, ", track {track}")?;
        }
        if let Some(nearest) = self.nearest_m {
            write!(f, ", nearest in the path {nearest:.1} m")?;
        }
        if let Some(ttc) = self.time_to_collision_s {
            write!(f, ", {ttc:.1} s to collision")?;
        }
        if let Some(braking) = self.required_deceleration_m_s2 {
            write!(f, ", {braking:.1} m/s2 needed")?;
        }
        Ok(())
    }
}

/// A run.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct RunSummary {
    /// Seconds from the first result to the last.
    pub seconds: f64,
    /// Seconds from the start to the first result.
    pub first_result_s: f64,
    /// Pairs that capture published.
    pub offered: u64,
    /// Frames that came out at the end.
    pub frames: u64,
    /// Frames that newer ones overtook on the way, all stages together.
    pub dropped: u64,
    /// Frames that ended otherwise: with a stage that died, or with the run.
    pub lost: u64,
    /// Frames a second.
    pub rate_hz: f64,
    /// Capture to obstacles.
    pub latency: Percentiles,
    /// Frames that took longer than the deadline, if there is one.
    #[serde(default)]
    pub late: u64,
    /// The processes.
    pub processes: Vec<ProcessSummary>,
    /// Shared memory of the daemon that was touched, counted once.
    pub shared_bytes: u64,
    /// Resident pages of the program file, counted once.
    pub file_bytes: u64,
    /// How often the alarm was raised.
    pub alarms: u32,
    /// Restarts of all stages together.
    pub restarts: u32,
    /// When the calibration was found good or degraded; the first hundred times.
    pub calibration: Vec<CalibrationChange>,
    /// When the alarm changed, and why; the first hundred times.
    #[serde(default)]
    pub alarm_changes: Vec<AlarmChange>,
}

impl fmt::Display for RunSummary {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(
            f,
            "{:<12} {:>4} {:>7} {:>8} {:>9} {:>9} {:>9} {:>9} {:>7} {:>9} {:>9}",
            "process",
            "core",
            "frames",
            "skipped",
            "work p50",
            "work p99",
            "age p50",
            "age p99",
            "CPU %",
            "RSS MiB",
            "restarts"
        )?;
        for p in &self.processes {
            let core = p.core.map_or("-".into(), |c| c.to_string());
            writeln!(
                f,
                "{:<12} {:>4} {:>7} {:>8} {:>9.1} {:>9.1} {:>9.1} {:>9.1} {:>7.1} {:>9.1} {:>9}",
                p.role,
                core,
                p.frames,
                p.skipped,
                p.work.p50_ms,
                p.work.p99_ms,
                p.age.p50_ms,
                p.age.p99_ms,
                p.cpu_percent,
                mebibytes(p.private_bytes),
                p.restarts
            )?;
        }
        let cpu: f64 = self.processes.iter().map(|p| p.cpu_percent).sum();
        let private: u64 = self.processes.iter().map(|p| p.private_bytes).sum();
        writeln!(
            f,
            "{:<12} {:>4} {:>7} {:>8} {:>9.1} {:>9.1} {:>9} {:>9} {:>7.1} {:>9.1} {:>9}",
            "end to end",
            "",
            self.frames,
            self.dropped,
            self.latency.p50_ms,
            self.latency.p99_ms,
            "",
            "",
            cpu,
            mebibytes(private + self.shared_bytes + self.file_bytes),
            self.restarts
        )?;
        write!(
            f,
            "{} of {} pairs in {:.1} s: {:.1} per second, first result after {:.2} s, {} alarms; \
             times in ms; the last line's memory counts {:.1} MiB of shared memory and {:.1} MiB of the \
             program once",
            self.frames,
            self.offered,
            self.seconds,
            self.rate_hz,
            self.first_result_s,
            self.alarms,
            mebibytes(self.shared_bytes),
            mebibytes(self.file_bytes)
        )?;
        // Good all the time is nothing to speak of.
        if self.calibration.iter().any(|change| change.state != "good") {
            for change in &self.calibration {
                write!(f, "\ncalibration, frame {}: {}", change.sequence, change.text)?;
            }
        }
        Ok(())
    }
}

fn mebibytes(bytes: u64) -> f64 {
    bytes as f64 / (1024.0 * 1024.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn percentiles_come_from_all_times() {
        let mut latency = Latency::new();
        assert_eq!(latency.percentiles(), Percentiles::default());
        for ms in 1..=100 {
            latency.add_ns(ms * 1_000_000);
        }
        let p = latency.percentiles();
        assert!((p.p50_ms - 50.0).abs() < 0.5 && (p.p99_ms - 99.0).abs() < 0.5, "{p:?}");
        assert!((p.max_ms - 100.0).abs() < 0.5);
        // Beyond the range it saturates.
        latency.add_ns(u64::MAX);
        assert_eq!(latency.count(), 101);
    }

    #[test]
    fn the_table_counts_shared_memory_once() {
        let process = ProcessSummary { role: "stereo".into(), private_bytes: 10 << 20, ..Default::default() };
        let summary = RunSummary {
            processes: vec![process.clone(), process],
            shared_bytes: 5 << 20,
            ..RunSummary::default()
        };
        let table = summary.to_string();
        let total = table.lines().find(|l| l.starts_with("end to end")).unwrap();
        assert!(total.contains("25.0"), "{table}");
    }
}
