//! Access to shared memory: one iceoryx2 node per process, and the ports of the services that
//! [`crate::pipeline`] declares.

use crate::clock::monotonic_ns;
pub use crate::error::IpcError;
use crate::free_memory::{self, Cushion};
use crate::header::{Header, LINE_BYTES, Line};
use crate::instance::Instance;
use crate::node_counter;
use crate::port::{Publisher, Subscriber};
use crate::run_files::open_own;
use crate::service::{LOANED, ServiceSpec};
use crate::stall::{self, Call, DropBegins, DropEnds, Guard};
use crate::type_name;
use iceoryx2::config::Config;
use iceoryx2::port::{DegradationAction, DegradationCause, DegradationInfo};
use iceoryx2::prelude::*;
use iceoryx2::service::attribute::{AttributeKey, AttributeValue};
use iceoryx2::service::builder::publish_subscribe::{
    PublishSubscribeOpenError, PublishSubscribeOpenOrCreateError,
};
use rustix::fs::{FallocateFlags, OFlags, fallocate};
use rustix::io::Errno;
use std::cell::Cell;
use std::fmt;

/// Maximum number of processes that use the services at a time: the daemon's and external readers.
const MAX_NODES: usize = 32;

/// Text whose `Debug` output has no quotes.
struct PlainText(String);

impl fmt::Debug for PlainText {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}

/// The node of this process in a run of the daemon. [`Self::publisher`] and [`Self::subscriber`] open its ports.
#[derive(Debug)]
pub struct Bus {
    _drop_begins: DropBegins,
    node: Node<ipc::Service>,
    instance: Instance,
    _drop_ends: DropEnds,
}

/// Result of [`Bus::sweep`].
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Sweep {
    /// Dead processes whose remains were removed.
    pub cleaned: u64,
    /// Dead processes whose remains could not be removed.
    pub failed: u64,
}

impl Bus {
    /// Joins the current run of an instance.
    ///
    /// # Errors
    /// If the instance is not running, belongs to another user, or its folders or shared memory cannot be used.
    pub fn join(instance: &Instance) -> Result<Self, IpcError> {
        // Here, too, because a reader that waits for a daemon joins whatever appears in its folder.
        instance.check_owner().map_err(|e| IpcError::new("join", instance.name(), e.to_string()))?;
        let fail = |what: &str, reason: &dyn fmt::Debug| IpcError::new("name", what, reason);
        let root = instance.bus_directory();
        let root = Path::new(root.as_os_str().as_encoded_bytes())
            .map_err(|e| fail(&root.display().to_string(), &e))?;
        let prefix =
            instance.prefix().ok_or_else(|| IpcError::new("join", instance.name(), "no daemon runs it"))?;
        // It would create files that nobody removes.
        if !prefix.has_mark() || !node_counter::exists(&prefix) {
            return Err(IpcError::new("join", instance.name(), PlainText("its run is ending".into())));
        }
        let mut config = Config::default();
        config.global.prefix =
            FileName::new(prefix.as_str().as_bytes()).map_err(|e| fail(prefix.as_str(), &e))?;
        config.global.set_root_path(&root);
        // Only the scheduler sweeps, after it has reaped its children: processes that exit at the same time must not
        // treat each other as dead.
        config.global.node.cleanup_dead_nodes_on_creation = false;
        config.global.node.cleanup_dead_nodes_on_destruction = false;
        config.global.service.cleanup_dead_nodes_on_open = false;
        stall::watch().map_err(|e| IpcError::new("join", instance.name(), e))?;
        let _guard = Guard::enter(Call::Join);
        let node = NodeBuilder::new()
            .config(&config)
            .signal_handling_mode(SignalHandlingMode::Disabled)
            .create::<ipc::Service>()
            .map_err(|e| IpcError::new("join", instance.name(), e))?;
        Ok(Self { _drop_begins: DropBegins, node, instance: instance.clone(), _drop_ends: DropEnds })
    }

    /// Removes the ports of dead processes and so frees their places. Dead children must have been reaped before.
    pub fn sweep(&self) -> Sweep {
        let _guard = Guard::enter(Call::Sweep);
        let state = self.node.try_cleanup_dead_nodes();
        Sweep { cleaned: state.cleanups, failed: state.failed_cleanups }
    }

