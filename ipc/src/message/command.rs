//! `command`: scheduler → capture. How fast to bring pairs, and in lock-step how far to go.

use crate::header::{Header, Kind, MessageError, record};
use crate::typed::Message;
use bytemuck::{Pod, Zeroable};

/// What the scheduler wants of the source.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct CommandRecord {
    /// 1 in lock-step: a pair is published only when `credit` allows it.
    pub lockstep: u32,
    /// 1 once no more pairs are wanted.
    pub drain: u32,
    /// In lock-step, the highest sequence number that may be published.
    pub credit: u64,
    /// Grows when the pair `credit` is to be published once more, because a stage died with it.
    pub attempt: u32,
    /// 1 while no pairs are wanted: the board is too hot.
    pub hold: u32,
    /// Time between pairs at live rate, in nanoseconds.
    pub period_ns: u64,
    /// What every header says of how the frame is to be treated: bits of [`crate::header::modes`].
    pub modes: u32,
    /// Padding; 0.
    pub reserved: u32,
}

/// Bytes of the payload.
pub const PAYLOAD_BYTES: usize = size_of::<CommandRecord>();

/// Checks a message and copies its record.
///
/// # Errors
/// When the header, the length or the period is wrong.
pub fn view(header: &Header, payload: &[u8]) -> Result<CommandRecord, MessageError> {
    header.check(Kind::Command)?;
    let command: CommandRecord = record(payload)?;
    if command.lockstep == 0 && command.period_ns == 0 {
        return Err(MessageError::Value { what: "period", value: 0 });
    }
    Ok(command)
}

/// The message in types.
#[derive(Clone, Copy, Debug)]
pub struct CommandMessage;

impl Message for CommandMessage {
    const KIND: Kind = Kind::Command;
    type View<'a> = CommandRecord;

    fn view<'a>(header: &Header, payload: &'a [u8]) -> Result<Self::View<'a>, MessageError> {
        view(header, payload)
    }

    fn max_payload_bytes(_: usize, _: usize) -> usize {
        PAYLOAD_BYTES
    }
}
