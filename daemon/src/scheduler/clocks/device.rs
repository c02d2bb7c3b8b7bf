//! A device with a clock, and its files in sysfs.

use super::hertz::{ClockError, Hertz};
use crate::scheduler::sysfs::Sysfs;
use serde::{Deserialize, Serialize};

/// Name of the GPU's clock in debugfs of the Jetson TK1.
pub const TK1_GPU: &str = "gbus";

/// Name of the TK1's switch for idle cores.
pub const TK1_CPUQUIET: &str = "tegra_cpuquiet";

/// Interface of the kernel to a clock.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum DeviceKind {
    /// Cores that share a clock: cpufreq, in kHz.
    CpuFreq,
    /// Any other device: devfreq, in Hz.
    DevFreq,
    /// A clock of the Jetson TK1 (Linux for Tegra R21): an override in debugfs, in Hz.
    Override,
    /// Not a clock: the switch of the TK1's kernel that switches idle cores off.
    CpuQuiet,
}

/// A device.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Device {
    /// Its interface.
    pub kind: DeviceKind,
    /// Its name in that interface.
    pub name: String,
}

/// All groups of cores that share a clock.
pub fn cpus(sysfs: &Sysfs) -> Vec<Device> {
    let devices = |names: Vec<String>| -> Vec<Device> {
        let devices = names.iter().map(|name| Device::new(DeviceKind::CpuFreq, name));
        devices.filter(|device| device.is_there(sysfs)).collect()
    };
    let policies = devices(sysfs.names("devices/system/cpu/cpufreq", "policy"));
    if !policies.is_empty() {
        return policies;
    }
    // Kernels before 4.3 have one entry per core; cores that share a clock have equal values.
    devices(sysfs.names("devices/system/cpu", "cpu"))
}

impl Device {
    /// A device of a kind.
    pub fn new(kind: DeviceKind, name: &str) -> Self {
        Self { kind, name: name.to_owned() }
    }

    fn file(&self, file: &str) -> String {
        let name = &self.name;
        match self.kind {
            DeviceKind::CpuFreq if name.starts_with("policy") => {
                format!("devices/system/cpu/cpufreq/{name}/{file}")
            }
            DeviceKind::CpuFreq => format!("devices/system/cpu/{name}/cpufreq/{file}"),
            DeviceKind::DevFreq => format!("class/devfreq/{name}/{file}"),
            DeviceKind::Override => format!("kernel/debug/clock/override.{name}/{file}"),
            DeviceKind::CpuQuiet => format!("devices/system/cpu/cpuquiet/{name}/{file}"),
        }
    }

    /// Unit of its files in Hz.
    fn unit(&self) -> u64 {
        if self.kind == DeviceKind::CpuFreq { 1000 } else { 1 }
    }

