//! `pair`: capture → stereo. Left image, then right image, each width × height grey bytes.

use crate::header::{Header, Kind, MessageError, check_length};
use crate::typed::Message;

/// Bytes of the payload for images of `width` × `height`.
pub fn payload_bytes(width: usize, height: usize) -> usize {
    2 * width * height
}

/// The images of a message.
#[derive(Clone, Copy, Debug)]
pub struct Pair<'a> {
    /// Left image, row after row.
    pub left: &'a [u8],
    /// Right image, row after row.
    pub right: &'a [u8],
}

/// Checks a message and sees its images.
///
/// # Errors
/// When the header or the length is wrong.
pub fn view<'a>(header: &Header, payload: &'a [u8]) -> Result<Pair<'a>, MessageError> {
    header.check(Kind::Pair)?;
    check_length(payload, 2 * header.pixels())?;
    let (left, right) = payload.split_at(header.pixels());
    Ok(Pair { left, right })
}

/// The two images of a payload, to be written.
pub fn split_mut(payload: &mut [u8]) -> (&mut [u8], &mut [u8]) {
    payload.split_at_mut(payload.len() / 2)
}

/// The message in types.
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
