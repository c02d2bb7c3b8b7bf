//! One run of the daemon: the scheduler's state and what it does at each wake-up.

use super::board::Board;
use super::children::Children;
use super::collector::Collector;
use super::cores::CorePlan;
use super::figures::MinuteFigures;
use super::flow::{DRAIN_NS, Flow};
use super::notify::Notify;
use super::supervisor::{Action, Supervisor, SupervisorParameters};
use super::{Ends, RunError, RunOptions, RunOutcome};
use crate::input;
use crate::launch::{FrameFormat, Launch};
use crate::memory::MemoryProbe;
use crate::rooms::recognition::RecognitionRoom;
use crate::rooms::{RoomError, matcher};
use crate::stage::pin;
use config::Config;
use ipc::alarm::{self, Faults};
use ipc::bus::{Bus, IpcError};
use ipc::calibration::CalibrationState;
use ipc::clock::{monotonic_ns, process_cpu_ns};
use ipc::header::{GREATEST_SIDE, Header, Kind};
use ipc::instance::{Instance, InstanceLock};
use ipc::obstacles::{AlarmRecord, Obstacles};
use ipc::port::{Publisher, Subscriber};
use ipc::report::{Health, ReportRecord};
use ipc::rig::RigRecord;
use ipc::role::Role;
use ipc::status::StatusRecord;
use ipc::wait::Next;
use ipc::{obstacles, report, service};
use perception::stereo::Mpv;
use signal_hook::consts::{SIGCHLD, SIGHUP, SIGINT, SIGTERM};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;
use tools::recording::RecordError;

/// How often the scheduler looks at its clocks.
const TICK: Duration = Duration::from_millis(50);

/// How often it publishes its status.
const STATUS_PERIOD_NS: u64 = 1_000_000_000;

/// What the run is doing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Phase {
    Running,
    /// The source is asked to stop; frames in flight come out until then.
    Draining {
        until_ns: u64,
    },
    /// The stages are asked to stop.
    Stopping,
}

/// The last result.
#[derive(Clone, Copy, Debug)]
struct LastResult {
    alarm: AlarmRecord,
    confirmed: u32,
    at_ns: u64,
}

/// See the module.
pub struct Run {
    options: RunOptions,
    pub(super) launch: Launch,
    plan: CorePlan,
    pub(super) supervisor: Supervisor,
    pub(super) collector: Collector,
    children: Children,
    pub(super) flow: Flow,
    pub(super) phase: Phase,
    pub(super) board: Board,
    pub(super) notify: Notify,
    /// SIGHUP has come.
    pub(super) hangup: Arc<AtomicBool>,
    failure: Option<String>,
    reason: String,
    /// What the source says is wrong with it; pairs may come again.
    source_trouble: String,
    stop: Arc<AtomicBool>,
    was_stopped: bool,
    memory: MemoryProbe,
    started_ns: u64,
    status_due_ns: u64,
    stale_after_ns: u64,
    shared_bytes: u64,
    last_result: Option<LastResult>,
    figures: MinuteFigures,
    // Last, in this order: the ports go before the bus, the bus before what it lives in.
    commands: Publisher,
    statuses: Publisher,
    /// The way into shared memory.
    pub bus: Bus,
    instance: Instance,
    _lock: InstanceLock,
}

