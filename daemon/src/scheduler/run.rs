//! One run of the daemon: the state of the scheduler and its actions at each wake-up.

mod result;
mod start;
mod state;

use super::board::Board;
use super::children::Children;
use super::collector::Collector;
use super::cores::CorePlan;
use super::credit::{Credit, DRAIN_NS};
use super::deadline_monitor::DeadlineMonitor;
use super::diagnostics::{Condition, Diagnostics, SourceRecovery};
use super::figures::MinuteFigures;
use super::notify::Notify;
use super::options::{Ends, RunError, RunOptions, RunOutcome};
use super::pacer::Pacer;
use super::supervisor::{Action, Supervisor};
use crate::frame_record::motion_line;
use crate::input;
use crate::launch::Launch;
use crate::memory::MemoryProbe;
use crate::realtime;
use config::Config;
use messages::bus::{Bus, IpcError};
use messages::clock::monotonic_ns;
use messages::free_memory::Cushion;
use messages::header::{Header, Kind};
use messages::instance::{Instance, InstanceLock};
use messages::pipeline::Role;
use messages::port::{Publisher, Sample, Subscriber};
use messages::realtime::RealtimeRecord;
use messages::report::{Health, ReportRecord};
use messages::status::StatusRecord;
use messages::wait::Next;
use messages::{obstacles, report, service};
use result::Results;
pub use start::Process;
use start::{
    check_memory, launch, open_source, pacer_parameters, prepare_outputs, roles, supervisor_parameters,
};
use std::io::IsTerminal;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

/// Maximum time between two wake-ups of the scheduler.
const TICK: Duration = Duration::from_millis(50);

/// Time between two status messages, in nanoseconds.
const STATUS_PERIOD_NS: u64 = 1_000_000_000;

/// Phase of a run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Phase {
    Running,
    /// The source has stopped. Frames in flight are processed, at most until this time.
    Draining {
        until_ns: u64,
    },
    /// The stages are stopping.
    Stopping,
}

/// The state of the scheduler.
pub struct Run {
    options: RunOptions,
    pub(super) launch: Launch,
    plan: CorePlan,
    pub(super) supervisor: Supervisor,
    pub(super) collector: Collector,
    children: Children,
    pub(super) credit: Credit,
    pub(super) phase: Phase,
    pub(super) board: Board,
    pub(super) notify: Notify,
    /// Set by SIGHUP.
    pub(super) hangup: Arc<AtomicBool>,
    pacer: Pacer,
    deadline_monitor: DeadlineMonitor,
    diagnostics: Diagnostics,
    source_recovery: SourceRecovery,
    realtime: RealtimeRecord,
    failure: Option<String>,
    /// A file of this run that another program has removed.
    lost: Option<PathBuf>,
    /// Why the run is stopping; else empty.
    reason: String,
    stop: Arc<AtomicBool>,
    retry: Arc<AtomicBool>,
    was_stopped: bool,
    memory: MemoryProbe,
    started_ns: u64,
    status_due_ns: u64,
    shared_bytes: u64,
    figures: MinuteFigures,
    // The last fields, in this order: ports are dropped before the bus, the bus before the instance.
    results: Results,
    commands: Publisher,
    statuses: Publisher,
    /// Pages for readers that join when /dev/shm is full; `None` if there was no room for them.
    cushion: Option<Cushion>,
    /// The scheduler's node in shared memory.
    pub bus: Bus,
    instance: Instance,
    lock: InstanceLock,
}

