//! Live cameras: two devices, or one that delivers both images side by side.
//!
//! [`Camera`] is the interface of a device: V4L2 (feature `v4l2`), GStreamer (feature `gstreamer`), and
//! scripted cameras in tests. Everything else is common to all devices and depends on neither device nor
//! clock: [`pairing`] matches frames by timestamp, [`connection`] decides when a lost camera is reopened,
//! [`exposure`] keeps both images equally bright.

pub mod connection;
#[cfg(feature = "v4l2")]
pub mod device_formats;
pub mod exposure;
#[cfg(test)]
mod fake;
#[cfg(feature = "gstreamer")]
pub mod gstreamer;
pub mod pairing;
pub mod pixels;
mod source;
#[cfg(feature = "v4l2")]
pub mod v4l2;

pub use source::{CameraSource, ExposureMode, Settings};

use std::time::Duration;
use thiserror::Error;

/// Metadata of a captured frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Taken {
    /// Time of the exposure on the monotonic clock, in nanoseconds: as stamped by the device, else the time of
    /// arrival.
    pub time_ns: u64,
    /// The device's frame number; gaps are frames that the device dropped.
    pub sequence: u32,
}

/// Exposure setting.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Exposure {
    /// The camera's own automatic exposure.
    Automatic,
    /// Fixed values.
    Fixed {
        /// Exposure time in microseconds.
        time_us: u32,
        /// Gain, in the device's unit.
        gain: u32,
    },
}

/// Why a camera cannot be used at present.
#[derive(Clone, Debug, Error, PartialEq, Eq)]
#[error("{device}: {reason}")]
pub struct CameraError {
    /// The device.
    pub device: String,
    /// What is wrong, and the remedy.
    pub reason: String,
}

/// An open camera.
pub trait Camera {
    /// Waits for the next frame, at most `patience`, and writes its grey pixels in row-major order.
    /// `None` when no frame arrived. Does not allocate.
    ///
    /// # Errors
    /// When the camera is lost and has to be reopened.
    fn grab(&mut self, patience: Duration, grey: &mut [u8]) -> Result<Option<Taken>, CameraError>;

    /// Sets the exposure.
    ///
    /// # Errors
    /// When the device does not support the setting; frames keep arriving.
    fn set_exposure(&mut self, exposure: Exposure) -> Result<(), CameraError>;
}

/// Opens cameras.
pub trait Opener {
    /// Opens camera `side` (0 is the left or the only one) for grey images of `width` × `height`.
    ///
    /// # Errors
    /// When the device is absent or does not support the request.
    fn open(&mut self, side: usize, size: (usize, usize)) -> Result<Box<dyn Camera>, CameraError>;
}
