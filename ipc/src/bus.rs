//! The way into shared memory: one node per process, and the ports of the table of services.

use crate::header::{Header, LINE_BYTES, Line};
use crate::instance::Instance;
use crate::port::{Publisher, Subscriber};
use crate::service::{LOANED, ServiceSpec};
use iceoryx2::config::Config;
use iceoryx2::prelude::*;
use std::cell::Cell;
use std::fmt;
use thiserror::Error;

/// Processes that may use the services at once: ours, and readers from outside.
const GREATEST_NODES: usize = 32;

/// Why shared memory cannot be used.
#[derive(Clone, Debug, Error, PartialEq, Eq)]
#[error("shared memory: cannot {action} \"{name}\": {reason}")]
pub struct IpcError {
    action: &'static str,
    name: String,
    reason: String,
}

impl IpcError {
    pub(crate) fn new(action: &'static str, name: &str, reason: impl fmt::Debug) -> Self {
        Self { action, name: name.to_owned(), reason: format!("{reason:?}") }
    }
}

/// This process's place among those of the daemon.
#[derive(Debug)]
pub struct Bus {
    node: Node<ipc::Service>,
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
    /// Joins the instance.
    ///
    /// # Errors
    /// When its folders or shared memory cannot be used.
    pub fn join(instance: &Instance) -> Result<Self, IpcError> {
        let fail = |what: &str, reason: &dyn fmt::Debug| IpcError::new("name", what, reason);
        let root = instance.directory();
        let root = Path::new(root.as_os_str().as_encoded_bytes())
            .map_err(|e| fail(&root.display().to_string(), &e))?;
        let prefix = instance.prefix();
        let mut config = Config::default();
        config.global.prefix = FileName::new(prefix.as_bytes()).map_err(|e| fail(&prefix, &e))?;
        config.global.set_root_path(&root);
        let node = NodeBuilder::new()
            .config(&config)
            .signal_handling_mode(SignalHandlingMode::Disabled)
            .create::<ipc::Service>()
            .map_err(|e| IpcError::new("join", instance.name(), e))?;
        Ok(Self { node })
    }

