//! Limits and permissions of this user, time, programs, and whether a daemon runs.

use super::finding::{Finding, text};
use config::Config;
use messages::instance::Instance;
use messages::user;
use rustix::process::{Resource, geteuid, getrlimit};
use std::path::Path;
use std::time::{SystemTime, UNIX_EPOCH};

/// The highest real-time priority that a stage may request, as in the service's unit.
const PRIORITY: u64 = 55;

/// Memory that a stage may lock, in bytes, as in the service's unit.
const LOCKED_BYTES: u64 = 256 << 20;

/// 1 January 2025 in seconds since 1970: a clock before that was never set.
const MIN_TIME_S: u64 = 1_735_689_600;

/// Clock sources that are read without a call of the kernel.
const FAST_CLOCKS: [&str; 4] = ["tsc", "arch_sys_counter", "kvm-clock", "hyperv_clocksource_tsc_page"];

pub fn findings(root: &Path, config: &Config) -> Vec<Finding> {
    vec![
        of_limits(config),
        of_kernel(root),
        of_folder(config),
        of_clock(root),
        of_time(root),
        of_programs(),
        of_daemon(root, config),
    ]
}

/// Whether this process has a capability, by its number.
fn has_capability(status: &str, number: u32) -> bool {
    let line = status.lines().find_map(|line| line.strip_prefix("CapEff:"));
    line.and_then(|mask| u64::from_str_radix(mask.trim(), 16).ok())
        .is_some_and(|mask| mask >> number & 1 == 1)
}

fn of_limits(config: &Config) -> Finding {
    /// CAP_IPC_LOCK and CAP_SYS_NICE.
    const LOCK: u32 = 14;
    const NICE: u32 = 23;
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let limit = |resource| getrlimit(resource).current.unwrap_or(u64::MAX);
    let may_schedule = has_capability(&status, NICE) || limit(Resource::Rtprio) >= PRIORITY;
    let may_lock = has_capability(&status, LOCK) || limit(Resource::Memlock) >= LOCKED_BYTES;
    let words = |may: bool| if may { "allowed" } else { "refused" };
    let text =
        format!("real-time priority {PRIORITY} {}, locked memory {}", words(may_schedule), words(may_lock));
    if may_schedule && may_lock {
        return Finding::good("limits", text);
    }
    let remedy = "the service has both (lookout.service); by hand: LimitRTPRIO and LimitMEMLOCK, or lines for rtprio and \
                  memlock in /etc/security/limits.d";
    let realtime = &config.realtime;
    let is_required = (!may_schedule && realtime.scheduling == "require")
        || (!may_lock && realtime.memory_lock == "require");
    if is_required { Finding::problem("limits", text, remedy) } else { Finding::note("limits", text, remedy) }
}

fn of_kernel(root: &Path) -> Finding {
    let version = text(root, "proc/sys/kernel/osrelease").unwrap_or_else(|| "unknown".into());
    let is_realtime = text(root, "sys/kernel/realtime").as_deref() == Some("1");
    let kind = if is_realtime { "PREEMPT_RT" } else { "not PREEMPT_RT: single frames may be late" };
    Finding::good("kernel", format!("Linux {version}, {kind}"))
}

fn of_folder(config: &Config) -> Finding {
    let instance = Instance::find(&config.instance.name, &config.instance.directory);
    let user = user::told(geteuid().as_raw());
    match instance.check_owner() {
        Ok(()) => Finding::good("permissions", format!("user {user}, daemons in {}", base(&instance))),
        Err(error) => {
            let remedy = "run lookout as that user (sudo -u), or give another folder with instance.directory";
            Finding::note("permissions", format!("user {user}: {error}"), remedy)
        }
    }
}

fn base(instance: &Instance) -> String {
    instance.directory().parent().unwrap_or(Path::new("/")).display().to_string()
}

fn of_clock(root: &Path) -> Finding {
    let file = "sys/devices/system/clocksource/clocksource0/current_clocksource";
    match text(root, file) {
        Some(name) if FAST_CLOCKS.contains(&&name[..]) => {
            Finding::good("time", format!("clock source {name}"))
        }
        Some(name) => {
            let remedy = "reading it is slow: look for another in available_clocksource beside it";
            Finding::note("time", format!("clock source {name}"), remedy)
        }
        None => Finding::good("time", "clock source not told by this kernel"),
    }
}

fn of_time(root: &Path) -> Finding {
    let now_s = SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |time| time.as_secs());
    if now_s < MIN_TIME_S {
        let remedy = "set the clock (timedatectl set-ntp true): names and times of recordings follow it; measurements do not";
        return Finding::note("time", "the calendar is not set", remedy);
    }
    if root.join("run/systemd/timesync/synchronized").exists() {
        return Finding::good("time", "the calendar is synchronised");
    }
    Finding::good("time", "the calendar is set; whether it is synchronised is not known here")
}

/// Programs that some commands call.
fn of_programs() -> Finding {
    let path = std::env::var_os("PATH").unwrap_or_default();
    let has = |name: &str| std::env::split_paths(&path).any(|folder| folder.join(name).is_file());
    match (has("ffmpeg"), has("gst-launch-1.0")) {
        (true, _) => Finding::good("programs", "ffmpeg: videos can be written and read"),
        (false, true) if cfg!(feature = "gstreamer") => {
            Finding::good("programs", "GStreamer: videos can be written and read")
        }
        (false, true) => {
            let text = "gst-launch-1.0, no ffmpeg: videos can be written, but not read";
            Finding::note("programs", text, "apt install ffmpeg, to replay videos")
        }
        (false, false) if cfg!(feature = "gstreamer") => {
            let text = "GStreamer is built in: videos can be read; lookout replay --video writes .gif only";
            Finding::note("programs", text, "apt install ffmpeg, to write other videos")
        }
        (false, false) => {
            let remedy = "apt install ffmpeg; without it videos cannot be read, and lookout replay --video writes .gif only";
            Finding::note("programs", "neither ffmpeg nor gst-launch-1.0", remedy)
        }
    }
}

fn of_daemon(root: &Path, config: &Config) -> Finding {
    let instance = Instance::find(&config.instance.name, &config.instance.directory);
    let unit = ["usr/lib/systemd/system/lookout.service", "etc/systemd/system/lookout.service"];
    let is_installed = unit.iter().any(|file| root.join(file).exists());
    let service = if is_installed { "the service is installed" } else { "the service is not installed" };
    let running = if instance.is_running() { "runs" } else { "does not run" };
    Finding::good("daemon", format!("\"{}\" {running}; {service}", instance.name()))
}

#[cfg(test)]
mod tests {
    use super::super::finding::Level;
    use super::*;

    #[test]
    fn capabilities_are_read_from_their_mask() {
        let status = "Name:\tlookout\nCapEff:\t0000000000804000\n";
        assert!(has_capability(status, 14) && has_capability(status, 23));
        assert!(!has_capability(status, 0) && !has_capability("", 23) && !has_capability("CapEff: x", 1));
    }

    #[test]
    fn a_slow_clock_is_a_note() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("sys/devices/system/clocksource/clocksource0");
        std::fs::create_dir_all(&path).unwrap();
        assert_eq!(of_clock(folder.path()).level, Level::Good);
        for (name, level) in [("tsc\n", Level::Good), ("acpi_pm\n", Level::Note)] {
            std::fs::write(path.join("current_clocksource"), name).unwrap();
            assert_eq!(of_clock(folder.path()).level, level, "{name}");
        }
    }
}
