//! The record of a tracked obstacle in the message `regions`.

use crate::alarm::MOVING;
use crate::header::{MAX_DISPARITY_PX, MAX_PIXELS, MAX_SIDE, MIN_DISPARITY_PX};
use crate::range::{
    ANY_U32, Each, FLAG, LATERAL_M, MAX_COLLISION_S, MAX_METRES, MAX_SPEED_M_S, METRES, SHARE, Within,
    ranges, within, within_or_infinite,
};
use bytemuck::{Pod, Zeroable};

/// Maximum number of tracks in a message.
pub const MAX_TRACKS: usize = 128;

/// One tracked obstacle. The box is in pixels of the left image; z is the camera's axis.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct TrackRecord {
    /// Number of the track, from 1.
    pub track: u32,
    /// 1 if it counts as an obstacle, else 0.
    pub confirmed: u32,
    /// Number of frames in which it was seen.
    pub seen: u32,
    /// Number of frames in a row, up to this one, in which it was not seen; its place is then the prediction.
    pub missed: u32,
    /// Number of frames in a row, up to this one, in which it was seen.
    pub consecutive_frames: u32,
    /// 1 if the speeds are over ground, 0 if they are relative to the camera.
    pub over_ground: u32,
    /// Whether it moves over ground: an index into [`crate::alarm::MOVING`]; 0 = unknown.
    pub moving: u32,
    /// Offset of the crop's first byte from the start of the crops.
    pub crop_offset: u32,
    /// The box of the whole thing: left, top, width, height, in px; within the image.
    pub bounds: [u32; 4],
    /// The crop, which is the box with a margin: left, top, width, height, in px; within the image. All 0 if the
    /// payload had no room for it.
    pub crop: [u32; 4],
    /// Probability that it exists, 0 to 1.
    pub probability: f64,
    /// Time since it was last seen, in seconds.
    pub unseen_s: f64,
    /// Mean absolute logarithm of the ratio of its measured width from frame to frame.
    pub width_jitter: f64,
    /// Disparity of the near side, in px, above 0.
    pub disparity_px: f64,
    /// Filtered distance along z, in metres.
    pub distance_m: f64,
    /// Standard deviation of the distance, in metres.
    pub distance_sigma_m: f64,
    /// Lateral position of its middle, in metres; positive to the right of the camera's axis.
    pub lateral_m: f64,
    /// Standard deviation of the lateral position, in metres.
    pub lateral_sigma_m: f64,
    /// Width in metres.
    pub width_m: f64,
    /// How far inside of its left and of its right side the near face begins, in metres.
    pub face_inset_m: [f64; 2],
    /// How far behind the near face its left and its right end are, in metres.
    pub end_depth_m: [f64; 2],
    /// How far outside of its left and of its right side these ends are, in metres.
    pub end_excess_m: [f64; 2],
    /// Height in metres.
    pub height_m: f64,
    /// By how much it stands before a wall that is as high, in metres; infinite where there is none.
    pub before_wall_m: f64,
    /// Filtered lateral speed in m/s; positive to the right.
    pub across_m_s: f64,
    /// Standard deviation of the lateral speed, in m/s.
    pub across_sigma_m_s: f64,
    /// Filtered speed along z, in m/s; positive away from the camera. 0 if the speeds are not over ground.
    pub along_m_s: f64,
    /// Standard deviation of the speed along z, in m/s.
    pub along_sigma_m_s: f64,
    /// Correlations of the errors of lateral position and distance, lateral position and speed, lateral position and speed along z,
    /// distance and lateral speed, distance and speed along z, and both speeds, -1 to 1. 0 if the speeds are not over ground.
    pub correlations: [f64; 6],
    /// Closing speed in m/s; positive while the distance decreases.
    pub closing_m_s: f64,
    /// Standard deviation of the closing speed, in m/s.
    pub closing_sigma_m_s: f64,
    /// Time to collision in seconds; infinite if the distance does not decrease significantly.
    pub time_to_collision_s: f64,
    /// Standard deviation of the time to collision, in seconds; 0 if the distance does not decrease.
    pub time_to_collision_sigma_s: f64,
}

/// Speeds with a sign, and their standard deviations.
const SPEED_M_S: Within<f64> = within(-MAX_SPEED_M_S, MAX_SPEED_M_S);
const SPEED_SIGMA_M_S: Within<f64> = within(0.0, MAX_SPEED_M_S);

ranges! {
    TrackRecord as "regions: track" {
        track: ANY_U32,
        confirmed: FLAG,
        seen: ANY_U32,
        missed: ANY_U32,
        consecutive_frames: ANY_U32,
        over_ground: FLAG,
        moving: within(0, MOVING.len() as u32 - 1),
        crop_offset: within(0, MAX_PIXELS),
        bounds: Each(within(0, MAX_SIDE)),
        crop: Each(within(0, MAX_SIDE)),
        probability: SHARE,
        unseen_s: within(0.0, 1e6),
        width_jitter: within(0.0, 1e3),
        disparity_px: within(MIN_DISPARITY_PX, MAX_DISPARITY_PX),
        distance_m: METRES,
        distance_sigma_m: METRES,
        lateral_m: LATERAL_M,
        lateral_sigma_m: METRES,
        width_m: METRES,
        face_inset_m: Each(METRES),
        end_depth_m: Each(METRES),
        end_excess_m: Each(METRES),
        height_m: METRES,
        before_wall_m: within_or_infinite(-MAX_METRES, MAX_METRES),
        across_m_s: SPEED_M_S,
        across_sigma_m_s: SPEED_SIGMA_M_S,
        along_m_s: SPEED_M_S,
        along_sigma_m_s: SPEED_SIGMA_M_S,
        correlations: Each(within(-1.0, 1.0)),
        closing_m_s: SPEED_M_S,
        closing_sigma_m_s: SPEED_SIGMA_M_S,
        time_to_collision_s: within_or_infinite(0.0, MAX_COLLISION_S),
        time_to_collision_sigma_s: within(0.0, MAX_COLLISION_S),
    }
}
