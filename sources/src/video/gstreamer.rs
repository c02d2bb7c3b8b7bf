//! Videos decoded by GStreamer, where its support is built in and ffmpeg is missing.

use super::info::{DEFAULT_RATE_HZ, RATES, VideoInfo, check_side};
use crate::SourceError;
use gst::prelude::*;
use gst_app::AppSink;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

/// Longest wait for the next frame of a file, and for its first one, as a number of waits of [`SLICE`] each.
const PATIENCE: u32 = 300;

/// How often a wait looks for an error, after which no frame comes.
const SLICE: gst::ClockTime = gst::ClockTime::from_mseconds(100);

/// Size, rate and number of frames of a video. Its frames are counted without decoding them.
///
/// # Errors
/// If GStreamer cannot read or decode it; the text has GStreamer's reason.
pub fn info(path: &Path) -> Result<VideoInfo, SourceError> {
    let fail = |explanation: String| SourceError::Foreign { path: path.to_owned(), explanation };
    let decoding = Decoding::start(path).map_err(&fail)?;
    let sample = decoding.wait(|sink| sink.try_pull_preroll(SLICE));
    let caps = sample.as_ref().and_then(|sample| sample.caps()?.structure(0));
    let caps = caps.ok_or_else(|| fail(decoding.fault("has no pictures")))?;
    let side = |name: &str| caps.get::<i32>(name).ok().and_then(|side| usize::try_from(side).ok());
    let (Some(width), Some(height)) = (side("width"), side("height")) else {
        return Err(fail(decoding.fault("has no pictures")));
    };
    check_side(width, height).map_err(&fail)?;
    let rate = caps.get::<gst::Fraction>("framerate").ok().filter(|rate| rate.denom() != 0);
    let rate = rate.map(|rate| f64::from(rate.numer()) / f64::from(rate.denom()));
    let rate_hz = rate.filter(|rate| RATES.contains(rate)).unwrap_or(DEFAULT_RATE_HZ);
    match count(path).map_err(&fail)? {
        0 => Err(fail("GStreamer finds no frames in it".into())),
        frames => Ok(VideoInfo { width, height, rate_hz, frames }),
    }
}

/// Number of frames of the first video stream: its parsed, not decoded buffers.
fn count(path: &Path) -> Result<u64, String> {
    let (pipeline, source) = pipeline_from(path)?;
    let parser = element("parsebin")?;
    let add = |part: &gst::Element| pipeline.add(part).map_err(|error| error.to_string());
    add(&parser)?;
    source.link(&parser).map_err(|error| error.to_string())?;
    let frames = Arc::new(AtomicU64::new(0));
    let (counter, whole, is_taken) = (frames.clone(), pipeline.downgrade(), AtomicU64::new(0));
    parser.connect_pad_added(move |_, pad| {
        let (Some(pipeline), Ok(sink)) = (whole.upgrade(), element("fakesink")) else { return };
        sink.set_property("sync", false);
        let caps = pad.current_caps().unwrap_or_else(|| pad.query_caps(None));
        let is_video = caps.structure(0).is_some_and(|caps| caps.name().starts_with("video/"));
        if is_video && is_taken.fetch_add(1, Ordering::Relaxed) == 0 {
            let counter = counter.clone();
            pad.add_probe(gst::PadProbeType::BUFFER, move |_, probe| {
                // The heads of Theora and others travel as buffers.
                if probe.buffer().is_some_and(|buffer| !buffer.flags().contains(gst::BufferFlags::HEADER)) {
                    counter.fetch_add(1, Ordering::Relaxed);
                }
                gst::PadProbeReturn::Ok
            });
        }
        // A stream that cannot be linked is left out: if it was the video's, no frames are counted, which is an error.
        if pipeline.add(&sink).is_ok() && sink.sync_state_with_parent().is_ok() {
            let _ = sink.static_pad("sink").map(|target| pad.link(&target));
        }
    });
    let running = Running(pipeline);
    running.play()?;
    let bus = running.0.bus().ok_or("GStreamer has no messages")?;
    let ends = [gst::MessageType::Eos, gst::MessageType::Error];
    match bus.timed_pop_filtered(gst::ClockTime::NONE, &ends).as_ref().map(|message| message.view()) {
        Some(gst::MessageView::Error(error)) => {
            Err(format!("GStreamer cannot read this video: {}", error.error()))
        }
        _ => Ok(frames.load(Ordering::Relaxed)),
    }
}

/// A pipeline that is stopped when it goes.
struct Running(gst::Pipeline);

impl Running {
    fn play(&self) -> Result<(), String> {
        match self.0.set_state(gst::State::Playing) {
            Ok(_) => Ok(()),
            Err(_) => Err(reason_of(&self.0, "GStreamer cannot open this video")),
        }
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        // What cannot be stopped is gone anyway.
        let _ = self.0.set_state(gst::State::Null);
    }
}

