//! The way into shared memory: one node per process, and the ports of the table of services.

use crate::clock::monotonic_ns;
pub use crate::error::IpcError;
use crate::header::{Header, LINE_BYTES, Line};
use crate::instance::Instance;
use crate::port::{Publisher, Subscriber};
use crate::service::{LOANED, ServiceSpec};
use iceoryx2::config::Config;
use iceoryx2::prelude::*;
use rustix::fs::{FallocateFlags, fallocate};
use rustix::io::Errno;
use std::cell::Cell;
use std::fmt;

/// Processes that may use the services at once: ours, and readers from outside.
const MAX_NODES: usize = 32;

/// A reason in words, shown as it is.
struct Words(String);

impl fmt::Debug for Words {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}

/// This process's place among those of the daemon.
#[derive(Debug)]
pub struct Bus {
    node: Node<ipc::Service>,
    instance: Instance,
}

/// What a sweep of dead processes found.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Sweep {
    /// Dead processes whose remains were removed.
    pub cleaned: u64,
    /// Dead processes whose remains could not be removed.
    pub failed: u64,
}

impl Bus {
    /// Joins the present run of an instance.
    ///
    /// # Errors
    /// When no daemon runs it, or its folders or shared memory cannot be used.
    pub fn join(instance: &Instance) -> Result<Self, IpcError> {
        let fail = |what: &str, reason: &dyn fmt::Debug| IpcError::new("name", what, reason);
        let root = instance.bus_directory();
        let root = Path::new(root.as_os_str().as_encoded_bytes())
            .map_err(|e| fail(&root.display().to_string(), &e))?;
        let prefix =
            instance.prefix().ok_or_else(|| IpcError::new("join", instance.name(), "no daemon runs it"))?;
        let mut config = Config::default();
        config.global.prefix = FileName::new(prefix.as_bytes()).map_err(|e| fail(&prefix, &e))?;
        config.global.set_root_path(&root);
        // The scheduler sweeps, once it has reaped: processes that leave at the same time must not
        // take each other for dead.
        config.global.node.cleanup_dead_nodes_on_creation = false;
        config.global.node.cleanup_dead_nodes_on_destruction = false;
        config.global.service.cleanup_dead_nodes_on_open = false;
        let node = NodeBuilder::new()
            .config(&config)
            .signal_handling_mode(SignalHandlingMode::Disabled)
            .create::<ipc::Service>()
            .map_err(|e| IpcError::new("join", instance.name(), e))?;
        Ok(Self { node, instance: instance.clone() })
    }

    /// Removes what dead processes left, so that their places are free. Dead children must have
    /// been reaped before.
    pub fn sweep(&self) -> Sweep {
        let state = self.node.try_cleanup_dead_nodes();
        Sweep { cleaned: state.cleanups, failed: state.failed_cleanups }
    }

    /// Makes all shared memory of this run real, so that no page of it has to be found when a message
    /// is written, and none can be missing. Gives how many bytes were not there yet.
    ///
    /// # Errors
    /// When /dev/shm is full: to write to a page that cannot be had would end the process.
    pub fn reserve(&self) -> Result<u64, IpcError> {
        let fail = |path: &std::path::Path, e: &dyn fmt::Debug| {
            IpcError::new("reserve", &path.display().to_string(), e)
        };
        let mut reserved = 0;
        for path in self.instance.shared_memory() {
            let file = match std::fs::OpenOptions::new().write(true).open(&path) {
                Ok(file) => file,
                // Others come and go.
                Err(error) if error.kind() == std::io::ErrorKind::NotFound => continue,
                Err(error) => return Err(fail(&path, &error)),
            };
            let metadata = file.metadata().map_err(|e| fail(&path, &e))?;
            let (bytes, there) = (metadata.len(), std::os::unix::fs::MetadataExt::blocks(&metadata) * 512);
            if there >= bytes {
                continue;
            }
            // Content that is there stays; only holes are filled.
            match fallocate(&file, FallocateFlags::empty(), 0, bytes) {
                Ok(()) => reserved += bytes - there,
                Err(Errno::NOSPC) => {
                    let text = format!("/dev/shm is full: {bytes} bytes more are needed: enlarge it");
                    return Err(IpcError::new("reserve", &path.display().to_string(), Words(text)));
                }
                Err(error) => return Err(fail(&path, &error)),
            }
        }
        Ok(reserved)
    }

