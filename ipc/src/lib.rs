//! Every message that crosses a process boundary, and the services that carry them.
//!
//! All services share one form: a [`header::Header`] and a slice of bytes in shared memory. What
//! the bytes mean is laid down by one module per message (`pair`, `depth`, `regions`, `obstacles`,
//! `report`, `command`, `status`). A publisher loans a sample, writes it in place and sends it; a
//! subscriber reads it in place. Nothing is copied, and nothing is trusted before it is checked.
//!
//! iceoryx2 is used in this crate only, in its non-generic ports, so that its generic code is
//! compiled once.

pub mod alarm;
pub mod allocation;
pub mod bus;
pub mod calibration;
pub mod clock;
pub mod deadline;
pub mod device;
mod error;
pub mod header;
pub mod heat;
pub mod idle;
pub mod instance;
mod message;
pub mod pipeline;
pub mod port;
pub mod privilege;
pub mod realtime;
pub mod rig;
pub mod service;
pub mod typed;
pub mod wait;

pub use message::*;
