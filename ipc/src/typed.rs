//! Messages by type: what a stage reads is checked once, and what it writes has the form of its service.

use crate::header::{Header, MessageError};
use crate::pipeline::Kind;
use std::marker::PhantomData;

/// A message on a service. The implementing types are empty: they name the message in types.
pub trait Message: 'static {
    /// The kind, which names the service.
    const KIND: Kind;

    /// A checked message, read in place.
    type View<'a>;

    /// Checks a message.
    ///
    /// # Errors
    /// When header or payload are not sound.
    fn view<'a>(header: &Header, payload: &'a [u8]) -> Result<Self::View<'a>, MessageError>;

    /// The longest payload for images of `width` × `height`, in bytes.
    fn max_payload_bytes(width: usize, height: usize) -> usize;
}

/// The payload of a message that is to be written in place. The module of each message says how.
#[derive(Debug)]
pub struct Output<'a, M> {
    pub(crate) payload: &'a mut [u8],
    message: PhantomData<M>,
}

/// Bytes of a payload that were written: only the writers of the messages make it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Written(pub(crate) usize);

impl Written {
    /// The bytes.
    pub fn bytes(self) -> usize {
        self.0
    }
}

impl<'a, M: Message> Output<'a, M> {
    /// A payload of [`Message::max_payload_bytes`] or more, aligned to eight bytes.
    pub fn new(payload: &'a mut [u8]) -> Self {
        Self { payload, message: PhantomData }
    }
}
