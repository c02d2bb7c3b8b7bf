//! GStreamer cameras: for CSI cameras whose drivers deliver raw Bayer frames, which only the board's own
//! elements (`nvarguscamerasrc`, `libcamerasrc`) convert to images.

use super::{Camera, CameraError, Exposure, Opener, Taken};
use gst::prelude::*;
use gst_app::AppSink;
use std::time::Duration;

/// Opens GStreamer pipelines.
#[derive(Clone, Debug)]
pub struct GstOpener {
    /// Pipeline descriptions in the syntax of `gst-launch-1.0`, starting at the source; conversion to grey and
    /// the app sink are appended. Left and right, or the one that delivers both images side by side.
    pub pipelines: Vec<String>,
}

struct GstCamera {
    name: String,
    pipeline: gst::Pipeline,
    sink: AppSink,
    width: usize,
    frames: u32,
}

impl Opener for GstOpener {
    fn open(&mut self, side: usize, (width, height): (usize, usize)) -> Result<Box<dyn Camera>, CameraError> {
        let name = self.pipelines.get(side).cloned().unwrap_or_default();
        let fail = |reason: String| CameraError { device: name.clone(), reason };
        gst::init().map_err(|e| fail(format!("GStreamer cannot be used: {e}")))?;
        let text = format!(
            "{name} ! videoconvert ! video/x-raw,format=GRAY8,width={width},height={height} ! \
             appsink name=lookout sync=false max-buffers=2 drop=true"
        );
        let element = gst::parse::launch(&text).map_err(|e| fail(format!("not a valid pipeline: {e}")))?;
        let pipeline = element
            .downcast::<gst::Pipeline>()
            .map_err(|_| fail("the description must start with a source element".into()))?;
        let sink = pipeline.by_name("lookout").and_then(|sink| sink.downcast::<AppSink>().ok());
        let sink = sink.ok_or_else(|| fail("the pipeline has no output for images".into()))?;
        // The system clock is CLOCK_MONOTONIC, whatever clock the source provides.
        pipeline.use_clock(Some(&gst::SystemClock::obtain()));
        let camera = GstCamera { name: name.clone(), pipeline, sink, width, frames: 0 };
        camera.pipeline.set_state(gst::State::Playing).map_err(|_| camera.fault("does not start"))?;
        Ok(Box::new(camera))
    }
}

impl GstCamera {
    /// An error with the message that the pipeline itself reports.
    fn fault(&self, what: &str) -> CameraError {
        let bus = self.pipeline.bus();
        let said =
            bus.and_then(|bus| bus.timed_pop_filtered(gst::ClockTime::ZERO, &[gst::MessageType::Error]));
        let because = match said.as_ref().map(|message| message.view()) {
            Some(gst::MessageView::Error(error)) => format!(": {}", error.error()),
            _ => String::new(),
        };
        CameraError { device: self.name.clone(), reason: format!("{what}{because}") }
    }
}

impl Camera for GstCamera {
    fn grab(&mut self, patience: Duration, grey: &mut [u8]) -> Result<Option<Taken>, CameraError> {
        let patience = gst::ClockTime::from_nseconds(patience.as_nanos() as u64);
        let Some(sample) = self.sink.try_pull_sample(patience) else {
            if self.sink.is_eos() {
                return Err(self.fault("has ended"));
            }
            let bus = self.pipeline.bus();
            let is_broken =
                bus.is_some_and(|bus| bus.peek().is_some_and(|m| m.type_() == gst::MessageType::Error));
            return if is_broken { Err(self.fault("is lost")) } else { Ok(None) };
        };
        let Some(buffer) = sample.buffer() else { return Ok(None) };
        let Ok(map) = buffer.map_readable() else { return Ok(None) };
        // Rows start at multiples of four bytes.
        let stride = self.width.next_multiple_of(4);
        let rows = map.chunks(stride).zip(grey.chunks_exact_mut(self.width));
        let mut count = 0;
        for (row, target) in rows {
            let Some(row) = row.get(..self.width) else { break };
            target.copy_from_slice(row);
            count += 1;
        }
        if count * self.width != grey.len() {
            return Ok(None);
        }
        let time = buffer.pts().zip(self.pipeline.base_time()).map(|(pts, base)| (pts + base).nseconds());
        let Some(time_ns) = time else { return Err(self.fault("delivers frames without a timestamp")) };
        self.frames = self.frames.wrapping_add(1);
        Ok(Some(Taken { time_ns, sequence: self.frames }))
    }

