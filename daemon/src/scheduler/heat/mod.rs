//! The thermal ladder: how much of the work the board's heat leaves. A pure state machine: readings and
//! time are passed in.
//!
//! ```text
//! normal ─▶ lower frame rate ─▶ lower clocks ─▶ recognition off ─▶ stopped ─▶ power off
//!        ◀─                  ◀─              ◀─                 ◀─
//! ```
//!
//! - Each zone is filtered by itself, seeded by its first sample: no ramp from zero at the start.
//!   The hottest counts.
//! - Up goes straight to the rung that the temperature asks for, down one rung at a time and only
//!   `hysteresis` below where it was entered. From change to change at least `dwell_ns` pass. Only
//!   the last rung is entered at once, when raw samples in a row say so, and never left.
//! - A zone that cannot be read any more is taken to warm up as fast as it ever can, from its last
//!   value on, until it can be read again.

#[cfg(test)]
mod tests;

use std::fmt;

/// A temperature in °C.
#[derive(Clone, Copy, Debug, PartialEq, PartialOrd)]
pub struct Celsius(pub f64);

impl fmt::Display for Celsius {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:.1} °C", self.0)
    }
}

/// Raw samples in a row above the highest limit that make it so: one may be a glitch of the sensor.
const CONFIRM: u32 = 3;

/// A rung of the ladder, coolest first.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
#[repr(u32)]
pub enum Rung {
    /// Everything runs.
    Normal = 0,
    /// Fewer pairs a second.
    FrameRate = 1,
    /// Slower clocks, too.
    Clocks = 2,
    /// No recognition, too: obstacles are tracked and raise alarms, but have no class.
    Recognition = 3,
    /// No pairs: the stages wait.
    Stopped = 4,
    /// The board is to be switched off.
    PowerOff = 5,
}

impl Rung {
    /// All but the first, coolest first.
    const LADDER: [Rung; 5] =
        [Rung::FrameRate, Rung::Clocks, Rung::Recognition, Rung::Stopped, Rung::PowerOff];

    /// The word for it.
    pub fn name(self) -> &'static str {
        messages::heat::RUNGS[self as usize]
    }

    fn below(self) -> Rung {
        match self {
            Rung::Normal | Rung::FrameRate => Rung::Normal,
            Rung::Clocks => Rung::FrameRate,
            Rung::Recognition => Rung::Clocks,
            Rung::Stopped => Rung::Recognition,
            Rung::PowerOff => Rung::Stopped,
        }
    }
}

/// Limits and times of the ladder.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HeatParameters {
    /// Above these the rungs from [`Rung::FrameRate`] on are entered; ascending.
    pub limits: [Celsius; 5],
    /// A rung is left this many kelvins below where it is entered.
    pub hysteresis_k: f64,
    /// Least time from change to change.
    pub dwell_ns: u64,
    /// Time constant of the filter; 0 = none.
    pub filter_ns: u64,
    /// How fast a zone can warm up, in °C a second.
    pub slew_c_per_s: f64,
    /// The daemon does not start with a zone at or above this.
    pub start_below: Celsius,
    /// Whether the board can be switched off; without it the ladder ends at [`Rung::Stopped`].
    pub powers_off: bool,
    /// Whether a zone that cannot be read may lead to [`Rung::PowerOff`], not only to [`Rung::Stopped`].
    pub missing_powers_off: bool,
    /// Share of the frame rate from [`Rung::FrameRate`] on.
    pub frame_rate_share: f64,
    /// Share of the clocks from [`Rung::Clocks`] on.
    pub clocks_share: f64,
}

/// What a rung leaves of the work.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HeatAction {
    /// Share of the frame rate, above 0.
    pub frame_rate_share: f64,
    /// Share of the configured clocks, above 0.
    pub clocks_share: f64,
    /// Whether regions are recognised.
    pub recognition: bool,
    /// Whether pairs are wanted at all.
    pub run: bool,
    /// Whether the board is to be switched off.
    pub power_off: bool,
}

/// One thermal zone.
#[derive(Clone, Debug)]
struct Zone {
    name: String,
    /// Filtered, or projected.
    celsius: f64,
    /// The last real sample, and when it came; `None` while the zone was never read.
    last: Option<(f64, u64)>,
    /// Samples in a row above the highest limit.
    over: u32,
    is_projected: bool,
}

/// The ladder.
#[derive(Clone, Debug)]
pub struct Heat {
    parameters: HeatParameters,
    zones: Vec<Zone>,
    rung: Rung,
    changed_ns: Option<u64>,
    reason: String,
}

impl Heat {
    /// The ladder over named zones, on its lowest rung.
    pub fn new(parameters: HeatParameters, names: &[String]) -> Self {
        let zone = |name: &String| Zone {
            name: name.clone(),
            celsius: f64::NEG_INFINITY,
            last: None,
            over: 0,
            is_projected: false,
        };
        Self {
            parameters,
            zones: names.iter().map(zone).collect(),
            rung: Rung::Normal,
            changed_ns: None,
            reason: String::new(),
        }
    }

    /// Other limits, from now on: for a configuration that was read again.
    pub fn set_parameters(&mut self, parameters: HeatParameters) {
        self.parameters = parameters;
    }

    /// Where the ladder is.
    pub fn rung(&self) -> Rung {
        self.rung
    }

    /// Why the last change was made; empty before the first.
    pub fn reason(&self) -> &str {
        &self.reason
    }

