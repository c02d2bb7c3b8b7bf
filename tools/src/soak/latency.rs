//! Latency statistics: by stage, end to end, and corrected for the machine's own stalls.

use super::delays::Delays;
use super::stalls::Stalls;
use super::trend::Trend;
use crate::reporting::summary::Latency;
use std::collections::VecDeque;

/// Delay from a result to its evaluation: by then the probes have reported stalls.
const HOLD_NS: u64 = 500_000_000;

/// Maximum number of frames that wait for evaluation; more than a second at any supported rate.
const MAX_HELD: usize = 4096;

/// Time after a recovery during which frames count as disturbed: a new process has cold caches.
const AFTERMATH_NS: u64 = 500_000_000;

/// Trace of one frame, on the monotonic clock.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Trace {
    /// Sequence number.
    pub sequence: u64,
    /// Capture time.
    pub capture_ns: u64,
    /// Start and end of processing in each stage.
    pub stamps: Vec<(u64, u64)>,
}

impl Trace {
    /// Time of the final result.
    pub fn end_ns(&self) -> u64 {
        self.stamps.last().map_or(0, |stamp| stamp.1)
    }

    fn is_consistent(&self) -> bool {
        let mut before = self.capture_ns;
        let in_order = self.stamps.iter().skip(1).all(|&(begin, end)| {
            let is_consistent = before <= begin && begin <= end;
            before = end;
            is_consistent
        });
        in_order && self.capture_ns > 0
    }
}

/// A stage on the path of a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PathStage {
    /// Its name.
    pub name: &'static str,
    /// Its core; `None` = not pinned.
    pub core: Option<u32>,
}

/// Durations of one stage.
#[derive(Clone, Debug)]
pub struct StageTimes {
    /// The stage.
    pub stage: PathStage,
    /// Processing time.
    pub work: Latency,
    /// From the result of the previous stage to the start of processing: transfer, and waiting for the previous
    /// frame.
    pub wait: Latency,
    /// Sum of both, for the typical duration.
    both: Latency,
    /// How long its process waited for its core.
    pub delays: Delays,
}

impl StageTimes {
    fn new(stage: PathStage) -> Self {
        Self {
            stage,
            work: Latency::new(),
            wait: Latency::new(),
            both: Latency::new(),
            delays: Delays::default(),
        }
    }
}

/// Latency statistics of a run.
#[derive(Clone, Debug)]
pub struct Latencies {
    /// By stage, from the source on.
    pub stages: Vec<StageTimes>,
    /// From capture to result.
    pub end_to_end: Latency,
    /// The same minus the machine's stalls.
    pub less_stalls: Latency,
    /// From capture to result for frames affected by a fault or its aftermath; they are excluded from all other
    /// statistics.
    pub disturbed: Latency,
    /// Latency from capture to result over time, in milliseconds.
    pub trend: Trend,
    /// The same for the age of frames at the start of stereo.
    pub age_trend: Trend,
    /// Deviation of the interval between results from the period.
    pub jitter: Latency,
    /// The longest interval between consecutive results without faults, in nanoseconds.
    pub longest_gap_ns: u64,
    /// Sum, sum of squares (both in seconds) and number of intervals between results.
    intervals: (f64, f64, u64),
    /// Frames with inconsistent timestamps.
    pub unsound: u64,
    /// Results of a frame that has had one: it was repeated after a stage died. The daemon does not count them either.
    pub repeated: u64,
    last_added: Option<u64>,
    held: VecDeque<Trace>,
    /// Faults with the end of their aftermath.
    faults: VecDeque<(u64, u64)>,
    last: Option<Trace>,
    start_ns: u64,
    period_ns: u64,
}

/// Regularity of the results.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Steadiness {
    /// Mean interval between results, in milliseconds.
    pub mean_ms: f64,
    /// Standard deviation of the interval relative to the period.
    pub spread: f64,
}

impl Latencies {
    /// Statistics of a run that starts at `start_ns` with a pair every `period_ns`, which passes `stages`.
    pub fn new(start_ns: u64, period_ns: u64, stages: &[PathStage]) -> Self {
        Self {
            stages: stages.iter().copied().map(StageTimes::new).collect(),
            end_to_end: Latency::new(),
            less_stalls: Latency::new(),
            disturbed: Latency::new(),
            trend: Trend::new(1.0),
            age_trend: Trend::new(1.0),
            jitter: Latency::new(),
            longest_gap_ns: 0,
            intervals: (0.0, 0.0, 0),
            unsound: 0,
            repeated: 0,
            last_added: None,
            held: VecDeque::with_capacity(64),
            faults: VecDeque::new(),
            last: None,
            start_ns,
            period_ns,
        }
    }

