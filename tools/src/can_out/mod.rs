//! What leaves the daemon on a CAN bus: the messages, their signals, and how they are sent.
//!
//! [`layout`] declares every message and signal once. [`Encoder`] turns the values of a cycle into frames, [`dbc()`]
//! writes the same declaration as a DBC file, and [`Link`] sends frames without ever waiting for the bus. All frames are
//! information for displays, loggers and developers: none asks anything of the vehicle, and none can be an actuation
//! command (no torque, brake, steering or deceleration request is among the signals).
//!
//! ```
//! use lookout_tools::can_out::{Encoder, Identifiers, Values};
//! use lookout_tools::can_out::checksum::is_intact;
//!
//! let mut encoder = Encoder::new(Identifiers { base: 0x640, is_extended: false, objects: 8 });
//! let mut frames = Vec::new();
//! // No daemon runs: the alarm is off, and every value is "not available".
//! encoder.encode(&Values::default().cycle(0, 500_000_000), &mut frames);
//! assert_eq!((frames.len(), frames[0].id), (21, 0x640));
//! assert!(is_intact(&frames[0].data, frames[0].data_id));
//! ```

pub mod checksum;
mod dbc;
mod encoder;
pub mod layout;
mod link;
#[cfg(test)]
mod page;
mod signal;
#[cfg(feature = "can")]
pub mod socket;
mod values;

pub use dbc::dbc;
pub use encoder::{Encoder, OutFrame};
pub use layout::{DEFAULT_BASE_ID, ID_COUNT, Identifiers, MAX_OBJECTS, is_diagnostic};
pub use link::{Link, LinkReport, LinkState, Port, Received};
pub use values::{
    DaemonState, Existence, Object, Own, PathAhead, ResultValues, STAGE_FAULT, STALE_FAULT, Values,
};
