//! Observes a daemon through shared memory and /proc, and injects faults.

use super::child::DaemonChild;
use super::error::SoakError;
use super::hot_board::HotBoard;
use super::plan::{Plan, Progress};
use super::probe::Probes;
use super::processes::{MachineTime, Processes, Reading, waited_ns};
use config::Config;
use messages::bus::Bus;
use messages::clock::monotonic_ns;
use messages::header::Header;
use messages::instance::Instance;
use messages::pipeline::{PATH, Role};
use messages::report::ReportRecord;
use messages::status::StatusRecord;
use messages::wait::{self, Next};
use messages::{report, service, status};
use rustix::process::{Pid, kill_process};
use std::collections::BTreeMap;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;
use tools::reporting::summary::Latency;
use tools::soak::director::{Director, Order, Signal};
use tools::soak::latency::{Latencies, PathStage, Trace};
use tools::soak::stalls::Stalls;
use tools::soak::trend::Trend;

/// Longest wait between two steps of the observer.
const TICK: Duration = Duration::from_millis(10);

/// Period of reading /proc and /dev/shm.
const SAMPLE_NS: u64 = 1_000_000_000;

/// Period of reading the run-queue delays of the stages.
const DELAY_NS: u64 = 5_000_000;

/// No fault is injected in this last part of a run, so that the recovery from the last one is observed.
const TAIL_NS: u64 = 3_000_000_000;

/// A daemon without results for this long counts as failed.
const RESULT_TIMEOUT_NS: u64 = 120_000_000_000;

/// Why a run is over.
#[derive(Debug, PartialEq)]
pub enum Ended {
    /// The planned time or number of kills was reached.
    InTime,
    /// Any other reason, as text.
    Because(String),
}

/// Counters of the daemon's status at one time.
#[derive(Clone, Copy, Debug, Default)]
pub struct Counts {
    /// For each role: frames, skipped, refused, restarts.
    pub roles: [[u64; 4]; Role::COUNT],
    /// Frames with results.
    pub frames: u64,
}

impl Counts {
    fn of(status: &StatusRecord) -> Self {
        let mut counts = Self { frames: status.frames, ..Self::default() };
        for (role, p) in status.processes() {
            counts.roles[role as usize] = [p.frames, p.skipped, p.refused, p.restarts.into()];
        }
        counts
    }
}

/// Values at the end of the warm-up, from which on is measured.
#[derive(Clone, Debug)]
pub struct Base {
    /// Time on the monotonic clock.
    pub at_ns: u64,
    /// Counters of the daemon.
    pub counts: Counts,
    /// Processor time of each role.
    pub cpu_ns: [u64; Role::COUNT],
    /// Processor time of the machine.
    pub machine: MachineTime,
}

/// Measures a daemon and injects faults.
pub struct Observer {
    pub(super) period_ns: u64,
    pub(super) started_ns: u64,
    pub(super) first_result_ns: Option<u64>,
    pub(super) base: Option<Base>,
    pub(super) end_ns: u64,
    pub(super) counts: Counts,
    pub(super) cores: [Option<u32>; Role::COUNT],
    pub(super) processes: Processes,
    pub(super) stalls: Stalls,
    pub(super) probe_policy: String,
    pub(super) latencies: Option<Latencies>,
    pub(super) director: Option<Director>,
    /// Resident memory of all processes over seconds since the start, in bytes; so are the trends below.
    pub(super) memory: Trend,
    /// Private memory and reserved shared memory: the part that could grow without bound.
    pub(super) growing: Trend,
    /// Private memory of each role.
    pub(super) role_memory: [Trend; Role::COUNT],
    /// Processor time of each role, in percent of one core.
    pub(super) role_cpu: [Trend; Role::COUNT],
    /// Number of entries in /dev/shm.
    pub(super) entries: Trend,
    pub(super) shared_bytes: u64,
    pub(super) reserved_bytes: u64,
    /// Description of the device that matches.
    pub(super) device: String,
    /// Time of the device for each pair.
    pub(super) device_time: Latency,
    /// Minimum and maximum reading of each clock.
    pub(super) clocks_mhz: BTreeMap<String, [f64; 2]>,
    probes: Option<Probes>,
    parameters: Option<tools::soak::director::DirectorParameters>,
    instance: Instance,
    daemon_pid: u32,
    warm_up_ns: u64,
    time_ns: Option<u64>,
    last_result_ns: u64,
    tail_ns: Option<u64>,
    sampled_ns: u64,
    delays_ns: u64,
    sampled_cpu_ns: [u64; Role::COUNT],
    pub(super) status_ns: u64,
    gave_up: Option<String>,
    board: HotBoard,
    probe_priority: Option<u32>,
}