impl Run {
    /// Checks configuration, source and memory, takes the instance, and sets up the run.
    pub fn start(config: &Config, options: &RunOptions, process: &mut Process) -> Result<Self, RunError> {
        let started_ns = monotonic_ns();
        let (source, frames) = open_source(config)?;
        let (width, height) = (frames.width, frames.height);
        // Signal handlers come before any file is created that a signal would leave behind.
        let signals = process.signals(options.ends)?;
        let instance = Instance::new(&config.instance.name, &config.instance.directory);
        let mut lock = InstanceLock::take(&instance)?;
        if lock.stale > 0 {
            tracing::warn!(files = lock.stale, "removed files of a dead run");
        }
        let board = Board::start(config, instance.directory(), started_ns)?;
        prepare_outputs(options)?;
        let roles = roles(options);
        check_memory(&lock, &instance, &frames, roles.len())?;

        let plan = CorePlan::new(&config.cores, &process.cores);
        let all: Vec<Role> = std::iter::once(Role::Scheduler).chain(roles.iter().copied()).collect();
        tracing::info!(cores = process.cores.len(), "{}", plan.describe(&all));
        // The scheduler requests its privileges first: if they are refused, those of the stages will be, too.
        let mut realtime = realtime::enter(config, Role::Scheduler, plan.core(Role::Scheduler))?;
        tracing::info!("scheduler: {realtime}");

        let launch = launch(config, options, source.as_ref(), frames);
        // Detects an unserialisable document before the first stage is started.
        launch.text()?;
        let bus = Bus::join(&instance)?;
        let now = monotonic_ns();
        let parameters = supervisor_parameters(config);
        let timeout_ns = parameters.liveness_deadline_ns;
        let mut collector = Collector::new(&all, started_ns);
        if matches!(options.ends, Ends::After(_)) {
            // The demo plots them.
            collector.keep_traces();
        }
        let period_ns = input::period_ns(config, source.as_ref());
        let pacer = Pacer::new(pacer_parameters(config, options.lockstep, period_ns), now);
        // In lock-step only the liveness deadline limits the time of a frame.
        let stale_ns = if options.lockstep { timeout_ns } else { (config.pacing.stale_ms * 1e6) as u64 };
        let commands = bus.publisher(&service::COMMAND, width, height)?;
        let statuses = bus.publisher(&service::STATUS, width, height)?;
        let results = Results::new(bus.publisher(&service::OBSTACLES, width, height)?, stale_ns);
        realtime::reserve(config, &bus, &mut realtime)?;
        lock.record_files();
        let cushion = Cushion::create(lock.prefix())
            .inspect_err(|error| tracing::warn!(%error, "no memory is kept for readers that join when /dev/shm is full"))
            .ok();
        Ok(Self {
            supervisor: Supervisor::new(parameters, &roles, now),
            collector,
            children: Children::default(),
            credit: Credit::new(options.lockstep, &roles, pacer.period_ns(), timeout_ns, now),
            pacer,
            deadline_monitor: DeadlineMonitor::new(config.pacing.late_frames.unsigned_abs()),
            diagnostics: Diagnostics::default(),
            source_recovery: SourceRecovery::default(),
            realtime,
            phase: Phase::Running,
            board,
            notify: Notify::from_environment(),
            hangup: signals.hangup,
            lost: None,
            failure: None,
            reason: String::new(),
            stop: signals.stop,
            retry: signals.retry,
            was_stopped: false,
            memory: MemoryProbe::open()?,
            started_ns,
            status_due_ns: now,
            shared_bytes: 0,
            figures: MinuteFigures::default(),
            options: options.clone(),
            launch,
            plan,
            results,
            commands,
            statuses,
            cushion,
            bus,
            instance,
            lock,
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
            if !self.results.is_own(&sample) {
                self.take_result(&sample);
            }
        }
        let now = monotonic_ns();
        for (role, how) in self.children.reap() {
            self.take_exit(role, &how, now);
        }
        for action in self.supervisor.tick(now) {
            self.act(action, now);
        }
        if self.retry.swap(false, Ordering::Relaxed) {
            tracing::info!("retrying the stages that were given up, on request");
            self.supervisor.retry(now);
        }
        if let Some(period_ns) = self.pacer.tick(now) {
            tracing::info!(rate_hz = 1e9 / period_ns as f64, slowest = ?self.pacer.slowest(), "pace");
            self.credit.set_period(period_ns);
            self.send_command()?;
        }
        if self.credit.tick(self.supervisor.all_running(), now) {
            tracing::warn!("no progress of the frame in lock-step: requesting it again");
            self.send_command()?;
        }
        if let Some(heat) = self.board.tick(now)
            && self.credit.limit(&heat)
        {
            self.send_command()?;
        }
        self.advance(now)?;
        self.notify(now);
        let period_ns = self.credit.command().period_ns;
        let withdrawn = self.results.withdraw_stale(self.supervisor.frames_pass(), period_ns, now)?;
        if let (Phase::Running, Some(faults)) = (self.phase, withdrawn) {
            self.collector.alarm_off(faults);
        }
        if now >= self.status_due_ns {
            self.status_due_ns = now + STATUS_PERIOD_NS;
            if let Some(cushion) = &self.cushion {
                cushion.refill();
            }
            let status = self.status(now);
            self.statuses.send_record(Header::new(Kind::Status), &status)?;
            self.notify_status(&status, now);
            watch(&status);
            self.figures.tick(&status);
            if self.look_for_loss().is_some() {
                return Ok(Next::Stop);
            }
        } else {
            // New subscribers receive the last status.
            self.statuses.refresh()?;
        }
        self.results.refresh()?;
        if self.phase == Phase::Stopping && self.supervisor.all_ended() {
            return Ok(Next::Stop);
        }
        Ok(Next::Wait(TICK))
    }

    /// A file of this run that another program has removed. No process can join the run any more, so its stages cannot
    /// be restarted.
    pub fn look_for_loss(&mut self) -> Option<&Path> {
        if self.lost.is_none() && self.phase == Phase::Running {
            self.lost = self.lock.missing_file().map(Path::to_owned);
        }
        self.lost.as_deref()
    }

    /// Handles a message of the last stage.
    fn take_result(&mut self, sample: &Sample) {
        let header = *sample.header();
        match obstacles::view(&header, sample.payload()) {
            Err(error) => tracing::warn!(%error, "obstacles were refused"),
            Ok(message) => {
                if self.results.take(header, &message) {
                    self.collector.alarm(&header, &message.alarm);
                    self.collector.motion.add(&motion_line(&header.motion));
                }
            }
        }
    }

    fn take_report(&mut self, header: &Header, report: &ReportRecord) -> Result<(), IpcError> {
        let Some(role) = report.role() else { return Ok(()) };
        if self.children.pid(role) != Some(report.pid) {
            // It comes from a process that was replaced.
            return Ok(());
        }
        let now = monotonic_ns();
        let was_running = self.supervisor.all_running();
        self.collector.report(header, report, now);
        self.take_health(role, report, now);
        if self.options.lockstep && report.refused > 0 {
            // The frame is lost, which contradicts lock-step.
            self.fail(format!("the {role} stage refused a message: {}", report.text()), now);
        }
        if report.health() == Health::Starting {
            return Ok(());
        }
        self.supervisor.reported(role, now);
        let is_running = self.supervisor.all_running();
        if !was_running && is_running {
            tracing::info!("all stages are running");
            self.credit.all_running(now);
            self.send_command()?;
        } else if role == Role::SOURCE && report.is_frame == 0 && report.frames == 0 {
            // Capture has just started and has no command yet. It gets one only when all stages are running:
            // pairs that it published before would be lost.
            if is_running || self.supervisor.given_up().is_some() {
                self.send_command()?;
            }
        }
        if report.health() == Health::Unreadable && role == Role::SOURCE {
            return self.take_unreadable(header.sequence, &report.text(), now);
        }
        if report.health() == Health::Finished && role == Role::SOURCE {
            self.credit.source_finished();
        }
        if report.is_frame == 1 {
            self.pacer.work(role, report.work_ns);
            if role == Role::LAST {
                self.take_lateness(report);
            }
        }
        if report.is_frame == 1 && self.credit.frame_done(role, header.sequence, now) {
            self.send_command()?;
        }
        Ok(())
    }

    /// The source left a pair out. A restarted source may tell that once more.
    fn take_unreadable(&mut self, sequence: u64, reason: &str, now: u64) -> Result<(), IpcError> {
        if self.collector.unreadable(sequence, reason) {
            tracing::warn!(sequence, "pair left out: {reason}");
        }
        if self.credit.left_out(sequence, now) { self.send_command() } else { Ok(()) }
    }

    fn send_command(&self) -> Result<(), IpcError> {
        self.commands.send_record(Header::new(Kind::Command), &self.credit.command())
    }

    /// Handles the health of a stage. A service waits for a source that cannot be read; any other run fails.
    fn take_health(&mut self, role: Role, report: &ReportRecord, now: u64) {
        let waits = role == Role::SOURCE && self.options.ends == Ends::Never;
        let reason = match report.health() {
            Health::Unusable if !waits => return self.fail(report.text(), now),
            Health::Unusable | Health::Stalled if role == Role::SOURCE => Some(report.text()),
            _ if role == Role::SOURCE => None,
            _ => return,
        };
        let is_new = self.diagnostics.set(Condition::Source, reason.as_deref());
        if self.source_recovery.take(report.pid, report.frames, reason.is_some()) {
            tracing::info!("source: it has recovered");
        }
        if let (true, Some(reason)) = (is_new, reason) {
            tracing::warn!("source: {reason}");
        }
    }

    fn take_lateness(&mut self, report: &ReportRecord) {
        let deadline = report.deadline;
        if self.deadline_monitor.frame(deadline.late_in_a_row > 0) {
            let reason = self.deadline_monitor.is_late().then(|| {
                let (age_ms, of_ms) = (deadline.age_ns as f64 * 1e-6, deadline.deadline_ns as f64 * 1e-6);
                format!(
                    "results are late: {} in a row, the last after {age_ms:.0} ms of {of_ms:.0}",
                    deadline.late_in_a_row
                )
            });
            match &reason {
                Some(reason) => tracing::warn!("{reason}"),
                None => tracing::info!("results are in time again"),
            }
            self.diagnostics.set(Condition::Late, reason.as_deref());
        }
    }

    fn take_exit(&mut self, role: Role, how: &str, now: u64) {
        if self.phase == Phase::Stopping || self.supervisor.is_renewing(role) {
            tracing::debug!(%role, how, "stage ended");
        } else {
            tracing::warn!(%role, how, "stage ended unexpectedly");
        }
        self.credit.stage_died();
        self.collector.ended(role);
        // The child has been reaped, so iceoryx2 treats it as dead and frees its ports.
        let sweep = self.bus.sweep();
        if sweep.failed > 0 {
            tracing::warn!(?sweep, "shared memory of a dead stage could not be removed");
        }
        if matches!(self.phase, Phase::Draining { .. }) {
            // The whole process group may have been stopped: no more results follow, and nothing is restarted.
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
                if self.options.ends != Ends::Never {
                    self.fail(reason, now);
                }
            }
        }
    }

