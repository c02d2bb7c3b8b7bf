//! `command`: scheduler → capture. The rate of the source and, in lock-step, its credit.

use crate::header::{Header, Kind, MessageError, modes, record};
use crate::range::{ANY_U32, CLOCK_NS, FLAG, PADDING, ranges, within};
use crate::typed::Message;
use bytemuck::{Pod, Zeroable};

/// Control of the source. A newer command replaces the previous one.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct CommandRecord {
    /// 1 in lock-step: a pair is published only if `credit` allows it; 0 at live rate.
    pub lockstep: u32,
    /// 1 from the time when the daemon stops: no more pairs are published; else 0.
    pub drain: u32,
    /// In lock-step, the highest sequence that may be published; 0 at live rate.
    pub credit: u64,
    /// In lock-step, number of the attempt at the pair `credit`, from 0. It grows when the pair is requested again
    /// because a stage died with it.
    pub attempt: u32,
    /// 1 while the board is too hot for any pair to be published; else 0.
    pub hold: u32,
    /// Time between pairs, in ns; at live rate above 0.
    pub period_ns: u64,
    /// Value of [`Header::modes`] for all frames: bits of [`crate::header::modes`].
    pub modes: u32,
    /// Padding; 0.
    pub reserved: u32,
}

ranges! {
    CommandRecord as "command" {
        lockstep: FLAG,
        drain: FLAG,
        // The credit ends nothing but the source, whose sequences are bounded by the header.
        credit: within(0, u64::MAX),
        attempt: ANY_U32,
        hold: FLAG,
        period_ns: CLOCK_NS,
        modes: within(0, modes::ALL),
        reserved: PADDING,
    }
}

/// Length of the payload in bytes.
pub const PAYLOAD_BYTES: usize = size_of::<CommandRecord>();

/// Checks a message and copies its record.
///
/// # Errors
/// If the header, the length or any field is invalid.
pub fn view(header: &Header, payload: &[u8]) -> Result<CommandRecord, MessageError> {
    header.check(Kind::Command)?;
    let command: CommandRecord = record(payload)?;
    if command.lockstep == 0 && command.period_ns == 0 {
        return Err(MessageError::Value { what: "command: period_ns", value: 0 });
    }
    Ok(command)
}

/// The typed message.
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::range::Ranged;

    #[test]
    fn every_number_outside_its_range_is_refused() {
        let header = Header::new(Kind::Command);
        let command = CommandRecord { period_ns: 1, ..CommandRecord::default() };
        assert_eq!(view(&header, bytemuck::bytes_of(&command)), Ok(command));
        for (field, wrong) in command.invalid() {
            assert!(view(&header, bytemuck::bytes_of(&wrong)).is_err(), "{field}: {wrong:?}");
        }
        // Only at live rate does a period of 0 mean pairs without a pause.
        let live = CommandRecord { period_ns: 0, ..command };
        assert!(view(&header, bytemuck::bytes_of(&live)).is_err());
        let lockstep = CommandRecord { lockstep: 1, ..live };
        assert!(view(&header, bytemuck::bytes_of(&lockstep)).is_ok());
    }
}
