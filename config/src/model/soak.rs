//! `[soak]`.

use serde::{Deserialize, Serialize};

/// How `lookout soak` goes about it, and its budgets.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Soak {
    pub warm_up_s: f64,
    pub fault_pause_ms: i64,
    pub memory_bytes: i64,
    pub slope_bytes_per_hour: i64,
    pub next_result_s: f64,
    pub latency_p50_ms: f64,
    pub latency_p99_ms: f64,
    pub latency_p999_ms: f64,
    pub cpu_percent: f64,
    pub processed_percent: f64,
    pub leaked_entries: i64,
    pub failed_restarts: i64,
}