/// What a pipeline reports as its error, after `what`. It may end before it says why.
fn reason_of(pipeline: &gst::Pipeline, what: &str) -> String {
    let bus = pipeline.bus();
    let said = bus.and_then(|bus| bus.timed_pop_filtered(SLICE, &[gst::MessageType::Error]));
    match said.as_ref().map(|message| message.view()) {
        Some(gst::MessageView::Error(error)) => format!("{what}: {}", error.error()),
        _ => what.into(),
    }
}

fn element(name: &str) -> Result<gst::Element, String> {
    gst::ElementFactory::make(name)
        .build()
        .map_err(|_| format!("GStreamer has no {name}: apt install gstreamer1.0-plugins-base, or ffmpeg"))
}

/// A pipeline with the file's source in it.
fn pipeline_from(path: &Path) -> Result<(gst::Pipeline, gst::Element), String> {
    gst::init().map_err(|error| format!("GStreamer cannot be used: {error}"))?;
    let (pipeline, source) = (gst::Pipeline::new(), element("filesrc")?);
    // A property, no text of a pipeline: names may hold any characters.
    source.set_property("location", path.to_str().ok_or("its name is not UTF-8: rename it")?);
    pipeline.add(&source).map_err(|error| error.to_string())?;
    Ok((pipeline, source))
}

/// A video that is being decoded to grey frames.
struct Decoding {
    running: Running,
    sink: AppSink,
}

impl Decoding {
    fn start(path: &Path) -> Result<Self, String> {
        let (pipeline, source) = pipeline_from(path)?;
        let (decoder, convert) = (element("decodebin")?, element("videoconvert")?);
        let grey = gst::Caps::builder("video/x-raw").field("format", "GRAY8").build();
        let sink = AppSink::builder().sync(false).max_buffers(4).drop(false).caps(&grey).build();
        let parts = [&decoder, &convert, sink.upcast_ref()];
        pipeline.add_many(parts).map_err(|error| error.to_string())?;
        source.link(&decoder).map_err(|error| error.to_string())?;
        convert.link(&sink).map_err(|error| error.to_string())?;
        decoder.connect_pad_added(move |_, pad| {
            // Sound does not fit, and a second picture finds the place taken.
            let _ =
                convert.static_pad("sink").filter(|place| !place.is_linked()).map(|place| pad.link(&place));
        });
        let running = Running(pipeline);
        running.play()?;
        Ok(Self { running, sink })
    }

    /// What `take` gets before the end, an error, or the end of patience.
    fn wait(&self, take: impl Fn(&AppSink) -> Option<gst::Sample>) -> Option<gst::Sample> {
        let bus = self.running.0.bus();
        for _ in 0..PATIENCE {
            // An error may come behind frames that are still to be taken.
            let has_failed = bus.as_ref().is_some_and(|bus| {
                bus.iter_filtered(&[gst::MessageType::Error])
                    .next()
                    .is_some_and(|error| bus.post(error).is_ok())
            });
            if let Some(sample) = take(&self.sink) {
                return Some(sample);
            }
            if has_failed || self.sink.is_eos() {
                return None;
            }
        }
        None
    }

    fn fault(&self, what: &str) -> String {
        let text = reason_of(&self.running.0, &format!("GStreamer: it {what}"));
        format!("{text}: is it complete? If a decoder is missing: apt install gstreamer1.0-libav, or ffmpeg")
    }
}

/// Grey frames of a video, in order.
pub struct GstVideo {
    path: PathBuf,
    size: (usize, usize),
    decoding: Option<Decoding>,
    /// Where it ended before, if it did.
    ended: Option<u64>,
    /// Number of the next frame that it delivers.
    next: u64,
}

impl GstVideo {
    /// The frames of a file; nothing is started yet.
    pub fn new(path: &Path, info: &VideoInfo) -> Self {
        Self { path: path.to_owned(), size: (info.width, info.height), decoding: None, ended: None, next: 0 }
    }

    /// Reads frame `index` as grey levels, row-major. Frames before it are skipped; an earlier one than the last needs a
    /// new start of the video.
    ///
    /// # Errors
    /// If the video ends before the frame or cannot be decoded.
    pub fn read(&mut self, index: u64, frame: &mut [u8]) -> Result<(), SourceError> {
        self.decode(index, frame).map_err(|reason| SourceError::Decode { path: self.path.clone(), reason })
    }