    /// Allocates all pages of this run's shared memory, so that writing a message causes no page allocation, which
    /// could fail. Returns the number of newly allocated bytes.
    ///
    /// # Errors
    /// If /dev/shm is full. Without this check, writing to a page that cannot be allocated would end the process with
    /// SIGBUS.
    pub fn reserve(&self) -> Result<u64, IpcError> {
        let fail = |path: &std::path::Path, e: &dyn fmt::Debug| {
            IpcError::new("reserve", &path.display().to_string(), e)
        };
        let mut reserved = 0;
        for path in self.instance.shared_memory() {
            let file = match open_own(&path, OFlags::WRONLY) {
                Ok(file) => file,
                // Another process may have removed the file meanwhile.
                Err(error) if error.kind() == std::io::ErrorKind::NotFound => continue,
                Err(error) => return Err(fail(&path, &error)),
            };
            let metadata = file.metadata().map_err(|e| fail(&path, &e))?;
            let (bytes, there) = (metadata.len(), std::os::unix::fs::MetadataExt::blocks(&metadata) * 512);
            if there >= bytes {
                continue;
            }
            // fallocate keeps existing content and only fills holes.
            match fallocate(&file, FallocateFlags::empty(), 0, bytes) {
                Ok(()) => reserved += bytes - there,
                Err(Errno::NOSPC) => {
                    let text = format!("/dev/shm is full: {bytes} bytes more are needed: enlarge it");
                    return Err(IpcError::new("reserve", &path.display().to_string(), PlainText(text)));
                }
                Err(error) => return Err(fail(&path, &error)),
            }
        }
        Ok(reserved)
    }

    /// Calls `open`; if it fails, sweeps dead processes and calls it once more. If /dev/shm has too few pages, those of the
    /// run's cushion are released.
    fn with_sweep<T>(&self, open: impl Fn() -> Result<T, IpcError>) -> Result<T, IpcError> {
        let guarded = || {
            let _guard = Guard::enter(Call::Open);
            open()
        };
        if free_memory::is_scarce() {
            Cushion::release(&self.instance);
        }
        let mut result = guarded().or_else(|_| {
            self.sweep();
            guarded()
        });
        while result.as_ref().is_err_and(IpcError::is_full) && Cushion::release(&self.instance) {
            result = guarded();
        }
        result
    }

    /// Opens a publisher of a service. `width` and `height`, in pixels, determine the size of its message pool.
    ///
    /// # Errors
    /// If the service exists with other settings, or has its maximum number of publishers.
    pub fn publisher(&self, spec: &ServiceSpec, width: usize, height: usize) -> Result<Publisher, IpcError> {
        self.with_sweep(|| {
            let factory = self.data(spec)?;
            let port = factory
                .publisher_builder()
                .initial_max_slice_len(spec.max_payload_bytes(width, height).div_ceil(LINE_BYTES))
                .max_loaned_samples(LOANED)
                // With safe overflow a full buffer never blocks; this makes sure that nothing else does.
                .backpressure_strategy(BackpressureStrategy::DiscardData)
                .create()
                .map_err(|e| IpcError::new("publish", spec.name, e))?;
            let notifier = self
                .event(spec)?
                .notifier_builder()
                .create()
                .map_err(|e| IpcError::new("notify", spec.name, e))?;
            Ok(Publisher {
                _drop_begins: DropBegins,
                port,
                notifier,
                name: spec.name,
                serial: Cell::new(0),
                first_ns: Cell::new(None),
                _drop_ends: DropEnds,
            })
        })
    }

