//! Statistics of a run, collected from the reports of the stages.

use super::cores::CorePlan;
use super::supervisor::Supervisor;
use crate::alarm_log::{AlarmLog, MAX_CHANGES};
use crate::alarm_tally::{AlarmTally, alarm_times};
use messages::alarm::Faults;
use messages::alarm_change::AlarmChanges;
use messages::alarm_time::AlarmTimeRecord;
use messages::calibration::{CalibrationCause, CalibrationRecord, CalibrationState};
use messages::deadline::DeadlineRecord;
use messages::device::DeviceRecord;
use messages::header::{Header, put_text};
use messages::obstacles::AlarmRecord;
use messages::pipeline::{PATH_LENGTH, Role, Starts};
use messages::report::ReportRecord;
use messages::source_time::SourceTimeRecord;
use messages::status::{ProcessRecord, WARM_FRAMES};
use tools::reporting::motion::MotionTally;
use tools::reporting::summary::{
    CalibrationChange, Latency, Percentiles, ProcessSummary, RunSummary, SourceTimeSummary,
};

/// Maximum number of frames whose times are kept individually.
const MAX_TRACES: usize = 20_000;

/// Times of one frame, in milliseconds.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FrameTrace {
    /// Sequence of the frame.
    pub sequence: u64,
    /// Work of each stage, in the order of [`messages::pipeline::PATH`].
    pub work_ms: [f64; PATH_LENGTH],
    /// Latency from capture to obstacles.
    pub latency_ms: f64,
}

/// Statistics of one role over all its processes.
#[derive(Clone, Debug)]
struct RoleFigures {
    role: Role,
    last: ReportRecord,
    alive: bool,
    /// Totals of the earlier processes.
    before: Totals,
    work: Latency,
    age: Latency,
    private_bytes: u64,
    /// Number of heap allocations for frames after the first [`WARM_FRAMES`] of each process.
    allocations: u64,
    /// Totals at the last status, for the rates.
    at_status: Totals,
}

#[derive(Clone, Copy, Debug, Default)]
struct Totals {
    frames: u64,
    skipped: u64,
    refused: u64,
    cpu_ns: u64,
    late: u64,
    source_time: SourceTimeRecord,
}

impl RoleFigures {
    fn totals(&self) -> Totals {
        Totals {
            frames: self.before.frames + self.last.frames,
            skipped: self.before.skipped + self.last.skipped,
            refused: self.before.refused + self.last.refused,
            cpu_ns: self.before.cpu_ns + self.last.cpu_ns,
            late: self.before.late + self.last.deadline.late,
            source_time: self.before.source_time.plus(&self.last.source_time),
        }
    }
}

/// The statistics of a run.
#[derive(Clone, Debug)]
pub struct Collector {
    roles: Vec<RoleFigures>,
    latency: Latency,
    traces: Vec<FrameTrace>,
    keeps_traces: bool,
    started_ns: u64,
    first_result_ns: Option<u64>,
    last_result_ns: u64,
    results: u64,
    /// Number of pairs that the source left out.
    unreadable: u64,
    /// Sequence of the last of them, and the reason.
    last_unreadable: Option<(u64, String)>,
    last_sequence: Option<u64>,
    alarm_log: AlarmLog,
    alarm_tally: AlarmTally,
    /// The vehicle's own motion over all results.
    pub motion: MotionTally,
    status_ns: u64,
    calibration: CalibrationRecord,
    /// The state that was logged last: good or degraded; unknown before the first.
    calibration_logged: (CalibrationState, CalibrationCause, bool),
    calibration_changes: Vec<CalibrationChange>,
    device: DeviceRecord,
}

