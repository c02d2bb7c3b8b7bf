//! Access to sysfs below the configured root: `/sys`, or a temporary tree in tests.

use super::heat::Celsius;
use std::fs::OpenOptions;
use std::io::{self, Write};
use std::path::{Path, PathBuf};

/// Plausible temperatures in °C. A sensor with other values is treated as broken.
const PLAUSIBLE: std::ops::RangeInclusive<f64> = -55.0..=150.0;

/// A sysfs tree.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Sysfs {
    root: PathBuf,
}

impl Sysfs {
    /// Files below `root`.
    pub fn new(root: &Path) -> Self {
        Self { root: root.to_owned() }
    }

    /// Path of a file, for messages.
    pub fn path(&self, file: &str) -> PathBuf {
        self.root.join(file)
    }

    /// The text of a file, trimmed.
    ///
    /// # Errors
    /// If it cannot be read.
    pub fn text(&self, file: &str) -> io::Result<String> {
        std::fs::read_to_string(self.path(file)).map(|text| text.trim().to_owned())
    }

    /// The integer in a file.
    ///
    /// # Errors
    /// If it cannot be read, or is not an integer.
    pub fn number(&self, file: &str) -> io::Result<u64> {
        let text = self.text(file)?;
        text.parse()
            .map_err(|_| io::Error::new(io::ErrorKind::InvalidData, format!("{text:?} is not a number")))
    }

    /// All integers in a file, ascending; empty if it cannot be read.
    pub fn numbers(&self, file: &str) -> Vec<u64> {
        let text = self.text(file).unwrap_or_default();
        let mut numbers: Vec<u64> = text.split_ascii_whitespace().filter_map(|n| n.parse().ok()).collect();
        numbers.sort_unstable();
        numbers
    }

    /// Writes an integer into an existing file.
    ///
    /// # Errors
    /// If the file does not exist, or the kernel refuses.
    pub fn write(&self, file: &str, number: u64) -> io::Result<()> {
        let mut open = OpenOptions::new().write(true).truncate(true).open(self.path(file))?;
        // In one call, because the kernel treats each write as a complete value.
        open.write_all(format!("{number}\n").as_bytes())
    }

    /// Whether a file or folder exists.
    pub fn has(&self, file: &str) -> bool {
        self.path(file).exists()
    }

    /// Names in a folder that start with `prefix`, sorted by their numbers: zone2 comes before zone10.
    pub fn names(&self, folder: &str, prefix: &str) -> Vec<String> {
        let Ok(entries) = std::fs::read_dir(self.path(folder)) else { return Vec::new() };
        let mut names: Vec<String> = entries
            .flatten()
            .filter_map(|entry| entry.file_name().into_string().ok())
            .filter(|name| name.starts_with(prefix))
            .collect();
        names.sort_by_key(|name| (name[prefix.len()..].parse().unwrap_or(u64::MAX), name.clone()));
        names
    }
}

/// The monitored thermal zones.
#[derive(Clone, Debug)]
pub struct Sensors {
    sysfs: Sysfs,
    /// Folders, in the order of `names`.
    folders: Vec<String>,
    names: Vec<String>,
}

impl Sensors {
    /// The zones whose type matches one of the patterns.
    pub fn find(sysfs: &Sysfs, patterns: &str) -> Self {
        let (mut folders, mut names): (Vec<String>, Vec<String>) = (Vec::new(), Vec::new());
        for zone in sysfs.names("class/thermal", "thermal_zone") {
            let folder = format!("class/thermal/{zone}");
            let Ok(kind) = sysfs.text(&format!("{folder}/type")) else { continue };
            if matches(patterns, &kind) {
                let count = names.iter().filter(|name| name.split('#').next() == Some(kind.as_str())).count();
                names.push(if count > 0 { format!("{kind}#{}", count + 1) } else { kind });
                folders.push(folder);
            }
        }
        Self { sysfs: sysfs.clone(), folders, names }
    }

    /// Types of the zones; those of the same type are numbered (`cpu-thermal#2`).
    pub fn names(&self) -> &[String] {
        &self.names
    }

    /// Reads all zones (the kernel's unit is 1/1000 °C). A zone that cannot be read, or has an implausible value, is
    /// `None`.
    pub fn read(&self, readings: &mut Vec<Option<Celsius>>) {
        readings.clear();
        readings.extend(self.folders.iter().map(|folder| {
            let text = self.sysfs.text(&format!("{folder}/temp")).ok()?;
            let celsius = text.parse::<i64>().ok()? as f64 * 1e-3;
            PLAUSIBLE.contains(&celsius).then_some(Celsius(celsius))
        }));
    }
}

