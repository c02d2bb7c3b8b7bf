//! What the alarm says of a frame: level, rule and reason.

use crate::tracking::filter::TimeToCollision;

/// Level of the alarm.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
#[repr(u32)]
pub enum AlarmLevel {
    /// The alarm cannot judge.
    #[default]
    Off = 0,
    /// The alarm judges, and no dangerous obstacle is known.
    Clear = 1,
    /// An obstacle will become dangerous.
    Warning = 2,
    /// An obstacle is dangerous.
    Alarm = 3,
}

/// Rule that raised a level.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[repr(u32)]
pub enum AlarmRule {
    /// None.
    #[default]
    None = 0,
    /// Preset distance.
    Distance = 1,
    /// Time to collision.
    TimeToCollision = 2,
    /// Required deceleration.
    Deceleration = 3,
}

/// State of the alarm, with its reason.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct AlarmState {
    /// Level.
    pub level: AlarmLevel,
    /// Rule that raised the level.
    pub rule: AlarmRule,
    /// Track that raised the level.
    pub track: Option<u32>,
    /// What the state is about: the track that raised the level, or else the nearest in the path.
    pub object: Option<u32>,
    /// Whether the level is only held: what raised it does not call for it in this frame.
    pub is_held: bool,
    /// Whether the level differs from that of the previous frame.
    pub changed: bool,
    /// Distance of the nearest obstacle in the path, in metres, whether or not it is dangerous.
    pub nearest_m: Option<f64>,
    /// Time to collision of the track, while it is present.
    pub time_to_collision: Option<TimeToCollision>,
    /// Required deceleration for the track, while it is present, in m/s².
    pub required_deceleration_m_s2: f64,
}