impl Run {
    /// Checks everything that can be known to be wrong, then takes the instance over.
    pub fn start(config: &Config, options: &RunOptions) -> Result<Self, RunError> {
        let started_ns = monotonic_ns();
        let source = input::open(config)?;
        let rig = input::rig(config, source.as_ref())?;
        let (width, height) = source.size();
        let source_name = || match config.source.kind.as_str() {
            "folder" | "recording" => config.source.path.display().to_string(),
            kind => kind.to_owned(),
        };
        if width.max(height) > GREATEST_SIDE as usize {
            return Err(RunError::Side { source_name: source_name(), width, height, most: GREATEST_SIDE });
        }
        let disparities = usize::try_from(config.stereo.disparities).unwrap_or(0);
        Mpv::check(width, height, disparities)
            .map_err(|error| RunError::Frames { source_name: source_name(), error })?;
        matcher::check(config, width, height).map_err(RoomError::from)?;
        let frames = FrameFormat::new((width, height), rig);
        RecognitionRoom::new(config, &frames)?;
        let nearest_m = rig.distance_m(disparities as f64 - 1.0);
        if nearest_m > config.alarm.distance_m {
            tracing::warn!(
                nearest_m,
                alarm_distance_m = config.alarm.distance_m,
                "nothing nearer than nearest_m can be seen: raise stereo.disparities"
            );
        }

        // Before anything is made that a signal would leave behind.
        let stop = Arc::new(AtomicBool::new(false));
        let hangup = Arc::new(AtomicBool::new(false));
        for signal in [SIGTERM, SIGINT] {
            signal_hook::flag::register(signal, Arc::clone(&stop))?;
        }
        if options.ends == Ends::Never {
            signal_hook::flag::register(SIGHUP, Arc::clone(&hangup))?;
        } else if !ignores_hangup() {
            // nohup means: go on when the terminal is gone.
            signal_hook::flag::register(SIGHUP, Arc::clone(&stop))?;
        }
        // Only to be woken when a child ends.
        signal_hook::flag::register(SIGCHLD, Arc::new(AtomicBool::new(false)))?;

        let instance = Instance::new(&config.instance.name, &config.instance.directory);
        let lock = InstanceLock::take(&instance, started_ns / 1_000_000)?;
        if lock.stale > 0 {
            tracing::warn!(files = lock.stale, "removed what a dead run had left behind");
        }
        let board = Board::start(config, instance.directory(), started_ns)?;
        if let Some(out) = &options.out {
            tools::output::prepare(out)?;
        }
        if let Some(path) = options.record.as_ref().filter(|path| path.exists()) {
            return Err(RecordError::Exists { path: path.clone() }.into());
        }
        let mut roles = Role::STAGES.to_vec();
        let has_writer = options.out.is_some() || options.record.is_some();
        roles.extend(has_writer.then_some(Role::Writer));
        let pool_bytes = service::total_pool_bytes(width, height, roles.len()) as u64;
        lock.check_memory(pool_bytes)?;
        for spec in &service::SERVICES {
            let (samples, bytes) = (spec.pool_samples(), spec.pool_bytes(width, height));
            tracing::debug!(service = spec.name, samples, bytes, "pool of one publisher");
        }
        tracing::info!(
            instance = instance.name(),
            width,
            height,
            pool_bytes,
            prefix = lock.prefix(),
            "starting"
        );

        let available: Vec<usize> =
            core_affinity::get_core_ids().unwrap_or_default().iter().map(|core| core.id).collect();
        let plan = CorePlan::new(&config.cores, &available);
        let all: Vec<Role> = std::iter::once(Role::Scheduler).chain(roles.iter().copied()).collect();
        tracing::info!(cores = available.len(), "{}", plan.describe(&all));
        if let Some(core) = plan.core(Role::Scheduler) {
            pin(core);
        }

        let count = if config.source.repeat { None } else { source.count() };
        let launch = Launch {
            config: config.clone(),
            core: None,
            scheduler_pid: std::process::id(),
            frames,
            lockstep: options.lockstep,
            first_sequence: 0,
            end_sequence: match (count, options.limit) {
                (Some(count), Some(limit)) => Some(count.min(limit)),
                (count, limit) => count.or(limit),
            },
            source_period_ns: source.period_ns(),
            out: options.out.clone(),
            record: options.record.clone(),
        };
        // Found now, not when the first stage is started.
        serde_json::to_vec(&launch)?;
        let bus = Bus::join(&instance)?;
        let now = monotonic_ns();
        let parameters = supervisor_parameters(config);
        let period_ns = input::period_ns(config, source.as_ref());
        let patience_ns = parameters.liveness_deadline_ns;
        let mut collector = Collector::new(&all, started_ns);
        if matches!(options.ends, Ends::After(_)) {
            // The demo draws them.
            collector.keep_traces();
        }
        Ok(Self {
            supervisor: Supervisor::new(parameters, &roles, now),
            collector,
            children: Children::default(),
            flow: Flow::new(options.lockstep, has_writer, period_ns, patience_ns, now),
            phase: Phase::Running,
            board,
            notify: Notify::from_environment(),
            hangup,
            failure: None,
            reason: String::new(),
            source_trouble: String::new(),
            stop,
            was_stopped: false,
            memory: MemoryProbe::open()?,
            started_ns,
            status_due_ns: now,
            stale_after_ns: patience_ns,
            shared_bytes: 0,
            last_result: None,
            figures: MinuteFigures::default(),
            options: options.clone(),
            launch,
            plan,
            commands: bus.publisher(&service::COMMAND, width, height)?,
            statuses: bus.publisher(&service::STATUS, width, height)?,
            bus,
            instance,
            _lock: lock,
        })
    }

