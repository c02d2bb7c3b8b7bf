//! `lanes`: nothing yet. An empty message of the walk in CONTRIBUTING.md.

use crate::header::{Header, Kind, MessageError, check_length};
use crate::typed::{Message, Output, Written};

/// The message.
#[derive(Clone, Copy, Debug)]
pub struct LanesMessage;

impl Message for LanesMessage {
    const KIND: Kind = Kind::Lanes;
    type View<'a> = ();

    fn view<'a>(header: &Header, payload: &'a [u8]) -> Result<Self::View<'a>, MessageError> {
        header.check(Kind::Lanes)?;
        check_length(payload, 0)
    }

    fn max_payload_bytes(_: usize, _: usize) -> usize {
        0
    }
}

impl Output<'_, LanesMessage> {
    /// Writes the message.
    pub fn write(self) -> Written {
        Written(0)
    }
}
