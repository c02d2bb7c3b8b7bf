//! The result of the standard tests: each run, and a table by row and speed.

use super::rules::{AlarmDue, Due, TEXT, Verdict};
use crate::evaluation::quantile;
use serde::Serialize;
use std::fmt;

/// Failed runs that are printed; all are in the JSON document.
const MAX_PRINTED: usize = 60;

/// Why runs are not judged.
pub const NOT_JUDGED: &str =
    "as half of the target comes into both pictures, or moves as it will, too late for any rule";

/// When something happened first, as time until the impact, or until the target is passed, in seconds.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct FirstTimes {
    /// At least half of the target is visible in both pictures.
    pub visible: Option<f64>,
    /// The danger can be known: it is visible and moves as it will.
    pub known: Option<f64>,
    /// A region is where it is.
    pub detected: Option<f64>,
    /// A confirmed track is where it is.
    pub tracked: Option<f64>,
    /// A warning, or an alarm without one before, because of it.
    pub warning: Option<f64>,
    /// An alarm because of it.
    pub alarm: Option<f64>,
    /// A warning or an alarm because of something else.
    pub other: Option<f64>,
    /// The alarm was off.
    pub off: Option<f64>,
}

/// One run.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Run {
    /// Its name; that of its scene file.
    pub id: String,
    /// Name and variant of the row.
    pub row: String,
    /// What happens.
    pub title: String,
    /// Our speed, in km/h.
    pub own_km_h: f64,
    /// Overlap or place of impact, in per cent of our width.
    pub place_percent: i32,
    /// The near miss, if it is one.
    pub miss: Option<String>,
    /// Weather.
    pub weather: String,
    /// Seed.
    pub seed: u64,
    /// Whether the warning alone is tested, whose TTC is a protocol's.
    pub is_warning_only: bool,
    /// What was asked for; `null` for a near miss.
    pub due: Option<Due>,
    /// What happened first.
    pub ttc_s: FirstTimes,
    /// Why the alarm was off at first.
    pub off_reason: Option<String>,
    /// The judgement.
    #[serde(flatten)]
    pub verdict: Verdict,
}

impl Run {
    /// The rules that were asked for, in short; see [`TEXT`].
    pub fn rules(&self) -> String {
        let Some(due) = self.due else { return "silent".into() };
        let warning = match (due.warning, self.is_warning_only) {
            (true, true) => Some("w1.7*"),
            (true, false) => Some("w1.7"),
            (false, _) => None,
        };
        let alarm = match due.alarm.filter(|_| !self.is_warning_only) {
            Some(AlarmDue::Avoid) => Some("avoid"),
            Some(AlarmDue::Halve) => Some("halve"),
            None => None,
        };
        let parts: Vec<&str> = warning.into_iter().chain(alarm).collect();
        if parts.is_empty() { "-".into() } else { parts.join("+") }
    }
}

/// A line of the table: the runs of a row at a speed in a weather.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Line {
    /// Name and variant of the row.
    pub row: String,
    /// What happens.
    pub title: String,
    /// The near miss, if it is one.
    pub miss: Option<String>,
    /// Weather.
    pub weather: String,
    /// Our speed, in km/h.
    pub own_km_h: f64,
    /// What was asked for in its runs.
    pub rules: Vec<String>,
    /// Runs.
    pub runs: usize,
    /// Runs in which anything can be asked for.
    pub judged: usize,
    /// Runs that passed.
    pub passed: usize,
    /// Median TTC of the warnings, in seconds.
    pub warning_ttc_s: Option<f64>,
    /// Median TTC of the alarms, in seconds.
    pub alarm_ttc_s: Option<f64>,
    /// Greatest speed at the impact with braking from the alarm on, in km/h.
    pub impact_km_h: f64,
    /// The same without braking.
    pub free_impact_km_h: f64,
}

/// A sum of runs.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Sum {
    /// Weather.
    pub weather: String,
    /// Runs that passed, and that were judged.
    pub runs: (usize, usize),
    /// Lines, a row at a speed, all judged runs of which passed, and that have one.
    pub lines: (usize, usize),
}