impl Collector {
    /// Empty statistics for a run that starts now.
    pub fn new(roles: &[Role], now_ns: u64) -> Self {
        let figures = |&role| RoleFigures {
            role,
            last: ReportRecord { pid: 0, ..ReportRecord::new(role) },
            alive: false,
            before: Totals::default(),
            work: Latency::new(),
            age: Latency::new(),
            private_bytes: 0,
            allocations: 0,
            at_status: Totals::default(),
        };
        Self {
            roles: roles.iter().map(figures).collect(),
            latency: Latency::new(),
            traces: Vec::new(),
            keeps_traces: false,
            started_ns: now_ns,
            first_result_ns: None,
            last_result_ns: now_ns,
            results: 0,
            unreadable: 0,
            last_unreadable: None,
            last_sequence: None,
            alarm_log: AlarmLog::default(),
            alarm_tally: AlarmTally::default(),
            motion: MotionTally::default(),
            status_ns: now_ns,
            calibration: CalibrationRecord::default(),
            calibration_logged: (CalibrationState::Unknown, CalibrationCause::None, false),
            calibration_changes: Vec::new(),
            device: DeviceRecord::default(),
        }
    }

    /// Adds a report. Returns whether it is the first of its process.
    pub fn report(&mut self, header: &Header, report: &ReportRecord, now_ns: u64) -> bool {
        let Some(role) = report.role() else { return false };
        let Some(figures) = self.roles.iter_mut().find(|f| f.role == role) else { return false };
        let is_new = figures.last.pid != report.pid;
        if is_new {
            figures.before = figures.totals();
        }
        figures.last = *report;
        figures.alive = true;
        figures.private_bytes = figures.private_bytes.max(report.private_bytes);
        if report.is_frame == 1 {
            figures.work.add_ns(report.work_ns);
            if report.frames > WARM_FRAMES {
                figures.allocations = figures.allocations.saturating_add(report.allocations);
            }
            if role != Role::SOURCE {
                figures.age.add_ns(report.age_ns);
            }
            if role == Role::LAST {
                self.result(header, now_ns);
            }
            if role == Role::Stereo {
                self.take_calibration(header.sequence, report.calibration);
                self.device = report.device;
            }
        }
        is_new
    }

    /// The source left a pair out. Returns whether that is new.
    pub fn unreadable(&mut self, sequence: u64, reason: &str) -> bool {
        let is_new = self.last_unreadable.as_ref().is_none_or(|(last, _)| sequence > *last);
        if is_new {
            self.unreadable += 1;
            self.last_unreadable = Some((sequence, reason.to_owned()));
        }
        is_new
    }

    /// Why the last pair was left out, if one was.
    pub fn last_unreadable(&self) -> Option<&str> {
        self.last_unreadable.as_ref().map(|(_, reason)| &reason[..])
    }

    /// The process of a role has ended. Its totals are kept.
    pub fn ended(&mut self, role: Role) {
        if let Some(figures) = self.roles.iter_mut().find(|f| f.role == role) {
            figures.alive = false;
        }
    }

    fn result(&mut self, header: &Header, now_ns: u64) {
        // A frame that was repeated after a stage died is one result.
        if self.last_sequence == Some(header.sequence) {
            return;
        }
        self.last_sequence = Some(header.sequence);
        let latency_ns = header.latency_ns();
        self.latency.add_ns(latency_ns);
        self.results += 1;
        self.first_result_ns.get_or_insert(now_ns);
        self.last_result_ns = now_ns;
        if self.keeps_traces && self.traces.len() < MAX_TRACES {
            self.traces.push(FrameTrace {
                sequence: header.sequence,
                work_ms: header.stamps.map(|s| s.end_ns.saturating_sub(s.begin_ns) as f64 * 1e-6),
                latency_ms: latency_ns as f64 * 1e-6,
            });
        }
    }

    fn take_calibration(&mut self, sequence: u64, calibration: CalibrationRecord) {
        self.calibration = calibration;
        let state = calibration.state();
        let is_known = matches!(state, CalibrationState::Good | CalibrationState::Degraded);
        let summary = (state, calibration.cause(), calibration.has_moved());
        if !is_known || summary == self.calibration_logged {
            return;
        }
        let remedy = calibration.remedy();
        if remedy.is_empty() {
            tracing::info!(sequence, "calibration {calibration}");
        } else {
            tracing::warn!(sequence, "calibration {calibration}: {remedy}");
        }
        self.calibration_logged = summary;
        if self.calibration_changes.len() < MAX_CHANGES {
            self.calibration_changes.push(calibration_change(sequence, &calibration));
        }
    }

