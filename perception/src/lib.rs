//! Perception algorithms of lookout: dense stereo, road model, obstacle detection, recognition, tracking and
//! the collision alarm.
//!
//! No code in this crate reads a file, a clock or the environment, or communicates with another process.
//! Threads are started only by a matcher that was configured with several. Every algorithm takes views of
//! caller-owned images and writes to caller-owned outputs; its scratch memory is in a workspace that is
//! allocated once.
//!
//! The stages in the order of processing, with the section of the paper (Xie, Long, Zhang and Sun, *A Robust
//! Real-Time Computing-based Environment Sensing System for Intelligent Vehicle*):
//!
//! - [`stereo`]: rectified image pair to disparity map (sections 3.2 to 3.4).
//! - [`scene`]: disparity map to road, obstacle regions and free space; runs [`road`], [`detection`] (section 3.5) and
//!   [`free_space`].
//! - [`recognition`]: cascade classifier for obstacle regions.
//! - [`tracking`]: regions to tracks with distance and closing speed.
//! - [`alarm`]: tracks to an alarm level (section 4.3).
//! - [`calibration`], [`rectify`], [`image_quality`], [`frozen_picture`], [`point_cloud`], [`excerpt`]: support. [`simd`]: vector kernels.
//!
//! [`scene`] has a runnable example.

pub mod alarm;
pub mod calibration;
pub mod depth;
pub mod detection;
pub mod excerpt;
pub mod frame_clock;
pub mod free_space;
pub mod frozen_picture;
pub mod image;
pub mod image_quality;
pub mod motion;
pub mod outline;
pub mod point_cloud;
pub mod range;
pub mod recognition;
pub mod rectify;
pub mod region;
pub mod rig;
pub mod road;
pub mod scene;
pub mod simd;
pub mod stereo;
pub mod tracking;
