//! The scheduler: starts, paces, watches and stops the stages, and sums up what they report.

pub mod children;
pub mod collector;
pub mod cores;
pub mod supervisor;

use crate::input::{self, InputError};
use crate::launch::{FrameFormat, Launch};
use crate::memory::MemoryProbe;
use crate::rooms::RoomError;
use crate::rooms::recognition::RecognitionRoom;
use crate::stage::pin;
use children::Children;
use collector::{Collector, FrameTrace};
use config::Config;
use cores::CorePlan;
use ipc::bus::{Bus, IpcError};
use ipc::clock::{monotonic_ns, process_cpu_ns};
use ipc::command::CommandRecord;
use ipc::header::{Header, Kind};
use ipc::instance::{Instance, InstanceError, InstanceLock};
use ipc::port::{Publisher, Subscriber};
use ipc::report::{Health, ReportRecord};
use ipc::role::Role;
use ipc::status::StatusRecord;
use ipc::wait::{self, Next};
use ipc::{obstacles, report, service};
use perception::stereo::{FullMpv, MatcherError};
use signal_hook::consts::{SIGCHLD, SIGINT, SIGTERM};
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;
use supervisor::{Action, Supervisor, SupervisorParameters};
use thiserror::Error;
use tools::summary::RunSummary;

/// How often the scheduler looks at its clocks.
const TICK: Duration = Duration::from_millis(50);

/// How often it publishes its status.
const STATUS_PERIOD_NS: u64 = 1_000_000_000;

/// How long frames in flight may take to come out once the source has stopped.
const DRAIN_NS: u64 = 3_000_000_000;

