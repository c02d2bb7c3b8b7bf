//! The report of a soak: JSON, Markdown and plots.

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
    /// 99th.
    pub p99: f64,
    /// 99.9th.
    pub p999: f64,
    /// The greatest.
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

/// One stage.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct StageRow {
    /// Its role.
    pub role: &'static str,
    /// From the result of the stage before to taking a frame up.
    pub wait_ms: Percentiles,
    /// From there to its result.
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

/// One process, over all that had its role.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct ProcessRow {
    /// Its role.
    pub role: String,
    /// The core that it was pinned to.
    pub core: Option<u32>,
    /// Its scheduling policy and priority, as `SCHED_OTHER` or `SCHED_FIFO 30`.
    pub policy: String,
    /// Processor time, in percent of one core.
    pub cpu_percent: f64,
    /// Greatest resident memory of its own.
    pub private_bytes: u64,
    /// Growth of that; `None` where processes were restarted, or the run was short.
    pub slope_bytes_per_hour: Option<f64>,
    /// Frames that it finished.
    pub frames: u64,
    /// Frames that newer ones overtook.
    pub skipped: u64,
    /// Messages that it refused.
    pub refused: u64,
    /// How often it was restarted.
    pub restarts: u32,
}

/// Stalls of one core.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct StallRow {
    /// The core; `None` is a probe that was not pinned.
    pub core: Option<u32>,
    /// Stalls of more than 1 ms.
    pub stalls: u64,
    /// Their share of the time, in percent.
    pub percent: f64,
    /// The longest.
    pub longest_ms: f64,
    /// 99.9th percentile of the lateness of all wake-ups.
    pub p999_ms: f64,
}

impl StallRow {
    /// Of figures over some seconds.
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

/// A key of the configuration that the soak has set.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Setting {
    /// The key.
    pub key: &'static str,
    /// Its value in this run.
    pub value: String,
    /// Why.
    pub why: &'static str,
}

/// The machine.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Machine {
    /// The processor's name.
    pub processor: String,
    /// Its cores.
    pub cores: usize,
    /// Kernel.
    pub kernel: String,
    /// Processor time that others used meanwhile, in percent of all cores.
    pub others_cpu_percent: f64,
    /// Time that a hypervisor took away, in percent of all cores.
    pub stolen_percent: f64,
    /// Load average at the end, over one minute.
    pub load: f64,
    /// Policy and priority of the probe.
    pub probe_policy: String,
}

/// A whole report. The first keys are those that scripts rely on.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct SoakReport {
    /// Results.
    pub frames: u64,
    /// Frames that newer ones overtook.
    pub dropped: u64,
    /// Restarts of all stages.
    pub restarts: u64,
    /// Restarts that no fault asked for, and faults after which no result came in time.
    pub failed_restarts: u64,
    /// Entries that were left in shared memory and in the instance's folder, and growth on the way.
    pub leaked_shm_entries: u64,
    /// End to end, of frames that no fault disturbed.
    pub latency_ms: Percentiles,
    /// Processor time of all processes, in percent of all cores.
    pub cpu_percent: f64,
    /// Greatest resident memory of all processes, shared memory and program counted once.
    pub rss_bytes: u64,
    /// Growth of private memory and of what is reserved in shared memory; `None` when the run was too
    /// short to tell.
    pub rss_slope_bytes_per_hour: Option<f64>,
    /// Longest time from a fault to the next result; 0 when there was no fault.
    pub next_result_s_max: f64,
    /// `pass` or `fail`.
    pub verdict: &'static str,
    /// Why it failed.
    pub reasons: Vec<String>,
    /// What was asked of the daemon.
    pub kind: Kind,
    /// Where the pairs came from.
    pub source: String,
    /// Pairs offered a second.
    pub fps: f64,
    /// Minutes from the end of the warm-up to the end.
    pub minutes: f64,
    /// Seconds that were left out at the start.
    pub warm_up_s: f64,
    /// From the start of the daemon to its first result.
    pub first_result_s: f64,
    /// Pairs that capture published.
    pub offered: u64,
    /// Frames that ended otherwise: with a stage that died, or with the run.
    pub lost: u64,
    /// Results a second.
    pub rate_hz: f64,
    /// Faults that were made.
    pub faults: u64,
    /// SIGKILLs among them.
    pub kills: u64,
    /// Seed of the faults.
    pub seed: u64,
    /// 95 % interval of the slope.
    pub rss_slope_interval_bytes_per_hour: Option<[f64; 2]>,
    /// Shared memory that was touched, counted once.
    pub shared_bytes: u64,
    /// Shared memory that is reserved: as much can be touched.
    pub shared_reserved_bytes: u64,
    /// Pages of the program, counted once.
    pub file_bytes: u64,
    /// Entries in shared memory: before the daemon, while it ran (greatest), after it.
    pub shm_entries: [u64; 3],
    /// Cores' worth of processor time.
    pub cpu_cores: f64,
    /// End to end less the machine's own stalls.
    pub latency_less_stalls_ms: Percentiles,
    /// Of frames that a fault or its aftermath touched.
    pub latency_disturbed_ms: Percentiles,
    /// Frames in the latencies, and disturbed ones.
    pub judged_frames: [u64; 2],
    /// Deviation of the time between results from the period.
    pub jitter_ms: Percentiles,
    /// Mean time between results.
    pub period_mean_ms: f64,
    /// Its standard deviation as a share of the period.
    pub period_spread: f64,
    /// The longest time between results, faults apart.
    pub longest_gap_ms: f64,
    /// By stage.
    pub stages: Vec<StageRow>,
    /// By process.
    pub processes: Vec<ProcessRow>,
    /// By kind of fault and stage.
    pub fault_rows: Vec<FaultRow>,
    /// The longest recoveries.
    pub worst: Vec<Recovery>,
    /// By core.
    pub stalls: Vec<StallRow>,
    /// Budgets.
    pub budgets: Vec<Line>,
    /// What the soak has set.
    pub settings: Vec<Setting>,
    /// Where.
    pub machine: Machine,
}