    /// Zones that were ever read: name, temperature, whether that is projected.
    pub fn zones(&self) -> impl Iterator<Item = (&str, Celsius, bool)> {
        let seen = self.zones.iter().filter(|zone| zone.last.is_some());
        seen.map(|zone| (zone.name.as_str(), Celsius(zone.celsius), zone.is_projected))
    }

    /// What the rung leaves of the work.
    pub fn action(&self) -> HeatAction {
        let p = &self.parameters;
        HeatAction {
            frame_rate_share: if self.rung >= Rung::FrameRate { p.frame_rate_share } else { 1.0 },
            clocks_share: if self.rung >= Rung::Clocks { p.clocks_share } else { 1.0 },
            recognition: self.rung < Rung::Recognition,
            run: self.rung < Rung::Stopped,
            power_off: self.rung == Rung::PowerOff,
        }
    }

    /// Takes one sample of each zone, in the order of their names; `None` could not be read. Gives
    /// whether the rung changed; [`Self::reason`] then says why.
    pub fn update(&mut self, now_ns: u64, readings: &[Option<Celsius>]) -> bool {
        let p = self.parameters;
        for (zone, reading) in self.zones.iter_mut().zip(readings) {
            zone.take(*reading, now_ns, &p);
        }
        if self.rung == Rung::PowerOff {
            return false;
        }
        let top = if p.powers_off { Rung::PowerOff } else { Rung::Stopped };
        if let Some(zone) = self.zones.iter().find(|zone| zone.over >= CONFIRM) {
            if self.rung < top {
                let at = zone.last.filter(|_| !zone.is_projected).map_or(zone.celsius, |(raw, _)| raw);
                let text = format!("{} is above {}", zone.describe(Celsius(at), now_ns), p.limits[4]);
                self.change(top, &text, now_ns);
                return true;
            }
            return false;
        }
        if self.changed_ns.is_some_and(|at| now_ns.saturating_sub(at) < p.dwell_ns) {
            return false;
        }
        let seen = self.zones.iter().filter(|zone| zone.last.is_some());
        let Some(hottest) = seen.max_by(|a, b| a.celsius.total_cmp(&b.celsius)) else { return false };
        let asked = Rung::LADDER[..4].iter().rev().find(|rung| hottest.celsius > p.limit(**rung).0);
        let asked = asked.copied().unwrap_or(Rung::Normal);
        let words = hottest.describe(Celsius(hottest.celsius), now_ns);
        if asked > self.rung {
            let text = format!("{words} is above {}", p.limit(asked));
            self.change(asked, &text, now_ns);
            return true;
        }
        let leave = Celsius(p.limit(self.rung).0 - p.hysteresis_k);
        if self.rung > Rung::Normal && hottest.celsius < leave.0 {
            let text = format!("{words} is below {leave}");
            self.change(self.rung.below(), &text, now_ns);
            return true;
        }
        false
    }

    fn change(&mut self, rung: Rung, why: &str, now_ns: u64) {
        self.rung = rung;
        self.changed_ns = Some(now_ns);
        self.reason = format!("{}: {why}", rung.name());
    }
}

impl HeatParameters {
    /// Above this a rung is entered; nothing is below the first.
    fn limit(&self, rung: Rung) -> Celsius {
        match rung {
            Rung::Normal => Celsius(f64::NEG_INFINITY),
            rung => self.limits[rung as usize - 1],
        }
    }

    /// The zone that forbids a start, with its temperature.
    pub fn too_hot_to_start<'a>(
        &self,
        names: &'a [String],
        readings: &[Option<Celsius>],
    ) -> Option<(&'a str, Celsius)> {
        let read =
            names.iter().zip(readings).filter_map(|(name, reading)| Some((name.as_str(), (*reading)?)));
        read.filter(|(_, at)| *at >= self.start_below).max_by(|a, b| a.1.0.total_cmp(&b.1.0))
    }
}

impl Zone {
    fn take(&mut self, reading: Option<Celsius>, now_ns: u64, p: &HeatParameters) {
        let Some(Celsius(raw)) = reading else {
            let Some((last, at_ns)) = self.last else { return };
            // From what was measured, not from the filter that trails behind it.
            let seconds = now_ns.saturating_sub(at_ns) as f64 * 1e-9;
            let from = if self.is_projected { last } else { last.max(self.celsius) };
            self.last = Some((from, at_ns));
            self.celsius = from + p.slew_c_per_s * seconds;
            self.is_projected = true;
            let is_over = p.missing_powers_off && self.celsius > p.limits[4].0;
            self.over = if is_over { self.over + 1 } else { 0 };
            return;
        };
        // A projection is no measurement: the filter starts again from what is one.
        let restart = self.is_projected || p.filter_ns == 0;
        self.celsius = match self.last {
            Some((_, at_ns)) if !restart => {
                let steps = now_ns.saturating_sub(at_ns) as f64 / p.filter_ns as f64;
                self.celsius + (raw - self.celsius) * (1.0 - (-steps).exp())
            }
            _ => raw,
        };
        self.last = Some((raw, now_ns));
        self.is_projected = false;
        self.over = if raw > p.limits[4].0 { self.over + 1 } else { 0 };
    }

    fn describe(&self, at: Celsius, now_ns: u64) -> String {
        match self.last {
            Some((last, at_ns)) if self.is_projected => format!(
                "{} cannot be read for {:.0} s (last {}); {at}, as it may have become,",
                self.name,
                now_ns.saturating_sub(at_ns) as f64 * 1e-9,
                Celsius(last)
            ),
            _ => format!("{} at {at}", self.name),
        }
    }
}