    fn spawn(&mut self, role: Role, now: u64) {
        let threads = if role == Role::Stereo { self.launch.config.stereo.threads } else { 1 };
        let helpers = usize::try_from(threads - 1).unwrap_or(0);
        let mut launch = Launch {
            core: self.plan.core(role),
            helper_cores: self.plan.helpers(role, helpers, start::capacity),
            ..self.launch.clone()
        };
        if role == Role::SOURCE {
            launch.first_sequence = self.credit.resume_at();
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

    /// Fails the run and stops the stages. Only the first reason is kept.
    fn fail(&mut self, reason: String, now: u64) {
        if self.failure.is_none() && self.phase != Phase::Stopping {
            // The command says it at the end; a service's log has it with its level, too, where that is another place.
            if self.options.ends == Ends::Never && !std::io::stderr().is_terminal() {
                tracing::error!("{reason}");
            } else {
                tracing::debug!("the run fails: {reason}");
            }
            self.failure = Some(reason);
            self.stop_stages(now);
        }
    }

    /// Advances the phase: drains or stops the run if that is due.
    fn advance(&mut self, now: u64) -> Result<(), IpcError> {
        let is_empty = self.credit.is_empty(self.supervisor.all_running(), now);
        // The flag is reset to detect a second signal, which skips draining.
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
                    self.credit.drain();
                    self.send_command()?;
                } else if self.credit.is_finished() && self.options.ends != Ends::Never && is_empty {
                    self.stop_stages(now);
                }
            }
            Phase::Draining { until_ns } => {
                if asked || now >= until_ns || (self.credit.is_finished() && is_empty) {
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

    /// Gives the run up without an orderly end, and returns the configuration in use.
    pub fn abandon(self) -> Config {
        self.launch.config.clone()
    }

    /// The outcome of the run, once all stages have ended.
    pub fn finish(mut self) -> RunOutcome {
        let now = monotonic_ns();
        self.status(now);
        let mut failure = self.failure.take();
        if let (None, Some(path)) = (&failure, &self.lost) {
            failure = Some(format!("{}: another program has removed it during the run", path.display()));
        }
        let may_be_empty = self.options.ends == Ends::Never || self.was_stopped;
        if failure.is_none() && !may_be_empty && self.collector.results() == 0 {
            failure = Some(match self.collector.last_unreadable() {
                Some(reason) => format!("no pair can be read: {reason}"),
                None => "there was no result: see the log for the reason".into(),
            });
        }
        let summary = self.collector.summary(&self.supervisor, &self.plan, self.shared_bytes, now);
        tracing::info!(frames = summary.frames, dropped = summary.dropped, lost = summary.lost, "stopped");
        let traces = self.collector.traces().to_vec();
        RunOutcome { summary, traces, failure, was_stopped: self.was_stopped }
    }
}