fn ms(p: &Percentiles) -> Vec<String> {
    [p.p50, p.p99, p.p999, p.max].map(|v| format!("{v:.2}")).to_vec()
}

fn row<const N: usize>(first: impl Into<String>, rest: [String; N]) -> Vec<String> {
    std::iter::once(first.into()).chain(rest).collect()
}

/// A figure with as many digits as it deserves.
fn figure(value: f64) -> String {
    match value.abs() {
        v if v >= 10_000.0 || v.fract() == 0.0 => format!("{value:.0}"),
        v if v >= 100.0 => format!("{value:.1}"),
        _ => format!("{value:.2}"),
    }
}

impl SoakReport {
    /// The table of budgets: what a run comes to.
    pub fn verdict_table(&self) -> String {
        let line = |l: &Line| {
            let limit = format!("{} {} {}", if l.at_least { "≥" } else { "≤" }, figure(l.limit), l.unit);
            let verdict =
                if l.why.is_empty() { l.verdict.to_string() } else { format!("{}: {}", l.verdict, l.why) };
            row(l.what, [l.measured.map_or_else(|| "-".into(), figure), limit.trim_end().to_owned(), verdict])
        };
        table(&["what", "measured", "budget", "verdict"], &self.budgets.iter().map(line).collect::<Vec<_>>())
    }

    /// The whole report; `plots` are (file, what it shows).
    pub fn markdown(&self, plots: &[(String, String)]) -> String {
        let mut out = format!("# Soak: {}\n\n", if self.verdict == "pass" { "pass" } else { "FAIL" });
        for reason in &self.reasons {
            let _ = writeln!(out, "- {reason}");
        }
        let m = &self.machine;
        let asked = match self.kind {
            Kind::Steady => "a steady rate",
            Kind::Faults => "a steady rate, with faults",
            Kind::Overload => "twice what it sustains",
        };
        let _ = write!(
            out,
            "\n{:.1} minutes at {} pairs a second ({asked}) of {}, after {:.0} s of warm-up. {} results of {} pairs \
             ({:.2} a second), {} overtaken by newer ones, {} lost with a stage or with the end. First result {:.2} s \
             after the start.\n\n\
             Machine: {}, {} cores, Linux {}. Others used {:.0} % of all cores meanwhile, a hypervisor took {:.1} %; load {:.1} \
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
            let _ = write!(out, "## Set for this run\n\n{}\n", table(&["key", "value", "why"], &rows));
        }
        for (file, what) in plots {
            let _ = writeln!(out, "![{what}]({file})\n");
        }
        out
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
            "## Latency\n\n{}\nOf {} frames; {} around faults are counted apart. End to end is from the whole pair in shared \
             memory to the obstacles. Results came every {:.2} ms (standard deviation {:.1} % of the period, longest gap {:.0} \
             ms).\n\n",
            table(&head, &rows),
            self.judged_frames[0],
            self.judged_frames[1],
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
            "The machine's own stalls: a probe on each core ({}) asked to be woken every 2 ms, and came late by more than \
             1 ms. Taken off a stage's time is what of it was a stall of its core, at most what is beyond its median, and at most \
             what the kernel says that it was kept from its core.\n\n{}\n",
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
            None => "Too short a run for a slope".into(),
        };
        let _ = write!(
            out,
            "## Processes\n\n{}\nIn all {:.2} cores' worth of processor time ({:.1} % of {} cores) and {:.2} MB of memory, of \
             which {:.2} MB (of {:.2} MB reserved) are shared memory and {:.2} MB the program, each counted once. {interval}. Entries in shared memory: \
             {} before, up to {} while it ran, {} after.\n\n",
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
             that the scheduler did not send, hang a SIGSTOP for good, which the daemon has to notice (liveness deadline and \
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

    /// Whether a budget failed, or something else did.
    pub fn has_failed(&self) -> bool {
        !self.reasons.is_empty() || self.budgets.iter().any(|l| l.verdict == Verdict::Fail)
    }
}
