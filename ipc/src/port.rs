//! Publishing and subscribing without copies.

use crate::bus::IpcError;
use crate::header::Header;
use iceoryx2::port::listener::Listener;
use iceoryx2::port::notifier::Notifier;
use iceoryx2::port::publisher::Publisher as IoxPublisher;
use iceoryx2::port::subscriber::Subscriber as IoxSubscriber;
use iceoryx2::port::update_connections::UpdateConnections;
use iceoryx2::prelude::ipc;
use iceoryx2::sample::Sample as IoxSample;
use iceoryx2::sample_mut::SampleMut;

/// Writes messages in place and wakes their readers.
#[derive(Debug)]
pub struct Publisher {
    pub(crate) port: IoxPublisher<ipc::Service, [u8], Header>,
    pub(crate) notifier: Notifier<ipc::Service>,
    pub(crate) name: &'static str,
}

/// A message that is being written.
#[derive(Debug)]
pub struct Loan {
    sample: SampleMut<ipc::Service, [u8], Header>,
}

impl Publisher {
    /// Borrows `bytes` bytes of shared memory for the next message. Their content is what an
    /// earlier message left there.
    ///
    /// # Errors
    /// When the message is longer than the service allows, or the last one was not yet sent.
    pub fn loan(&self, bytes: usize) -> Result<Loan, IpcError> {
        let sample = self.port.loan_slice_uninit(bytes).map_err(|e| IpcError::new("loan", self.name, e))?;
        // SAFETY: the payload lies in a memory-mapped file, whose bytes the kernel has initialised
        // (to zero, or by an earlier message), and every bit pattern is a valid u8.
        let sample = unsafe { sample.assume_init() };
        Ok(Loan { sample })
    }

    /// Hands a message over and wakes the readers.
    ///
    /// # Errors
    /// When it cannot be delivered. That a reader has died is no error.
    pub fn send(&self, loan: Loan) -> Result<(), IpcError> {
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

    /// The payload, to be written. Eight-byte aligned, and more.
    pub fn payload_mut(&mut self) -> &mut [u8] {
        self.sample.payload_mut()
    }
}

/// Reads messages in place.
#[derive(Debug)]
pub struct Subscriber {
    pub(crate) port: IoxSubscriber<ipc::Service, [u8], Header>,
    pub(crate) listener: Listener<ipc::Service>,
    pub(crate) name: &'static str,
}

/// A message that is being read; it stays as it is until it is dropped.
#[derive(Debug)]
pub struct Sample {
    sample: IoxSample<ipc::Service, [u8], Header>,
}

impl Subscriber {
    /// The next message, if there is one. Of services with a buffer of one it is the newest.
    /// The message before must have been dropped.
    ///
    /// # Errors
    /// When more messages are held than the service allows, or the connection is broken.
    pub fn receive(&self) -> Result<Option<Sample>, IpcError> {
        let sample = self.port.receive().map_err(|e| IpcError::new("receive", self.name, e))?;
        Ok(sample.map(|sample| Sample { sample }))
    }
}

impl Sample {
    /// The header; to be checked before it is used.
    pub fn header(&self) -> &Header {
        self.sample.user_header()
    }

    /// The payload.
    pub fn payload(&self) -> &[u8] {
        self.sample.payload()
    }
}
