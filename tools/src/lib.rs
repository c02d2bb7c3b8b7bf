//! Offline tools and output formats, without processes of their own.
//!
//! - [`evaluation`]: accuracy against ground truth (disparity maps, detection, distance, recognition) and
//!   comparison of runs;
//! - [`training`]: training of recognition cascades;
//! - [`calibration`]: calibration from folders and live sessions, with reports;
//! - [`recording`]: MCAP recording of a running daemon;
//! - [`can_out`]: frames for a CAN bus, their DBC file, and sending them;
//! - [`reporting`]: images, plots, frame records and run summaries that the other modules write;
//! - `ros2` (feature `ros2`): messages of ROS 2 and their names over zenoh;
//! - [`soak`]: statistics, fault injection and verdict of soak tests.
//!
//! Processes, command lines and services are in the `daemon` crate, which calls these modules.

pub mod calibration;
pub mod can_out;
pub mod evaluation;
pub mod recording;
pub mod reporting;
#[cfg(any(feature = "ros2", test))]
pub mod ros2;
pub mod soak;
pub mod training;
