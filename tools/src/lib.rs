//! What people run at a desk, without processes of its own: evaluation against truth, training, calibration
//! sessions, recordings, soak statistics, and the pictures, plots and records that all of these write.

pub mod calibration;
pub mod evaluation;
pub mod recording;
pub mod reporting;
pub mod soak;
pub mod training;
