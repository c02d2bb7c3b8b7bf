//! Video4Linux cameras: USB cameras and others whose driver delivers grey, YUV or JPEG frames.

use super::pixels::{PixelFormat, to_grey};
use super::{Camera, CameraError, Exposure, Opener, Taken};
use moq_v4l::buffer::{Flags, Type};
use moq_v4l::control::{Control, Value};
use moq_v4l::device::Device;
use moq_v4l::io::mmap::Stream;
use moq_v4l::io::traits::{CaptureStream, Stream as _};
use moq_v4l::video::Capture;
use moq_v4l::video::capture::Parameters;
use moq_v4l::{FourCC, sys};
use std::io;
use std::time::Duration;

/// Buffers in the driver: one being filled, one waiting, one being read, one spare.
const BUFFERS: u32 = 4;

/// Upper limit of the buffers that a driver grants.
const MAX_BUFFERS: usize = 32;

/// POLLIN of poll(2).
const READABLE: i16 = 1;

/// ENODEV of errno(3): the device is gone.
const NO_SUCH_DEVICE: i32 = 19;

/// Formats in order of preference: cheapest conversion first.
pub(super) const FORMATS: [(&[u8; 4], PixelFormat); 6] = [
    (b"GREY", PixelFormat::Grey),
    (b"YUYV", PixelFormat::Yuyv),
    (b"UYVY", PixelFormat::Uyvy),
    (b"NV12", PixelFormat::Planar),
    (b"YU12", PixelFormat::Planar),
    (b"MJPG", PixelFormat::Mjpeg),
];

/// Opens V4L2 devices.
#[derive(Clone, Debug)]
pub struct V4l2Opener {
    /// Device paths: left and right, or the one that delivers both images side by side.
    pub devices: Vec<String>,
    /// Requested frame rate, in Hz.
    pub rate_hz: f64,
    /// FourCC of the format, such as `YUYV`; empty selects the cheapest to convert.
    pub format: String,
    /// The monotonic clock, in nanoseconds: for devices that do not stamp frames with it.
    pub clock: fn() -> u64,
}

/// An open device.
struct V4l2Camera {
    name: String,
    device: Device,
    /// `None` only while it is being dropped.
    stream: Option<Stream<'static>>,
    format: PixelFormat,
    width: usize,
    stride: usize,
    clock: fn() -> u64,
}

impl Opener for V4l2Opener {
    fn open(&mut self, side: usize, size: (usize, usize)) -> Result<Box<dyn Camera>, CameraError> {
        let name = self.devices.get(side).cloned().unwrap_or_default();
        let fail = |reason: String| CameraError { device: name.clone(), reason };
        let what = |what: &str, e: &io::Error| fail(format!("cannot {what}: {e}"));
        let device = Device::with_path(&name).map_err(|e| what("be opened", &e))?;
        let offered = device.enum_formats().map_err(|e| what("list its formats", &e))?;
        let wanted = FORMATS.iter().find(|(code, _)| {
            let is_asked_for = self.format.is_empty() || self.format.as_bytes() == *code;
            is_asked_for && offered.iter().any(|o| o.fourcc == FourCC::new(code))
        });
        let Some((code, format)) = wanted else {
            if offered.is_empty() {
                return Err(fail(
                    "delivers no frames: is it a capture device, and the first one of the camera?".into(),
                ));
            }
            let has: Vec<String> = offered.iter().map(|o| o.fourcc.to_string()).collect();
            let known: Vec<String> =
                FORMATS.iter().map(|(c, _)| String::from_utf8_lossy(*c).into_owned()).collect();
            return Err(fail(format!(
                "delivers {}, none of which is supported (camera.format \"{}\", of {})",
                has.join(", "),
                self.format,
                known.join(", ")
            )));
        };
        let asked = moq_v4l::Format::new(size.0 as u32, size.1 as u32, FourCC::new(code));
        let given = device.set_format(&asked).map_err(|e| what("set its format", &e))?;
        if (given.width as usize, given.height as usize) != size || given.fourcc != asked.fourcc {
            return Err(fail(format!(
                "delivers {}x{} {}, not {}x{} {}: set camera.width and camera.height to a size that it has \
                 (v4l2-ctl --list-formats-ext)",
                given.width, given.height, given.fourcc, size.0, size.1, asked.fourcc
            )));
        }
        // A camera without a settable rate runs at its own.
        let rate = moq_v4l::Fraction::new(1000, (self.rate_hz * 1000.0).round().max(1.0) as u32);
        let _ = device.set_params(&Parameters::new(rate));
        let stream = Stream::with_buffers(&device, Type::VideoCapture, BUFFERS);
        let mut stream = stream.map_err(|e| what("allocate frame buffers", &e))?;
        // Queues all buffers but the first, which counts as read: the next frame returns it.
        for index in 1..MAX_BUFFERS {
            if CaptureStream::queue(&mut stream, index).is_err() {
                break;
            }
        }
        let mut camera = V4l2Camera {
            name: name.clone(),
            device,
            stream: Some(stream),
            format: *format,
            width: size.0,
            stride: given.stride as usize,
            clock: self.clock,
        };
        if let Some(stream) = &mut camera.stream {
            stream.start().map_err(|e| what("start", &e))?;
        }
        Ok(Box::new(camera))
    }
}

