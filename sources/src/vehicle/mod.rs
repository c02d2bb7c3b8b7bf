//! What the vehicle itself reports of its motion: the signals of its CAN bus, their decoding and their state.
//!
//! [`Decoder`] finds the signals that are configured, in a DBC file or in DBC's own notation, and turns the frames of the
//! bus into values. [`BusState`] keeps the newest value of each, and [`BusState::reading`] gives what holds at the time of
//! an image. Neither reads a clock or a socket; `can` (with the feature of that name) reads SocketCAN.
//!
//! ```
//! use lookout_sources::vehicle::{BusSettings, Decoder, Frame};
//!
//! let settings = BusSettings {
//!     speed_signal: "0x123:8|16@1+ (0.01,0) km/h".into(),
//!     ..BusSettings::default()
//! };
//! let decoder = Decoder::new(&settings)?;
//! let mut state = decoder.state();
//! state.opened();
//! // 36 km/h, received at 2 s.
//! decoder.decode(&Frame::new(0x123, false, &[0, 0x10, 0x0e, 0, 0, 0, 0, 0]), 2_000_000_000, &mut state);
//! let reading = state.reading(2_020_000_000, 500_000_000);
//! let speed = reading.sample.speed_m_s.expect("it is fresh");
//! assert!((speed.value - 10.0).abs() < 1e-9 && (speed.age_s - 0.02).abs() < 1e-9);
//! # Ok::<(), lookout_sources::vehicle::VehicleError>(())
//! ```

#[cfg(feature = "can")]
pub mod can;
mod dbc;
mod decoder;
mod error;
mod frame;
mod quantity;
mod reading;
mod signal;
mod state;
mod watch;

pub use dbc::Dbc;
pub use decoder::{BusSettings, Decoder};
pub use error::VehicleError;
pub use frame::Frame;
pub use quantity::{MAX_SPEED_M_S, MAX_STEERING_ANGLE_RAD, MAX_YAW_RATE_RAD_S};
pub use reading::{VehicleFaults, VehicleReading};
pub use signal::{ByteOrder, Signal};
pub use state::BusState;
pub use watch::Watch;
