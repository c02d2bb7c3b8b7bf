//! What a matcher says of the device that it runs on, and how a matcher on a device is replaced when the
//! device is lost.

use thiserror::Error;

/// Why a device is no longer used.
#[derive(Clone, Copy, Debug, Error, PartialEq, Eq)]
pub enum Loss {
    /// The driver has given it up: a reset, an unplugged card, a driver that ended.
    #[error("the driver lost the device")]
    Device,
    /// It has no memory left.
    #[error("the device is out of memory")]
    OutOfMemory,
    /// A frame was not finished in the time that it was given.
    #[error("the device does not answer in time")]
    Hung,
    /// The driver refused what it was asked to do.
    #[error("the driver refused a command")]
    Refused,
}

/// The stages that a matcher on a device is timed by.
pub const STAGES: [&str; 8] =
    ["prepare", "plan", "cost", "horizontal", "vertical", "diagonal", "winner", "finish"];

/// Time that one stage of the last pair took on the device, over all scales.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct StageTime {
    /// The stage.
    pub stage: &'static str,
    /// Nanoseconds between its first and its last command.
    pub ns: u64,
}

/// A device as it is told to people.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct DeviceState<'a> {
    /// Name of the adapter.
    pub adapter: &'a str,
    /// Its driver and the driver's version.
    pub driver: &'a str,
    /// Times of the last pair; empty where the device has no timestamps.
    pub stages: &'a [StageTime],
    /// Why it is no longer used, if so.
    pub loss: Option<Loss>,
}