    /// Opens a subscriber of a service.
    ///
    /// # Errors
    /// If the service exists with other settings, or has its maximum number of subscribers.
    pub fn subscriber(&self, spec: &ServiceSpec) -> Result<Subscriber, IpcError> {
        self.with_sweep(|| {
            free_memory::take_refusal();
            let port = self
                .data(spec)?
                .subscriber_builder()
                .buffer_size(spec.buffer)
                .set_degradation_handler(on_degradation)
                .create()
                .map_err(|e| free_memory::failure("subscribe to", spec.name, e))?;
            // Without a connection to each publisher it would be created, too, and wait for messages in vain.
            if free_memory::take_refusal() {
                free_memory::note_refusal();
                return Err(free_memory::failure("subscribe to", spec.name, "no connection"));
            }
            let listener = self
                .event(spec)?
                .listener_builder()
                .create()
                .map_err(|e| free_memory::failure("listen to", spec.name, e))?;
            let (last, known_ns) = (Cell::new(None), Cell::new(monotonic_ns()));
            Ok(Subscriber {
                _drop_begins: DropBegins,
                port,
                listener,
                name: spec.name,
                last,
                known_ns,
                missed: Cell::new(0),
                _drop_ends: DropEnds,
            })
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
        let attributes = attributes(spec)?;
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
            .open_or_create_with_attributes(&attributes)
            .map_err(|e| open_error(spec, e))
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

/// A connection that failed because /dev/shm is full is an error; others concern a publisher that has just ended.
fn on_degradation(_: DegradationCause, _: &DegradationInfo) -> DegradationAction {
    if free_memory::is_refused() {
        free_memory::note_refusal();
        DegradationAction::DegradeAndFail
    } else {
        DegradationAction::Warn
    }
}

/// What a service says about its message, also to programs that are no part of lookout.
fn attributes(spec: &ServiceSpec) -> Result<AttributeVerifier, IpcError> {
    let fail = |e: &dyn fmt::Debug| IpcError::new("name", spec.name, e);
    let key = AttributeKey::try_from(type_name::ATTRIBUTE).map_err(|e| fail(&e))?;
    let value = AttributeValue::try_from(&type_name::of_service(spec)[..]).map_err(|e| fail(&e))?;
    AttributeVerifier::new().require(&key, &value).map_err(|e| fail(&e))
}

fn open_error(spec: &ServiceSpec, error: PublishSubscribeOpenOrCreateError) -> IpcError {
    use PublishSubscribeOpenError::{IncompatibleAttributes, IncompatibleTypes};
    match error {
        PublishSubscribeOpenOrCreateError::PublishSubscribeOpenError(
            IncompatibleTypes | IncompatibleAttributes,
        ) => {
            let text = format!(
                "its messages have another layout than {}: the daemon and this program must be of one release",
                type_name::of_service(spec)
            );
            IpcError::new("open", spec.name, PlainText(text))
        }
        error => IpcError::new("open", spec.name, error),
    }
}

fn service_name(spec: &ServiceSpec) -> Result<ServiceName, IpcError> {
    ServiceName::new(spec.name).map_err(|e| IpcError::new("name", spec.name, e))
}

/// Limits the log of iceoryx2 to warnings and errors.
pub fn set_library_log_level() {
    set_log_level(LogLevel::Error);
    // It warns at the first use of its global configuration that there is no file of it. There is none: each node gets its own.
    let _ = Config::global_config();
    set_log_level(LogLevel::Warn);
}

/// Limits the log of iceoryx2 to errors, for a reader that outlives runs of the daemon: iceoryx2 warns about
/// resources that were removed with their run, which such a reader expects.
pub fn set_library_log_level_of_reader() {
    set_log_level(LogLevel::Error);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::instance::InstanceLock;
    use crate::service::{PAIR, STATUS};

    #[test]
    fn messages_of_another_layout_are_refused_with_the_remedy() {
        let folder = tempfile::tempdir().unwrap();
        let instance = Instance::new("layout", folder.path());
        let _lock = InstanceLock::take(&instance).unwrap();
        let bus = Bus::join(&instance).unwrap();
        let builder = |name: &str| bus.node.service_builder(&ServiceName::new(name).unwrap());
        let _bytes = builder(PAIR.name).publish_subscribe::<[u8]>().create().unwrap();
        // The types are the same, the message is not.
        let older = AttributeSpecifier::new()
            .define(&type_name::ATTRIBUTE.try_into().unwrap(), &"lookout.status.v0".try_into().unwrap())
            .unwrap();
        let status = builder(STATUS.name).publish_subscribe::<[Line]>().user_header::<Header>();
        let _older = status.create_with_attributes(&older).unwrap();
        for spec in [&PAIR, &STATUS] {
            let error = bus.subscriber(spec).unwrap_err().to_string();
            let name = type_name::of_service(spec);
            assert!(error.contains(&name) && error.contains("must be of one release"), "{error}");
        }
    }
}
