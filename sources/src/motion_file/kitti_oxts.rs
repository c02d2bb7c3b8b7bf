//! OXTS as KITTI's raw data has it: `oxts/data/*.txt`, a file of 30 numbers for each frame.

use super::table::{fault, number};
use crate::SourceError;
use crate::bounded_file::{FileLimit, read_text};
use crate::limits::MAX_IMAGES;
use std::path::{Path, PathBuf};

/// A file of one frame has about 500 bytes.
const FRAME: FileLimit =
    FileLimit { what: "OXTS of one frame", bytes: 4096, remedy: "give KITTI's oxts/data/*.txt" };

/// Places of the speed forward (vf) and of the yaw rate (wu) in a file.
const SPEED: usize = 8;
/// See [`SPEED`].
const YAW_RATE: usize = 22;

/// Reads speed in m/s and yaw rate in rad/s of each frame from a folder `oxts`, in the order of the names.
///
/// # Errors
/// Names the file or folder and the remedy.
pub fn read_frames(folder: &Path) -> Result<Vec<[f64; 2]>, SourceError> {
    let data = folder.join("data");
    let io = |path: &Path, source| SourceError::Io { path: path.to_owned(), source };
    let mut paths: Vec<PathBuf> = Vec::new();
    for entry in std::fs::read_dir(&data).map_err(|e| io(&data, e))? {
        let path = entry.map_err(|e| io(&data, e))?.path();
        if path.extension().is_none_or(|ending| ending != "txt") {
            continue;
        }
        if paths.len() == MAX_IMAGES {
            let remedy = "divide the recording into folders";
            return Err(SourceError::TooMany { path: data, what: "files", limit: MAX_IMAGES, remedy });
        }
        paths.push(path);
    }
    paths.sort();
    if paths.is_empty() {
        return Err(fault(
            &data,
            "no files: give KITTI's oxts folder, with a text file for each frame".into(),
        ));
    }
    let one = |path: &PathBuf| {
        let text = read_text(path, &FRAME).map_err(|e| io(path, e))?;
        let words: Vec<&str> = text.split_ascii_whitespace().collect();
        let value = |place: usize| {
            let word = words.get(place).ok_or_else(|| format!("{} numbers, not 30", words.len()))?;
            number(word)
        };
        let both = value(SPEED).and_then(|speed| Ok([speed, value(YAW_RATE)?]));
        both.map_err(|reason| fault(path, reason))
    };
    paths.iter().map(one).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn speed_and_yaw_rate_are_at_their_places() {
        let folder = tempfile::tempdir().unwrap();
        let oxts = folder.path().join("oxts");
        assert!(read_frames(&oxts).unwrap_err().to_string().contains("oxts/data"));
        std::fs::create_dir_all(oxts.join("data")).unwrap();
        assert!(read_frames(&oxts).unwrap_err().to_string().contains("no files"));
        // lat lon alt roll pitch yaw vn ve vf vl vu ax ay az af al au wx wy wz wf wl wu, then accuracies.
        let line = |n: usize| (0..30).map(|i| format!("{}", i + 100 * n)).collect::<Vec<_>>().join(" ");
        std::fs::write(oxts.join("data/0000000001.txt"), line(1)).unwrap();
        std::fs::write(oxts.join("data/0000000000.txt"), line(0)).unwrap();
        assert_eq!(read_frames(&oxts).unwrap(), [[8.0, 22.0], [108.0, 122.0]]);
        std::fs::write(oxts.join("data/0000000001.txt"), "1 2 3").unwrap();
        let error = read_frames(&oxts).unwrap_err().to_string();
        assert!(error.contains("0000000001.txt: 3 numbers, not 30"), "{error}");
    }
}