impl Observer {
    /// Creates an observer of a daemon that was just started.
    pub fn new(config: &Config, plan: &Plan, daemon: &DaemonChild) -> Self {
        let now = monotonic_ns();
        Self {
            period_ns: (1e9 / config.source.fps) as u64,
            started_ns: daemon.started_ns,
            first_result_ns: None,
            base: None,
            end_ns: now,
            counts: Counts::default(),
            cores: [None; Role::COUNT],
            processes: Processes::default(),
            stalls: Stalls::default(),
            probe_policy: String::new(),
            latencies: None,
            director: None,
            memory: Trend::new(1.0),
            growing: Trend::new(1.0),
            role_memory: std::array::from_fn(|_| Trend::new(1.0)),
            role_cpu: std::array::from_fn(|_| Trend::new(1.0)),
            entries: Trend::new(1.0),
            shared_bytes: 0,
            reserved_bytes: 0,
            device: String::new(),
            device_time: Latency::new(),
            clocks_mhz: BTreeMap::new(),
            probes: None,
            parameters: plan.faults,
            instance: daemon.instance.clone(),
            daemon_pid: daemon.pid(),
            warm_up_ns: (config.soak.warm_up_s * 1e9) as u64,
            time_ns: plan.time.map(|time| time.as_nanos() as u64),
            last_result_ns: now,
            tail_ns: None,
            sampled_ns: 0,
            delays_ns: 0,
            sampled_cpu_ns: [0; Role::COUNT],
            status_ns: now,
            gave_up: None,
            board: HotBoard::of(&config.board.sysfs),
            probe_priority: crate::realtime::lowest_priority(config),
        }
    }

    /// Observes until the run is over.
    pub fn watch(
        &mut self,
        bus: &Bus,
        daemon: &mut DaemonChild,
        stop: &Arc<AtomicBool>,
        progress: &mut dyn FnMut(&Progress),
    ) -> Result<Ended, SoakError> {
        let reports = bus.subscriber(&service::REPORT)?;
        let statuses = bus.subscriber(&service::STATUS)?;
        let mut ended = Ended::InTime;
        let mut progress_ns = monotonic_ns();
        wait::run::<SoakError>(&[&reports, &statuses], || {
            while let Some(sample) = statuses.receive()? {
                if let Ok(status) = status::view(sample.header(), sample.payload()) {
                    self.take_status(&status)?;
                }
            }
            while let Some(sample) = reports.receive()? {
                if let Ok(report) = report::view(sample.header(), sample.payload()) {
                    self.take_report(sample.header(), &report);
                }
            }
            let now = monotonic_ns();
            self.step(now);
            if now.saturating_sub(progress_ns) >= self.progress_period_ns() {
                progress_ns = now;
                progress(&self.progress(now));
            }
            if let Some(over) = self.is_over(now, daemon, stop)? {
                ended = over;
                return Ok(Next::Stop);
            }
            Ok(Next::Wait(TICK))
        })?;
        self.end_ns = monotonic_ns();
        self.processes.read();
        if let (Some(latencies), director) = (&mut self.latencies, &self.director) {
            let open = director.as_ref().and_then(Director::open_since_ns);
            latencies.settle(u64::MAX, open, &self.stalls);
        }
        Ok(ended)
    }

    /// Stops the probes and keeps their policy for the report.
    pub fn stop_probes(&mut self) {
        if let Some(probes) = self.probes.take() {
            self.probe_policy = probes.policy();
        }
    }

