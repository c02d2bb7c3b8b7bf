//! The program that encodes: ffmpeg, or GStreamer. It gets raw pictures through a pipe, and writes the file.

use super::frames::Frames;
use super::outcome::{Video, VideoError};
use image::RgbImage;
use std::ffi::{OsStr, OsString};
use std::io::{self, Read, Write};
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};

/// Bytes of the program's error messages that are repeated.
const MAX_WORDS: u64 = 2000;

/// GStreamer's elements for a container.
struct Elements {
    container: &'static str,
    /// Encoders in the order of preference, each with its parser.
    encoders: &'static [(&'static str, &'static str)],
    multiplexer: &'static str,
}

const ELEMENTS: [Elements; 3] = [
    Elements { container: "mp4", encoders: H264, multiplexer: "mp4mux" },
    Elements { container: "mkv", encoders: H264, multiplexer: "matroskamux" },
    Elements {
        container: "webm",
        encoders: &[("vp8enc", "identity"), ("vp9enc", "identity")],
        multiplexer: "webmmux",
    },
];

/// H.264: software encoders, then that of the Raspberry Pi and others.
const H264: &[(&str, &str)] =
    &[("x264enc", "h264parse"), ("openh264enc", "h264parse"), ("v4l2h264enc", "h264parse")];

/// A program that can write a container.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum Program {
    /// ffmpeg, with the encoder that it prefers for the container.
    Ffmpeg(PathBuf),
    /// `gst-launch-1.0`, with the end of its pipeline.
    GStreamer { launch: PathBuf, encoder: &'static str, parser: &'static str, multiplexer: &'static str },
}

/// The executable file `name` in one of the folders of `search`.
fn executable(name: &str, search: &OsStr) -> Option<PathBuf> {
    let is_executable =
        |path: &PathBuf| path.metadata().is_ok_and(|m| m.is_file() && m.permissions().mode() & 0o111 != 0);
    // An empty entry means the working folder, where nobody expects programs.
    let folders = std::env::split_paths(search).filter(|folder| !folder.as_os_str().is_empty());
    folders.map(|folder| folder.join(name)).find(is_executable)
}

impl Program {
    /// A program for a container.
    ///
    /// # Errors
    /// What was not found.
    pub(super) fn find(container: &str, search: &OsStr) -> Result<Self, String> {
        if let Some(ffmpeg) = executable("ffmpeg", search) {
            return Ok(Self::Ffmpeg(ffmpeg));
        }
        let both = (executable("gst-launch-1.0", search), executable("gst-inspect-1.0", search));
        let (Some(launch), Some(inspect)) = both else {
            return Err("neither ffmpeg nor GStreamer (gst-launch-1.0) is on the PATH".into());
        };
        let exists = |element: &str| {
            let mut command = Command::new(&inspect);
            command.args(["--exists", element]).stdout(Stdio::null()).stderr(Stdio::null());
            command.status().is_ok_and(|status| status.success())
        };
        let Some(elements) = ELEMENTS.iter().find(|elements| elements.container == container) else {
            return Err(format!("GStreamer is not used for .{container}"));
        };
        let multiplexer = elements.multiplexer;
        if !exists("rawvideoparse") || !exists(multiplexer) {
            return Err(format!(
                "ffmpeg is not on the PATH, and GStreamer has no rawvideoparse or {multiplexer}"
            ));
        }
        let encoders = elements.encoders;
        match encoders.iter().find(|(encoder, parser)| exists(encoder) && exists(parser)) {
            Some((encoder, parser)) => Ok(Self::GStreamer { launch, encoder, parser, multiplexer }),
            None => {
                let names: Vec<_> = encoders.iter().map(|(encoder, _)| *encoder).collect();
                Err(format!("ffmpeg is not on the PATH, and GStreamer has none of {}", names.join(", ")))
            }
        }
    }

