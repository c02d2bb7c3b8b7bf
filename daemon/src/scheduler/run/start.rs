//! What is checked and prepared before a run takes its instance over.

use crate::input;
use crate::launch::{FrameFormat, Launch};
use crate::scheduler::options::{Ends, RunError, RunOptions};
use crate::scheduler::pacer::PacerParameters;
use crate::scheduler::supervisor::SupervisorParameters;
use crate::stages;
use config::Config;
use messages::header::MAX_SIDE;
use messages::instance::{Instance, InstanceLock};
use messages::pipeline::{Role, Starts};
use messages::service;
use perception::stereo::Mpv;
use signal_hook::consts::{SIGCHLD, SIGHUP, SIGINT, SIGTERM, SIGUSR1};
use sources::PairSource;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use tools::recording::RecordError;

/// Opens the source, and checks that the stages can be configured for its frames.
pub(super) fn open_source(config: &Config) -> Result<(Box<dyn PairSource>, FrameFormat), RunError> {
    let source = input::open(config)?;
    input::tell_notes(source.as_ref());
    let rig = input::rig(config, source.as_ref())?;
    let (width, height) = source.size();
    let source_name = || match config.source.kind.as_str() {
        "folder" | "recording" => config.source.path.display().to_string(),
        kind => kind.to_owned(),
    };
    if width.max(height) > MAX_SIDE as usize {
        return Err(RunError::Side { source_name: source_name(), width, height, most: MAX_SIDE });
    }
    let disparities = usize::try_from(config.stereo.disparities).unwrap_or(0);
    Mpv::check(width, height, disparities)
        .map_err(|error| RunError::Frames { source_name: source_name(), error })?;
    let frames = FrameFormat::new((width, height), rig);
    stages::check(config, &frames)?;
    let nearest_m = rig.distance_m(disparities as f64 - 1.0);
    if nearest_m > config.alarm.distance_m {
        let alarm_m = config.alarm.distance_m;
        let needed = (rig.focal_px * rig.baseline_m / alarm_m).ceil().max(0.0) as usize + 1;
        // Not every rig can see so near.
        let remedy = match Mpv::check(width, height, needed).is_ok() {
            true => format!("set stereo.disparities to {needed} or more"),
            false => "use smaller pictures: more disparities cannot be searched".into(),
        };
        tracing::warn!(
            nearest_m,
            alarm_distance_m = alarm_m,
            "obstacles nearer than nearest_m cannot be detected: {remedy}"
        );
    }
    Ok((source, frames))
}

/// What outlives a run, if the process starts another.
pub struct Process {
    signals: Option<Signals>,
    /// The cores that this process may use, before it pins itself to one of them.
    pub(super) cores: Vec<usize>,
}

impl Process {
    /// Examines this process.
    pub fn new() -> Self {
        let cores = core_affinity::get_core_ids().unwrap_or_default().iter().map(|core| core.id).collect();
        Self { signals: None, cores }
    }

    /// The flags of the signals, whose handlers are installed by the first call.
    pub(super) fn signals(&mut self, ends: Ends) -> Result<Signals, RunError> {
        if let Some(signals) = &self.signals {
            return Ok(signals.clone());
        }
        let signals = Signals::register(ends)?;
        self.signals = Some(signals.clone());
        Ok(signals)
    }
}

/// Flags that signals set.
#[derive(Clone)]
pub(super) struct Signals {
    pub(super) stop: Arc<AtomicBool>,
    pub(super) hangup: Arc<AtomicBool>,
    pub(super) retry: Arc<AtomicBool>,
}

impl Signals {
    fn register(ends: Ends) -> Result<Self, RunError> {
        let flag = || Arc::new(AtomicBool::new(false));
        let signals = Self { stop: flag(), hangup: flag(), retry: flag() };
        for signal in [SIGTERM, SIGINT] {
            signal_hook::flag::register(signal, Arc::clone(&signals.stop))?;
        }
        if ends == Ends::Never {
            signal_hook::flag::register(SIGHUP, Arc::clone(&signals.hangup))?;
        } else if !ignores_hangup() {
            // Under nohup, SIGHUP stays ignored.
            signal_hook::flag::register(SIGHUP, Arc::clone(&signals.stop))?;
        }
        signal_hook::flag::register(SIGUSR1, Arc::clone(&signals.retry))?;
        // SIGCHLD only has to interrupt the wait; its flag is not used.
        signal_hook::flag::register(SIGCHLD, flag())?;
        Ok(signals)
    }
}

