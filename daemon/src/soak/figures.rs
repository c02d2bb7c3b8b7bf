//! The report of a soak, from the values that an observer measured.

use super::observer::{Counts, Observer};
use super::plan::{Plan, Soaked};
use super::processes::MachineTime;
use config::Config;
use messages::pipeline::{PATH, Role};
use tools::reporting::summary::Latency;
use tools::reporting::svg::{Plot, Series};
use tools::soak::budget::{Budgets, Figures, Kind, SLOPE_SPAN_S, Verdict, judge};
use tools::soak::latency::{Latencies, PathStage};
use tools::soak::paper::RateRun;
use tools::soak::recovery::Recoveries;
use tools::soak::report::{Machine, ProcessRow, SoakReport, StageRow, StallRow};
use tools::soak::trend::{Slope, Trend};

const HOUR_S: f64 = 3600.0;

/// The budgets of a configuration.
pub fn budgets(config: &Config) -> Budgets {
    let c = &config.soak;
    Budgets {
        memory_bytes: c.memory_bytes as f64,
        slope_bytes_per_hour: c.slope_bytes_per_hour as f64,
        next_result_s: c.next_result_s,
        latency_p50_ms: c.latency_p50_ms,
        latency_p99_ms: c.latency_p99_ms,
        latency_p999_ms: c.latency_p999_ms,
        cpu_percent: c.cpu_percent,
        processed_percent: c.processed_percent,
        leaked_entries: c.leaked_entries.unsigned_abs(),
        failed_restarts: c.failed_restarts.unsigned_abs(),
    }
}

/// Whether a slope covers enough time to be compared with a budget.
fn is_long(slope: &Slope) -> bool {
    slope.span_s >= SLOPE_SPAN_S
}

/// The stages that follow stereo: the paper counts them as its obstacle detection.
const AFTER_STEREO: &[Role] = PATH.split_at(2).1;

/// The measured part of a run, from the end of the warm-up.
struct Span {
    /// Counters at its begin.
    base: Counts,
    /// Its begin, in seconds since the start of the daemon.
    from_s: f64,
    /// Its length.
    seconds: f64,
    /// Time from its begin to the last status, which the counters belong to.
    counted_s: f64,
}

/// Sums over all processes, in the measured part.
struct Totals {
    frames: u64,
    offered: u64,
    dropped: u64,
    restarts: u64,
    failed_restarts: u64,
    /// Entries in shared memory that were left, and their growth during the run.
    leaked: u64,
    memory_bytes: f64,
    /// Slope of the memory that could grow without bound.
    slope: Option<Slope>,
    cpu_cores: f64,
    /// In percent of all cores.
    cpu_percent: f64,
}