    /// Epipolar alignment after the last frame.
    pub fn calibration(&self) -> CalibrationRecord {
        self.calibration
    }

    /// The device on which the last frame was matched.
    pub fn device(&self) -> &DeviceRecord {
        &self.device
    }

    /// Age of the last result, and the number of late ones since the daemon started.
    pub fn deadline(&self) -> DeadlineRecord {
        let figures = self.roles.iter().find(|f| f.role == Role::LAST);
        figures.map_or_else(DeadlineRecord::default, |f| DeadlineRecord {
            late: f.totals().late,
            ..f.last.deadline
        })
    }

    /// What was wrong with the time of the source since the daemon started.
    pub fn source_time(&self) -> SourceTimeRecord {
        let each = self.roles.iter().map(|figures| figures.totals().source_time);
        each.fold(SourceTimeRecord::default(), |sum, one| sum.plus(&one))
    }

    /// Adds the alarm of a frame, and logs it if its level or rule has changed.
    pub fn alarm(&mut self, header: &Header, record: &AlarmRecord) {
        self.alarm_tally.add(header.sequence, header.source_ns, record);
        self.alarm_log.add(header.sequence, record);
    }

    /// The scheduler has switched the alarm off because of `faults`. Without faults, nothing changes.
    pub fn alarm_off(&mut self, faults: Faults) {
        if !faults.is_none() {
            self.alarm_tally.withdraw(faults);
            self.alarm_log.withdraw(self.last_sequence.unwrap_or(0), faults);
        }
    }

    /// How often the level became "alarm".
    pub fn alarms(&self) -> u32 {
        self.alarm_log.alarms()
    }

    /// Frames and time in each level of the alarm.
    pub fn alarm_time(&self) -> AlarmTimeRecord {
        self.alarm_tally.record()
    }

    /// The last changes of the alarm's level.
    pub fn last_changes(&self) -> AlarmChanges {
        self.alarm_tally.changes()
    }

    /// When the first result arrived, in ns of CLOCK_MONOTONIC.
    pub fn first_result_ns(&self) -> Option<u64> {
        self.first_result_ns
    }

    /// Number of results so far.
    pub fn results(&self) -> u64 {
        self.results
    }

    /// Latency from capture to obstacles.
    pub fn latency(&self) -> Percentiles {
        self.latency.percentiles()
    }

    /// Keeps the times of each frame, for short runs.
    pub fn keep_traces(&mut self) {
        self.keeps_traces = true;
        self.traces.reserve(1024);
    }

    /// Times of each frame; empty without [`Self::keep_traces`].
    pub fn traces(&self) -> &[FrameTrace] {
        &self.traces
    }

    /// The processes for a status message. Rates refer to the time since the previous call.
    pub fn processes(
        &mut self,
        supervisor: &Supervisor,
        plan: &CorePlan,
        now_ns: u64,
    ) -> impl Iterator<Item = ProcessRecord> {
        let seconds = now_ns.saturating_sub(self.status_ns).max(1) as f64 * 1e-9;
        self.status_ns = now_ns;
        self.roles.iter_mut().map(move |figures| {
            let totals = figures.totals();
            let before = std::mem::replace(&mut figures.at_status, totals);
            let work = figures.work.percentiles();
            let mut state = [0; 24];
            let name = match supervisor.state(figures.role) {
                Some(state) => state.name(),
                None => "running",
            };
            put_text(&mut state, name);
            ProcessRecord {
                role: figures.role as u32,
                pid: if figures.alive { figures.last.pid } else { 0 },
                core: plan.core(figures.role).map_or(-1, |c| c as i32),
                restarts: supervisor.restarts(figures.role),
                frames: totals.frames,
                skipped: totals.skipped,
                refused: totals.refused,
                cpu_percent: (totals.cpu_ns.saturating_sub(before.cpu_ns) as f64 * 1e-7 / seconds) as f32,
                rate_hz: (totals.frames.saturating_sub(before.frames) as f64 / seconds) as f32,
                p50_ms: work.p50_ms as f32,
                p99_ms: work.p99_ms as f32,
                private_bytes: if figures.alive { figures.last.private_bytes } else { 0 },
                shared_bytes: if figures.alive { figures.last.shared_bytes } else { 0 },
                allocations: figures.allocations,
                realtime: figures.last.realtime,
                state,
            }
        })
    }