    fn decode(&mut self, index: u64, frame: &mut [u8]) -> Result<(), String> {
        let (width, height) = self.size;
        if frame.len() != width * height {
            return Err(format!("a frame has {} bytes, not {}", width * height, frame.len()));
        }
        if let Some(end) = self.ended.filter(|end| index >= *end) {
            return Err(format!("the video ends before frame {end}"));
        }
        if self.decoding.is_none() || index < self.next {
            // The old one stops first.
            self.decoding = None;
            self.decoding = Some(Decoding::start(&self.path)?);
            self.next = 0;
        }
        let Some(decoding) = &self.decoding else { return Err("GStreamer does not run".into()) };
        loop {
            let Some(sample) = decoding.wait(|sink| sink.try_pull_sample(SLICE)) else {
                let reason = decoding.fault(&format!("ended before frame {}", self.next));
                (self.ended, self.decoding) = (Some(self.next), None);
                return Err(reason);
            };
            self.next += 1;
            if self.next > index {
                return copy(&sample, width, frame).ok_or_else(|| format!("frame {index} has another size"));
            }
        }
    }
}

/// Copies a sample without the padding of its rows, which begin at multiples of four bytes.
fn copy(sample: &gst::Sample, width: usize, frame: &mut [u8]) -> Option<()> {
    let map = sample.buffer()?.map_readable().ok()?;
    let stride = width.next_multiple_of(4);
    if map.len() < stride * (frame.len() / width).saturating_sub(1) + width {
        return None;
    }
    for (row, target) in map.chunks(stride).zip(frame.chunks_exact_mut(width)) {
        target.copy_from_slice(row.get(..width)?);
    }
    Some(())
}

#[cfg(test)]
mod tests {
    use super::super::VideoFiles;
    use super::*;

    const FRAMES: u64 = 12;

    /// A video of 70x50 px, whose frame number n is grey 40 + 10 n in the upper half and black below, in a container that
    /// GStreamer's own base plugins write and read.
    fn video(path: &Path) {
        gst::init().unwrap();
        let text = format!(
            "appsrc name=in format=time caps=video/x-raw,format=GRAY8,width=70,height=50,framerate=20/1 ! videoconvert ! \
             video/x-raw,format=I420 ! theoraenc quality=63 ! oggmux ! filesink location=\"{}\"",
            path.display()
        );
        let pipeline = gst::parse::launch(&text).unwrap().downcast::<gst::Pipeline>().unwrap();
        let source = pipeline.by_name("in").unwrap().downcast::<gst_app::AppSrc>().unwrap();
        let running = Running(pipeline);
        running.play().unwrap();
        for index in 0..FRAMES {
            let mut content = vec![0; 72 * 50];
            content[..72 * 25].fill(40 + 10 * index as u8);
            let mut buffer = gst::Buffer::from_mut_slice(content);
            let head = buffer.get_mut().unwrap();
            head.set_pts(gst::ClockTime::from_mseconds(50 * index));
            head.set_duration(gst::ClockTime::from_mseconds(50));
            source.push_buffer(buffer).unwrap();
        }
        source.end_of_stream().unwrap();
        let end = running
            .0
            .bus()
            .unwrap()
            .timed_pop_filtered(gst::ClockTime::from_seconds(60), &[gst::MessageType::Eos]);
        assert!(end.is_some(), "the video was not written");
    }

    #[test]
    fn a_video_is_counted_and_its_frames_come_in_any_order() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a video.ogv");
        video(&path);
        let info = info(&path).unwrap();
        assert_eq!((info.width, info.height, info.frames, info.rate_hz), (70, 50, FRAMES, 20.0));
        let (mut source, mut frame) = (GstVideo::new(&path, &info), vec![0; 70 * 50]);
        for index in [0, 1, 5, 11, 2] {
            source.read(index, &mut frame).unwrap();
            let (upper, lower) = frame.split_at(70 * 20);
            let wanted = 40 + 10 * index as i32;
            assert!(
                upper.iter().all(|&v| (i32::from(v) - wanted).abs() <= 3),
                "frame {index}: {} {wanted}",
                upper[0]
            );
            assert!(lower[70 * 10..].iter().all(|&v| v <= 3), "frame {index}");
        }
        let error = source.read(FRAMES, &mut frame).unwrap_err().to_string();
        assert!(error.contains("ended before frame 12"), "{error}");
        assert!(
            source.read(FRAMES + 1, &mut frame).unwrap_err().to_string().contains("ends before frame 12")
        );
        source.read(3, &mut frame).unwrap();
        assert!((i32::from(frame[0]) - 70).abs() <= 3);
    }

    #[test]
    fn what_is_no_video_is_told_with_its_name() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("text.mp4");
        std::fs::write(&path, "no video\n".repeat(50)).unwrap();
        let error = info(&path).unwrap_err().to_string();
        assert!(error.starts_with(&path.display().to_string()) && error.contains("GStreamer"), "{error}");
        let missing = VideoFiles::SideBySide(folder.path().join("none.mp4"));
        assert!(super::super::VideoSource::open(&missing).is_err());
    }
}
