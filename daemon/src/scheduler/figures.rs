//! Figures of a run in the log, once a minute: fields of the journal for users without a metrics database.

use messages::pipeline::Role;
use messages::status::StatusRecord;

/// Time between two lines.
const PERIOD_NS: u64 = 60_000_000_000;

/// Timer of the line.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct MinuteFigures {
    written_ns: u64,
}

impl MinuteFigures {
    /// Whether a line is due `uptime_ns` after the start. If so, the timer restarts.
    fn is_due(&mut self, uptime_ns: u64) -> bool {
        let is_due = uptime_ns.saturating_sub(self.written_ns) >= PERIOD_NS;
        if is_due {
            self.written_ns = uptime_ns;
        }
        is_due
    }

    /// Writes a line if one is due.
    pub fn tick(&mut self, status: &StatusRecord) {
        if !self.is_due(status.uptime_ns) {
            return;
        }
        let stages = || status.processes().filter(|(role, _)| Role::STAGES.contains(role));
        let last = stages().find(|(role, _)| *role == Role::LAST);
        tracing::info!(
            figures = "minute",
            state = status.state_name(),
            frames = status.frames,
            rate_hz = last.map_or(0.0, |(_, p)| p.rate_hz),
            p50_ms = status.latency_p50_ms,
            p99_ms = status.latency_p99_ms,
            dropped = stages().map(|(_, p)| p.skipped).sum::<u64>(),
            restarts = status.processes().map(|(_, p)| u64::from(p.restarts)).sum::<u64>(),
            cpu_percent = status.processes().map(|(_, p)| p.cpu_percent).sum::<f32>(),
            private_bytes = status.processes().map(|(_, p)| p.private_bytes).sum::<u64>(),
            alarms = status.alarms,
            "figures"
        );
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_a_minute() {
        let mut figures = MinuteFigures::default();
        let due: Vec<u64> = (0..600).filter(|s| figures.is_due(s * 1_000_000_000)).collect();
        assert_eq!(due, [60, 120, 180, 240, 300, 360, 420, 480, 540]);
    }
}