    /// The summary of the run.
    pub fn summary(
        &self,
        supervisor: &Supervisor,
        plan: &CorePlan,
        shared_bytes: u64,
        now_ns: u64,
    ) -> RunSummary {
        let wall_ns = now_ns.saturating_sub(self.started_ns).max(1);
        let first = self.first_result_ns.unwrap_or(self.last_result_ns);
        let seconds = self.last_result_ns.saturating_sub(first) as f64 * 1e-9;
        let processes: Vec<ProcessSummary> = self
            .roles
            .iter()
            .map(|figures| {
                let totals = figures.totals();
                ProcessSummary {
                    role: figures.role.name().into(),
                    core: plan.core(figures.role).map(|c| c as u32),
                    frames: totals.frames,
                    skipped: totals.skipped,
                    refused: totals.refused,
                    work: figures.work.percentiles(),
                    age: figures.age.percentiles(),
                    cpu_percent: totals.cpu_ns as f64 / wall_ns as f64 * 100.0,
                    private_bytes: figures.private_bytes,
                    allocations: figures.allocations,
                    restarts: supervisor.restarts(figures.role),
                }
            })
            .collect();
        let offered = self.roles.iter().find(|f| f.role == Role::SOURCE).map_or(0, |f| f.totals().frames);
        // Frames that a process on request skips still reach the vehicle, so they do not count.
        let always = |f: &&RoleFigures| f.role.spec().starts == Starts::Always;
        let dropped = self.roles.iter().filter(always).map(|f| f.totals().skipped).sum();
        RunSummary {
            seconds,
            first_result_s: self.first_result_ns.map_or(0.0, |at| (at - self.started_ns) as f64 * 1e-9),
            offered,
            frames: self.results,
            dropped,
            unreadable: self.unreadable,
            lost: offered.saturating_sub(self.results).saturating_sub(dropped),
            file_bytes: self.roles.iter().map(|f| f.last.file_bytes).max().unwrap_or(0),
            rate_hz: if seconds > 0.0 { self.results.saturating_sub(1) as f64 / seconds } else { 0.0 },
            latency: self.latency.percentiles(),
            late: self.deadline().late,
            restarts: processes.iter().map(|p| p.restarts).sum(),
            source_time: source_time_summary(&self.source_time()),
            processes,
            shared_bytes,
            alarms: self.alarm_log.alarms(),
            alarm_times: alarm_times(&self.alarm_tally.record()),
            alarm_changes: self.alarm_log.changes().to_vec(),
            motion: self.motion.summary(),
            calibration: self.calibration_changes.clone(),
            calibration_last: (self.calibration_logged.0 != CalibrationState::Unknown)
                .then(|| calibration_change(self.last_sequence.unwrap_or(0), &self.calibration)),
        }
    }
}

/// The state of the calibration for the summary of a run.
fn calibration_change(sequence: u64, calibration: &CalibrationRecord) -> CalibrationChange {
    CalibrationChange {
        sequence,
        state: calibration.state().name().into(),
        cause: calibration.cause().name().into(),
        text: calibration.to_string(),
        lost: calibration.lost.into(),
        typical_px: calibration.typical_px.into(),
        corrected_px: calibration.corrected_px.into(),
        moved_px: if calibration.has_moved() { calibration.moved_px.into() } else { 0.0 },
    }
}

