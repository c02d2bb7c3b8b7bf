//! The summary of a run, as printed by `demo` and `replay`, and as written to `summary.json`.

use crate::reporting::alarm_times::AlarmTimes;
use crate::reporting::motion::MotionSummary;
use crate::reporting::record::{AlarmObject, level_words};
use hdrhistogram::Histogram;
use serde::{Deserialize, Serialize};
use std::fmt;

/// A histogram of durations with constant memory.
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
    /// An empty histogram from 1 µs to 1 h with three significant digits.
    ///
    /// # Panics
    /// Never: the bounds are valid constants.
    pub fn new() -> Self {
        let histogram = Histogram::new_with_bounds(1, 3_600_000_000, 3).expect("the bounds are valid");
        Self { histogram }
    }

    /// Adds a duration in nanoseconds.
    pub fn add_ns(&mut self, ns: u64) {
        self.histogram.saturating_record((ns / 1000).max(1));
    }

    /// Number of durations.
    pub fn count(&self) -> u64 {
        self.histogram.len()
    }

    /// A percentile in milliseconds; 0 for an empty histogram.
    pub fn percentile_ms(&self, percentile: f64) -> f64 {
        if self.histogram.is_empty() {
            return 0.0;
        }
        self.histogram.value_at_percentile(percentile) as f64 / 1000.0
    }

    /// Median, 99th percentile and maximum.
    pub fn percentiles(&self) -> Percentiles {
        Percentiles {
            p50_ms: self.percentile_ms(50.0),
            p99_ms: self.percentile_ms(99.0),
            max_ms: self.percentile_ms(100.0),
        }
    }
}

/// Percentiles of a duration.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Percentiles {
    /// Median.
    pub p50_ms: f64,
    /// 99th percentile.
    pub p99_ms: f64,
    /// Maximum.
    #[serde(rename = "greatest_ms")]
    pub max_ms: f64,
}

/// Summary of one process.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ProcessSummary {
    /// Role of the process.
    pub role: String,
    /// The core it was pinned to.
    pub core: Option<u32>,
    /// Processed frames.
    pub frames: u64,
    /// Frames that were replaced by newer ones before processing.
    pub skipped: u64,
    /// Messages that failed validation.
    pub refused: u64,
    /// Processing time per frame.
    pub work: Percentiles,
    /// Age of a frame at the start of processing.
    pub age: Percentiles,
    /// CPU usage over the run, in percent of one core.
    pub cpu_percent: f64,
    /// Peak private resident memory.
    pub private_bytes: u64,
    /// Heap allocations while processing frames, after the warm-up.
    #[serde(default)]
    pub allocations: u64,
    /// Number of restarts.
    pub restarts: u32,
}

/// A change of the calibration monitor's state, or the cameras have moved.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct CalibrationChange {
    /// Sequence number of the frame.
    pub sequence: u64,
    /// `good` or `degraded`.
    pub state: String,
    /// Description with the measured values.
    pub text: String,
    /// Why it is degraded: `none`, `rows_differ`, `beyond_correction`, `rows_apart`, `swapped` or `identical`.
    #[serde(default)]
    pub cause: String,
    /// Share of matches that the remaining row offset loses, 0 to 1.
    #[serde(default)]
    pub lost: f64,
    /// Typical row offset after the correction, in pixels.
    #[serde(default)]
    pub typical_px: f64,
    /// Row correction applied to the right image at that time, in pixels.
    pub corrected_px: f64,
    /// Change of the row offset since the start, in pixels; 0 unless the cameras have moved.
    #[serde(default)]
    pub moved_px: f64,
}

/// A change of the alarm level.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct AlarmChange {
    /// Sequence number of the frame.
    pub sequence: u64,
    /// `off`, `clear`, `warning` or `alarm`.
    pub level: String,
    /// The rule that raised the alarm.
    pub rule: Option<String>,
    /// The track that triggered it.
    pub track: Option<u32>,
    /// Distance of the nearest obstacle in the path.
    pub nearest_m: Option<f64>,
    /// Time to collision of the track.
    pub time_to_collision_s: Option<f64>,
    /// Deceleration needed to stop before it.
    pub required_deceleration_m_s2: Option<f64>,
    /// Why it has this level, in words.
    pub reason: String,
    /// What the level is about: the object that raised it, or else the nearest in the path.
    #[serde(default)]
    pub object: Option<AlarmObject>,
}

