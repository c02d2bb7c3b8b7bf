//! The threads of a matcher. They live as long as it, because starting a thread for each step of a frame takes longer
//! than a coarse scale.

use rayon::{ThreadPool, ThreadPoolBuildError, ThreadPoolBuilder};
use std::cell::RefCell;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::sync::atomic::Ordering::Relaxed;
use thiserror::Error;

/// The threads were not started.
#[derive(Debug, Error)]
#[error("the matcher's threads could not be started: {0}")]
pub struct CrewError(#[from] ThreadPoolBuildError);

thread_local! {
    /// The crew that this thread leads. A thread cannot lead another one.
    static LED: RefCell<Crew> = RefCell::default();
}

/// Threads that work on one frame together. Clones share them.
#[derive(Clone, Debug, Default)]
pub struct Crew {
    /// `None`: the calling thread works alone.
    pool: Option<Arc<ThreadPool>>,
}

impl Crew {
    /// A crew of `threads` threads. The calling thread is one of them and leads: threads that are woken by a thread that
    /// then sleeps land on one core, if they are not pinned. Each of the others calls `start` with its number, from 1,
    /// before its first work: to be pinned to a core, say.
    ///
    /// A thread keeps its crew until it ends: called again for as many threads, it gets the same crew, without `start`.
    ///
    /// # Errors
    /// If the system refuses a thread.
    pub fn new(threads: usize, start: impl Fn(usize) + Send + Sync + 'static) -> Result<Self, CrewError> {
        if threads <= 1 {
            return Ok(Self::default());
        }
        let led = LED.with_borrow(Clone::clone);
        if led.threads() == threads {
            return Ok(led);
        }
        let builder = ThreadPoolBuilder::new()
            .num_threads(threads)
            .thread_name(|number| format!("matcher-{number}"))
            .start_handler(start);
        if led.pool.is_some() {
            // Of another size, and led by one of its own threads, number 0.
            return Ok(Self { pool: Some(Arc::new(builder.build()?)) });
        }
        let pool = builder.use_current_thread().build()?;
        // Looks for work once, for which a thread gets memory the first time.
        pool.yield_now();
        let crew = Self { pool: Some(Arc::new(pool)) };
        LED.set(crew.clone());
        Ok(crew)
    }

    /// Number of threads.
    pub fn threads(&self) -> usize {
        self.pool.as_ref().map_or(1, |pool| pool.current_num_threads())
    }

    /// Does `work` on a thread of the crew, so that what it divides reaches the others. One of them stays awake meanwhile:
    /// the steps of a frame follow each other faster than a sleeping thread wakes up.
    pub fn lead<R: Send>(&self, work: impl FnOnce() -> R + Send) -> R {
        let Some(pool) = &self.pool else { return work() };
        let done = AtomicBool::new(false);
        // Done at once by the thread that leads the crew.
        pool.install(|| {
            let end = End(&done);
            both(
                move || {
                    let _end = end;
                    work()
                },
                || stay_awake(&done),
            )
            .0
        })
    }
}

/// Sets its flag when the work ends, even by a panic.
struct End<'a>(&'a AtomicBool);

impl Drop for End<'_> {
    fn drop(&mut self) {
        self.0.store(true, Relaxed);
    }
}

/// Does what others leave to this thread until `done`. There is one such task in a crew: it is the oldest, and so the first
/// that another thread takes. The leader, which waits for others within its own work, never takes it before it is done.
fn stay_awake(done: &AtomicBool) {
    while !done.load(Relaxed) {
        if rayon::yield_now() != Some(rayon::Yield::Executed) {
            // Not a busy loop: the leader itself may wait for this core.
            std::thread::yield_now();
        }
    }
}

/// Does two works at the same time, if another thread of the crew is free. Only below [`Crew::lead`] of a crew of several
/// threads.
pub(super) fn both<A: Send, B: Send>(a: impl FnOnce() -> A + Send, b: impl FnOnce() -> B + Send) -> (A, B) {
    rayon::join(a, b)
}