/// What the runs have in common.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Setup {
    /// Protocol.
    pub year: u16,
    /// Cameras.
    pub rig: String,
    /// Pairs per second.
    pub fps: f64,
    /// First and last seed.
    pub seeds: (u64, u64),
}

/// The result.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct NcapReport {
    /// What the runs have in common.
    #[serde(flatten)]
    pub setup: Setup,
    /// The rules in words.
    pub rules: String,
    /// Sums of the impacts, by weather.
    pub sums: Vec<Sum>,
    /// Sums of the near misses, by weather.
    pub near_miss_sums: Vec<Sum>,
    /// The impacts by row, weather and speed.
    pub table: Vec<Line>,
    /// The near misses by row, near miss, weather and speed.
    pub near_misses: Vec<Line>,
    /// All runs.
    pub runs: Vec<Run>,
}

impl NcapReport {
    /// The report of some runs.
    pub fn new(setup: Setup, runs: Vec<Run>) -> Self {
        let (hits, misses): (Vec<&Run>, Vec<&Run>) = runs.iter().partition(|run| run.miss.is_none());
        let (table, near_misses) = (lines(&hits), lines(&misses));
        Self {
            sums: sums(&table),
            near_miss_sums: sums(&near_misses),
            table,
            near_misses,
            rules: TEXT.into(),
            setup,
            runs,
        }
    }
}

impl NcapReport {
    fn write_table(&self, f: &mut fmt::Formatter<'_>, width: usize) -> fmt::Result {
        writeln!(
            f,
            "{:<width$} {:<10} {:>4} {:>7} {:<22} {:>9} {:>8} {:>12} {:>10}",
            "row", "weather", "km/h", "passed", "rules", "warning s", "alarm s", "impact km/h", "unbraked"
        )?;
        for line in &self.table {
            writeln!(
                f,
                "{:<width$} {:<10} {:>4} {:>7} {:<22} {:>9} {:>8} {:>12.0} {:>10.0}",
                line.row,
                line.weather,
                line.own_km_h,
                if line.judged > 0 { format!("{}/{}", line.passed, line.judged) } else { "-".into() },
                line.rules.join(" "),
                seconds(line.warning_ttc_s),
                seconds(line.alarm_ttc_s),
                line.impact_km_h,
                line.free_impact_km_h
            )?;
        }
        for sum in &self.sums {
            writeln!(f, "passed, {sum}")?;
        }
        Ok(())
    }

    fn write_near_misses(&self, f: &mut fmt::Formatter<'_>, width: usize) -> fmt::Result {
        writeln!(f, "\n{:<width$} {:<10} {:>4} {:>7} near miss", "row", "weather", "km/h", "silent")?;
        for line in &self.near_misses {
            let silent = format!("{}/{}", line.passed, line.judged);
            let miss = line.miss.as_deref().unwrap_or("");
            writeln!(f, "{:<width$} {:<10} {:>4} {silent:>7} {miss}", line.row, line.weather, line.own_km_h)?;
        }
        for sum in &self.near_miss_sums {
            writeln!(f, "silent, {sum}")?;
        }
        Ok(())
    }

    /// Rows, with speed and weather, in no run of which anything can be asked for.
    pub fn not_judged(&self) -> Vec<String> {
        let lines = self.table.iter().filter(|line| line.judged == 0);
        lines.map(|line| format!("{} at {} km/h, {}", line.row, line.own_km_h, line.weather)).collect()
    }
}

/// The lines of some runs, in the order of the first run of each.
fn lines(runs: &[&Run]) -> Vec<Line> {
    let mut groups: Vec<Vec<&Run>> = Vec::new();
    let key = |run: &Run| (run.row.clone(), run.miss.clone(), run.weather.clone(), run.own_km_h.to_bits());
    for run in runs {
        match groups.iter_mut().find(|group| key(group[0]) == key(run)) {
            Some(group) => group.push(run),
            None => groups.push(vec![run]),
        }
    }
    groups.iter().map(|group| line(group)).collect()
}

