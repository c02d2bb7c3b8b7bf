//! `depth`: stereo → road. Disparity (u16, 1/256 px, 0 = unknown), left image (u8), confidence (u8) and the right
//! image as it was matched (u8), each width × height values, row after row.

use crate::header::{Header, Kind, MessageError, check_length};
use crate::typed::{Message, Output, Written};

/// Length of the payload in bytes for images of `width` × `height` pixels.
pub fn payload_bytes(width: usize, height: usize) -> usize {
    5 * width * height
}

/// The maps of a message, each width × height values, row after row, read in place. Every value is valid, and another
/// process may change it at any time: whoever uses them must accept any value, also another one at the next look.
#[derive(Clone, Copy, Debug)]
pub struct Depth<'a> {
    /// Disparity in 1/256 px; 0 = unknown.
    pub disparity: &'a [u16],
    /// Left image, grey values.
    pub left: &'a [u8],
    /// Confidence of the disparity, 1 to 255; 0 where it is unknown.
    pub confidence: &'a [u8],
    /// Right image as it was matched: after the correction of row offsets, if one is active.
    pub right: &'a [u8],
}

/// As [`Depth`], for writing.
#[derive(Debug)]
pub struct DepthMut<'a> {
    /// Disparity in 1/256 px; 0 = unknown.
    pub disparity: &'a mut [u16],
    /// Left image, grey values.
    pub left: &'a mut [u8],
    /// Confidence of the disparity, 1 to 255; 0 where it is unknown.
    pub confidence: &'a mut [u8],
    /// Right image as it was matched: after the correction of row offsets, if one is active.
    pub right: &'a mut [u8],
}

/// Checks a message and returns its maps.
///
/// # Errors
/// If the header, the length or the alignment is invalid. Every value of a map is valid.
pub fn view<'a>(header: &Header, payload: &'a [u8]) -> Result<Depth<'a>, MessageError> {
    header.check(Kind::Depth)?;
    let pixels = header.pixels();
    check_length(payload, 5 * pixels)?;
    let (disparity, rest) = payload.split_at(2 * pixels);
    let disparity = bytemuck::try_cast_slice(disparity)
        .map_err(|_| MessageError::Value { what: "depth: address", value: payload.as_ptr() as u64 })?;
    let (left, rest) = rest.split_at(pixels);
    let (confidence, right) = rest.split_at(pixels);
    Ok(Depth { disparity, left, confidence, right })
}

/// The maps of a payload for images of `pixels` pixels, for writing.
///
/// # Errors
/// If the payload has another length, or is not aligned to two bytes.
pub fn split_mut(payload: &mut [u8], pixels: usize) -> Result<DepthMut<'_>, MessageError> {
    check_length(payload, 5 * pixels)?;
    let at = payload.as_ptr() as u64;
    let (disparity, rest) = payload.split_at_mut(2 * pixels);
    let disparity = bytemuck::try_cast_slice_mut(disparity)
        .map_err(|_| MessageError::Value { what: "depth: address", value: at })?;
    let (left, rest) = rest.split_at_mut(pixels);
    let (confidence, right) = rest.split_at_mut(pixels);
    Ok(DepthMut { disparity, left, confidence, right })
}

/// The typed message.
#[derive(Clone, Copy, Debug)]
pub struct DepthMessage;

impl Message for DepthMessage {
    const KIND: Kind = Kind::Depth;
    type View<'a> = Depth<'a>;

    fn view<'a>(header: &Header, payload: &'a [u8]) -> Result<Self::View<'a>, MessageError> {
        view(header, payload)
    }

    fn max_payload_bytes(width: usize, height: usize) -> usize {
        payload_bytes(width, height)
    }
}

impl<'a> Output<'a, DepthMessage> {
    /// Calls `fill` to write the maps of a frame of `pixels` pixels.
    ///
    /// # Errors
    /// If the payload is too short, or the error of `fill`.
    pub fn write<E: From<MessageError>>(
        self,
        pixels: usize,
        fill: impl FnOnce(DepthMut<'_>) -> Result<(), E>,
    ) -> Result<Written, E> {
        let needed = 5 * pixels;
        let given = self.payload.len();
        let payload = self.payload.get_mut(..needed).ok_or(MessageError::Length { given, needed })?;
        fill(split_mut(payload, pixels)?)?;
        Ok(Written(needed))
    }
}
