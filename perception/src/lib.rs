//! The algorithms of lookout: dense stereo, road model, obstacle regions, recognition and tracking.
//!
//! Nothing here reads a file, a clock or the environment or talks to another process; threads are
//! started only by a matcher that was asked for several. Every algorithm takes views of caller-owned images, writes into caller-owned outputs
//! and keeps its scratch memory in a workspace that is allocated once.

pub mod alarm;
pub mod calibration;
pub mod depth;
pub mod detection;
pub mod image;
pub mod image_quality;
pub mod point_cloud;
pub mod recognition;
pub mod rectify;
pub mod region;
pub mod rig;
pub mod road;
pub mod scene;
pub mod simd;
pub mod stereo;
pub mod tracking;
