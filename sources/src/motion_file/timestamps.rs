//! Times of a folder's pairs: `timestamps.csv` with the columns `name` and `left_s`.

use super::table::{check_times, fault, is_blank, number, read};
use crate::SourceError;
use crate::limits::{MAX_IMAGES, MAX_MOTION_COLUMNS};
use std::collections::HashMap;
use std::path::Path;

/// Name of the file in a folder of pairs.
pub const TIMESTAMPS: &str = "timestamps.csv";

/// Times of the left images, in the order of the file.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct FrameTimes {
    /// Names of the images without extension.
    pub names: Vec<String>,
    /// Times of the exposures, in seconds; they do not decrease.
    pub times_s: Vec<f64>,
}

impl FrameTimes {
    /// The times of the named images, in their order.
    ///
    /// # Errors
    /// The first name that has no time, or whose time is before that of the name above.
    pub fn of<'a>(&self, names: impl Iterator<Item = &'a str>) -> Result<Vec<f64>, String> {
        let known: HashMap<&str, f64> =
            self.names.iter().map(String::as_str).zip(self.times_s.iter().copied()).collect();
        let mut before = f64::NEG_INFINITY;
        names
            .map(|name| {
                let time_s = *known
                    .get(name)
                    .ok_or_else(|| format!("no line for image {name}: add it, or remove the file"))?;
                if time_s < before {
                    return Err(format!(
                        "left_s = {time_s} of image {name} is before that of the image before it"
                    ));
                }
                before = time_s;
                Ok(time_s)
            })
            .collect()
    }
}

/// Reads `timestamps.csv`: the columns `name` and `left_s`; others, such as `right_s`, are ignored.
///
/// # Errors
/// Names the file, the line and the remedy.
pub fn read_timestamps(path: &Path) -> Result<FrameTimes, SourceError> {
    parse(&read(path)?).map_err(|reason| fault(path, reason))
}

fn parse(text: &str) -> Result<FrameTimes, String> {
    let mut lines = text.lines().zip(1..).filter(|(line, _)| !is_blank(line));
    let head = lines.next().map_or("", |(line, _)| line.trim_start_matches('\u{feff}'));
    let place = |wanted: &str| {
        let found = head.split(',').take(MAX_MOTION_COLUMNS).position(|column| column.trim() == wanted);
        found.ok_or_else(|| {
            format!("no column {wanted}: the first line names the columns, needed are name, left_s")
        })
    };
    let (name_at, time_at) = (place("name")?, place("left_s")?);
    let mut times = FrameTimes::default();
    let mut numbers = Vec::new();
    for (line, at) in lines {
        if numbers.len() == MAX_IMAGES {
            return Err(format!(
                "line {at}: more than {MAX_IMAGES} images: divide the recording into folders"
            ));
        }
        let word = |place: usize, name: &str| {
            line.split(',').nth(place).map(str::trim).ok_or_else(|| format!("line {at}: {name} is missing"))
        };
        let name = word(name_at, "name")?;
        // With or without the extension of the image.
        let name = Path::new(name).file_stem().and_then(|stem| stem.to_str()).unwrap_or(name);
        let time_s = number(word(time_at, "left_s")?).map_err(|e| format!("line {at}: left_s: {e}"))?;
        times.names.push(name.to_owned());
        times.times_s.push(time_s);
        numbers.push(at);
    }
    check_times(numbers.into_iter().zip(times.times_s.iter().copied()), "left_s")?;
    Ok(times)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_have_times() {
        let times = parse("name,left_s,right_s\n000001,1.5,1.6\n000002.png,2.5,2.6\n").unwrap();
        assert_eq!(times.of(["000001", "000002"].into_iter()), Ok(vec![1.5, 2.5]));
        assert_eq!(times.of(["000002"].into_iter()), Ok(vec![2.5]));
        assert!(times.of(["7"].into_iter()).unwrap_err().contains("no line for image 7"));
        assert!(times.of(["000002", "000001"].into_iter()).unwrap_err().contains("image 000001 is before"));
        for (text, expected) in [
            ("name,right_s\n", "no column left_s"),
            ("name,left_s\na\n", "line 2: left_s is missing"),
            ("name,left_s\na,now\n", "line 2: left_s: \"now\" is not a number"),
            ("name,left_s\na,2\nb,1\n", "line 3: left_s = 1 is before 2"),
        ] {
            let error = parse(text).unwrap_err();
            assert!(error.contains(expected), "{error}");
        }
    }
}
