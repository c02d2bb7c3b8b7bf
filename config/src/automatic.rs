//! A switch that is decided by what is found, unless it is set.

use serde::de::{Error, Visitor};
use serde::{Deserialize, Deserializer, Serialize, Serializer};
use std::fmt;

/// `"auto"`, true or false.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Automatic {
    /// As it is found.
    #[default]
    Auto,
    /// On.
    On,
    /// Off.
    Off,
}

/// How [`Automatic::Auto`] is written.
pub const AUTO: &str = "auto";

impl Serialize for Automatic {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match self {
            Self::Auto => serializer.serialize_str(AUTO),
            Self::On => serializer.serialize_bool(true),
            Self::Off => serializer.serialize_bool(false),
        }
    }
}

impl<'de> Deserialize<'de> for Automatic {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Value;

        impl Visitor<'_> for Value {
            type Value = Automatic;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("\"auto\", true or false")
            }

            fn visit_bool<E: Error>(self, is_on: bool) -> Result<Automatic, E> {
                Ok(if is_on { Automatic::On } else { Automatic::Off })
            }

            fn visit_str<E: Error>(self, text: &str) -> Result<Automatic, E> {
                if text == AUTO {
                    Ok(Automatic::Auto)
                } else {
                    Err(E::custom("give \"auto\", true or false"))
                }
            }
        }

        deserializer.deserialize_any(Value)
    }
}
