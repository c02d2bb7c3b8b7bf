//! `[realtime]` and `[pacing]`.

use serde::{Deserialize, Serialize};

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Realtime {
    pub scheduling: String,
    pub memory_lock: String,
    pub prefault: String,
    pub pinning: String,
    pub priority_scheduler: i64,
    pub priority_capture: i64,
    pub priority_stereo: i64,
    pub priority_road: i64,
    pub priority_recognition: i64,
    pub budget_ms: i64,
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Pacing {
    pub follow: bool,
    pub min_fps: f64,
    pub max_fps: f64,
    pub headroom_percent: f64,
    pub deadline_ms: f64,
    pub late_frames: i64,
    pub stale_ms: f64,
    pub stall_ms: f64,
}
