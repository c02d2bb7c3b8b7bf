//! Output files of a run: overlays, disparity maps, `obstacles.jsonl` and `summary.json`.

use crate::reporting::overlay::{self, OverlayInput};
use crate::reporting::picture::{PictureError, save_disparity};
use crate::reporting::record::FrameRecord;
use crate::reporting::summary::RunSummary;
use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use thiserror::Error;

/// One line per frame.
pub const LINES: &str = "obstacles.jsonl";

/// Folder of the overlays.
pub const OVERLAYS: &str = "overlay";

/// Summary of the run.
const SUMMARY: &str = "summary.json";

/// Errors when writing results.
#[derive(Debug, Error)]
pub enum OutputError {
    /// A folder or file cannot be written.
    #[error("{}: {source}: give a folder that can be written with --out", path.display())]
    Io {
        /// Path that was written.
        path: PathBuf,
        /// Cause.
        source: io::Error,
    },
    /// An image cannot be written.
    #[error(transparent)]
    Picture(#[from] PictureError),
}

/// Writes frames to a folder in order of arrival.
#[derive(Debug)]
pub struct FrameWriter {
    folder: PathBuf,
    lines: File,
    lines_path: PathBuf,
    last: Option<u64>,
}

/// Creates the folder and its subfolders, and removes the results of an earlier run: images named by a frame
/// number, `obstacles.jsonl` and `summary.json`, nothing else.
///
/// # Errors
/// When a folder cannot be created or a file cannot be removed.
pub fn prepare(folder: &Path) -> Result<(), OutputError> {
    for name in [LINES, SUMMARY] {
        let path = folder.join(name);
        if path.is_file() {
            std::fs::remove_file(&path).map_err(|source| OutputError::Io { path, source })?;
        }
    }
    for part in [OVERLAYS, "disparity"] {
        let path = folder.join(part);
        let io = |source| OutputError::Io { path: path.clone(), source };
        std::fs::create_dir_all(&path).map_err(io)?;
        for entry in std::fs::read_dir(&path).map_err(io)?.flatten() {
            let name = entry.file_name();
            let number = name.to_str().and_then(|n| n.strip_suffix(".png"));
            if number.is_some_and(|n| n.len() >= 6 && n.bytes().all(|b| b.is_ascii_digit())) {
                std::fs::remove_file(entry.path()).map_err(io)?;
            }
        }
    }
    Ok(())
}

/// Name of a frame's images.
pub fn picture_name(sequence: u64) -> String {
    format!("{sequence:06}.png")
}

impl FrameWriter {
    /// Opens a folder created by [`prepare`]. A writer that replaces another one appends to its lines.
    ///
    /// # Errors
    /// When it cannot be written.
    pub fn open(folder: &Path) -> Result<Self, OutputError> {
        let lines_path = folder.join(LINES);
        let last = last_sequence(&lines_path);
        let lines = File::options()
            .create(true)
            .append(true)
            .open(&lines_path)
            .map_err(|source| OutputError::Io { path: lines_path.clone(), source })?;
        Ok(Self { folder: folder.to_owned(), lines, lines_path, last })
    }

    /// Number of the last written frame, including those of a previous writer.
    pub fn last(&self) -> Option<u64> {
        self.last
    }

    /// Writes the record of a frame and, given images, its overlay and disparity map. The line is written last: if
    /// it exists, the images are complete.
    ///
    /// # Errors
    /// When a file cannot be written.
    pub fn write(
        &mut self,
        record: &FrameRecord,
        images: Option<OverlayInput<'_>>,
    ) -> Result<(), OutputError> {
        if let Some(input) = images {
            let name = picture_name(record.sequence);
            overlay::draw(input, record).save(&self.folder.join(OVERLAYS).join(&name))?;
            let path = self.folder.join("disparity").join(&name);
            save_disparity(&path, input.disparity, input.width, input.height)?;
        }
        let io = |source| OutputError::Io { path: self.lines_path.clone(), source };
        let mut line = serde_json::to_vec(record).map_err(|e| io(e.into()))?;
        line.push(b'\n');
        // One write per line, so that a killed writer leaves no partial line.
        self.lines.write_all(&line).map_err(io)?;
        self.last = Some(record.sequence);
        Ok(())
    }
}

/// Bytes at the end of a file in which its last line is searched. A line has some KiB.
const MAX_LINE_BYTES: u64 = 1 << 20;

/// Sequence number in the last line of a file; `None` when there is none.
fn last_sequence(path: &Path) -> Option<u64> {
    let mut file = File::open(path).ok()?;
    let size = file.metadata().ok()?.len();
    file.seek(SeekFrom::Start(size.saturating_sub(MAX_LINE_BYTES))).ok()?;
    let mut end = Vec::new();
    file.take(MAX_LINE_BYTES).read_to_end(&mut end).ok()?;
    let text = String::from_utf8_lossy(&end);
    let record: FrameRecord = serde_json::from_str(text.lines().last()?).ok()?;
    Some(record.sequence)
}

/// Writes `summary.json`.
///
/// # Errors
/// When it cannot be written.
pub fn write_summary(folder: &Path, summary: &RunSummary) -> Result<(), OutputError> {
    let path = folder.join(SUMMARY);
    let mut text = serde_json::to_vec_pretty(summary)
        .map_err(|e| OutputError::Io { path: path.clone(), source: e.into() })?;
    text.push(b'\n');
    std::fs::write(&path, text).map_err(|source| OutputError::Io { path, source })
}

#[cfg(test)]
mod tests {
    use super::*;
    use perception::rig::Rig;

    #[test]
    fn frames_become_files() {
        let folder = tempfile::tempdir().unwrap();
        let out = folder.path().join("a/b");
        prepare(&out).unwrap();
        let mut writer = FrameWriter::open(&out).unwrap();
        let (left, disparity, profile) = (vec![5; 600], vec![256; 600], vec![0.0; 20]);
        let images = OverlayInput {
            left: &left,
            disparity: &disparity,
            profile_px: &profile,
            edges: Default::default(),
            width: 30,
            height: 20,
            rig: Rig { focal_px: 30.0, baseline_m: 0.2, cx_px: 15.0, cy_px: 10.0 },
        };
        writer.write(&FrameRecord { sequence: 7, ..Default::default() }, Some(images)).unwrap();
        drop(writer);
        let mut writer = FrameWriter::open(&out).unwrap();
        assert_eq!(writer.last(), Some(7));
        writer.write(&FrameRecord { sequence: 8, ..Default::default() }, None).unwrap();
        let lines = std::fs::read_to_string(out.join("obstacles.jsonl")).unwrap();
        let sequences: Vec<u64> =
            lines.lines().map(|l| serde_json::from_str::<FrameRecord>(l).unwrap().sequence).collect();
        assert_eq!(sequences, [7, 8]);
        assert!(out.join("overlay/000007.png").is_file() && out.join("disparity/000007.png").is_file());
        write_summary(&out, &RunSummary::default()).unwrap();
        // A new run removes the images of the old one and nothing else.
        std::fs::write(out.join("overlay/mine.png"), b"x").unwrap();
        prepare(&out).unwrap();
        assert!(!out.join("overlay/000007.png").exists() && out.join("overlay/mine.png").exists());
        assert!(!out.join(LINES).exists() && !out.join(SUMMARY).exists());
        std::fs::write(out.join("file"), b"x").unwrap();
        let error = prepare(&out.join("file")).unwrap_err().to_string();
        assert!(error.contains("--out"), "{error}");
    }
}
