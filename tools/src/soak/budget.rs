//! Budgets of a soak run, and the verdict on them.

use serde::Serialize;
use std::fmt;

/// Minimum time span for judging a memory slope, in seconds: extrapolated from a shorter one to an hour, every
/// page would look like a leak.
pub const SLOPE_SPAN_S: f64 = 240.0;

/// Resource budgets of a run: `[soak]` of the configuration.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Budgets {
    /// Resident memory of all processes, with shared memory and executable counted once.
    pub memory_bytes: f64,
    /// Growth of that memory.
    pub slope_bytes_per_hour: f64,
    /// Time from a fault to the next result.
    pub next_result_s: f64,
    /// Median latency from capture to result.
    pub latency_p50_ms: f64,
    /// 99th percentile of the latency minus the machine's own stalls.
    pub latency_p99_ms: f64,
    /// 99.9th percentile of the latency minus the machine's own stalls.
    pub latency_p999_ms: f64,
    /// CPU usage of all processes, in percent of all cores.
    pub cpu_percent: f64,
    /// Minimum of results per offered pair.
    pub processed_percent: f64,
    /// Entries left in shared memory.
    pub leaked_entries: u64,
    /// Restarts that failed.
    pub failed_restarts: u64,
}

/// Load of the run, which determines the applicable budgets.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Kind {
    /// A sustainable rate.
    #[default]
    Steady,
    /// A sustainable rate with fault injection.
    Faults,
    /// Twice the sustainable rate.
    Overload,
}

/// Measurements of a run.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Figures {
    /// Load of the run.
    pub kind: Kind,
    /// Number of results.
    pub frames: u64,
    /// Number of frames with judged latency: those not affected by a fault.
    pub judged_frames: u64,
    /// See [`Budgets::memory_bytes`].
    pub memory_bytes: f64,
    /// Growth in bytes per hour, and the time span of its points in seconds.
    pub slope: Option<(f64, f64)>,
    /// Number of injected faults.
    pub faults: u64,
    /// Longest time from a fault to the next result.
    pub next_result_s: f64,
    /// See [`Budgets::failed_restarts`].
    pub failed_restarts: u64,
    /// See [`Budgets::leaked_entries`].
    pub leaked_entries: u64,
    /// See [`Budgets::latency_p50_ms`].
    pub latency_p50_ms: f64,
    /// See [`Budgets::latency_p99_ms`].
    pub latency_p99_ms: f64,
    /// See [`Budgets::latency_p999_ms`].
    pub latency_p999_ms: f64,
    /// See [`Budgets::cpu_percent`].
    pub cpu_percent: f64,
    /// See [`Budgets::processed_percent`].
    pub processed_percent: f64,
    /// 99th percentile of the age of frames at the start of stereo, in milliseconds.
    pub age_p99_ms: f64,
    /// Bound of that age under overload: one period plus the median processing time of stereo.
    pub age_bound_ms: f64,
    /// Growth of the age over the run, in milliseconds.
    pub age_growth_ms: Option<f64>,
}

/// Verdict on one budget.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Verdict {
    /// Within the budget.
    Pass,
    /// Exceeded.
    Fail,
    /// Not applicable to this run.
    NotJudged,
}

impl fmt::Display for Verdict {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Pass => "pass",
            Self::Fail => "FAIL",
            Self::NotJudged => "not judged",
        })
    }
}

/// A budget with its measurement.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Line {
    /// The key of the budget.
    pub name: &'static str,
    /// Description.
    pub what: &'static str,
    /// Unit of limit and measurement.
    pub unit: &'static str,
    /// Limit.
    pub limit: f64,
    /// Whether the limit is a minimum rather than a maximum.
    pub at_least: bool,
    /// Measured value; `None` without a measurement.
    pub measured: Option<f64>,
    /// Verdict.
    pub verdict: Verdict,
    /// Why it is not judged.
    pub why: &'static str,
}

impl Line {
    /// One sentence for the reasons of a failed run.
    pub fn reason(&self) -> String {
        let measured = self.measured.unwrap_or(f64::NAN);
        let bound = if self.at_least { "at least" } else { "at most" };
        format!(
            "{}: {measured:.6} {}, budget {bound} {} (soak.{})",
            self.what, self.unit, self.limit, self.name
        )
    }
}

const FAULTY: &str = "restarts are part of this run";
const OVERLOADED: &str = "more is offered than can be done";