    /// One wake-up: reports, results, deaths, deadlines, status.
    pub fn step(
        &mut self,
        reports: &Subscriber,
        results: &Subscriber,
        watch: &mut dyn FnMut(&StatusRecord),
    ) -> Result<Next, IpcError> {
        while let Some(sample) = reports.receive()? {
            match report::view(sample.header(), sample.payload()) {
                Ok(report) => self.take_report(sample.header(), &report)?,
                Err(error) => tracing::warn!(%error, "a report was refused"),
            }
        }
        while let Some(sample) = results.receive()? {
            match obstacles::view(sample.header(), sample.payload()) {
                Ok(message) => self.take_result(sample.header(), &message),
                Err(error) => tracing::warn!(%error, "obstacles were refused"),
            }
        }
        let now = monotonic_ns();
        for (role, how) in self.children.reap() {
            self.take_exit(role, &how, now);
        }
        for action in self.supervisor.tick(now) {
            self.act(action, now);
        }
        if self.flow.tick(self.supervisor.all_running(), now) {
            tracing::warn!("the frame in lock-step does not move: asking for it again");
            self.send_command()?;
        }
        if let Some(heat) = self.board.tick(now)
            && self.flow.limit(&heat)
        {
            self.send_command()?;
        }
        self.advance(now)?;
        self.notify(now);
        if self.phase == Phase::Running && self.last_result.is_some() {
            self.collector.alarm_off(self.staleness(now));
        }
        if now >= self.status_due_ns {
            self.status_due_ns = now + STATUS_PERIOD_NS;
            let status = self.status(now);
            self.statuses.send_record(Header::new(Kind::Status), &status)?;
            self.notify_status(&status, now);
            watch(&status);
            self.figures.tick(&status);
        } else {
            // Late comers get the last one.
            self.statuses.refresh()?;
        }
        if self.phase == Phase::Stopping && self.supervisor.all_ended() {
            return Ok(Next::Stop);
        }
        Ok(Next::Wait(TICK))
    }

    fn take_report(&mut self, header: &Header, report: &ReportRecord) -> Result<(), IpcError> {
        let Some(role) = report.role() else { return Ok(()) };
        if self.children.pid(role) != Some(report.pid) {
            // The last words of a process that was replaced.
            return Ok(());
        }
        let now = monotonic_ns();
        let was_running = self.supervisor.all_running();
        self.collector.report(header, report, now);
        if role == Role::Capture && report.is_frame == 0 && report.health() == Health::Ready {
            self.source_trouble = report.text();
        }
        if report.health() == Health::Unusable {
            self.fail(report.text(), now);
        }
        if self.options.lockstep && report.refused > 0 {
            // The frame will never come out: that is no lock-step any more.
            self.fail(format!("the {role} stage refused a message: {}", report.text()), now);
        }
        if report.health() == Health::Starting {
            return Ok(());
        }
        self.supervisor.reported(role, now);
        let is_running = self.supervisor.all_running();
        if !was_running && is_running {
            tracing::info!("all stages are running");
            self.flow.all_running(now);
            self.send_command()?;
        } else if role == Role::Capture && report.is_frame == 0 && report.frames == 0 {
            // It has just come up and knows nothing yet. Before all stages are there it stays so:
            // what it published would be lost.
            if is_running || self.supervisor.given_up().is_some() {
                self.send_command()?;
            }
        }
        if report.health() == Health::Finished && role == Role::Capture {
            self.flow.source_finished();
        }
        if report.is_frame == 1 && self.flow.frame_done(role, header.sequence, now) {
            self.send_command()?;
        }
        Ok(())
    }

    fn send_command(&self) -> Result<(), IpcError> {
        self.commands.send_record(Header::new(Kind::Command), &self.flow.command())
    }

    fn take_result(&mut self, header: &Header, message: &Obstacles<'_>) {
        self.last_result = Some(LastResult {
            alarm: message.alarm,
            confirmed: message.obstacles.iter().filter(|o| o.confirmed == 1).count() as u32,
            at_ns: monotonic_ns(),
        });
        self.collector.alarm(header.sequence, &message.alarm);
    }

