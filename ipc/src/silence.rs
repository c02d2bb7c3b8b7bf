//! Why a daemon that holds its lock sends nothing.

use crate::instance::Instance;
use std::time::Duration;

/// A daemon sends a status once a second; one that sends none for this long is stopped, or hangs.
pub const TIMEOUT: Duration = Duration::from_secs(5);

/// The process of a daemon, for messages.
pub fn process(instance: &Instance) -> String {
    instance.process().map_or_else(|| "process unknown".into(), |pid| format!("process {pid}"))
}

/// Why a daemon is silent, and what helps; `None` if there is none.
pub fn reason(instance: &Instance) -> Option<String> {
    if !instance.is_running() {
        return None;
    }
    let (name, process) = (instance.name(), process(instance));
    Some(match instance.process().filter(|&pid| is_stopped(pid)) {
        Some(pid) => format!(
            "the daemon \"{name}\" ({process}) is stopped (SIGSTOP): it neither detects nor warns: continue it with \
             kill -CONT {pid}, or end it with kill -KILL {pid}"
        ),
        None => format!(
            "the daemon \"{name}\" ({process}) is running, but does not answer: it is starting, or hangs; see its log"
        ),
    })
}

/// Whether a process was stopped by a signal or a debugger.
fn is_stopped(pid: u32) -> bool {
    std::fs::read_to_string(format!("/proc/{pid}/stat"))
        .is_ok_and(|stat| matches!(state(&stat), Some('T' | 't')))
}

/// The state in `/proc/<pid>/stat`, after the name of the program, which is in parentheses and may contain anything.
fn state(stat: &str) -> Option<char> {
    stat.rsplit_once(')')?.1.trim_start().chars().next()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_state_follows_the_name() {
        assert_eq!(state("12 (lookout) T 1 12"), Some('T'));
        assert_eq!(state("12 (a) T (b) S 1 12"), Some('S'));
        assert_eq!((state("12 (lookout)"), state("")), (None, None));
        assert!(!is_stopped(std::process::id()));
    }
}