    fn set_exposure(&mut self, exposure: Exposure) -> Result<(), CameraError> {
        if exposure == Exposure::Automatic {
            return Ok(());
        }
        let reason =
            "the pipeline's own elements control exposure and gain: set camera.exposure = \"automatic\"";
        Err(CameraError { device: self.name.clone(), reason: reason.into() })
    }
}

impl Drop for GstCamera {
    fn drop(&mut self) {
        // Releases the device. A pipeline that cannot be stopped is gone anyway, so the error is ignored.
        let _ = self.pipeline.set_state(gst::State::Null);
    }
}

#[cfg(test)]
mod tests {
    use super::super::connection::ConnectionParameters;
    use super::super::{CameraSource, ExposureMode, Settings};
    use super::*;
    use crate::{LiveSource, PairSource, Readiness};
    use std::time::Instant;

    #[test]
    fn test_pipelines_become_pairs() {
        let pipeline = |pattern: &str| {
            format!("videotestsrc is-live=true pattern={pattern} ! video/x-raw,framerate=30/1")
        };
        let opener = GstOpener { pipelines: vec![pipeline("white"), pipeline("black")] };
        let parameters = ConnectionParameters {
            silence_ns: 60_000_000_000,
            retry_initial_ns: 1_000_000_000,
            retry_max_ns: 1_000_000_000,
        };
        // Two test sources start at different times, so any two frames may form a pair.
        let settings = Settings {
            size: (322, 240),
            period_ns: 33_333_333,
            side_by_side: false,
            skew_ns: 16_600_000,
            connection: parameters,
            exposure: ExposureMode::Once(Exposure::Automatic),
        };
        let mut source = CameraSource::new(Box::new(opener), settings, || {
            std::time::UNIX_EPOCH.elapsed().map_or(0, |d| d.as_nanos() as u64)
        });
        let (mut left, mut right) = (vec![0; 322 * 240], vec![0; 322 * 240]);
        let (start, mut times) = (Instant::now(), Vec::new());
        while times.len() < 5 {
            assert!(start.elapsed() < Duration::from_secs(120), "no pairs arrived");
            match source.wait(Duration::from_millis(50)) {
                Readiness::Pair { capture_ns } => {
                    source.read(0, &mut left, &mut right).unwrap();
                    assert!(left.iter().all(|&v| v > 230) && right.iter().all(|&v| v < 30));
                    times.push(capture_ns);
                }
                Readiness::Trouble(text) => panic!("{text}"),
                Readiness::Nothing | Readiness::Recovered => {}
            }
        }
        assert!(times.windows(2).all(|t| t[1] > t[0]), "{times:?}");
    }

    #[test]
    fn a_wrong_pipeline_is_named() {
        let mut opener = GstOpener { pipelines: vec!["nosuchelement".into()] };
        let error = opener.open(0, (64, 48)).err().map(|e| e.to_string()).unwrap_or_default();
        assert!(error.contains("nosuchelement") && error.contains("not a valid pipeline"), "{error}");
        // A pipeline that ends counts as a lost camera.
        let mut opener = GstOpener { pipelines: vec!["videotestsrc num-buffers=2".into()] };
        let mut camera = opener.open(0, (64, 48)).map_err(|e| e.to_string()).unwrap();
        let mut grey = vec![0; 64 * 48];
        let start = Instant::now();
        let error = loop {
            assert!(start.elapsed() < Duration::from_secs(120), "the pipeline never ended");
            if let Err(error) = camera.grab(Duration::from_millis(50), &mut grey) {
                break error.to_string();
            }
        };
        assert!(error.contains("has ended"), "{error}");
    }
}
