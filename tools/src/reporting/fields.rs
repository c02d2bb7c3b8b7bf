//! The names of a record's fields, as its JSON has them.

use serde::de::value::Error;
use serde::de::{Deserialize, Deserializer, Error as _, Visitor};
use serde::forward_to_deserialize_any;

/// The names of the fields of a struct in the order of their declaration; empty for other types. Also fields that are
/// left out of some JSON have a name.
pub fn field_names<T: for<'de> Deserialize<'de>>() -> &'static [&'static str] {
    let mut names: &[&str] = &[];
    // A struct names its fields before it asks for their values, of which there are none.
    let _ = T::deserialize(Names(&mut names));
    names
}

/// Takes the names that a struct expects.
struct Names<'a>(&'a mut &'static [&'static str]);

impl<'de> Deserializer<'de> for Names<'_> {
    type Error = Error;

    fn deserialize_any<V: Visitor<'de>>(self, _: V) -> Result<V::Value, Error> {
        Err(Error::custom("not a struct"))
    }

    fn deserialize_struct<V: Visitor<'de>>(
        self,
        _: &'static str,
        fields: &'static [&'static str],
        _: V,
    ) -> Result<V::Value, Error> {
        *self.0 = fields;
        Err(Error::custom("only the names were asked for"))
    }

    forward_to_deserialize_any! {
        bool i8 i16 i32 i64 i128 u8 u16 u32 u64 u128 f32 f64 char str string bytes byte_buf option unit unit_struct
        newtype_struct seq tuple tuple_struct map enum identifier ignored_any
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::reporting::record::FrameRecord;

    #[test]
    fn the_fields_are_those_of_the_json() {
        let json = serde_json::to_value(FrameRecord::default()).unwrap();
        let names = field_names::<FrameRecord>();
        assert_eq!(names[0], "sequence");
        assert!(json.as_object().unwrap().keys().all(|key| names.contains(&key.as_str())), "{names:?}");
        assert!(field_names::<Vec<u32>>().is_empty());
    }
}
