//! The thread that sends a cycle of frames each period.

use super::Shared;
use messages::clock::monotonic_ns;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;
use tools::can_out::{Encoder, Identifiers, Link, LinkState, OutFrame, Port, Values};

/// Pause before frames that found no room are tried again: a bus of 500 kbit/s takes some four in that time.
const RESUME: Duration = Duration::from_millis(1);

/// Time after which a bus that was sending counts as sound: its next failure is logged as the first.
const STEADY_NS: u64 = 60_000_000_000;

/// Parameters of the sender.
#[derive(Clone, Copy, Debug)]
pub struct Settings {
    /// Identifiers and number of obstacles.
    pub identifiers: Identifiers,
    /// Period of a cycle, in nanoseconds.
    pub period_ns: u64,
    /// Age from which a result is stale, in nanoseconds.
    pub stale_ns: u64,
}

/// Sends cycles until `stop` is set.
pub fn run(port: impl Port, settings: Settings, shared: &Arc<Shared>, stop: &AtomicBool) {
    let mut encoder = Encoder::new(settings.identifiers);
    let mut link = Link::new(port, last_frame(settings.identifiers));
    let mut log = Log::default();
    let mut due_ns = monotonic_ns();
    while !stop.load(Ordering::Relaxed) {
        let now_ns = monotonic_ns();
        link.cycle(now_ns, || {
            // Cloned, so that the watcher never waits for the bus.
            let values = shared.values().clone();
            let mut frames = Vec::new();
            encoder.encode(&values.cycle(now_ns, settings.stale_ns), &mut frames);
            frames
        });
        log.state(link.report().state, &link.report().reason, now_ns);
        shared.report().clone_from(link.report());
        due_ns += settings.period_ns;
        // After a pause of the process, cycles that were missed are not sent later.
        due_ns = due_ns.max(now_ns);
        while link.has_rest() && due_ns.saturating_sub(monotonic_ns()) > 2 * RESUME.as_nanos() as u64 {
            std::thread::sleep(RESUME);
            link.resume(monotonic_ns());
        }
        std::thread::sleep(Duration::from_nanos(due_ns.saturating_sub(monotonic_ns())));
    }
}

/// The last frame of each cycle; its data change.
fn last_frame(identifiers: Identifiers) -> OutFrame {
    let mut frames = Vec::new();
    Encoder::new(identifiers).encode(&Values::default().cycle(0, 0), &mut frames);
    let none = OutFrame { id: 0, is_extended: false, data: [0; 8], data_id: 0 };
    frames.last().copied().unwrap_or(none)
}

/// Logs changes of the bus's state: the first, second, fourth … failure, and recoveries from those.
#[derive(Debug, Default)]
struct Log {
    last: LinkState,
    since_ns: u64,
    failures: u64,
    is_told: bool,
}

impl Log {
    fn state(&mut self, state: LinkState, reason: &str, now_ns: u64) {
        if state == self.last {
            return;
        }
        if self.last == LinkState::Sending && now_ns.saturating_sub(self.since_ns) > STEADY_NS {
            self.failures = 0;
        }
        (self.last, self.since_ns) = (state, now_ns);
        if state == LinkState::Sending {
            if self.is_told || self.failures == 0 {
                tracing::info!("CAN out: frames are sent");
            }
            return;
        }
        self.failures += 1;
        self.is_told = self.failures.is_power_of_two();
        if self.is_told {
            tracing::warn!(failures = self.failures, "CAN out: {reason}");
        }
    }
}
