//! What the vehicle reported, as a JSON document of a recording.

use crate::vehicle::{
    MAX_SPEED_M_S, MAX_STEERING_ANGLE_RAD, MAX_YAW_RATE_RAD_S, VehicleFaults, VehicleReading,
};
use perception::motion::vehicle::{Aged, Gear, TurnIndicator, VehicleSample};
use serde::{Deserialize, Serialize};

/// Maximum magnitude of an age, in seconds.
const MAX_AGE_S: f64 = 60.0;

/// A message of the topic `/vehicle`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct VehicleLine {
    /// Speed, in m/s, forwards positive.
    pub speed_m_s: Option<f64>,
    /// Time from the measurement of the speed to the frame, in seconds.
    pub speed_age_s: Option<f64>,
    /// Yaw rate, in rad/s, to the left positive.
    pub yaw_rate_rad_s: Option<f64>,
    /// Time from the measurement of the yaw rate to the frame, in seconds.
    pub yaw_rate_age_s: Option<f64>,
    /// Angle of the steering wheel, in rad, to the left positive.
    pub steering_angle_rad: Option<f64>,
    /// Whether the brake is pressed.
    pub braking: Option<bool>,
    /// Turn indicators.
    pub turn_indicator: Option<TurnIndicatorName>,
    /// Selected gear.
    pub gear: Option<GearName>,
    /// Why values are missing.
    pub faults: FaultNames,
}

/// Why values are missing: see [`VehicleFaults`].
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct FaultNames {
    /// The bus cannot be opened, or nothing comes from it.
    pub no_bus: bool,
    /// A configured signal has never been received.
    pub missing: bool,
    /// A configured signal has not been received for too long.
    pub stale: bool,
    /// A value was out of its range.
    pub out_of_range: bool,
}

/// Name of [`TurnIndicator`].
#[allow(missing_docs)]
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum TurnIndicatorName {
    Off,
    Left,
    Right,
    Both,
}

/// Name of [`Gear`].
#[allow(missing_docs)]
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum GearName {
    Park,
    Reverse,
    Neutral,
    Forward,
}

impl From<VehicleReading> for VehicleLine {
    fn from(reading: VehicleReading) -> Self {
        let VehicleReading { sample, faults } = reading;
        Self {
            speed_m_s: sample.speed_m_s.map(|v| v.value),
            speed_age_s: sample.speed_m_s.map(|v| v.age_s),
            yaw_rate_rad_s: sample.yaw_rate_rad_s.map(|v| v.value),
            yaw_rate_age_s: sample.yaw_rate_rad_s.map(|v| v.age_s),
            steering_angle_rad: sample.steering_angle_rad,
            braking: sample.is_braking,
            turn_indicator: sample.turn_indicator.map(|turn| match turn {
                TurnIndicator::Off => TurnIndicatorName::Off,
                TurnIndicator::Left => TurnIndicatorName::Left,
                TurnIndicator::Right => TurnIndicatorName::Right,
                TurnIndicator::Both => TurnIndicatorName::Both,
            }),
            gear: sample.gear.map(|gear| match gear {
                Gear::Park => GearName::Park,
                Gear::Reverse => GearName::Reverse,
                Gear::Neutral => GearName::Neutral,
                Gear::Forward => GearName::Forward,
            }),
            faults: FaultNames {
                no_bus: faults.no_bus,
                missing: faults.missing,
                stale: faults.stale,
                out_of_range: faults.out_of_range,
            },
        }
    }
}

impl VehicleLine {
    /// Parses a message. `None` if it is not one.
    pub(super) fn parse(data: &[u8]) -> Option<Self> {
        serde_json::from_slice(data).ok()
    }