/// The counts for the summary of a run.
fn source_time_summary(counts: &SourceTimeRecord) -> SourceTimeSummary {
    let SourceTimeRecord { gaps, steps_back, repeats, dropped_obstacles } = *counts;
    SourceTimeSummary { gaps, steps_back, repeats, dropped_obstacles }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scheduler::supervisor::tests::PARAMETERS;
    use messages::header::{Kind, Stamp};

    fn report(role: Role, pid: u32, frames: u64) -> ReportRecord {
        ReportRecord {
            pid,
            frames,
            is_frame: 1,
            work_ns: 4_000_000,
            cpu_ns: frames * 1_000,
            ..ReportRecord::new(role)
        }
    }

    #[test]
    fn totals_continue_over_restarts() {
        let roles = [Role::Capture, Role::Stereo, Role::Recognition];
        let mut collector = Collector::new(&roles, 0);
        let mut header = Header::new(Kind::Report);
        header.capture_ns = 1_000_000;
        header.set_stamp(Role::LAST, Stamp { begin_ns: 20_000_000, end_ns: 41_000_000 });
        header.sequence = 1;
        assert!(collector.report(&header, &report(Role::Recognition, 10, 3), 1_000_000_000));
        header.sequence = 2;
        assert!(!collector.report(&header, &report(Role::Recognition, 10, 4), 2_000_000_000));
        // A repeated frame is not a new result.
        let source_time = SourceTimeRecord { gaps: 2, ..SourceTimeRecord::default() };
        let last = ReportRecord { source_time, ..report(Role::Recognition, 10, 4) };
        assert!(!collector.report(&header, &last, 2_500_000_000));
        header.sequence = 4;
        let first = ReportRecord { source_time, ..report(Role::Recognition, 11, 1) };
        assert!(collector.report(&header, &first, 3_000_000_000));
        assert_eq!(collector.source_time().gaps, 4, "the counts of both processes");
        collector.report(&header, &report(Role::Capture, 9, 8), 3_000_000_000);
        // Only changes between good and degraded are kept; unknown is not a change.
        for (sequence, state) in [(0, 1), (1, 2), (2, 2), (3, 3), (4, 1), (5, 3), (6, 2)] {
            let calibration = CalibrationRecord { state, typical_px: 0.75, ..CalibrationRecord::default() };
            header.sequence = sequence;
            let report = ReportRecord { calibration, ..report(Role::Stereo, 12, sequence) };
            collector.report(&header, &report, 3_000_000_000);
        }
        assert_eq!(collector.calibration().state(), CalibrationState::Good);
        for (sequence, level) in [1, 3, 3, 0, 3, 2, 1].into_iter().enumerate() {
            let record = AlarmRecord { level, rule: u32::from(level > 1), ..AlarmRecord::default() };
            header.sequence = sequence as u64;
            header.source_ns = 100_000_000 * header.sequence;
            collector.alarm(&header, &record);
        }
        collector.alarm_off(Faults::NONE);
        collector.alarm_off(Faults::STAGE);
        collector.alarm_off(Faults::STALE);
        let supervisor = Supervisor::new(PARAMETERS, &roles, 0);
        let plan = CorePlan::new(&config::Cores::default(), &[0]);
        let summary = collector.summary(&supervisor, &plan, 77, 4_000_000_000);
        assert_eq!((summary.offered, summary.frames, summary.alarms), (8, 3, 2));
        assert_eq!(summary.source_time.gaps, 4);
        assert!(collector.traces().is_empty(), "traces are off by default");
        let changes = summary.calibration.iter().map(|c| (c.sequence, &c.state[..])).collect::<Vec<_>>();
        assert_eq!(changes, [(1, "good"), (3, "degraded"), (6, "good")]);
        let changes: Vec<&str> = summary.alarm_changes.iter().map(|c| &c.level[..]).collect();
        assert_eq!(changes, ["clear", "alarm", "off", "alarm", "warning", "clear", "off"]);
        assert_eq!(summary.alarm_changes[6].reason, "a stage is not running");
        let times = &summary.alarm_times;
        let frames = [&times.off, &times.clear, &times.warning, &times.alarm].map(|time| time.frames);
        assert_eq!((frames, times.alarm.seconds), ([1, 2, 1, 3], 0.3));
        let recognition = &summary.processes[2];
        assert_eq!(recognition.frames, 5);
        assert!((recognition.work.p50_ms - 4.0).abs() < 0.01);
        assert!((summary.latency.p50_ms - 40.0).abs() < 0.1);
        assert!((summary.rate_hz - 1.0).abs() < 1e-9 && (summary.first_result_s - 1.0).abs() < 1e-9);
    }
}
