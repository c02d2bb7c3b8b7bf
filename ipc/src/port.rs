//! Publishing and subscribing without copies.

use crate::clock::monotonic_ns;
use crate::error::IpcError;
use crate::header::{Header, LINE_BYTES, Line};
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

/// Writes messages in place and wakes their readers.
#[derive(Debug)]
pub struct Publisher {
    pub(crate) port: IoxPublisher<ipc::Service, [Line], Header>,
    pub(crate) notifier: Notifier<ipc::Service>,
    pub(crate) name: &'static str,
    pub(crate) serial: Cell<u64>,
    /// When the first message was sent, on the monotonic clock.
    pub(crate) first_ns: Cell<Option<u64>>,
}

/// A message that is being written.
#[derive(Debug)]
pub struct Loan {
    sample: SampleMut<ipc::Service, [Line], Header>,
    bytes: usize,
}

impl Publisher {
    /// Borrows `bytes` bytes of shared memory for the next message. Their content is what an
    /// earlier message left there.
    ///
    /// # Errors
    /// When the message is longer than the service allows, or the last one was not yet sent.
    pub fn loan(&self, bytes: usize) -> Result<Loan, IpcError> {
        let lines = bytes.div_ceil(LINE_BYTES);
        let sample = self.port.loan_slice_uninit(lines).map_err(|e| IpcError::new("loan", self.name, e))?;
        // SAFETY: the payload lies in a memory-mapped file, whose bytes the kernel has initialised
        // (to zero, or by an earlier message), and every bit pattern is a valid Line.
        let sample = unsafe { sample.assume_init() };
        Ok(Loan { sample, bytes })
    }

    /// Hands a message over and wakes the readers.
    ///
    /// # Errors
    /// When it cannot be delivered. That a reader has died is no error.
    pub fn send(&self, mut loan: Loan) -> Result<(), IpcError> {
        let bytes = loan.bytes as u32;
        let header = loan.header_mut();
        header.payload_bytes = bytes;
        header.issued_ns = monotonic_ns();
        header.first_ns = self.first_ns.get().unwrap_or(header.issued_ns);
        self.first_ns.set(Some(header.first_ns));
        header.serial = self.serial.replace(self.serial.get() + 1);
        loan.sample.send().map_err(|e| IpcError::new("send", self.name, e))?;
        self.notify()
    }

    /// Sends a header with the bytes of a plain record.
    ///
    /// # Errors
    /// As [`Self::loan`] and [`Self::send`].
    pub fn send_record<T: bytemuck::Pod>(&self, header: Header, record: &T) -> Result<(), IpcError> {
        let mut loan = self.loan(size_of::<T>())?;
        *loan.header_mut() = header;
        loan.payload_mut().copy_from_slice(bytemuck::bytes_of(record));
        self.send(loan)
    }

    /// Connects readers that came since, and gives them the history.
    ///
    /// # Errors
    /// When a connection cannot be made.
    pub fn refresh(&self) -> Result<(), IpcError> {
        self.port.update_connections().map_err(|e| IpcError::new("connect", self.name, e))
    }

    fn notify(&self) -> Result<(), IpcError> {
        self.notifier.notify().map(|_| ()).map_err(|e| IpcError::new("notify", self.name, e))
    }
}

impl Loan {
    /// The header, to be written.
    pub fn header_mut(&mut self) -> &mut Header {
        self.sample.user_header_mut()
    }

    /// Sends only the first `bytes` bytes of what was loaned.
    pub fn truncate(&mut self, bytes: usize) {
        self.bytes = self.bytes.min(bytes);
    }

    /// The payload, to be written; it starts at a multiple of 64 bytes.
    pub fn payload_mut(&mut self) -> &mut [u8] {
        &mut bytemuck::cast_slice_mut(self.sample.payload_mut())[..self.bytes]
    }
}

/// Reads messages in place.
#[derive(Debug)]
pub struct Subscriber {
    pub(crate) port: IoxSubscriber<ipc::Service, [Line], Header>,
    pub(crate) listener: Listener<ipc::Service>,
    pub(crate) name: &'static str,
    /// Publisher and serial number of the last message.
    pub(crate) last: Cell<Option<(UniquePublisherId, u64)>>,
    /// When it began, or when its last message was sent, on the monotonic clock: what a publisher sent that is
    /// younger, it has been sent from the first message on.
    pub(crate) known_ns: Cell<u64>,
    pub(crate) missed: Cell<u64>,
}

/// A message that is being read; it stays as it is until it is dropped.
#[derive(Debug)]
pub struct Sample {
    sample: IoxSample<ipc::Service, [Line], Header>,
}

impl Subscriber {
    /// The next message, if there is one. Of services with a buffer of one it is the newest.
    /// The message before must have been dropped.
    ///
    /// # Errors
    /// When more messages are held than the service allows, or the connection is broken.
    pub fn receive(&self) -> Result<Option<Sample>, IpcError> {
        let sample = self.port.receive().map_err(|e| IpcError::new("receive", self.name, e))?;
        if let Some(sample) = &sample {
            let (origin, header) = (sample.origin(), sample.user_header());
            let serial = header.serial;
            let gap = match self.last.replace(Some((origin, serial))) {
                Some((publisher, before)) if publisher == origin => {
                    serial.saturating_sub(before).saturating_sub(1)
                }
                // Of one that is older, it cannot tell what came before the reader, or before another's message.
                _ if header.first_ns < self.known_ns.get() => 0,
                _ => serial,
            };
            self.known_ns.set(header.issued_ns);
            self.missed.set(self.missed.get().saturating_add(gap));
        }
        Ok(sample.map(|sample| Sample { sample }))
    }

    /// Messages that newer ones overtook before they were received, since the last call.
    pub fn take_missed(&self) -> u64 {
        self.missed.take()
    }
}

impl Sample {
    /// Whether this process has sent it itself.
    pub fn is_from(&self, publisher: &Publisher) -> bool {
        self.sample.origin() == publisher.port.id()
    }

    /// The header; to be checked before it is used.
    pub fn header(&self) -> &Header {
        self.sample.user_header()
    }

    /// The payload, as long as its header says, but never longer than what is there.
    pub fn payload(&self) -> &[u8] {
        let bytes: &[u8] = bytemuck::cast_slice(self.sample.payload());
        &bytes[..bytes.len().min(self.header().payload_bytes as usize)]
    }
}
