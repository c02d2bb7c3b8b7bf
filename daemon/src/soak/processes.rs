//! Processor time, memory and scheduling priority of the daemon's processes, from /proc.

use messages::pipeline::Role;
use std::collections::BTreeMap;

/// Values of one process in /proc.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Reading {
    /// Process id of the parent.
    pub parent: u32,
    /// Processor time, in clock ticks.
    pub ticks: u64,
    /// Scheduling policy, as in sched(7).
    pub policy: u32,
    /// Real-time priority.
    pub priority: u32,
    /// Resident anonymous memory (`RssAnon`).
    pub private_bytes: u64,
    /// Resident pages of mapped files (`RssFile`).
    pub file_bytes: u64,
}

impl Reading {
    /// Reads a process; `None` if it has ended.
    pub fn of(pid: u32) -> Option<Self> {
        let mut reading = parse_stat(&std::fs::read_to_string(format!("/proc/{pid}/stat")).ok()?)?;
        let status = std::fs::read_to_string(format!("/proc/{pid}/status")).ok()?;
        reading.private_bytes = kilobytes(&status, "RssAnon:")?;
        reading.file_bytes = kilobytes(&status, "RssFile:")?;
        Some(reading)
    }

    /// Name of the policy, with the priority of a real-time one.
    pub fn policy(&self) -> String {
        match self.policy {
            0 => "SCHED_OTHER".into(),
            1 => format!("SCHED_FIFO {}", self.priority),
            2 => format!("SCHED_RR {}", self.priority),
            3 => "SCHED_BATCH".into(),
            5 => "SCHED_IDLE".into(),
            6 => "SCHED_DEADLINE".into(),
            other => format!("policy {other}"),
        }
    }
}

/// Parses /proc/PID/stat; the name may contain spaces and parentheses.
fn parse_stat(text: &str) -> Option<Reading> {
    let rest = &text[text.rfind(')')? + 1..];
    let fields: Vec<&str> = rest.split_ascii_whitespace().collect();
    // Numbered as in proc(5), where the state is the third.
    let field = |number: usize| fields.get(number - 3)?.parse::<u64>().ok();
    Some(Reading {
        parent: u32::try_from(field(4)?).ok()?,
        ticks: field(14)? + field(15)?,
        priority: u32::try_from(field(40)?).ok()?,
        policy: u32::try_from(field(41)?).ok()?,
        ..Reading::default()
    })
}

fn kilobytes(status: &str, name: &str) -> Option<u64> {
    let line = status.lines().find_map(|line| line.strip_prefix(name))?;
    Some(line.split_ascii_whitespace().next()?.parse::<u64>().ok()? * 1024)
}

/// Time that the main thread of a process was runnable but waited for a core (run-queue delay), in
/// nanoseconds; `None` without `/proc/PID/schedstat`.
pub fn waited_ns(pid: u32) -> Option<u64> {
    let text = std::fs::read_to_string(format!("/proc/{pid}/schedstat")).ok()?;
    text.split_ascii_whitespace().nth(1)?.parse().ok()
}

/// Processor time of one role, over all its processes so far.
#[derive(Clone, Copy, Debug, Default)]
struct Usage {
    pid: u32,
    /// The previous process: its last reports may still arrive.
    previous_pid: u32,
    /// Processor time of all previous processes.
    before_ns: u64,
    /// Processor time of the current process.
    now_ns: u64,
    reading: Reading,
}

/// Processor time and memory of all roles.
#[derive(Clone, Debug, Default)]
pub struct Processes {
    roles: BTreeMap<Role, Usage>,
}

impl Processes {
    /// Adds a report of a process: its role and processor time. Returns whether the process is new.
    pub fn add_report(&mut self, role: Role, pid: u32, cpu_ns: u64) -> bool {
        let usage = self.roles.entry(role).or_default();
        if pid == usage.previous_pid && pid != 0 {
            return false;
        }
        let is_new = usage.pid != pid;
        if is_new {
            let before_ns = usage.before_ns + usage.now_ns;
            *usage = Usage { pid, previous_pid: usage.pid, before_ns, ..Usage::default() };
        }
        usage.now_ns = usage.now_ns.max(cpu_ns);
        is_new
    }

    /// The current process of a role; `None` if it has not reported yet.
    pub fn pid(&self, role: Role) -> Option<u32> {
        self.roles.get(&role).map(|usage| usage.pid).filter(|&pid| pid != 0)
    }

