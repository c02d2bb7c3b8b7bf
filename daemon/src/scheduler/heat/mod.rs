//! The thermal ladder: sheds load as the temperature of the board rises. A pure state machine: readings and time are
//! passed in.
//!
//! ```text
//! normal ─▶ lower frame rate ─▶ lower clocks ─▶ recognition off ─▶ stopped ─▶ power off
//!        ◀─                  ◀─              ◀─                 ◀─
//! ```
//!
//! - Each zone has its own low-pass filter, which starts at the first sample. The hottest zone counts.
//! - The ladder climbs directly to the rung of the temperature. It descends one rung at a time, when the temperature is
//!   `hysteresis_k` below the limit of the rung. Changes are at least `dwell_ns` apart, except that the last rung is
//!   entered at once, after several raw samples in a row above its limit, and is never left.
//! - The temperature of a zone that cannot be read is projected from its last value with the maximum rate of rise
//!   (`slew_c_per_s`) until it can be read again.

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

/// Number of raw samples in a row above the highest limit that enter the last rung; a single one may be a glitch.
const CONFIRM: u32 = 3;

/// A rung of the ladder, coolest first.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
#[repr(u32)]
pub enum Rung {
    /// No limits.
    Normal = 0,
    /// Lower frame rate.
    FrameRate = 1,
    /// Also lower clocks.
    Clocks = 2,
    /// Also no recognition: obstacles are tracked and raise alarms, but have no class.
    Recognition = 3,
    /// No frames: the stages wait.
    Stopped = 4,
    /// The board is switched off.
    PowerOff = 5,
}

impl Rung {
    /// All but the first, coolest first.
    const LADDER: [Rung; 5] =
        [Rung::FrameRate, Rung::Clocks, Rung::Recognition, Rung::Stopped, Rung::PowerOff];

    /// Its name.
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
    /// Temperatures above which the rungs from [`Rung::FrameRate`] to [`Rung::PowerOff`] are entered; ascending.
    pub limits: [Celsius; 5],
    /// A rung is left this far below the temperature at which it is entered, in kelvins.
    pub hysteresis_k: f64,
    /// Minimum time between two changes, in nanoseconds.
    pub dwell_ns: u64,
    /// Time constant of the filter, in nanoseconds; 0 = no filter.
    pub filter_ns: u64,
    /// Maximum rate of rise of a zone, in °C per second.
    pub slew_c_per_s: f64,
    /// The daemon does not start if a zone is at or above this temperature.
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

/// Limits of a rung.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HeatAction {
    /// Share of the frame rate, above 0 to 1.
    pub frame_rate_share: f64,
    /// Share of the configured clocks, above 0 to 1.
    pub clocks_share: f64,
    /// Whether tracks are classified.
    pub recognition: bool,
    /// Whether frames are processed at all.
    pub run: bool,
    /// Whether the board is switched off.
    pub power_off: bool,
}

/// One thermal zone.
#[derive(Clone, Debug)]
struct Zone {
    name: String,
    /// Filtered or projected temperature in °C.
    celsius: f64,
    /// The last measured sample in °C, and its time in ns; `None` until the zone has been read.
    last: Option<(f64, u64)>,
    /// Number of samples in a row above the highest limit.
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

    /// Sets other parameters, for a reload.
    pub fn set_parameters(&mut self, parameters: HeatParameters) {
        self.parameters = parameters;
    }

    /// The current rung.
    pub fn rung(&self) -> Rung {
        self.rung
    }

    /// Reason for the last change; empty before the first.
    pub fn reason(&self) -> &str {
        &self.reason
    }

    /// All zones that have been read at least once: name, temperature, whether it is projected.
    pub fn zones(&self) -> impl Iterator<Item = (&str, Celsius, bool)> {
        let read = self.zones.iter().filter(|zone| zone.last.is_some());
        read.map(|zone| (zone.name.as_str(), Celsius(zone.celsius), zone.is_projected))
    }

    /// Limits of the current rung.
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

    /// Adds one sample of each zone, in the order of their names; `None` = it could not be read. Returns whether the
    /// rung has changed; [`Self::reason`] then gives the reason.
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
        let read = self.zones.iter().filter(|zone| zone.last.is_some());
        let Some(hottest) = read.max_by(|a, b| a.celsius.total_cmp(&b.celsius)) else { return false };
        let target = Rung::LADDER[..4].iter().rev().find(|rung| hottest.celsius > p.limit(**rung).0);
        let target = target.copied().unwrap_or(Rung::Normal);
        let description = hottest.describe(Celsius(hottest.celsius), now_ns);
        if target > self.rung {
            let text = format!("{description} is above {}", p.limit(target));
            self.change(target, &text, now_ns);
            return true;
        }
        let leave = Celsius(p.limit(self.rung).0 - p.hysteresis_k);
        if self.rung > Rung::Normal && hottest.celsius < leave.0 {
            let text = format!("{description} is below {leave}");
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
    /// Temperature above which a rung is entered; −∞ for [`Rung::Normal`].
    fn limit(&self, rung: Rung) -> Celsius {
        match rung {
            Rung::Normal => Celsius(f64::NEG_INFINITY),
            rung => self.limits[rung as usize - 1],
        }
    }

    /// The hottest zone that is too hot for a start, with its temperature; `None` if the daemon may start.
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
            // Projected from the last sample, because the filtered value lags behind it while it rises.
            let seconds = now_ns.saturating_sub(at_ns) as f64 * 1e-9;
            let from = if self.is_projected { last } else { last.max(self.celsius) };
            self.last = Some((from, at_ns));
            self.celsius = from + p.slew_c_per_s * seconds;
            self.is_projected = true;
            let is_over = p.missing_powers_off && self.celsius > p.limits[4].0;
            self.over = if is_over { self.over + 1 } else { 0 };
            return;
        };
        // After a projection, the filter starts again at the first sample.
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
                "{} cannot be read for {:.0} s (last {}); {at}, projected,",
                self.name,
                now_ns.saturating_sub(at_ns) as f64 * 1e-9,
                Celsius(last)
            ),
            _ => format!("{} at {at}", self.name),
        }
    }
}