fn line(runs: &[&Run]) -> Line {
    let median = |of: fn(&Run) -> Option<f64>| {
        let mut values: Vec<f64> = runs.iter().filter_map(|run| of(run)).collect();
        quantile(&mut values, 0.5)
    };
    let most = |of: fn(&Run) -> f64| 3.6 * runs.iter().map(|run| of(run)).fold(0.0, f64::max);
    let mut rules: Vec<String> = runs.iter().map(|run| run.rules()).collect();
    rules.sort();
    rules.dedup();
    let first = runs[0];
    Line {
        row: first.row.clone(),
        title: first.title.clone(),
        miss: first.miss.clone(),
        weather: first.weather.clone(),
        own_km_h: first.own_km_h,
        rules,
        runs: runs.len(),
        judged: runs.iter().filter(|run| run.verdict.passed.is_some()).count(),
        passed: runs.iter().filter(|run| run.verdict.passed == Some(true)).count(),
        warning_ttc_s: median(|run| run.ttc_s.warning),
        alarm_ttc_s: median(|run| run.ttc_s.alarm),
        impact_km_h: most(|run| run.verdict.impact_m_s),
        free_impact_km_h: most(|run| run.verdict.free_impact_m_s),
    }
}

fn sums(table: &[Line]) -> Vec<Sum> {
    let mut weathers: Vec<&str> = Vec::new();
    for line in table {
        if !weathers.contains(&&line.weather[..]) {
            weathers.push(&line.weather);
        }
    }
    let sum = |weather: &str| {
        let own = table.iter().filter(|line| line.weather == weather && line.judged > 0);
        let add = |sum: Sum, line: &Line| Sum {
            runs: (sum.runs.0 + line.passed, sum.runs.1 + line.judged),
            lines: (sum.lines.0 + usize::from(line.passed == line.judged), sum.lines.1 + 1),
            ..sum
        };
        own.fold(Sum { weather: weather.into(), ..Sum::default() }, add)
    };
    weathers.into_iter().map(sum).collect()
}

/// A time, or `-`.
pub fn seconds(time: Option<f64>) -> String {
    time.map_or("-".into(), |s| format!("{s:.2}"))
}

fn percent((part, whole): (usize, usize)) -> String {
    match whole {
        0 => "none".into(),
        _ => format!("{part} of {whole} ({:.0} %)", 100.0 * part as f64 / whole as f64),
    }
}

impl fmt::Display for Sum {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: runs {}, rows at a speed {}", self.weather, percent(self.runs), percent(self.lines))
    }
}

impl Run {
    /// The run, why it failed, and what happened when.
    pub fn explanation(&self) -> String {
        let FirstTimes { visible, known, detected, tracked, warning, alarm, .. } = self.ttc_s;
        let mut text = format!("{}: {}", self.id, self.verdict.reasons.join("; "));
        if self.miss.is_none() {
            text += &format!(
                " (TTC visible {}, known {}, detected {}, tracked {}, warning {}, alarm {})",
                seconds(visible),
                seconds(known),
                seconds(detected),
                seconds(tracked),
                seconds(warning),
                seconds(alarm)
            );
        }
        if let (Some(reason), Some(off)) = (&self.off_reason, self.ttc_s.off) {
            text += &format!("; alarm off at TTC {off:.2}: {reason}");
        }
        text
    }
}

