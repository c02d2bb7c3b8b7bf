//! The lowest priority, for readers of a running daemon: they get only time and memory that it does not need.

/// The lowest time-sharing priority.
const NICE: i32 = 19;

/// Lowers the scheduling priority, and makes this process an early victim of the OOM killer.
pub fn yield_to_the_daemon() {
    if let Err(error) = messages::idle::run_when_idle() {
        tracing::warn!(%error, "cannot use the idle scheduling policy");
    }
    if let Err(error) = rustix::process::nice(NICE) {
        tracing::warn!(%error, "cannot lower the priority: runs at normal priority");
    }
    if let Err(error) = std::fs::write("/proc/self/oom_score_adj", "800") {
        tracing::debug!(%error, "cannot set oom_score_adj");
    }
}