/// Whether a name matches one of several patterns, separated by commas. `*` stands for any text; case is ignored.
pub fn matches(patterns: &str, name: &str) -> bool {
    let name = name.to_ascii_lowercase();
    patterns.split(',').any(|pattern| matches_one(&pattern.trim().to_ascii_lowercase(), &name))
}

fn matches_one(pattern: &str, name: &str) -> bool {
    let Some((first, rest)) = pattern.split_once('*') else { return pattern == name };
    let Some(name) = name.strip_prefix(first) else { return false };
    (0..=name.len()).any(|at| name.get(at..).is_some_and(|tail| matches_one(rest, tail)))
}

#[cfg(test)]
pub mod tests {
    use super::*;

    /// A temporary sysfs tree.
    pub struct Tree(pub tempfile::TempDir);

    impl Tree {
        pub fn new(files: &[(&str, &str)]) -> Self {
            let tree = Self(tempfile::tempdir().unwrap());
            for (file, text) in files {
                tree.set(file, text);
            }
            tree
        }

        pub fn sysfs(&self) -> Sysfs {
            Sysfs::new(self.0.path())
        }

        pub fn set(&self, file: &str, text: &str) {
            let path = self.0.path().join(file);
            std::fs::create_dir_all(path.parent().unwrap()).unwrap();
            std::fs::write(path, format!("{text}\n")).unwrap();
        }

        pub fn get(&self, file: &str) -> String {
            std::fs::read_to_string(self.0.path().join(file)).unwrap().trim().to_owned()
        }

        pub fn remove(&self, file: &str) {
            std::fs::remove_file(self.0.path().join(file)).unwrap();
        }
    }

    #[test]
    fn patterns_match_as_a_shell_would() {
        for (patterns, name, expected) in [
            ("*", "anything", true),
            ("cpu*", "CPU-therm", true),
            ("cpu*", "soc-cpu", false),
            ("*gpu*,*ga10b", "17000000.ga10b", true),
            ("*gpu*,*ga10b", "17000000.ga10b.x", false),
            ("*gpu", "fb000000.gpu", true),
            ("*gpu", "gpu.gpu", true),
            ("a*b*a", "aba", true),
            ("a*b*a", "ab", false),
            ("ab*ba", "aba", false),
            ("exact", "exact", true),
            ("exact", "exactly", false),
            ("", "x", false),
            ("", "", true),
        ] {
            assert_eq!(matches(patterns, name), expected, "{patterns:?} {name:?}");
        }
    }

    #[test]
    fn zones_are_found_by_type_and_broken_values_are_no_readings() {
        let tree = Tree::new(&[
            ("class/thermal/thermal_zone10/type", "cpu-thermal"),
            ("class/thermal/thermal_zone10/temp", "-3500"),
            ("class/thermal/thermal_zone2/type", "cpu-thermal"),
            ("class/thermal/thermal_zone2/temp", "64250"),
            ("class/thermal/thermal_zone3/type", "PMIC-Die"),
            ("class/thermal/thermal_zone3/temp", "100000"),
            ("class/thermal/thermal_zone4/type", "gpu-thermal"),
            ("class/thermal/thermal_zone4/temp", "-274000"),
            ("class/thermal/thermal_zone5/type", "gpu-thermal"),
            ("class/thermal/cooling_device0/type", "cpu-fan"),
        ]);
        let sensors = Sensors::find(&tree.sysfs(), "cpu*,gpu*");
        assert_eq!(sensors.names(), ["cpu-thermal", "gpu-thermal", "gpu-thermal#2", "cpu-thermal#2"]);
        let mut readings = Vec::new();
        sensors.read(&mut readings);
        assert_eq!(readings, [Some(Celsius(64.25)), None, None, Some(Celsius(-3.5))]);
        tree.set("class/thermal/thermal_zone5/temp", "not a number");
        tree.remove("class/thermal/thermal_zone2/temp");
        sensors.read(&mut readings);
        assert_eq!(readings, [None, None, None, Some(Celsius(-3.5))]);
        assert!(Sensors::find(&Sysfs::new(Path::new("/no/such/tree")), "*").names().is_empty());
    }
}
