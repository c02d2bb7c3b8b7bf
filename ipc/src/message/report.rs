//! `report`: every stage → scheduler. One record per frame, and a heartbeat when idle.

use crate::calibration::CalibrationRecord;
use crate::deadline::DeadlineRecord;
use crate::device::DeviceRecord;
use crate::header::{Header, Kind, MessageError, get_text, put_text, record};
use crate::realtime::RealtimeRecord;
use crate::pipeline::Role;
use crate::typed::Message;
use bytemuck::{Pod, Zeroable};

/// How a stage is doing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u32)]
pub enum Health {
    /// Starting, not yet able to take frames.
    Starting = 0,
    /// Working, or ready to.
    Ready = 1,
    /// The source has no more pairs.
    Finished = 2,
    /// The input cannot be used; a restart would not help. The text says why.
    Unusable = 3,
    /// The stage is alive, and waits for a source that brings nothing. The text says since when.
    Stalled = 4,
}

/// What a stage reports.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct ReportRecord {
    /// [`Role`] as a number.
    pub role: u32,
    /// [`Health`] as a number.
    pub health: u32,
    /// Its process id: reports of a process that was replaced are told apart.
    pub pid: u32,
    /// 1 when this reports a frame, 0 for a heartbeat.
    pub is_frame: u32,
    /// Frames finished since the stage started.
    pub frames: u64,
    /// Frames that newer ones overtook before the stage took them up.
    pub skipped: u64,
    /// Messages refused by their check.
    pub refused: u64,
    /// Processor time used so far, in nanoseconds.
    pub cpu_ns: u64,
    /// Resident memory of its own, in bytes.
    pub private_bytes: u64,
    /// Resident pages of the program file, in bytes; all stages share them.
    pub file_bytes: u64,
    /// Resident shared memory, in bytes.
    pub shared_bytes: u64,
    /// Age of the frame when the stage took it up, in nanoseconds.
    pub age_ns: u64,
    /// Time of the stage's own work on the frame, in nanoseconds.
    pub work_ns: u64,
    /// Heap allocations of the stage's own thread since its last frame.
    pub allocations: u64,
    /// Whether its frames are in time.
    pub deadline: DeadlineRecord,
    /// What it got of what real time needs.
    pub realtime: RealtimeRecord,
    /// What the stereo stage says of the calibration; zeros from the others.
    pub calibration: CalibrationRecord,
    /// The device that matches; zeros from stages that do not.
    pub device: DeviceRecord,
    /// Why, in words, padded with zeros.
    pub text: [u8; 256],
}

impl ReportRecord {
    /// An empty report of a stage.
    pub fn new(role: Role) -> Self {
        Self { role: role as u32, pid: std::process::id(), ..Self::zeroed() }
    }

    /// Sets the health and the words that go with it.
    pub fn set_health(&mut self, health: Health, text: &str) {
        self.health = health as u32;
        put_text(&mut self.text, text);
    }

    /// The words.
    pub fn text(&self) -> String {
        get_text(&self.text)
    }

    /// The role; `view` has made sure that there is one.
    pub fn role(&self) -> Option<Role> {
        u8::try_from(self.role).ok().and_then(Role::from_raw)
    }

    /// The health; `view` has made sure that it is one.
    pub fn health(&self) -> Health {
        match self.health {
            1 => Health::Ready,
            2 => Health::Finished,
            3 => Health::Unusable,
            4 => Health::Stalled,
            _ => Health::Starting,
        }
    }
}

/// Bytes of the payload.
pub const PAYLOAD_BYTES: usize = size_of::<ReportRecord>();

/// Checks a message and copies its record.
///
/// # Errors
/// When the header, the length, the role or the health is wrong.
pub fn view(header: &Header, payload: &[u8]) -> Result<ReportRecord, MessageError> {
    header.check(Kind::Report)?;
    let report: ReportRecord = record(payload)?;
    if report.role().is_none() {
        return Err(MessageError::Value { what: "role", value: report.role.into() });
    }
    if report.health > Health::Stalled as u32 {
        return Err(MessageError::Value { what: "health", value: report.health.into() });
    }
    Ok(report)
}

/// The message in types.
#[derive(Clone, Copy, Debug)]
pub struct ReportMessage;

impl Message for ReportMessage {
    const KIND: Kind = Kind::Report;
    type View<'a> = ReportRecord;

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

    #[test]
    fn reports_are_checked() {
        let header = Header::new(Kind::Report);
        let mut report = ReportRecord::new(Role::Road);
        report.set_health(Health::Unusable, "left/7.png: cannot be decoded");
        let got = view(&header, bytemuck::bytes_of(&report)).unwrap();
        assert_eq!((got.role(), got.health()), (Some(Role::Road), Health::Unusable));
        assert_eq!(got.text(), "left/7.png: cannot be decoded");
        for (role, health) in [(99, 0), (1, 5), (u32::MAX, u32::MAX)] {
            let wrong = ReportRecord { role, health, ..report };
            assert!(view(&header, bytemuck::bytes_of(&wrong)).is_err());
        }
        assert!(view(&header, &[0; 3]).is_err());
        assert!(view(&Header::new(Kind::Command), bytemuck::bytes_of(&report)).is_err());
    }
}
