//! Cores and memory.

use super::finding::{Finding, text};
use std::path::Path;

/// Stages that run at the same time on pairs that follow each other.
const STAGES: usize = 4;

/// Bytes of a mebibyte.
const MIB: u64 = 1 << 20;

/// Shared memory that a run with pictures of 640×480 takes, with a reserve, in bytes.
const MIN_SHARED: u64 = 64 * MIB;

/// Memory that all processes of such a run take with room to spare, in bytes.
const MIN_FREE: u64 = 256 * MIB;

pub fn findings(root: &Path) -> Vec<Finding> {
    let cores = std::thread::available_parallelism().map_or(1, std::num::NonZero::get);
    let shared = rustix::fs::statvfs(root.join("dev/shm").as_path()).ok().map(|stat| {
        let block = stat.f_frsize;
        (stat.f_blocks.saturating_mul(block), stat.f_bavail.saturating_mul(block))
    });
    let mut all = vec![of_cores(root, cores)];
    all.push(of_memory(&text(root, "proc/meminfo").unwrap_or_default()));
    all.push(of_shared_memory(shared));
    all.into_iter().flatten().collect()
}

fn of_cores(root: &Path, cores: usize) -> Option<Finding> {
    let model = text(root, "proc/device-tree/model").or_else(|| {
        let info = text(root, "proc/cpuinfo")?;
        let line = info.lines().find(|line| line.starts_with("model name"))?;
        Some(line.split_once(':')?.1.trim().to_owned())
    });
    let model = model.map_or_else(String::new, |model| format!(", {}", model.trim_end_matches('\0')));
    let words = format!("{cores} cores for this user, {}{model}", std::env::consts::ARCH);
    Some(if cores >= STAGES {
        Finding::good("processor", words)
    } else {
        let remedy = "give stages that take little time the same core in [cores], and lower camera.fps if frames are dropped";
        Finding::note("processor", format!("{words}: the {STAGES} stages share them"), remedy)
    })
}

fn of_memory(meminfo: &str) -> Option<Finding> {
    let of = |name: &str| -> Option<u64> {
        let line = meminfo.lines().find_map(|line| line.strip_prefix(name))?;
        Some(line.trim_start_matches(':').trim().trim_end_matches(" kB").parse::<u64>().ok()? * 1024)
    };
    let (total, free) = (of("MemTotal")?, of("MemAvailable")?);
    let words = format!("{} MiB, {} MiB available", total / MIB, free / MIB);
    Some(if free >= MIN_FREE {
        Finding::good("memory", words)
    } else {
        let remedy = "end other programs, or lower stereo.disparities and the picture size";
        Finding::problem("memory", words, remedy)
    })
}

fn of_shared_memory(shared: Option<(u64, u64)>) -> Option<Finding> {
    let Some((total, free)) = shared else {
        let remedy = "mount it: mount -t tmpfs tmpfs /dev/shm";
        return Some(Finding::problem("memory", "there is no /dev/shm, through which frames travel", remedy));
    };
    let words = format!("/dev/shm: {} MiB, {} MiB free", total / MIB, free / MIB);
    Some(if free >= MIN_SHARED {
        Finding::good("memory", words)
    } else {
        let remedy = "enlarge it: mount -o remount,size=256M /dev/shm; in a container: --shm-size 512m";
        Finding::problem("memory", words, remedy)
    })
}

#[cfg(test)]
mod tests {
    use super::super::finding::Level;
    use super::*;

    #[test]
    fn little_memory_is_a_problem_with_a_remedy() {
        let info = |kb: u64| format!("MemTotal:       4000000 kB\nMemFree: 1 kB\nMemAvailable:   {kb} kB\n");
        assert_eq!(of_memory(&info(1_000_000)).unwrap().level, Level::Good);
        assert_eq!(of_memory(&info(100_000)).unwrap().level, Level::Problem);
        assert_eq!(of_memory("nothing"), None);
        let shared = of_shared_memory(Some((64 * MIB, 10 * MIB))).unwrap();
        assert!(shared.level == Level::Problem && shared.remedy.unwrap().contains("--shm-size"));
        assert_eq!(of_shared_memory(None).unwrap().level, Level::Problem);
        assert_eq!(of_shared_memory(Some((512 * MIB, 400 * MIB))).unwrap().level, Level::Good);
    }
}
