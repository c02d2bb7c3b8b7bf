//! Real cameras: two devices, or one that gives both images side by side.
//!
//! [`Camera`] is what a kind of camera has to be able to do: V4L2 (feature `v4l2`), GStreamer (feature
//! `gstreamer`), and in tests a script of times. Everything else is the same for all of them, in parts
//! that know neither a device nor a clock: [`pairing`] joins frames by their times, [`connection`]
//! decides when a lost camera is opened again, [`exposure`] keeps both equally bright.

pub mod connection;
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

/// A frame that a camera gave.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Taken {
    /// When it was exposed, on the monotonic clock, in nanoseconds: as the device says, else when it
    /// arrived.
    pub time_ns: u64,
    /// Its number at the device; gaps are frames that the device dropped.
    pub sequence: u32,
}

/// How brightness is set.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Exposure {
    /// The camera's own automatic.
    Automatic,
    /// As given.
    Fixed {
        /// Exposure time in microseconds.
        time_us: u32,
        /// Gain, in the device's own unit.
        gain: u32,
    },
}

/// Why a camera cannot be used, now.
#[derive(Clone, Debug, Error, PartialEq, Eq)]
#[error("{device}: {reason}")]
pub struct CameraError {
    /// The device.
    pub device: String,
    /// What is wrong, and what to do.
    pub reason: String,
}

/// A camera that is open.
pub trait Camera {
    /// Waits for the next frame, at most `patience`, and writes its grey pixels, row after row. `None`
    /// when there was none. Allocates nothing.
    ///
    /// # Errors
    /// When the camera is lost: it has to be opened again.
    fn grab(&mut self, patience: Duration, grey: &mut [u8]) -> Result<Option<Taken>, CameraError>;

    /// Sets the exposure.
    ///
    /// # Errors
    /// When the device cannot do that; the images keep coming.
    fn set_exposure(&mut self, exposure: Exposure) -> Result<(), CameraError>;
}

/// Opens cameras.
pub trait Opener {
    /// Opens camera `side` (0 is the left one, or the only one), for grey images of `width` × `height`.
    ///
    /// # Errors
    /// When it is not there, or cannot do what is asked of it.
    fn open(&mut self, side: usize, size: (usize, usize)) -> Result<Box<dyn Camera>, CameraError>;
}
