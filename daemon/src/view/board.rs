//! Temperatures and clocks of the board, from the world-readable files below `/sys`.

use serde::Serialize;
use std::path::{Path, PathBuf};

/// Maximum number of sensors, and of clocks.
const MAX_COUNT: usize = 16;

/// The files to read, searched once at start.
#[derive(Clone, Debug, Default)]
pub struct Board {
    temperatures: Vec<(String, PathBuf)>,
    clocks: Vec<(String, PathBuf, f64)>,
}

/// One reading.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Reading {
    /// Name of the sensor or clock.
    pub name: String,
    /// In degrees Celsius, or in hertz.
    pub value: f64,
}

/// All readings at one time.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Readings {
    /// In degrees Celsius.
    pub temperatures: Vec<Reading>,
    /// In hertz.
    pub clocks: Vec<Reading>,
}

impl Board {
    /// Finds thermal zones, CPU clocks (one for each group of cores that share it) and device clocks
    /// (GPU, memory) below `root`, which is `/sys` except in tests.
    pub fn find(root: &Path) -> Self {
        let mut board = Self::default();
        for zone in entries(&root.join("class/thermal"), "thermal_zone") {
            let name = text(&zone.join("type")).unwrap_or_else(|| file_name(&zone));
            board.temperatures.push((name, zone.join("temp")));
        }
        for policy in entries(&root.join("devices/system/cpu/cpufreq"), "policy") {
            let name = file_name(&policy).replace("policy", "cpu");
            board.clocks.push((name, policy.join("scaling_cur_freq"), 1e3));
        }
        for device in entries(&root.join("class/devfreq"), "") {
            board.clocks.push((file_name(&device), device.join("cur_freq"), 1.0));
        }
        board.temperatures.truncate(MAX_COUNT);
        board.clocks.truncate(MAX_COUNT);
        board
    }

    /// Reads all files; those that cannot be read now are left out.
    pub fn read(&self) -> Readings {
        let number = |path: &Path| text(path)?.parse::<f64>().ok();
        let reading = |name: &String, path: &Path, scale: f64| {
            number(path).map(|value| Reading { name: name.clone(), value: value * scale })
        };
        Readings {
            temperatures: self.temperatures.iter().filter_map(|(n, p)| reading(n, p, 1e-3)).collect(),
            clocks: self.clocks.iter().filter_map(|(n, p, scale)| reading(n, p, *scale)).collect(),
        }
    }
}

/// Entries of a folder whose names begin with `start`, sorted by the number in the name.
fn entries(folder: &Path, start: &str) -> Vec<PathBuf> {
    let mut found: Vec<PathBuf> = std::fs::read_dir(folder)
        .map(|entries| entries.flatten().map(|e| e.path()).collect())
        .unwrap_or_default();
    found.retain(|path| file_name(path).starts_with(start));
    found.sort_by_key(|path| {
        let name = file_name(path);
        let number: String = name.chars().filter(char::is_ascii_digit).collect();
        (number.parse::<u64>().unwrap_or(u64::MAX), name)
    });
    found
}

fn file_name(path: &Path) -> String {
    path.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default()
}

fn text(path: &Path) -> Option<String> {
    std::fs::read_to_string(path).ok().map(|t| t.trim().to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sensors_and_clocks_are_found_and_unreadable_ones_left_out() {
        let root = tempfile::tempdir().unwrap();
        let put = |path: &str, text: &str| {
            let path = root.path().join(path);
            std::fs::create_dir_all(path.parent().unwrap()).unwrap();
            std::fs::write(path, text).unwrap();
        };
        put("class/thermal/thermal_zone10/type", "gpu\n");
        put("class/thermal/thermal_zone10/temp", "61500\n");
        put("class/thermal/thermal_zone2/type", "cpu\n");
        put("class/thermal/thermal_zone2/temp", "-3000\n");
        put("class/thermal/thermal_zone3/type", "broken\n");
        put("class/thermal/cooling_device0/type", "fan\n");
        put("devices/system/cpu/cpufreq/policy0/scaling_cur_freq", "1500000\n");
        put("class/devfreq/57000000.gpu/cur_freq", "852000000\n");
        let readings = Board::find(root.path()).read();
        let pairs = |list: &[Reading]| list.iter().map(|r| (r.name.clone(), r.value)).collect::<Vec<_>>();
        assert_eq!(pairs(&readings.temperatures), [("cpu".into(), -3.0), ("gpu".into(), 61.5)]);
        assert_eq!(pairs(&readings.clocks), [("cpu0".into(), 1.5e9), ("57000000.gpu".into(), 852e6)]);
        assert_eq!(Board::find(&root.path().join("nothing")).read(), Readings::default());
    }
}
