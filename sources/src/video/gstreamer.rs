//! Videos decoded by GStreamer, where its support is built in and ffmpeg is missing.

use super::info::{DEFAULT_RATE_HZ, RATES, VideoInfo, check_side};
use crate::SourceError;
use gst::prelude::*;
use gst_app::AppSink;
use std::path::{Path, PathBuf};

/// How often a wait for a frame looks for an error, after which none may come.
const SLICE: gst::ClockTime = gst::ClockTime::from_mseconds(100);

/// Longest wait for a frame, in slices.
const PATIENCE: u32 = 300;

/// Longest wait after an error for frames that were decoded before it, in slices.
const PATIENCE_AFTER_ERROR: u32 = 10;

/// Contents that lead to other files or into the network: a video is one file.
const ELSEWHERE: [&str; 4] =
    ["application/x-hls", "application/dash+xml", "application/vnd.ms-sstr+xml", "application/sdp"];

/// What to do where GStreamer cannot decode a video.
const REMEDY: &str = "is it complete? If a decoder is missing: apt install gstreamer1.0-libav, or ffmpeg";

/// Size, rate and number of frames of a video. It is decoded once to count them: no other count holds for all formats.
///
/// # Errors
/// If GStreamer cannot read or decode it; the text has GStreamer's reason.
pub fn info(path: &Path) -> Result<VideoInfo, SourceError> {
    let fail = |explanation: String| SourceError::Foreign { path: path.to_owned(), explanation };
    let decoding = Decoding::start(path).map_err(&fail)?;
    let first = decoding.next("has no pictures").map_err(&fail)?;
    let caps = first.as_ref().and_then(|sample| sample.caps()?.structure(0));
    let (Some(caps), Some((width, height))) = (caps, first.as_ref().and_then(size_of)) else {
        return Err(fail(decoding.fault("has no pictures")));
    };
    check_side(width, height).map_err(&fail)?;
    let rate = caps.get::<gst::Fraction>("framerate").ok().filter(|rate| rate.denom() != 0);
    let rate = rate.map(|rate| f64::from(rate.numer()) / f64::from(rate.denom()));
    let rate_hz = rate.filter(|rate| RATES.contains(rate)).unwrap_or(DEFAULT_RATE_HZ);
    let mut frames = 1;
    while decoding.next("cannot be counted").map_err(&fail)?.is_some() {
        frames += 1;
    }
    Ok(VideoInfo { width, height, rate_hz, frames })
}

/// Width and height of a frame, in px.
fn size_of(sample: &gst::Sample) -> Option<(usize, usize)> {
    let caps = sample.caps()?.structure(0)?;
    let side = |name: &str| usize::try_from(caps.get::<i32>(name).ok()?).ok();
    Some((side("width")?, side("height")?))
}

/// A pipeline that is stopped when it goes.
struct Running(gst::Pipeline);

