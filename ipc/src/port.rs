//! Zero-copy publishers and subscribers.
//!
//! # Memory that another process may write
//!
//! A payload is a slice over shared memory. Forming it is sound only while nobody writes that memory, and this crate
//! cannot enforce that. It relies on the following.
//!
//! - Only processes of the same user can open the memory: the files of a run have mode 0600. Subscribers map
//!   the pools of publishers read-only.
//! - A publisher writes a sample only between its loan and its sending, and iceoryx2 lends no sample that a subscriber
//!   holds.
//!
//! A process of the same user that keeps to neither, or a publisher with a defect, can change a sample while it is
//! read. Strictly, that is a data race, of which Rust promises nothing; it cannot be prevented without copying the
//! images. What this crate does is to leave such a change nothing to harm:
//!
//! - Header and records are copied out once, by volatile reads, and the copies are checked and used.
//!   Every length, count, index and offset comes from a copy.
//! - Images and disparities, road profile and free space are read in place. Every value is valid for them, no address
//!   and no length depends on them unchecked, and nothing relies on reading the same value twice.
//!
//! iceoryx2's own structures in shared memory (connections, indices of samples, lengths of slices) are not checked, as
//! no program that uses it can. Garbage in them ends the processes that read it; the service manager brings the daemon
//! back (docs/operations.md).

use crate::clock::monotonic_ns;
use crate::error::IpcError;
use crate::free_memory;
use crate::header::{Header, LINE_BYTES, Line};
use crate::stall::{Call, DropBegins, DropEnds, Guard};
use iceoryx2::identifiers::UniquePublisherId;
use iceoryx2::port::listener::Listener;
use iceoryx2::port::notifier::Notifier;
use iceoryx2::port::publisher::Publisher as IoxPublisher;
use iceoryx2::port::subscriber::Subscriber as IoxSubscriber;
use iceoryx2::port::update_connections::UpdateConnections;
use iceoryx2::prelude::ipc;
use iceoryx2::sample::Sample as IoxSample;
use iceoryx2::sample_mut::SampleMut;
use std::cell::Cell;

/// Sends messages that were written in place, and notifies their subscribers.
#[derive(Debug)]
pub struct Publisher {
    pub(crate) _drop_begins: DropBegins,
    pub(crate) port: IoxPublisher<ipc::Service, [Line], Header>,
    pub(crate) notifier: Notifier<ipc::Service>,
    pub(crate) name: &'static str,
    pub(crate) serial: Cell<u64>,
    /// When the first message was sent, in ns of CLOCK_MONOTONIC; `None` before it.
    pub(crate) first_ns: Cell<Option<u64>>,
    pub(crate) _drop_ends: DropEnds,
}

/// A message in shared memory that is being written.
#[derive(Debug)]
pub struct Loan {
    sample: SampleMut<ipc::Service, [Line], Header>,
    bytes: usize,
}

impl Publisher {
    /// Borrows `bytes` bytes of shared memory for the next message. They hold the content of an earlier message.
    ///
    /// # Errors
    /// If the message is longer than the service allows, or the previous loan was not yet sent.
    pub fn loan(&self, bytes: usize) -> Result<Loan, IpcError> {
        let _guard = Guard::enter(Call::Loan);
        let lines = bytes.div_ceil(LINE_BYTES);
        let sample = self.port.loan_slice_uninit(lines).map_err(|e| IpcError::new("loan", self.name, e))?;
        // SAFETY: the payload lies in a memory-mapped file, whose bytes are initialised (to zero by the kernel, or by
        // an earlier message), and every bit pattern is a valid Line. iceoryx2 lends the sample to nobody else; the
        // documentation of the module says what happens if another process writes it nevertheless.
        let sample = unsafe { sample.assume_init() };
        Ok(Loan { sample, bytes })
    }

    /// Sends a message and notifies the subscribers.
    ///
    /// # Errors
    /// If it cannot be delivered. A dead subscriber is not an error.
    pub fn send(&self, mut loan: Loan) -> Result<(), IpcError> {
        let bytes = loan.bytes as u32;
        let issued_ns = monotonic_ns();
        let first_ns = self.first_ns.get().unwrap_or(issued_ns);
        self.first_ns.set(Some(first_ns));
        let header = loan.header_mut();
        header.payload_bytes = bytes;
        header.issued_ns = issued_ns;
        header.first_ns = first_ns;
        header.serial = self.serial.replace(self.serial.get() + 1);
        let _guard = Guard::enter(Call::Send);
        loan.sample.send().map_err(|e| IpcError::new("send", self.name, e))?;
        self.notifier.notify().map(|_| ()).map_err(|e| IpcError::new("notify", self.name, e))
    }

