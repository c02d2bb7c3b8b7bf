//! Keys that exist once for each process: `cores.<stage>` and `realtime.priority_<stage>`. The processes and the
//! defaults are those of [`messages::pipeline`].

use messages::pipeline::{self, PROCESSES, ProcessSpec, Role};
use serde::de::{Deserialize, Deserializer, Error, MapAccess, Visitor};
use serde::ser::{Serialize, SerializeMap, Serializer};
use std::fmt;
use std::marker::PhantomData;

/// A whole-number key that exists once for each process.
pub trait StageKey {
    /// What precedes the process name in the key's name.
    const PREFIX: &'static str;
    /// Smallest and largest value.
    const RANGE: (i64, i64);
    /// Default of a process; `None` where it has no such key.
    fn default(stage: &ProcessSpec) -> Option<i64>;
}

/// `cores.<stage>`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Core;

impl StageKey for Core {
    const PREFIX: &'static str = "";
    const RANGE: (i64, i64) = (0, 1023);
    fn default(stage: &ProcessSpec) -> Option<i64> {
        match stage.core {
            pipeline::Core::Own(core) => Some(core.into()),
            pipeline::Core::With(_) => None,
        }
    }
}

/// `realtime.priority_<stage>`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Priority;

impl StageKey for Priority {
    const PREFIX: &'static str = "priority_";
    const RANGE: (i64, i64) = (10, 55);
    fn default(stage: &ProcessSpec) -> Option<i64> {
        stage.priority.map(i64::from)
    }
}

/// The values of such a key, in the order of [`PROCESSES`].
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PerStage<K> {
    values: Vec<(Role, i64)>,
    key: PhantomData<K>,
}

impl<K: StageKey> PerStage<K> {
    /// Name of the key of a process.
    pub fn name(role: Role) -> String {
        format!("{}{role}", K::PREFIX)
    }

    /// Value of a process; `None` where it has no such key.
    pub fn get(&self, role: Role) -> Option<i64> {
        self.iter().find(|(other, _)| *other == role).map(|(_, value)| value)
    }

    /// Processes with their values.
    pub fn iter(&self) -> impl Iterator<Item = (Role, i64)> {
        self.values.iter().copied()
    }
}

impl<K: StageKey> Default for PerStage<K> {
    fn default() -> Self {
        let values = PROCESSES.iter().filter_map(|stage| Some((stage.role, K::default(stage)?))).collect();
        Self { values, key: PhantomData }
    }
}

impl<K: StageKey> Serialize for PerStage<K> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut map = serializer.serialize_map(Some(self.values.len()))?;
        for (role, value) in self.iter() {
            map.serialize_entry(&Self::name(role), &value)?;
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
        let mut read = PerStage::<K>::default();
        let mut missing: Vec<Role> = read.iter().map(|(role, _)| role).collect();
        while let Some(key) = map.next_key::<String>()? {
            let entry = read.values.iter_mut().find(|(role, _)| PerStage::<K>::name(*role) == key);
            let (role, value) = entry.ok_or_else(|| A::Error::custom(format!("unknown field `{key}`")))?;
            *value = map.next_value()?;
            missing.retain(|other| other != role);
        }
        match missing.first() {
            Some(role) => Err(A::Error::custom(format!("missing field `{}`", PerStage::<K>::name(*role)))),
            None => Ok(read),
        }
    }
}

#[cfg(test)]
mod tests {
    use crate::{Cores, Realtime};
    use messages::pipeline::Role;

    #[test]
    fn keys_have_the_names_of_the_stages() {
        let written = toml::to_string(&Cores::default()).unwrap();
        assert_eq!(
            written,
            "pin = true\nscheduler = 0\ncapture = 0\nstereo = 1\nroad = 2\nrecognition = 3\n"
        );
        let read: Cores = toml::from_str(&written.replace("stereo = 1", "stereo = 7")).unwrap();
        assert_eq!((read.of(Role::Stereo), read.of(Role::Recognition)), (7, 3));
        let error = toml::from_str::<Cores>(&written.replace("stereo", "stero")).unwrap_err().to_string();
        assert!(error.contains("unknown field `stero`"), "{error}");
        let error = toml::from_str::<Cores>(&written.replace("road = 2\n", "")).unwrap_err().to_string();
        assert!(error.contains("missing field `road`"), "{error}");
        let shared: Cores = toml::from_str(&written.replace("scheduler = 0", "scheduler = 5")).unwrap();
        assert_eq!(shared.of(Role::Writer), 5, "the writer runs on the scheduler's core");
        let realtime = Realtime::default();
        assert_eq!((realtime.priority(Role::Road), realtime.priority(Role::Writer)), (Some(30), None));
        assert!(toml::to_string(&realtime).unwrap().contains("\npriority_road = 30\n"));
    }
}