impl Observer {
    /// The report, after the daemon has ended. `left` is the number of shared-memory entries and files that it
    /// left behind.
    pub fn conclude(
        self,
        plan: &Plan,
        config: &Config,
        entries_before: u64,
        left: u64,
        mut reasons: Vec<String>,
    ) -> Soaked {
        let span = self.span();
        let no_faults = Recoveries::default();
        let recoveries = self.director.as_ref().map_or(&no_faults, |director| &director.recoveries);
        let totals = self.totals(&span, recoveries, left);
        let unpinned = PATH.map(|role| PathStage { name: role.name(), core: None });
        let nothing = Latencies::new(0, self.period_ns, &unpinned);
        let latencies = self.latencies.as_ref().unwrap_or(&nothing);
        let lines = judge(&self.figures(plan.kind, &totals, latencies, recoveries), &budgets(config));
        if totals.frames == 0 {
            reasons.push("there were no results".into());
        }
        reasons.extend(lines.iter().filter(|l| l.verdict == Verdict::Fail).map(|l| l.reason()));
        let (_, file_bytes) = self.processes.memory();
        let steadiness = latencies.steadiness();
        let report = SoakReport {
            frames: totals.frames,
            dropped: totals.dropped,
            restarts: totals.restarts,
            failed_restarts: totals.failed_restarts,
            leaked_shm_entries: totals.leaked,
            latency_ms: (&latencies.end_to_end).into(),
            cpu_percent: totals.cpu_percent,
            rss_bytes: totals.memory_bytes.max(0.0) as u64,
            rss_slope_bytes_per_hour: totals.slope.filter(is_long).map(|s| s.per_s * HOUR_S),
            next_result_s_max: recoveries.longest_s(),
            verdict: if reasons.is_empty() { "pass" } else { "fail" },
            reasons,
            kind: plan.kind,
            source: plan.source.clone(),
            fps: config.source.fps,
            minutes: span.seconds / 60.0,
            warm_up_s: config.soak.warm_up_s,
            first_result_s: self
                .first_result_ns
                .map_or(0.0, |first| first.saturating_sub(self.started_ns) as f64 * 1e-9),
            offered: totals.offered,
            lost: totals.offered.saturating_sub(totals.frames).saturating_sub(totals.dropped),
            surplus: (totals.frames + totals.dropped).saturating_sub(totals.offered),
            rate_hz: totals.frames as f64 / span.counted_s,
            faults: recoveries.count(),
            kills: recoveries.kills(),
            seed: plan.faults.map_or(0, |faults| faults.seed),
            rss_slope_interval_bytes_per_hour: totals
                .slope
                .filter(is_long)
                .map(|s| [s.low_per_s * HOUR_S, s.high_per_s * HOUR_S]),
            shared_bytes: self.shared_bytes,
            shared_reserved_bytes: self.reserved_bytes,
            file_bytes,
            shm_entries: [entries_before, self.entries.greatest(0.0).unwrap_or(0.0) as u64, left],
            cpu_cores: totals.cpu_cores,
            latency_less_stalls_ms: (&latencies.less_stalls).into(),
            latency_disturbed_ms: (&latencies.disturbed).into(),
            judged_frames: [latencies.end_to_end.count(), latencies.disturbed.count()],
            unsound: latencies.unsound,
            traced: latencies.count(),
            repeated: latencies.repeated,
            jitter_ms: (&latencies.jitter).into(),
            period_mean_ms: steadiness.mean_ms,
            period_spread: steadiness.spread,
            longest_gap_ms: latencies.longest_gap_ns as f64 * 1e-6,
            stages: StageRow::all(latencies),
            processes: self.process_rows(&span),
            fault_rows: recoveries.rows(),
            worst: recoveries.worst().to_vec(),
            stalls: self.stalls.figures().iter().map(|f| StallRow::new(f, span.seconds)).collect(),
            budgets: lines,
            settings: plan.settings.clone(),
            machine: self.machine(totals.cpu_percent),
        };
        let rate = self.rate_run(config, &report, &span);
        let plots = self.plots(config, latencies, recoveries, plan.kind);
        let device_p50_ms = (self.device_time.count() > 0).then(|| self.device_time.percentile_ms(50.0));
        Soaked { report, plots, rate, device: self.device, device_p50_ms, clocks_mhz: self.clocks_mhz }
    }

    fn span(&self) -> Span {
        let base_ns = self.base.as_ref().map_or(self.end_ns, |base| base.at_ns);
        let base = self.base.clone().map_or_else(Counts::default, |base| base.counts);
        Span {
            base,
            from_s: base_ns.saturating_sub(self.started_ns) as f64 * 1e-9,
            seconds: (self.end_ns.saturating_sub(base_ns) as f64 * 1e-9).max(1e-9),
            counted_s: (self.status_ns.saturating_sub(base_ns) as f64 * 1e-9).max(1e-9),
        }
    }

    /// Change of a counter of a role since the end of the warm-up; `field` as in [`Counts::roles`].
    fn since(&self, span: &Span, role: Role, field: usize) -> u64 {
        let i = role as usize;
        self.counts.roles[i][field].saturating_sub(span.base.roles[i][field])
    }

    /// Processor time of a role since the end of the warm-up, in cores.
    fn cpu_cores(&self, span: &Span, role: Role) -> f64 {
        let before = self.base.as_ref().map_or(0, |base| base.cpu_ns[role as usize]);
        self.processes.cpu_ns(role).saturating_sub(before) as f64 * 1e-9 / span.seconds
    }

