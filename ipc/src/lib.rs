//! All messages between processes of lookout, and the services that carry them through shared memory.
//!
//! ```
//! use lookout_ipc::bus::Bus;
//! use lookout_ipc::command::{self, CommandRecord};
//! use lookout_ipc::header::{Header, Kind};
//! use lookout_ipc::instance::{Instance, InstanceLock};
//! use lookout_ipc::service::COMMAND;
//!
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! let folder = tempfile::tempdir()?;
//! let instance = Instance::new("example", folder.path());
//! let _lock = InstanceLock::take(&instance)?; // the scheduler holds it while the daemon runs
//! let bus = Bus::join(&instance)?;
//! let publisher = bus.publisher(&COMMAND, 0, 0)?; // this message has no images
//! let subscriber = bus.subscriber(&COMMAND)?;
//!
//! let sent = CommandRecord { period_ns: 50_000_000, ..CommandRecord::default() };
//! publisher.send_record(Header::new(Kind::Command), &sent)?;
//! let sample = subscriber.receive()?.ok_or("no message")?;
//! let received = command::view(sample.header(), sample.payload())?;
//! assert_eq!(received, sent);
//! # Ok(())
//! # }
//! ```
//!
//! Every message is a [`header::Header`] and a payload, a slice of bytes. One module per message declares the layout of
//! the payload (`pair`, `depth`, `regions`, `obstacles`, `report`, `command`, `status`). A publisher loans a sample,
//! writes it in place and sends it; a subscriber reads images in place, so they are not copied. The `view` function of
//! each message copies header and records, and checks every number of them against its range before it is used;
//! [`port`] says what is relied on when another process writes the same memory.
//!
//! [`pipeline`] declares the services and the processes. [`bus`] opens the ports ([`port`]), [`wait`] blocks until
//! messages arrive, [`instance`] manages names, locks and the files of a run.
//!
//! Only this crate uses iceoryx2, with its non-generic ports, so that its generic code is compiled once.

pub mod alarm;
pub mod alarm_change;
mod alarm_text;
pub mod alarm_time;
pub mod allocation;
pub mod bus;
pub mod calibration;
pub mod clock;
mod copied;
pub mod deadline;
pub mod device;
mod error;
mod file_sync;
pub mod free_memory;
pub mod header;
pub mod heat;
pub mod idle;
pub mod instance;
pub mod layout;
mod message;
pub mod motion;
pub mod neighbours;
mod node_counter;
pub mod pipeline;
pub mod port;
pub mod privilege;
mod range;
pub mod realtime;
pub mod rig;
pub mod run_files;
pub mod service;
pub mod silence;
pub mod source_time;
pub mod space;
pub mod stall;
pub mod type_name;
pub mod typed;
pub mod user;
pub mod wait;

pub use copied::Records;
pub use message::*;
pub use range::{MAX_CLOCK_NS, MAX_COUNT, MAX_CPU_NS, MAX_SOURCE_NS, Number, RangeError};
