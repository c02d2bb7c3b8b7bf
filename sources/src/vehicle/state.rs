//! The newest value of each signal of the bus.

use super::reading::{VehicleFaults, VehicleReading};
use perception::motion::vehicle::{Aged, Gear, TurnIndicator, VehicleSample};

/// What a signal is for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Purpose {
    /// Speed, in m/s.
    Speed,
    /// Yaw rate, in rad/s.
    YawRate,
    /// Angle of the steering wheel, in rad.
    SteeringAngle,
    /// Brake: 0 or 1.
    Brake,
    /// Left indicator: 0 or 1.
    TurnLeft,
    /// Right indicator: 0 or 1.
    TurnRight,
    /// Gear: [`gear_number`].
    Gear,
}

impl Purpose {
    /// Number of purposes.
    pub const COUNT: usize = 7;

    /// All purposes, in the order of their numbers.
    pub const ALL: [Self; Self::COUNT] = [
        Self::Speed,
        Self::YawRate,
        Self::SteeringAngle,
        Self::Brake,
        Self::TurnLeft,
        Self::TurnRight,
        Self::Gear,
    ];
}

/// The newest value of a signal.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Newest {
    /// The signal is not configured.
    Unused,
    /// It has not been received yet.
    Missing,
    /// The value, `None` if it was out of range, and when it was received, in ns.
    Received { value: Option<f64>, time_ns: u64 },
}

/// The newest values of the bus. Small, without heap memory.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BusState {
    newest: [Newest; Purpose::COUNT],
    is_open: bool,
    /// Whether the speed signal cannot say reverse.
    speed_is_unsigned: bool,
}

/// The number that stands for a gear.
pub fn gear_number(gear: Gear) -> f64 {
    match gear {
        Gear::Park => 0.0,
        Gear::Reverse => 1.0,
        Gear::Neutral => 2.0,
        Gear::Forward => 3.0,
    }
}

impl BusState {
    /// The state before the first frame, for the signals that are configured; the bus is not open. `speed_is_unsigned`
    /// says that the speed signal cannot be negative.
    pub(super) fn new(is_configured: impl Fn(Purpose) -> bool, speed_is_unsigned: bool) -> Self {
        let newest =
            Purpose::ALL.map(|purpose| if is_configured(purpose) { Newest::Missing } else { Newest::Unused });
        Self { newest, is_open: false, speed_is_unsigned }
    }

    /// The bus is open.
    pub fn opened(&mut self) {
        self.is_open = true;
    }

    /// The bus is closed. Values remain until they are stale.
    pub fn closed(&mut self) {
        self.is_open = false;
    }

    /// A value was received; `None` is one out of range.
    pub(super) fn set(&mut self, purpose: Purpose, value: Option<f64>, time_ns: u64) {
        self.newest[purpose as usize] = Newest::Received { value, time_ns };
    }

    /// What holds for an image that was exposed at `at_ns`, on the clock of the frames. A value is stale that was received
    /// more than `stale_ns` before.
    pub fn reading(&self, at_ns: u64, stale_ns: u64) -> VehicleReading {
        let mut faults = VehicleFaults::default();
        let (mut used, mut fresh) = (false, false);
        let values = self.newest.map(|newest| {
            used |= newest != Newest::Unused;
            match newest {
                Newest::Unused => None,
                Newest::Missing => {
                    faults.missing = true;
                    None
                }
                Newest::Received { time_ns, .. } if at_ns.saturating_sub(time_ns) > stale_ns => {
                    faults.stale = true;
                    None
                }
                Newest::Received { value: None, .. } => {
                    (faults.out_of_range, fresh) = (true, true);
                    None
                }
                Newest::Received { value: Some(value), time_ns } => {
                    fresh = true;
                    let age_s = (i128::from(at_ns) - i128::from(time_ns)) as f64 * 1e-9;
                    Some(Aged { value, age_s })
                }
            }
        });
        faults.no_bus = used && (!self.is_open || !fresh);
        let [mut speed_m_s, yaw_rate_rad_s, steering, brake, left, right, gear] = values;
        let gear = gear.and_then(|aged| {
            [Gear::Park, Gear::Reverse, Gear::Neutral, Gear::Forward]
                .into_iter()
                .find(|g| gear_number(*g) == aged.value)
        });
        if gear == Some(Gear::Reverse)
            && self.speed_is_unsigned
            && let Some(speed) = &mut speed_m_s
        {
            speed.value = -speed.value;
        }
        let is_on = |value: Option<Aged>| value.map(|aged| aged.value != 0.0);
        // One indicator alone says on, not off: the other may be on.
        let turn_indicator = match (is_on(left), is_on(right)) {
            (Some(true), Some(true)) => Some(TurnIndicator::Both),
            (Some(true), _) => Some(TurnIndicator::Left),
            (_, Some(true)) => Some(TurnIndicator::Right),
            (Some(false), Some(false)) => Some(TurnIndicator::Off),
            _ => None,
        };
        let sample = VehicleSample {
            speed_m_s,
            yaw_rate_rad_s,
            steering_angle_rad: steering.map(|aged| aged.value),
            is_braking: is_on(brake),
            turn_indicator,
            gear,
        };
        VehicleReading { sample, faults }
    }
}
