//! Probes that measure stalls of the machine: a thread on each core sleeps for 2 ms at a time and notes
//! when it woke up. It has the lowest priority of the stages, so whatever delays it delays them, too.

use super::processes::Reading;
use messages::clock::monotonic_ns;
use messages::privilege;
use std::collections::BTreeSet;
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::Duration;
use tools::soak::stalls::Stalls;

const PERIOD: Duration = Duration::from_millis(2);

/// Capacity of the list of wake-ups; the observer empties it every few milliseconds.
const MAX_WAKES: usize = 1 << 16;

/// A wake-up: core, due time, actual time.
type Wake = (Option<u32>, u64, u64);

/// Running probes; stopped on drop.
pub struct Probes {
    stop: Arc<AtomicBool>,
    wakes: Arc<Mutex<Vec<Wake>>>,
    threads: Vec<JoinHandle<()>>,
    /// SCHED_FIFO priority that the last probe got; 0 = time-sharing (SCHED_OTHER).
    priority: Arc<AtomicU32>,
}

impl Probes {
    /// Starts a probe on each core; `None` stands for a probe that is not pinned. `priority` is the
    /// SCHED_FIFO priority to request; if it is refused the probe runs with SCHED_OTHER and logs a warning.
    pub fn start(cores: &BTreeSet<Option<u32>>, priority: Option<u32>) -> std::io::Result<Self> {
        let mut probes = Self {
            stop: Arc::default(),
            wakes: Arc::default(),
            threads: Vec::new(),
            priority: Arc::default(),
        };
        for &core in cores {
            let (stop, wakes) = (Arc::clone(&probes.stop), Arc::clone(&probes.wakes));
            let got = Arc::clone(&probes.priority);
            let thread = std::thread::Builder::new().name("probe".into()).spawn(move || {
                if let Some(priority) = priority
                    && let Err(error) = privilege::set_fifo(priority)
                {
                    tracing::warn!(%error, "a probe runs without real-time priority: it sees stalls that the stages do not have");
                }
                got.store(privilege::fifo_priority(), Ordering::Relaxed);
                probe(core, &stop, &wakes);
            })?;
            probes.threads.push(thread);
        }
        Ok(probes)
    }

    /// Adds the wake-ups since the last call to `stalls`.
    pub fn take(&self, stalls: &mut Stalls) {
        let wakes = std::mem::take(&mut *self.wakes.lock().unwrap_or_else(PoisonError::into_inner));
        for (core, due_ns, woke_ns) in wakes {
            stalls.add(core, due_ns, woke_ns);
        }
    }

    /// Scheduling policy of the probes.
    pub fn policy(&self) -> String {
        match self.priority.load(Ordering::Relaxed) {
            0 => Reading::of(std::process::id()).map_or_else(String::new, |reading| reading.policy()),
            priority => format!("SCHED_FIFO {priority}"),
        }
    }
}

impl Drop for Probes {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        for thread in self.threads.drain(..) {
            let _ = thread.join();
        }
    }
}

fn probe(core: Option<u32>, stop: &AtomicBool, wakes: &Mutex<Vec<Wake>>) {
    if let Some(core) = core
        && !core_affinity::set_for_current(core_affinity::CoreId { id: core as usize })
    {
        tracing::warn!(core, "a probe cannot be pinned: stalls of this core are not measured");
        return;
    }
    while !stop.load(Ordering::Relaxed) {
        let due_ns = monotonic_ns() + PERIOD.as_nanos() as u64;
        std::thread::sleep(PERIOD);
        let wake = (core, due_ns, monotonic_ns());
        let mut wakes = wakes.lock().unwrap_or_else(PoisonError::into_inner);
        if wakes.len() < MAX_WAKES {
            wakes.push(wake);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn probes_wake_and_are_counted() {
        let cores: BTreeSet<Option<u32>> = [None, Some(0)].into();
        // The priority may be refused on this machine.
        let probes = Probes::start(&cores, Some(1)).unwrap();
        let mut stalls = Stalls::default();
        let wakes = |stalls: &Stalls| stalls.figures().iter().map(|f| f.wakes).collect::<Vec<_>>();
        // Waits for both probes; hangs if one never wakes.
        while wakes(&stalls).len() < 2 || wakes(&stalls).iter().any(|&n| n < 3) {
            probes.take(&mut stalls);
            std::thread::yield_now();
        }
        let expected = if privilege::set_fifo(1).is_ok() { "SCHED_FIFO 1" } else { "SCHED_OTHER" };
        assert_eq!(probes.policy(), expected);
    }
}