impl fmt::Display for NcapReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Setup { year, rig, fps, seeds: (from, to) } = &self.setup;
        writeln!(f, "{year} tests, rig {rig}, {fps} pairs/s, seeds {from}-{to}\n{}\n", self.rules)?;
        let width = self.table.iter().chain(&self.near_misses).map(|line| line.row.chars().count());
        let width = width.max().unwrap_or(0).max("row".len());
        if !self.table.is_empty() {
            self.write_table(f, width)?;
        }
        if !self.near_misses.is_empty() {
            self.write_near_misses(f, width)?;
        }
        let failed = || self.runs.iter().filter(|run| run.verdict.passed == Some(false));
        if failed().next().is_some() {
            writeln!(f, "\nFailed:")?;
        }
        for run in failed().take(MAX_PRINTED) {
            writeln!(f, "  {}", run.explanation())?;
        }
        let more = failed().count().saturating_sub(MAX_PRINTED);
        if more > 0 {
            writeln!(f, "  and {more} more: --json and --out have all")?;
        }
        let not_judged = self.not_judged();
        if !not_judged.is_empty() {
            writeln!(f, "\nNot judged, {NOT_JUDGED}: {}", not_judged.join("; "))?;
        }
        Ok(())
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    /// A run of a row at 30 km/h.
    pub fn run(row: &str, passed: Option<bool>, warning: Option<f64>) -> Run {
        let reasons = if passed == Some(true) { Vec::new() } else { vec!["warning late <1.7 s".into()] };
        Run {
            id: format!("{row}-30"),
            row: row.into(),
            own_km_h: 30.0,
            weather: "sunny".into(),
            due: Some(Due { warning: true, alarm: Some(AlarmDue::Avoid) }),
            ttc_s: FirstTimes { warning, ..FirstTimes::default() },
            verdict: Verdict { passed, reasons, impact_m_s: 2.5, ..Verdict::default() },
            ..Run::default()
        }
    }

    /// A report of impacts and near misses.
    pub fn report() -> NcapReport {
        let miss =
            |passed| Run { miss: Some("stops before".into()), due: None, ..run("CPNA", Some(passed), None) };
        let runs = vec![
            run("CCRs", Some(true), Some(2.5)),
            run("CCRs", Some(true), Some(2.7)),
            run("CPNA", Some(true), Some(2.0)),
            run("CPNA", Some(false), Some(1.1)),
            run("CBFA", None, None),
            miss(true),
            miss(false),
        ];
        NcapReport::new(Setup { year: 2026, rig: "paper".into(), fps: 12.5, seeds: (1, 2) }, runs)
    }

    #[test]
    fn lines_and_sums_count_what_is_judged() {
        let report = report();
        let counts: Vec<_> =
            report.table.iter().map(|line| (&line.row[..], line.runs, line.judged, line.passed)).collect();
        assert_eq!(counts, [("CCRs", 2, 2, 2), ("CPNA", 2, 2, 1), ("CBFA", 1, 0, 0)]);
        assert_eq!((report.sums[0].runs, report.sums[0].lines), ((3, 4), (1, 2)));
        assert_eq!(report.near_miss_sums[0].runs, (1, 2));
        let text = report.to_string();
        for part in
            ["passed, sunny: runs 3 of 4 (75 %), rows at a speed 1 of 2 (50 %)", "w1.7+avoid", "Failed:"]
        {
            assert!(text.contains(part), "{part}: {text}");
        }
        assert!(
            text.contains("silent, sunny: runs 1 of 2")
                && text.contains("too late for any rule: CBFA at 30 km/h, sunny"),
            "{text}"
        );
        let json = serde_json::to_value(&report).unwrap();
        assert_eq!(json["runs"][3]["passed"], false);
        assert_eq!(json["runs"][3]["due"]["alarm"], "avoid");
        assert_eq!(json["table"][1]["impact_km_h"], 9.0);
        assert!(json["runs"][4]["passed"].is_null());
    }

    #[test]
    fn the_rules_of_a_run_are_named() {
        let mut run = run("CCRs-FCW", Some(true), Some(2.0));
        assert_eq!(run.rules(), "w1.7+avoid");
        run.is_warning_only = true;
        assert_eq!(run.rules(), "w1.7*");
        run.due = Some(Due { warning: false, alarm: None });
        assert_eq!(run.rules(), "-");
        run.due = None;
        assert_eq!(run.rules(), "silent");
    }
}
