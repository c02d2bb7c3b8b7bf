//! Clocks of the board: set to the configured frequencies, read back, and restored at the end.
//!
//! While the daemon controls the clocks, the original values are kept in a file beside the lock, so that
//! `lookout restore-clocks` can restore them after a daemon was killed. The file holds devices and numbers, no paths:
//! a user who can write it can change clocks of the board within their limits, but no other file. Root uses it, too,
//! so another user's file is refused ([`kept`]).

mod device;
mod hertz;
mod kept;
#[cfg(test)]
mod tests;

use super::sysfs::{Sysfs, matches};
use device::{Device, DeviceKind, TK1_CPUQUIET, TK1_GPU};
pub use hertz::{ClockError, Hertz};
pub use kept::state_file;
use kept::{Kept, Saved, keep};
use std::path::{Path, PathBuf};

/// A clock that reads less than this share of its target is too slow.
const MIN_SHARE: f64 = 0.98;

/// Number of low readings in a row that count as a fault.
const CONFIRM: u32 = 3;

/// The configured clocks.
#[derive(Clone, Debug, PartialEq)]
pub struct ClockSettings {
    /// Frequency of all cores; `None` = unchanged.
    pub cpu: Option<Hertz>,
    /// Frequency of the GPU; `None` = unchanged.
    pub gpu: Option<Hertz>,
    /// Whether the clock of the GPU is set in debugfs, as on the Jetson TK1.
    pub gpu_by_override: bool,
    /// Patterns of the GPU's name in devfreq.
    pub gpu_device: String,
    /// Whether a configured clock that the board lacks is an error; otherwise it is a fault, and the others are set.
    pub needs_all: bool,
}

/// A controlled clock.
#[derive(Clone, Debug)]
pub struct Clock {
    device: Device,
    configured: Hertz,
    /// Frequency that is set now.
    target: Hertz,
    /// Last reading; `None` if it could not be read.
    read: Option<Hertz>,
    /// Number of low readings in a row.
    low: u32,
    refused: Option<String>,
}

/// All controlled clocks. Dropping them restores the original values.
#[derive(Debug)]
pub struct Clocks {
    sysfs: Sysfs,
    file: PathBuf,
    clocks: Vec<Clock>,
    saved: Vec<Saved>,
    /// Why a configured clock is not controlled.
    lacking: Option<String>,
    share: f64,
}

impl Clocks {
    /// Finds the clocks, saves their values in `file`, and sets them. If `file` exists, a run was killed; its values are
    /// restored first.
    ///
    /// # Errors
    /// If a clock is missing that is needed, or all are, the kernel refuses, or `file` cannot be used. No clock is changed
    /// then.
    pub fn take(sysfs: &Sysfs, settings: &ClockSettings, file: &Path) -> Result<Self, ClockError> {
        if restore(sysfs, file)?.is_some() {
            tracing::warn!("clocks that a killed run had set were restored first");
        }
        let mut clocks = Vec::new();
        let mut saved = Vec::new();
        let mut missing = Vec::new();
        if let Some(wanted) = settings.cpu {
            let devices = device::cpus(sysfs);
            if devices.is_empty() {
                missing.push("cpu");
            }
            clocks.extend(devices.into_iter().map(|device| Clock::new(device, wanted)));
            // The kernel of the TK1 switches idle cores off (cpuquiet).
            let quiet = Device::new(DeviceKind::CpuQuiet, TK1_CPUQUIET);
            if quiet.is_there(sysfs) {
                saved.push(Saved { values: quiet.save(sysfs)?, device: quiet });
            }
        }
        if let Some(wanted) = settings.gpu {
            match gpu(sysfs, settings.gpu_by_override, &settings.gpu_device) {
                Some(device) => clocks.push(Clock::new(device, wanted)),
                None => missing.push("gpu"),
            }
        }
        let lacking = missing.first().map(|&what| ClockError::Missing { what, root: sysfs.path("") });
        let lacking = match lacking {
            Some(error) if settings.needs_all || clocks.is_empty() => return Err(error),
            lacking => lacking.map(|error| format!("not all clocks are set: {error}")),
        };
        for clock in &clocks {
            saved.push(Saved { values: clock.device.save(sysfs)?, device: clock.device.clone() });
        }
        keep(file, &saved)?;
        let mut all =
            Self { sysfs: sysfs.clone(), file: file.to_owned(), clocks, saved, lacking, share: 1.0 };
        for quiet in all.saved.iter().filter(|saved| saved.device.kind == DeviceKind::CpuQuiet) {
            quiet.device.restore(sysfs, &[0])?;
        }
        // If the kernel refuses, dropping `all` restores the changed values.
        all.set(1.0)?;
        all.check();
        Ok(all)
    }

