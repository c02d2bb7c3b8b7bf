//! Typed messages: the input of a stage is checked once, and its output has the layout of its service.

use crate::header::{Header, MessageError};
use crate::pipeline::Kind;
use std::marker::PhantomData;

/// A message on a service. The implementing types are empty marker types.
pub trait Message: 'static {
    /// The kind, which determines the service.
    const KIND: Kind;

    /// A checked message, read in place.
    type View<'a>;

    /// Checks a message.
    ///
    /// # Errors
    /// If the header or the payload is invalid.
    fn view<'a>(header: &Header, payload: &'a [u8]) -> Result<Self::View<'a>, MessageError>;

    /// Maximum length of the payload for images of `width` × `height` pixels, in bytes.
    fn max_payload_bytes(width: usize, height: usize) -> usize;
}

/// The payload of a message, to be written in place with the methods that the module of the message defines.
#[derive(Debug)]
pub struct Output<'a, M> {
    pub(crate) payload: &'a mut [u8],
    message: PhantomData<M>,
}

/// Number of payload bytes that were written. Only the writers of the messages create it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Written(pub(crate) usize);

impl Written {
    /// Length of the payload in bytes.
    pub fn bytes(self) -> usize {
        self.0
    }
}

impl<'a, M: Message> Output<'a, M> {
    /// Wraps a payload of at least [`Message::max_payload_bytes`] bytes, aligned to eight bytes.
    pub fn new(payload: &'a mut [u8]) -> Self {
        Self { payload, message: PhantomData }
    }
}
