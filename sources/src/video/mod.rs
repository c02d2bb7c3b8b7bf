//! Stereo pairs from videos, decoded by the program ffmpeg or else by GStreamer where it is built in: one video with both
//! images side by side, or two.

#[cfg(feature = "gstreamer")]
mod gstreamer;
mod info;
mod stream;

use crate::calibration_file::{self, Calibration};
use crate::foreign;
use crate::{Geometry, PairSource, SourceError, check_two_files};
use info::VideoInfo;
use perception::rig::Rig;
use std::path::{Path, PathBuf};
use stream::VideoStream;

/// Files beside a video that may hold its calibration.
const CALIBRATIONS: [&str; 2] = ["rig.toml", "calib.txt"];

/// Largest difference of the frame rates of two videos of a pair, relative to the first.
const MAX_RATE_DIFFERENCE: f64 = 1e-3;

/// The videos of a source.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum VideoFiles {
    /// One with both images, the left one in the left half.
    SideBySide(PathBuf),
    /// One for each camera.
    Two(PathBuf, PathBuf),
}

impl VideoFiles {
    /// The videos that a path, or else the names of left and right pictures, mean; `None` if they are none.
    pub fn named(path: &Path, left: &Path, right: &Path) -> Option<Self> {
        if foreign::is_video(left) && foreign::is_video(right) {
            return Some(Self::Two(left.to_owned(), right.to_owned()));
        }
        foreign::is_video(path).then(|| Self::SideBySide(path.to_owned()))
    }
}

impl VideoFiles {
    /// Checks that the videos are there, before a decoder is asked for.
    fn check_there(&self) -> Result<(), SourceError> {
        let (first, second) = match self {
            Self::SideBySide(path) => (path, None),
            Self::Two(left, right) => (left, Some(right)),
        };
        for path in [Some(first), second].into_iter().flatten() {
            let is_there =
                path.try_exists().map_err(|source| SourceError::Io { path: path.clone(), source })?;
            if !is_there {
                return Err(SourceError::Foreign {
                    path: path.clone(),
                    explanation: "there is no such file: give the path of a video".into(),
                });
            }
        }
        Ok(())
    }
}

/// What decodes a video.
enum Decoder {
    Ffmpeg(VideoStream),
    #[cfg(feature = "gstreamer")]
    GStreamer(gstreamer::GstVideo),
}

impl Decoder {
    /// ffmpeg where it is on the `PATH`, else GStreamer.
    fn open(path: &Path) -> Result<(Self, VideoInfo), SourceError> {
        if let Some(info) = VideoInfo::read(path)? {
            return Ok((Self::Ffmpeg(VideoStream::new(path, &info)), info));
        }
        #[cfg(feature = "gstreamer")]
        {
            let info = gstreamer::info(path)?;
            Ok((Self::GStreamer(gstreamer::GstVideo::new(path, &info)), info))
        }
        #[cfg(not(feature = "gstreamer"))]
        Err(SourceError::Foreign { path: path.to_owned(), explanation: foreign::video_without_ffmpeg(path) })
    }

    fn read(&mut self, index: u64, frame: &mut [u8]) -> Result<(), SourceError> {
        match self {
            Self::Ffmpeg(stream) => stream.read(index, frame),
            #[cfg(feature = "gstreamer")]
            Self::GStreamer(video) => video.read(index, frame),
        }
    }
}

/// Pairs of one or two videos.
pub struct VideoSource {
    decoders: Vec<Decoder>,
    /// One frame with both images.
    both: Vec<u8>,
    size: (usize, usize),
    count: u64,
    period_ns: u64,
    rig: Option<Rig>,
    rig_file: Option<PathBuf>,
    geometry: Geometry,
    notes: Vec<String>,
}