    fn take_status(&mut self, status: &StatusRecord) -> Result<(), SoakError> {
        if status.pid != self.daemon_pid {
            return Ok(());
        }
        self.status_ns = monotonic_ns();
        self.counts = Counts::of(status);
        self.processes.add_report(Role::Scheduler, status.pid, 0);
        if let Some(director) = &mut self.director
            && status.heat.rung_name() == "stopped"
        {
            director.held_up();
        }
        for (role, process) in status.processes() {
            self.cores[role as usize] = u32::try_from(process.core).ok();
            if process.state() == "given up" {
                self.gave_up = Some(format!("the daemon has given up {role}: {}", status.reason()));
            }
        }
        if self.base.is_some() {
            for clock in status.heat.clocks().iter().filter(|clock| clock.read_mhz > 0.0) {
                let read = f64::from(clock.read_mhz);
                let [min, max] = self.clocks_mhz.entry(clock.name()).or_insert([read; 2]);
                (*min, *max) = (min.min(read), max.max(read));
            }
        }
        if self.probes.is_none() && self.latencies.is_none() {
            let path = PATH.map(|role| PathStage { name: role.name(), core: self.cores[role as usize] });
            let cores = path.map(|stage| stage.core);
            let probes = Probes::start(&cores.into(), self.probe_priority)
                .map_err(|source| SoakError::Io { path: "probe thread".into(), source })?;
            self.probes = Some(probes);
            self.latencies = Some(Latencies::new(self.started_ns, self.period_ns, &path));
        }
        Ok(())
    }

    fn take_report(&mut self, header: &Header, report: &ReportRecord) {
        let Some(role) = report.role() else { return };
        let is_new = self.processes.add_report(role, report.pid, report.cpu_ns);
        if let (true, Some(stage), Some(director)) = (is_new, stage_index(role), &mut self.director) {
            director.restarted(stage);
        }
        if role == Role::Stereo && report.is_frame == 1 && self.base.is_some() {
            self.device = report.device.describe();
            let ms: f32 = report.device.times_ms().iter().sum();
            if ms > 0.0 {
                self.device_time.add_ns((f64::from(ms) * 1e6) as u64);
            }
        }
        if role != Role::LAST || report.is_frame != 1 {
            return;
        }
        let trace = Trace {
            sequence: header.sequence,
            capture_ns: header.capture_ns,
            stamps: header.stamps.iter().map(|stamp| (stamp.begin_ns, stamp.end_ns)).collect(),
        };
        self.last_result_ns = monotonic_ns();
        self.first_result_ns.get_or_insert(header.result_ns());
        let Some(latencies) = &mut self.latencies else { return };
        latencies.add(trace, &self.stalls);
        if let Some(director) = &mut self.director
            && let Some(recovered) = director.result(header.capture_ns, header.result_ns())
        {
            latencies.disturb(recovered.from_ns, recovered.result_ns);
        }
    }

    /// Periodic work: ends the warm-up, samples /proc, injects faults, settles latencies.
    fn step(&mut self, now: u64) {
        if let Some(probes) = &self.probes {
            probes.take(&mut self.stalls);
        }
        if self.base.is_none()
            && self.first_result_ns.is_some_and(|first| now >= first + self.warm_up_ns)
            // The counters come from the status: start right after one, while they are current.
            && now.saturating_sub(self.status_ns) < 50_000_000
        {
            self.begin(now);
        }
        let is_calm = self.open_fault_ns().is_none();
        if is_calm && now.saturating_sub(self.sampled_ns) >= SAMPLE_NS {
            self.sample(now);
        }
        self.direct(now);
        let open = self.open_fault_ns();
        if let Some(latencies) = &mut self.latencies {
            if now.saturating_sub(self.delays_ns) >= DELAY_NS {
                self.delays_ns = now;
                for (times, role) in latencies.stages.iter_mut().zip(PATH) {
                    if let Some(total_ns) = self.processes.pid(role).and_then(waited_ns) {
                        times.delays.add(monotonic_ns(), total_ns);
                    }
                }
            }
            latencies.settle(now, open, &self.stalls);
        }
        self.stalls.forget_before(now.saturating_sub(RESULT_TIMEOUT_NS));
    }

