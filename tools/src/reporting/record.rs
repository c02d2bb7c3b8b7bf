//! The result of one frame: a line of `obstacles.jsonl`.

use crate::reporting::motion::MotionLine;
use crate::reporting::path::PathLine;
use crate::reporting::space::BoundaryLine;
pub use crate::reporting::tidy::{tidy, tidy_finite};
use serde::{Deserialize, Serialize};
use std::fmt;

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
    /// Free space: polygons on the road, each a list of corners, right and forward of the left camera.
    #[serde(default)]
    pub free_space_m: Vec<Vec<[f64; 2]>>,
    /// Boundaries beside the path, nearest first.
    #[serde(default)]
    pub boundaries: Vec<BoundaryLine>,
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
    /// Why it has this level, in words; `null` only in files of earlier versions.
    pub reason: Option<String>,
    /// What the level is about: the object that raised it, or else the nearest in the path.
    #[serde(default)]
    pub object: Option<AlarmObject>,
}

/// The object that the alarm is about.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct AlarmObject {
    /// Track number.
    pub track: u32,
    /// Class; `obstacle` when no class was recognised; `null` while it is lost.
    pub class: Option<String>,
    /// Gap between it and the path when the vehicle arrives; negative where they overlap: by so much it would have to be
    /// farther aside. `null` while it is lost.
    pub clearance_m: Option<f64>,
}

/// An obstacle.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ObstacleLine {
    /// Track number.
    pub track: u32,
    /// Class; `obstacle` when no class was recognised.
    pub class: String,
    /// Probability of the class, if recognised.
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
    /// Gap between it and the vehicle's path when the vehicle arrives; negative where they overlap. `null` in files of
    /// earlier versions.
    #[serde(default)]
    pub clearance_m: Option<f64>,
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

/// A level in words that stand alone, by its name: `off`, `clear`, `warning` or `alarm`.
pub fn level_words(level: &str) -> &'static str {
    match level {
        "alarm" => "alarm raised",
        "warning" => "warning raised",
        "clear" => "alarm clear",
        _ => "alarm off",
    }
}

impl AlarmLine {
    /// One-line description of the alarm: the level, the reason, the object.
    pub fn text(&self) -> String {
        let reason = self.reason.as_deref().unwrap_or("no reason");
        let object = self.object.as_ref().map_or(String::new(), |object| format!(", {object}"));
        let nearest = self.nearest_m.map_or(String::new(), |m| format!(", nearest in the path {m:.1} m"));
        let words = level_words(&self.level);
        match self.level.as_str() {
            "off" => format!("{words}: {reason}"),
            "clear" => format!("{words}: {reason}{object}"),
            _ => format!("{words}: {reason}{object}{nearest}"),
        }
    }
}

impl ObstacleLine {
    /// Whether pictures show it: what was never confirmed and is not seen now is left out.
    pub fn is_shown(&self) -> bool {
        self.confirmed || !self.predicted
    }
}

/// Such as "vehicle 12, 0.6 m into the path".
impl fmt::Display for AlarmObject {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} {}", self.class.as_deref().unwrap_or("track"), self.track)?;
        match self.clearance_m {
            Some(overlap) if overlap < 0.0 => write!(f, ", {:.1} m into the path", -overlap),
            Some(gap) => write!(f, ", {gap:.1} m beside the path"),
            None => Ok(()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_alarm_is_told_in_words() {
        let object = AlarmObject { track: 12, class: Some("vehicle".into()), clearance_m: Some(-0.64) };
        let alarm = |level: &str, reason: &str, object: Option<AlarmObject>| AlarmLine {
            level: level.into(),
            reason: Some(reason.into()),
            object,
            ..AlarmLine::default()
        };
        let warning = alarm("warning", "1.6 s to collision", Some(object.clone()));
        assert_eq!(warning.text(), "warning raised: 1.6 s to collision, vehicle 12, 0.6 m into the path");
        assert_eq!(alarm("clear", "nothing in the path", None).text(), "alarm clear: nothing in the path");
        assert_eq!(alarm("off", "no road seen", None).text(), "alarm off: no road seen");
        let lost = AlarmObject { class: None, clearance_m: None, ..object };
        assert_eq!(alarm("alarm", "held", Some(lost)).text(), "alarm raised: held, track 12");
        // A line of an earlier version.
        let old = r#"{"level":"standby","rule":null,"track":null,"changed":false,"nearest_m":null,
            "time_to_collision_s":null,"required_deceleration_m_s2":null,"reason":null}"#;
        let line: AlarmLine = serde_json::from_str(old).unwrap();
        assert_eq!((line.object, line.reason), (None, None));
    }
}