    /// The files that setting the clock changes.
    fn changed(&self) -> &'static [&'static str] {
        match self.kind {
            DeviceKind::CpuFreq => &["scaling_min_freq", "scaling_max_freq"],
            DeviceKind::DevFreq => &["min_freq", "max_freq"],
            DeviceKind::Override => &["rate", "state"],
            DeviceKind::CpuQuiet => &["enable"],
        }
    }

    /// Whether the board has it.
    pub fn is_there(&self, sysfs: &Sysfs) -> bool {
        self.changed().iter().all(|file| sysfs.has(&self.file(file)))
    }

    /// Whether name and values, which come from a file, can be those of a device that the daemon controls: the files
    /// that it then writes are those of [`Self::changed`] for such a device, whether the board has it or not.
    pub fn is_sound(&self, values: &[u64]) -> bool {
        let name = self.name.as_str();
        let is_numbered = |prefix| {
            let number: Option<&str> = name.strip_prefix(prefix);
            number.is_some_and(|n| !n.is_empty() && n.bytes().all(|b| b.is_ascii_digit()))
        };
        let is_entry = |b: u8| b.is_ascii_alphanumeric() || matches!(b, b'.' | b'_' | b'-' | b':');
        let is_known = match self.kind {
            DeviceKind::CpuFreq => is_numbered("policy") || is_numbered("cpu"),
            DeviceKind::DevFreq => !name.is_empty() && !name.starts_with('.') && name.bytes().all(is_entry),
            DeviceKind::Override => self.name == TK1_GPU,
            DeviceKind::CpuQuiet => self.name == TK1_CPUQUIET,
        };
        let are_possible = match (self.kind, values) {
            // Old kernels use 0 for "no maximum".
            (DeviceKind::CpuFreq | DeviceKind::DevFreq, &[min, max]) => min <= max || max == 0,
            (DeviceKind::Override, &[_, switch]) | (DeviceKind::CpuQuiet, &[switch]) => switch <= 1,
            _ => false,
        };
        is_known && are_possible
    }

    /// Lowest and highest frequency of the device, in the unit of its files; `None` if the board does not tell them.
    fn limits(&self, sysfs: &Sysfs) -> Option<(u64, u64)> {
        let limit = |file| sysfs.number(&self.file(file)).ok();
        if let (DeviceKind::CpuFreq, Some(low), Some(high)) =
            (self.kind, limit("cpuinfo_min_freq"), limit("cpuinfo_max_freq"))
        {
            return Some((low, high));
        }
        let steps = self.steps(sysfs);
        Some((steps.first()?.0 / self.unit(), steps.last()?.0 / self.unit()))
    }

    /// A frequency, in the unit of the device's files, within its limits; 0 stays, it means "no limit".
    fn within_limits(&self, sysfs: &Sysfs, value: u64) -> u64 {
        match self.limits(sysfs) {
            Some((low, high)) if value > 0 && low <= high => value.clamp(low, high),
            _ => value,
        }
    }

    /// The values of the files that setting the clock changes.
    ///
    /// # Errors
    /// If one cannot be read.
    pub fn save(&self, sysfs: &Sysfs) -> Result<Vec<u64>, ClockError> {
        let read = |file: &&str| {
            let file = self.file(file);
            sysfs.number(&file).map_err(|source| ClockError::Refused { path: sysfs.path(&file), source })
        };
        self.changed().iter().map(read).collect()
    }

    fn write(&self, sysfs: &Sysfs, file: &str, value: u64) -> Result<(), ClockError> {
        let file = self.file(file);
        sysfs.write(&file, value).map_err(|source| ClockError::Refused { path: sysfs.path(&file), source })
    }

    /// Restores saved values, frequencies within the limits of the device.
    ///
    /// # Errors
    /// When the kernel refuses.
    pub fn restore(&self, sysfs: &Sysfs, values: &[u64]) -> Result<(), ClockError> {
        let within = |value| self.within_limits(sysfs, value);
        match (self.kind, values) {
            (DeviceKind::CpuFreq | DeviceKind::DevFreq, &[min, max]) => {
                self.set_range(sysfs, within(min), within(max))
            }
            (DeviceKind::Override, &[rate, state]) => {
                self.write(sysfs, "rate", within(rate))?;
                self.write(sysfs, "state", state)
            }
            _ => self.changed().iter().zip(values).try_for_each(|(file, &v)| self.write(sysfs, file, v)),
        }
    }

    /// Sets minimum and maximum in an order in which the minimum never exceeds the maximum, which the kernel would
    /// refuse.
    fn set_range(&self, sysfs: &Sysfs, min: u64, max: u64) -> Result<(), ClockError> {
        let [min_file, max_file] = [self.changed()[0], self.changed()[1]];
        let now = sysfs.number(&self.file(max_file)).unwrap_or(0);
        if min > now {
            self.write(sysfs, max_file, max)?;
            self.write(sysfs, min_file, min)
        } else {
            self.write(sysfs, min_file, min)?;
            self.write(sysfs, max_file, max)
        }
    }

    /// Fixes the clock at a frequency.
    ///
    /// # Errors
    /// When the kernel refuses.
    pub fn fix(&self, sysfs: &Sysfs, clock: Hertz) -> Result<(), ClockError> {
        let value = clock.0 / self.unit();
        match self.kind {
            DeviceKind::CpuFreq | DeviceKind::DevFreq => self.set_range(sysfs, value, value),
            DeviceKind::Override => {
                self.write(sysfs, "rate", value)?;
                self.write(sysfs, "state", 1)
            }
            DeviceKind::CpuQuiet => Ok(()),
        }
    }

    /// The current frequency.
    ///
    /// # Errors
    /// If it cannot be read.
    pub fn read(&self, sysfs: &Sysfs) -> std::io::Result<Hertz> {
        let file = match self.kind {
            DeviceKind::CpuFreq => self.file("scaling_cur_freq"),
            DeviceKind::Override => format!("kernel/debug/clock/{}/rate", self.name),
            _ => self.file("cur_freq"),
        };
        Ok(Hertz(sysfs.number(&file)?.saturating_mul(self.unit())))
    }

    /// The frequencies that the device supports, ascending; empty if it has no list.
    pub fn steps(&self, sysfs: &Sysfs) -> Vec<Hertz> {
        let (steps, unit) = match self.kind {
            DeviceKind::CpuFreq => (sysfs.numbers(&self.file("scaling_available_frequencies")), 1000),
            DeviceKind::Override => {
                (sysfs.numbers(&format!("kernel/debug/clock/{}/possible_rates", self.name)), 1000)
            }
            _ => (sysfs.numbers(&self.file("available_frequencies")), 1),
        };
        steps.into_iter().map(|step| Hertz(step.saturating_mul(unit))).collect()
    }

    /// The fastest step of the device that is at most 1 % above `wanted` (a configured 1900 MHz means a step of
    /// 1900.8 MHz), or its slowest step. Without a list of steps, `wanted` within the limits of the device.
    pub fn step(&self, sysfs: &Sysfs, wanted: Hertz) -> Hertz {
        let steps = self.steps(sysfs);
        let max = wanted.times(1.01);
        if let Some(first) = steps.first() {
            return *steps.iter().rev().find(|step| **step <= max).unwrap_or(first);
        }
        let limit = |file| sysfs.number(&self.file(file)).ok().map(|v| Hertz(v * self.unit()));
        let (low, high) = (limit("cpuinfo_min_freq"), limit("cpuinfo_max_freq"));
        wanted.min(high.unwrap_or(wanted)).max(low.unwrap_or(Hertz(0)))
    }
}