    /// Runs `open`; when it fails, sweeps the dead and tries once more.
    fn with_sweep<T>(&self, open: impl Fn() -> Result<T, IpcError>) -> Result<T, IpcError> {
        open().or_else(|_| {
            self.sweep();
            open()
        })
    }

    /// A publisher of a service for images of `width` × `height`.
    ///
    /// # Errors
    /// When the service exists with other settings, or all its places are taken.
    pub fn publisher(&self, spec: &ServiceSpec, width: usize, height: usize) -> Result<Publisher, IpcError> {
        self.with_sweep(|| {
            let factory = self.data(spec)?;
            let port = factory
                .publisher_builder()
                .initial_max_slice_len(spec.max_payload_bytes(width, height).div_ceil(LINE_BYTES))
                .max_loaned_samples(LOANED)
                // With overflow on, a full buffer never blocks; this is for the unforeseen.
                .backpressure_strategy(BackpressureStrategy::DiscardData)
                .create()
                .map_err(|e| IpcError::new("publish", spec.name, e))?;
            let notifier = self
                .event(spec)?
                .notifier_builder()
                .create()
                .map_err(|e| IpcError::new("notify", spec.name, e))?;
            Ok(Publisher { port, notifier, name: spec.name, serial: Cell::new(0), first_ns: Cell::new(None) })
        })
    }

    /// A subscriber of a service.
    ///
    /// # Errors
    /// As [`Self::publisher`].
    pub fn subscriber(&self, spec: &ServiceSpec) -> Result<Subscriber, IpcError> {
        self.with_sweep(|| {
            let port = self
                .data(spec)?
                .subscriber_builder()
                .buffer_size(spec.buffer)
                .create()
                .map_err(|e| IpcError::new("subscribe to", spec.name, e))?;
            let listener = self
                .event(spec)?
                .listener_builder()
                .create()
                .map_err(|e| IpcError::new("listen to", spec.name, e))?;
            let (last, known_ns) = (Cell::new(None), Cell::new(monotonic_ns()));
            Ok(Subscriber { port, listener, name: spec.name, last, known_ns, missed: Cell::new(0) })
        })
    }

    fn data(
        &self,
        spec: &ServiceSpec,
    ) -> Result<
        iceoryx2::service::port_factory::publish_subscribe::PortFactory<ipc::Service, [Line], Header>,
        IpcError,
    > {
        let name = service_name(spec)?;
        self.node
            .service_builder(&name)
            .publish_subscribe::<[Line]>()
            .user_header::<Header>()
            .enable_safe_overflow(true)
            .max_publishers(spec.publishers)
            .max_subscribers(spec.subscribers)
            .max_nodes(MAX_NODES)
            .subscriber_max_buffer_size(spec.buffer)
            .subscriber_max_borrowed_samples(spec.borrowed)
            .history_size(spec.history)
            .open_or_create()
            .map_err(|e| IpcError::new("open", spec.name, e))
    }

    fn event(
        &self,
        spec: &ServiceSpec,
    ) -> Result<iceoryx2::service::port_factory::event::PortFactory<ipc::Service>, IpcError> {
        let name = service_name(spec)?;
        self.node
            .service_builder(&name)
            .event()
            .max_notifiers(spec.publishers)
            .max_listeners(spec.subscribers)
            .max_nodes(MAX_NODES)
            .open_or_create()
            .map_err(|e| IpcError::new("open the events of", spec.name, e))
    }
}

fn service_name(spec: &ServiceSpec) -> Result<ServiceName, IpcError> {
    ServiceName::new(spec.name).map_err(|e| IpcError::new("name", spec.name, e))
}

/// Quietens the library: only what it warns of goes to the log.
pub fn set_library_log_level() {
    set_log_level(LogLevel::Warn);
}

/// Quietens it further, for a reader that outlives the daemon's runs: that what it holds of a run has been
/// removed with the run is no news to it.
pub fn set_library_log_level_of_reader() {
    set_log_level(LogLevel::Error);
}
