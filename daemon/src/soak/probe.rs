//! Probes that measure the machine's own stalls: a thread on each core that asks to be woken every
//! 2 ms and notes when it was.

use super::processes::Reading;
use ipc::clock::monotonic_ns;
use std::collections::BTreeSet;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::Duration;
use tools::soak::stalls::Stalls;

const PERIOD: Duration = Duration::from_millis(2);

/// Wake-ups that wait to be taken; the observer takes them every few milliseconds.
const MOST: usize = 1 << 16;

/// A wake-up: core, when it was due, when it came.
type Wake = (Option<u32>, u64, u64);

/// Probes on some cores, until it is dropped.
pub struct Probes {
    stop: Arc<AtomicBool>,
    wakes: Arc<Mutex<Vec<Wake>>>,
    threads: Vec<JoinHandle<()>>,
}

impl Probes {
    /// A probe on each core; `None` is one that is not pinned.
    pub fn start(cores: &BTreeSet<Option<u32>>) -> std::io::Result<Self> {
        let mut probes = Self { stop: Arc::default(), wakes: Arc::default(), threads: Vec::new() };
        for &core in cores {
            let (stop, wakes) = (Arc::clone(&probes.stop), Arc::clone(&probes.wakes));
            let thread =
                std::thread::Builder::new().name("probe".into()).spawn(move || probe(core, &stop, &wakes))?;
            probes.threads.push(thread);
        }
        Ok(probes)
    }

    /// Hands over what was noted since the last call.
    pub fn take(&self, stalls: &mut Stalls) {
        let wakes = std::mem::take(&mut *self.wakes.lock().unwrap_or_else(PoisonError::into_inner));
        for (core, due_ns, woke_ns) in wakes {
            stalls.add(core, due_ns, woke_ns);
        }
    }

    /// Policy of this process, which the probes have, too.
    pub fn policy(&self) -> String {
        Reading::of(std::process::id()).map_or_else(String::new, |reading| reading.policy())
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
        tracing::warn!(core, "a probe cannot be pinned: stalls of this core are not known");
        return;
    }
    while !stop.load(Ordering::Relaxed) {
        let due_ns = monotonic_ns() + PERIOD.as_nanos() as u64;
        std::thread::sleep(PERIOD);
        let wake = (core, due_ns, monotonic_ns());
        let mut wakes = wakes.lock().unwrap_or_else(PoisonError::into_inner);
        if wakes.len() < MOST {
            wakes.push(wake);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn probes_wake_and_tell() {
        let cores: BTreeSet<Option<u32>> = [None, Some(0)].into();
        let probes = Probes::start(&cores).unwrap();
        let mut stalls = Stalls::default();
        let wakes = |stalls: &Stalls| stalls.figures().iter().map(|f| f.wakes).collect::<Vec<_>>();
        // Waits for both to tell; a machine on which they never do hangs here, and is seen.
        while wakes(&stalls).len() < 2 || wakes(&stalls).iter().any(|&n| n < 3) {
            probes.take(&mut stalls);
            std::thread::yield_now();
        }
        assert!(probes.policy().starts_with("SCHED_"), "{}", probes.policy());
    }
}
