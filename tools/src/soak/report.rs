//! Report of a soak run: JSON, Markdown and plots.

use super::budget::{Kind, Line, Verdict};
use super::latency::{Latencies, StageTimes};
use super::markdown::table;
use super::recovery::{FaultRow, Recovery};
use super::stalls::CoreFigures;
use crate::reporting::summary::Latency;
use serde::Serialize;
use std::fmt::Write;

/// Percentiles in milliseconds.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Percentiles {
    /// Median.
    pub p50: f64,
    /// 99th percentile.
    pub p99: f64,
    /// 99.9th percentile.
    pub p999: f64,
    /// Maximum.
    pub max: f64,
}

impl From<&Latency> for Percentiles {
    fn from(latency: &Latency) -> Self {
        Self {
            p50: latency.percentile_ms(50.0),
            p99: latency.percentile_ms(99.0),
            p999: latency.percentile_ms(99.9),
            max: latency.percentile_ms(100.0),
        }
    }
}

/// Durations of one stage.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct StageRow {
    /// Role of the stage.
    pub role: &'static str,
    /// From the result of the previous stage to the start of processing.
    pub wait_ms: Percentiles,
    /// Processing time.
    pub work_ms: Percentiles,
}

impl StageRow {
    /// All stages.
    pub fn all(latencies: &Latencies) -> Vec<Self> {
        let row = |times: &StageTimes| Self {
            role: times.stage.name,
            wait_ms: (&times.wait).into(),
            work_ms: (&times.work).into(),
        };
        latencies.stages.iter().map(row).collect()
    }
}

/// Statistics of all processes of one role.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct ProcessRow {
    /// Role of the process.
    pub role: String,
    /// The core it was pinned to.
    pub core: Option<u32>,
    /// Scheduling policy and priority, such as `SCHED_OTHER` or `SCHED_FIFO 30`.
    pub policy: String,
    /// CPU usage, in percent of one core.
    pub cpu_percent: f64,
    /// Peak private resident memory.
    pub private_bytes: u64,
    /// Growth of private memory; `None` after restarts or in a short run.
    pub slope_bytes_per_hour: Option<f64>,
    /// Processed frames.
    pub frames: u64,
    /// Frames replaced by newer ones before processing.
    pub skipped: u64,
    /// Messages that failed validation.
    pub refused: u64,
    /// Number of restarts.
    pub restarts: u32,
}

/// Stalls of one core.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct StallRow {
    /// Core number; `None` for a probe that was not pinned.
    pub core: Option<u32>,
    /// Stalls of more than 1 ms.
    pub stalls: u64,
    /// Share of time stalled, in percent.
    pub percent: f64,
    /// The longest stall.
    pub longest_ms: f64,
    /// 99.9th percentile of the wake-up latency.
    pub p999_ms: f64,
}

impl StallRow {
    /// Statistics of one core over a duration.
    pub fn new(figures: &CoreFigures, seconds: f64) -> Self {
        Self {
            core: figures.core,
            stalls: figures.stalls,
            percent: figures.total_ns as f64 * 1e-7 / seconds.max(1e-9),
            longest_ms: figures.longest_ns as f64 * 1e-6,
            p999_ms: figures.p999_ms,
        }
    }
}

/// A configuration key set by the soak test.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Setting {
    /// Name of the key.
    pub key: &'static str,
    /// Its value in this run.
    pub value: String,
    /// Reason.
    pub why: &'static str,
}

/// Environment of the run.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Machine {
    /// Name of the processor.
    pub processor: String,
    /// Number of cores.
    pub cores: usize,
    /// Kernel version.
    pub kernel: String,
    /// CPU usage of other processes, in percent of all cores.
    pub others_cpu_percent: f64,
    /// Steal time of a hypervisor, in percent of all cores.
    pub stolen_percent: f64,
    /// One-minute load average at the end.
    pub load: f64,
    /// Scheduling policy and priority of the probe.
    pub probe_policy: String,
}

