//! A frame of a CAN bus.

/// Maximum length of a frame's data, in bytes: CAN FD.
pub const MAX_DATA_BYTES: usize = 64;

/// Largest standard identifier: 11 bits.
pub const MAX_STANDARD_ID: u32 = 0x7ff;

/// Largest extended identifier: 29 bits.
pub const MAX_EXTENDED_ID: u32 = 0x1fff_ffff;

/// A data frame of a CAN bus.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Frame {
    /// Its identifier.
    pub id: FrameId,
    data: [u8; MAX_DATA_BYTES],
    length: usize,
}

/// Identifier of a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct FrameId {
    /// The number: 11 bits, or 29 of an extended one.
    pub number: u32,
    /// Whether it is extended.
    pub is_extended: bool,
}

impl Frame {
    /// A frame; data beyond 64 bytes is left out.
    pub fn new(id: u32, is_extended: bool, data: &[u8]) -> Self {
        let mut frame = Self {
            id: FrameId { number: id, is_extended },
            data: [0; MAX_DATA_BYTES],
            length: data.len().min(MAX_DATA_BYTES),
        };
        frame.data[..frame.length].copy_from_slice(&data[..frame.length]);
        frame
    }

    /// Its data.
    pub fn data(&self) -> &[u8] {
        &self.data[..self.length]
    }
}
