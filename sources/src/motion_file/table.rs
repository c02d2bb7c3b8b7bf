//! Tables of numbers in CSV with a header line, columns taken by name.

use crate::SourceError;
use crate::bounded_file::read_text;
use crate::limits::{MAX_MOTION_COLUMNS, MAX_MOTION_LINES, MOTION};
use perception::excerpt::{VALUE_CHARS, excerpt};
use std::path::Path;

/// Largest magnitude of a time in seconds. Unix time stays below it until 2096, as the source time of messages.
pub const MAX_TIME_S: f64 = 4e9;

/// Reads a file within [`MOTION`].
pub fn read(path: &Path) -> Result<String, SourceError> {
    read_text(path, &MOTION).map_err(|source| SourceError::Io { path: path.to_owned(), source })
}

/// An error in a file.
pub fn fault(path: &Path, reason: String) -> SourceError {
    SourceError::Motion { path: path.to_owned(), reason }
}

/// A finite number.
pub fn number(word: &str) -> Result<f64, String> {
    let value = word.trim().parse().ok().filter(|v: &f64| v.is_finite());
    value.ok_or_else(|| format!("\"{}\" is not a number", excerpt(word.trim(), VALUE_CHARS)))
}

/// Reads the columns `names` of a CSV file, in that order; others are ignored. Returns the rows with their line numbers.
///
/// # Errors
/// Names the file, the line or column and the remedy.
pub fn columns<const N: usize>(path: &Path, names: [&str; N]) -> Result<Vec<(usize, [f64; N])>, SourceError> {
    let text = read(path)?;
    parse(&text, names).map_err(|reason| fault(path, reason))
}

fn parse<const N: usize>(text: &str, names: [&str; N]) -> Result<Vec<(usize, [f64; N])>, String> {
    let mut lines = text.lines().zip(1..).filter(|(line, _)| !is_blank(line));
    // Some programs begin a file with a byte order mark.
    let head = lines.next().map_or("", |(line, _)| line.trim_start_matches('\u{feff}'));
    let head: Vec<&str> = head.split(',').map(str::trim).take(MAX_MOTION_COLUMNS + 1).collect();
    if head.len() > MAX_MOTION_COLUMNS {
        return Err(format!("more than {MAX_MOTION_COLUMNS} columns: keep those named {}", names.join(", ")));
    }
    let mut places = [0; N];
    for (place, name) in places.iter_mut().zip(names) {
        *place = head.iter().position(|&column| column == name).ok_or_else(|| {
            format!("no column {name}: the first line names the columns, needed are {}", names.join(", "))
        })?;
    }
    let mut rows = Vec::new();
    for (line, at) in lines {
        if rows.len() == MAX_MOTION_LINES {
            return Err(format!("line {at}: more than {MAX_MOTION_LINES} samples: divide the recording"));
        }
        let words: Vec<&str> = line.split(',').take(MAX_MOTION_COLUMNS).collect();
        let mut row = [0.0; N];
        for ((value, place), name) in row.iter_mut().zip(places).zip(names) {
            let word = words.get(place).ok_or_else(|| format!("line {at}: {name} is missing"))?;
            *value = number(word).map_err(|reason| format!("line {at}: {name}: {reason}"))?;
        }
        rows.push((at, row));
    }
    Ok(rows)
}

/// Whether a line is empty or a comment.
pub fn is_blank(line: &str) -> bool {
    let line = line.trim();
    line.is_empty() || line.starts_with('#')
}

/// Checks that times, each with its line, are in range and do not decrease.
pub fn check_times(times: impl Iterator<Item = (usize, f64)>, name: &str) -> Result<(), String> {
    let mut before = f64::NEG_INFINITY;
    for (at, time_s) in times {
        if time_s.abs() > MAX_TIME_S {
            return Err(format!("line {at}: {name} = {time_s}: give seconds, at most {MAX_TIME_S}"));
        }
        if time_s < before {
            return Err(format!(
                "line {at}: {name} = {time_s} is before {before} of the line above: sort the lines by time"
            ));
        }
        before = time_s;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn columns_are_taken_by_name() {
        let text = "\u{feff}note, b ,a,c\n# a comment\nx,2,1,\n\ny, 4 ,3e0\r\n";
        assert_eq!(parse(text, ["a", "b"]).unwrap(), [(3, [1.0, 2.0]), (5, [3.0, 4.0])]);
        assert_eq!(parse("a\n", ["a"]).unwrap(), []);
        for (text, expected) in [
            ("", "no column a: the first line names the columns, needed are a, b"),
            ("a,c\n1,2\n", "no column b"),
            ("a,b\n1\n", "line 2: b is missing"),
            ("a,b\n1,2\n1,x\n", "line 3: b: \"x\" is not a number"),
            ("a,b\n1,nan\n", "line 2: b: \"nan\" is not a number"),
            (&",".repeat(300), "more than 256 columns"),
        ] {
            let error = parse(text, ["a", "b"]).unwrap_err();
            assert!(error.contains(expected), "{error}");
        }
    }

    #[test]
    fn times_must_not_decrease() {
        assert_eq!(check_times([(2, 1.0), (3, 1.0), (4, 2.0)].into_iter(), "time_s"), Ok(()));
        let error = check_times([(2, 1.0), (5, 0.5)].into_iter(), "time_s").unwrap_err();
        assert_eq!(error, "line 5: time_s = 0.5 is before 1 of the line above: sort the lines by time");
        assert!(check_times([(2, 5e9)].into_iter(), "time_s").unwrap_err().contains("line 2"));
    }
}