/// The complete report. The first fields are those that scripts rely on.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct SoakReport {
    /// Number of results.
    pub frames: u64,
    /// Frames replaced by newer ones.
    pub dropped: u64,
    /// Restarts of all stages.
    pub restarts: u64,
    /// Restarts without a fault, and faults without a result within the time limit.
    pub failed_restarts: u64,
    /// Entries left in shared memory and in the instance's folder, and growth during the run.
    pub leaked_shm_entries: u64,
    /// Latency from capture to result, of frames not affected by a fault.
    pub latency_ms: Percentiles,
    /// CPU usage of all processes, in percent of all cores.
    pub cpu_percent: f64,
    /// Peak resident memory of all processes, with shared memory and executable counted once.
    pub rss_bytes: u64,
    /// Growth of private memory and of reserved shared memory; `None` when the run was too short.
    pub rss_slope_bytes_per_hour: Option<f64>,
    /// Longest time from a fault to the next result; 0 without faults.
    pub next_result_s_max: f64,
    /// `pass` or `fail`.
    pub verdict: &'static str,
    /// Reasons of failure.
    pub reasons: Vec<String>,
    /// Load of the run.
    pub kind: Kind,
    /// Source of the pairs.
    pub source: String,
    /// Offered pairs per second.
    pub fps: f64,
    /// Duration without the warm-up, in minutes.
    pub minutes: f64,
    /// Duration of the warm-up, in seconds.
    pub warm_up_s: f64,
    /// Time from the start of the daemon to its first result.
    pub first_result_s: f64,
    /// Pairs published by capture.
    pub offered: u64,
    /// Frames lost with a stage that died or at the end of the run.
    pub lost: u64,
    /// By how much `frames` and `dropped` exceed `offered`: frames that were published before the measurement. So
    /// `offered` + `surplus` = `frames` + `dropped` + `lost`.
    pub surplus: u64,
    /// Results per second.
    pub rate_hz: f64,
    /// Number of injected faults.
    pub faults: u64,
    /// Number of SIGKILLs among them.
    pub kills: u64,
    /// Seed of fault injection.
    pub seed: u64,
    /// 95 % confidence interval of the slope.
    pub rss_slope_interval_bytes_per_hour: Option<[f64; 2]>,
    /// Touched shared memory, counted once.
    pub shared_bytes: u64,
    /// Reserved shared memory: the upper limit of what can be touched.
    pub shared_reserved_bytes: u64,
    /// Resident pages of the executable, counted once.
    pub file_bytes: u64,
    /// Entries in shared memory: before the run, maximum during the run, after the run.
    pub shm_entries: [u64; 3],
    /// CPU usage of all processes, in cores.
    pub cpu_cores: f64,
    /// Latency from capture to result, minus the machine's own stalls.
    pub latency_less_stalls_ms: Percentiles,
    /// Latency of frames affected by a fault or its aftermath.
    pub latency_disturbed_ms: Percentiles,
    /// Number of frames in the latency statistics, and of disturbed frames.
    pub judged_frames: [u64; 2],
    /// Results with inconsistent stamps, which are in no statistics.
    pub unsound: u64,
    /// Results that the soak itself saw: the sum of the three counts above. `frames` is the count of the daemon's last
    /// status.
    pub traced: u64,
    /// Further results of frames that were repeated after a stage died; no other count contains them.
    pub repeated: u64,
    /// Deviation of the interval between results from the period.
    pub jitter_ms: Percentiles,
    /// Mean interval between results.
    pub period_mean_ms: f64,
    /// Standard deviation of the interval relative to the period.
    pub period_spread: f64,
    /// The longest interval between results, without faults.
    pub longest_gap_ms: f64,
    /// Durations by stage.
    pub stages: Vec<StageRow>,
    /// Statistics by process.
    pub processes: Vec<ProcessRow>,
    /// Recoveries by kind of fault and stage.
    pub fault_rows: Vec<FaultRow>,
    /// The longest recoveries.
    pub worst: Vec<Recovery>,
    /// Stalls by core.
    pub stalls: Vec<StallRow>,
    /// Budgets.
    pub budgets: Vec<Line>,
    /// Configuration keys set by the soak test.
    pub settings: Vec<Setting>,
    /// Environment.
    pub machine: Machine,
}

