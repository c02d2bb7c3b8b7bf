//! Tables of the board.

use serde::{Deserialize, Serialize};
use std::path::PathBuf;

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Heat {
    pub watch: String,
    pub zones: String,
    pub period_ms: i64,
    pub filter_s: f64,
    pub start_below_c: f64,
    pub frame_rate_above_c: f64,
    pub frame_rate_share: f64,
    pub clocks_above_c: f64,
    pub clocks_share: f64,
    pub recognition_above_c: f64,
    pub stop_above_c: f64,
    pub power_off_above_c: f64,
    pub hysteresis_c: f64,
    pub dwell_s: f64,
    pub slew_c_per_s: f64,
    pub missing: String,
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Clocks {
    pub set: String,
    pub cpu_mhz: f64,
    pub gpu_mhz: f64,
    pub check_ms: i64,
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Board {
    pub sysfs: PathBuf,
    pub gpu: String,
    pub gpu_device: String,
    pub power_off: String,
    pub power_off_command: PathBuf,
}