    /// Why what the last frame said is no judgement of the road now.
    fn staleness(&self, now: u64) -> Faults {
        let is_running = self.phase == Phase::Running && self.supervisor.all_running();
        let is_fresh =
            self.last_result.is_some_and(|last| now.saturating_sub(last.at_ns) < self.stale_after_ns);
        Faults::STAGE.when(!is_running).and(Faults::STALE.when(is_running && !is_fresh))
    }

    fn take_exit(&mut self, role: Role, how: &str, now: u64) {
        if self.phase == Phase::Stopping || self.supervisor.is_renewing(role) {
            tracing::debug!(%role, how, "stage ended");
        } else {
            tracing::warn!(%role, how, "stage ended unasked");
        }
        self.flow.stage_died();
        self.collector.ended(role);
        // Only reaped children count as dead; now their places can be freed.
        let sweep = self.bus.sweep();
        if sweep.failed > 0 {
            tracing::warn!(?sweep, "shared memory of a dead stage could not be removed");
        }
        if matches!(self.phase, Phase::Draining { .. }) {
            // Asked to stop as a group, perhaps: nothing more will come out, nothing is restarted.
            self.stop_stages(now);
        }
        if let Some(action) = self.supervisor.exited(role, how, now) {
            self.act(action, now);
        }
    }

    pub(super) fn act(&mut self, action: Action, now: u64) {
        match action {
            Action::Spawn(role) => self.spawn(role, now),
            Action::Terminate(role) => self.children.terminate(role),
            Action::Kill(role, why) => {
                tracing::warn!(%role, why, "stage is killed");
                self.children.kill(role);
            }
            Action::GiveUp(role, reason) => {
                tracing::error!(%role, %reason, "stage is given up");
                self.reason.clone_from(&reason);
                if self.options.ends != Ends::Never {
                    self.fail(reason, now);
                }
            }
        }
    }

    fn spawn(&mut self, role: Role, now: u64) {
        let mut launch = Launch { core: self.plan.core(role), ..self.launch.clone() };
        if role == Role::Capture {
            launch.first_sequence = self.flow.resume_at();
        }
        let started = self.children.spawn(role, &launch);
        self.supervisor.spawned(role, now);
        match started {
            Ok(pid) => tracing::info!(%role, pid, "stage started"),
            Err(error) => {
                tracing::error!(%role, %error, "stage cannot be started");
                if let Some(action) = self.supervisor.exited(role, "could not be started", now) {
                    self.act(action, now);
                }
            }
        }
    }

    /// The run cannot come to a good end; the first reason counts.
    fn fail(&mut self, reason: String, now: u64) {
        if self.failure.is_none() && self.phase != Phase::Stopping {
            tracing::error!("{reason}");
            self.failure = Some(reason);
            self.stop_stages(now);
        }
    }

    /// Ends the run when it is time to.
    fn advance(&mut self, now: u64) -> Result<(), IpcError> {
        let is_empty = self.flow.is_empty(self.supervisor.all_running(), now);
        // Taken, so that a second signal is told from the first.
        let asked = self.stop.swap(false, Ordering::Relaxed);
        self.was_stopped |= asked;
        match self.phase {
            Phase::Running => {
                let over = match (self.options.ends, self.collector.first_result_ns()) {
                    (Ends::After(time), Some(first)) => now.saturating_sub(first) >= time.as_nanos() as u64,
                    _ => false,
                };
                if asked || over {
                    self.reason = if asked { "asked to stop" } else { "its time is up" }.into();
                    self.phase = Phase::Draining { until_ns: now + DRAIN_NS };
                    self.flow.drain();
                    self.send_command()?;
                } else if self.flow.is_finished() && self.options.ends != Ends::Never && is_empty {
                    self.stop_stages(now);
                }
            }
            Phase::Draining { until_ns } => {
                if asked || now >= until_ns || (self.flow.is_finished() && is_empty) {
                    self.stop_stages(now);
                }
            }
            Phase::Stopping => {}
        }
        Ok(())
    }

    fn stop_stages(&mut self, now: u64) {
        if self.phase != Phase::Stopping {
            self.phase = Phase::Stopping;
            self.shared_bytes = self.instance.shared_bytes();
            for action in self.supervisor.stop(now) {
                self.act(action, now);
            }
        }
    }

