//! Frame size and rectified rig of a run: part of `status`, so that an external reader can convert disparities to
//! metres without the configuration and the calibration.

use bytemuck::{Pod, Zeroable};

/// Frame size and rectified rig. All zeros until they are known.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct RigRecord {
    /// Width of an image in pixels.
    pub width: u32,
    /// Height of an image in pixels.
    pub height: u32,
    /// Number of disparities that are searched, from 0 px.
    pub disparities: u32,
    /// 1 in lock-step, 0 at live rate.
    pub lockstep: u32,
    /// Focal length of both cameras, in pixels.
    pub focal_px: f64,
    /// Distance between the camera centres, in metres.
    pub baseline_m: f64,
    /// Column of the left principal point, in pixels.
    pub cx_px: f64,
    /// Row of the principal point, in pixels.
    pub cy_px: f64,
    /// Current target of the time between two pairs at live rate, in ns.
    pub period_ns: u64,
}
