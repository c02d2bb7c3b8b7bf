//! What the vehicle itself reports of its motion (CAN bus, recording).

/// A measured value and its age.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Aged {
    /// The value.
    pub value: f64,
    /// Time from the measurement to the frame, in seconds; negative if it was measured after the frame.
    pub age_s: f64,
}

/// Turn indicators.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TurnIndicator {
    /// Off.
    Off,
    /// Left.
    Left,
    /// Right.
    Right,
    /// Both: hazard warning.
    Both,
}

/// Selected gear.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Gear {
    /// Park.
    Park,
    /// Reverse.
    Reverse,
    /// Neutral.
    Neutral,
    /// Any forward gear.
    Forward,
}

/// What the vehicle reports at the time of a frame; `None` where a value is not configured, missing or stale.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct VehicleSample {
    /// Speed, in m/s, forwards positive.
    pub speed_m_s: Option<Aged>,
    /// Yaw rate, in rad/s, to the left positive.
    pub yaw_rate_rad_s: Option<Aged>,
    /// Angle of the steering wheel, in rad, to the left positive.
    pub steering_angle_rad: Option<f64>,
    /// Whether the brake is pressed.
    pub is_braking: Option<bool>,
    /// Turn indicators.
    pub turn_indicator: Option<TurnIndicator>,
    /// Selected gear.
    pub gear: Option<Gear>,
}
