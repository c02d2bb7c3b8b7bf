//! The daemon under test: a child process with a separate instance.

use super::error::SoakError;
use config::Config;
use messages::bus::Bus;
use messages::clock::monotonic_ns;
use messages::instance::Instance;
use messages::run_files::RunPrefix;
use rustix::process::{Pid, Signal, kill_process};
use std::fs::File;
use std::os::unix::process::CommandExt;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// Time limit for the daemon to open its shared memory.
const START_TIMEOUT: Duration = Duration::from_secs(30);

/// Time limit for the daemon to stop; longer than its drain and the grace of its stages.
const STOP_TIMEOUT: Duration = Duration::from_secs(60);

/// Period of checks while waiting.
const CHECK_PERIOD: Duration = Duration::from_millis(5);

/// A running daemon; killed on drop.
pub struct DaemonChild {
    child: Child,
    /// Its instance.
    pub instance: Instance,
    /// Start time on the monotonic clock.
    pub started_ns: u64,
    log: PathBuf,
}

impl DaemonChild {
    /// Writes `daemon.toml` to a folder and starts the daemon with it; its log goes to `daemon.log`.
    pub fn start(config: &Config, folder: &Path) -> Result<Self, SoakError> {
        let (file, log) = (folder.join("daemon.toml"), folder.join("daemon.log"));
        let text = toml::to_string(config).map_err(|e| SoakError::Config(e.to_string()))?;
        std::fs::write(&file, text).map_err(SoakError::io(&file))?;
        let errors = File::create(&log).map_err(SoakError::io(&log))?;
        let started_ns = monotonic_ns();
        // The running program, even if its file was replaced by an upgrade.
        let child = Command::new("/proc/self/exe")
            .arg0("lookout")
            .args(["run", "--with-parent", "-c"])
            .arg(&file)
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .stderr(errors)
            // Variables that systemd set for this process do not apply to the child.
            .env_remove("NOTIFY_SOCKET")
            .env_remove("WATCHDOG_USEC")
            .env_remove("WATCHDOG_PID")
            .env_remove("JOURNAL_STREAM")
            // Its own process group: Ctrl-C reaches only the soak, which then stops the daemon in order.
            .process_group(0)
            .spawn()
            .map_err(SoakError::io(Path::new("/proc/self/exe")))?;
        let instance = Instance::new(&config.instance.name, &config.instance.directory);
        Ok(Self { child, instance, started_ns, log })
    }

    /// Its process id.
    pub fn pid(&self) -> u32 {
        self.child.id()
    }

    /// Connects to the daemon as soon as its shared memory exists. Also returns the prefix of its run.
    pub fn join(&mut self, stop: &AtomicBool) -> Result<(Bus, RunPrefix), SoakError> {
        let start = Instant::now();
        loop {
            self.expect_running()?;
            if let Some(prefix) = self.instance.prefix()
                && let Ok(bus) = Bus::join(&self.instance)
            {
                return Ok((bus, prefix));
            }
            if stop.load(Ordering::Relaxed) {
                return Err(SoakError::Stopped);
            }
            if start.elapsed() > START_TIMEOUT {
                return Err(SoakError::Silent(self.log_tail()));
            }
            std::thread::sleep(CHECK_PERIOD);
        }
    }

    /// Fails if the daemon has ended.
    pub fn expect_running(&mut self) -> Result<(), SoakError> {
        match self.child.try_wait().map_err(SoakError::io(&self.log))? {
            Some(status) => Err(SoakError::Ended(status, self.log_tail())),
            None => Ok(()),
        }
    }

    /// The last three lines of its log.
    pub fn log_tail(&self) -> String {
        let text = std::fs::read(&self.log).unwrap_or_default();
        let text = String::from_utf8_lossy(&text[text.len().saturating_sub(4096)..]).into_owned();
        let lines: Vec<&str> = text.lines().collect();
        let last = lines[lines.len().saturating_sub(3)..].join("\n  ");
        format!("{}:\n  {last}", self.log.display())
    }

    /// Sends SIGTERM and waits for the end of the daemon.
    pub fn stop(mut self) -> Result<ExitStatus, SoakError> {
        self.expect_running()?;
        if let Some(pid) = Pid::from_raw(self.child.id() as i32) {
            kill_process(pid, Signal::TERM).map_err(|e| SoakError::io(&self.log)(e.into()))?;
        }
        let start = Instant::now();
        loop {
            if let Some(status) = self.child.try_wait().map_err(SoakError::io(&self.log))? {
                return Ok(status);
            }
            if start.elapsed() > STOP_TIMEOUT {
                return Err(SoakError::Endless(STOP_TIMEOUT));
            }
            std::thread::sleep(CHECK_PERIOD);
        }
    }
}

impl Drop for DaemonChild {
    fn drop(&mut self) {
        if matches!(self.child.try_wait(), Ok(None)) {
            let _ = self.child.kill();
            let _ = self.child.wait();
        }
    }
}
