//! Writing recordings: MCAP files that Foxglove, Lichtblick and the mcap tools open, and that
//! `lookout replay` reads.
//!
//! [`Sink`] decides which message goes into which file: splitting, the ring buffer before an alarm, free space
//! on the disk. It uses neither clocks nor threads. [`Recorder`] runs a sink on its own thread behind a bounded
//! queue, so that a slow disk never blocks the caller.

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
pub use sink::{About, BYTES_PER_MB, Item, Limits, RecordError, Report, RingLimits, Sink};
pub use topic::{Choice, ImageForm, Message, Topic};
