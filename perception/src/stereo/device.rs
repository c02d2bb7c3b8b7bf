//! State of the device that a matcher runs on: its name, the time of each stage, and why it was lost.

use core::time::Duration;
use thiserror::Error;

/// Default of the time after which a device that has not finished a frame is treated as hanging.
pub const DEFAULT_TIMEOUT: Duration = Duration::from_secs(2);

/// Why a device was lost.
#[derive(Clone, Copy, Debug, Error, PartialEq, Eq)]
pub enum Loss {
    /// The driver reports the device as lost: a reset, an unplugged card, a driver that ended.
    #[error("the driver lost the device")]
    Device,
    /// The device is out of memory.
    #[error("the device is out of memory")]
    OutOfMemory,
    /// A frame did not finish within the time limit.
    #[error("the device does not answer in time")]
    Hung,
    /// The driver refused a command.
    #[error("the driver refused a command")]
    Refused,
}

/// Names of the stages that are timed on a device, in the order in which they run.
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

/// Description and state of a device, for logs and status.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct DeviceState<'a> {
    /// Name of the adapter.
    pub adapter: &'a str,
    /// Name and version of its driver.
    pub driver: &'a str,
    /// Times of the last pair; empty where the device has no timestamps.
    pub stages: &'a [StageTime],
    /// Why it was lost; `None` while it is in use.
    pub loss: Option<Loss>,
}