    /// Reads all processes from /proc; returns whether all of them run.
    pub fn read(&mut self) -> bool {
        let tick_ns = 1_000_000_000 / rustix::param::clock_ticks_per_second().max(1);
        let mut all = true;
        for usage in self.roles.values_mut() {
            match Reading::of(usage.pid) {
                Some(reading) => {
                    usage.now_ns = usage.now_ns.max(reading.ticks * tick_ns);
                    usage.reading = reading;
                }
                None => all = false,
            }
        }
        all
    }

    /// Processor time of a role so far.
    pub fn cpu_ns(&self, role: Role) -> u64 {
        self.roles.get(&role).map_or(0, |usage| usage.before_ns + usage.now_ns)
    }

    /// The last reading of a role.
    pub fn reading(&self, role: Role) -> Reading {
        self.roles.get(&role).map_or_else(Reading::default, |usage| usage.reading)
    }

    /// Private memory of all processes, and the pages of the program, counted once.
    pub fn memory(&self) -> (u64, u64) {
        let readings = || self.roles.values().map(|usage| usage.reading);
        let private = readings().map(|r| r.private_bytes).sum();
        (private, readings().map(|r| r.file_bytes).max().unwrap_or(0))
    }
}

/// Processor time of the whole machine, in clock ticks.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct MachineTime {
    /// All states, including idle.
    pub total: u64,
    /// Neither idle nor stolen.
    pub busy: u64,
    /// Used by the hypervisor for other guests (steal).
    pub stolen: u64,
}

impl MachineTime {
    /// Reads /proc/stat; zeros if it cannot be read.
    pub fn now() -> Self {
        parse_machine(&std::fs::read_to_string("/proc/stat").unwrap_or_default()).unwrap_or_default()
    }

    /// Difference to an earlier reading.
    pub fn since(&self, before: &Self) -> Self {
        Self {
            total: self.total.saturating_sub(before.total),
            busy: self.busy.saturating_sub(before.busy),
            stolen: self.stolen.saturating_sub(before.stolen),
        }
    }
}

fn parse_machine(text: &str) -> Option<MachineTime> {
    let line = text.lines().next()?.strip_prefix("cpu ")?;
    let ticks: Vec<u64> = line.split_ascii_whitespace().filter_map(|v| v.parse().ok()).collect();
    // user, nice, system, idle, iowait, irq, softirq, steal; guest time is included in user.
    let [user, nice, system, idle, iowait, irq, softirq, stolen] = *ticks.first_chunk::<8>()?;
    let busy = user + nice + system + irq + softirq;
    Some(MachineTime { total: busy + idle + iowait + stolen, busy, stolen })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn proc_files_are_parsed() {
        let mut stat = "77 (a b) c) S 5 77 77 0 -1 4194560 1 2 3 4 120 30 0 0 20 0 1 0 9 1 2".to_owned();
        stat.push_str(&" 0".repeat(15));
        stat.push_str(" 30 1 0 0 0");
        let reading = parse_stat(&stat).unwrap();
        assert_eq!((reading.parent, reading.ticks), (5, 150));
        assert_eq!(reading.policy(), "SCHED_FIFO 30", "{reading:?}");
        assert_eq!(parse_stat("77 (a"), None);
        let own = Reading::of(std::process::id()).unwrap();
        assert!(own.private_bytes > 100_000 && own.file_bytes > 0, "{own:?}");
        let machine = parse_machine("cpu  10 20 30 400 5 6 7 8 0 0\ncpu0 1 2\n").unwrap();
        assert_eq!(machine, MachineTime { total: 486, busy: 73, stolen: 8 });
        assert_eq!(parse_machine("cpu  10 20"), None);
        assert!(MachineTime::now().total > 0);
    }

    #[test]
    fn processor_time_outlives_its_process() {
        let mut processes = Processes::default();
        assert!(processes.add_report(Role::Road, 10, 500));
        assert!(!processes.add_report(Role::Road, 10, 700));
        assert!(processes.add_report(Role::Road, 11, 50));
        assert!(!processes.add_report(Role::Road, 10, 800), "last report of the previous process");
        assert_eq!((processes.cpu_ns(Role::Road), processes.pid(Role::Road)), (750, Some(11)));
        assert_eq!((processes.cpu_ns(Role::Stereo), processes.pid(Role::Stereo)), (0, None));
        let own = std::process::id();
        processes.add_report(Role::Road, own, 0);
        assert!(processes.read());
        assert!(processes.memory().0 > 100_000);
        processes.add_report(Role::Stereo, u32::MAX, 0);
        assert!(!processes.read(), "a process that has ended");
    }
}
