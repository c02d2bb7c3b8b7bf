//! `report`: every stage → scheduler. One record per frame, and a heartbeat while the stage is idle.

use crate::calibration::CalibrationRecord;
use crate::deadline::DeadlineRecord;
use crate::device::DeviceRecord;
use crate::header::{Header, Kind, MessageError, get_text, put_text, record};
use crate::realtime::RealtimeRecord;
use crate::pipeline::Role;
use crate::source_time::SourceTimeRecord;
use crate::range::{AnyBytes, CLOCK_NS, COUNT, FLAG, MAX_CPU_NS, MAX_PID, Nested, ranges, within};
use crate::typed::Message;
use bytemuck::{Pod, Zeroable};

/// Health of a stage.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u32)]
pub enum Health {
    /// Starting, not yet able to process frames.
    Starting = 0,
    /// Able to process frames.
    Ready = 1,
    /// The source has no more pairs.
    Finished = 2,
    /// The input cannot be used, and a restart would not help. The text gives the reason.
    Unusable = 3,
    /// The stage is alive, and its source gives no pairs. The text says since when.
    Stalled = 4,
    /// The source left the pair of this sequence out, because a picture of it cannot be read. The text says which.
    Unreadable = 5,
}

/// Report of a stage.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct ReportRecord {
    /// [`Role`] as a number.
    pub role: u32,
    /// [`Health`] as a number.
    pub health: u32,
    /// Its process id, which identifies reports of a process that was replaced.
    pub pid: u32,
    /// 1 if the report is about a frame, 0 for a heartbeat.
    pub is_frame: u32,
    /// Number of frames finished since the stage started.
    pub frames: u64,
    /// Number of frames that newer ones overtook before the stage took them.
    pub skipped: u64,
    /// Number of messages that failed their check.
    pub refused: u64,
    /// Processor time used since the process started, in ns.
    pub cpu_ns: u64,
    /// Private resident memory, in bytes.
    pub private_bytes: u64,
    /// Resident pages of the program file, in bytes; all stages share them.
    pub file_bytes: u64,
    /// Resident shared memory, in bytes.
    pub shared_bytes: u64,
    /// Age of the last frame when the stage took it, in ns since its capture; 0 from capture.
    pub age_ns: u64,
    /// Time that the stage spent on the last frame, in ns.
    pub work_ns: u64,
    /// Number of heap allocations of the stage's thread since the previous frame.
    pub allocations: u64,
    /// Age of the last frame at its end, and the number of late frames.
    pub deadline: DeadlineRecord,
    /// Real-time privileges of the process.
    pub realtime: RealtimeRecord,
    /// Epipolar alignment, from the stereo stage; all zeros from the others.
    pub calibration: CalibrationRecord,
    /// Device that the stereo stage matches on; all zeros from the others.
    pub device: DeviceRecord,
    /// What was wrong with the time of the source, from the recognition stage; all zeros from the others.
    pub source_time: SourceTimeRecord,
    /// Reason for the health, padded with zeros; may be empty.
    pub text: [u8; 256],
}

ranges! {
    ReportRecord as "report" {
        role: within(0, Role::COUNT as u32 - 1),
        health: within(0, Health::Unreadable as u32),
        pid: within(0, MAX_PID),
        is_frame: FLAG,
        frames: COUNT,
        skipped: COUNT,
        refused: COUNT,
        cpu_ns: within(0, MAX_CPU_NS),
        private_bytes: COUNT,
        file_bytes: COUNT,
        shared_bytes: COUNT,
        age_ns: CLOCK_NS,
        work_ns: CLOCK_NS,
        allocations: COUNT,
        deadline: Nested,
        realtime: Nested,
        calibration: Nested,
        device: Nested,
        source_time: Nested,
        text: AnyBytes,
    }
}

impl ReportRecord {
    /// A report of this process with all counts zero.
    pub fn new(role: Role) -> Self {
        Self { role: role as u32, pid: std::process::id(), ..Self::zeroed() }
    }

    /// Sets the health and its reason, truncated to its field.
    pub fn set_health(&mut self, health: Health, text: &str) {
        self.health = health as u32;
        put_text(&mut self.text, text);
    }

    /// Reason for the health.
    pub fn text(&self) -> String {
        get_text(&self.text)
    }

    /// The role; [`view`] refuses a report without a known role.
    pub fn role(&self) -> Option<Role> {
        u8::try_from(self.role).ok().and_then(Role::from_raw)
    }

    /// The health; [`view`] refuses unknown values.
    pub fn health(&self) -> Health {
        match self.health {
            1 => Health::Ready,
            2 => Health::Finished,
            3 => Health::Unusable,
            4 => Health::Stalled,
            5 => Health::Unreadable,
            _ => Health::Starting,
        }
    }
}

/// Length of the payload in bytes.
pub const PAYLOAD_BYTES: usize = size_of::<ReportRecord>();

/// Checks a message and copies its record.
///
/// # Errors
/// If the header, the length or any field is invalid.
pub fn view(header: &Header, payload: &[u8]) -> Result<ReportRecord, MessageError> {
    header.check(Kind::Report)?;
    record(payload)
}

/// The typed message.
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
    use crate::range::Ranged;

    #[test]
    fn reports_are_checked() {
        let header = Header::new(Kind::Report);
        let mut report = ReportRecord::new(Role::Road);
        report.set_health(Health::Unusable, "left/7.png: cannot be decoded");
        let got = view(&header, bytemuck::bytes_of(&report)).unwrap();
        assert_eq!((got.role(), got.health()), (Some(Role::Road), Health::Unusable));
        assert_eq!(got.text(), "left/7.png: cannot be decoded");
        for (role, health) in [(99, 0), (1, 6), (u32::MAX, u32::MAX)] {
            let wrong = ReportRecord { role, health, ..report };
            assert!(view(&header, bytemuck::bytes_of(&wrong)).is_err());
        }
        for (field, wrong) in report.invalid() {
            assert!(view(&header, bytemuck::bytes_of(&wrong)).is_err(), "{field}: {wrong:?}");
        }
        assert!(view(&header, &[0; 3]).is_err());
        assert!(view(&Header::new(Kind::Command), bytemuck::bytes_of(&report)).is_err());
    }
}
