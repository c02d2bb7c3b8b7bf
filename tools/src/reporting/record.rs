//! What came out of one frame: a line of `obstacles.jsonl`.

use serde::{Deserialize, Serialize};

/// One frame. Units are in the names of the keys.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct FrameRecord {
    /// Number of the pair in its source, from 0.
    pub sequence: u64,
    /// Time in the scene, in seconds.
    pub time_s: f64,
    /// The road; `null` when none was seen.
    pub road: Option<RoadLine>,
    /// The alarm.
    pub alarm: AlarmLine,
    /// The obstacles.
    pub obstacles: Vec<ObstacleLine>,
}

/// The road of a frame.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct RoadLine {
    /// Height of the camera above it.
    pub camera_height_m: f64,
    /// Row where it reaches infinity.
    pub horizon_px: f64,
    /// Share of rows in which it is supported, 0 to 1.
    pub confidence: f64,
}

/// The alarm of a frame.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct AlarmLine {
    /// `off`, `standby`, `warning` or `alarm`.
    pub level: String,
    /// The rule that raised it: `distance`, `time_to_collision` or `deceleration`.
    pub rule: Option<String>,
    /// The track that caused it.
    pub track: Option<u32>,
    /// Whether the level is another than in the frame before.
    pub changed: bool,
    /// Nearest obstacle in the path.
    pub nearest_m: Option<f64>,
    /// The track's time to collision.
    pub time_to_collision_s: Option<f64>,
    /// Braking that would stop the vehicle before it.
    pub required_deceleration_m_s2: Option<f64>,
    /// Why it is off.
    pub reason: Option<String>,
}

/// One obstacle.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ObstacleLine {
    /// Its track.
    pub track: u32,
    /// What it is; `obstacle` when no class recognised it.
    pub class: String,
    /// Score of the class, where one did.
    pub score: Option<f64>,
    /// Whether it was seen often enough to count.
    pub confirmed: bool,
    /// Frames in a row in which it was out of sight; its place is then the one expected.
    pub missed: u32,
    /// Left column.
    pub x_px: u32,
    /// Top row.
    pub y_px: u32,
    /// Width.
    pub width_px: u32,
    /// Height.
    pub height_px: u32,
    /// Distance.
    pub distance_m: f64,
    /// One standard deviation of it.
    pub distance_sigma_m: f64,
    /// To the right of the camera's axis.
    pub lateral_m: f64,
    /// Width.
    pub width_m: f64,
    /// Height.
    pub height_m: f64,
    /// Speed to the right; `null` where one frame cannot tell.
    pub across_m_s: Option<f64>,
    /// Closing speed; `null` where one frame cannot tell.
    pub closing_m_s: Option<f64>,
    /// One standard deviation of it.
    pub closing_sigma_m_s: Option<f64>,
    /// Time to collision; `null` when it does not close in.
    pub time_to_collision_s: Option<f64>,
    /// One standard deviation of it.
    pub time_to_collision_sigma_s: Option<f64>,
    /// Whether the vehicle would meet it in its path.
    pub in_path: bool,
}

impl AlarmLine {
    /// The alarm in a few words: the level, and why.
    pub fn text(&self) -> String {
        let nearest = self.nearest_m.map_or(String::new(), |m| format!(", nearest in path {m:.1} m"));
        match (self.level.as_str(), self.rule.as_deref()) {
            ("off", _) => format!("alarm off: {}", self.reason.as_deref().unwrap_or("it cannot judge")),
            (level, Some(rule)) => {
                let why = match (rule, self.time_to_collision_s, self.required_deceleration_m_s2) {
                    ("time_to_collision", Some(s), _) => format!("{s:.1} s to collision"),
                    ("deceleration", _, Some(a)) if a > 0.0 => format!("brake with {a:.1} m/s2"),
                    ("distance", ..) => "near".into(),
                    _ => "held".into(),
                };
                format!("{} ({why}{nearest})", level.to_uppercase())
            }
            (level, None) => format!("{level}{nearest}"),
        }
    }
}

/// Four decimals are enough for anything measured here, and keep lines readable. What is not
/// finite has no place in JSON.
pub fn tidy(value: f64) -> f64 {
    if value.is_finite() { (value * 1e4).round() / 1e4 } else { 0.0 }
}

/// [`tidy`], with `None` for what is not finite.
pub fn tidy_finite(value: f64) -> Option<f64> {
    value.is_finite().then(|| tidy(value))
}
