//! `lookout soak`: its procedure and its budgets.

use crate::key::Reload;
use crate::table::table;

table! {
    /// Procedure and budgets of `lookout soak`.
    pub struct Soak, reload: Reload::OtherProcess;

    /// Time after the first result that counts in no figure, while caches fill and pages are touched.
    warm_up_s: Number(0.0, 3600.0) in "s" = 10.0;

    /// Mean time from the recovery of one fault to the next fault, with `--faults`; with `--kills` at most 200.
    fault_pause_ms: Whole(10, 600_000) in "ms" = 2_000;

    /// Budget: resident memory of all processes; shared memory and the program are counted once.
    memory_bytes: Whole(1_000_000, 1 << 40) in "bytes" = 54_000_000;

    /// Budget: growth of that memory; evaluated if the samples span four minutes.
    slope_bytes_per_hour: Whole(0, 1 << 40) in "bytes/h" = 1_048_576;

    /// Budget: time from a fault to the next result.
    next_result_s: Number(0.05, 600.0) in "s" = 3.0;

    /// Budget: median latency from capture to obstacles.
    latency_p50_ms: Number(0.1, 60_000.0) in "ms" = 80.0;

    /// Budget: 99th percentile of that latency, less the machine's own stalls.
    latency_p99_ms: Number(0.1, 60_000.0) in "ms" = 120.0;

    /// Budget: 99.9th percentile of that latency, less the machine's own stalls.
    latency_p999_ms: Number(0.1, 60_000.0) in "ms" = 160.0;

    /// Budget: processor time of all processes, in percent of all cores of the machine.
    cpu_percent: Number(0.1, 100.0) in "%" = 37.0;

    /// Budget: minimum number of results per offered pair.
    processed_percent: Number(0.0, 100.0) in "%" = 97.0;

    /// Budget: entries left in shared memory.
    leaked_entries: Whole(0, 1_000_000) = 0;

    /// Budget: restarts that failed or had no cause.
    failed_restarts: Whole(0, 1_000_000) = 0;
}
