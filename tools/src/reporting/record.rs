//! The result of one frame: a line of `obstacles.jsonl`.

use crate::reporting::motion::MotionLine;
use crate::reporting::path::PathLine;
pub use crate::reporting::tidy::{tidy, tidy_finite};
use serde::{Deserialize, Serialize};

/// Record of one frame. Field names contain the units.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct FrameRecord {
    /// Index of the pair in its source, from 0.
    pub sequence: u64,
    /// Source time, in seconds.
    pub time_s: f64,
    /// The road; `null` when it was not detected.
    pub road: Option<RoadLine>,
    /// The vehicle's own motion.
    #[serde(default)]
    pub motion: MotionLine,
    /// The vehicle's path as the alarm sees it.
    #[serde(default)]
    pub path: PathLine,
    /// The alarm.
    pub alarm: AlarmLine,
    /// The obstacles.
    pub obstacles: Vec<ObstacleLine>,
}

/// Road estimate of a frame.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct RoadLine {
    /// Height of the camera above the road.
    pub camera_height_m: f64,
    /// Row of the horizon, where the road's disparity is zero.
    pub horizon_px: f64,
    /// Share of rows that support the estimate, 0 to 1.
    pub confidence: f64,
}

/// Alarm state of a frame.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct AlarmLine {
    /// `off`, `clear`, `warning` or `alarm`.
    pub level: String,
    /// The rule that raised it: `distance`, `time_to_collision` or `deceleration`.
    pub rule: Option<String>,
    /// The track that triggered the alarm.
    pub track: Option<u32>,
    /// Whether the level changed since the previous frame.
    pub changed: bool,
    /// Distance of the nearest obstacle in the path.
    pub nearest_m: Option<f64>,
    /// Time to collision of the track.
    pub time_to_collision_s: Option<f64>,
    /// Deceleration needed to stop before it.
    pub required_deceleration_m_s2: Option<f64>,
    /// Why the alarm is off.
    pub reason: Option<String>,
}

/// An obstacle.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ObstacleLine {
    /// Track number.
    pub track: u32,
    /// Class; `obstacle` when no class was recognised.
    pub class: String,
    /// Score of the class, if recognised.
    pub score: Option<f64>,
    /// Whether it probably exists, so that it counts as an obstacle.
    pub confirmed: bool,
    /// Consecutive frames without a sighting.
    pub missed: u32,
    /// Whether box, place and size are predictions, because nothing was seen of it in this frame.
    #[serde(default)]
    pub predicted: bool,
    /// Probability that it exists.
    #[serde(default)]
    pub probability: f64,
    /// Left column.
    pub x_px: u32,
    /// Top row.
    pub y_px: u32,
    /// Width in the image.
    pub width_px: u32,
    /// Height in the image.
    pub height_px: u32,
    /// Distance of the near side.
    pub distance_m: f64,
    /// Standard deviation of the distance.
    pub distance_sigma_m: f64,
    /// Lateral position right of the camera's axis.
    pub lateral_m: f64,
    /// Physical width.
    pub width_m: f64,
    /// Physical height.
    pub height_m: f64,
    /// Lateral velocity to the right; `null` where it cannot be estimated from a single frame.
    pub across_m_s: Option<f64>,
    /// Closing speed; `null` where it cannot be estimated from a single frame.
    pub closing_m_s: Option<f64>,
    /// Standard deviation of the closing speed.
    pub closing_sigma_m_s: Option<f64>,
    /// Time to collision; `null` when the obstacle does not approach.
    pub time_to_collision_s: Option<f64>,
    /// Standard deviation of the time to collision.
    pub time_to_collision_sigma_s: Option<f64>,
    /// Whether it is or will be in the vehicle's path.
    pub in_path: bool,
}

impl AlarmLine {
    /// One-line description of the alarm: the level and the reason.
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
