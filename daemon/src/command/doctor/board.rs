//! GPU, thermal zones and clocks.

use super::finding::{Finding, entries, text};
use crate::scheduler::sysfs::{Sensors, Sysfs};
use config::Config;
use std::path::Path;

/// Device files of GPUs: of DRM, NVIDIA's driver, and the Jetsons.
const GPU_FILES: [&str; 4] = ["dri/renderD", "nvidia", "nvhost-gpu", "nvgpu"];

pub fn findings(root: &Path, config: &Config) -> Vec<Finding> {
    let mut all = vec![of_gpu(root)];
    all.push(of_heat(&root.join("sys"), config));
    all.push(of_clocks(root, config));
    all
}

fn of_gpu(root: &Path) -> Finding {
    let files: Vec<String> = GPU_FILES
        .iter()
        .flat_map(|start| {
            let (folder, start) = start
                .rsplit_once('/')
                .map_or(("dev".into(), *start), |(folder, start)| (format!("dev/{folder}"), start));
            entries(root, &folder, start)
        })
        .map(|path| path.display().to_string())
        .collect();
    let there = if files.is_empty() { "no device file".to_owned() } else { files.join(", ") };
    if cfg!(not(feature = "gpu")) {
        let text = format!("this build matches on the CPU; {there}");
        return match files.is_empty() {
            true => Finding::good("gpu", text),
            false => Finding::note("gpu", text, "to use it build with --features gpu: docs/gpu.md"),
        };
    }
    match adapters() {
        found if found.is_empty() => {
            let remedy = "install its Vulkan driver (mesa-vulkan-drivers) and give this user its group (render); \
                          without it stereo runs on the CPU";
            Finding::note("gpu", format!("no Vulkan adapter; {there}"), remedy)
        }
        found => Finding::good("gpu", found.join("; ")),
    }
}

#[cfg(feature = "gpu")]
fn adapters() -> Vec<String> {
    let all = perception::stereo::gpu::adapters().into_iter();
    all.map(|adapter| format!("{} ({}, {})", adapter.name, adapter.kind, adapter.driver)).collect()
}

#[cfg(not(feature = "gpu"))]
fn adapters() -> Vec<String> {
    Vec::new()
}

fn of_heat(sysfs: &Path, config: &Config) -> Finding {
    let tree = Sysfs::new(sysfs);
    let zones = Sensors::find(&tree, "*");
    let mut readings = Vec::new();
    zones.read(&mut readings);
    let words: Vec<String> = zones
        .names()
        .iter()
        .zip(&readings)
        .map(|(name, reading)| match reading {
            Some(celsius) => format!("{name} {:.0} °C", celsius.0),
            None => format!("{name} cannot be read"),
        })
        .collect();
    let is_required = config.heat.watch == "require";
    if words.is_empty() {
        let text = "no thermal zone in /sys/class/thermal";
        let remedy =
            "the daemon cannot shed load as temperature rises: set heat.watch = \"prefer\" or \"off\"";
        return match is_required {
            true => Finding::problem("heat", text, remedy),
            false => Finding::note(
                "heat",
                text,
                "nothing to do on a virtual machine; on a board the kernel lacks its sensors",
            ),
        };
    }
    let watched = Sensors::find(&tree, &config.heat.zones);
    if config.heat.watch != "off" && watched.names().is_empty() {
        let text = format!("{}; none matches heat.zones = \"{}\"", words.join(", "), config.heat.zones);
        let remedy = "name some of these in heat.zones, or take the profile of this board";
        return match is_required {
            true => Finding::problem("heat", text, remedy),
            false => Finding::note("heat", text, remedy),
        };
    }
    Finding::good("heat", words.join(", "))
}

fn of_clocks(root: &Path, config: &Config) -> Finding {
    let policies = entries(root, "sys/devices/system/cpu/cpufreq", "policy");
    let describe = |policy: &std::path::PathBuf| {
        let of = |file: &str| text(policy, file);
        let mhz = |file: &str| Some(of(file)?.parse::<u64>().ok()? / 1000);
        let name = policy.file_name()?.to_string_lossy().replace("policy", "cpu");
        let [now, most] = [mhz("scaling_cur_freq"), mhz("scaling_max_freq")]
            .map(|mhz| mhz.map_or("?".into(), |mhz| mhz.to_string()));
        Some(format!("{name} {now} of {most} MHz, {}", of("scaling_governor").unwrap_or_default()))
    };
    let words: Vec<String> = policies.iter().filter_map(describe).collect();
    let is_set = config.clocks.set != "off";
    if words.is_empty() {
        let text = "no cpufreq in /sys: the clocks cannot be set";
        return match is_set {
            true => Finding::note("clocks", text, "set clocks.set = \"off\""),
            false => Finding::good("clocks", text),
        };
    }
    let words = words.join("; ");
    let may = policies.iter().all(|policy| {
        rustix::fs::access(policy.join("scaling_max_freq").as_path(), rustix::fs::Access::WRITE_OK).is_ok()
    });
    if is_set && !may {
        let remedy = "the Debian package gives the group lookout this permission (tmpfiles.d): run the daemon as its service";
        return Finding::note("clocks", format!("{words}; this user may not set them"), remedy);
    }
    if !is_set && (words.contains("powersave") || words.contains("ondemand")) {
        let remedy = "times vary with the clock: fix it with [clocks] set and cpu_mhz (docs/operations.md)";
        return Finding::note("clocks", words, remedy);
    }
    Finding::good("clocks", words)
}

#[cfg(test)]
mod tests {
    use super::super::finding::Level;
    use super::*;

    fn write(root: &Path, file: &str, content: &str) {
        let path = root.join(file);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(path, content).unwrap();
    }

    #[test]
    fn sensors_are_read_and_those_that_are_configured_have_to_be_there() {
        let folder = tempfile::tempdir().unwrap();
        let mut config = Config::default();
        config.heat.watch = "require".into();
        config.heat.zones = "cpu*".into();
        let of = |config: &Config| of_heat(&folder.path().join("sys"), config);
        assert_eq!(of(&config).level, Level::Problem);
        write(folder.path(), "sys/class/thermal/thermal_zone0/type", "gpu-thermal\n");
        write(folder.path(), "sys/class/thermal/thermal_zone0/temp", "61500\n");
        let found = of(&config);
        assert!(found.level == Level::Problem && found.text.contains("heat.zones"), "{found}");
        config.heat.zones = "gpu*".into();
        let found = of(&config);
        assert!(found.level == Level::Good && found.text.contains("gpu-thermal 62 °C"), "{found}");
    }

    #[test]
    fn clocks_are_told_with_their_governor() {
        let folder = tempfile::tempdir().unwrap();
        assert_eq!(of_clocks(folder.path(), &Config::default()).level, Level::Good);
        let policy = "sys/devices/system/cpu/cpufreq/policy0/";
        write(folder.path(), &format!("{policy}scaling_cur_freq"), "600000\n");
        write(folder.path(), &format!("{policy}scaling_max_freq"), "2400000\n");
        write(folder.path(), &format!("{policy}scaling_governor"), "ondemand\n");
        let found = of_clocks(folder.path(), &Config::default());
        assert!(
            found.level == Level::Note && found.text.contains("cpu0 600 of 2400 MHz, ondemand"),
            "{found}"
        );
    }
}
