//! A video of a run: the overlays in its results folder, at the pace of their source times.
//!
//! The video is made after the run, from the files that it left, so that encoding takes nothing from the frames.
//! MP4, Matroska and WebM are written by a program on the `PATH`, ffmpeg or GStreamer, which gets raw pictures through a
//! pipe; animated GIF is written here ([`gif`]).

mod frames;
mod gif;
mod outcome;
mod plan;
mod program;

pub use outcome::{Video, VideoError};
pub use plan::Plan;

#[cfg(test)]
mod tests;
