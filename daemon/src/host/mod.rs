//! The process side of a stage: shared memory, reports, heartbeats, signals, privileges.

use crate::launch::Launch;
use crate::memory::MemoryProbe;
use crate::realtime::{self, Refused};
use crate::stages::stage::SetupError;
use messages::allocation;
use messages::bus::{Bus, IpcError};
use messages::calibration::CalibrationRecord;
use messages::clock::{monotonic_ns, process_cpu_ns};
use messages::device::DeviceRecord;
use messages::header::{Header, Kind};
use messages::instance::Instance;
use messages::pipeline::Role;
use messages::port::Publisher;
use messages::report::{Health, ReportRecord};
use messages::service;
use messages::source_time::SourceTimeRecord;
use rustix::process::{Signal, getppid, set_parent_process_death_signal};
use signal_hook::consts::{SIGINT, SIGTERM};
use std::io;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;
use thiserror::Error;

/// Time between two readings of a stage's memory, in nanoseconds.
const MEMORY_PERIOD_NS: u64 = 500_000_000;

/// Why a stage ends with an error.
#[derive(Debug, Error)]
pub enum HostError {
    /// Standard input held no launch document.
    #[error("a stage is started by the scheduler, not by hand: {0}")]
    Launch(String),
    /// A system call failed.
    #[error("{what}: {source}")]
    System {
        /// What was tried.
        what: &'static str,
        /// The cause.
        source: io::Error,
    },
    /// A required real-time privilege was refused.
    #[error(transparent)]
    Refused(#[from] Refused),
    /// Shared memory cannot be used.
    #[error(transparent)]
    Ipc(#[from] IpcError),
    /// The stage cannot be configured.
    #[error(transparent)]
    Setup(#[from] SetupError),
    /// The run cannot be recorded.
    #[error(transparent)]
    Record(#[from] tools::recording::RecordError),
    /// Results cannot be written.
    #[error(transparent)]
    Output(#[from] tools::reporting::output::OutputError),
}

/// The process of a stage: its shared memory, its reports, its signals.
pub struct Host {
    role: Role,
    /// Its launch document.
    pub launch: Launch,
    /// Its node in shared memory.
    pub bus: Bus,
    reports: Publisher,
    report: ReportRecord,
    stop: Arc<AtomicBool>,
    memory: MemoryProbe,
    next_beat_ns: u64,
    next_memory_ns: u64,
    heartbeat: Duration,
    warned_ns: Option<u64>,
    /// Number of heap allocations up to the last frame.
    allocations: u64,
    /// Header of the last frame; heartbeats carry it, too.
    header: Header,
}

impl Host {
    /// Sets up the process of a stage: signals, privileges, shared memory.
    ///
    /// # Errors
    /// If the scheduler has exited, a required privilege is refused, or shared memory cannot be used.
    pub fn new(role: Role, launch: Launch) -> Result<Self, HostError> {
        let system = |what, source: io::Error| HostError::System { what, source };
        // Without its scheduler a stage would only occupy shared memory.
        set_parent_process_death_signal(Some(Signal::KILL))
            .map_err(|e| system("setting the parent-death signal", e.into()))?;
        if getppid().map(|p| p.as_raw_nonzero().get() as u32) != Some(launch.scheduler_pid) {
            return Err(HostError::Launch("its scheduler has exited".into()));
        }
        let stop = Arc::new(AtomicBool::new(false));
        for signal in [SIGTERM, SIGINT] {
            signal_hook::flag::register(signal, Arc::clone(&stop))
                .map_err(|e| system("installing a signal handler", e))?;
        }
        allocation::keep_small_blocks();
        let realtime = realtime::enter(&launch.config, role, launch.core)?;
        if role.spec().priority.is_none() {
            // A process without a real-time priority has no deadline.
            let _ = rustix::process::nice(10);
        }
        let instance = Instance::new(&launch.config.instance.name, &launch.config.instance.directory);
        let bus = Bus::join(&instance)?;
        let reports = bus.publisher(&service::REPORT, 0, 0)?;
        let mut host = Self {
            role,
            heartbeat: Duration::from_millis(launch.config.supervision.heartbeat_ms.unsigned_abs()),
            launch,
            bus,
            reports,
            report: ReportRecord::new(role),
            stop,
            memory: MemoryProbe::open().map_err(|e| system("opening /proc/self", e))?,
            next_beat_ns: 0,
            next_memory_ns: 0,
            warned_ns: None,
            allocations: 0,
            header: Header::new(Kind::Report),
        };
        host.report.set_health(Health::Starting, "");
        host.report.realtime = realtime;
        host.report.deadline.deadline_ns = (host.launch.config.pacing.deadline_ms * 1e6) as u64;
        host.send_report(false)?;
        Ok(host)
    }

    /// The role of the process.
    pub fn role(&self) -> Role {
        self.role
    }

    /// Whether SIGTERM or SIGINT has arrived.
    pub fn should_stop(&self) -> bool {
        self.stop.load(Ordering::Relaxed)
    }

    /// Reports that the stage has opened its ports and can process frames.
    ///
    /// # Errors
    /// If the report cannot be sent, or required prefaulting fails.
    pub fn ready(&mut self) -> Result<(), HostError> {
        realtime::reserve(&self.launch.config, &self.bus, &mut self.report.realtime)?;
        self.report.set_health(Health::Ready, "");
        self.send_report(false)
    }

    /// Reports a change of health, with its reason.
    ///
    /// # Errors
    /// If the report cannot be sent.
    pub fn set_health(&mut self, health: Health, text: &str) -> Result<(), HostError> {
        self.report.set_health(health, text);
        self.send_report(false)
    }

    /// Reports that the source left pair `sequence` out, because it cannot be read; it is ready for the next.
    ///
    /// # Errors
    /// If the report cannot be sent.
    pub fn left_out(&mut self, sequence: u64, reason: &str) -> Result<(), HostError> {
        self.header = Header::new(Kind::Report);
        self.header.sequence = sequence;
        self.set_health(Health::Unreadable, reason)?;
        self.report.set_health(Health::Ready, "");
        Ok(())
    }

    /// Reports a finished frame: its age when the stage took it, and the time of the work, both in nanoseconds.
    ///
    /// # Errors
    /// If the report cannot be sent.
    pub fn frame_done(&mut self, header: &Header, age_ns: u64, work_ns: u64) -> Result<(), HostError> {
        self.report.frames += 1;
        self.report.age_ns = age_ns;
        self.report.work_ns = work_ns;
        self.report.deadline.finished(header.capture_ns, monotonic_ns());
        self.header = header.forward(Kind::Report);
        self.send_report(true)
    }

    /// Sets the calibration of the following reports.
    pub fn set_calibration(&mut self, calibration: CalibrationRecord) {
        self.report.calibration = calibration;
    }

    /// Sets the device of the following reports.
    pub fn set_device(&mut self, device: DeviceRecord) {
        self.report.device = device;
    }

    /// Sets what was wrong with the time of the source, in the following reports.
    pub fn set_source_time(&mut self, source_time: SourceTimeRecord) {
        self.report.source_time = source_time;
    }

    /// Counts frames that newer ones overtook before this stage took them.
    pub fn skipped(&mut self, count: u64) {
        self.report.skipped = self.report.skipped.saturating_add(count);
    }

    /// Counts a refused message, and logs at most one per second.
    pub fn refused(&mut self, service: &str, reason: &dyn std::fmt::Display) {
        self.report.refused = self.report.refused.saturating_add(1);
        self.report.set_health(self.report.health(), &format!("{service}: {reason}"));
        let now = monotonic_ns();
        if self.warned_ns.is_none_or(|at| now - at > 1_000_000_000) {
            self.warned_ns = Some(now);
            tracing::warn!(service, %reason, total = self.report.refused, "message refused");
        }
    }

    /// Sends a heartbeat if one is due. Returns the time until the next.
    ///
    /// # Errors
    /// If the report cannot be sent.
    pub fn heartbeat(&mut self) -> Result<Duration, HostError> {
        let now = monotonic_ns();
        if now >= self.next_beat_ns {
            self.send_report(false)?;
        }
        Ok(Duration::from_nanos(self.next_beat_ns.saturating_sub(now)).max(Duration::from_millis(1)))
    }

    fn send_report(&mut self, is_frame: bool) -> Result<(), HostError> {
        self.report.is_frame = u32::from(is_frame);
        if is_frame {
            let allocations = allocation::by_this_thread();
            self.report.allocations = allocations - self.allocations;
            self.allocations = allocations;
        }
        self.report.realtime.log_dropped = crate::logging::dropped();
        self.report.cpu_ns = process_cpu_ns();
        let now = monotonic_ns();
        // Reading the memory costs more than the rest of a report, so it is not read for each one.
        if now >= self.next_memory_ns
            && let Some(memory) = self.memory.read()
        {
            self.next_memory_ns = now + MEMORY_PERIOD_NS;
            self.report.private_bytes = memory.private_bytes;
            self.report.file_bytes = memory.file_bytes;
            self.report.shared_bytes = memory.shared_bytes;
        }
        self.next_beat_ns = now + self.heartbeat.as_nanos() as u64;
        self.reports.send_record(self.header, &self.report.limited())?;
        Ok(())
    }
}