/// Why the daemon cannot run.
#[derive(Debug, Error)]
pub enum RunError {
    /// No input.
    #[error(transparent)]
    Input(#[from] InputError),
    /// Another daemon, or no room in memory.
    #[error(transparent)]
    Instance(#[from] InstanceError),
    /// Shared memory cannot be used.
    #[error(transparent)]
    Ipc(#[from] IpcError),
    /// The frames cannot be matched.
    #[error("{source_name}: {error}")]
    Frames {
        /// The source.
        source_name: String,
        /// Why.
        error: MatcherError,
    },
    /// A stage cannot be furnished.
    #[error(transparent)]
    Room(#[from] RoomError),
    /// Results cannot be written.
    #[error(transparent)]
    Output(#[from] tools::output::OutputError),
    /// Signals or /proc.
    #[error("{0}")]
    System(#[from] std::io::Error),
}

/// When a run ends by itself.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ends {
    /// Never: it runs until it is stopped, degraded if need be.
    Never,
    /// When the source does, or a stage is given up.
    WithSource,
    /// This long after the first result, or as above.
    After(Duration),
}

/// How to run.
#[derive(Clone, Debug)]
pub struct RunOptions {
    /// Every frame, one at a time.
    pub lockstep: bool,
    /// At most this many pairs.
    pub limit: Option<u64>,
    /// Where to write results.
    pub out: Option<PathBuf>,
    /// When to end.
    pub ends: Ends,
}

/// What a run came to.
#[derive(Clone, Debug)]
pub struct RunOutcome {
    /// Its figures.
    pub summary: RunSummary,
    /// Times frame by frame.
    pub traces: Vec<FrameTrace>,
    /// Why it failed, if it did.
    pub failure: Option<String>,
}

/// Runs the daemon until it ends; `watch` sees every status.
///
/// # Errors
/// When it cannot start. What goes wrong later is in the outcome.
pub fn run(
    config: &Config,
    options: &RunOptions,
    watch: &mut dyn FnMut(&StatusRecord),
) -> Result<RunOutcome, RunError> {
    let mut scheduler = Scheduler::start(config, options)?;
    let (reports, results) =
        (scheduler.bus.subscriber(&service::REPORT)?, scheduler.bus.subscriber(&service::OBSTACLES)?);
    wait::run(&[&reports, &results], || scheduler.step(&reports, &results, watch))?;
    drop((reports, results));
    Ok(scheduler.finish())
}

/// What the run is doing.
#[derive(Clone, Debug, PartialEq, Eq)]
enum Phase {
    Running,
    /// The source is asked to stop; frames in flight come out until then.
    Draining {
        until_ns: u64,
    },
    /// The stages are asked to stop.
    Stopping,
}

struct Scheduler {
    options: RunOptions,
    launch: Launch,
    plan: CorePlan,
    supervisor: Supervisor,
    collector: Collector,
    children: Children,
    phase: Phase,
    failure: Option<String>,
    reason: String,
    stop: Arc<AtomicBool>,
    command: CommandRecord,
    /// The frame in lock-step, and the last ones that were seen.
    flow: Flow,
    /// A stage has died since all were last running.
    stage_died: bool,
    memory: MemoryProbe,
    started_ns: u64,
    status_due_ns: u64,
    shared_bytes: u64,
    alarm_level: u32,
    confirmed: u32,
    nearest_m: f64,
    // Last, in this order: the ports go before the bus, the bus before what it lives in.
    commands: Publisher,
    statuses: Publisher,
    bus: Bus,
    instance: Instance,
    _lock: InstanceLock,
}

/// Where frames are.
#[derive(Clone, Copy, Debug, Default)]
struct Flow {
    /// Last pair that capture published.
    published: Option<u64>,
    /// Last frame that recognition finished.
    recognised: Option<u64>,
    /// Last frame that the writer finished.
    written: Option<u64>,
    /// The source has no more.
    finished: bool,
    /// When any of these last moved.
    moved_ns: u64,
}

impl Flow {
    /// Whether frame `sequence` has gone all the way.
    fn is_done(&self, sequence: u64, with_writer: bool) -> bool {
        self.recognised >= Some(sequence) && (!with_writer || self.written >= Some(sequence))
    }
}

impl Scheduler {
    fn start(config: &Config, options: &RunOptions) -> Result<Self, RunError> {
        let started_ns = monotonic_ns();
        // All that can be known to be wrong is found before anything is started.
        let source = input::open(config)?;
        let rig = input::rig(config, source.as_ref())?;
        let (width, height) = source.size();
        let disparities = usize::try_from(config.stereo.disparities).unwrap_or(0);
        FullMpv::check(width, height, disparities).map_err(|error| RunError::Frames {
            source_name: match config.source.kind.as_str() {
                "folder" => config.source.path.display().to_string(),
                kind => kind.to_owned(),
            },
            error,
        })?;
        let frames = FrameFormat::new((width, height), rig);
        RecognitionRoom::new(config, &frames)?;
        if let Some(out) = &options.out {
            tools::output::prepare(out)?;
        }

        let instance = Instance::new(&config.instance.name, &config.instance.directory);
        let lock = InstanceLock::take(&instance)?;
        if lock.stale > 0 {
            tracing::warn!(files = lock.stale, "removed what an earlier run had left in shared memory");
        }
        let mut roles = Role::STAGES.to_vec();
        roles.extend(options.out.is_some().then_some(Role::Writer));
        let pool_bytes = service::total_pool_bytes(width, height, roles.len()) as u64;
        lock.check_memory(pool_bytes)?;
        tracing::info!(
            instance = instance.name(),
            width,
            height,
            pool_bytes,
            prefix = instance.prefix(),
            "starting"
        );

        let stop = Arc::new(AtomicBool::new(false));
        for signal in [SIGTERM, SIGINT] {
            signal_hook::flag::register(signal, Arc::clone(&stop))?;
        }
        // Only to be woken when a child ends.
        signal_hook::flag::register(SIGCHLD, Arc::new(AtomicBool::new(false)))?;

        let available: Vec<usize> =
            core_affinity::get_core_ids().unwrap_or_default().iter().map(|core| core.id).collect();
        let plan = CorePlan::new(&config.cores, &available);
        let all: Vec<Role> = std::iter::once(Role::Scheduler).chain(roles.iter().copied()).collect();
        tracing::info!(cores = available.len(), "{}", plan.describe(&all));
        if let Some(core) = plan.core(Role::Scheduler) {
            pin(core);
        }

        let bus = Bus::join(&instance)?;
        let commands = bus.publisher(&service::COMMAND, width, height)?;
        let statuses = bus.publisher(&service::STATUS, width, height)?;
        let count = if config.source.repeat { None } else { source.count() };
        let end_sequence = match (count, options.limit) {
            (Some(count), Some(limit)) => Some(count.min(limit)),
            (count, limit) => count.or(limit),
        };
        let period_ns = input::period_ns(config, source.as_ref());
        let launch = Launch {
            config: config.clone(),
            core: None,
            scheduler_pid: std::process::id(),
            frames,
            lockstep: options.lockstep,
            first_sequence: 0,
            end_sequence,
            period_ns,
            out: options.out.clone(),
            is_restart: false,
        };
        let now = monotonic_ns();
        Ok(Self {
            supervisor: Supervisor::new(supervisor_parameters(config), &roles, now),
            collector: Collector::new(&all, started_ns),
            children: Children::default(),
            phase: Phase::Running,
            failure: None,
            reason: String::new(),
            stop,
            command: CommandRecord { lockstep: u32::from(options.lockstep), period_ns, ..Default::default() },
            flow: Flow { moved_ns: now, ..Flow::default() },
            stage_died: false,
            memory: MemoryProbe::open()?,
            started_ns,
            status_due_ns: now,
            shared_bytes: 0,
            alarm_level: 0,
            confirmed: 0,
            nearest_m: f64::INFINITY,
            options: options.clone(),
            launch,
            plan,
            commands,
            statuses,
            bus,
            instance,
            _lock: lock,
        })
    }

    fn step(
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
                Ok(message) => self.take_result(&message),
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
        self.advance(now)?;
        if now >= self.status_due_ns {
            self.status_due_ns = now + STATUS_PERIOD_NS;
            let status = self.status(now);
            self.statuses.send_record(Header::new(Kind::Status), &status)?;
            watch(&status);
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
        if report.health() == Health::Unusable && self.failure.is_none() {
            tracing::error!("{}", report.text());
            self.failure = Some(report.text());
            self.stop_stages(now);
        }
        if report.health() == Health::Starting {
            return Ok(());
        }
        self.supervisor.reported(role, now);
        let may_flow = self.supervisor.all_running() || self.supervisor.given_up().is_some();
        if role == Role::Capture && report.is_frame == 0 && report.frames == 0 && may_flow {
            // It has just come up, and knows nothing yet.
            self.send_command()?;
        }
        if report.health() == Health::Finished && role == Role::Capture {
            self.flow.finished = true;
        }
        if report.is_frame == 1 {
            let place = match role {
                Role::Capture => &mut self.flow.published,
                Role::Recognition => &mut self.flow.recognised,
                Role::Writer => &mut self.flow.written,
                _ => return Ok(()),
            };
            *place = (*place).max(Some(header.sequence));
            self.flow.moved_ns = now;
            self.give_credit()?;
        }
        if !was_running && self.supervisor.all_running() {
            tracing::info!("all stages are running");
            self.let_flow()?;
        }
        Ok(())
    }

    /// In lock-step, allows the next frame once the last one has gone all the way.
    fn give_credit(&mut self) -> Result<(), IpcError> {
        if self.options.lockstep && self.flow.is_done(self.command.credit, self.options.out.is_some()) {
            self.command.credit += 1;
            self.command.attempt = 0;
            self.send_command()?;
        }
        Ok(())
    }

    /// All stages are there: nothing that is published now is lost. In lock-step, the frame that a
    /// dead stage may have taken to its grave is asked for once more.
    fn let_flow(&mut self) -> Result<(), IpcError> {
        if std::mem::take(&mut self.stage_died) && self.flow.published == Some(self.command.credit) {
            self.command.attempt += 1;
        }
        self.send_command()
    }

    fn send_command(&self) -> Result<(), IpcError> {
        self.commands.send_record(Header::new(Kind::Command), &self.command)
    }

    fn take_result(&mut self, message: &obstacles::Obstacles<'_>) {
        self.alarm_level = message.alarm.level;
        self.nearest_m = message.alarm.nearest_m;
        self.confirmed = message.obstacles.iter().filter(|o| o.confirmed == 1).count() as u32;
        self.collector.alarm(message.alarm.level);
    }

    fn take_exit(&mut self, role: Role, how: &str, now: u64) {
        if self.phase == Phase::Stopping {
            tracing::debug!(%role, how, "stage ended");
        } else {
            tracing::warn!(%role, how, "stage ended unasked");
        }
        self.stage_died = true;
        // Only reaped children count as dead; now their places can be freed.
        let sweep = self.bus.sweep();
        if sweep.failed > 0 {
            tracing::warn!(?sweep, "shared memory of a dead stage could not be removed");
        }
        if let Some(action) = self.supervisor.exited(role, how, now) {
            self.act(action, now);
        }
    }

    fn act(&mut self, action: Action, now: u64) {
        match action {
            Action::Spawn(role) => {
                let mut launch = Launch { core: self.plan.core(role), ..self.launch.clone() };
                launch.is_restart = self.supervisor.restarts(role) > 0;
                if role == Role::Capture && launch.is_restart {
                    launch.first_sequence = match self.flow.published {
                        _ if self.options.lockstep => self.command.credit,
                        Some(last) => last + 1,
                        None => 0,
                    };
                }
                match self.children.spawn(role, &launch) {
                    Ok(pid) => {
                        tracing::info!(%role, pid, "stage started");
                        self.supervisor.spawned(role, now);
                    }
                    Err(error) => {
                        tracing::error!(%role, %error, "stage cannot be started");
                        self.supervisor.spawned(role, now);
                        if let Some(action) = self.supervisor.exited(role, "could not be started", now) {
                            self.act(action, now);
                        }
                    }
                }
            }
            Action::Terminate(role) => self.children.terminate(role),
            Action::Kill(role, why) => {
                tracing::warn!(%role, why, "stage is killed");
                self.children.kill(role);
            }
            Action::GiveUp(role, reason) => {
                tracing::error!(%role, %reason, "stage is given up");
                self.reason.clone_from(&reason);
                if self.options.ends != Ends::Never {
                    self.failure.get_or_insert(reason);
                    self.stop_stages(now);
                }
            }
        }
    }

    /// Ends the run when it is time to.
    fn advance(&mut self, now: u64) -> Result<(), IpcError> {
        match self.phase {
            Phase::Running => {
                let over = match self.options.ends {
                    Ends::After(time) => self
                        .collector
                        .first_result_ns()
                        .is_some_and(|first| now.saturating_sub(first) >= time.as_nanos() as u64),
                    _ => false,
                };
                if self.stop.load(Ordering::Relaxed) {
                    self.reason = "asked to stop".into();
                    self.drain(now)?;
                } else if over {
                    self.reason = "its time is up".into();
                    self.drain(now)?;
                } else if self.flow.finished && self.options.ends != Ends::Never && self.is_empty(now) {
                    self.stop_stages(now);
                }
            }
            Phase::Draining { until_ns } => {
                if now >= until_ns || (self.flow.finished && self.is_empty(now)) {
                    self.stop_stages(now);
                }
            }
            Phase::Stopping => {}
        }
        Ok(())
    }

    /// Whether the last pair has come out at the end, or will not come any more.
    fn is_empty(&self, now: u64) -> bool {
        let with_writer = self.options.out.is_some();
        let done = self.flow.published.is_none_or(|last| self.flow.is_done(last, with_writer));
        // A frame in a stage that died is lost at live rate; the newest one has no successor.
        let lost = !self.options.lockstep
            && self.supervisor.all_running()
            && now.saturating_sub(self.flow.moved_ns) > DRAIN_NS;
        done || lost
    }

    fn drain(&mut self, now: u64) -> Result<(), IpcError> {
        self.phase = Phase::Draining { until_ns: now + DRAIN_NS };
        self.command.drain = 1;
        self.send_command()
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
            (own.private_bytes, own.shared_bytes) = (memory.private_bytes, memory.shared_bytes);
        }
        self.collector.report(&Header::new(Kind::Report), &own, now);
        let latency = self.collector.latency();
        let mut status = StatusRecord::empty();
        status.pid = std::process::id();
        status.state = match (&self.phase, self.supervisor.given_up()) {
            (Phase::Draining { .. } | Phase::Stopping, _) => 3,
            (Phase::Running, Some(_)) => 2,
            (Phase::Running, None) => {
                u32::from(self.collector.results() > 0 && self.supervisor.all_running())
            }
        };
        status.alarm = self.alarm_level;
        status.alarms = self.collector.alarms;
        status.obstacles = self.confirmed;
        status.uptime_ns = now.saturating_sub(self.started_ns);
        status.frames = self.collector.results();
        status.nearest_m = self.nearest_m;
        status.latency_p50_ms = latency.p50_ms as f32;
        status.latency_p99_ms = latency.p99_ms as f32;
        let reason = self.failure.as_ref().unwrap_or(&self.reason);
        status.set_reason(reason);
        let processes = self.collector.processes(&self.supervisor, &self.plan, now);
        for (place, process) in status.process.iter_mut().zip(processes) {
            *place = process;
            status.processes += 1;
        }
        if let Some(scheduler) = status.process.first_mut() {
            scheduler.pid = std::process::id();
        }
        status
    }

    fn finish(mut self) -> RunOutcome {
        let now = monotonic_ns();
        self.status(now);
        let mut failure = self.failure.take();
        let ends_early = self.options.ends == Ends::Never || self.stop.load(Ordering::Relaxed);
        if failure.is_none() && !ends_early && self.collector.results() == 0 {
            failure = Some("no frame came out at the end: see the log for why".into());
        }
        let summary = self.collector.summary(&self.supervisor, &self.plan, self.shared_bytes, now);
        tracing::info!(frames = summary.frames, dropped = summary.dropped, "stopped");
        RunOutcome { summary, traces: self.collector.traces().to_vec(), failure }
    }
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