    fn totals(&self, span: &Span, recoveries: &Recoveries, left: u64) -> Totals {
        let cores = std::thread::available_parallelism().map_or(1, usize::from);
        let restarts: u64 = Role::STAGES.iter().map(|&role| self.since(span, role, 3)).sum();
        let cpu_cores: f64 = Role::ALL.into_iter().map(|role| self.cpu_cores(span, role)).sum();
        let rise = self.entries.floor_rise(span.from_s).unwrap_or(0.0).max(0.0) as u64;
        Totals {
            frames: self.counts.frames.saturating_sub(span.base.frames),
            offered: self.since(span, Role::SOURCE, 0),
            dropped: Role::STAGES.iter().map(|&role| self.since(span, role, 1)).sum(),
            restarts,
            failed_restarts: recoveries.failures() + restarts.saturating_sub(recoveries.expected_restarts()),
            leaked: left + rise,
            memory_bytes: self.memory.greatest(span.from_s).unwrap_or(f64::NAN),
            // Pages of a pool become resident when they are first written, up to the reserved size: that is not
            // growth. Reserved and private memory could grow without bound.
            slope: self.growing.slope(span.from_s),
            cpu_cores,
            cpu_percent: cpu_cores / cores as f64 * 100.0,
        }
    }

    /// The values that are compared with the budgets.
    fn figures(
        &self,
        kind: Kind,
        totals: &Totals,
        latencies: &Latencies,
        recoveries: &Recoveries,
    ) -> Figures {
        let stereo = &latencies.stages[1];
        let age_slope = latencies.age_trend.slope(0.0).filter(|s| s.span_s >= 20.0);
        Figures {
            kind,
            frames: totals.frames,
            judged_frames: latencies.end_to_end.count(),
            memory_bytes: totals.memory_bytes,
            slope: totals.slope.map(|s| (s.per_s * HOUR_S, s.span_s)),
            faults: recoveries.count(),
            next_result_s: recoveries.longest_s(),
            failed_restarts: totals.failed_restarts,
            leaked_entries: totals.leaked,
            latency_p50_ms: or_nan(&latencies.end_to_end, 50.0),
            latency_p99_ms: or_nan(&latencies.less_stalls, 99.0),
            latency_p999_ms: or_nan(&latencies.less_stalls, 99.9),
            cpu_percent: totals.cpu_percent,
            processed_percent: match totals.offered {
                0 => 0.0,
                offered => totals.frames as f64 / offered as f64 * 100.0,
            },
            age_p99_ms: or_nan(&stereo.wait, 99.0),
            age_bound_ms: self.period_ns as f64 * 1e-6 + stereo.work.percentile_ms(50.0),
            age_growth_ms: age_slope.map(|s| s.per_s * s.span_s),
        }
    }

    /// The processes that were running at the end.
    fn process_rows(&self, span: &Span) -> Vec<ProcessRow> {
        let process = |role: Role| {
            let i = role as usize;
            let since = |field: usize| self.since(span, role, field);
            let own = self.role_memory[i].slope(span.from_s).filter(is_long).filter(|_| since(3) == 0);
            ProcessRow {
                role: role.name().into(),
                core: self.cores[i],
                policy: self.processes.reading(role).policy(),
                cpu_percent: self.cpu_cores(span, role) * 100.0,
                private_bytes: self.role_memory[i].greatest(span.from_s).unwrap_or(0.0) as u64,
                slope_bytes_per_hour: own.map(|s| s.per_s * HOUR_S),
                frames: since(0),
                skipped: since(1),
                refused: since(2),
                restarts: since(3) as u32,
            }
        };
        let is_running = |role: &Role| self.processes.pid(*role).is_some();
        Role::ALL.into_iter().filter(is_running).map(process).collect()
    }