/// [`both`] if `share`, else one after the other on this thread.
pub(super) fn both_if<A: Send, B: Send>(
    share: bool,
    a: impl FnOnce() -> A + Send,
    b: impl FnOnce() -> B + Send,
) -> (A, B) {
    if share { both(a, b) } else { (a(), b()) }
}

/// First row of part `i` of `parts` that share `height` rows evenly.
pub(super) fn first_row(height: usize, i: usize, parts: usize) -> usize {
    height * i / parts
}

/// Does `work` with each of `parts` and its share of the rows of `map` ([`first_row`]), at the same time.
pub(super) fn in_bands<P: Send, T: Send>(
    parts: &mut [P],
    map: &mut [T],
    width: usize,
    work: &(impl Fn(&mut P, &mut [T]) + Sync),
) {
    let (height, count) = (map.len() / width, parts.len());
    divide(parts, map, 0, &|i| first_row(height, i, count) * width, work);
}

/// [`in_bands`] for the parts from `first` on; `start` tells where a part starts in the whole map.
fn divide<P: Send, T: Send>(
    parts: &mut [P],
    map: &mut [T],
    first: usize,
    start: &(impl Fn(usize) -> usize + Sync),
    work: &(impl Fn(&mut P, &mut [T]) + Sync),
) {
    match parts {
        [] => {}
        [alone] => work(alone, map),
        several => {
            let middle = first + several.len() / 2;
            let (upper, lower) = several.split_at_mut(middle - first);
            let (above, below) = map.split_at_mut(start(middle) - start(first));
            both(|| divide(upper, above, first, start, work), || divide(lower, below, middle, start, work));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::panic::{AssertUnwindSafe, catch_unwind};
    use std::sync::Barrier;

    #[test]
    fn all_threads_of_a_crew_work_and_each_row_is_worked_on_once() {
        for threads in [1, 2, 3, 5] {
            let crew = Crew::new(threads, |_| ()).unwrap();
            assert_eq!(crew.threads(), threads);
            for height in [0, 1, 4, 13] {
                let (mut parts, mut map) = (vec![0; threads], vec![0; 7 * height]);
                crew.lead(|| {
                    in_bands(&mut parts, &mut map, 7, &|part, band| {
                        *part += band.len();
                        band.iter_mut().for_each(|value| *value += 1);
                    });
                });
                assert!(map.iter().all(|&value| value == 1));
                assert!(parts.iter().all(|part| part % 7 == 0 && part.abs_diff(7 * height / threads) < 7));
            }
        }
        // Both at the same time, or neither gets past the barrier.
        let barrier = Barrier::new(2);
        let crew = Crew::new(2, |_| ()).unwrap();
        crew.lead(|| both(|| barrier.wait(), || barrier.wait()));
    }

    #[test]
    fn a_thread_keeps_its_crew_and_may_use_others() {
        let crew = Crew::new(2, |_| ()).unwrap();
        let again = Crew::new(2, |_| unreachable!("the threads have started before")).unwrap();
        assert!(Arc::ptr_eq(crew.pool.as_ref().unwrap(), again.pool.as_ref().unwrap()));
        let here = std::thread::current().id();
        assert_eq!(crew.lead(|| std::thread::current().id()), here, "the calling thread leads");
        let larger = Crew::new(3, |_| ()).unwrap();
        assert_eq!(larger.lead(|| both(|| 1, || 2)), (1, 2));
        // Led by a thread that does not belong to it.
        let elsewhere = std::thread::spawn(move || crew.lead(|| both(|| 1, || 2)));
        assert_eq!(elsewhere.join().unwrap(), (1, 2));
    }

    #[test]
    fn a_panic_ends_the_work_and_not_the_crew() {
        let crew = Crew::new(2, |_| ()).unwrap();
        for culprit in 0..2 {
            let ended = catch_unwind(AssertUnwindSafe(|| {
                crew.lead(|| both(|| assert!(culprit != 0, "expected"), || assert!(culprit != 1, "expected")))
            }));
            assert!(ended.is_err());
            assert_eq!(crew.lead(|| both(|| 1, || 2)), (1, 2));
        }
    }
}