impl fmt::Display for AlarmChange {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} at frame {}: {}", level_words(&self.level), self.sequence, self.reason)?;
        if let Some(object) = &self.object {
            write!(f, ", {object}")?;
        }
        match self.nearest_m {
            // The reason of a clear alarm has it already.
            Some(nearest) if self.rule.is_some() => write!(f, ", nearest in the path {nearest:.1} m"),
            _ => Ok(()),
        }
    }
}

/// What was wrong with the time of the source, and obstacles that meant nothing.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct SourceTimeSummary {
    /// Gaps, after which tracks and alarm started anew.
    pub gaps: u64,
    /// Steps back, after which tracks and alarm started anew.
    pub steps_back: u64,
    /// Frames with the time of the frame before, which added nothing.
    pub repeats: u64,
    /// Obstacles that were dropped, because their numbers were not finite or beyond what can be measured.
    pub dropped_obstacles: u64,
}

/// Summary of a run.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct RunSummary {
    /// Seconds from the first result to the last.
    pub seconds: f64,
    /// Seconds from the start to the first result.
    pub first_result_s: f64,
    /// Pairs published by capture.
    pub offered: u64,
    /// Frames with a final result.
    pub frames: u64,
    /// Frames replaced by newer ones on the way, in all stages.
    pub dropped: u64,
    /// Pairs that the source left out, because a picture was missing or could not be decoded.
    #[serde(default)]
    pub unreadable: u64,
    /// Frames lost with a stage that died or at the end of the run.
    pub lost: u64,
    /// Results per second.
    pub rate_hz: f64,
    /// Latency from capture to obstacles.
    pub latency: Percentiles,
    /// Frames that exceeded the deadline, if there is one.
    #[serde(default)]
    pub late: u64,
    /// Processes.
    pub processes: Vec<ProcessSummary>,
    /// Shared memory pages touched by the daemon, counted once.
    pub shared_bytes: u64,
    /// Resident pages of the executable, counted once.
    pub file_bytes: u64,
    /// Number of alarms.
    pub alarms: u32,
    /// Frames and time in each level of the alarm, and why it was off.
    #[serde(default)]
    pub alarm_times: AlarmTimes,
    /// What was wrong with the time of the source.
    #[serde(default)]
    pub source_time: SourceTimeSummary,
    /// The vehicle's own motion.
    #[serde(default)]
    pub motion: MotionSummary,
    /// Restarts of all stages.
    pub restarts: u32,
    /// Changes of the calibration monitor's state, up to one hundred.
    pub calibration: Vec<CalibrationChange>,
    /// The calibration after the last frame; `None` if it is not monitored, or too little was matched.
    #[serde(default)]
    pub calibration_last: Option<CalibrationChange>,
    /// Changes of the alarm level with reasons, up to one hundred.
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
             times in ms; the memory in the last line includes {:.1} MiB of shared memory and {:.1} MiB of the \
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
        match self.unreadable {
            0 => {}
            1 => f.write_str("\n1 pair left out, because it cannot be read")?,
            n => write!(f, "\n{n} pairs left out, because they cannot be read")?,
        }
        write!(f, "\n{}", self.alarm_times)?;
        if self.source_time != SourceTimeSummary::default() {
            let SourceTimeSummary { gaps, steps_back, repeats, dropped_obstacles } = self.source_time;
            write!(
                f,
                "\ntime of the source: {gaps} gaps, {steps_back} steps back, {repeats} repeats; {dropped_obstacles} \
                 obstacles dropped"
            )?;
        }
        write!(f, "\n{}", self.motion)?;
        // Reported only when the state was ever different from good, or the cameras have moved.
        if self.calibration.iter().any(|change| change.state != "good" || change.moved_px > 0.0) {
            for change in &self.calibration {
                write!(f, "\ncalibration, frame {}: {}", change.sequence, change.text)?;
            }
        }
        if let Some(last) = &self.calibration_last {
            write!(f, "\ncalibration at the end: {}", last.text)?;
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
        // Saturates at the upper bound.
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
