//! `pair`: capture → stereo. Left image, then right image, each width × height grey values (u8), row after row.

use crate::header::{Header, Kind, MessageError, check_length};
use crate::typed::Message;

/// Length of the payload in bytes for images of `width` × `height` pixels.
pub fn payload_bytes(width: usize, height: usize) -> usize {
    2 * width * height
}

/// The images of a message, read in place. Every value is valid, and another process may change it at any time: whoever
/// uses them must accept any value, also another one at the next look.
#[derive(Clone, Copy, Debug)]
pub struct Pair<'a> {
    /// Left image, grey values row after row.
    pub left: &'a [u8],
    /// Right image, grey values row after row.
    pub right: &'a [u8],
}

/// Checks a message and returns its images.
///
/// # Errors
/// If the header or the length is invalid.
pub fn view<'a>(header: &Header, payload: &'a [u8]) -> Result<Pair<'a>, MessageError> {
    header.check(Kind::Pair)?;
    check_length(payload, 2 * header.pixels())?;
    let (left, right) = payload.split_at(header.pixels());
    Ok(Pair { left, right })
}

/// The left and the right image of a payload, for writing.
pub fn split_mut(payload: &mut [u8]) -> (&mut [u8], &mut [u8]) {
    payload.split_at_mut(payload.len() / 2)
}

/// The typed message.
#[derive(Clone, Copy, Debug)]
pub struct PairMessage;

impl Message for PairMessage {
    const KIND: Kind = Kind::Pair;
    type View<'a> = Pair<'a>;

    fn view<'a>(header: &Header, payload: &'a [u8]) -> Result<Self::View<'a>, MessageError> {
        view(header, payload)
    }

    fn max_payload_bytes(width: usize, height: usize) -> usize {
        payload_bytes(width, height)
    }
}
