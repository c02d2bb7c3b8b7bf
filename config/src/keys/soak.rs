//! Keys of `lookout soak`: how it goes about it, and the budgets that it judges by.

use super::Kind::{Number, Whole};
use super::{Key, key};

/// `[soak]`.
pub(super) const SOAK: &[Key] = &[
    key(
        "soak.warm_up_s",
        Number(0.0, 3600.0),
        "Seconds from the first result that count in no figure: caches fill, pages are touched.",
    ),
    key(
        "soak.fault_pause_ms",
        Whole(10, 600_000),
        "Mean pause from the recovery of one fault to the next, in milliseconds, with --faults; --kills makes it 200 at most.",
    ),
    key(
        "soak.memory_bytes",
        Whole(1_000_000, 1 << 40),
        "Budget: resident memory of all processes, in bytes; shared memory and the program are counted once.",
    ),
    key(
        "soak.slope_bytes_per_hour",
        Whole(0, 1 << 40),
        "Budget: growth of that memory, in bytes an hour; judged when the samples span four minutes.",
    ),
    key("soak.next_result_s", Number(0.05, 600.0), "Budget: seconds from a fault to the next result."),
    key(
        "soak.latency_p50_ms",
        Number(0.1, 60_000.0),
        "Budget: capture to obstacles, median, in milliseconds.",
    ),
    key(
        "soak.latency_p99_ms",
        Number(0.1, 60_000.0),
        "Budget: 99th percentile of that, less the machine's own stalls, in milliseconds.",
    ),
    key(
        "soak.latency_p999_ms",
        Number(0.1, 60_000.0),
        "Budget: 99.9th percentile of that, less the machine's own stalls, in milliseconds.",
    ),
    key(
        "soak.cpu_percent",
        Number(0.1, 100.0),
        "Budget: processor time of all processes, in percent of all cores of the machine.",
    ),
    key(
        "soak.processed_percent",
        Number(0.0, 100.0),
        "Budget: results per offered pair, in percent, at least.",
    ),
    key("soak.leaked_entries", Whole(0, 1_000_000), "Budget: entries left in shared memory."),
    key(
        "soak.failed_restarts",
        Whole(0, 1_000_000),
        "Budget: restarts that failed or that nothing called for.",
    ),
];
