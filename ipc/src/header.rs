//! The header of every message, and its check.

use crate::alarm::Faults;
use crate::clock::monotonic_ns;
use crate::copied::copy_out;
use crate::motion::{MotionRecord, VehicleRecord};
pub use crate::pipeline::{Kind, VERSION};
use crate::pipeline::{PATH_LENGTH, Role};
use crate::range::{
    ANY_U32, CLOCK_NS, COUNT, Each, FLAG, MAX_SOURCE_NS, Nested, PADDING, RangeError, Ranged, ranges, within,
};
use crate::type_name;
use iceoryx2::prelude::ZeroCopySend;
use thiserror::Error;

/// First field of every header ("LKT1").
const MAGIC: u32 = 0x4c4b_5431;

/// A cache line. Payloads consist of whole lines, so that they are aligned for all SIMD kernels.
#[repr(C, align(64))]
#[derive(Clone, Copy, Debug, bytemuck::Pod, bytemuck::Zeroable)]
pub struct Line(pub(crate) [u8; LINE_BYTES]);

// SAFETY: the layout is fixed by repr(C), there are no pointers, nothing to drop, and every bit
// pattern is valid. (The derive does not accept an alignment.)
unsafe impl ZeroCopySend for Line {
    unsafe fn type_name() -> &'static str {
        type_name::LINE
    }
}

/// Bytes of a [`Line`].
pub const LINE_BYTES: usize = 64;

/// Maximum width and height of an image, in pixels.
pub const MAX_SIDE: u32 = 8192;

/// Minimum disparity of a region or track, in px: the resolution of the map.
pub(crate) const MIN_DISPARITY_PX: f64 = 1.0 / 256.0;

/// Maximum disparity, in px: the width of an image.
pub(crate) const MAX_DISPARITY_PX: f64 = MAX_SIDE as f64;

/// Maximum number of pixels of an image.
pub(crate) const MAX_PIXELS: u32 = MAX_SIDE * MAX_SIDE;

/// Bits of [`Header::modes`]. The scheduler sends them to capture, and capture writes them into each header, so that
/// all stages treat a frame in the same way.
pub mod modes {
    /// Regions are tracked, but not classified, because the board is too hot.
    pub const RECOGNITION_OFF: u32 = 1;

    /// All bits that have a meaning.
    pub const ALL: u32 = RECOGNITION_OFF;
}

/// When a stage worked on a frame, in nanoseconds of CLOCK_MONOTONIC; 0 = not yet.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ZeroCopySend)]
pub struct Stamp {
    /// Start of the work, in ns.
    pub begin_ns: u64,
    /// When its result was complete, in ns.
    pub end_ns: u64,
}

ranges! {
    Stamp as "header: stamp" {
        begin_ns: CLOCK_NS,
        end_ns: CLOCK_NS,
    }
}

/// The header of every message.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Header {
    pub(crate) magic: u32,
    pub(crate) version: u16,
    pub(crate) kind: u16,
    /// Number of the pair in its source, from 0.
    pub sequence: u64,
    /// Source time: time in the recording, the scene or of the camera, in ns. Filters use it.
    pub source_ns: u64,
    /// When the pair was captured, in ns of CLOCK_MONOTONIC. Ages and latencies are measured from it; 0 where the
    /// message has no frame.
    pub capture_ns: u64,
    /// When the message was sent, in ns of CLOCK_MONOTONIC. Of two contradicting messages, the later one is valid.
    pub issued_ns: u64,
    /// Number of the message among those of its publisher, from 0. Gaps are messages that a reader missed.
    pub(crate) serial: u64,
    /// When the first message of its publisher was sent, in ns of CLOCK_MONOTONIC. Subscribers that existed by then
    /// have been sent all its messages.
    pub(crate) first_ns: u64,
    /// Number of the attempt at this frame, from 0; above 0 only after a stage died in lock-step.
    pub attempt: u32,
    /// Length of the payload in bytes; shared memory holds whole lines of [`LINE_BYTES`].
    pub(crate) payload_bytes: u32,
    /// 1 if the message withdraws the results of this and all earlier frames, because a stage has died or results
    /// have stopped; else 0. Only the scheduler sends 1, on `obstacles`.
    pub withdraws: u32,
    /// Width of the frame's images in pixels, 1 to [`MAX_SIDE`]; 0 where the message has no frame.
    pub width: u32,
    /// Height of the frame's images in pixels, 1 to [`MAX_SIDE`]; 0 where the message has no frame.
    pub height: u32,
    /// How stages treat the frame: bits of [`modes`].
    pub modes: u32,
    /// Self-checks that failed for the frame so far: bits of [`crate::alarm::Faults`].
    pub faults: u32,
    /// Padding; 0.
    pub(crate) reserved: u32,
    /// What the vehicle reported; capture writes it.
    pub vehicle: VehicleRecord,
    /// The vehicle's own motion; the stage road writes it.
    pub motion: MotionRecord,
    /// One stamp per stage, in the order of [`crate::pipeline::PATH`].
    pub stamps: [Stamp; PATH_LENGTH],
}