/// Creates the folder of the results, and checks that no recording is overwritten.
pub(super) fn prepare_outputs(options: &RunOptions) -> Result<(), RunError> {
    if let Some(out) = &options.out {
        tools::reporting::output::prepare(out)?;
    }
    if let Some(path) = options.record.as_ref().filter(|path| path.exists()) {
        return Err(RecordError::Exists { path: path.clone() }.into());
    }
    Ok(())
}

/// The processes of the run, without the scheduler.
pub(super) fn roles(options: &RunOptions) -> Vec<Role> {
    let has_writer = options.out.is_some() || options.record.is_some();
    let requested = |role: &Role| has_writer && role.spec().starts == Starts::OnRequest;
    Role::STAGES.into_iter().chain(Role::ALL.into_iter().filter(requested)).collect()
}

/// Checks that /dev/shm has room for the pools of all services.
pub(super) fn check_memory(
    lock: &InstanceLock,
    instance: &Instance,
    frames: &FrameFormat,
    processes: usize,
) -> Result<(), RunError> {
    let (width, height) = (frames.width, frames.height);
    let pool_bytes = service::total_pool_bytes(width, height, processes) as u64;
    lock.check_memory(pool_bytes)?;
    for spec in service::SERVICES {
        let (samples, bytes) = (spec.pool_samples(), spec.pool_bytes(width, height));
        tracing::debug!(service = spec.name, samples, bytes, "pool of one publisher");
    }
    tracing::info!(
        instance = instance.name(),
        width,
        height,
        pool_bytes,
        prefix = lock.prefix().as_str(),
        "starting"
    );
    Ok(())
}

/// The launch document of all stages. Core and first sequence are set when a stage is started.
pub(super) fn launch(
    config: &Config,
    options: &RunOptions,
    source: &dyn PairSource,
    frames: FrameFormat,
) -> Launch {
    let count = if config.source.repeat { None } else { source.count() };
    let end = match (count, options.limit) {
        (Some(count), Some(limit)) => Some(count.min(limit)),
        (count, limit) => count.or(limit),
    };
    Launch {
        config: config.clone(),
        core: None,
        helper_cores: Vec::new(),
        scheduler_pid: std::process::id(),
        frames,
        lockstep: options.lockstep,
        first_sequence: 0,
        // A later end is none: no run has 2⁶³ pairs.
        end_sequence: end.filter(|&end| i64::try_from(end).is_ok()),
        source_period_ns: source.period_ns().min(i64::MAX as u64),
        out: options.out.clone(),
        record: options.record.clone(),
    }
}

/// How fast a core is, relative to the fastest (1024); `None` where all are alike, or the kernel does not tell.
pub fn capacity(core: usize) -> Option<u32> {
    let file = format!("/sys/devices/system/cpu/cpu{core}/cpu_capacity");
    std::fs::read_to_string(file).ok()?.trim().parse().ok()
}

/// Whether this process was started to ignore SIGHUP (signal 1, the lowest bit of the mask).
fn ignores_hangup() -> bool {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let mask = status.lines().find_map(|line| line.strip_prefix("SigIgn:"));
    mask.and_then(|m| u64::from_str_radix(m.trim(), 16).ok()).is_some_and(|m| m & 1 == 1)
}

pub(super) fn supervisor_parameters(config: &Config) -> SupervisorParameters {
    let c = &config.supervision;
    let ms = |v: i64| v.unsigned_abs() * 1_000_000;
    SupervisorParameters {
        startup_deadline_ns: ms(c.startup_deadline_ms),
        liveness_deadline_ns: ms(c.liveness_deadline_ms),
        restart_first_ns: ms(c.restart_first_ms),
        restart_longest_ns: ms(c.restart_longest_ms),
        restart_count: usize::try_from(c.restart_count).unwrap_or(0),
        restart_window_ns: ms(c.restart_window_s) * 1000,
        retry_ns: ms(c.retry_s) * 1000,
        stop_grace_ns: ms(c.stop_grace_ms),
    }
}

pub(super) fn pacer_parameters(config: &Config, lockstep: bool, wanted_ns: u64) -> PacerParameters {
    let c = &config.pacing;
    PacerParameters {
        // In lock-step the credit determines the rate.
        follow: c.follow && !lockstep,
        wanted_ns,
        shortest_ns: (1e9 / c.max_fps) as u64,
        longest_ns: (1e9 / c.min_fps) as u64,
        headroom: c.headroom_percent * 1e-2,
    }
}