fn ms(p: &Percentiles) -> Vec<String> {
    [p.p50, p.p99, p.p999, p.max].map(|v| format!("{v:.2}")).to_vec()
}

fn row<const N: usize>(first: impl Into<String>, rest: [String; N]) -> Vec<String> {
    std::iter::once(first.into()).chain(rest).collect()
}

/// A number with a suitable number of digits.
fn figure(value: f64) -> String {
    match value.abs() {
        v if v >= 10_000.0 || v.fract() == 0.0 => format!("{value:.0}"),
        v if v >= 100.0 => format!("{value:.1}"),
        _ => format!("{value:.2}"),
    }
}

impl SoakReport {
    /// The table of budgets.
    pub fn verdict_table(&self) -> String {
        let line = |l: &Line| {
            let limit = format!("{} {} {}", if l.at_least { "≥" } else { "≤" }, figure(l.limit), l.unit);
            let verdict =
                if l.why.is_empty() { l.verdict.to_string() } else { format!("{}: {}", l.verdict, l.why) };
            row(l.what, [l.measured.map_or_else(|| "-".into(), figure), limit.trim_end().to_owned(), verdict])
        };
        table(&["what", "measured", "budget", "verdict"], &self.budgets.iter().map(line).collect::<Vec<_>>())
    }

    /// The complete report as Markdown; `plots` are (file, description).
    pub fn markdown(&self, plots: &[(String, String)]) -> String {
        let mut out = format!("# Soak: {}\n\n", if self.verdict == "pass" { "pass" } else { "FAIL" });
        for reason in &self.reasons {
            let _ = writeln!(out, "- {reason}");
        }
        let m = &self.machine;
        let asked = match self.kind {
            Kind::Steady => "a steady rate",
            Kind::Faults => "a steady rate, with faults",
            Kind::Overload => "twice the sustainable rate",
        };
        let _ = write!(
            out,
            "\n{:.1} minutes at {} pairs per second ({asked}) of {}, after {:.0} s of warm-up. {} results of {} pairs \
             ({:.2} per second), {} replaced by newer ones, {} lost with a stage or at the end{}. First result {:.2} s \
             after the start.\n\n\
             Machine: {}, {} cores, Linux {}. Other processes used {:.0} % of all cores, steal time {:.1} %; load {:.1} \
             at the end.\n\n## Budgets\n\n{}\n",
            self.minutes,
            figure(self.fps),
            self.source,
            self.warm_up_s,
            self.frames,
            self.offered,
            self.rate_hz,
            self.dropped,
            self.lost,
            match self.surplus {
                0 => String::new(),
                surplus => format!(
                    ", {surplus} of the results and replaced ones of pairs from before the measurement"
                ),
            },
            self.first_result_s,
            m.processor,
            m.cores,
            m.kernel,
            m.others_cpu_percent,
            m.stolen_percent,
            m.load,
            self.verdict_table()
        );
        self.latency_part(&mut out);
        self.process_part(&mut out);
        self.fault_part(&mut out);
        if !self.settings.is_empty() {
            let rows: Vec<_> =
                self.settings.iter().map(|s| row(s.key, [s.value.clone(), s.why.to_owned()])).collect();
            let _ = write!(out, "## Settings of this run\n\n{}\n", table(&["key", "value", "why"], &rows));
        }
        for (file, what) in plots {
            let _ = writeln!(out, "![{what}]({file})\n");
        }
        out
    }

