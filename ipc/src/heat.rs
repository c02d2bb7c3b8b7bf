//! How hot the board is and how fast its clocks run: part of `status`.

use crate::header::{get_text, put_text};
use bytemuck::{Pod, Zeroable};

/// Most zones that a status shows.
pub const MAX_ZONES: usize = 8;

/// Most clocks that a status shows.
pub const MAX_CLOCKS: usize = 8;

/// Words for the rungs of the thermal ladder.
pub const RUNGS: [&str; 6] =
    ["normal", "lower frame rate", "lower clocks", "recognition off", "stopped", "power off"];

/// One thermal zone.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct ZoneRecord {
    /// Its type, as the kernel names it.
    pub name: [u8; 24],
    /// Its filtered temperature, in °C.
    pub celsius: f32,
    /// 1 when it cannot be read: the temperature is what it may have become.
    pub projected: u32,
}

/// One clock.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct ClockRecord {
    /// Its device.
    pub name: [u8; 24],
    /// What it was set to, in MHz.
    pub wanted_mhz: f32,
    /// What was read back last, in MHz; 0 when it cannot be read.
    pub read_mhz: f32,
}

/// Heat and clocks of the board.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct HeatRecord {
    /// 1 when temperatures are watched.
    pub watched: u32,
    /// Rung of the ladder: an index of [`RUNGS`].
    pub rung: u32,
    /// Zones that follow.
    pub zones: u32,
    /// Clocks that follow.
    pub clocks: u32,
    /// Share of the frame rate that heat allows.
    pub frame_rate_share: f32,
    /// Share of the clocks that heat allows.
    pub clocks_share: f32,
    /// Why the rung is what it is, in words.
    pub reason: [u8; 160],
    /// The zones.
    pub zone: [ZoneRecord; MAX_ZONES],
    /// The clocks.
    pub clock: [ClockRecord; MAX_CLOCKS],
}

impl HeatRecord {
    /// Nothing is watched, nothing is held back.
    pub fn empty() -> Self {
        Self { frame_rate_share: 1.0, clocks_share: 1.0, ..Self::zeroed() }
    }

    /// The word for the rung; a number that means nothing counts as the last.
    pub fn rung_name(&self) -> &'static str {
        RUNGS[(self.rung as usize).min(RUNGS.len() - 1)]
    }

    /// Why the rung is what it is.
    pub fn reason(&self) -> String {
        get_text(&self.reason)
    }

    /// Sets the words.
    pub fn set_reason(&mut self, text: &str) {
        put_text(&mut self.reason, text);
    }

    /// Adds a zone, if there is room.
    pub fn add_zone(&mut self, name: &str, celsius: f64, projected: bool) {
        if let Some(place) = self.zone.get_mut(self.zones as usize) {
            put_text(&mut place.name, name);
            place.celsius = celsius as f32;
            place.projected = u32::from(projected);
            self.zones += 1;
        }
    }

    /// Adds a clock, if there is room.
    pub fn add_clock(&mut self, name: &str, wanted_mhz: f64, read_mhz: f64) {
        if let Some(place) = self.clock.get_mut(self.clocks as usize) {
            put_text(&mut place.name, name);
            place.wanted_mhz = wanted_mhz as f32;
            place.read_mhz = read_mhz as f32;
            self.clocks += 1;
        }
    }

    /// The zones.
    pub fn zones(&self) -> &[ZoneRecord] {
        &self.zone[..(self.zones as usize).min(MAX_ZONES)]
    }

    /// The clocks.
    pub fn clocks(&self) -> &[ClockRecord] {
        &self.clock[..(self.clocks as usize).min(MAX_CLOCKS)]
    }
}

impl ZoneRecord {
    /// Its type.
    pub fn name(&self) -> String {
        get_text(&self.name)
    }
}

impl ClockRecord {
    /// Its device.
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
