//! Physical quantities of signals: their units and what a vehicle can have at most.

/// Maximum magnitude of a speed, in m/s: no car on a public road is faster. What is beyond is an invalid value.
pub const MAX_SPEED_M_S: f64 = 120.0;

/// Maximum magnitude of a yaw rate, in rad/s: a car that spins turns once in two seconds.
pub const MAX_YAW_RATE_RAD_S: f64 = 4.0;

/// Maximum magnitude of the angle of a steering wheel, in rad: three turns.
pub const MAX_STEERING_ANGLE_RAD: f64 = 19.0;

/// A physical quantity with a unit.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Quantity {
    /// In m/s.
    Speed,
    /// In rad/s.
    YawRate,
    /// In rad.
    Angle,
}

const SPEEDS: &[(&[&str], f64)] = &[
    (&["m/s", "mps"], 1.0),
    (&["km/h", "kmh", "kph", "kmph"], 1.0 / 3.6),
    // The international mile.
    (&["mph", "mi/h"], 0.447_04),
];

const DEGREE: f64 = std::f64::consts::PI / 180.0;

const YAW_RATES: &[(&[&str], f64)] = &[
    (&["rad/s", "rad/sec"], 1.0),
    (&["deg/s", "deg/sec", "degree/s", "degrees/s", "dps", "°/s", "°/sec"], DEGREE),
];

const ANGLES: &[(&[&str], f64)] = &[(&["rad"], 1.0), (&["deg", "degree", "degrees", "°"], DEGREE)];

impl Quantity {
    fn units(self) -> &'static [(&'static [&'static str], f64)] {
        match self {
            Self::Speed => SPEEDS,
            Self::YawRate => YAW_RATES,
            Self::Angle => ANGLES,
        }
    }

    /// Factor from a unit to m/s, rad/s or rad; `None` if the unit is unknown. Capital letters do not matter.
    pub fn scale(self, unit: &str) -> Option<f64> {
        let unit = unit.to_lowercase();
        self.units().iter().find(|(names, _)| names.contains(&unit.as_str())).map(|(_, scale)| *scale)
    }

    /// The first name of each unit, for an error.
    pub fn names(self) -> String {
        self.units().iter().filter_map(|(names, _)| names.first().copied()).collect::<Vec<_>>().join(", ")
    }

    /// Maximum magnitude, in m/s, rad/s or rad.
    pub fn max(self) -> f64 {
        match self {
            Self::Speed => MAX_SPEED_M_S,
            Self::YawRate => MAX_YAW_RATE_RAD_S,
            Self::Angle => MAX_STEERING_ANGLE_RAD,
        }
    }
}