// SAFETY: the layout is fixed by repr(C), and the fields are whole numbers and records that may be sent. (The derive takes
// no name that is computed.)
unsafe impl ZeroCopySend for Header {
    unsafe fn type_name() -> &'static str {
        type_name::HEADER
    }
}

/// Maximum length of a payload, in bytes: the maps of `depth`, with room for the records of a message.
const MAX_PAYLOAD_BYTES: u32 = 6 * MAX_SIDE * MAX_SIDE;

ranges! {
    Header as "header" {
        // `check` compares the first three with what is expected.
        magic: ANY_U32,
        version: within(0, u16::MAX),
        kind: within(0, u16::MAX),
        sequence: COUNT,
        source_ns: within(0, MAX_SOURCE_NS),
        capture_ns: CLOCK_NS,
        issued_ns: CLOCK_NS,
        serial: COUNT,
        first_ns: CLOCK_NS,
        attempt: ANY_U32,
        payload_bytes: within(0, MAX_PAYLOAD_BYTES),
        withdraws: FLAG,
        width: within(0, MAX_SIDE),
        height: within(0, MAX_SIDE),
        modes: within(0, modes::ALL),
        faults: within(0, Faults::ALL.0),
        reserved: PADDING,
        vehicle: Nested,
        motion: Nested,
        stamps: Each(Nested),
    }
}

/// Why a message is refused.
#[derive(Clone, Copy, Debug, Error, PartialEq)]
pub enum MessageError {
    /// The header does not start with the magic number.
    #[error("not a lookout message")]
    Magic,
    /// Another layout version.
    #[error("layout version {0}, this program has {VERSION}")]
    Version(u16),
    /// Another kind than the service carries.
    #[error("message kind {0} does not belong to this service")]
    Kind(u16),
    /// Image size out of range.
    #[error("image size {width}x{height} is out of range")]
    Size {
        /// Width in the header, in pixels.
        width: u32,
        /// Height in the header, in pixels.
        height: u32,
    },
    /// The payload has another length than its header requires.
    #[error("payload of {given} bytes, its header requires {needed}")]
    Length {
        /// Actual length in bytes.
        given: usize,
        /// Required length in bytes.
        needed: usize,
    },
    /// A number is out of range.
    #[error(transparent)]
    Range(#[from] RangeError),
    /// A number contradicts another one.
    #[error("{what} is out of range: {value}")]
    Value {
        /// Name of the field.
        what: &'static str,
        /// Its value.
        value: u64,
    },
}

impl Header {
    /// A header of a kind; all other fields are zero.
    pub fn new(kind: Kind) -> Self {
        Self { magic: MAGIC, version: VERSION, kind: kind as u16, ..Self::default() }
    }

    /// Sets the source time, in ns. A time beyond [`MAX_SOURCE_NS`] becomes that: a source that gives such times seems to
    /// stand still, which the alarm reports, while a message with them would be refused.
    pub fn set_source_time(&mut self, source_ns: u64) {
        self.source_ns = source_ns.min(MAX_SOURCE_NS);
    }

    /// The header of the same frame for a message of another kind.
    pub fn forward(&self, kind: Kind) -> Self {
        Self { kind: kind as u16, ..*self }
    }

    /// Checks magic number, layout version, kind, image size, the ranges of all other fields, and that the message was
    /// not issued in the future: of two messages of `obstacles` the one that was issued later is valid.
    ///
    /// # Errors
    /// The first violation; the message must then not be used.
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
        self.check_ranges()
    }