    /// Sends a header with a plain record as payload.
    ///
    /// # Errors
    /// As [`Self::loan`] and [`Self::send`].
    pub fn send_record<T: bytemuck::Pod>(&self, header: Header, record: &T) -> Result<(), IpcError> {
        let mut loan = self.loan(size_of::<T>())?;
        *loan.header_mut() = header;
        loan.payload_mut().copy_from_slice(bytemuck::bytes_of(record));
        self.send(loan)
    }

    /// Connects new subscribers and sends them the history.
    ///
    /// # Errors
    /// If a connection cannot be made.
    pub fn refresh(&self) -> Result<(), IpcError> {
        let _guard = Guard::enter(Call::Connect);
        self.port.update_connections().map_err(|e| IpcError::new("connect", self.name, e))
    }
}

impl Loan {
    /// The header, for writing.
    pub fn header_mut(&mut self) -> &mut Header {
        self.sample.user_header_mut()
    }

    /// Shortens the payload to its first `bytes` bytes.
    pub fn truncate(&mut self, bytes: usize) {
        self.bytes = self.bytes.min(bytes);
    }

    /// The payload, for writing; its address is a multiple of 64 bytes.
    pub fn payload_mut(&mut self) -> &mut [u8] {
        &mut bytemuck::cast_slice_mut(self.sample.payload_mut())[..self.bytes]
    }
}

/// Receives messages, to be read in place.
#[derive(Debug)]
pub struct Subscriber {
    pub(crate) _drop_begins: DropBegins,
    pub(crate) port: IoxSubscriber<ipc::Service, [Line], Header>,
    pub(crate) listener: Listener<ipc::Service>,
    pub(crate) name: &'static str,
    /// Publisher and serial number of the last message.
    pub(crate) last: Cell<Option<(UniquePublisherId, u64)>>,
    /// When the subscriber was created, or its last message was sent, in ns of CLOCK_MONOTONIC. A publisher whose
    /// first message is younger has sent all its messages to this subscriber.
    pub(crate) known_ns: Cell<u64>,
    pub(crate) missed: Cell<u64>,
    pub(crate) _drop_ends: DropEnds,
}

/// A received message. Publishers do not change its payload until it is dropped.
#[derive(Debug)]
pub struct Sample {
    sample: IoxSample<ipc::Service, [Line], Header>,
    /// Copy of the header in shared memory: what was checked does not change.
    header: Header,
}

impl Subscriber {
    /// The next message, if there is one; with a buffer of one, the newest. The previous message must have been
    /// dropped.
    ///
    /// # Errors
    /// If more messages are held than the service allows, or the connection is broken.
    pub fn receive(&self) -> Result<Option<Sample>, IpcError> {
        let _guard = Guard::enter(Call::Receive);
        // A publisher that has joined since then needs a connection.
        free_memory::take_refusal();
        let sample = self.port.receive().map_err(|e| free_memory::failure("receive", self.name, e))?;
        let Some(sample) = sample else { return Ok(None) };
        // SAFETY: the reference is valid for reads, and every bit pattern is a valid `Header`, which consists of whole
        // numbers. The read is volatile: the compiler may not read shared memory again in place of the copy.
        let header = unsafe { std::ptr::read_volatile(sample.user_header()) };
        // Garbage counts nothing; whoever checks the message refuses it.
        if header.check_ranges().is_ok() {
            let origin = sample.origin();
            let serial = header.serial;
            let gap = match self.last.replace(Some((origin, serial))) {
                Some((publisher, before)) if publisher == origin => {
                    serial.saturating_sub(before).saturating_sub(1)
                }
                // The publisher is older: the messages before this one may precede the subscriber, so none counts.
                _ if header.first_ns < self.known_ns.get() => 0,
                _ => serial,
            };
            self.known_ns.set(header.issued_ns);
            self.missed.set(self.missed.get().saturating_add(gap));
        }
        Ok(Some(Sample { sample, header }))
    }

    /// Number of messages since the last call that newer ones overtook before they were received.
    pub fn take_missed(&self) -> u64 {
        self.missed.take()
    }
}

impl Sample {
    /// Whether `publisher` has sent it.
    pub fn is_from(&self, publisher: &Publisher) -> bool {
        self.sample.origin() == publisher.port.id()
    }

    /// A copy of the header; call [`Header::check`] before using it.
    pub fn header(&self) -> &Header {
        &self.header
    }

    /// The payload, with the length that its header states, limited to the received bytes.
    pub fn payload(&self) -> &[u8] {
        let bytes: &[u8] = bytemuck::cast_slice(self.sample.payload());
        &bytes[..bytes.len().min(self.header.payload_bytes as usize)]
    }
}
