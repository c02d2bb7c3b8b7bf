//! The typed configuration. What each key means, its unit and range stand in [`crate::keys`].

#![allow(missing_docs, reason = "every key is described once, in the table of keys")]

mod board;
mod realtime;
mod soak;

pub use board::{Board, Clocks, Heat};
pub use realtime::{Pacing, Realtime};
use serde::{Deserialize, Serialize};
pub use soak::Soak;
use std::path::PathBuf;

/// The whole configuration.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Config {
    pub instance: Instance,
    pub log: Log,
    pub source: Source,
    pub stereo: Stereo,
    pub calibration: Calibration,
    pub road: Road,
    pub regions: Regions,
    pub recognition: Recognition,
    pub tracking: Tracking,
    pub alarm: Alarm,
    pub cores: Cores,
    pub supervision: Supervision,
    pub heat: Heat,
    pub clocks: Clocks,
    pub board: Board,
    pub soak: Soak,
    pub camera: Camera,
    pub realtime: Realtime,
    pub pacing: Pacing,
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Instance {
    pub name: String,
    pub directory: PathBuf,
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Log {
    pub level: String,
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Source {
    pub kind: String,
    pub path: PathBuf,
    pub seed: i64,
    pub fps: f64,
    pub repeat: bool,
    pub rig: PathBuf,
    pub rectify: bool,
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Stereo {
    pub method: String,
    pub disparities: i64,
    pub budget_ms: f64,
    pub threads: i64,
    pub ssim_k2: f64,
    pub gradient_limit: i64,
    pub lambda_horizontal: i64,
    pub lambda_vertical: i64,
    pub lambda_diagonal: i64,
    pub truncation_horizontal: i64,
    pub truncation_other: i64,
    pub edge_levels: i64,
    pub edge_percent: i64,
    pub merging: String,
    pub scales: i64,
    pub slopes: bool,
    pub sub_pixel: String,
    pub left_right_px: i64,
    pub speckle_pixels: i64,
    pub confidence_min: i64,
    pub bridge_px: i64,
    pub fill: bool,
    pub backend: String,
    pub adapter: String,
    pub gpu_timeout_ms: f64,
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Calibration {
    pub check: bool,
    pub every_frames: i64,
    pub bound_px: f64,
    pub correct_px: f64,
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Road {
    pub camera_height_min_m: f64,
    pub camera_height_max_m: f64,
    pub horizon_share: f64,
    pub least_support: f64,
    pub shape: String,
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Regions {
    pub height_min_m: f64,
    pub height_max_m: f64,
    pub distance_max_m: f64,
    pub width_min_m: f64,
    pub depth_span_m: f64,
    pub pixels_min: i64,
    pub count_max: i64,
    pub confirm: bool,
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Recognition {
    pub cascade: PathBuf,
    pub label: String,
    pub window_m: f64,
    pub window_min_px: i64,
    pub window_max_px: i64,
    pub growth: f64,
    pub neighbours_min: i64,
    pub looks_max: i64,
    pub again_frames: i64,
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Tracking {
    pub confirm_frames: i64,
    pub forget_frames: i64,
    pub overlap_min: f64,
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Alarm {
    pub distance_m: f64,
    pub ttc_warning_s: f64,
    pub ttc_alarm_s: f64,
    pub deceleration_warning_m_s2: f64,
    pub deceleration_alarm_m_s2: f64,
    pub path_width_m: f64,
    pub confirm_frames: i64,
    pub clear_share: f64,
    pub hold_ms: i64,
    pub frame_age_max_ms: i64,
    pub self_check: bool,
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Cores {
    pub pin: bool,
    pub scheduler: i64,
    pub capture: i64,
    pub stereo: i64,
    pub road: i64,
    pub recognition: i64,
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Supervision {
    pub heartbeat_ms: i64,
    pub startup_deadline_ms: i64,
    pub liveness_deadline_ms: i64,
    pub restart_first_ms: i64,
    pub restart_longest_ms: i64,
    pub restart_count: i64,
    pub restart_window_s: i64,
    pub retry_s: i64,
    pub stop_grace_ms: i64,
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Camera {
    pub backend: String,
    pub left: PathBuf,
    pub right: PathBuf,
    pub side_by_side: bool,
    pub width: i64,
    pub height: i64,
    pub fps: f64,
    pub format: String,
    pub skew_ms: f64,
    pub exposure: String,
    pub exposure_us: i64,
    pub gain: i64,
    pub silence_ms: i64,
    pub retry_first_ms: i64,
    pub retry_longest_ms: i64,
}
