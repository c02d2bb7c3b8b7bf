//! Frame size and rectified rig of a run: part of `status`, so that an external reader can convert disparities to
//! metres without the configuration and the calibration.

use crate::header::MAX_SIDE;
use crate::range::{CLOCK_NS, FLAG, MAX_PLANE_PX, ranges, within};
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

/// Maximum focal length, in px, and baseline, in metres: the limits of a calibration.
const MAX_FOCAL_PX: f64 = 100_000.0;
const MAX_BASELINE_M: f64 = 20.0;

ranges! {
    RigRecord as "rig" {
        width: within(0, MAX_SIDE),
        height: within(0, MAX_SIDE),
        disparities: within(0, MAX_SIDE),
        lockstep: FLAG,
        focal_px: within(0.0, MAX_FOCAL_PX),
        baseline_m: within(0.0, MAX_BASELINE_M),
        cx_px: within(-MAX_PLANE_PX, MAX_PLANE_PX),
        cy_px: within(-MAX_PLANE_PX, MAX_PLANE_PX),
        period_ns: CLOCK_NS,
    }
}