    /// The counts of results, and why they differ.
    fn counts(&self) -> String {
        let Self { frames, traced, repeated, unsound, judged_frames: [judged, disturbed], .. } = self;
        let mut text = format!(
            "Of the {traced} results that the soak saw, {judged} are in this table, {disturbed} around faults are counted \
             separately, and {unsound} with stamps out of order are left out."
        );
        let difference = traced.abs_diff(*frames);
        if traced > frames {
            let _ = write!(
                text,
                " {difference} of them came after the daemon's last status, which counted {frames}."
            );
        } else if traced < frames {
            let _ = write!(
                text,
                " The daemon's last status counted {frames}: {difference} came just before the soak began to measure, or \
                 it missed their reports."
            );
        }
        if *repeated > 0 {
            let _ = write!(
                text,
                " {repeated} further results repeated a frame after a restart and are in no count."
            );
        }
        text
    }

    fn latency_part(&self, out: &mut String) {
        let head = ["ms", "p50", "p99", "p99.9", "max"];
        let mut rows = Vec::new();
        let mut add = |name: String, p: &Percentiles| {
            rows.push(std::iter::once(name).chain(ms(p)).collect::<Vec<_>>());
        };
        for (place, stage) in self.stages.iter().enumerate() {
            if place > 0 {
                add(format!("wait for {}", stage.role), &stage.wait_ms);
            }
            add(stage.role.to_owned(), &stage.work_ms);
        }
        add("end to end".into(), &self.latency_ms);
        add("end to end, less stalls".into(), &self.latency_less_stalls_ms);
        if self.judged_frames[1] > 0 {
            add("end to end, around faults".into(), &self.latency_disturbed_ms);
        }
        add("deviation from the period".into(), &self.jitter_ms);
        let _ = write!(
            out,
            "## Latency\n\n{}\n{} End to end is from the complete pair in \
             shared memory to the obstacles. Mean interval between results {:.2} ms (standard deviation {:.1} % of the \
             period, longest gap {:.0} ms).\n\n",
            table(&head, &rows),
            self.counts(),
            self.period_mean_ms,
            self.period_spread * 100.0,
            self.longest_gap_ms
        );
        let core = |c: Option<u32>| c.map_or_else(|| "any".into(), |c| c.to_string());
        let rows: Vec<_> = self
            .stalls
            .iter()
            .map(|s| {
                row(
                    core(s.core),
                    [
                        s.stalls.to_string(),
                        format!("{:.2}", s.percent),
                        format!("{:.2}", s.p999_ms),
                        format!("{:.1}", s.longest_ms),
                    ],
                )
            })
            .collect();
        let _ = write!(
            out,
            "The machine's own stalls: a probe on each core ({}) wakes every 2 ms and records wake-ups late by more than \
             1 ms. From a stage's time the stalls of its core are subtracted, limited to its excess over the median and to \
             the scheduling delay that the kernel reports for it.\n\n{}\n",
            self.machine.probe_policy,
            table(&["core", "stalls", "% of time", "p99.9 ms", "longest ms"], &rows)
        );
    }