impl V4l2Camera {
    fn fail(&self, reason: impl std::fmt::Display) -> CameraError {
        CameraError { device: self.name.clone(), reason: reason.to_string() }
    }

    fn set(&self, id: u32, value: i64) -> io::Result<()> {
        self.device.set_control(Control { id, value: Value::Integer(value) })
    }
}

impl Camera for V4l2Camera {
    fn grab(&mut self, patience: Duration, grey: &mut [u8]) -> Result<Option<Taken>, CameraError> {
        let milliseconds = i32::try_from(patience.as_millis()).unwrap_or(i32::MAX);
        let Some(stream) = &mut self.stream else { return Ok(None) };
        // Polls first: a read that times out would return a buffer twice.
        match self.device.handle().poll(READABLE, milliseconds) {
            Ok(0) => return Ok(None),
            Err(error) if error.kind() == io::ErrorKind::Interrupted => return Ok(None),
            Ok(_) => {}
            Err(error) => return Err(self.fail(error)),
        }
        let (bytes, metadata) = match CaptureStream::next(stream) {
            Ok(next) => next,
            Err(error) => {
                let reason = format!("is lost: {error}");
                return Err(self.fail(reason));
            }
        };
        if metadata.flags.contains(Flags::ERROR) {
            return Ok(None);
        }
        let used = (metadata.bytesused as usize).min(bytes.len());
        // Frames stamped with another clock cannot be compared with those of the other device.
        let is_monotonic = metadata.flags.bits() & sys::V4L2_BUF_FLAG_TIMESTAMP_MASK
            == sys::V4L2_BUF_FLAG_TIMESTAMP_MONOTONIC;
        let stamp = metadata.timestamp;
        let time_ns = if is_monotonic && stamp.sec >= 0 && stamp.usec >= 0 {
            stamp.sec as u64 * 1_000_000_000 + stamp.usec as u64 * 1000
        } else {
            (self.clock)()
        };
        let sequence = metadata.sequence;
        // A damaged frame, as occurs with JPEG over USB, is dropped.
        let is_whole = to_grey(self.format, &bytes[..used], self.width, self.stride, grey).is_ok();
        Ok(is_whole.then_some(Taken { time_ns, sequence }))
    }

    fn set_exposure(&mut self, exposure: Exposure) -> Result<(), CameraError> {
        /// V4L2_CID_EXPOSURE_AUTO: 1 is manual, 3 is aperture priority (automatic exposure, fixed aperture), 0 is
        /// fully automatic.
        const MANUAL: i64 = 1;
        let refused = |what: &str, e: io::Error| self.fail(format!("cannot set {what}: {e}"));
        match exposure {
            Exposure::Automatic => {
                // A camera without this control is left as it is: its exposure is its own in any case.
                let _ = [3, 0].into_iter().find(|&v| self.set(sys::V4L2_CID_EXPOSURE_AUTO, v).is_ok());
                Ok(())
            }
            Exposure::Fixed { time_us, gain } => {
                // Cameras without automatic exposure lack this control.
                let _ = self.set(sys::V4L2_CID_EXPOSURE_AUTO, MANUAL);
                // In units of 100 µs where the device supports them, in its own (lines) elsewhere.
                let exposed = self
                    .set(sys::V4L2_CID_EXPOSURE_ABSOLUTE, i64::from((time_us / 100).max(1)))
                    .or_else(|_| self.set(sys::V4L2_CID_EXPOSURE, time_us.into()))
                    .map_err(|e| refused("camera.exposure_us", e));
                let _ = self.set(sys::V4L2_CID_AUTOGAIN, 0);
                // Also where the exposure time cannot be set: each control that a camera has is used.
                let gained = self
                    .set(sys::V4L2_CID_GAIN, gain.into())
                    .or_else(|_| self.set(sys::V4L2_CID_ANALOGUE_GAIN, gain.into()))
                    .map_err(|e| refused("camera.gain", e));
                exposed.and(gained)
            }
        }
    }
}

impl Drop for V4l2Camera {
    fn drop(&mut self) {
        // The library panics when a stream cannot be stopped for another reason than that its device is gone. Then its
        // memory is leaked until the process ends. A device that is gone must be closed: it keeps its number until
        // then, and the same camera, plugged in again, would become another /dev/videoN.
        if let Some(mut stream) = self.stream.take()
            && let Err(error) = stream.stop()
            && error.raw_os_error() != Some(NO_SUCH_DEVICE)
        {
            std::mem::forget(stream);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_no_camera_is_named_with_the_reason() {
        let opener = |path: &str| V4l2Opener {
            devices: vec![path.into()],
            rate_hz: 30.0,
            format: String::new(),
            clock: || 0,
        };
        let error =
            |path: &str| opener(path).open(0, (640, 480)).err().map(|e| e.to_string()).unwrap_or_default();
        let absent = error("/dev/video-that-is-not-there");
        assert!(absent.starts_with("/dev/video-that-is-not-there: cannot be opened"), "{absent}");
        // A device that is not a camera.
        let null = error("/dev/null");
        assert!(null.starts_with("/dev/null: delivers no frames"), "{null}");
    }
}