    /// Adds a frame with a final result.
    pub fn add(&mut self, trace: Trace, stalls: &Stalls) {
        if self.last_added.replace(trace.sequence) == Some(trace.sequence) {
            self.repeated += 1;
            return;
        }
        if !trace.is_consistent() {
            self.unsound += 1;
            return;
        }
        if self.held.len() >= MAX_HELD
            && let Some(oldest) = self.held.pop_front()
        {
            self.judge(&oldest, stalls);
        }
        self.held.push_back(trace);
    }

    /// Marks frames between these times as disturbed by a fault.
    pub fn disturb(&mut self, from_ns: u64, recovered_ns: u64) {
        if self.faults.len() >= 64 {
            self.faults.pop_front();
        }
        self.faults.push_back((from_ns, recovered_ns.saturating_add(AFTERMATH_NS)));
    }

    /// Evaluates the frames whose delay is over; `open_fault_ns` is the start of a fault whose recovery is pending.
    pub fn settle(&mut self, now_ns: u64, open_fault_ns: Option<u64>, stalls: &Stalls) {
        if let Some(from_ns) = open_fault_ns {
            self.disturb(from_ns, now_ns);
        }
        while self.held.front().is_some_and(|t| t.end_ns().saturating_add(HOLD_NS) <= now_ns) {
            if let Some(trace) = self.held.pop_front() {
                self.judge(&trace, stalls);
            }
        }
        if open_fault_ns.is_some() {
            // Its end will be reported.
            self.faults.pop_back();
        }
    }

    fn is_disturbed(&self, from_ns: u64, to_ns: u64) -> bool {
        self.faults.iter().any(|&(begin, end)| begin <= to_ns && from_ns <= end)
    }

    fn judge(&mut self, trace: &Trace, stalls: &Stalls) {
        let total_ns = trace.end_ns() - trace.capture_ns;
        let last = self.last.replace(trace.clone());
        if self.is_disturbed(trace.capture_ns, trace.end_ns()) {
            self.disturbed.add_ns(total_ns);
            return;
        }
        let at_s = trace.end_ns().saturating_sub(self.start_ns) as f64 * 1e-9;
        self.end_to_end.add_ns(total_ns);
        self.trend.add(at_s, total_ns as f64 * 1e-6);
        let (begin, end) = trace.stamps[0];
        self.stages[0].work.add_ns(end.saturating_sub(begin));
        let age_ns = trace.stamps[1].0 - trace.capture_ns;
        self.age_trend.add(at_s, age_ns as f64 * 1e-6);
        let mut before = trace.capture_ns;
        let mut stalled_ns = 0;
        for (i, stage) in self.stages.iter_mut().enumerate().skip(1) {
            let (begin, end) = trace.stamps[i];
            stage.wait.add_ns(begin - before);
            stage.work.add_ns(end - begin);
            // A stall accounts for at most the excess over the typical duration: normal processing is not a stall,
            // even if the probe had to wait for it.
            let usual_ns = (stage.both.percentile_ms(50.0) * 1e6) as u64;
            let beyond_ns = (end - before).saturating_sub(usual_ns);
            // Nor does it account for more than the scheduling delay of the stage: otherwise the stage was slow,
            // and the probe waited for it.
            let waited_ns = stage.delays.between_ns(before, end).unwrap_or(u64::MAX);
            stalled_ns += stalls.overlap_ns(stage.stage.core, before, end).min(beyond_ns).min(waited_ns);
            stage.both.add_ns(end - before);
            before = end;
        }
        self.less_stalls.add_ns(total_ns - stalled_ns.min(total_ns));
        let Some(last) = last.filter(|l| !self.is_disturbed(l.capture_ns, l.end_ns())) else { return };
        let interval_ns = trace.end_ns().saturating_sub(last.end_ns());
        self.longest_gap_ns = self.longest_gap_ns.max(interval_ns);
        let seconds = interval_ns as f64 * 1e-9;
        self.intervals.0 += seconds;
        self.intervals.1 += seconds * seconds;
        self.intervals.2 += 1;
        // An interval across a dropped frame is compared with twice the period; the drop is counted separately.
        let steps = trace.sequence.saturating_sub(last.sequence).max(1);
        self.jitter.add_ns(interval_ns.abs_diff(steps.saturating_mul(self.period_ns)));
    }

