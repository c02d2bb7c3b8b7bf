//! The stage processes as children of the scheduler.

use super::notify::VARIABLES;
use crate::launch::Launch;
use messages::pipeline::Role;
use rustix::process::{Pid, Signal, kill_process};
use signal_hook::consts::{SIGABRT, SIGBUS, SIGKILL, SIGSEGV, SIGXCPU};
use std::io::{self, Write};
use std::os::unix::process::{CommandExt, ExitStatusExt};
use std::process::{Child, Command, ExitStatus, Stdio};

/// All stage processes that were started and not yet reaped.
#[derive(Debug, Default)]
pub struct Children {
    running: Vec<(Role, Child)>,
}

impl Children {
    /// Starts a stage and writes its launch document to its standard input. Returns its process id.
    ///
    /// # Errors
    /// If the process cannot be started.
    pub fn spawn(&mut self, role: Role, launch: &Launch) -> io::Result<u32> {
        let document = launch.text().map_err(io::Error::other)?;
        // The running program, even if an upgrade has replaced its file.
        let mut child = Command::new("/proc/self/exe")
            .arg0("lookout")
            .args(["stage", role.name()])
            // Only the scheduler notifies systemd.
            .env_remove(VARIABLES[0])
            .env_remove(VARIABLES[1])
            .env_remove(VARIABLES[2])
            .stdin(Stdio::piped())
            .stdout(Stdio::null())
            // A separate process group, so that Ctrl-C in a terminal reaches only the scheduler.
            .process_group(0)
            .spawn()?;
        let pid = child.id();
        if let Some(mut stdin) = child.stdin.take()
            && let Err(error) = stdin.write_all(document.as_bytes())
        {
            // It died immediately; its exit status gives the reason.
            tracing::debug!(%role, %error, "the launch document was not read");
        }
        self.running.push((role, child));
        Ok(pid)
    }

    /// Process id of a role until its process is reaped.
    pub fn pid(&self, role: Role) -> Option<u32> {
        self.running.iter().find(|(r, _)| *r == role).map(|(_, child)| child.id())
    }

    /// Asks a stage to stop (SIGTERM).
    pub fn terminate(&self, role: Role) {
        self.signal(role, Signal::TERM);
    }

    /// Kills a stage (SIGKILL).
    pub fn kill(&self, role: Role) {
        self.signal(role, Signal::KILL);
    }

    fn signal(&self, role: Role, signal: Signal) {
        // An unreaped child keeps its process id, so the signal cannot reach another process.
        if let Some(pid) = self.pid(role).and_then(|pid| Pid::from_raw(pid as i32))
            && let Err(error) = kill_process(pid, signal)
        {
            tracing::debug!(%role, %error, "the signal was not delivered");
        }
    }

    /// Reaps the children that have ended, each with a description of its exit.
    pub fn reap(&mut self) -> Vec<(Role, String)> {
        let mut ended = Vec::new();
        self.running.retain_mut(|(role, child)| match child.try_wait() {
            Ok(None) => true,
            Ok(Some(status)) => {
                ended.push((*role, describe(status)));
                false
            }
            Err(error) => {
                ended.push((*role, format!("cannot be waited for: {error}")));
                false
            }
        });
        ended
    }
}

impl Drop for Children {
    /// Kills all stages, so that none outlives the scheduler.
    fn drop(&mut self) {
        for (_, child) in &mut self.running {
            let _ = child.kill();
            let _ = child.wait();
        }
    }
}

/// Usual cause of a signal from the kernel or the runtime.
fn hint(signal: i32) -> &'static str {
    match signal {
        SIGABRT => {
            " (SIGABRT: it aborted, for example because it ran out of memory; see its last lines in the log)"
        }
        SIGBUS => " (SIGBUS: is /dev/shm full?)",
        SIGKILL => " (SIGKILL: by the scheduler, a user, or the kernel because memory was short)",
        SIGSEGV => " (SIGSEGV)",
        SIGXCPU => " (SIGXCPU: it ran for longer than realtime.budget_ms without sleeping)",
        _ => "",
    }
}

fn describe(status: ExitStatus) -> String {
    match (status.code(), status.signal()) {
        (Some(code), _) => format!("exited with code {code}"),
        (None, Some(signal)) => format!("was killed by signal {signal}{}", hint(signal)),
        (None, None) => "ended".into(),
    }
}