    /// What holds for a frame that is `later_s` after the one that the message belongs to; what is then older than
    /// `stale_s` is left out. Values out of range, which a foreign file may have, are left out too.
    pub(super) fn reading(&self, later_s: f64, stale_s: f64) -> VehicleReading {
        let faults = self.faults;
        let mut faults = VehicleFaults {
            no_bus: faults.no_bus,
            missing: faults.missing,
            stale: faults.stale,
            out_of_range: faults.out_of_range,
        };
        let mut within = |value: Option<f64>, max: f64| {
            let value = value?;
            faults.out_of_range |= value.abs() > max;
            (value.abs() <= max).then_some(value)
        };
        let values = (within(self.speed_m_s, MAX_SPEED_M_S), within(self.yaw_rate_rad_s, MAX_YAW_RATE_RAD_S));
        let steering_angle_rad = within(self.steering_angle_rad, MAX_STEERING_ANGLE_RAD);
        let mut aged = |value: Option<f64>, age_s: Option<f64>| {
            let aged = Aged { value: value?, age_s: age_s.unwrap_or(0.0) + later_s };
            let is_fresh = aged.age_s.abs() <= MAX_AGE_S && (later_s == 0.0 || aged.age_s.abs() <= stale_s);
            faults.stale |= !is_fresh;
            is_fresh.then_some(aged)
        };
        let sample = VehicleSample {
            speed_m_s: aged(values.0, self.speed_age_s),
            yaw_rate_rad_s: aged(values.1, self.yaw_rate_age_s),
            steering_angle_rad,
            is_braking: self.braking,
            turn_indicator: self.turn_indicator.map(|turn| match turn {
                TurnIndicatorName::Off => TurnIndicator::Off,
                TurnIndicatorName::Left => TurnIndicator::Left,
                TurnIndicatorName::Right => TurnIndicator::Right,
                TurnIndicatorName::Both => TurnIndicator::Both,
            }),
            gear: self.gear.map(|gear| match gear {
                GearName::Park => Gear::Park,
                GearName::Reverse => Gear::Reverse,
                GearName::Neutral => Gear::Neutral,
                GearName::Forward => Gear::Forward,
            }),
        };
        VehicleReading { sample, faults }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn full() -> VehicleReading {
        let sample = VehicleSample {
            speed_m_s: Some(Aged { value: 12.5, age_s: 0.02 }),
            yaw_rate_rad_s: Some(Aged { value: -0.3, age_s: -0.01 }),
            steering_angle_rad: Some(1.25),
            is_braking: Some(true),
            turn_indicator: Some(TurnIndicator::Left),
            gear: Some(Gear::Reverse),
        };
        VehicleReading { sample, faults: VehicleFaults { stale: true, ..VehicleFaults::default() } }
    }

    #[test]
    fn a_reading_comes_back() {
        for reading in [full(), VehicleReading::default()] {
            let text = serde_json::to_vec(&VehicleLine::from(reading)).unwrap();
            assert_eq!(VehicleLine::parse(&text).unwrap().reading(0.0, 0.5), reading);
        }
        let later = VehicleLine::from(full()).reading(0.1, 0.5);
        assert!((later.sample.speed_m_s.unwrap().age_s - 0.12).abs() < 1e-9);
        let stale = VehicleLine::from(full()).reading(0.495, 0.5);
        assert!(
            stale.sample.speed_m_s.is_none() && stale.sample.yaw_rate_rad_s.is_some() && stale.faults.stale
        );
    }

    #[test]
    fn foreign_documents_are_no_readings() {
        for text in ["", "{", "1", "{\"speed_m_s\": \"fast\"}", "{\"gear\": \"fifth\"}"] {
            assert_eq!(VehicleLine::parse(text.as_bytes()), None, "{text}");
        }
        assert_eq!(VehicleLine::parse(b"{\"other\": 1}"), Some(VehicleLine::default()));
        let wild =
            VehicleLine::parse(b"{\"speed_m_s\": 1e300, \"yaw_rate_rad_s\": 1, \"yaw_rate_age_s\": 1e9}")
                .unwrap();
        let reading = wild.reading(0.0, 0.5);
        assert_eq!(reading.sample, VehicleSample::default());
        assert!(reading.faults.out_of_range && reading.faults.stale);
    }
}