    /// The machine, and its load by other processes since the warm-up.
    fn machine(&self, cpu_percent: f64) -> Machine {
        let machine = self
            .base
            .as_ref()
            .map_or_else(MachineTime::default, |base| MachineTime::now().since(&base.machine));
        let whole = machine.total.max(1) as f64;
        Machine {
            processor: processor(),
            cores: std::thread::available_parallelism().map_or(1, usize::from),
            kernel: read_line("/proc/sys/kernel/osrelease"),
            others_cpu_percent: (machine.busy as f64 / whole * 100.0 - cpu_percent).max(0.0),
            stolen_percent: machine.stolen as f64 / whole * 100.0,
            load: read_line("/proc/loadavg").split(' ').next().and_then(|v| v.parse().ok()).unwrap_or(0.0),
            probe_policy: self.probe_policy.clone(),
        }
    }

    /// The row in the paper's tables.
    fn rate_run(&self, config: &Config, report: &SoakReport, span: &Span) -> RateRun {
        let (from_s, seconds) = (span.from_s, span.seconds);
        let total = memory_total_bytes().max(1) as f64;
        // Means over each fifth of the run.
        let part = |i: usize| {
            let (from, to) = (from_s + seconds / 5.0 * i as f64, from_s + seconds / 5.0 * (i + 1) as f64);
            let sum = |trends: &[Trend; Role::COUNT]| {
                AFTER_STEREO.iter().map(|role| trends[*role as usize].mean(from, to)).sum::<Option<f64>>()
            };
            Some((sum(&self.role_cpu)?, sum(&self.role_memory)? / total * 100.0))
        };
        RateRun {
            fps: config.source.fps,
            processed_fps: report.rate_hz,
            cpu_cores: report.cpu_cores,
            capture_cores: self.cpu_cores(span, Role::SOURCE),
            memory_bytes: report.rss_bytes as f64,
            work_p50_ms: report.stages.iter().map(|row| row.work_ms.p50).collect(),
            obstacles: (0..5).filter_map(part).collect(),
        }
    }

    /// The plots: file name, title, plot.
    fn plots(
        &self,
        config: &Config,
        latencies: &Latencies,
        recoveries: &Recoveries,
        kind: Kind,
    ) -> Vec<(String, String, Plot)> {
        let c = &config.soak;
        let judged = kind != Kind::Overload;
        let cpu = Plot {
            x_name: MINUTES.into(),
            y_name: "%".into(),
            series: role_series(&self.role_cpu, 1.0),
            ..Plot::default()
        };
        let mut plots = vec![
            ("memory.svg", "Resident memory", self.memory_plot(c.memory_bytes as f64 * 1e-6)),
            (
                "latency.svg",
                "Capture to obstacles",
                latency_plot(latencies, judged.then_some(c.latency_p50_ms)),
            ),
            (
                "percentiles.svg",
                "Capture to obstacles, by percentile",
                percentile_plot(latencies, judged.then_some(c.latency_p999_ms)),
            ),
            ("cpu.svg", "Processor time, percent of one core", cpu),
        ];
        if recoveries.count() > 0 {
            let plot = recovery_plot(recoveries, c.next_result_s);
            plots.push(("recovery.svg", "Time from a fault to the next result", plot));
        }
        plots
            .into_iter()
            .map(|(file, title, plot)| {
                (file.to_owned(), title.to_owned(), Plot { title: title.into(), ..plot })
            })
            .collect()
    }

    fn memory_plot(&self, budget_mb: f64) -> Plot {
        let mut series = vec![line("all", over(&self.memory, 1e-6))];
        series.extend(role_series(&self.role_memory, 1e-6));
        Plot {
            x_name: MINUTES.into(),
            y_name: "MB".into(),
            series,
            limit: Some(("budget of all".into(), budget_mb)),
            ..Plot::default()
        }
    }
}

/// Name of the time axis.
const MINUTES: &str = "minutes since the start";

fn line(name: &str, points: Vec<(f64, f64)>) -> Series {
    Series { name: name.into(), points, dots: false }
}

