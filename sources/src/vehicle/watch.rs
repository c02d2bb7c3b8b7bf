//! What is told of the bus: faults are counted, and the first, second, fourth, eighth … is logged.

use super::decoder::Refused;
use super::reading::VehicleFaults;

/// Counts the faults of the bus, and says which are to be told.
#[derive(Clone, Debug, Default)]
pub struct Watch {
    last: VehicleFaults,
    missing: u64,
    stale: u64,
    out_of_range: u64,
    refused: u64,
}

/// Whether the n-th event is told.
fn is_told(count: u64) -> bool {
    count.is_power_of_two()
}

impl Watch {
    /// Takes the faults of now. Returns a text where values have become missing, stale or invalid, or have come back.
    pub fn faults(&mut self, now: VehicleFaults) -> Option<String> {
        let before = std::mem::replace(&mut self.last, now);
        if now.missing && !before.missing {
            self.missing += 1;
            if is_told(self.missing) {
                let text = "a configured value has not been received yet: check vehicle.dbc and the bus, or vehicle.motion";
                return Some(text.into());
            }
        }
        if now.stale && !before.stale {
            self.stale += 1;
            if is_told(self.stale) {
                return Some(format!(
                    "a value is stale and not used until it comes again ({} times so far)",
                    self.stale
                ));
            }
        }
        if now.out_of_range && !before.out_of_range {
            self.out_of_range += 1;
            if is_told(self.out_of_range) {
                return Some(format!(
                    "a value is out of range and not used ({} times so far)",
                    self.out_of_range
                ));
            }
        }
        let is_over = (before.stale || before.missing) && !now.stale && !now.missing;
        (is_over && is_told(self.stale.max(1))).then(|| "all configured values are received".into())
    }

    /// Takes a value that was out of range. Returns a text where it is to be told.
    pub fn refused(&mut self, refused: Refused) -> Option<String> {
        self.refused += 1;
        let count = self.refused;
        is_told(count).then(|| match refused.value {
            Some(value) => format!(
                "vehicle.{}: the value {value} is out of range and not used ({count} so far)",
                refused.key
            ),
            None => {
                format!("vehicle.{}: the frame is too short for the signal ({count} so far)", refused.key)
            }
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_second_fourth_and_eighth_are_told() {
        let mut watch = Watch::default();
        let stale = VehicleFaults { stale: true, ..VehicleFaults::default() };
        let mut told = Vec::new();
        for i in 1..=9 {
            if watch.faults(stale).is_some() {
                told.push(i);
            }
            assert_eq!(watch.faults(stale), None, "once for each time");
            watch.faults(VehicleFaults::default());
        }
        assert_eq!(told, [1, 2, 4, 8]);
        let bad = Refused { key: "speed_signal", value: Some(655.35) };
        let told: Vec<u32> = (1..=20).filter(|_| watch.refused(bad).is_some()).collect();
        assert_eq!(told, [1, 2, 4, 8, 16]);
        let mut watch = Watch::default();
        let missing = VehicleFaults { missing: true, no_bus: true, ..VehicleFaults::default() };
        assert!(watch.faults(missing).unwrap().contains("not been received yet"));
        assert!(watch.faults(VehicleFaults::default()).unwrap().contains("all configured"));
        let text = watch.refused(bad).unwrap();
        assert_eq!(text, "vehicle.speed_signal: the value 655.35 is out of range and not used (1 so far)");
    }
}
