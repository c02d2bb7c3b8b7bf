//! The daemon that is soaked: a child process with an instance of its own.

use super::error::SoakError;
use config::Config;
use messages::bus::Bus;
use messages::clock::monotonic_ns;
use messages::instance::Instance;
use rustix::process::{Pid, Signal, kill_process};
use std::fs::File;
use std::os::unix::process::CommandExt;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// How long the daemon may take to open its shared memory.
const OPENING: Duration = Duration::from_secs(30);

/// How long it may take to end: its drain, its grace and some more.
const ENDING: Duration = Duration::from_secs(60);

/// How often it is looked at meanwhile.
const LOOK: Duration = Duration::from_millis(5);

/// A running daemon; killed when it is dropped.
pub struct DaemonChild {
    child: Child,
    /// Its instance.
    pub instance: Instance,
    /// When it was started.
    pub started_ns: u64,
    log: PathBuf,
}

impl DaemonChild {
    /// Writes `daemon.toml` to a folder and starts the daemon with it; what it logs goes to
    /// `daemon.log`.
    pub fn start(config: &Config, folder: &Path) -> Result<Self, SoakError> {
        let (file, log) = (folder.join("daemon.toml"), folder.join("daemon.log"));
        let text = toml::to_string(config).map_err(|e| SoakError::Config(e.to_string()))?;
        std::fs::write(&file, text).map_err(SoakError::io(&file))?;
        let errors = File::create(&log).map_err(SoakError::io(&log))?;
        let started_ns = monotonic_ns();
        // This very program, even when its file was replaced by an upgrade.
        let child = Command::new("/proc/self/exe")
            .arg0("lookout")
            .args(["run", "--with-parent", "-c"])
            .arg(&file)
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .stderr(errors)
            // What systemd tells this process is not for that one.
            .env_remove("NOTIFY_SOCKET")
            .env_remove("WATCHDOG_USEC")
            .env_remove("WATCHDOG_PID")
            .env_remove("JOURNAL_STREAM")
            // Ctrl-C in a terminal reaches the soak alone, which ends it in order.
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

    /// Joins it once its shared memory is there. Gives the prefix of its run, too.
    pub fn join(&mut self, stop: &AtomicBool) -> Result<(Bus, String), SoakError> {
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
            if start.elapsed() > OPENING {
                return Err(SoakError::Silent(self.last_words()));
            }
            std::thread::sleep(LOOK);
        }
    }

    /// Says so when it has ended.
    pub fn expect_running(&mut self) -> Result<(), SoakError> {
        match self.child.try_wait().map_err(SoakError::io(&self.log))? {
            Some(status) => Err(SoakError::Ended(status, self.last_words())),
            None => Ok(()),
        }
    }

    /// The end of its log.
    pub fn last_words(&self) -> String {
        let text = std::fs::read(&self.log).unwrap_or_default();
        let text = String::from_utf8_lossy(&text[text.len().saturating_sub(4096)..]).into_owned();
        let lines: Vec<&str> = text.lines().collect();
        let last = lines[lines.len().saturating_sub(3)..].join("\n  ");
        format!("{}:\n  {last}", self.log.display())
    }

    /// Asks it to stop and waits until it has.
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
            if start.elapsed() > ENDING {
                return Err(SoakError::Endless(ENDING));
            }
            std::thread::sleep(LOOK);
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
