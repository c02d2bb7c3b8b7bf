//! What the vehicle reports, between sources and messages.

use messages::motion::{VehicleRecord, present, vehicle_faults};
use perception::motion::vehicle::{Aged, Gear, TurnIndicator, VehicleSample};
use sources::vehicle::{VehicleFaults, VehicleReading};

/// Turn indicators, indexed by their numbers in messages.
const TURN_INDICATORS: [TurnIndicator; 4] =
    [TurnIndicator::Off, TurnIndicator::Left, TurnIndicator::Right, TurnIndicator::Both];

/// Gears, indexed by their numbers in messages.
const GEARS: [Gear; 4] = [Gear::Park, Gear::Reverse, Gear::Neutral, Gear::Forward];

fn number<T: PartialEq>(of: &[T], value: Option<T>) -> u32 {
    value.and_then(|value| of.iter().position(|v| *v == value)).map_or(0, |place| place as u32)
}

/// The record of a reading, with all numbers in their ranges.
pub fn record(reading: &VehicleReading) -> VehicleRecord {
    let VehicleReading { sample: s, faults: f } = reading;
    let bit = |is_set: bool, bit: u32| if is_set { bit } else { 0 };
    let (speed, yaw_rate) = (s.speed_m_s.unwrap_or_default(), s.yaw_rate_rad_s.unwrap_or_default());
    VehicleRecord {
        speed_m_s: speed.value,
        speed_age_s: speed.age_s,
        yaw_rate_rad_s: yaw_rate.value,
        yaw_rate_age_s: yaw_rate.age_s,
        steering_angle_rad: s.steering_angle_rad.unwrap_or_default(),
        present: bit(s.speed_m_s.is_some(), present::SPEED)
            | bit(s.yaw_rate_rad_s.is_some(), present::YAW_RATE)
            | bit(s.steering_angle_rad.is_some(), present::STEERING_ANGLE)
            | bit(s.is_braking.is_some(), present::BRAKE)
            | bit(s.turn_indicator.is_some(), present::TURN_INDICATOR)
            | bit(s.gear.is_some(), present::GEAR),
        faults: bit(f.no_bus, vehicle_faults::NO_BUS)
            | bit(f.missing, vehicle_faults::MISSING)
            | bit(f.stale, vehicle_faults::STALE)
            | bit(f.out_of_range, vehicle_faults::OUT_OF_RANGE),
        is_braking: u32::from(s.is_braking == Some(true)),
        turn_indicator: number(&TURN_INDICATORS, s.turn_indicator),
        gear: number(&GEARS, s.gear),
        reserved: 0,
    }
    .limited()
}

/// The reading of a record.
pub fn reading(record: &VehicleRecord) -> VehicleReading {
    let has = |bit: u32| record.present & bit != 0;
    let aged = |bit: u32, value: f64, age_s: f64| has(bit).then_some(Aged { value, age_s });
    let place = |number: u32| usize::try_from(number).unwrap_or(usize::MAX);
    let turn_indicator = TURN_INDICATORS.get(place(record.turn_indicator)).copied();
    let gear = GEARS.get(place(record.gear)).copied();
    let sample = VehicleSample {
        speed_m_s: aged(present::SPEED, record.speed_m_s, record.speed_age_s),
        yaw_rate_rad_s: aged(present::YAW_RATE, record.yaw_rate_rad_s, record.yaw_rate_age_s),
        steering_angle_rad: has(present::STEERING_ANGLE).then_some(record.steering_angle_rad),
        is_braking: has(present::BRAKE).then_some(record.is_braking == 1),
        turn_indicator: turn_indicator.filter(|_| has(present::TURN_INDICATOR)),
        gear: gear.filter(|_| has(present::GEAR)),
    };
    let is_set = |bit: u32| record.faults & bit != 0;
    let faults = VehicleFaults {
        no_bus: is_set(vehicle_faults::NO_BUS),
        missing: is_set(vehicle_faults::MISSING),
        stale: is_set(vehicle_faults::STALE),
        out_of_range: is_set(vehicle_faults::OUT_OF_RANGE),
    };
    VehicleReading { sample, faults }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn random_readings_come_back() {
        let mut random = fastrand::Rng::with_seed(6);
        for _ in 0..2000 {
            let mut some = |range: f64| random.bool().then(|| range * (2.0 * random.f64() - 1.0));
            let [speed, yaw_rate, steering] = [some(120.0), some(4.0), some(19.0)];
            let aged = |value: Option<f64>| value.map(|value| Aged { value, age_s: value / 10.0 });
            let sample = VehicleSample {
                speed_m_s: aged(speed),
                yaw_rate_rad_s: aged(yaw_rate),
                steering_angle_rad: steering,
                is_braking: random.bool().then(|| random.bool()),
                turn_indicator: random.bool().then(|| TURN_INDICATORS[random.usize(0..4)]),
                gear: random.bool().then(|| GEARS[random.usize(0..4)]),
            };
            let faults = VehicleFaults {
                no_bus: random.bool(),
                missing: random.bool(),
                stale: random.bool(),
                out_of_range: random.bool(),
            };
            let expected = VehicleReading { sample, faults };
            assert_eq!(reading(&record(&expected)), expected);
        }
        assert_eq!(record(&VehicleReading::default()), VehicleRecord::default());
    }

    #[test]
    fn numbers_beyond_the_ranges_are_limited() {
        let speed = Aged { value: 1e9, age_s: -1e9 };
        let sample = VehicleSample { speed_m_s: Some(speed), ..VehicleSample::default() };
        let record = record(&VehicleReading { sample, ..VehicleReading::default() });
        assert_eq!((record.speed_m_s, record.speed_age_s), (300.0, -60.0));
    }
}