    /// Regularity of the results.
    pub fn steadiness(&self) -> Steadiness {
        let (sum, squares, count) = self.intervals;
        if count == 0 {
            return Steadiness::default();
        }
        let mean = sum / count as f64;
        let deviation = (squares / count as f64 - mean * mean).max(0.0).sqrt();
        Steadiness { mean_ms: mean * 1e3, spread: deviation / (self.period_ns as f64 * 1e-9) }
    }

    /// Number of results that were added, each frame once; those that are not evaluated yet are not among them.
    pub fn count(&self) -> u64 {
        self.end_to_end.count() + self.disturbed.count() + self.unsound
    }

    /// Resets all statistics, and drops pending frames, which belong to the time before: end of the warm-up.
    pub fn forget(&mut self) {
        let stages: Vec<PathStage> = self.stages.iter().map(|times| times.stage).collect();
        let fresh = Self::new(self.start_ns, self.period_ns, &stages);
        let old = std::mem::replace(self, fresh);
        self.faults = old.faults;
        self.last_added = old.last_added;
        for (stage, old) in self.stages.iter_mut().zip(old.stages) {
            // The typical duration remains known.
            stage.both = old.both;
            stage.delays = old.delays;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: u64 = 1_000_000;

    fn path(core: Option<u32>) -> [PathStage; 4] {
        ["capture", "stereo", "road", "recognition"].map(|name| PathStage { name, core })
    }

    /// On two cores in turn.
    fn two_cores() -> [PathStage; 4] {
        let mut path = path(Some(0));
        (path[1].core, path[3].core) = (Some(1), Some(1));
        path
    }

    /// A frame of 2 + 20 + 1 + 5 + 1 + 3 ms.
    fn frame(sequence: u64, late_ns: u64) -> Trace {
        let capture_ns = 10_000 * MS + sequence * 80 * MS;
        let at = |ms: u64| capture_ns + ms * MS;
        let stamps = vec![
            (capture_ns - 3 * MS, capture_ns),
            (at(2), at(22) + late_ns),
            (at(23) + late_ns, at(28) + late_ns),
            (at(29) + late_ns, at(32) + late_ns),
        ];
        Trace { sequence, capture_ns, stamps }
    }

    fn run(count: u64, late: impl Fn(u64) -> u64, stalls: &Stalls) -> Latencies {
        let mut all = Latencies::new(0, 80 * MS, &two_cores());
        for i in 0..count {
            all.add(frame(i, late(i)), stalls);
        }
        all.settle(u64::MAX, None, stalls);
        all
    }

    #[test]
    fn times_are_told_apart_by_stage() {
        let all = run(100, |_| 0, &Stalls::default());
        let p50 = |l: &Latency| l.percentile_ms(50.0).round();
        assert_eq!(p50(&all.end_to_end), 32.0);
        assert_eq!(all.stages.iter().map(|s| p50(&s.work)).collect::<Vec<_>>(), [3.0, 20.0, 5.0, 3.0]);
        assert_eq!(all.stages.iter().map(|s| p50(&s.wait)).collect::<Vec<_>>(), [0.0, 2.0, 1.0, 1.0]);
        assert_eq!(all.end_to_end.count(), 100);
        let steady = all.steadiness();
        assert!((steady.mean_ms - 80.0).abs() < 1e-6 && steady.spread < 1e-6, "{steady:?}");
        assert!(all.jitter.percentile_ms(100.0) < 0.01);
        assert_eq!(all.longest_gap_ns, 80 * MS);
    }

    #[test]
    fn a_stall_explains_what_is_beyond_the_usual_and_no_more() {
        let late = |i: u64| if i == 50 { 100 * MS } else { 0 };
        let begin = frame(50, 0).stamps[1].0 + 5 * MS;
        // On the core of stereo, during its processing.
        let mut stalls = Stalls::default();
        stalls.add(Some(1), begin, begin + 90 * MS);
        let all = run(100, late, &stalls);
        assert!((all.end_to_end.percentile_ms(100.0) - 132.0).abs() < 1.0);
        assert!((all.less_stalls.percentile_ms(100.0) - 42.0).abs() < 1.0);
        // A stall of another core is not subtracted.
        let mut elsewhere = Stalls::default();
        elsewhere.add(Some(0), begin, begin + 90 * MS);
        let all = run(100, late, &elsewhere);
        assert!((all.less_stalls.percentile_ms(100.0) - 132.0).abs() < 1.0);
        // A probe that waited for normal processing of the stage subtracts nothing.
        let mut ordinary = Stalls::default();
        for i in 0..100 {
            let (begin, end) = frame(i, 0).stamps[1];
            ordinary.add(Some(1), begin, end);
        }
        let all = run(100, |_| 0, &ordinary);
        assert!(all.less_stalls.percentile_ms(50.0) > 31.0, "{}", all.less_stalls.percentile_ms(50.0));
    }

    #[test]
    fn a_stage_that_had_its_core_has_no_excuse() {
        let late = |i: u64| if i == 50 { 100 * MS } else { 0 };
        let begin = frame(50, 0).stamps[1].0 + 5 * MS;
        let mut stalls = Stalls::default();
        stalls.add(Some(1), begin, begin + 90 * MS);
        for (waited, expected) in [(0, 132.0), (60 * MS, 72.0), (500 * MS, 42.0)] {
            let mut all = Latencies::new(0, 80 * MS, &two_cores());
            let at = frame(50, 0).capture_ns;
            for (reading, total) in [(0, 0), (at - MS, 0), (at + 200 * MS, waited), (u64::MAX, waited)] {
                all.stages[1].delays.add(reading, total);
            }
            for i in 0..100 {
                all.add(frame(i, late(i)), &stalls);
            }
            all.settle(u64::MAX, None, &stalls);
            let longest = all.less_stalls.percentile_ms(100.0);
            assert!((longest - expected).abs() < 1.0, "{waited}: {longest}");
        }
    }

    #[test]
    fn frames_around_a_fault_are_counted_apart() {
        let stalls = Stalls::default();
        let mut all = Latencies::new(0, 80 * MS, &path(None));
        let fault = frame(40, 0).capture_ns;
        for i in 0..100 {
            if !(40..60).contains(&i) {
                all.add(frame(i, 0), &stalls);
            }
            // The recovery is still pending when the frames before it are evaluated.
            let open = (40..60).contains(&i).then_some(fault);
            all.settle(frame(i, 0).end_ns(), open, &stalls);
            if i == 60 {
                all.disturb(fault, frame(60, 0).end_ns());
            }
        }
        all.settle(u64::MAX, None, &stalls);
        // The frame of the recovery, and half a second after it.
        assert_eq!(all.disturbed.count(), 7);
        assert_eq!(all.end_to_end.count(), 73);
        assert_eq!(all.longest_gap_ns, 80 * MS, "the gap of the fault is the recovery's figure");
    }

    #[test]
    fn stamps_without_sense_are_counted_and_drops_are_no_jitter() {
        let stalls = Stalls::default();
        let mut all = Latencies::new(0, 80 * MS, &path(None));
        let mut wrong = frame(0, 0);
        wrong.stamps[2].1 = 5;
        all.add(wrong, &stalls);
        all.add(Trace { sequence: 9, ..Trace::default() }, &stalls);
        for i in [1, 2, 4, 5] {
            all.add(frame(i, 0), &stalls);
        }
        all.settle(u64::MAX, None, &stalls);
        assert_eq!((all.unsound, all.end_to_end.count()), (2, 4));
        assert!(all.jitter.percentile_ms(50.0) < 0.01);
        all.forget();
        assert_eq!(all.end_to_end.count(), 0);
    }

    #[test]
    fn every_result_since_the_warm_up_is_counted_once() {
        let (mut all, stalls) = (Latencies::new(0, 80 * MS, &two_cores()), Stalls::default());
        for i in 0..10 {
            all.add(frame(i, 0), &stalls);
        }
        // The frames so far belong to the warm-up, whether they are evaluated or not.
        all.forget();
        all.disturb(frame(15, 0).capture_ns, frame(16, 0).capture_ns);
        for i in [9, 10, 11, 11, 12, 13, 14, 15, 16, 17, 17, 17, 18, 19] {
            all.add(frame(i, 0), &stalls);
        }
        all.add(Trace { capture_ns: u64::MAX, ..frame(20, 0) }, &stalls);
        all.settle(u64::MAX, None, &stalls);
        assert_eq!((all.count(), all.repeated, all.unsound), (11, 4, 1));
        assert_eq!(all.end_to_end.count() + all.disturbed.count(), 10);
        assert!(all.disturbed.count() > 1);
    }
}