    fn name(&self) -> &'static str {
        match self {
            Self::Ffmpeg(_) => "ffmpeg",
            Self::GStreamer { .. } => "gst-launch-1.0",
        }
    }

    /// The command for pictures of a size that is even, of a period in microseconds.
    fn command(&self, (width, height): (u32, u32), period_us: u32, path: &Path) -> Command {
        match self {
            Self::Ffmpeg(ffmpeg) => {
                let mut command = Command::new(ffmpeg);
                command.args(["-nostdin", "-loglevel", "error", "-y", "-f", "rawvideo", "-pix_fmt", "rgb24"]);
                command.arg("-video_size").arg(format!("{width}x{height}"));
                command.arg("-framerate").arg(format!("1000000/{period_us}"));
                // Chroma at half size is what every player can show.
                command.args(["-i", "pipe:0", "-an", "-pix_fmt", "yuv420p"]);
                // A name with a colon is no protocol, one with a dash no option.
                let mut file = OsString::from("file:");
                file.push(path);
                command.arg(file);
                command
            }
            Self::GStreamer { launch, encoder, parser, multiplexer } => {
                let mut command = Command::new(launch);
                command.args(["-q", "fdsrc", "fd=0", "!", "rawvideoparse", "format=rgbx"]);
                command.arg(format!("width={width}")).arg(format!("height={height}"));
                command.arg(format!("framerate=1000000/{period_us}"));
                command.args(["!", "videoconvert", "!", "video/x-raw,format=I420", "!", encoder]);
                command.args(["!", parser, "!", multiplexer, "!", "filesink"]);
                let mut location = OsString::from("location=");
                location.push(path);
                command.arg(location);
                command
            }
        }
    }

    /// Writes the video to `path`.
    pub(super) fn write(
        &self,
        frames: &Frames,
        path: &Path,
        done: &mut dyn FnMut(u64),
    ) -> Result<Video, VideoError> {
        let failed = |reason: String| VideoError::Failed { program: self.name().into(), reason };
        let even = |pixels: u32| (pixels & !1).max(2);
        let size = (even(frames.width), even(frames.height));
        let period_us = (frames.period_s * 1e6).round() as u32;
        let mut child = self
            .command(size, period_us, path)
            .stdin(Stdio::piped())
            .stdout(Stdio::null())
            .stderr(Stdio::piped())
            .spawn()
            .map_err(|e| failed(e.to_string()))?;
        let words = last_words(&mut child);
        let pixels: fn(RgbImage) -> Vec<u8> = match self {
            Self::Ffmpeg(_) => RgbImage::into_raw,
            Self::GStreamer { .. } => with_fourth_byte,
        };
        let sent = send(&mut child, frames, (size, pixels), done);
        // Its input has ended: it completes the file.
        let status = child.wait().map_err(|e| failed(e.to_string()))?;
        let words = words.and_then(|thread| thread.join().ok()).unwrap_or_default();
        match sent {
            Err(error @ (VideoError::Damaged { .. } | VideoError::Empty(_))) => Err(error),
            Ok(pictures) if status.success() => {
                let seconds = pictures as f64 * frames.period_s;
                Ok(Video { pictures, seconds, left_out: 0 })
            }
            _ if words.is_empty() => Err(failed(format!("ended with {status}"))),
            _ => Err(failed(words)),
        }
    }
}

/// Collects what the program says on its standard error, so that it never waits for a reader.
fn last_words(child: &mut Child) -> Option<std::thread::JoinHandle<String>> {
    let mut errors = child.stderr.take()?;
    let collect = move || {
        let mut words = Vec::new();
        let _ = errors.by_ref().take(MAX_WORDS).read_to_end(&mut words);
        let _ = io::copy(&mut errors, &mut io::sink());
        String::from_utf8_lossy(&words).trim().replace('\n', "; ")
    };
    std::thread::Builder::new().name("encoder".into()).spawn(collect).ok()
}

/// Pixels of four bytes: GStreamer takes rows of three bytes a pixel for padded to a multiple of four.
fn with_fourth_byte(picture: RgbImage) -> Vec<u8> {
    picture.pixels().flat_map(|pixel| [pixel.0[0], pixel.0[1], pixel.0[2], u8::MAX]).collect()
}

/// Size of the pictures that an encoder takes, and how their pixels are written.
type Pixels = ((u32, u32), fn(RgbImage) -> Vec<u8>);

/// Sends all pictures, each as often as its time requires; returns their number.
fn send(
    child: &mut Child,
    frames: &Frames,
    ((width, height), pixels): Pixels,
    done: &mut dyn FnMut(u64),
) -> Result<u64, VideoError> {
    let pipe = |source| VideoError::Io { path: "the pipe to the encoder".into(), source };
    let mut input = child.stdin.take().ok_or_else(|| pipe(io::ErrorKind::BrokenPipe.into()))?;
    let (mut pictures, mut time_s) = (0, 0.0);
    for (i, frame) in frames.frames.iter().enumerate() {
        let mut picture = frames.picture(frame)?;
        if picture.dimensions() != (width, height) {
            // Without its last column or row; of a single one, repeated.
            let (from_width, from_height) = picture.dimensions();
            picture = RgbImage::from_fn(width, height, |x, y| {
                *picture.get_pixel(x.min(from_width - 1), y.min(from_height - 1))
            });
        }
        time_s += frame.shown_s;
        // At least once: no frame is left out.
        let until = ((time_s / frames.period_s).round() as u64).max(pictures + 1);
        let bytes = pixels(picture);
        for _ in pictures..until {
            input.write_all(&bytes).map_err(pipe)?;
        }
        pictures = until;
        done(i as u64 + 1);
    }
    Ok(pictures)
}
