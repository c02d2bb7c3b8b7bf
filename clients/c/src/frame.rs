//! The structures that are passed between a program and the library.

use client::{AlarmRecord, MotionRecord, ObstacleRecord, RigRecord, VehicleRecord};
use std::ffi::c_char;

/// What to read. `LOOKOUT_OPTIONS` initialises it: the daemon `lookout`, without pictures.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct LookoutOptions {
    /// `LOOKOUT_LAYOUT`: the layout that the program was compiled with.
    pub layout: u32,
    /// 1: frames come with the disparity map and its pictures; 0: without.
    pub pictures: u32,
    /// Name of the daemon, `instance.name` of its configuration; NULL: `lookout`.
    pub instance: *const c_char,
    /// Its folder, `instance.directory`. NULL or empty: `$RUNTIME_DIRECTORY`, `/tmp/lookout-<user id>`, or the folder of the
    /// systemd service.
    pub directory: *const c_char,
}

/// The results of one frame. All pointers are valid until the next call of `lookout_next` or `lookout_close` with the same
/// client, and what they lead to must not be written.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct LookoutFrame {
    /// Number of the pair in its run, from 0, rising; a gap is a frame that a newer one has overtaken.
    pub sequence: u64,
    /// Time of the source (recording, scene, camera), in ns.
    pub source_ns: u64,
    /// When the pair was captured, in ns of CLOCK_MONOTONIC: the age of a result is that clock less this value. 0 where the
    /// daemon itself has ended.
    pub capture_ns: u64,
    /// When the result was complete, in ns of CLOCK_MONOTONIC; 0 where it is withdrawn.
    pub result_ns: u64,
    /// The run: 12 letters and digits, other ones at each start of the daemon. Run and sequence identify a frame.
    pub run: *const c_char,
    /// Why the alarm has its level, in words.
    pub reason: *const c_char,
    /// Alarm, road, path, and in `space` free space and boundaries.
    pub alarm: *const AlarmRecord,
    /// The obstacles, the oldest track first: `obstacle_count` of them.
    pub obstacles: *const ObstacleRecord,
    /// The vehicle's own motion; unknown unless its `health` has `LOOKOUT_HEALTH_KNOWN`.
    pub motion: *const MotionRecord,
    /// What the vehicle's bus reported; which values there are is in its field `present`.
    pub vehicle: *const VehicleRecord,
    /// Frame size and rectified rig, to turn disparities into metres: z = `focal_px` × `baseline_m` ÷ disparity. All zeros
    /// until the daemon has told it, within a second of the client's start.
    pub rig: *const RigRecord,
    /// Disparity in 1/256 px, 0 = unknown: `width` × `height` values, row after row. NULL if pictures were not asked for, or
    /// the frame is withdrawn; so are the other pictures then.
    pub disparity: *const u16,
    /// Confidence of the disparity, 1 to 255; 0 where it is unknown.
    pub confidence: *const u8,
    /// Left rectified picture, grey values.
    pub left: *const u8,
    /// Right rectified picture as it was matched, grey values.
    pub right: *const u8,
    /// Number of obstacles, 0 to `LOOKOUT_MAX_OBSTACLES`.
    pub obstacle_count: u32,
    /// 1: the results of this frame and of all earlier ones no longer hold: a stage or the daemon has ended, or results have
    /// stopped. The alarm is then off, and there are no obstacles. Else 0.
    pub withdrawn: u32,
    /// Width of the frame's pictures, in pixels; 0 where the daemon itself has ended.
    pub width: u32,
    /// Height of the frame's pictures, in pixels; 0 where the daemon itself has ended.
    pub height: u32,
    /// How stages treated the frame: bits of [`crate::modes`].
    pub modes: u32,
    /// Padding; 0.
    pub reserved: u32,
}
