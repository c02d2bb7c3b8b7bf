//! The keys of a vehicle: `lookout/<fleet>/<vehicle>/…`.

/// First part of all keys.
const ROOT: &str = "lookout";

/// The keys of one vehicle, or with `*` of several.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Keys {
    base: String,
}

impl Keys {
    /// The keys of a vehicle.
    pub fn new(fleet: &str, vehicle: &str) -> Self {
        Self { base: format!("{ROOT}/{fleet}/{vehicle}") }
    }

    /// The key of a topic.
    pub fn topic(&self, name: &str) -> String {
        format!("{}/{name}", self.base)
    }

    /// The liveliness token: it is there as long as the bridge is connected.
    pub fn alive(&self) -> String {
        self.topic("alive")
    }

    /// Everything of all events.
    pub fn events(&self) -> String {
        self.topic("events/**")
    }

    /// An event.
    pub fn event(&self, number: u64) -> String {
        format!("{}/events/{number}", self.base)
    }

    /// A picture of an event: that of a frame.
    pub fn picture(&self, event: u64, frame: u64) -> String {
        format!("{}/events/{event}/pictures/{frame}", self.base)
    }
}

/// Fleet and vehicle of a key; `None` for others.
pub fn vehicle_of(key: &str) -> Option<(&str, &str)> {
    let mut parts = key.strip_prefix(ROOT)?.strip_prefix('/')?.split('/');
    Some((parts.next()?, parts.next()?))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn keys_name_fleet_and_vehicle() {
        let keys = Keys::new("north", "car-7");
        assert_eq!(keys.picture(3, 12), "lookout/north/car-7/events/3/pictures/12");
        assert_eq!(
            (keys.alive(), keys.event(3)),
            ("lookout/north/car-7/alive".into(), "lookout/north/car-7/events/3".into())
        );
        assert_eq!(vehicle_of(&keys.alive()), Some(("north", "car-7")));
        assert_eq!((vehicle_of("other/a/b"), vehicle_of("lookout/a")), (None, None));
    }
}