/// A line whose budget is an upper limit; `not_judged` says why it does not count.
fn at_most(
    (name, what, unit): (&'static str, &'static str, &'static str),
    limit: f64,
    measured: f64,
    not_judged: Option<&'static str>,
) -> Line {
    let verdict = match not_judged {
        Some(_) => Verdict::NotJudged,
        // NaN compares false and so fails.
        None if measured <= limit => Verdict::Pass,
        None => Verdict::Fail,
    };
    let why = not_judged.unwrap_or_default();
    Line { name, what, unit, limit, at_least: false, measured: Some(measured), verdict, why }
}

/// Judges a run, budget by budget.
pub fn judge(f: &Figures, b: &Budgets) -> Vec<Line> {
    let steady_only = match f.kind {
        Kind::Steady => None,
        Kind::Faults => Some(FAULTY),
        Kind::Overload => Some(OVERLOADED),
    };
    let growth = match f.slope {
        Some((_, span_s)) if span_s >= SLOPE_SPAN_S => None,
        _ => Some("too short a run: its samples must span four minutes"),
    };
    let slope = f.slope.map(|(slope, _)| slope);
    let processed = Line {
        at_least: true,
        verdict: match steady_only {
            Some(_) => Verdict::NotJudged,
            None if f.processed_percent >= b.processed_percent => Verdict::Pass,
            None => Verdict::Fail,
        },
        ..at_most(
            ("processed_percent", "results per offered pair", "%"),
            b.processed_percent,
            f.processed_percent,
            steady_only,
        )
    };
    let mut lines = vec![
        at_most(
            ("failed_restarts", "restarts that failed", ""),
            b.failed_restarts as f64,
            f.failed_restarts as f64,
            None,
        ),
        at_most(
            ("leaked_entries", "entries left in shared memory", ""),
            b.leaked_entries as f64,
            f.leaked_entries as f64,
            None,
        ),
        at_most(
            ("next_result_s", "longest time from a fault to the next result", "s"),
            b.next_result_s,
            f.next_result_s,
            (f.faults == 0).then_some("no fault was made"),
        ),
        at_most(
            ("memory_bytes", "resident memory, all processes", "bytes"),
            b.memory_bytes,
            f.memory_bytes,
            None,
        ),
        Line {
            measured: slope,
            ..at_most(
                ("slope_bytes_per_hour", "growth of private and of reserved shared memory", "bytes/h"),
                b.slope_bytes_per_hour,
                slope.unwrap_or(f64::NAN),
                growth,
            )
        },
    ];
    lines.extend(latency_lines(f, b));
    lines.push(at_most(
        ("cpu_percent", "processor time, of all cores", "%"),
        b.cpu_percent,
        f.cpu_percent,
        steady_only,
    ));
    lines.push(processed);
    if f.kind == Kind::Overload {
        lines.extend(age_lines(f));
    }
    lines
}

fn latency_lines(f: &Figures, b: &Budgets) -> [Line; 3] {
    let not_judged = |frames: u64| match f.kind {
        Kind::Overload => Some(OVERLOADED),
        // A run without any result is judged, and fails.
        _ if f.frames > 0 && f.judged_frames < frames => {
            Some("too few undisturbed frames for this percentile")
        }
        _ => None,
    };
    [
        at_most(
            ("latency_p50_ms", "end to end, median", "ms"),
            b.latency_p50_ms,
            f.latency_p50_ms,
            not_judged(1),
        ),
        at_most(
            ("latency_p99_ms", "end to end, 99 %, less stalls", "ms"),
            b.latency_p99_ms,
            f.latency_p99_ms,
            not_judged(100),
        ),
        at_most(
            ("latency_p999_ms", "end to end, 99.9 %, less stalls", "ms"),
            b.latency_p999_ms,
            f.latency_p999_ms,
            not_judged(1000),
        ),
    ]
}

/// Under overload the age of frames must stay bounded.
fn age_lines(f: &Figures) -> [Line; 2] {
    let short = f.age_growth_ms.is_none().then_some("too short a run");
    [
        at_most(
            ("age", "age of frames when stereo takes them up, 99 %: a period and stereo's median work", "ms"),
            f.age_bound_ms,
            f.age_p99_ms,
            None,
        ),
        at_most(
            ("age_growth", "growth of that age over the run: half of its bound", "ms"),
            f.age_bound_ms / 2.0,
            f.age_growth_ms.unwrap_or(f64::NAN),
            short,
        ),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    const BUDGETS: Budgets = Budgets {
        memory_bytes: 54e6,
        slope_bytes_per_hour: 1_048_576.0,
        next_result_s: 3.0,
        latency_p50_ms: 80.0,
        latency_p99_ms: 120.0,
        latency_p999_ms: 160.0,
        cpu_percent: 37.0,
        processed_percent: 97.0,
        leaked_entries: 0,
        failed_restarts: 0,
    };

    fn good(kind: Kind) -> Figures {
        Figures {
            kind,
            frames: 15_000,
            judged_frames: 14_000,
            memory_bytes: 54e6,
            slope: Some((1_048_576.0, 1000.0)),
            faults: 10,
            next_result_s: 3.0,
            failed_restarts: 0,
            leaked_entries: 0,
            latency_p50_ms: 80.0,
            latency_p99_ms: 120.0,
            latency_p999_ms: 160.0,
            cpu_percent: 37.0,
            processed_percent: 97.0,
            age_p99_ms: 30.0,
            age_bound_ms: 30.0,
            age_growth_ms: Some(15.0),
        }
    }

    fn verdict(lines: &[Line], name: &str) -> Verdict {
        lines.iter().find(|l| l.name == name).unwrap_or_else(|| panic!("no line {name}")).verdict
    }

    #[test]
    fn what_just_keeps_its_budget_passes() {
        let steady = judge(&good(Kind::Steady), &BUDGETS);
        assert!(steady.iter().all(|l| l.verdict == Verdict::Pass), "{steady:#?}");
        assert_eq!(steady.len(), 10);
        for kind in [Kind::Faults, Kind::Overload] {
            assert!(judge(&good(kind), &BUDGETS).iter().all(|l| l.verdict != Verdict::Fail));
        }
    }

    /// Each budget can fail on its own, and fails on NaN.
    #[test]
    fn every_budget_can_fail() {
        type Change = fn(&mut Figures);
        let changes: [(&str, Kind, Change); 12] = [
            ("failed_restarts", Kind::Faults, |f| f.failed_restarts = 1),
            ("leaked_entries", Kind::Faults, |f| f.leaked_entries = 1),
            ("next_result_s", Kind::Faults, |f| f.next_result_s = 3.01),
            ("memory_bytes", Kind::Steady, |f| f.memory_bytes = 54e6 + 1.0),
            ("slope_bytes_per_hour", Kind::Steady, |f| f.slope = Some((1_048_577.0, 240.0))),
            ("latency_p50_ms", Kind::Steady, |f| f.latency_p50_ms = 80.1),
            ("latency_p99_ms", Kind::Steady, |f| f.latency_p99_ms = 120.1),
            ("latency_p999_ms", Kind::Steady, |f| f.latency_p999_ms = 160.1),
            ("cpu_percent", Kind::Steady, |f| f.cpu_percent = 37.1),
            ("processed_percent", Kind::Steady, |f| f.processed_percent = 96.9),
            ("age", Kind::Overload, |f| f.age_p99_ms = 30.1),
            ("age_growth", Kind::Overload, |f| f.age_growth_ms = Some(15.1)),
        ];
        for (name, kind, change) in changes {
            let mut figures = good(kind);
            change(&mut figures);
            let lines = judge(&figures, &BUDGETS);
            for line in &lines {
                assert_eq!(line.verdict == Verdict::Fail, line.name == name, "{name}: {line:?}");
            }
            let failed = lines.iter().find(|l| l.name == name).unwrap();
            assert!(failed.reason().contains(&format!("soak.{name}")), "{}", failed.reason());
        }
        let nan: [(&str, Change); 4] = [
            ("memory_bytes", |f| f.memory_bytes = f64::NAN),
            ("latency_p999_ms", |f| f.latency_p999_ms = f64::NAN),
            ("cpu_percent", |f| f.cpu_percent = f64::NAN),
            ("processed_percent", |f| f.processed_percent = f64::NAN),
        ];
        for (name, change) in nan {
            let mut figures = good(Kind::Steady);
            change(&mut figures);
            assert_eq!(verdict(&judge(&figures, &BUDGETS), name), Verdict::Fail);
        }
    }

    #[test]
    fn what_a_run_cannot_tell_is_not_judged() {
        let lines = judge(&Figures { slope: Some((1e9, 239.0)), ..good(Kind::Steady) }, &BUDGETS);
        assert_eq!(verdict(&lines, "slope_bytes_per_hour"), Verdict::NotJudged);
        let lines =
            judge(&Figures { slope: None, faults: 0, next_result_s: 0.0, ..good(Kind::Steady) }, &BUDGETS);
        assert_eq!(verdict(&lines, "slope_bytes_per_hour"), Verdict::NotJudged);
        assert_eq!(verdict(&lines, "next_result_s"), Verdict::NotJudged);
        let few = Figures { judged_frames: 120, latency_p999_ms: 1e9, ..good(Kind::Faults) };
        let lines = judge(&few, &BUDGETS);
        assert_eq!(verdict(&lines, "latency_p999_ms"), Verdict::NotJudged);
        assert_eq!(verdict(&lines, "latency_p99_ms"), Verdict::Pass);
        assert_eq!(verdict(&lines, "cpu_percent"), Verdict::NotJudged);
        assert_eq!(verdict(&lines, "processed_percent"), Verdict::NotJudged);
    }
}