    fn open_fault_ns(&self) -> Option<u64> {
        self.director.as_ref().and_then(Director::open_since_ns)
    }

    /// Ends the warm-up.
    fn begin(&mut self, now: u64) {
        self.processes.read();
        self.base = Some(Base {
            at_ns: now,
            counts: self.counts,
            cpu_ns: Role::ALL.map(|role| self.processes.cpu_ns(role)),
            machine: MachineTime::now(),
        });
        if let Some(latencies) = &mut self.latencies {
            latencies.forget();
        }
        self.stalls = Stalls::default();
        self.director = self.parameters.map(|parameters| Director::new(parameters, now));
    }

    fn seconds(&self, now: u64) -> f64 {
        now.saturating_sub(self.started_ns) as f64 * 1e-9
    }

    fn sample(&mut self, now: u64) {
        let whole = self.processes.read() && Role::STAGES.iter().all(|&r| self.processes.pid(r).is_some());
        if !whole {
            return;
        }
        let at_s = self.seconds(now);
        let elapsed_ns = now.saturating_sub(self.sampled_ns).max(1);
        self.shared_bytes = self.instance.shared_bytes();
        let (private, file) = self.processes.memory();
        self.memory.add(at_s, (private + file + self.shared_bytes) as f64);
        let entries = self.instance.shared_memory();
        self.reserved_bytes = entries.iter().filter_map(|e| std::fs::metadata(e).ok()).map(|m| m.len()).sum();
        self.growing.add(at_s, (private + self.reserved_bytes) as f64);
        self.entries.add(at_s, entries.len() as f64);
        for role in Role::ALL {
            let i = role as usize;
            let cpu_ns = self.processes.cpu_ns(role);
            if self.processes.pid(role).is_some() {
                self.role_memory[i].add(at_s, self.processes.reading(role).private_bytes as f64);
                if self.sampled_ns > 0 {
                    let used = cpu_ns.saturating_sub(self.sampled_cpu_ns[i]);
                    self.role_cpu[i].add(at_s, used as f64 / elapsed_ns as f64 * 100.0);
                }
            }
            self.sampled_cpu_ns[i] = cpu_ns;
        }
        self.sampled_ns = now;
    }

    /// Injects faults when they are due.
    fn direct(&mut self, now: u64) {
        let steady = now.saturating_sub(self.last_result_ns) < (5 * self.period_ns).max(500_000_000)
            && Role::STAGES.iter().all(|&role| self.processes.pid(role).is_some());
        let Some(director) = &mut self.director else { return };
        if let Some(order) = director.tick(now, steady) {
            let sent = match order.signal {
                Signal::Heat | Signal::Cool => {
                    let set = self.board.set(order.signal == Signal::Heat);
                    if let Err(error) = &set {
                        tracing::warn!(%error, "cannot set the temperature of the simulated board");
                    }
                    set.is_ok()
                }
                _ => send(order, &self.processes, self.daemon_pid),
            };
            let after = monotonic_ns();
            match (order.signal, sent) {
                (Signal::Continue | Signal::Cool, _) => {}
                (_, true) => director.sent(after),
                (_, false) => director.not_sent(after),
            }
        }
    }

