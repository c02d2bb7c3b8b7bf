//! One device with a clock, and the files through which the kernel shows it.

use super::hertz::{ClockError, Hertz};
use crate::scheduler::sysfs::Sysfs;
use serde::{Deserialize, Serialize};

/// How the kernel shows a clock.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum DeviceKind {
    /// Cores that share a clock: cpufreq, in kHz.
    CpuFreq,
    /// Any other device: devfreq, in Hz.
    DevFreq,
    /// A clock of the Jetson TK1 (Linux for Tegra R21): an override in debugfs, in Hz.
    Override,
    /// Not a clock: what lets the TK1's kernel take cores away.
    CpuQuiet,
}

/// A device.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Device {
    /// How it is shown.
    pub kind: DeviceKind,
    /// Its name there.
    pub name: String,
}

/// All groups of cores with a clock of their own.
pub fn cpus(sysfs: &Sysfs) -> Vec<Device> {
    let devices = |names: Vec<String>| -> Vec<Device> {
        let devices = names.iter().map(|name| Device::new(DeviceKind::CpuFreq, name));
        devices.filter(|device| device.is_there(sysfs)).collect()
    };
    let policies = devices(sysfs.names("devices/system/cpu/cpufreq", "policy"));
    if !policies.is_empty() {
        return policies;
    }
    // Kernels before 4.3; there the cores of one clock show the same.
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

    /// Hertz in one unit of its files.
    fn unit(&self) -> u64 {
        if self.kind == DeviceKind::CpuFreq { 1000 } else { 1 }
    }

    /// The files that are changed.
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

    /// Whether name and values can be those of such a device: they come from a file.
    pub fn is_sound(&self, values: &[u64]) -> bool {
        let is_name = |b: u8| b.is_ascii_alphanumeric() || matches!(b, b'.' | b'_' | b'-' | b':');
        let name = self.name.as_bytes();
        !name.is_empty()
            && name[0] != b'.'
            && name.iter().all(|&b| is_name(b))
            && values.len() == self.changed().len()
    }

    /// The values of the files that are changed.
    ///
    /// # Errors
    /// When one cannot be read.
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

    /// Puts saved values back.
    ///
    /// # Errors
    /// When the kernel refuses.
    pub fn restore(&self, sysfs: &Sysfs, values: &[u64]) -> Result<(), ClockError> {
        match (self.kind, values) {
            (DeviceKind::CpuFreq | DeviceKind::DevFreq, &[min, max]) => self.set_range(sysfs, min, max),
            _ => self.changed().iter().zip(values).try_for_each(|(file, &v)| self.write(sysfs, file, v)),
        }
    }

    /// Sets the least and the greatest clock in the order in which neither is ever above the other:
    /// the kernel would refuse.
    fn set_range(&self, sysfs: &Sysfs, min: u64, max: u64) -> Result<(), ClockError> {
        let [least, greatest] = [self.changed()[0], self.changed()[1]];
        let now = sysfs.number(&self.file(greatest)).unwrap_or(0);
        if min > now {
            self.write(sysfs, greatest, max)?;
            self.write(sysfs, least, min)
        } else {
            self.write(sysfs, least, min)?;
            self.write(sysfs, greatest, max)
        }
    }

    /// Fixes the clock.
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

    /// What the clock is.
    ///
    /// # Errors
    /// When it cannot be read.
    pub fn read(&self, sysfs: &Sysfs) -> std::io::Result<Hertz> {
        let file = match self.kind {
            DeviceKind::CpuFreq => self.file("scaling_cur_freq"),
            DeviceKind::Override => format!("kernel/debug/clock/{}/rate", self.name),
            _ => self.file("cur_freq"),
        };
        Ok(Hertz(sysfs.number(&file)?.saturating_mul(self.unit())))
    }

    /// The steps that the device tells, ascending.
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

    /// The fastest step of the device that is not above `wanted`, but for a hundredth (a configured
    /// 1900 MHz means a step of 1900.8); its slowest when all are.
    pub fn step(&self, sysfs: &Sysfs, wanted: Hertz) -> Hertz {
        let steps = self.steps(sysfs);
        let most = wanted.times(1.01);
        if let Some(first) = steps.first() {
            return *steps.iter().rev().find(|step| **step <= most).unwrap_or(first);
        }
        let limit = |file| sysfs.number(&self.file(file)).ok().map(|v| Hertz(v * self.unit()));
        let (low, high) = (limit("cpuinfo_min_freq"), limit("cpuinfo_max_freq"));
        wanted.min(high.unwrap_or(wanted)).max(low.unwrap_or(Hertz(0)))
    }
}