    /// Checks everything but kind and image size.
    pub(crate) fn check_ranges(&self) -> Result<(), MessageError> {
        if self.magic != MAGIC {
            return Err(MessageError::Magic);
        }
        if self.version != VERSION {
            return Err(MessageError::Version(self.version));
        }
        Ranged::check(self)?;
        if self.issued_ns > monotonic_ns() {
            return Err(MessageError::Value {
                what: "header: issued_ns, in the future,",
                value: self.issued_ns,
            });
        }
        Ok(())
    }

    /// Sets the stamp of a stage. Processes outside [`crate::pipeline::PATH`] have none.
    pub fn set_stamp(&mut self, role: Role, stamp: Stamp) {
        if let Some(place) = role.place() {
            self.stamps[place] = stamp;
        }
    }

    /// When the last stage finished the frame, in ns of CLOCK_MONOTONIC; 0 = not yet.
    pub fn result_ns(&self) -> u64 {
        self.stamps[PATH_LENGTH - 1].end_ns
    }

    /// Time from capture to result, in nanoseconds; 0 if the result precedes the capture.
    pub fn latency_ns(&self) -> u64 {
        self.result_ns().saturating_sub(self.capture_ns)
    }

    /// Number of pixels of one image of the frame.
    pub fn pixels(&self) -> usize {
        self.width as usize * self.height as usize
    }
}

/// Checks that a box (left, top, width, height, in px) lies within the frame's images.
pub(crate) fn check_box(what: &'static str, header: &Header, bounds: &[u32; 4]) -> Result<(), MessageError> {
    let [x, y, width, height] = bounds.map(u64::from);
    for (end, side) in [(x + width, header.width), (y + height, header.height)] {
        if end > u64::from(side) {
            return Err(MessageError::Value { what, value: end });
        }
    }
    Ok(())
}

/// Checks that a payload has exactly the length that its header requires.
pub(crate) fn check_length(payload: &[u8], needed: usize) -> Result<(), MessageError> {
    if payload.len() == needed { Ok(()) } else { Err(MessageError::Length { given: payload.len(), needed }) }
}

/// Copies the single record that a payload consists of, and checks the copy.
pub(crate) fn record<T: bytemuck::Pod + Ranged>(payload: &[u8]) -> Result<T, MessageError> {
    let needed = size_of::<T>();
    check_length(payload, needed)?;
    let record: T = copy_out(payload).ok_or(MessageError::Length { given: payload.len(), needed })?;
    record.check()?;
    Ok(record)
}

/// Copies UTF-8 text into a field of fixed size, truncated at a character boundary and padded with zeros.
pub fn put_text(field: &mut [u8], text: &str) {
    let mut end = text.len().min(field.len());
    while !text.is_char_boundary(end) {
        end -= 1;
    }
    field[..end].copy_from_slice(&text.as_bytes()[..end]);
    field[end..].fill(0);
}

/// Reads the text of such a field up to the first zero; invalid UTF-8 becomes U+FFFD.
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
        // As in the attack: obstacles of the age of the universe.
        let late = Header { source_ns: 1 << 62, ..good };
        let error = late.check(Kind::Pair).unwrap_err().to_string();
        assert_eq!(error, "header: source_ns is 4611686018427387904, valid is 0 to 4000000000000000000");
        // A source may give such a time.
        let mut limited = good;
        limited.set_source_time(u64::MAX);
        assert_eq!(limited.check(Kind::Pair), Ok(()));
        // Unix time is a source time, too.
        assert_eq!(Header { source_ns: 1_800_000_000_000_000_000, ..good }.check(Kind::Pair), Ok(()));
        for (field, wrong) in good.invalid() {
            assert!(wrong.check(Kind::Pair).is_err(), "{field}: {wrong:?}");
        }
        // A message of tomorrow would outlive all results until then.
        let tomorrow = Header { issued_ns: monotonic_ns() + 86_400_000_000_000, ..good };
        assert!(tomorrow.check(Kind::Pair).is_err());
        assert_eq!(Header { issued_ns: monotonic_ns(), ..good }.check(Kind::Pair), Ok(()));
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
