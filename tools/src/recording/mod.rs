//! Writing recordings: MCAP files that Foxglove, Lichtblick and the mcap tools open, and that
//! `lookout replay` reads.
//!
//! [`Sink`] is the policy: files, their lengths, the ring before an alarm, the disk's free space. It
//! knows neither clock nor thread. [`Recorder`] is a sink on a thread of its own behind a queue of
//! bounded length, so that a slow card delays nobody.

pub mod encode;
mod file;
mod recorder;
mod ring;
mod schema;
mod sink;
pub mod storage;
#[cfg(test)]
mod tests;
mod topic;

pub use recorder::{Offer, Recorder};
pub use sink::{About, Item, Limits, RecordError, Report, RingLimits, Sink};
pub use topic::{Choice, ImageForm, Message, Topic};
