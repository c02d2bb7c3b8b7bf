//! The frames of a results folder: their overlays and times.

use super::outcome::VideoError;
use crate::reporting::output::{LINES, OVERLAYS, picture_name};
use crate::reporting::record::FrameRecord;
use image::{DynamicImage, RgbImage};
use sources::{SourceError, picture};
use std::fs::File;
use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};

/// Range of the time between two frames, in seconds: from 120 to 0.5 frames a second.
const PERIOD_S: (f64, f64) = (1.0 / 120.0, 2.0);

/// Period where times do not tell one, in seconds.
const DEFAULT_PERIOD_S: f64 = 0.1;

/// Longest time that one frame is shown, in seconds; a longer gap in the recording is cut short.
const MAX_SHOWN_S: f64 = 2.0;

/// A frame.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Frame {
    path: PathBuf,
    /// How long it is shown, in seconds.
    pub(super) shown_s: f64,
}

/// The frames of a run, in order.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Frames {
    pub(super) frames: Vec<Frame>,
    /// Median time between two frames, in seconds.
    pub(super) period_s: f64,
    /// Width of an overlay in pixels.
    pub(super) width: u32,
    /// Its height.
    pub(super) height: u32,
}

impl Frames {
    /// Reads the list of frames, and the size of the first overlay.
    pub(super) fn open(folder: &Path) -> Result<Self, VideoError> {
        let path = folder.join(LINES);
        let io = |source| VideoError::Io { path: path.clone(), source };
        let (mut paths, mut times_s) = (Vec::new(), Vec::new());
        for line in BufReader::new(File::open(&path).map_err(io)?).lines() {
            let record: FrameRecord = serde_json::from_str(&line.map_err(io)?)
                .map_err(|e| VideoError::Damaged { path: path.clone(), reason: e.to_string() })?;
            let overlay = folder.join(OVERLAYS).join(picture_name(record.sequence));
            // At live rate a result may have come without its images.
            if overlay.is_file() {
                paths.push(overlay);
                times_s.push(record.time_s);
            }
        }
        let first = paths.first().ok_or_else(|| VideoError::Empty(path.clone()))?;
        let first = overlay(first)?;
        let (width, height) = (first.width(), first.height());
        let period_s = period_s(&times_s);
        let shown = times_shown_s(&times_s, period_s);
        let frames = paths.into_iter().zip(shown).map(|(path, shown_s)| Frame { path, shown_s }).collect();
        Ok(Self { frames, period_s, width, height })
    }

    /// The overlay of a frame.
    pub(super) fn picture(&self, frame: &Frame) -> Result<RgbImage, VideoError> {
        let picture = overlay(&frame.path)?.into_rgb8();
        if picture.dimensions() == (self.width, self.height) {
            Ok(picture)
        } else {
            let reason = format!("not {}x{} pixels, as the first overlay", self.width, self.height);
            Err(VideoError::Damaged { path: frame.path.clone(), reason })
        }
    }
}

/// Reads an overlay.
fn overlay(path: &Path) -> Result<DynamicImage, VideoError> {
    picture::read(path).map_err(|error| match error {
        SourceError::Decode { path, reason } => VideoError::Damaged { path, reason },
        SourceError::Io { path, source } => VideoError::Damaged { path, reason: source.to_string() },
        other => VideoError::Damaged { path: path.to_owned(), reason: other.to_string() },
    })
}

/// Median of the steps forward in time.
fn period_s(times_s: &[f64]) -> f64 {
    let mut steps: Vec<f64> = times_s.windows(2).map(|pair| pair[1] - pair[0]).filter(|s| *s > 0.0).collect();
    steps.sort_by(f64::total_cmp);
    let median = steps.get(steps.len() / 2).copied().unwrap_or(DEFAULT_PERIOD_S);
    median.clamp(PERIOD_S.0, PERIOD_S.1)
}

/// How long each frame is shown: until the next; a period where time stands still or goes back, and for the last one.
fn times_shown_s(times_s: &[f64], period_s: f64) -> Vec<f64> {
    let next = times_s.iter().skip(1).map(Some).chain([None]);
    let shown = times_s.iter().zip(next).map(|(time, next)| match next.map(|next| next - time) {
        Some(step) if step > 0.0 => step.min(MAX_SHOWN_S),
        _ => period_s,
    });
    shown.collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_are_shown_until_the_next() {
        let times = [0.0, 0.1, 0.2, 0.4, 0.5, 60.0, 0.1, 0.1, 0.2];
        let period = period_s(&times);
        assert!((period - 0.1).abs() < 1e-9, "{period}");
        let shown = times_shown_s(&times, period);
        let expected = [0.1, 0.1, 0.2, 0.1, MAX_SHOWN_S, 0.1, 0.1, 0.1, 0.1];
        assert!(shown.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-9), "{shown:?}");
        assert_eq!((period_s(&[3.0]), period_s(&[0.0, 1e-9])), (DEFAULT_PERIOD_S, PERIOD_S.0));
        assert!(times_shown_s(&[], 0.1).is_empty());
    }
}
