//! What the vehicle reports at the time of a frame, and what is wrong with it.

use perception::motion::vehicle::VehicleSample;

/// What the vehicle reports at the time of a frame.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct VehicleReading {
    /// The values; `None` where one is not configured, missing, stale or out of range.
    pub sample: VehicleSample,
    /// Why values are missing.
    pub faults: VehicleFaults,
}

/// Why values of the vehicle are missing. All false where nothing is configured.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct VehicleFaults {
    /// The bus cannot be opened, or nothing comes from it.
    pub no_bus: bool,
    /// A configured signal has never been received.
    pub missing: bool,
    /// A configured signal has not been received for too long.
    pub stale: bool,
    /// A value was out of its range.
    pub out_of_range: bool,
}
