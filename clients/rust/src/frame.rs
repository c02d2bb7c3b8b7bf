//! A frame as a client gets it.

use messages::alarm::level_name;
use messages::clock::monotonic_ns;
use messages::depth::Depth;
use messages::motion::{MotionRecord, VehicleRecord};
use messages::obstacles::{AlarmRecord, ObstacleRecord};
use messages::rig::RigRecord;
use std::time::Duration;

/// The results of one frame. It is valid until the next call of [`Client::next`](crate::Client::next).
///
/// Camera axes: x to the right, y down, z forward along the optical axis of the left camera. Speeds are positive forwards,
/// yaw and curvature to the left, lateral positions to the right. The documentation of each field of the records says
/// unit, sign, and what it holds where it is not known.
#[derive(Clone, Copy, Debug)]
pub struct Frame<'a> {
    /// The run: 12 letters and digits, other ones at each start of the daemon. Run and sequence identify a frame.
    pub run: &'a str,
    /// Number of the pair in its run, from 0, rising; a gap is a frame that a newer one has overtaken.
    pub sequence: u64,
    /// Time of the source (recording, scene, camera), in ns.
    pub source_ns: u64,
    /// When the pair was captured, in ns of CLOCK_MONOTONIC; 0 where the daemon itself has ended.
    pub capture_ns: u64,
    /// When the result was complete, in ns of CLOCK_MONOTONIC; 0 where it is withdrawn.
    pub result_ns: u64,
    /// Width of the frame's pictures, in pixels; 0 where the daemon itself has ended.
    pub width: u32,
    /// Height of the frame's pictures, in pixels; 0 where the daemon itself has ended.
    pub height: u32,
    /// How stages treated the frame: bits of [`crate::modes`].
    pub modes: u32,
    /// The results of this frame and of all earlier ones no longer hold: a stage or the daemon has ended, or results have
    /// stopped. The alarm is then off, and there are no obstacles.
    pub withdrawn: bool,
    /// Alarm, road, path, and in `space` free space and boundaries.
    pub alarm: &'a AlarmRecord,
    /// The obstacles, the oldest track first.
    pub obstacles: &'a [ObstacleRecord],
    /// The vehicle's own motion; unknown unless [`MotionRecord::is_known`].
    pub motion: &'a MotionRecord,
    /// What the vehicle's bus reported; which values there are is in its field `present`.
    pub vehicle: &'a VehicleRecord,
    /// Frame size and rectified rig, to turn disparities into metres: z = `focal_px` × `baseline_m` ÷ disparity. All zeros
    /// until the daemon has told it, within a second of the client's start.
    pub rig: &'a RigRecord,
    /// Disparity map and pictures, read in place; `None` if they were not asked for, or the frame is withdrawn.
    pub pictures: Option<Depth<'a>>,
    /// Why the client itself withdrew the frame; empty otherwise.
    pub(crate) ended: &'a str,
}

impl Frame<'_> {
    /// Name of the alarm's level: `off`, `clear`, `warning` or `alarm`.
    pub fn level(&self) -> &'static str {
        level_name(self.alarm.level)
    }

    /// Why the alarm has its level, in words.
    pub fn reason(&self) -> String {
        if self.ended.is_empty() { self.alarm.reason() } else { self.ended.into() }
    }

    /// Time since the pair was captured; the time since the machine was started where the daemon itself has ended.
    pub fn age(&self) -> Duration {
        Duration::from_nanos(monotonic_ns().saturating_sub(self.capture_ns))
    }

    /// Disparity at a column and row, in px; `None` where it is unknown, outside the picture, or without pictures.
    pub fn disparity_px(&self, column: u32, row: u32) -> Option<f64> {
        /// Disparities of a message have steps of 1/256 px.
        const STEPS_PER_PX: f64 = 256.0;
        let inside = column < self.width && row < self.height;
        let index = row as usize * self.width as usize + column as usize;
        let steps = *self.pictures.filter(|_| inside)?.disparity.get(index)?;
        (steps > 0).then(|| f64::from(steps) / STEPS_PER_PX)
    }
}
