//! The frames of a video, decoded by ffmpeg in a process of its own.

use super::info::{VideoInfo, as_file};
use crate::SourceError;
use std::io::Read;
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdout, Command, Stdio};

/// Grey frames of a video, in order.
pub struct VideoStream {
    path: PathBuf,
    /// ffmpeg and its output; `None` before the first frame and after an error.
    running: Option<(Child, ChildStdout)>,
    /// Where it ended before, if it did.
    ended: Option<u64>,
    /// Number of the next frame that it delivers.
    next: u64,
    /// Bytes of a frame.
    bytes: usize,
}

impl VideoStream {
    /// The frames of a file; nothing is started yet.
    pub fn new(path: &Path, info: &VideoInfo) -> Self {
        Self { path: path.to_owned(), running: None, ended: None, next: 0, bytes: info.width * info.height }
    }

    /// Reads frame `index` as grey levels, row-major. Frames before it are skipped; an earlier one than the last needs a
    /// new start of the video.
    ///
    /// # Errors
    /// If ffmpeg cannot be started, or ends before the frame.
    pub fn read(&mut self, index: u64, frame: &mut [u8]) -> Result<(), SourceError> {
        let fail = |path: &Path, reason: String| SourceError::Decode { path: path.to_owned(), reason };
        if frame.len() != self.bytes {
            let reason = format!("a frame has {} bytes, not {}", self.bytes, frame.len());
            return Err(fail(&self.path, reason));
        }
        if let Some(end) = self.ended.filter(|end| index >= *end) {
            return Err(fail(&self.path, format!("the video ends before frame {end}")));
        }
        if self.running.is_none() || index < self.next {
            self.start()?;
        }
        let Some((_, output)) = &mut self.running else {
            return Err(fail(&self.path, "ffmpeg does not run".into()));
        };
        while self.next <= index {
            if let Err(error) = output.read_exact(frame) {
                let reason = format!("ffmpeg ended before frame {}: {error}", self.next);
                self.ended = Some(self.next);
                self.stop();
                return Err(fail(&self.path, reason));
            }
            self.next += 1;
        }
        Ok(())
    }

    fn start(&mut self) -> Result<(), SourceError> {
        self.stop();
        let spawned = Command::new("ffmpeg")
            .args(["-v", "quiet", "-nostdin", "-noautorotate", "-protocol_whitelist", "file,pipe", "-i"])
            .arg(as_file(&self.path))
            .args(["-map", "0:v:0", "-vsync", "passthrough", "-pix_fmt", "gray", "-f", "rawvideo", "pipe:1"])
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn();
        let mut child = spawned.map_err(|source| SourceError::Io { path: "ffmpeg".into(), source })?;
        self.running = child.stdout.take().map(|output| (child, output));
        self.next = 0;
        Ok(())
    }

    fn stop(&mut self) {
        if let Some((mut child, output)) = self.running.take() {
            drop(output);
            // It may have ended already.
            let _ = child.kill();
            let _ = child.wait();
        }
    }
}

impl Drop for VideoStream {
    fn drop(&mut self) {
        self.stop();
    }
}
