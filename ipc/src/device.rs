//! The GPU that the stereo stage matches on: part of `report` and `status`.

use crate::header::{get_text, put_text};
use crate::range::{AnyBytes, Each, MS, ranges, within};
use bytemuck::{Pod, Zeroable};

/// Maximum number of timed steps of the matcher.
pub const MAX_STAGES: usize = 8;

/// Device of the stereo stage. All zeros if it matches on the CPU.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct DeviceRecord {
    /// 0 = it matches on the CPU, as configured; 1 = on the device; 2 = the device is lost, and the CPU matches.
    pub state: u32,
    /// Number of valid entries of `stages_ms`; 0 if the device has no timestamps.
    pub stages: u32,
    /// Time of each step of the matcher for the last frame on the device, in milliseconds.
    pub stages_ms: [f32; MAX_STAGES],
    /// Name of the adapter, padded with zeros.
    pub adapter: [u8; 64],
    /// Name and version of the driver, padded with zeros.
    pub driver: [u8; 64],
    /// Reason for the loss of the device, padded with zeros; empty unless it is lost.
    pub loss: [u8; 64],
}

ranges! {
    DeviceRecord as "device" {
        state: within(0, 2),
        stages: within(0, MAX_STAGES as u32),
        stages_ms: Each(MS),
        adapter: AnyBytes,
        driver: AnyBytes,
        loss: AnyBytes,
    }
}

impl Default for DeviceRecord {
    fn default() -> Self {
        Self::zeroed()
    }
}

impl DeviceRecord {
    /// A record of a device that is in use, or was lost for the reason `loss`.
    pub fn new(adapter: &str, driver: &str, loss: Option<&str>) -> Self {
        let mut record = Self { state: if loss.is_some() { 2 } else { 1 }, ..Self::zeroed() };
        put_text(&mut record.adapter, adapter);
        put_text(&mut record.driver, driver);
        put_text(&mut record.loss, loss.unwrap_or(""));
        record
    }

    /// Sets the times of the steps, in nanoseconds; those after [`MAX_STAGES`] are ignored.
    pub fn set_times_ns(&mut self, times: impl Iterator<Item = u64>) {
        self.stages = 0;
        for (to, ns) in self.stages_ms.iter_mut().zip(times) {
            *to = ns as f32 * 1e-6;
            self.stages += 1;
        }
    }

    /// Times of the steps in milliseconds; empty if the device has no timestamps.
    pub fn times_ms(&self) -> &[f32] {
        &self.stages_ms[..(self.stages as usize).min(MAX_STAGES)]
    }

    /// Whether the device was lost.
    pub fn is_lost(&self) -> bool {
        self.state == 2
    }

    /// Name of the adapter.
    pub fn adapter(&self) -> String {
        get_text(&self.adapter)
    }

    /// Name and version of the driver.
    pub fn driver(&self) -> String {
        get_text(&self.driver)
    }

    /// Description of the device and its state; empty for the CPU.
    pub fn describe(&self) -> String {
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
    fn the_description_names_device_and_loss() {
        assert_eq!(DeviceRecord::default().describe(), "");
        let mut used = DeviceRecord::new("Orin", "NVIDIA 540", None);
        used.set_times_ns([1_500_000, 250_000].into_iter());
        assert_eq!((used.describe(), used.times_ms()), ("Orin (NVIDIA 540)".into(), &[1.5, 0.25][..]));
        used.set_times_ns([7; 20].into_iter());
        assert_eq!(used.times_ms().len(), MAX_STAGES);
        used.stages = u32::MAX;
        assert_eq!(used.times_ms().len(), MAX_STAGES, "an invalid count is limited");
        let lost = DeviceRecord::new("Orin", "NVIDIA 540", Some("it hangs"));
        assert!(lost.is_lost() && !used.is_lost());
        assert_eq!(lost.describe(), "Orin (NVIDIA 540) is lost: it hangs: the CPU matches");
    }
}