impl Running {
    fn play(&self) -> Result<(), String> {
        match self.0.set_state(gst::State::Playing) {
            Ok(_) => Ok(()),
            Err(_) => Err(format!("{}: {REMEDY}", reason_of(&self.0, "GStreamer cannot open this video"))),
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
        // Those of boards deliver memory of the GPU, which nothing here converts.
        if decoder.has_property("force-sw-decoders") {
            decoder.set_property("force-sw-decoders", true);
        }
        // Whether decodebin shall go on with a stream.
        decoder.connect("autoplug-continue", false, |values| {
            let caps = values.get(2).and_then(|value| value.get::<gst::Caps>().ok());
            let name = caps.as_ref().and_then(|caps| Some(caps.structure(0)?.name().to_string()));
            let is_wanted =
                name.is_none_or(|name| !name.starts_with("audio/") && !ELSEWHERE.contains(&&name[..]));
            Some(is_wanted.to_value())
        });
        decoder.connect_pad_added(move |_, pad| {
            let caps = pad.current_caps().unwrap_or_else(|| pad.query_caps(None));
            let is_picture = caps.structure(0).is_some_and(|caps| caps.name() == "video/x-raw");
            // A second picture finds the place taken. Without a link nothing arrives, which is told.
            if let Some(place) = convert.static_pad("sink").filter(|place| is_picture && !place.is_linked()) {
                let _ = pad.link(&place);
            }
        });
        let running = Running(pipeline);
        running.play()?;
        Ok(Self { running, sink })
    }

    /// The next frame; `None` at the end of the video, also of one that is cut off.
    fn next(&self, what: &str) -> Result<Option<gst::Sample>, String> {
        let bus = self.running.0.bus();
        let mut since_error = 0;
        for _ in 0..PATIENCE {
            if let Some(sample) = self.sink.try_pull_sample(SLICE) {
                return Ok(Some(sample));
            }
            if self.sink.is_eos() {
                return Ok(None);
            }
            // It stays for the one who asks for its text.
            let has_failed = bus.as_ref().is_some_and(|bus| {
                let error = bus.iter_filtered(&[gst::MessageType::Error]).next();
                error.is_some_and(|error| bus.post(error).is_ok())
            });
            since_error += u32::from(has_failed);
            if since_error > PATIENCE_AFTER_ERROR {
                return Err(self.fault(what));
            }
        }
        let waited_s = (SLICE * u64::from(PATIENCE)).seconds();
        Err(format!("GStreamer gives no frame for {waited_s} s: is the disk slow?"))
    }

    fn fault(&self, what: &str) -> String {
        format!("{}: {REMEDY}", reason_of(&self.running.0, &format!("GStreamer: it {what}")))
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
            let number = self.next;
            let sample = match decoding.next(&format!("cannot be decoded at frame {number}")) {
                Ok(Some(sample)) => sample,
                end => {
                    // What did not come in time may come to the next one who asks.
                    self.ended = end.is_ok().then_some(number);
                    self.decoding = None;
                    return Err(end.err().unwrap_or_else(|| format!("the video ends before frame {number}")));
                }
            };
            self.next += 1;
            if self.next > index {
                return copy(&sample, self.size, frame).ok_or_else(|| {
                    format!(
                        "frame {index} has another size than the first one: cut the video where it changes"
                    )
                });
            }
        }
    }
}

/// Copies a sample without the padding of its rows, which begin at multiples of four bytes.
fn copy(sample: &gst::Sample, (width, height): (usize, usize), frame: &mut [u8]) -> Option<()> {
    size_of(sample).filter(|size| *size == (width, height))?;
    let map = sample.buffer()?.map_readable().ok()?;
    let stride = width.next_multiple_of(4);
    if map.len() < stride * height.saturating_sub(1) + width {
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

    /// A video with sound of 70x50 px, whose frame number n is grey 40 + 10 n in the upper half and black below, in a container that
    /// GStreamer's own base plugins write and read.
    fn video(path: &Path) {
        gst::init().unwrap();
        let text = format!(
            "appsrc name=in format=time caps=video/x-raw,format=GRAY8,width=70,height=50,framerate=20/1 ! videoconvert ! \
             video/x-raw,format=I420 ! theoraenc quality=63 ! queue ! oggmux name=mux ! filesink location=\"{}\" \
             audiotestsrc num-buffers=20 ! audioconvert ! vorbisenc ! queue ! mux.",
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
        assert!(error.contains("ends before frame 12"), "{error}");
        assert!(
            source.read(FRAMES + 1, &mut frame).unwrap_err().to_string().contains("ends before frame 12")
        );
        source.read(3, &mut frame).unwrap();
        assert!((i32::from(frame[0]) - 70).abs() <= 3);
    }

    #[test]
    fn what_is_no_video_is_told_with_its_name() {
        let folder = tempfile::tempdir().unwrap();
        let playlist =
            "#EXTM3U\n#EXT-X-VERSION:3\n#EXT-X-TARGETDURATION:9\n#EXTINF:9,\nother.ts\n#EXT-X-ENDLIST\n";
        for (name, text) in
            [("text.mp4", &"no video\n".repeat(50)[..]), ("elsewhere.mp4", playlist), ("no.mkv", "")]
        {
            let path = folder.path().join(name);
            std::fs::write(&path, text).unwrap();
            let error = info(&path).unwrap_err().to_string();
            assert!(error.starts_with(&path.display().to_string()) && error.contains("GStreamer"), "{error}");
            assert!(error.contains("apt install"), "{error}");
        }
        let missing = VideoFiles::SideBySide(folder.path().join("none.mp4"));
        assert!(super::super::VideoSource::open(&missing).is_err());
    }
}
