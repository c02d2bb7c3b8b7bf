//! Jobs that some threads work on.

use crate::command::error::CommandError;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Mutex, PoisonError};

/// Works on all jobs with some threads. The results are in the order of the jobs, whatever the threads; a fault ends all.
///
/// # Errors
/// The first fault, in the order of the jobs.
pub fn in_parallel<J: Sync, R: Send>(
    jobs: &[J],
    threads: u64,
    work: impl Fn(&J) -> Result<R, CommandError> + Sync,
) -> Result<Vec<R>, CommandError> {
    let next = AtomicUsize::new(0);
    let results: Mutex<Vec<(usize, Result<R, CommandError>)>> = Mutex::new(Vec::new());
    let worker = || {
        loop {
            let index = next.fetch_add(1, Ordering::Relaxed);
            let Some(job) = jobs.get(index) else { break };
            let result = work(job);
            if result.is_err() {
                next.store(jobs.len(), Ordering::Relaxed);
            }
            results.lock().unwrap_or_else(PoisonError::into_inner).push((index, result));
        }
    };
    std::thread::scope(|scope| {
        for _ in 1..threads.min(jobs.len() as u64) {
            scope.spawn(worker);
        }
        worker();
    });
    let mut results = results.into_inner().unwrap_or_else(PoisonError::into_inner);
    results.sort_by_key(|(index, _)| *index);
    results.into_iter().map(|(_, result)| result).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn results_are_in_order_and_a_fault_ends_it() {
        let jobs: Vec<u32> = (0..50).collect();
        for threads in [1, 4, 64] {
            assert_eq!(
                in_parallel(&jobs, threads, |job| Ok(2 * job)).ok(),
                Some((0..50).map(|k| 2 * k).collect())
            );
        }
        let fault = |job: &u32| if *job == 7 { Err(CommandError::Other("seven".into())) } else { Ok(*job) };
        assert_eq!(in_parallel(&jobs, 3, fault).unwrap_err().to_string(), "seven");
        assert_eq!(in_parallel(&[], 3, fault).ok(), Some(Vec::new()));
    }
}
