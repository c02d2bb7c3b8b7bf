//! The header of every message, and its check.

pub use crate::pipeline::{Kind, VERSION};
use crate::pipeline::{PATH_LENGTH, Role};
use iceoryx2::prelude::ZeroCopySend;
use thiserror::Error;

/// Marks a header as ours.
const MAGIC: u32 = 0x4c4b_5431;

/// A cache line: what payloads are made of, so that they are aligned for every kernel.
#[repr(C, align(64))]
#[derive(Clone, Copy, Debug, bytemuck::Pod, bytemuck::Zeroable)]
pub struct Line(pub(crate) [u8; LINE_BYTES]);

// SAFETY: the layout is fixed by repr(C), there are no pointers, nothing to drop, and every bit
// pattern is valid. (The derive does not accept an alignment.)
unsafe impl ZeroCopySend for Line {}

/// Bytes of a [`Line`].
pub const LINE_BYTES: usize = 64;

/// The greatest width and height of an image, in pixels.
pub const MAX_SIDE: u32 = 8192;

/// Bits of [`Header::modes`]: what the scheduler wants of the stages, told by capture with each frame, so
/// that a frame is treated the same way by every stage that looks.
pub mod modes {
    /// Regions are tracked, but not recognised: the board is too hot.
    pub const RECOGNITION_OFF: u32 = 1;
}

/// When a stage worked on a frame, in nanoseconds of the monotonic clock; 0 = not yet.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ZeroCopySend)]
pub struct Stamp {
    /// When it took the frame up.
    pub begin_ns: u64,
    /// When its result was written.
    pub end_ns: u64,
}

/// The header of every message.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ZeroCopySend)]
pub struct Header {
    pub(crate) magic: u32,
    pub(crate) version: u16,
    pub(crate) kind: u16,
    /// Number of the pair in its source, from 0.
    pub sequence: u64,
    /// Time in the scene: of the recording, or of the camera. Filters run on it.
    pub source_ns: u64,
    /// When the pair was captured, on the monotonic clock. Ages and latencies are measured from it.
    pub capture_ns: u64,
    /// When the message was sent, on the monotonic clock: of two messages that differ, the later holds.
    pub issued_ns: u64,
    /// Number of the message among those of its publisher, from 0: tells readers what they missed.
    pub(crate) serial: u64,
    /// When the first message of its publisher was sent, on the monotonic clock: who was there by then has been
    /// sent them all.
    pub(crate) first_ns: u64,
    /// Which attempt at this frame it is; above 0 only after a stage died in lock-step.
    pub attempt: u32,
    /// Bytes of the payload; shared memory holds whole lines.
    pub(crate) payload_bytes: u32,
    /// 1 when the message takes back what was said of this and all earlier frames: a stage has died, or
    /// results have stopped. Only the scheduler sends such, on `obstacles`.
    pub withdraws: u32,
    /// Width of the frame's images in pixels; 0 where there are none.
    pub width: u32,
    /// Height of the frame's images in pixels; 0 where there are none.
    pub height: u32,
    /// How stages are to treat the frame: bits of [`modes`].
    pub modes: u32,
    /// Self-checks that failed on the frame's way so far: [`crate::alarm::Faults`].
    pub faults: u32,
    /// Padding; 0.
    pub(crate) reserved: u32,
    /// One stamp per stage, in the order of [`crate::pipeline::PATH`].
    pub stamps: [Stamp; PATH_LENGTH],
}

/// Why a message is not used.
#[derive(Clone, Copy, Debug, Error, PartialEq, Eq)]
pub enum MessageError {
    /// Not one of ours.
    #[error("no lookout message")]
    Magic,
    /// Written by another version of the program.
    #[error("layout version {0}, this program has {VERSION}")]
    Version(u16),
    /// Another kind than the service carries.
    #[error("message kind {0} on a service for another")]
    Kind(u16),
    /// Image sides out of range.
    #[error("{width}x{height} pixels")]
    Size {
        /// Width that the header claims.
        width: u32,
        /// Height that it claims.
        height: u32,
    },
    /// The bytes are not as many as the header says.
    #[error("{given} bytes, its header needs {needed}")]
    Length {
        /// Bytes that came.
        given: usize,
        /// Bytes that the header needs.
        needed: usize,
    },
    /// A count or value out of range.
    #[error("{what} is {value}")]
    Value {
        /// Name of the field.
        what: &'static str,
        /// What it holds.
        value: u64,
    },
}

