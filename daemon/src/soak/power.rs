//! Power sensors of a board in sysfs.

use crate::scheduler::sysfs::Sysfs;

/// One rail: its name and the files whose numbers make its power.
#[derive(Clone, Debug, PartialEq, Eq)]
struct Rail {
    name: String,
    files: Files,
}

#[derive(Clone, Debug, PartialEq, Eq)]
enum Files {
    /// µW, as hwmon has it.
    MicroWatts(String),
    /// mV and mA, as hwmon's drivers of the INA3221 have it.
    MilliVoltsAndAmperes(String, String),
    /// mW, as NVIDIA's older drivers of the INA3221 have it.
    MilliWatts(String),
}

/// The power rails of a board.
#[derive(Clone, Debug)]
pub struct Power {
    sysfs: Sysfs,
    rails: Vec<Rail>,
}

impl Power {
    /// The rails that the kernel's drivers measure; none on many boards.
    pub fn find(sysfs: &Sysfs) -> Self {
        let mut rails = Vec::new();
        for chip in sysfs.names("class/hwmon", "hwmon") {
            let folder = format!("class/hwmon/{chip}");
            let chip = sysfs.text(&format!("{folder}/name")).unwrap_or(chip);
            let label = |kind: &str, number: &str| {
                let text = sysfs.text(&format!("{folder}/{kind}{number}_label")).ok();
                text.filter(|text| !text.is_empty()).unwrap_or_else(|| format!("{chip} {number}"))
            };
            for number in channels(sysfs, &folder, "power") {
                let file = format!("{folder}/power{number}_input");
                rails.push(Rail { name: label("power", &number), files: Files::MicroWatts(file) });
            }
            for number in channels(sysfs, &folder, "curr") {
                let [volts, amperes] = ["in", "curr"].map(|kind| format!("{folder}/{kind}{number}_input"));
                if sysfs.has(&volts) {
                    let files = Files::MilliVoltsAndAmperes(volts, amperes);
                    rails.push(Rail { name: label("in", &number), files });
                }
            }
        }
        let drivers = "bus/i2c/drivers/ina3221x";
        for device in sysfs.names(drivers, "") {
            for part in sysfs.names(&format!("{drivers}/{device}"), "iio:device") {
                let folder = format!("{drivers}/{device}/{part}");
                for number in channels(sysfs, &folder, "in_power") {
                    let name = sysfs.text(&format!("{folder}/rail_name_{number}"));
                    let file = format!("{folder}/in_power{number}_input");
                    let name = name.unwrap_or_else(|_| format!("{device} {number}"));
                    rails.push(Rail { name, files: Files::MilliWatts(file) });
                }
            }
        }
        Self { sysfs: sysfs.clone(), rails }
    }

    /// Name of a rail.
    pub fn name(&self, rail: usize) -> Option<&str> {
        self.rails.get(rail).map(|rail| rail.name.as_str())
    }

    /// Power of each rail in W; `None` where it cannot be read.
    pub fn read_w(&self) -> Vec<Option<f64>> {
        let number = |file: &str| self.sysfs.number(file).ok().map(|number| number as f64);
        let power = |rail: &Rail| match &rail.files {
            Files::MicroWatts(file) => Some(1e-6 * number(file)?),
            Files::MilliVoltsAndAmperes(volts, amperes) => Some(1e-6 * number(volts)? * number(amperes)?),
            Files::MilliWatts(file) => Some(1e-3 * number(file)?),
        };
        self.rails.iter().map(power).collect()
    }
}

/// Numbers of the channels of a kind: `2` for `power2_input`.
fn channels(sysfs: &Sysfs, folder: &str, kind: &str) -> Vec<String> {
    let names = sysfs.names(folder, kind);
    let numbers = names.iter().filter_map(|name| name[kind.len()..].strip_suffix("_input"));
    numbers.filter(|number| number.bytes().all(|b| b.is_ascii_digit())).map(str::to_owned).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scheduler::sysfs::tests::Tree;

    #[test]
    fn rails_of_all_kinds_are_read_in_watts() {
        let tree = Tree::new(&[
            ("class/hwmon/hwmon0/name", "ina3221"),
            ("class/hwmon/hwmon0/in1_label", "VDD_IN"),
            ("class/hwmon/hwmon0/in1_input", "5000"),
            ("class/hwmon/hwmon0/curr1_input", "1850"),
            ("class/hwmon/hwmon0/curr2_input", "900"),
            ("class/hwmon/hwmon1/name", "ina226"),
            ("class/hwmon/hwmon1/power1_input", "3100000"),
            ("class/hwmon/hwmon1/power1_average", "9"),
            ("bus/i2c/drivers/ina3221x/6-0040/iio:device0/rail_name_0", "POM_5V_IN"),
            ("bus/i2c/drivers/ina3221x/6-0040/iio:device0/in_power0_input", "2750"),
            ("bus/i2c/drivers/ina3221x/6-0040/iio:device0/in_power1_input", "no number"),
        ]);
        let power = Power::find(&tree.sysfs());
        let names: Vec<_> = (0..9).map_while(|rail| power.name(rail)).collect();
        assert_eq!(names, ["VDD_IN", "ina226 1", "POM_5V_IN", "6-0040 1"]);
        let watts = power.read_w();
        let near = |a: Option<f64>, b: f64| (a.unwrap_or(f64::NAN) - b).abs() < 1e-9;
        assert!(near(watts[0], 9.25) && near(watts[1], 3.1) && near(watts[2], 2.75), "{watts:?}");
        assert_eq!(watts[3], None);
        assert!(Power::find(&Sysfs::new(std::path::Path::new("/no/such/tree"))).read_w().is_empty());
    }
}
