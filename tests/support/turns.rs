//! Who may run beside whom: tests that measure run alone, of the others only a few run at the same time.

use std::collections::HashMap;
use std::io::Write;
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use std::thread::{self, ThreadId};
use std::time::Instant;

/// Tests at the same time. Every test starts a whole daemon, and all daemons pin their stages to the same cores.
const MAX_TESTS: usize = 4;

/// Threads whose tests run, with the number of turns that each holds.
struct Running {
    threads: Option<HashMap<ThreadId, usize>>,
    /// The test that runs alone.
    alone: Option<ThreadId>,
    /// Tests that wait to run alone; no other test begins before them.
    waiting: usize,
}

static RUNNING: Mutex<Running> = Mutex::new(Running { threads: None, alone: None, waiting: 0 });
static CHANGED: Condvar = Condvar::new();

fn running() -> MutexGuard<'static, Running> {
    RUNNING.lock().unwrap_or_else(PoisonError::into_inner)
}

/// The right to run until it is dropped; with `LOOKOUT_TIMES` set it prints then how long that took.
pub struct Turn {
    thread: ThreadId,
    is_outer: bool,
    start: Instant,
}

/// Waits for a turn beside other tests. A test may take several.
pub fn beside_others() -> Turn {
    let thread = thread::current().id();
    let mut now = running();
    loop {
        let threads = now.threads.get_or_insert_default();
        let is_inner = threads.contains_key(&thread);
        let has_room = threads.len() < MAX_TESTS;
        if is_inner || (has_room && now.alone.is_none() && now.waiting == 0) {
            return take(&mut now, thread);
        }
        now = CHANGED.wait(now).unwrap_or_else(PoisonError::into_inner);
    }
}

/// Waits until no other test runs, and keeps others waiting: for tests that measure times or load the machine.
pub fn alone() -> Turn {
    let thread = thread::current().id();
    let mut now = running();
    assert!(!now.threads.get_or_insert_default().contains_key(&thread), "this test has a turn beside others");
    now.waiting += 1;
    while now.alone.is_some() || !now.threads.get_or_insert_default().is_empty() {
        now = CHANGED.wait(now).unwrap_or_else(PoisonError::into_inner);
    }
    now.waiting -= 1;
    now.alone = Some(thread);
    take(&mut now, thread)
}

fn take(now: &mut Running, thread: ThreadId) -> Turn {
    let turns = now.threads.get_or_insert_default().entry(thread).or_default();
    *turns += 1;
    Turn { thread, is_outer: *turns == 1, start: Instant::now() }
}

impl Drop for Turn {
    fn drop(&mut self) {
        let mut now = running();
        let threads = now.threads.get_or_insert_default();
        let left = threads.get(&self.thread).map_or(0, |turns| turns - 1);
        if left > 0 {
            threads.insert(self.thread, left);
            return;
        }
        threads.remove(&self.thread);
        if now.alone == Some(self.thread) {
            now.alone = None;
        }
        CHANGED.notify_all();
        drop(now);
        if self.is_outer && std::env::var_os("LOOKOUT_TIMES").is_some() {
            let thread = thread::current();
            let text =
                format!("{:6.1} s {}\n", self.start.elapsed().as_secs_f64(), thread.name().unwrap_or("?"));
            // Past libtest, which keeps the output of tests that pass.
            let _ = std::io::stderr().write_all(text.as_bytes());
        }
    }
}