    fn process_part(&self, out: &mut String) {
        let rows: Vec<_> = self
            .processes
            .iter()
            .map(|p| {
                row(
                    p.role.clone(),
                    [
                        p.core.map_or_else(|| "-".into(), |c| c.to_string()),
                        p.policy.clone(),
                        format!("{:.1}", p.cpu_percent),
                        format!("{:.2}", p.private_bytes as f64 / 1e6),
                        p.slope_bytes_per_hour.map_or_else(|| "-".into(), |s| format!("{:.0}", s / 1024.0)),
                        p.frames.to_string(),
                        p.skipped.to_string(),
                        p.refused.to_string(),
                        p.restarts.to_string(),
                    ],
                )
            })
            .collect();
        let head = [
            "process",
            "core",
            "policy",
            "CPU %",
            "memory MB",
            "KiB/h",
            "frames",
            "skipped",
            "refused",
            "restarts",
        ];
        let interval = match self.rss_slope_interval_bytes_per_hour {
            Some([low, high]) => format!(
                "Growth {:.0} KiB/h (Theil and Sen; 95 % interval {:.0} to {:.0})",
                self.rss_slope_bytes_per_hour.unwrap_or(f64::NAN) / 1024.0,
                low / 1024.0,
                high / 1024.0
            ),
            None => "Run too short for a slope".into(),
        };
        let _ = write!(
            out,
            "## Processes\n\n{}\nTotal: {:.2} cores ({:.1} % of {} cores) and {:.2} MB of memory, \
             including {:.2} MB (of {:.2} MB reserved) of shared memory and {:.2} MB of the executable, each counted once. \
             {interval}. Entries in shared memory: {} before, up to {} while it ran, {} after.\n\n",
            table(&head, &rows),
            self.cpu_cores,
            self.cpu_percent,
            self.machine.cores,
            self.rss_bytes as f64 / 1e6,
            self.shared_bytes as f64 / 1e6,
            self.shared_reserved_bytes as f64 / 1e6,
            self.file_bytes as f64 / 1e6,
            self.shm_entries[0],
            self.shm_entries[1],
            self.shm_entries[2],
        );
    }

    fn fault_part(&self, out: &mut String) {
        if self.faults == 0 {
            return;
        }
        let rows: Vec<_> = self
            .fault_rows
            .iter()
            .map(|r| {
                row(
                    format!("{} of {}", r.kind.name(), r.stage),
                    [
                        r.count.to_string(),
                        r.failed.to_string(),
                        format!("{:.2}", r.next_result_s_p50),
                        format!("{:.2}", r.next_result_s_max),
                    ],
                )
            })
            .collect();
        let worst: Vec<String> = self
            .worst
            .iter()
            .take(5)
            .map(|w| format!("{:.2} s ({} at {:.0} s)", w.next_result_s, w.fault, w.at_s))
            .collect();
        let _ = write!(
            out,
            "## Faults\n\n{} faults, {} of them SIGKILLs, seed {}; {} restarts, {} failed.\n\n{}\nkill is SIGKILL, exit a SIGTERM \
             that the scheduler did not send, hang a permanent SIGSTOP that the daemon has to detect (liveness deadline and \
             restart are in the time), stall a shorter SIGSTOP (timed from its end). The time ends with the first result whose \
             pair was captured after the fault. The longest: {}.\n\n",
            self.faults,
            self.kills,
            self.seed,
            self.restarts,
            self.failed_restarts,
            table(&["fault", "count", "failed", "next result s, median", "longest"], &rows),
            worst.join(", ")
        );
    }

    /// Whether the run failed.
    pub fn has_failed(&self) -> bool {
        !self.reasons.is_empty() || self.budgets.iter().any(|l| l.verdict == Verdict::Fail)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn counts_that_differ_are_explained() {
        let with = |frames, judged, disturbed, repeated| {
            let traced = judged + disturbed + 3;
            let judged_frames = [judged, disturbed];
            SoakReport { frames, traced, judged_frames, unsound: 3, repeated, ..SoakReport::default() }
                .counts()
        };
        assert_eq!(
            with(5135, 5132, 150, 147),
            "Of the 5285 results that the soak saw, 5132 are in this table, 150 around faults are counted separately, and \
             3 with stamps out of order are left out. 150 of them came after the daemon's last status, which counted 5135. \
             147 further results repeated a frame after a restart and are in no count."
        );
        assert!(with(110, 97, 0, 0).contains("last status counted 110: 10 came just before"));
        assert!(with(100, 97, 0, 0).ends_with("left out."));
        let page = SoakReport { offered: 90, frames: 92, surplus: 2, ..SoakReport::default() }.markdown(&[]);
        assert!(page.contains("92 results of 90 pairs") && page.contains(", 2 of the results"), "{page}");
    }
}
