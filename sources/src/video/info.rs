//! Size, rate and length of a video, from ffprobe or GStreamer.

use crate::SourceError;
use std::io::ErrorKind;
use std::path::Path;
use std::process::{Command, Stdio};

/// Largest width and height of a video, in px.
const MAX_SIDE: usize = 8192;

/// Plausible frame rates, in Hz.
pub const RATES: std::ops::RangeInclusive<f64> = 0.01..=1000.0;

/// Rate of a video that does not tell its own, in Hz, as of folders without times.
pub const DEFAULT_RATE_HZ: f64 = 10.0;

/// What a video is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct VideoInfo {
    /// Width of a frame, in px.
    pub width: usize,
    /// Height of a frame, in px.
    pub height: usize,
    /// Frames a second.
    pub rate_hz: f64,
    /// Number of frames.
    pub frames: u64,
}

impl VideoInfo {
    /// Asks ffprobe; `None` where there is none.
    ///
    /// # Errors
    /// If it cannot read the file.
    pub fn read(path: &Path) -> Result<Option<Self>, SourceError> {
        let output = Command::new("ffprobe")
            .args(["-v", "error", "-protocol_whitelist", "file", "-select_streams", "v:0", "-count_packets"])
            .args([
                "-show_entries",
                "stream=width,height,avg_frame_rate,nb_read_packets",
                "-of",
                "default=nw=1",
            ])
            .arg(as_file(path))
            .stdin(Stdio::null())
            .output();
        let fail = |explanation: String| SourceError::Foreign { path: path.to_owned(), explanation };
        let output = match output {
            Err(error) if error.kind() == ErrorKind::NotFound => return Ok(None),
            Err(error) => {
                return Err(fail(format!("ffprobe cannot be started: {error}: apt install ffmpeg")));
            }
            Ok(output) => output,
        };
        if !output.status.success() {
            let text = String::from_utf8_lossy(&output.stderr).into_owned();
            let reason = text.lines().next_back().unwrap_or("no reason was given").to_owned();
            return Err(fail(format!("ffmpeg cannot read this video: {reason}: is it complete?")));
        }
        parse(&String::from_utf8_lossy(&output.stdout))
            .map(Some)
            .map_err(|reason| fail(format!("{reason}: give a video with both images side by side, or two")))
    }

    /// Time from one frame to the next, in nanoseconds.
    pub fn period_ns(&self) -> u64 {
        (1e9 / self.rate_hz) as u64
    }
}

/// A path as ffmpeg takes it, whatever characters it begins with.
pub fn as_file(path: &Path) -> std::ffi::OsString {
    let mut text = std::ffi::OsString::from("file:");
    text.push(path);
    text
}

/// Checks the size of a frame.
///
/// # Errors
/// If it cannot be read; the text says what can.
pub fn check_side(width: usize, height: usize) -> Result<(), String> {
    if (1..=MAX_SIDE).contains(&width) && (1..=MAX_SIDE).contains(&height) {
        return Ok(());
    }
    Err(format!("frames of {width}x{height} pixels, at most {MAX_SIDE}x{MAX_SIDE} are read"))
}

fn parse(text: &str) -> Result<VideoInfo, String> {
    let of = |name: &str| text.lines().find_map(|line| line.strip_prefix(name)?.strip_prefix('='));
    let side = |name: &str| of(name).and_then(|value| value.parse::<usize>().ok());
    let (Some(width), Some(height)) = (side("width"), side("height")) else {
        return Err("it has no pictures".into());
    };
    check_side(width, height)?;
    let frames = of("nb_read_packets").and_then(|value| value.parse().ok()).unwrap_or(0);
    if frames == 0 {
        return Err("it has no frames".into());
    }
    let rate = of("avg_frame_rate").and_then(|rate| {
        let (count, seconds) = rate.split_once('/')?;
        Some(count.parse::<f64>().ok()? / seconds.parse::<f64>().ok()?)
    });
    let rate_hz = rate.filter(|rate| RATES.contains(rate)).unwrap_or(DEFAULT_RATE_HZ);
    Ok(VideoInfo { width, height, rate_hz, frames })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn answers_of_ffprobe_are_read_and_senseless_ones_refused() {
        let text = "width=1280\nheight=480\navg_frame_rate=30000/1001\nnb_read_packets=17\n";
        let info = parse(text).unwrap();
        assert_eq!((info.width, info.height, info.frames), (1280, 480, 17));
        assert_eq!(info.period_ns(), 33_366_666);
        assert_eq!(parse(&text.replace("30000/1001", "0/0")).unwrap().period_ns(), 100_000_000);
        for (from, to) in [("1280", "100000"), ("width=1280\n", ""), ("=17", "=0"), ("480", "x")] {
            assert!(parse(&text.replace(from, to)).is_err(), "{from} {to}");
        }
    }

    #[test]
    fn a_name_is_no_option_and_no_address() {
        assert_eq!(as_file(Path::new("-i.mp4")), "file:-i.mp4");
    }
}
