//! One run of a test: row, speed, place, weather, rig and seed.

use super::row::{Miss, Place, ROWS, Row};
use crate::scene::file::{NamedRig, Weather};

/// One run.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Case {
    /// The test.
    pub row: &'static Row,
    /// Our speed, in km/h.
    pub own_km_h: f64,
    /// Where the target is hit.
    pub place: Place,
    /// The near miss that is driven instead; `None` for the impact.
    pub miss: Option<Miss>,
    /// Weather.
    pub weather: Weather,
    /// Cameras.
    pub rig: NamedRig,
    /// Pairs per second.
    pub fps: f64,
    /// Seed of everything that the test leaves open.
    pub seed: u64,
}

impl Case {
    /// A name for files.
    pub fn id(&self) -> String {
        let how = match self.miss {
            Some(miss) => miss.name(),
            None => format!("at {}", self.place.percent()),
        };
        let (own, weather) = (self.own_km_h, self.weather.name());
        let text = format!("{} {own} {how} {weather} {} {}", self.row.label(), self.rig.name(), self.seed);
        let plain = |c: char| if c.is_ascii_alphanumeric() || "-_.".contains(c) { c } else { '-' };
        text.replace(", ", " ").replace("km/h", "kmh").chars().map(plain).collect()
    }
}

/// Which runs are wanted.
#[derive(Clone, Debug)]
pub struct Selection {
    /// Protocol.
    pub year: u16,
    /// Names of rows; empty: all.
    pub rows: Vec<String>,
    /// Own speeds in km/h; empty: all.
    pub speeds_km_h: Vec<f64>,
    /// Whether only the nominal place is driven.
    pub is_nominal: bool,
    /// Whether the extended range belongs to it.
    pub is_extended: bool,
    /// Weathers; empty: sunny, and night for the rows that have it.
    pub weathers: Vec<Weather>,
    /// Cameras.
    pub rig: NamedRig,
    /// Pairs per second.
    pub fps: f64,
    /// First and last seed.
    pub seeds: (u64, u64),
}

impl Selection {
    fn takes(&self, row: &Row) -> bool {
        let is_named = |name: &String| name.eq_ignore_ascii_case(row.name);
        row.years.contains(&self.year)
            && (self.is_extended || !row.is_extended)
            && (self.rows.is_empty() || self.rows.iter().any(is_named))
    }

    fn weathers(&self, row: &Row) -> Vec<Weather> {
        match (&self.weathers[..], row.at_night) {
            ([], true) => vec![Weather::Sunny, Weather::Night],
            ([], false) => vec![Weather::Sunny],
            (given, _) => given.to_vec(),
        }
    }

    /// The runs: impacts first, then near misses, each in the order of the rows.
    pub fn cases(&self) -> Vec<Case> {
        let (mut hits, mut misses) = (Vec::new(), Vec::new());
        for row in ROWS.iter().filter(|row| self.takes(row)) {
            let is_wanted = |km_h: &&f64| self.speeds_km_h.is_empty() || self.speeds_km_h.contains(km_h);
            for &own_km_h in row.own_km_h.iter().filter(is_wanted) {
                for weather in self.weathers(row) {
                    for seed in self.seeds.0..=self.seeds.1 {
                        let (rig, fps) = (self.rig, self.fps);
                        let case = |place, miss| Case { row, own_km_h, place, miss, weather, rig, fps, seed };
                        let places = if self.is_nominal { &row.places[..1] } else { row.places };
                        hits.extend(places.iter().map(|&place| case(place, None)));
                        misses.extend(row.misses().iter().map(|&miss| case(row.places[0], Some(miss))));
                    }
                }
            }
        }
        hits.extend(misses);
        hits
    }
}

/// Names of the rows of a year, each once.
pub fn names(year: u16) -> Vec<&'static str> {
    let mut names: Vec<&str> =
        ROWS.iter().filter(|row| row.years.contains(&year)).map(|row| row.name).collect();
    names.dedup();
    names
}