/// Means of a trend over minutes, scaled.
fn over(trend: &Trend, scale: f64) -> Vec<(f64, f64)> {
    trend.points().map(|p| (p.at_s / 60.0, p.mean * scale)).collect()
}

/// One line for each role that has values.
fn role_series(trends: &[Trend; Role::COUNT], scale: f64) -> Vec<Series> {
    let has_points = |role: &Role| trends[*role as usize].points().next().is_some();
    let series = |role: Role| line(role.name(), over(&trends[role as usize], scale));
    Role::ALL.into_iter().filter(has_points).map(series).collect()
}

fn latency_plot(latencies: &Latencies, budget_ms: Option<f64>) -> Plot {
    let greatest = latencies.trend.points().map(|p| (p.at_s / 60.0, p.greatest)).collect();
    Plot {
        x_name: MINUTES.into(),
        y_name: "ms".into(),
        series: vec![line("mean", over(&latencies.trend, 1.0)), line("maximum", greatest)],
        limit: budget_ms.map(|ms| ("budget of the median".into(), ms)),
        ..Plot::default()
    }
}

/// The x axis counts nines: 0 is the minimum, 1 the 90th percentile, 2 the 99th, …
fn percentile_plot(latencies: &Latencies, budget_ms: Option<f64>) -> Plot {
    let percentiles = |latency: &Latency| -> Vec<(f64, f64)> {
        (0..=400)
            .map(|i| f64::from(i) * 0.01)
            .map(|nines| (nines, latency.percentile_ms(100.0 - 100.0 * 10_f64.powf(-nines))))
            .collect()
    };
    let marks = [(0.0, "0"), (0.301, "50"), (1.0, "90"), (2.0, "99"), (3.0, "99.9"), (4.0, "99.99")];
    Plot {
        x_name: "percentile".into(),
        y_name: "ms".into(),
        series: vec![
            line("measured", percentiles(&latencies.end_to_end)),
            line("less the machine's stalls", percentiles(&latencies.less_stalls)),
        ],
        limit: budget_ms.map(|ms| ("budget of 99.9 %, less stalls".into(), ms)),
        x_marks: marks.map(|(at, name)| (at, name.to_owned())).to_vec(),
        ..Plot::default()
    }
}

fn recovery_plot(recoveries: &Recoveries, budget_s: f64) -> Plot {
    let points = recoveries.trend.points().map(|p| (p.at_s / 60.0, p.greatest)).collect();
    Plot {
        x_name: "minutes since the first pause".into(),
        y_name: "s".into(),
        series: vec![Series { name: "faults".into(), points, dots: true }],
        limit: Some(("budget".into(), budget_s)),
        ..Plot::default()
    }
}

/// A percentile in milliseconds; NaN without values.
fn or_nan(latency: &Latency, percentile: f64) -> f64 {
    if latency.count() == 0 { f64::NAN } else { latency.percentile_ms(percentile) }
}

fn read_line(path: &str) -> String {
    std::fs::read_to_string(path).unwrap_or_default().trim().to_owned()
}

/// Name of the processor as reported by the kernel, otherwise its architecture.
pub fn processor() -> String {
    let text = read_line("/proc/cpuinfo");
    let named = |name: &str| {
        text.lines()
            .find_map(|l| l.strip_prefix(name)?.trim_start().strip_prefix(':'))
            .map(|v| v.trim().to_owned())
    };
    let model = read_line("/sys/firmware/devicetree/base/model").trim_end_matches('\0').to_owned();
    match named("model name").filter(|n| !n.is_empty()) {
        Some(name) => name,
        None if !model.is_empty() => model,
        None => named("Hardware").unwrap_or_else(|| std::env::consts::ARCH.into()),
    }
}

fn memory_total_bytes() -> u64 {
    let text = std::fs::read_to_string("/proc/meminfo").unwrap_or_default();
    let line = text.lines().find_map(|l| l.strip_prefix("MemTotal:")).unwrap_or_default();
    line.split_ascii_whitespace().next().and_then(|v| v.parse::<u64>().ok()).unwrap_or(0) * 1024
}