    /// Sets all clocks to a share of the configured frequency, rounded down to a step of the device.
    ///
    /// # Errors
    /// The first refusal; the other clocks are set nevertheless. [`Self::fault`] reports it, too.
    pub fn set(&mut self, share: f64) -> Result<(), ClockError> {
        self.share = share;
        let mut result = Ok(());
        for clock in &mut self.clocks {
            clock.target = clock.device.step(&self.sysfs, clock.configured.times(share));
            clock.low = 0;
            let fixed = clock.device.fix(&self.sysfs, clock.target);
            clock.refused = fixed.as_ref().err().map(ToString::to_string);
            result = result.and(fixed);
        }
        result
    }

    /// Reads all clocks back; has to be called about once a second.
    pub fn check(&mut self) {
        for clock in &mut self.clocks {
            clock.read = clock.device.read(&self.sysfs).ok();
            // At the full share the reading is compared with the configured clock, which the board may not have.
            let expected = if self.share < 1.0 { clock.target } else { clock.configured };
            let is_low = clock.read.is_none_or(|read| read < expected.times(MIN_SHARE));
            clock.low = if is_low { clock.low.saturating_add(1) } else { 0 };
        }
    }

    /// Description of the first fault of a clock; `None` if there is none.
    pub fn fault(&self) -> Option<String> {
        let of_clocks = self.clocks.iter().find_map(|clock| {
            let name = &clock.device.name;
            if let Some(refused) = &clock.refused {
                return Some(format!("clock {name} cannot be set: {refused}"));
            }
            let expected = if self.share < 1.0 { clock.target } else { clock.configured };
            match clock.read {
                _ if clock.low < CONFIRM => None,
                Some(read) => Some(format!("clock {name} runs at {read}, set to {expected}")),
                None => Some(format!("clock {name} cannot be read back")),
            }
        });
        of_clocks.or_else(|| self.lacking.clone())
    }

    /// Name, target and last reading of each clock.
    pub fn readings(&self) -> impl Iterator<Item = (&str, Hertz, Option<Hertz>)> {
        self.clocks.iter().map(|clock| (clock.device.name.as_str(), clock.target, clock.read))
    }
}

impl Drop for Clocks {
    fn drop(&mut self) {
        match restore(&self.sysfs, &self.file) {
            Ok(Some(count)) => tracing::debug!(count, "clocks were restored"),
            Ok(None) => {}
            Err(error) => tracing::error!(%error, "clocks could not be restored"),
        }
    }
}

impl Clock {
    fn new(device: Device, configured: Hertz) -> Self {
        Self { device, configured, target: configured, read: None, low: 0, refused: None }
    }
}

/// The GPU of the board.
fn gpu(sysfs: &Sysfs, by_override: bool, patterns: &str) -> Option<Device> {
    if by_override {
        return Some(Device::new(DeviceKind::Override, TK1_GPU)).filter(|device| device.is_there(sysfs));
    }
    let names = sysfs.names("class/devfreq", "");
    let name = names.into_iter().find(|name| matches(patterns, name));
    name.map(|name| Device::new(DeviceKind::DevFreq, &name))
}

/// Name of the GPU of the board in the readings of its clock, and the clock's steps, ascending; `None` where there
/// is no such clock, or one without steps.
pub fn gpu_steps(board: &config::Board) -> Option<(String, Vec<Hertz>)> {
    let sysfs = Sysfs::new(&board.sysfs);
    let device = gpu(&sysfs, board.gpu == "tk1", &board.gpu_device)?;
    let steps = device.steps(&sysfs);
    (!steps.is_empty()).then_some((device.name, steps))
}

/// Restores the values in `file` and removes it. Returns the number of devices, or `None` without a file.
///
/// # Errors
/// If the file is another user's or invalid, or the kernel refuses. The file is then kept.
pub fn restore(sysfs: &Sysfs, file: &Path) -> Result<Option<usize>, ClockError> {
    let Some(kept) = Kept::open(file)? else { return Ok(None) };
    let saved = kept.read()?;
    if let Some(wrong) = saved.iter().find(|saved| !saved.device.is_sound(&saved.values)) {
        return Err(kept.invalid(format!("invalid name or values of device \"{}\"", wrong.device.name)));
    }
    // In reverse order; all of them, even if one is refused.
    let results: Vec<_> = saved.iter().rev().map(|s| s.device.restore(sysfs, &s.values)).collect();
    results.into_iter().collect::<Result<(), _>>()?;
    kept.remove()?;
    Ok(Some(saved.len()))
}
