//! Temperatures, thermal ladder and clocks of the board: part of `status`.

use crate::header::{get_text, put_text};
use crate::range::{AnyBytes, Each, FLAG, Nested, ranges, within};
use bytemuck::{Pod, Zeroable};

/// Maximum number of thermal zones in a status.
pub const MAX_ZONES: usize = 8;

/// Maximum number of clocks in a status.
pub const MAX_CLOCKS: usize = 8;

/// Names of the rungs of the thermal ladder, indexed by their numbers.
pub const RUNGS: [&str; 6] =
    ["normal", "lower frame rate", "lower clocks", "recognition off", "stopped", "power off"];

/// One thermal zone.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct ZoneRecord {
    /// The kernel's name of its type, padded with zeros.
    pub name: [u8; 24],
    /// Filtered temperature in °C, or its projection.
    pub celsius: f32,
    /// 1 if the sensor cannot be read and the temperature is projected from its last value; else 0.
    pub projected: u32,
}

/// Range of temperatures in °C: absolute zero, and far above any chip that still reports.
const MIN_CELSIUS: f32 = -273.15;
const MAX_CELSIUS: f32 = 1000.0;

/// Maximum frequency of a clock, in MHz: 1 THz.
const MAX_MHZ: f32 = 1e6;

ranges! {
    ZoneRecord as "heat: zone" {
        name: AnyBytes,
        celsius: within(MIN_CELSIUS, MAX_CELSIUS),
        projected: FLAG,
    }
}

/// One clock.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct ClockRecord {
    /// Name of its device, padded with zeros.
    pub name: [u8; 24],
    /// Frequency that was set, in MHz.
    pub wanted_mhz: f32,
    /// Frequency at the last reading, in MHz; 0 if it cannot be read.
    pub read_mhz: f32,
}

ranges! {
    ClockRecord as "heat: clock" {
        name: AnyBytes,
        wanted_mhz: within(0.0, MAX_MHZ),
        read_mhz: within(0.0, MAX_MHZ),
    }
}

/// Thermal state and clocks of the board.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct HeatRecord {
    /// 1 if temperatures are monitored, else 0.
    pub watched: u32,
    /// Rung of the thermal ladder: an index into [`RUNGS`].
    pub rung: u32,
    /// Number of valid entries of `zone`, 0 to [`MAX_ZONES`].
    pub zones: u32,
    /// Number of valid entries of `clock`, 0 to [`MAX_CLOCKS`].
    pub clocks: u32,
    /// Share of the frame rate that the rung allows, 0 to 1; 0 = no frames.
    pub frame_rate_share: f32,
    /// Share of the configured clocks that the rung allows, above 0 to 1.
    pub clocks_share: f32,
    /// Reason for the last change of the rung, padded with zeros; empty before the first.
    pub reason: [u8; 160],
    /// The zones.
    pub zone: [ZoneRecord; MAX_ZONES],
    /// The clocks.
    pub clock: [ClockRecord; MAX_CLOCKS],
}

ranges! {
    HeatRecord as "heat" {
        watched: FLAG,
        rung: within(0, RUNGS.len() as u32 - 1),
        zones: within(0, MAX_ZONES as u32),
        clocks: within(0, MAX_CLOCKS as u32),
        frame_rate_share: within(0.0_f32, 1.0),
        clocks_share: within(0.0_f32, 1.0),
        reason: AnyBytes,
        zone: Each(Nested),
        clock: Each(Nested),
    }
}

impl HeatRecord {
    /// A record without zones and clocks, and without limits.
    pub fn empty() -> Self {
        Self { frame_rate_share: 1.0, clocks_share: 1.0, ..Self::zeroed() }
    }

    /// Name of the rung; an unknown number counts as the last.
    pub fn rung_name(&self) -> &'static str {
        RUNGS[(self.rung as usize).min(RUNGS.len() - 1)]
    }

    /// Reason for the last change of the rung.
    pub fn reason(&self) -> String {
        get_text(&self.reason)
    }

    /// Sets the reason, truncated to its field.
    pub fn set_reason(&mut self, text: &str) {
        put_text(&mut self.reason, text);
    }

    /// Adds a zone; ignored after [`MAX_ZONES`].
    pub fn add_zone(&mut self, name: &str, celsius: f64, projected: bool) {
        if let Some(place) = self.zone.get_mut(self.zones as usize) {
            put_text(&mut place.name, name);
            place.celsius = celsius as f32;
            place.projected = u32::from(projected);
            self.zones += 1;
        }
    }

    /// Adds a clock; ignored after [`MAX_CLOCKS`].
    pub fn add_clock(&mut self, name: &str, wanted_mhz: f64, read_mhz: f64) {
        if let Some(place) = self.clock.get_mut(self.clocks as usize) {
            put_text(&mut place.name, name);
            place.wanted_mhz = wanted_mhz as f32;
            place.read_mhz = read_mhz as f32;
            self.clocks += 1;
        }
    }

    /// The valid zones.
    pub fn zones(&self) -> &[ZoneRecord] {
        &self.zone[..(self.zones as usize).min(MAX_ZONES)]
    }

    /// The valid clocks.
    pub fn clocks(&self) -> &[ClockRecord] {
        &self.clock[..(self.clocks as usize).min(MAX_CLOCKS)]
    }
}

impl ZoneRecord {
    /// The kernel's name of its type.
    pub fn name(&self) -> String {
        get_text(&self.name)
    }
}

impl ClockRecord {
    /// Name of its device.
    pub fn name(&self) -> String {
        get_text(&self.name)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn counts_and_rungs_are_bounded() {
        let mut heat = HeatRecord::empty();
        for zone in 0..20 {
            heat.add_zone(&format!("zone{zone}"), 50.0, zone == 3);
            heat.add_clock(&format!("clock{zone}"), 852.0, 0.0);
        }
        assert_eq!((heat.zones().len(), heat.clocks().len()), (MAX_ZONES, MAX_CLOCKS));
        assert_eq!((heat.zones()[3].name().as_str(), heat.zones()[3].projected), ("zone3", 1));
        let hostile = HeatRecord { rung: 99, zones: u32::MAX, clocks: u32::MAX, ..heat };
        assert_eq!(hostile.rung_name(), "power off");
        assert_eq!((hostile.zones().len(), hostile.clocks().len()), (MAX_ZONES, MAX_CLOCKS));
    }
}