impl VideoSource {
    /// Opens videos; the calibration is read beside them.
    ///
    /// # Errors
    /// If nothing is here that decodes them, they cannot be read, or they do not belong together.
    pub fn open(files: &VideoFiles) -> Result<Self, SourceError> {
        files.check_there()?;
        let (first, opened, size) = match files {
            VideoFiles::SideBySide(path) => {
                let (decoder, info) = Decoder::open(path)?;
                let size = (info.width / 2, info.height);
                (path, vec![(path, decoder, info)], size)
            }
            VideoFiles::Two(left, right) => {
                check_two_files(left, right)?;
                let ((a, a_info), (b, b_info)) = (Decoder::open(left)?, Decoder::open(right)?);
                check_sizes(left, &a_info, right, &b_info)?;
                let size = (a_info.width, a_info.height);
                (left, vec![(left, a, a_info), (right, b, b_info)], size)
            }
        };
        let infos: Vec<_> = opened.iter().map(|(path, _, info)| (*path, *info)).collect();
        let mut source = Self {
            decoders: opened.into_iter().map(|(_, decoder, _)| decoder).collect(),
            both: Vec::new(),
            size,
            count: infos.iter().map(|(_, info)| info.frames).min().unwrap_or(0),
            period_ns: infos[0].1.period_ns(),
            rig: None,
            rig_file: None,
            geometry: Geometry::Unknown,
            notes: Vec::new(),
        };
        if let [(_, info)] = &infos[..] {
            source.both = vec![0; info.width * info.height];
            source.notes.push(format!(
                "{}: a video with both images side by side is expected; two videos are named by --left and --right",
                first.display()
            ));
        }
        source.note_differences(&infos);
        source.find_rig(first)?;
        Ok(source)
    }

    /// Notes where two videos differ.
    fn note_differences(&mut self, infos: &[(&PathBuf, VideoInfo)]) {
        let [(left, a), (right, b)] = infos else { return };
        let (left, right) = (left.display(), right.display());
        if (a.rate_hz - b.rate_hz).abs() > MAX_RATE_DIFFERENCE * a.rate_hz {
            self.notes.push(format!(
                "{left} has {:.3} frames a second, {right} {:.3}: pairs drift apart in time",
                a.rate_hz, b.rate_hz
            ));
        }
        if a.frames != b.frames {
            self.notes.push(format!(
                "{left} has {} frames, {right} {}: the longer one is cut at its end",
                a.frames, b.frames
            ));
        }
    }

    /// The calibration beside the first video.
    fn find_rig(&mut self, video: &Path) -> Result<(), SourceError> {
        let beside = CALIBRATIONS.map(|name| video.with_file_name(name));
        let Some(file) = beside.into_iter().find(|file| file.is_file()) else { return Ok(()) };
        let calibration = calibration_file::open_for(&file, true, self.size)?;
        if let Calibration::Rectified { .. } = calibration {
            self.geometry = Geometry::Rectified;
        }
        (self.rig, self.rig_file) = (Some(calibration.rig()), Some(file));
        Ok(())
    }
}

fn check_sizes(left: &Path, a: &VideoInfo, right: &Path, b: &VideoInfo) -> Result<(), SourceError> {
    if (a.width, a.height) == (b.width, b.height) {
        return Ok(());
    }
    Err(SourceError::Size {
        path: right.to_owned(),
        size: (b.width, b.height),
        first: left.to_owned(),
        expected: (a.width, a.height),
    })
}

impl PairSource for VideoSource {
    fn size(&self) -> (usize, usize) {
        self.size
    }

    fn rig(&self) -> Option<Rig> {
        self.rig
    }

    fn geometry(&self) -> Geometry {
        self.geometry
    }

    fn rig_file(&self) -> Option<&Path> {
        self.rig_file.as_deref()
    }

    fn count(&self) -> Option<u64> {
        Some(self.count)
    }

    fn period_ns(&self) -> u64 {
        self.period_ns
    }

    fn notes(&self) -> Vec<String> {
        self.notes.clone()
    }

    fn read(&mut self, index: u64, left: &mut [u8], right: &mut [u8]) -> Result<(), SourceError> {
        if index >= self.count {
            return Err(SourceError::End { index, count: self.count });
        }
        match &mut self.decoders[..] {
            [one] => {
                one.read(index, &mut self.both)?;
                let (width, stride) = (self.size.0, self.both.len() / self.size.1.max(1));
                let rows = self.both.chunks_exact(stride.max(1));
                for ((row, left), right) in
                    rows.zip(left.chunks_exact_mut(width)).zip(right.chunks_exact_mut(width))
                {
                    left.copy_from_slice(&row[..width]);
                    right.copy_from_slice(&row[width..2 * width]);
                }
                Ok(())
            }
            [one, two] => {
                one.read(index, left)?;
                two.read(index, right)
            }
            _ => Err(SourceError::End { index, count: 0 }),
        }
    }
}