    fn status(&mut self, now: u64) -> StatusRecord {
        let mut own = ReportRecord::new(Role::Scheduler);
        own.cpu_ns = process_cpu_ns();
        if let Some(memory) = self.memory.read() {
            own.private_bytes = memory.private_bytes;
            own.file_bytes = memory.file_bytes;
            own.shared_bytes = memory.shared_bytes;
        }
        self.collector.report(&Header::new(Kind::Report), &own, now);
        let latency = self.collector.latency();
        let is_running = self.phase == Phase::Running && self.supervisor.all_running();
        let mut status = StatusRecord::empty();
        status.calibration = self.collector.calibration();
        status.heat = self.board.record();
        status.rig = self.rig_record();
        status.device = *self.collector.device();
        // The first counts.
        let fault = self.board.fault().or_else(|| {
            let is_off = status.calibration.state() == CalibrationState::Degraded;
            is_off.then(|| format!("calibration {}", status.calibration))
        });
        let fault = fault.or_else(|| status.device.is_lost().then(|| status.device.words()));
        status.pid = std::process::id();
        status.state = match (self.phase, self.supervisor.given_up()) {
            (Phase::Draining { .. } | Phase::Stopping, _) => 3,
            (Phase::Running, Some(_)) => 2,
            (Phase::Running, None) if is_running && fault.is_some() => 2,
            (Phase::Running, None) => u32::from(self.collector.results() > 0 && is_running),
        };
        let staleness = self.staleness(now);
        let fresh = self.last_result.filter(|_| staleness.is_none());
        status.alarm = fresh.map_or(alarm::OFF, |last| last.alarm.level);
        status.alarm_rule = fresh.map_or(0, |last| last.alarm.rule);
        status.alarm_faults = fresh.map_or(staleness.0, |last| last.alarm.faults);
        status.obstacles = fresh.map_or(0, |last| last.confirmed);
        status.nearest_m = fresh.map_or(f64::INFINITY, |last| last.alarm.nearest_m);
        status.alarms = self.collector.alarms;
        status.uptime_ns = now.saturating_sub(self.started_ns);
        status.frames = self.collector.results();
        status.latency_p50_ms = latency.p50_ms as f32;
        status.latency_p99_ms = latency.p99_ms as f32;
        match self.failure.as_ref().unwrap_or(&self.reason) {
            reason if reason.is_empty() && !self.source_trouble.is_empty() => {
                status.set_reason(&self.source_trouble);
            }
            reason if reason.is_empty() => status.set_reason(fault.as_deref().unwrap_or("")),
            reason => status.set_reason(reason),
        }
        let processes = self.collector.processes(&self.supervisor, &self.plan, now);
        for (place, process) in status.process.iter_mut().zip(processes) {
            *place = process;
            status.processes += 1;
        }
        status
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
            period_ns: self.flow.command().period_ns,
        }
    }

    /// The figures of the run, once all stages have ended.
    pub fn finish(mut self) -> RunOutcome {
        let now = monotonic_ns();
        self.status(now);
        let mut failure = self.failure.take();
        let may_be_empty = self.options.ends == Ends::Never || self.was_stopped;
        if failure.is_none() && !may_be_empty && self.collector.results() == 0 {
            failure = Some("no frame came out at the end: see the log for why".into());
        }
        let summary = self.collector.summary(&self.supervisor, &self.plan, self.shared_bytes, now);
        tracing::info!(frames = summary.frames, dropped = summary.dropped, lost = summary.lost, "stopped");
        let traces = self.collector.traces().to_vec();
        RunOutcome { summary, traces, failure, was_stopped: self.was_stopped }
    }
}

/// Whether this process was started to ignore SIGHUP (signal 1, the lowest bit of the mask).
fn ignores_hangup() -> bool {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let mask = status.lines().find_map(|line| line.strip_prefix("SigIgn:"));
    mask.and_then(|m| u64::from_str_radix(m.trim(), 16).ok()).is_some_and(|m| m & 1 == 1)
}

fn supervisor_parameters(config: &Config) -> SupervisorParameters {
    let c = &config.supervision;
    let ms = |v: i64| v.unsigned_abs() * 1_000_000;
    SupervisorParameters {
        startup_deadline_ns: ms(c.startup_deadline_ms),
        liveness_deadline_ns: ms(c.liveness_deadline_ms),
        restart_first_ns: ms(c.restart_first_ms),
        restart_longest_ns: ms(c.restart_longest_ms),
        restart_count: usize::try_from(c.restart_count).unwrap_or(0),
        restart_window_ns: ms(c.restart_window_s) * 1000,
        stop_grace_ns: ms(c.stop_grace_ms),
    }
}
