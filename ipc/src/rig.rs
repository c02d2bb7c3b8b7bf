//! What the frames of a run are, and what turns their disparities into metres: part of `status`, so
//! that a reader from outside needs neither the configuration nor the calibration.

use bytemuck::{Pod, Zeroable};

/// The frames and the rectified rig.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct RigRecord {
    /// Width of an image in pixels; 0 while it is not known.
    pub width: u32,
    /// Height of an image in pixels.
    pub height: u32,
    /// Disparities that are searched, from 0 px on.
    pub disparities: u32,
    /// 1 when frames come one at a time, each as soon as the one before is done (lock-step).
    pub lockstep: u32,
    /// Focal length of both cameras, in pixels.
    pub focal_px: f64,
    /// Distance between the two centres, in metres.
    pub baseline_m: f64,
    /// Column of the left principal point, in pixels.
    pub cx_px: f64,
    /// Row of the principal point, in pixels.
    pub cy_px: f64,
    /// Time from one pair to the next that the run aims at, in nanoseconds.
    pub period_ns: u64,
}
