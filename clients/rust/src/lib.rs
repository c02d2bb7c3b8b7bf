//! Reads the results of a running lookout daemon from shared memory: obstacles, alarm, path, free space, own motion, and
//! if wanted the disparity map with its pictures, without a copy.
//!
//! ```no_run
//! use lookout_client::{Client, Options};
//! use std::time::Duration;
//!
//! let mut client = Client::open(Options::default())?;
//! loop {
//!     let Some(frame) = client.next(Duration::from_secs(1))? else { continue };
//!     println!("{} {}: {} obstacles", frame.sequence, frame.level(), frame.obstacles.len());
//! }
//! # #[allow(unreachable_code)]
//! # Ok::<(), lookout_client::ClientError>(())
//! ```
//!
//! - [`Client::next`] gives the newest frame, each at most once. A reader that is slow gets fewer frames.
//! - It waits for a daemon that is not there, and goes on with the next run when the daemon is restarted.
//! - Results that no longer hold come as a frame with [`Frame::withdrawn`]. Whoever acts on results also watches their
//!   [age](Frame::age): a program that is itself held up learns nothing.
//! - A client costs the daemon nothing, also one that stalls: it holds at most one message of a pool that has room for it.
//! - Only the daemon's user can read its shared memory; other users read the socket of `lookout stream`
//!   (docs/clients.md).
//! - Client and daemon must be of one release: [`LAYOUT`] names the layout of the messages. The error says so otherwise.
//!
//! If damage to the shared memory lets a call wait for ever, the process is ended after some seconds with a message on
//! standard error (`lookout_ipc::stall`).

mod client;
mod frame;
mod last;
mod options;
mod run;

pub use client::{Client, ClientError};
pub use frame::Frame;
pub use messages::alarm::{self, Faults};
pub use messages::depth::Depth;
pub use messages::header::{VERSION as LAYOUT, modes};
pub use messages::motion::{self, MotionRecord, VehicleRecord};
pub use messages::obstacles::{AlarmRecord, MAX_COUNT as MAX_OBSTACLES, ObstacleRecord};
pub use messages::rig::RigRecord;
pub use messages::space::{self, BoundaryPointRecord, BoundaryRecord, SectorRecord, SpaceRecord};
pub use options::Options;