    /// Removes what dead processes left, so that their places are free. Dead children must have
    /// been reaped before.
    pub fn sweep(&self) -> Sweep {
        let state = self.node.try_cleanup_dead_nodes();
        Sweep { cleaned: state.cleanups, failed: state.failed_cleanups }
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
                .initial_max_slice_len(spec.greatest_payload_bytes(width, height).div_ceil(LINE_BYTES))
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
            Ok(Publisher { port, notifier, name: spec.name, serial: Cell::new(0) })
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
            Ok(Subscriber { port, listener, name: spec.name, last: Cell::new(None), missed: Cell::new(0) })
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
            .max_nodes(GREATEST_NODES)
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
            .max_nodes(GREATEST_NODES)
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::header::{Kind, MessageError};
    use crate::instance::InstanceLock;
    use crate::service::{COMMAND, OBSTACLES, PAIR};
    use crate::wait::{self, Next};
    use crate::{command, pair};
    use std::time::Duration;

    /// An instance of its own for each test, and the folder that it lives in.
    fn instance(name: &str) -> (tempfile::TempDir, Instance) {
        let folder = tempfile::tempdir().unwrap();
        let instance = Instance::new(&format!("{name}-{}", std::process::id()), folder.path());
        (folder, instance)
    }

    fn publish(publisher: &Publisher, sequence: u64) {
        let mut loan = publisher.loan(pair::payload_bytes(4, 2)).unwrap();
        *loan.header_mut() = Header { sequence, width: 4, height: 2, ..Header::new(Kind::Pair) };
        loan.payload_mut().fill(sequence as u8);
        publisher.send(loan).unwrap();
    }

    #[test]
    fn the_newest_message_wins_and_nothing_is_left_behind() {
        let (_folder, instance) = instance("newest");
        let lock = InstanceLock::take(&instance).unwrap();
        let bus = Bus::join(&instance).unwrap();
        let publisher = bus.publisher(&PAIR, 4, 2).unwrap();
        let subscriber = bus.subscriber(&PAIR).unwrap();
        assert!(subscriber.receive().unwrap().is_none());
        for sequence in 0..10 {
            publish(&publisher, sequence);
        }
        let sample = subscriber.receive().unwrap().unwrap();
        assert_eq!(sample.header().sequence, 9);
        // The first message that was seen is where counting starts.
        assert_eq!(subscriber.take_missed(), 0);
        let images = pair::view(sample.header(), sample.payload()).unwrap();
        assert_eq!((images.left, images.right), (&[9_u8; 8][..], &[9_u8; 8][..]));
        // What is being read does not change while newer ones are sent.
        for sequence in 10..20 {
            publish(&publisher, sequence);
        }
        assert_eq!(sample.payload()[0], 9);
        drop(sample);
        assert_eq!(subscriber.receive().unwrap().unwrap().header().sequence, 19);
        assert_eq!((subscriber.take_missed(), subscriber.take_missed()), (9, 0));
        // The pool is as large as the table says, and no larger.
        let pools = PAIR.pool_bytes(4, 2) as u64;
        assert!(instance.shared_bytes() < pools + 100_000, "{} for {pools}", instance.shared_bytes());
        assert!(subscriber.receive().unwrap().is_none());
        assert!(!instance.shared_memory().is_empty());
        drop((publisher, subscriber, bus, lock));
        assert_eq!(instance.shared_memory(), Vec::<std::path::PathBuf>::new());
        assert!(!instance.directory().exists());
    }

    #[test]
    fn late_readers_get_the_history_and_long_messages_are_refused() {
        let (_folder, instance) = instance("history");
        let _lock = InstanceLock::take(&instance).unwrap();
        let bus = Bus::join(&instance).unwrap();
        let publisher = bus.publisher(&COMMAND, 0, 0).unwrap();
        let record = command::CommandRecord { period_ns: 5, ..Default::default() };
        publisher.send_record(Header::new(Kind::Command), &record).unwrap();
        let late = bus.subscriber(&COMMAND).unwrap();
        publisher.refresh().unwrap();
        let sample = late.receive().unwrap().unwrap();
        assert_eq!(command::view(sample.header(), sample.payload()), Ok(record));
        assert!(publisher.loan(command::PAYLOAD_BYTES + LINE_BYTES).is_err());
    }

    #[test]
    fn a_message_that_lies_is_refused_by_its_check() {
        let (_folder, instance) = instance("lies");
        let _lock = InstanceLock::take(&instance).unwrap();
        let bus = Bus::join(&instance).unwrap();
        let publisher = bus.publisher(&PAIR, 4, 2).unwrap();
        let subscriber = bus.subscriber(&PAIR).unwrap();
        let mut loan = publisher.loan(16).unwrap();
        *loan.header_mut() = Header { width: 8000, height: 8000, ..Header::new(Kind::Pair) };
        publisher.send(loan).unwrap();
        let sample = subscriber.receive().unwrap().unwrap();
        let error = pair::view(sample.header(), sample.payload()).unwrap_err();
        assert!(matches!(error, MessageError::Length { given: 16, .. }));
    }

    #[test]
    fn waiting_ends_with_a_message_a_time_or_a_stop() {
        let (_folder, instance) = instance("wait");
        let _lock = InstanceLock::take(&instance).unwrap();
        let bus = Bus::join(&instance).unwrap();
        let publisher = bus.publisher(&PAIR, 4, 2).unwrap();
        let subscriber = bus.subscriber(&PAIR).unwrap();
        let (mut calls, mut seen) = (0, Vec::new());
        let watchdog = std::time::Instant::now();
        wait::run::<IpcError>(&[&subscriber], || {
            calls += 1;
            assert!(watchdog.elapsed() < Duration::from_secs(60), "the wait never ended");
            if let Some(sample) = subscriber.receive()? {
                seen.push(sample.header().sequence);
            }
            match calls {
                1 => publish(&publisher, 7),
                2 => return Ok(Next::Wait(Duration::from_millis(1))),
                3 => return Ok(Next::Stop),
                _ => unreachable!("Stop was ignored"),
            }
            Ok(Next::Wait(Duration::from_secs(3600)))
        })
        .unwrap();
        assert_eq!((calls, seen), (3, vec![7]));
    }

    #[test]
    fn a_service_with_other_settings_is_an_error() {
        let (_folder, instance) = instance("settings");
        let _lock = InstanceLock::take(&instance).unwrap();
        let bus = Bus::join(&instance).unwrap();
        let _first = bus.publisher(&OBSTACLES, 4, 2).unwrap();
        let other = ServiceSpec { buffer: 9, ..OBSTACLES };
        let error = bus.subscriber(&other).unwrap_err().to_string();
        assert!(error.contains("obstacles"), "{error}");
    }
}
