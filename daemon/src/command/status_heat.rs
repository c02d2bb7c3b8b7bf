//! Heat and clocks in `lookout status`.

use messages::heat::HeatRecord;
use serde::Serialize;
use std::fmt::Write;

/// As JSON.
#[derive(Serialize)]
pub struct HeatJson {
    watched: bool,
    rung: &'static str,
    reason: String,
    frame_rate_share: f32,
    clocks_share: f32,
    zones: Vec<ZoneJson>,
    clocks: Vec<ClockJson>,
}

#[derive(Serialize)]
struct ZoneJson {
    name: String,
    celsius: f32,
    projected: bool,
}

#[derive(Serialize)]
struct ClockJson {
    name: String,
    wanted_mhz: f32,
    read_mhz: Option<f32>,
}

impl HeatJson {
    pub fn new(heat: &HeatRecord) -> Self {
        let zone = |z: &messages::heat::ZoneRecord| ZoneJson {
            name: z.name(),
            celsius: z.celsius,
            projected: z.projected == 1,
        };
        let clock = |c: &messages::heat::ClockRecord| ClockJson {
            name: c.name(),
            wanted_mhz: c.wanted_mhz,
            read_mhz: (c.read_mhz > 0.0).then_some(c.read_mhz),
        };
        Self {
            watched: heat.watched == 1,
            rung: heat.rung_name(),
            reason: heat.reason(),
            frame_rate_share: heat.frame_rate_share,
            clocks_share: heat.clocks_share,
            zones: heat.zones().iter().map(zone).collect(),
            clocks: heat.clocks().iter().map(clock).collect(),
        }
    }
}

/// As a person reads it; nothing where neither is watched.
pub fn lines(heat: &HeatRecord) -> String {
    let mut out = String::new();
    if heat.watched == 1 {
        let _ = write!(out, "heat: {}", heat.rung_name());
        for zone in heat.zones() {
            let mark = if zone.projected == 1 { " (cannot be read; projected)" } else { "" };
            let _ = write!(out, ", {} {:.1} °C{mark}", zone.name(), zone.celsius);
        }
        out.push('\n');
    }
    if !heat.clocks().is_empty() {
        out.push_str("clocks:");
        for (i, clock) in heat.clocks().iter().enumerate() {
            let comma = if i > 0 { "," } else { "" };
            let _ = write!(out, "{comma} {} {:.0} MHz", clock.name(), clock.wanted_mhz);
            if clock.read_mhz != clock.wanted_mhz {
                let _ = write!(out, " (reads {:.0})", clock.read_mhz);
            }
        }
        out.push('\n');
    }
    out
}
