//! The device that the stereo stage matches on: part of `report` and `status`.

use crate::header::{get_text, put_text};
use bytemuck::{Pod, Zeroable};

/// The most stages that are timed.
pub const MAX_STAGES: usize = 8;

/// What the stereo stage says of its device.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct DeviceRecord {
    /// 0: it matches on the CPU, as it was asked to. 1: on the device. 2: the device is lost, and the CPU
    /// matches.
    pub state: u32,
    /// Entries of `stages_ms` that count; 0 where the device has no timestamps.
    pub stages: u32,
    /// Time of each stage of the last frame on the device, in milliseconds.
    pub stages_ms: [f32; MAX_STAGES],
    /// Name of the adapter.
    pub adapter: [u8; 64],
    /// Its driver and the driver's version.
    pub driver: [u8; 64],
    /// Why it is lost, in words.
    pub loss: [u8; 64],
}

impl Default for DeviceRecord {
    fn default() -> Self {
        Self::zeroed()
    }
}

impl DeviceRecord {
    /// A record of a device that is used, or lost for a reason.
    pub fn new(adapter: &str, driver: &str, loss: Option<&str>) -> Self {
        let mut record = Self { state: if loss.is_some() { 2 } else { 1 }, ..Self::zeroed() };
        put_text(&mut record.adapter, adapter);
        put_text(&mut record.driver, driver);
        put_text(&mut record.loss, loss.unwrap_or(""));
        record
    }

    /// Sets the times of the stages, in nanoseconds.
    pub fn set_times_ns(&mut self, times: impl Iterator<Item = u64>) {
        self.stages = 0;
        for (to, ns) in self.stages_ms.iter_mut().zip(times) {
            *to = ns as f32 * 1e-6;
            self.stages += 1;
        }
    }

    /// The times of the stages in milliseconds; empty where there are none.
    pub fn times_ms(&self) -> &[f32] {
        &self.stages_ms[..(self.stages as usize).min(MAX_STAGES)]
    }

    /// Whether it was lost.
    pub fn is_lost(&self) -> bool {
        self.state == 2
    }

    /// Name of the adapter.
    pub fn adapter(&self) -> String {
        get_text(&self.adapter)
    }

    /// Its driver.
    pub fn driver(&self) -> String {
        get_text(&self.driver)
    }

    /// The device and how it is, in words; empty on the CPU.
    pub fn words(&self) -> String {
        let device = format!("{} ({})", self.adapter(), self.driver());
        match self.state {
            0 => String::new(),
            2 => format!("{device} is lost: {}: the CPU matches", get_text(&self.loss)),
            _ => device,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_is_told_in_words() {
        assert_eq!(DeviceRecord::default().words(), "");
        let mut used = DeviceRecord::new("Orin", "NVIDIA 540", None);
        used.set_times_ns([1_500_000, 250_000].into_iter());
        assert_eq!((used.words(), used.times_ms()), ("Orin (NVIDIA 540)".into(), &[1.5, 0.25][..]));
        used.set_times_ns([7; 20].into_iter());
        assert_eq!(used.times_ms().len(), MAX_STAGES);
        used.stages = u32::MAX;
        assert_eq!(used.times_ms().len(), MAX_STAGES, "whatever a message holds");
        let lost = DeviceRecord::new("Orin", "NVIDIA 540", Some("it hangs"));
        assert!(lost.is_lost() && !used.is_lost());
        assert_eq!(lost.words(), "Orin (NVIDIA 540) is lost: it hangs: the CPU matches");
    }
}
