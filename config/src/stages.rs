//! Keys that exist once for each process: `cores.<stage>` and `realtime.priority_<stage>`.

use serde::de::{Deserialize, Deserializer, Error, MapAccess, Visitor};
use serde::ser::{Serialize, SerializeMap, Serializer};
use std::fmt;
use std::marker::PhantomData;

/// Defaults of one process.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct StageDefaults {
    /// Its name.
    pub name: &'static str,
    /// CPU core.
    pub core: i64,
    /// SCHED_FIFO priority; `None` for a process that never has one.
    pub priority: Option<i64>,
}

/// The processes that have keys of their own.
pub const STAGES: &[StageDefaults] = &[
    StageDefaults { name: "scheduler", core: 0, priority: Some(55) },
    StageDefaults { name: "capture", core: 0, priority: Some(50) },
    StageDefaults { name: "stereo", core: 1, priority: Some(20) },
    StageDefaults { name: "road", core: 2, priority: Some(30) },
    StageDefaults { name: "recognition", core: 3, priority: Some(40) },
];

/// A whole-number key that exists once for each process.
pub trait StageKey {
    /// What precedes the process name in the key's name.
    const PREFIX: &'static str;
    /// Smallest and largest value.
    const RANGE: (i64, i64);
    /// Default of a process; `None` where it has no such key.
    fn default(stage: &StageDefaults) -> Option<i64>;
}

/// `cores.<stage>`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Core;

impl StageKey for Core {
    const PREFIX: &'static str = "";
    const RANGE: (i64, i64) = (0, 1023);
    fn default(stage: &StageDefaults) -> Option<i64> {
        Some(stage.core)
    }
}

/// `realtime.priority_<stage>`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Priority;

impl StageKey for Priority {
    const PREFIX: &'static str = "priority_";
    const RANGE: (i64, i64) = (10, 55);
    fn default(stage: &StageDefaults) -> Option<i64> {
        stage.priority
    }
}

/// The values of such a key, in the order of [`STAGES`].
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PerStage<K> {
    values: Vec<(&'static str, i64)>,
    key: PhantomData<K>,
}

impl<K: StageKey> PerStage<K> {
    /// Value of a process; `None` where it has no such key.
    pub fn get(&self, stage: &str) -> Option<i64> {
        self.iter().find(|(name, _)| *name == stage).map(|(_, value)| value)
    }

    /// Processes with their values.
    pub fn iter(&self) -> impl Iterator<Item = (&'static str, i64)> {
        self.values.iter().copied()
    }
}

impl<K: StageKey> Default for PerStage<K> {
    fn default() -> Self {
        let values = STAGES.iter().filter_map(|stage| Some((stage.name, K::default(stage)?))).collect();
        Self { values, key: PhantomData }
    }
}

impl<K: StageKey> Serialize for PerStage<K> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut map = serializer.serialize_map(Some(self.values.len()))?;
        for (stage, value) in self.iter() {
            map.serialize_entry(&format!("{}{stage}", K::PREFIX), &value)?;
        }
        map.end()
    }
}

impl<'de, K: StageKey> Deserialize<'de> for PerStage<K> {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_map(Values(PhantomData))
    }
}

/// Reads a map with exactly one value for each process. Unknown keys are errors: a table with such keys cannot
/// have `deny_unknown_fields`, because serde does not support it together with `flatten`.
struct Values<K>(PhantomData<K>);

impl<'de, K: StageKey> Visitor<'de> for Values<K> {
    type Value = PerStage<K>;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "a whole number {}<stage> for each stage", K::PREFIX)
    }

    fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<Self::Value, A::Error> {
        let mut missing = PerStage::<K>::default().values;
        let mut read = missing.clone();
        while let Some(key) = map.next_key::<String>()? {
            let stage = key.strip_prefix(K::PREFIX);
            let entry = read.iter_mut().find(|(name, _)| stage == Some(*name));
            let (name, value) = entry.ok_or_else(|| A::Error::custom(format!("unknown field `{key}`")))?;
            *value = map.next_value()?;
            missing.retain(|(other, _)| other != name);
        }
        match missing.first() {
            Some((stage, _)) => Err(A::Error::custom(format!("missing field `{}{stage}`", K::PREFIX))),
            None => Ok(PerStage { values: read, key: PhantomData }),
        }
    }
}

#[cfg(test)]
mod tests {
    use crate::{Cores, Realtime};

    #[test]
    fn values_have_the_names_of_the_stages() {
        let written = toml::to_string(&Cores::default()).unwrap();
        assert_eq!(
            written,
            "pin = true\nscheduler = 0\ncapture = 0\nstereo = 1\nroad = 2\nrecognition = 3\n"
        );
        let read: Cores = toml::from_str(&written.replace("stereo = 1", "stereo = 7")).unwrap();
        assert_eq!((read.of("stereo"), read.of("recognition")), (7, 3));
        let error = toml::from_str::<Cores>(&written.replace("stereo", "stero")).unwrap_err().to_string();
        assert!(error.contains("unknown field `stero`"), "{error}");
        let error = toml::from_str::<Cores>(&written.replace("road = 2\n", "")).unwrap_err().to_string();
        assert!(error.contains("missing field `road`"), "{error}");
        let realtime = Realtime::default();
        assert_eq!((realtime.priority("road"), realtime.priority("writer")), (Some(30), None));
        assert!(toml::to_string(&realtime).unwrap().contains("\npriority_road = 30\n"));
    }
}
