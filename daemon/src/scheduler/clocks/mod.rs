//! Clocks of the board: set to what is configured, read back, and put back as they were.
//!
//! What was there before is kept in a file beside the lock while the clocks are ours, so that
//! `lookout restore-clocks` can put it back after a daemon that was killed. The file names devices and
//! numbers, no paths: whoever may write it can move clocks, but nothing else.

mod device;
mod hertz;
#[cfg(test)]
mod tests;

use super::sysfs::{Sysfs, matches};
use device::{Device, DeviceKind};
pub use hertz::{ClockError, Hertz};
use serde::{Deserialize, Serialize};
use std::io;
use std::path::{Path, PathBuf};

/// A clock that reads less than this share of what it was set to runs too slowly.
const MIN_SHARE: f64 = 0.98;

/// Low readings in a row that are no coincidence.
const CONFIRM: u32 = 3;

/// Which clocks, and how fast.
#[derive(Clone, Debug, PartialEq)]
pub struct ClockWishes {
    /// All cores; `None` leaves them alone.
    pub cpu: Option<Hertz>,
    /// The GPU; `None` leaves it alone.
    pub gpu: Option<Hertz>,
    /// Whether the GPU's clock is set the TK1's way, in debugfs.
    pub gpu_by_override: bool,
    /// Patterns for the GPU's name in devfreq.
    pub gpu_device: String,
}

/// Values of a device before they were changed.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
struct Saved {
    #[serde(flatten)]
    device: Device,
    values: Vec<u64>,
}

/// A clock that is ours.
#[derive(Clone, Debug)]
pub struct Clock {
    device: Device,
    configured: Hertz,
    /// What it is set to now.
    target: Hertz,
    /// What was read back last.
    read: Option<Hertz>,
    low: u32,
    refused: Option<String>,
}

/// All clocks that are ours; dropping them puts back what was there.
#[derive(Debug)]
pub struct Clocks {
    sysfs: Sysfs,
    file: PathBuf,
    clocks: Vec<Clock>,
    saved: Vec<Saved>,
    share: f64,
}

impl Clocks {
    /// Finds the clocks, keeps their values in `file`, and sets them. A file that is there already is
    /// of a run that was killed: what it says is put back first.
    ///
    /// # Errors
    /// When a clock is missing, the kernel refuses, or `file` cannot be used; then nothing is
    /// changed.
    pub fn take(sysfs: &Sysfs, wishes: &ClockWishes, file: &Path) -> Result<Self, ClockError> {
        if restore(sysfs, file)?.is_some() {
            tracing::warn!("clocks that a killed run had set were put back first");
        }
        let mut clocks = Vec::new();
        let mut saved = Vec::new();
        let missing = |what| ClockError::Missing { what, root: sysfs.path("") };
        if let Some(wanted) = wishes.cpu {
            let devices = device::cpus(sysfs);
            if devices.is_empty() {
                return Err(missing("cpu"));
            }
            clocks.extend(devices.into_iter().map(|device| Clock::new(device, wanted)));
            // The TK1's kernel takes cores away when it sees no need for them.
            let quiet = Device::new(DeviceKind::CpuQuiet, "tegra_cpuquiet");
            if quiet.is_there(sysfs) {
                saved.push(Saved { values: quiet.save(sysfs)?, device: quiet });
            }
        }
        if let Some(wanted) = wishes.gpu {
            let device = gpu(sysfs, wishes.gpu_by_override, &wishes.gpu_device);
            clocks.push(Clock::new(device.ok_or_else(|| missing("gpu"))?, wanted));
        }
        for clock in &clocks {
            saved.push(Saved { values: clock.device.save(sysfs)?, device: clock.device.clone() });
        }
        keep(file, &saved)?;
        let mut all = Self { sysfs: sysfs.clone(), file: file.to_owned(), clocks, saved, share: 1.0 };
        for quiet in all.saved.iter().filter(|saved| saved.device.kind == DeviceKind::CpuQuiet) {
            quiet.device.restore(sysfs, &[0])?;
        }
        // After a refusal, what was changed is put back by the drop.
        all.set(1.0)?;
        all.check();
        Ok(all)
    }

    /// Sets all clocks to a share of what is configured, or the next step below that they have.
    ///
    /// # Errors
    /// The first refusal; the other clocks are set all the same, and [`Self::fault`] tells, too.
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

    /// Reads all clocks back; to be called about once a second.
    pub fn check(&mut self) {
        for clock in &mut self.clocks {
            clock.read = clock.device.read(&self.sysfs).ok();
            // At the full share, the configured clock counts: the board may not have it.
            let expected = if self.share < 1.0 { clock.target } else { clock.configured };
            let is_low = clock.read.is_none_or(|read| read < expected.times(MIN_SHARE));
            clock.low = if is_low { clock.low.saturating_add(1) } else { 0 };
        }
    }

    /// What is wrong with the clocks, in words.
    pub fn fault(&self) -> Option<String> {
        self.clocks.iter().find_map(|clock| {
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
        })
    }

    /// Name, target and last reading of each.
    pub fn readings(&self) -> impl Iterator<Item = (&str, Hertz, Option<Hertz>)> {
        self.clocks.iter().map(|clock| (clock.device.name.as_str(), clock.target, clock.read))
    }
}

impl Drop for Clocks {
    fn drop(&mut self) {
        match restore(&self.sysfs, &self.file) {
            Ok(Some(count)) => tracing::debug!(count, "clocks were put back"),
            Ok(None) => {}
            Err(error) => tracing::error!(%error, "clocks could not be put back"),
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
        return Some(Device::new(DeviceKind::Override, "gbus")).filter(|device| device.is_there(sysfs));
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

/// Where an instance keeps the clocks as they were.
pub fn state_file(directory: &Path) -> PathBuf {
    directory.join("clocks.json")
}

/// Writes what was there, whole or not at all.
fn keep(file: &Path, saved: &[Saved]) -> Result<(), ClockError> {
    let state = |reason: String| ClockError::State { path: file.to_owned(), reason };
    let text = serde_json::to_vec(saved).map_err(|error| state(error.to_string()))?;
    let new = file.with_extension("new");
    std::fs::write(&new, text).and_then(|()| std::fs::rename(&new, file)).map_err(|e| state(e.to_string()))
}

/// Puts back what `file` holds and removes it. Gives how many devices, or `None` without a file.
///
/// # Errors
/// When the file is not sound, or the kernel refuses: the file then stays.
pub fn restore(sysfs: &Sysfs, file: &Path) -> Result<Option<usize>, ClockError> {
    let state = |reason: String| ClockError::State { path: file.to_owned(), reason };
    let text = match std::fs::read(file) {
        Ok(text) => text,
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(None),
        Err(error) => return Err(state(error.to_string())),
    };
    let saved: Vec<Saved> = serde_json::from_slice(&text).map_err(|error| state(error.to_string()))?;
    if let Some(wrong) = saved.iter().find(|saved| !saved.device.is_sound(&saved.values)) {
        return Err(state(format!("\"{}\" is no device that was changed", wrong.device.name)));
    }
    // The last first; all of them, even when one is refused.
    let results: Vec<_> = saved.iter().rev().map(|s| s.device.restore(sysfs, &s.values)).collect();
    results.into_iter().collect::<Result<(), _>>()?;
    std::fs::remove_file(file).map_err(|error| state(error.to_string()))?;
    Ok(Some(saved.len()))
}
