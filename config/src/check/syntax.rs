//! Errors of the TOML parser, with the key or table at which they stand and a remedy: the parser names neither.

use crate::keys;
use crate::limits::MAX_SUGGESTED_CHARS;

/// What the parser says of `text` at `offset`, with the key or the table of that line.
pub(super) fn syntax_error(text: &str, offset: Option<usize>, message: &str) -> String {
    let place = offset.and_then(|at| place(text, at));
    let remedy = match (&place, message == "duplicate key") {
        (Some(Place::Table(name)), true) => format!("write all keys of the table below one [{name}]"),
        (_, true) => "keep one of them".into(),
        (Some(Place::Table(name)), false) => format!("write [{name}] alone on the line"),
        (_, false) if message.contains("escape") => {
            "write \\\\ for a backslash, or the text in single quotes".into()
        }
        (_, false) if message.contains("unclosed") || message.contains("missing") => {
            "write KEY = VALUE, with each quote and bracket closed".into()
        }
        (_, false) => "write KEY = VALUE, with texts in quotes".into(),
    };
    match place {
        Some(Place::Key(key)) => format!("{key}: {message}: {remedy}"),
        Some(Place::Table(name)) => format!("table [{name}]: {message}: {remedy}"),
        None => format!("{message}: {remedy}"),
    }
}

enum Place {
    Table(String),
    /// With its table.
    Key(String),
}

/// The table or key that the line at `offset` begins with.
fn place(text: &str, offset: usize) -> Option<Place> {
    let before = text.get(..offset.min(text.len()))?;
    let start = before.rfind('\n').map_or(0, |end| end + 1);
    let line = text[start..].lines().next()?;
    if let Some(name) = header(line) {
        return Some(Place::Table(name.to_owned()));
    }
    let (name, rest) = name_at_start(line.trim_start());
    let table = text[..start].lines().rev().find_map(header);
    // A line inside a list or a long text is no key, though it may look like one.
    let is_known = || keys::all().any(|key| Some(key.table) == table && key.name == name);
    if name.is_empty() || !(rest.trim_start().starts_with('=') || is_known()) {
        return None;
    }
    Some(Place::Key(table.map_or_else(|| name.to_owned(), |table| format!("{table}.{name}"))))
}

/// The name in a line that begins a table: `[name]`, or that without its end.
fn header(line: &str) -> Option<&str> {
    let inside = line.trim_start().strip_prefix('[')?;
    let (name, rest) = name_at_start(inside.trim_start_matches('[').trim_start());
    let begins = name.starts_with(|c: char| c.is_ascii_alphabetic());
    (begins && (rest.trim().is_empty() || rest.trim_start().starts_with([']', '#']))).then_some(name)
}

/// A name without quotes and of a sensible length at the start of a text, and the rest.
fn name_at_start(text: &str) -> (&str, &str) {
    let is_part = |c: char| c.is_ascii_alphanumeric() || matches!(c, '_' | '-' | '.');
    let end = text.find(|c| !is_part(c)).unwrap_or(text.len());
    if end > MAX_SUGGESTED_CHARS { ("", text) } else { text.split_at(end) }
}

#[cfg(test)]
mod tests {
    use crate::parse;
    use std::path::Path;

    #[test]
    fn what_the_parser_refuses_is_told_with_its_key_and_a_remedy() {
        for (text, expected) in [
            (
                "[alarm]\ndistance_m = 7\ndistance_m = 8\n",
                "3: alarm.distance_m: duplicate key: keep one of them",
            ),
            ("profile = \"tk1\"\nprofile = \"tk1\"\n", "2: profile: duplicate key: keep one of them"),
            ("alarm.hold_ms = 1\nalarm.hold_ms = 2\n", "2: alarm.hold_ms: duplicate key"),
            (
                "[alarm]\n[road]\n[alarm]\n",
                "3: table [alarm]: duplicate key: write all keys of the table below one [alarm]",
            ),
            ("[alarm\ndistance_m = 7\n", "1: table [alarm]: unclosed table"),
            ("[source]\nkind = scene\n", "2: source.kind: string values must be quoted"),
            ("[source]\npath = \"a\n", "2: source.path: "),
            ("[alarm]\ndistance_m 7\n", "2: alarm.distance_m: "),
            ("[alarm]\ndistance_m =\n", "2: alarm.distance_m: "),
            ("[source]\npath = \"a\\qb\"\n", "2: source.path: "),
        ] {
            let errors = parse(text, Path::new("car.toml")).unwrap_err().to_string();
            assert!(errors.starts_with(&format!("car.toml:{expected}")), "{text}{errors}");
            let (_, remedy) = errors.rsplit_once(": ").unwrap();
            assert!(["keep", "write"].iter().any(|word| remedy.starts_with(word)), "{errors}");
        }
        // A line of a list names no key, and a name that is no key stays short.
        let list =
            parse("[recognition]\ndetectors = [\n 1 2\n]\n", Path::new("car.toml")).unwrap_err().to_string();
        assert!(list.starts_with("car.toml:3: ") && !list.contains("recognition.1"), "{list}");
        let long = format!("{0} = 1\n{0} = 2\n", "x".repeat(100_000));
        assert!(parse(&long, Path::new("car.toml")).unwrap_err().to_string().len() < 200);
    }
}