    fn is_over(
        &mut self,
        now: u64,
        daemon: &mut DaemonChild,
        stop: &AtomicBool,
    ) -> Result<Option<Ended>, SoakError> {
        if let Err(error) = daemon.expect_running() {
            // During the warm-up this is an error of the run, later a result of the measurement.
            return if self.base.is_some() {
                Ok(Some(Ended::Because(error.to_string())))
            } else {
                Err(error)
            };
        }
        let Some(base) = &self.base else {
            if stop.load(Ordering::Relaxed) {
                return Err(SoakError::Stopped);
            }
            if now.saturating_sub(self.last_result_ns) > RESULT_TIMEOUT_NS {
                return Err(SoakError::Silent(daemon.log_tail()));
            }
            return Ok(None);
        };
        let measured_ns = now.saturating_sub(base.at_ns);
        if stop.load(Ordering::Relaxed) {
            let text = format!("stopped by a signal after {:.1} minutes", measured_ns as f64 / 6e10);
            return Ok(Some(Ended::Because(text)));
        }
        if let Some(reason) = self.gave_up.take() {
            return Ok(Some(Ended::Because(reason)));
        }
        if now.saturating_sub(self.last_result_ns) > RESULT_TIMEOUT_NS {
            let text =
                format!("no result for {} s; {}", RESULT_TIMEOUT_NS / 1_000_000_000, daemon.log_tail());
            return Ok(Some(Ended::Because(text)));
        }
        let time_is_up = self.time_ns.is_some_and(|time| measured_ns >= time);
        let Some(director) = &mut self.director else {
            return Ok(time_is_up.then_some(Ended::InTime));
        };
        if self.time_ns.is_some_and(|time| measured_ns + TAIL_NS >= time) {
            director.end();
        }
        if !director.is_done() {
            return Ok(None);
        }
        // The recovery from the last fault is still observed.
        let tail_ns = *self.tail_ns.get_or_insert(now);
        let kills_decide =
            self.time_ns.is_none_or(|time| tail_ns < base.at_ns.saturating_add(time) - TAIL_NS);
        let seen = now.saturating_sub(tail_ns) >= TAIL_NS;
        Ok((seen && (time_is_up || kills_decide)).then_some(Ended::InTime))
    }

    /// A sixtieth of the planned time, between 5 s and 10 minutes.
    fn progress_period_ns(&self) -> u64 {
        (self.time_ns.unwrap_or(0) / 60).clamp(5_000_000_000, 600_000_000_000)
    }

    fn progress(&self, now: u64) -> Progress {
        let begin = self.base.as_ref().map_or(
            // An estimate, until the warm-up has ended.
            self.first_result_ns.unwrap_or(now) + self.warm_up_ns,
            |base| base.at_ns,
        );
        let dropped =
            |counts: &Counts| Role::STAGES.iter().map(|&r| counts.roles[r as usize][1]).sum::<u64>();
        let base = self.base.as_ref().map_or_else(Counts::default, |base| base.counts);
        let latency =
            |percentile| self.latencies.as_ref().map_or(0.0, |l| l.end_to_end.percentile_ms(percentile));
        let (private, file) = self.processes.memory();
        let recoveries = self.director.as_ref().map(|d| &d.recoveries);
        Progress {
            measured_s: (now as f64 - begin as f64) * 1e-9,
            planned_s: self.time_ns.map(|time| time as f64 * 1e-9),
            frames: self.counts.frames.saturating_sub(base.frames),
            dropped: dropped(&self.counts).saturating_sub(dropped(&base)),
            latency_ms: [latency(50.0), latency(99.0)],
            memory_bytes: private + file + self.shared_bytes,
            faults: recoveries.map_or([0; 2], |r| [r.count(), r.failures()]),
            next_result_s: recoveries.map_or(0.0, |r| r.longest_s()),
        }
    }
}

/// Sends a signal to the current process of a stage, after checking that it is a child of the daemon.
fn send(order: Order, processes: &Processes, daemon_pid: u32) -> bool {
    let Some(pid) = Role::STAGES.get(order.stage).and_then(|&role| processes.pid(role)) else { return false };
    if Reading::of(pid).is_none_or(|reading| reading.parent != daemon_pid) {
        return false;
    }
    let signal = match order.signal {
        Signal::Kill => rustix::process::Signal::KILL,
        Signal::Terminate => rustix::process::Signal::TERM,
        Signal::Stop => rustix::process::Signal::STOP,
        Signal::Continue => rustix::process::Signal::CONT,
        Signal::Heat | Signal::Cool => return false,
    };
    Pid::from_raw(pid as i32).is_some_and(|pid| kill_process(pid, signal).is_ok())
}

/// Number of a stage in `tools::soak`.
fn stage_index(role: Role) -> Option<usize> {
    Role::STAGES.iter().position(|&stage| stage == role)
}
