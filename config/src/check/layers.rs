//! A configuration from its layers: the defaults, a profile, a file.

use crate::keys::{self, Kind};
use crate::tables::Config;
use toml::{Table, Value};

/// The defaults, overwritten by one text after the other.
pub(super) fn layered(texts: &[&str]) -> Result<Config, String> {
    let mut merged = Table::try_from(Config::default()).map_err(|error| error.to_string())?;
    for text in texts {
        let layer: Table = toml::from_str(text).map_err(|error| error.message().to_owned())?;
        for (name, value) in layer {
            // `profile = "…"` is the only value outside of a table.
            let Value::Table(mut keys) = value else { continue };
            words_of_numbers(&name, &mut keys);
            let table = merged.entry(name).or_insert_with(|| Table::new().into());
            if let Some(table) = table.as_table_mut() {
                table.extend(keys);
            }
        }
    }
    merged.try_into().map_err(|error: toml::de::Error| error.message().to_owned())
}

/// Numbers among words, such as `source.bits = 12`, as the words that they mean.
fn words_of_numbers(table: &str, keys: &mut Table) {
    let declared = keys::tables().iter().find(|declared| declared.name == table);
    for key in declared.into_iter().flat_map(|table| &table.keys) {
        if matches!(key.kind, Kind::Choice(_))
            && let Some(value @ Value::Integer(_)) = keys.get_mut(&key.name)
        {
            *value = Value::String(value.to_string());
        }
    }
}

#[cfg(test)]
mod tests {
    use crate::parse;
    use std::path::Path;

    #[test]
    fn a_number_among_words_needs_no_quotes() {
        for text in ["12", "\"12\"", "0xc"] {
            let config = parse(&format!("[source]\nbits = {text}\n"), Path::new("car.toml")).unwrap();
            assert_eq!(config.source.bits, "12", "{text}");
        }
        let error = parse("[source]\nbits = 11\n", Path::new("car.toml")).unwrap_err().to_string();
        assert!(error.contains("car.toml:2: source.bits = 11: give one of \"auto\", \"8\""), "{error}");
    }

    #[test]
    fn equal_cameras_are_no_error_of_the_file_alone() {
        // Options may still name another source, or set camera.side_by_side.
        let text = "[source]\nkind = \"camera\"\n[camera]\nleft = \"/dev/video0\"\nright = \"/dev/video0\"\n";
        assert!(parse(text, Path::new("car.toml")).is_ok());
    }
}
