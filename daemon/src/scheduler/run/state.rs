//! Assembly of the status message.

use super::result::Results;
use super::{Phase, Run};
use crate::scheduler::diagnostics::Condition;
use messages::calibration::CalibrationState;
use messages::clock::process_cpu_ns;
use messages::deadline::PacingRecord;
use messages::header::{Header, Kind};
use messages::motion::VehicleRecord;
use messages::obstacles::AlarmRecord;
use messages::pipeline::Role;
use messages::report::ReportRecord;
use messages::rig::RigRecord;
use messages::status::StatusRecord;

impl Run {
    /// The current status. Rates refer to the time since the previous call.
    pub(super) fn status(&mut self, now: u64) -> StatusRecord {
        let mut own = ReportRecord::new(Role::Scheduler);
        own.cpu_ns = process_cpu_ns();
        if let Some(memory) = self.memory.read() {
            own.private_bytes = memory.private_bytes;
            own.file_bytes = memory.file_bytes;
            own.shared_bytes = memory.shared_bytes;
        }
        own.realtime = self.realtime;
        own.realtime.log_dropped = crate::logging::dropped();
        self.collector.report(&Header::new(Kind::Report), &own, now);

        let mut status = StatusRecord::empty();
        status.calibration = self.collector.calibration();
        status.heat = self.board.record();
        status.rig = self.rig_record();
        status.device = *self.collector.device();
        status.deadline = self.collector.deadline();
        status.source_time = self.collector.source_time();
        status.pacing = self.pacing();
        let is_degraded = status.calibration.state() == CalibrationState::Degraded;
        let rows = is_degraded
            .then(|| format!("calibration {}: {}", status.calibration, status.calibration.remedy()));
        self.diagnostics.set(Condition::Calibration, rows.as_deref());
        self.diagnostics.set(Condition::Board, self.board.fault().as_deref());
        let lost = status.device.is_lost().then(|| status.device.describe());
        self.diagnostics.set(Condition::Device, lost.as_deref());
        self.diagnostics.set(Condition::GivenUp, self.supervisor.given_up_reason().as_deref());

        status.pid = std::process::id();
        status.source = match self.launch.config.source.kind.as_str() {
            "camera" => 0,
            "scene" => 2,
            _ => 1,
        };
        let is_running = self.phase == Phase::Running && self.supervisor.all_running();
        status.state = match self.phase {
            Phase::Draining { .. } | Phase::Stopping => 3,
            Phase::Running if self.diagnostics.is_degraded(is_running) => 2,
            Phase::Running => u32::from(self.collector.results() > 0 && is_running),
        };
        // While the run is stopping, the last result does not describe the road any more.
        let last = self.results.last().filter(|_| self.phase == Phase::Running);
        let frames_pass = self.phase == Phase::Running && self.supervisor.frames_pass();
        status.alarm = last.map_or(AlarmRecord::off(Results::faults(frames_pass)), |last| last.alarm);
        status.alarm_time = self.collector.alarm_time();
        status.alarm_changes = self.collector.last_changes();
        status.obstacles = last.map_or(0, |last| last.confirmed);
        status.motion = last.map_or_else(Default::default, |last| last.header.motion);
        status.vehicle = last.map_or(VehicleRecord::default(), |last| last.header.vehicle);
        status.alarms = self.collector.alarms().into();
        status.uptime_ns = now.saturating_sub(self.started_ns);
        status.frames = self.collector.results();
        let latency = self.collector.latency();
        status.latency_p50_ms = latency.p50_ms as f32;
        status.latency_p99_ms = latency.p99_ms as f32;
        match self.failure.as_ref().unwrap_or(&self.reason) {
            reason if reason.is_empty() => status.set_reason(&self.diagnostics.reason()),
            reason => status.set_reason(reason),
        }
        let processes = self.collector.processes(&self.supervisor, &self.plan, now);
        for (place, process) in status.process.iter_mut().zip(processes) {
            *place = process;
            status.processes += 1;
        }
        status.limited()
    }

    fn rig_record(&self) -> RigRecord {
        let f = &self.launch.frames;
        RigRecord {
            width: f.width as u32,
            height: f.height as u32,
            disparities: u32::try_from(self.launch.config.stereo.disparities).unwrap_or(0),
            lockstep: u32::from(self.options.lockstep),
            focal_px: f.focal_px,
            baseline_m: f.baseline_m,
            cx_px: f.cx_px,
            cy_px: f.cy_px,
            period_ns: self.credit.command().period_ns,
        }
    }

    fn pacing(&self) -> PacingRecord {
        if self.options.lockstep {
            return PacingRecord::default();
        }
        let parameters = self.pacer.parameters();
        let slowest = self.pacer.slowest();
        PacingRecord {
            // The thermal ladder may allow less than the pacer.
            rate_hz: 1e9 / self.credit.command().period_ns.max(1) as f64,
            wanted_hz: 1e9 / parameters.wanted_ns.max(1) as f64,
            slowest_ms: slowest.map_or(0.0, |(_, ns)| ns as f64 * 1e-6),
            slowest: slowest.map_or(0, |(role, _)| role as u32),
            follows: u32::from(parameters.follow),
        }
    }
}
