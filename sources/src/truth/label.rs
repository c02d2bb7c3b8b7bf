//! Labels of the KITTI object benchmark: class, image box and position.

use super::error::TruthError;
use crate::bounded_file::read_text;
use crate::limits::{LABELS, MAX_LABELS};
use perception::excerpt::{VALUE_CHARS, excerpt};
use std::path::Path;

/// One labelled object.
#[derive(Clone, Debug, PartialEq)]
pub struct Label {
    /// `Car`, `Van`, `Truck`, `Pedestrian`, `Cyclist`, …
    pub class: String,
    /// Share of the object outside the image, 0 to 1.
    pub truncated: f64,
    /// 0 fully visible, 1 partly occluded, 2 largely occluded, 3 unknown.
    pub occluded: u8,
    /// Left, top, right and bottom of its box, in px.
    pub bounds_px: [f64; 4],
    /// Height in metres.
    pub height_m: f64,
    /// Width in metres.
    pub width_m: f64,
    /// Length in metres.
    pub length_m: f64,
    /// Distance of its centre along the camera's axis, in metres.
    pub distance_m: f64,
}

/// Reads a label file; `DontCare` lines, which label no object, are skipped.
///
/// # Errors
/// Names the file, the line and the expected content.
pub fn read(path: &Path) -> Result<Vec<Label>, TruthError> {
    let io = |source| TruthError::Io { path: path.to_owned(), source };
    let text = read_text(path, &LABELS).map_err(io)?;
    let lines = text.lines().zip(1..).filter(|(line, _)| !line.trim().is_empty());
    let mut labels = Vec::new();
    for (line, number) in lines {
        let parsed = label(line).map_err(|reason| TruthError::Map {
            path: path.to_owned(),
            reason: format!("line {number}: {reason}"),
        })?;
        if labels.len() == MAX_LABELS && parsed.class != "DontCare" {
            let reason = format!(
                "line {number}: more than {MAX_LABELS} objects: an image has at most so many; give one label \
                 file for each image"
            );
            return Err(TruthError::Map { path: path.to_owned(), reason });
        }
        labels.extend((parsed.class != "DontCare").then_some(parsed));
    }
    Ok(labels)
}

fn label(line: &str) -> Result<Label, String> {
    let words: Vec<&str> = line.split_ascii_whitespace().collect();
    let [class, numbers @ ..] = &words[..] else { return Err("empty".into()) };
    // A sixteenth field is the score of a detector's result.
    if ![14, 15].contains(&numbers.len()) {
        return Err(format!("{} fields: KITTI's labels have 15", words.len()));
    }
    let numbers: Vec<f64> = numbers
        .iter()
        .map(|word| {
            let value = word.parse().ok().filter(|v: &f64| v.is_finite());
            value.ok_or_else(|| format!("\"{}\" is not a number", excerpt(word, VALUE_CHARS)))
        })
        .collect::<Result<_, _>>()?;
    Ok(Label {
        class: (*class).to_owned(),
        truncated: numbers[0],
        occluded: numbers[1].clamp(0.0, 3.0) as u8,
        bounds_px: [numbers[3], numbers[4], numbers[5], numbers[6]],
        height_m: numbers[7],
        width_m: numbers[8],
        length_m: numbers[9],
        distance_m: numbers[12],
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    const CAR: &str = "Car 0.24 1 1.94 11.50 172.55 405.84 374.00 1.68 1.63 3.90 -3.18 1.71 6.59 1.51";

    fn read_text(text: &str) -> Result<Vec<Label>, String> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("000007.txt");
        std::fs::write(&path, text).unwrap();
        read(&path).map_err(|e| e.to_string())
    }

    #[test]
    fn objects_are_read_and_regions_to_ignore_are_not() {
        let text = format!("{CAR}\n\nDontCare -1 -1 -10 1 2 3 4 -1 -1 -1 -1000 -1000 -1000 -10\n");
        let labels = read_text(&text).unwrap();
        let car = Label {
            class: "Car".into(),
            truncated: 0.24,
            occluded: 1,
            bounds_px: [11.5, 172.55, 405.84, 374.0],
            height_m: 1.68,
            width_m: 1.63,
            length_m: 3.9,
            distance_m: 6.59,
        };
        assert_eq!(labels, [car]);
        assert_eq!(read_text("").unwrap(), []);
    }

    #[test]
    fn faults_name_the_line() {
        for (text, expected) in [
            (CAR.replace("6.59", "near"), "000007.txt: line 1: \"near\" is not a number"),
            (CAR.replace("6.59", "inf"), "\"inf\" is not a number"),
            (format!("{CAR}\n").repeat(2001), "line 2001: more than 2000 objects"),
            ("x".repeat(2 << 20), "2097152 bytes: a label file has at most 1048576; give the labels"),
            (format!("{CAR}\nCar 1 2"), "line 2: 3 fields: KITTI's labels have 15"),
        ] {
            let error = read_text(&text).unwrap_err();
            assert!(error.contains(expected), "{error}");
        }
    }
}