impl Header {
    /// A header of a kind, all else zero.
    pub fn new(kind: Kind) -> Self {
        Self { magic: MAGIC, version: VERSION, kind: kind as u16, ..Self::default() }
    }

    /// The same frame on its way to the next stage.
    pub fn forward(&self, kind: Kind) -> Self {
        Self { kind: kind as u16, ..*self }
    }

    /// Checks that the header is ours, of the expected kind, and of possible size.
    ///
    /// # Errors
    /// Says what is wrong; nothing of the message may then be used.
    pub fn check(&self, kind: Kind) -> Result<(), MessageError> {
        if self.magic != MAGIC {
            return Err(MessageError::Magic);
        }
        if self.version != VERSION {
            return Err(MessageError::Version(self.version));
        }
        if self.kind != kind as u16 {
            return Err(MessageError::Kind(self.kind));
        }
        let side = 1..=MAX_SIDE;
        if kind.service().carries_frame && !(side.contains(&self.width) && side.contains(&self.height)) {
            return Err(MessageError::Size { width: self.width, height: self.height });
        }
        Ok(())
    }

    /// Notes when a stage worked on the frame. A stage beside the path leaves no stamp.
    pub fn set_stamp(&mut self, role: Role, stamp: Stamp) {
        if let Some(place) = role.place() {
            self.stamps[place] = stamp;
        }
    }

    /// When the result of the frame was written; 0 = not yet.
    pub fn result_ns(&self) -> u64 {
        self.stamps[PATH_LENGTH - 1].end_ns
    }

    /// Time from capture to result, in nanoseconds; 0 when the stamps make no sense.
    pub fn latency_ns(&self) -> u64 {
        self.result_ns().saturating_sub(self.capture_ns)
    }

    /// Pixels of one image of the frame.
    pub fn pixels(&self) -> usize {
        self.width as usize * self.height as usize
    }
}

/// Checks that a payload is exactly as long as its header needs.
pub(crate) fn check_length(payload: &[u8], needed: usize) -> Result<(), MessageError> {
    if payload.len() == needed { Ok(()) } else { Err(MessageError::Length { given: payload.len(), needed }) }
}

/// Reads the one plain record that a payload consists of.
pub(crate) fn record<T: bytemuck::Pod>(payload: &[u8]) -> Result<T, MessageError> {
    check_length(payload, size_of::<T>())?;
    Ok(bytemuck::pod_read_unaligned(payload))
}

/// Copies text into a field of fixed size, shortened at a character, padded with zeros.
pub fn put_text(field: &mut [u8], text: &str) {
    let mut end = text.len().min(field.len());
    while !text.is_char_boundary(end) {
        end -= 1;
    }
    field[..end].copy_from_slice(&text.as_bytes()[..end]);
    field[end..].fill(0);
}

/// Reads such a field; what is not text is shown as such.
pub fn get_text(field: &[u8]) -> String {
    let end = field.iter().position(|&b| b == 0).unwrap_or(field.len());
    String::from_utf8_lossy(&field[..end]).into_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn foreign_and_wrong_headers_are_refused() {
        let good = Header { width: 640, height: 480, ..Header::new(Kind::Pair) };
        assert_eq!(good.check(Kind::Pair), Ok(()));
        assert_eq!(good.check(Kind::Depth), Err(MessageError::Kind(1)));
        assert_eq!(good.forward(Kind::Depth).check(Kind::Depth), Ok(()));
        assert_eq!(Header::default().check(Kind::Pair), Err(MessageError::Magic));
        let newer = Header { version: 99, ..good };
        assert_eq!(newer.check(Kind::Pair), Err(MessageError::Version(99)));
        for (width, height) in [(0, 480), (640, 0), (MAX_SIDE + 1, 1), (u32::MAX, u32::MAX)] {
            let header = Header { width, height, ..good };
            assert!(matches!(header.check(Kind::Pair), Err(MessageError::Size { .. })));
        }
        // Messages without images have no size.
        assert_eq!(Header::new(Kind::Report).check(Kind::Report), Ok(()));
    }

    #[test]
    fn text_fits_its_field() {
        let mut field = [9_u8; 6];
        put_text(&mut field, "grün");
        assert_eq!(get_text(&field), "grün");
        put_text(&mut field, "abcdeü");
        assert_eq!(get_text(&field), "abcde");
        assert_eq!(get_text(&[0xff, b'a']), "\u{fffd}a");
    }
}
