//! `obstacles`: recognition → vehicle, scheduler, recorder, viewer. The alarm, the road model
//! and up to [`MAX_COUNT`] tracked obstacles.

use crate::alarm::{Faults, LEVELS, MOVING, OFF, RULES};
use crate::copied::{Records, copy_out};
use crate::header::{Header, Kind, MAX_SIDE, MessageError, check_box};
use crate::range::{
    ANY_U32, AnyBytes, Each, FLAG, LATERAL_M, MAX_COLLISION_S, MAX_METRES, MAX_SPEED_M_S, METRES, Nested, Ranged, SHARE, Within, ranges, within, within_or_infinite,
};
use super::regions::{CAMERA_HEIGHT_M, HORIZON_PX, SLOPE};
use crate::space::SpaceRecord;
use crate::typed::{Message, Output, Written};
use bytemuck::{Pod, Zeroable};

/// Maximum number of obstacles in a message.
pub const MAX_COUNT: usize = 128;

/// Alarm and road model of a frame.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct AlarmRecord {
    /// Level of the alarm: 0 = off (a self-check failed), 1 = clear, 2 = warning, 3 = alarm
    /// ([`crate::alarm::LEVELS`]).
    pub level: u32,
    /// The rule that raised it: an index into [`crate::alarm::RULES`]; 0 = none.
    pub rule: u32,
    /// The track that caused it, from 1; 0 = none.
    pub track: u32,
    /// Self-checks that failed: bits of [`crate::alarm::Faults`]; not 0 while the level is off.
    pub faults: u32,
    /// 1 if the level differs from that of the previous frame, else 0.
    pub changed: u32,
    /// The track that the state is about, from 1: the one that raised the level, or else the nearest in the path; 0 = none.
    pub object: u32,
    /// 1 if the level is only held: what raised it does not call for it in this frame.
    pub held: u32,
    /// 1 if the path follows from the vehicle's motion: the strip that its body sweeps. 0: the motion is unknown, the
    /// path is the straight strip of the configuration, and of the fields `path_…` only its half width and the body are set.
    pub path_known: u32,
    /// Distance of the nearest obstacle in the path, in metres; infinite if there is none.
    pub nearest_m: f64,
    /// Time to collision of `track`, in seconds; infinite if its distance does not decrease, or it is lost.
    pub time_to_collision_s: f64,
    /// Deceleration that stops the vehicle before `track`, in m/s², positive; 0 if none is required.
    pub required_deceleration_m_s2: f64,
    /// Gap between `object` and the path when the vehicle arrives, in metres; negative if they overlap: by so much it would
    /// have to be farther aside. Infinite if there is none, or it is lost.
    pub clearance_m: f64,
    /// Class of `object`, padded with zeros; empty if there is none, or it is lost.
    pub class: [u8; 16],
    /// 1 if a road was detected, else 0. The fields of the road below are then 0.
    pub road_seen: u32,
    /// Number of obstacles that follow, 0 to [`MAX_COUNT`].
    pub obstacles: u32,
    /// Slope of the road in v-disparity, px of disparity per row.
    pub slope: f64,
    /// Row of the horizon in the left image, in px; may lie outside the image.
    pub horizon_px: f64,
    /// Share of rows whose disparities support the road, 0 to 1.
    pub confidence: f64,
    /// Height of the camera above the road, in metres.
    pub camera_height_m: f64,
    /// Curvature of the path of the rear axle's centre, in 1/m, to the left positive.
    pub path_curvature_per_m: f64,
    /// Its standard deviation, in 1/m.
    pub path_curvature_sigma_per_m: f64,
    /// Half the width of the body, in metres; the front's overhang adds to it on the outer side of a bend.
    pub path_half_width_m: f64,
    /// Arc length from the rear axle from which the path follows the road's edges, in metres; 0 if it does not.
    pub path_edges_from_m: f64,
    /// Curvature from there on, in 1/m, to the left positive.
    pub path_edges_curvature_per_m: f64,
    /// Position of the camera to the right of the vehicle's centre line, in metres.
    pub path_camera_right_m: f64,
    /// Distance from the camera back to the rear axle, in metres.
    pub path_rear_axle_m: f64,
    /// Distance from the camera forward to the front of the body, in metres.
    pub path_front_m: f64,
    /// Yaw of the camera in the vehicle, in rad, to the left positive.
    pub path_camera_yaw_rad: f64,
    /// Free space and boundaries.
    pub space: SpaceRecord,
}

/// Maximum curvature of a path, in 1/m: a radius of 1 m, less than any vehicle's.
const MAX_CURVATURE_PER_M: f64 = 1.0;
/// Curvature with a sign.
const CURVATURE: Within<f64> = within(-MAX_CURVATURE_PER_M, MAX_CURVATURE_PER_M);
/// Maximum magnitude of a position within the vehicle, in metres: longer than any road vehicle.
const MAX_BODY_M: f64 = 50.0;
/// Position within the vehicle.
const BODY_M: Within<f64> = within(-MAX_BODY_M, MAX_BODY_M);

/// Maximum required deceleration, in m/s²: [`MAX_SPEED_M_S`] within 0.1 m.
const MAX_DECELERATION_M_S2: f64 = MAX_SPEED_M_S * MAX_SPEED_M_S / (2.0 * 0.1);

/// A gap with a sign.
pub(crate) const CLEARANCE_M: Within<f64> = within_or_infinite(-MAX_METRES, MAX_METRES);
/// Distance of the nearest obstacle in the path.
pub(crate) const NEAREST_M: Within<f64> = within_or_infinite(0.0, MAX_METRES);
/// Time to collision.
pub(crate) const COLLISION_S: Within<f64> = within_or_infinite(0.0, MAX_COLLISION_S);
/// Required deceleration.
pub(crate) const DECELERATION_M_S2: Within<f64> = within(0.0, MAX_DECELERATION_M_S2);

ranges! {
    AlarmRecord as "obstacles: alarm" {
        level: within(0, LEVELS.len() as u32 - 1),
        rule: within(0, RULES.len() as u32 - 1),
        track: ANY_U32,
        faults: within(0, Faults::ALL.0),
        changed: FLAG,
        object: ANY_U32,
        held: FLAG,
        path_known: FLAG,
        nearest_m: NEAREST_M,
        time_to_collision_s: COLLISION_S,
        required_deceleration_m_s2: DECELERATION_M_S2,
        clearance_m: CLEARANCE_M,
        class: AnyBytes,
        road_seen: FLAG,
        obstacles: within(0, MAX_COUNT as u32),
        slope: SLOPE,
        horizon_px: HORIZON_PX,
        confidence: SHARE,
        camera_height_m: CAMERA_HEIGHT_M,
        path_curvature_per_m: CURVATURE,
        path_curvature_sigma_per_m: within(0.0, MAX_CURVATURE_PER_M),
        path_half_width_m: within(0.0, MAX_BODY_M),
        path_edges_from_m: METRES,
        path_edges_curvature_per_m: CURVATURE,
        path_camera_right_m: BODY_M,
        path_rear_axle_m: BODY_M,
        path_front_m: BODY_M,
        path_camera_yaw_rad: within(-0.1, 0.1),
        space: Nested,
    }
}

impl AlarmRecord {
    /// An alarm that cannot judge, because these self-checks failed.
    pub fn off(faults: Faults) -> Self {
        Self {
            level: OFF,
            faults: faults.0,
            nearest_m: f64::INFINITY,
            time_to_collision_s: f64::INFINITY,
            clearance_m: f64::INFINITY,
            ..Self::default()
        }
    }
}

/// One tracked obstacle. The box is in pixels of the left image; z is the camera's axis.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct ObstacleRecord {
    /// Number of its track, from 1.
    pub track: u32,
    /// 1 if the track is confirmed: only then it can raise the alarm; else 0.
    pub confirmed: u32,
    /// Number of frames in which it was detected.
    pub seen: u32,
    /// Number of frames in a row, up to this one, in which it was not detected. Above 0, its box, place and size are
    /// predictions.
    pub missed: u32,
    /// The box: left, top, width, height, in px; within the image.
    pub bounds: [u32; 4],
    /// Probability that it exists, 0 to 1.
    pub probability: f64,
    /// Filtered distance along z, in metres.
    pub distance_m: f64,
    /// Standard deviation of the distance, in metres.
    pub distance_sigma_m: f64,
    /// Lateral position of its centre, in metres; positive to the right of the camera's axis.
    pub lateral_m: f64,
    /// Width in metres.
    pub width_m: f64,
    /// Height in metres.
    pub height_m: f64,
    /// Gap between it and the vehicle's path when the vehicle arrives, in metres; negative if they overlap: by so much it
    /// would have to be farther aside.
    pub clearance_m: f64,
    /// Lateral speed in m/s; positive to the right. Over ground where the alarm's path is known, else relative to the
    /// camera.
    pub across_m_s: f64,
    /// Speed over ground along z, in m/s; positive away from the camera. 0 where the alarm's path is unknown.
    pub along_m_s: f64,
    /// Closing speed in m/s; positive while the distance decreases.
    pub closing_m_s: f64,
    /// Standard deviation of the closing speed, in m/s.
    pub closing_sigma_m_s: f64,
    /// Time to collision in seconds; infinite if the distance does not decrease.
    pub time_to_collision_s: f64,
    /// Standard deviation of the time to collision, in seconds; 0 if the distance does not decrease.
    pub time_to_collision_sigma_s: f64,
    /// 1 if it is in the path of the vehicle, else 0.
    pub in_path: u32,
    /// Whether it moves over ground: an index into [`crate::alarm::MOVING`]; 0 = unknown.
    pub moving: u32,
    /// Probability of the recognised class; 0 if none was recognised.
    pub score: f64,
    /// Name of the class, padded with zeros; `obstacle` if none was recognised.
    pub class: [u8; 16],
}

/// Speeds with a sign, and their standard deviations.
const SPEED_M_S: Within<f64> = within(-MAX_SPEED_M_S, MAX_SPEED_M_S);
const SPEED_SIGMA_M_S: Within<f64> = within(0.0, MAX_SPEED_M_S);

ranges! {
    ObstacleRecord as "obstacles: obstacle" {
        track: ANY_U32,
        confirmed: FLAG,
        seen: ANY_U32,
        missed: ANY_U32,
        bounds: Each(within(0, MAX_SIDE)),
        probability: SHARE,
        distance_m: METRES,
        distance_sigma_m: METRES,
        lateral_m: LATERAL_M,
        width_m: METRES,
        height_m: METRES,
        clearance_m: CLEARANCE_M,
        across_m_s: SPEED_M_S,
        along_m_s: SPEED_M_S,
        closing_m_s: SPEED_M_S,
        closing_sigma_m_s: SPEED_SIGMA_M_S,
        time_to_collision_s: within_or_infinite(0.0, MAX_COLLISION_S),
        time_to_collision_sigma_s: within(0.0, MAX_COLLISION_S),
        in_path: FLAG,
        moving: within(0, MOVING.len() as u32 - 1),
        score: SHARE,
        class: AnyBytes,
    }
}

/// The parts of a message, copied out of it.
#[derive(Clone, Copy, Debug)]
pub struct Obstacles {
    /// Alarm and road model.
    pub alarm: AlarmRecord,
    /// The obstacles, in the order of their tracks: the oldest first.
    pub obstacles: Records<ObstacleRecord, MAX_COUNT>,
}

/// Length of the payload with `count` obstacles, in bytes.
pub fn payload_bytes(count: usize) -> usize {
    size_of::<AlarmRecord>() + count * size_of::<ObstacleRecord>()
}

/// Writes the message to the start of a payload. Returns its length in bytes, [`payload_bytes`]`(obstacles.len())`.
///
/// # Errors
/// If the payload is too short, or there are more than [`MAX_COUNT`] obstacles.
pub fn write(
    payload: &mut [u8],
    alarm: AlarmRecord,
    obstacles: &[ObstacleRecord],
) -> Result<usize, MessageError> {
    let needed = payload_bytes(obstacles.len());
    if payload.len() < needed || obstacles.len() > MAX_COUNT {
        return Err(MessageError::Length { given: payload.len(), needed });
    }
    let alarm = AlarmRecord { obstacles: obstacles.len() as u32, ..alarm };
    let (start, rest) = payload[..needed].split_at_mut(size_of::<AlarmRecord>());
    start.copy_from_slice(bytemuck::bytes_of(&alarm));
    rest.copy_from_slice(bytemuck::cast_slice(obstacles));
    Ok(needed)
}

/// Copies the parts of a message and checks them: every number is in its range, and all boxes lie within the image.
///
/// # Errors
/// If the header, the length or any field is invalid.
pub fn view(header: &Header, payload: &[u8]) -> Result<Obstacles, MessageError> {
    header.check(Kind::Obstacles)?;
    let short = MessageError::Length { given: payload.len(), needed: size_of::<AlarmRecord>() };
    let alarm: AlarmRecord = copy_out(payload).ok_or(short)?;
    alarm.check()?;
    let (count, rest) = (alarm.obstacles as usize, &payload[size_of::<AlarmRecord>()..]);
    if rest.len() != count * size_of::<ObstacleRecord>() {
        return Err(MessageError::Length { given: payload.len(), needed: payload_bytes(count) });
    }
    let obstacles = Records::<ObstacleRecord, MAX_COUNT>::copy_out(rest);
    for obstacle in &obstacles {
        obstacle.check()?;
        check_box("obstacles: box of an obstacle", header, &obstacle.bounds)?;
    }
    Ok(Obstacles { alarm, obstacles })
}

/// Selects the valid messages of `obstacles`: messages of its two publishers (the last stage and the scheduler) can
/// arrive in any order, and a new subscriber receives the last message of each.
#[derive(Clone, Copy, Debug, Default)]
pub struct Newest {
    issued_ns: u64,
}

impl Newest {
    /// Whether a message was not issued before one that was already accepted. Otherwise it is out of date and must be
    /// ignored.
    pub fn accepts(&mut self, header: &Header) -> bool {
        let newer = header.issued_ns >= self.issued_ns;
        if newer {
            self.issued_ns = header.issued_ns;
        }
        newer
    }
}

/// The typed message.
#[derive(Clone, Copy, Debug)]
pub struct ObstaclesMessage;

impl Message for ObstaclesMessage {
    const KIND: Kind = Kind::Obstacles;
    type View<'a> = Obstacles;

    fn view(header: &Header, payload: &[u8]) -> Result<Obstacles, MessageError> {
        view(header, payload)
    }

    fn max_payload_bytes(_: usize, _: usize) -> usize {
        payload_bytes(MAX_COUNT)
    }
}

impl Output<'_, ObstaclesMessage> {
    /// Writes the message; see [`write()`].
    ///
    /// # Errors
    /// As [`write()`].
    pub fn write(self, alarm: AlarmRecord, obstacles: &[ObstacleRecord]) -> Result<Written, MessageError> {
        write(self.payload, alarm, obstacles).map(Written)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_message_that_was_issued_last_is_valid_in_any_order_of_arrival() {
        let at = |issued_ns| Header { issued_ns, ..Header::new(Kind::Obstacles) };
        let mut newest = Newest::default();
        let accepted = [5, 9, 7, 9, 10].map(|ns| newest.accepts(&at(ns)));
        assert_eq!(accepted, [true, true, false, true, true]);
    }

    #[test]
    fn written_messages_are_read_and_invalid_ones_refused() {
        let header = Header { width: 100, height: 80, ..Header::new(Kind::Obstacles) };
        let obstacle = ObstacleRecord { track: 3, bounds: [10, 10, 20, 20], ..ObstacleRecord::default() };
        let mut memory = vec![0_u64; payload_bytes(2) / 8];
        let payload: &mut [u8] = bytemuck::cast_slice_mut(&mut memory);
        write(payload, AlarmRecord { level: 2, ..AlarmRecord::default() }, &[obstacle, obstacle]).unwrap();
        let got = view(&header, payload).unwrap();
        assert_eq!((got.alarm.level, &got.obstacles[..]), (2, &[obstacle, obstacle][..]));
        assert!(view(&header, &payload[..payload.len() - 8]).is_err());
        assert!(view(&header, &[]).is_err());
        assert!(view(&Header { width: 25, ..header }, payload).is_err(), "box outside the image");
        for wrong in [
            ObstacleRecord { distance_m: f64::INFINITY, ..obstacle },
            ObstacleRecord { lateral_m: f64::NAN, ..obstacle },
            ObstacleRecord { time_to_collision_s: f64::NAN, ..obstacle },
        ] {
            let mut memory = vec![0_u64; payload_bytes(1) / 8];
            let payload: &mut [u8] = bytemuck::cast_slice_mut(&mut memory);
            write(payload, AlarmRecord::default(), &[wrong]).unwrap();
            assert!(view(&header, payload).is_err(), "{wrong:?}");
        }
        let alarm = AlarmRecord { level: 2, ..AlarmRecord::default() };
        for (field, wrong) in obstacle.invalid() {
            let mut memory = vec![0_u64; payload_bytes(1) / 8];
            let payload: &mut [u8] = bytemuck::cast_slice_mut(&mut memory);
            write(payload, alarm, &[wrong]).unwrap();
            let error = view(&header, payload).unwrap_err().to_string();
            assert!(error.starts_with("obstacles: obstacle: ") && error.contains(field), "{error}");
        }
        for (field, wrong) in alarm.invalid().into_iter().filter(|(field, _)| *field != "obstacles") {
            let mut memory = vec![0_u64; payload_bytes(0) / 8];
            let payload: &mut [u8] = bytemuck::cast_slice_mut(&mut memory);
            write(payload, wrong, &[]).unwrap();
            let error = view(&header, payload).unwrap_err().to_string();
            // The space is named as itself: two messages carry it.
            let is_named = error.starts_with("obstacles: alarm: ") || error.starts_with("space: ");
            assert!(is_named && error.contains(field), "{error}");
        }
        let endless = ObstacleRecord { time_to_collision_s: f64::INFINITY, ..obstacle };
        let mut memory = vec![0_u64; payload_bytes(1) / 8];
        let one: &mut [u8] = bytemuck::cast_slice_mut(&mut memory);
        write(one, AlarmRecord::default(), &[endless]).unwrap();
        assert!(view(&header, one).is_ok());
        let mut wrong = payload.to_vec();
        wrong[0] = 4;
        assert!(view(&header, &wrong).is_err(), "unknown level");
        assert!(write(&mut payload[..64], AlarmRecord::default(), &[obstacle]).is_err());
    }
}
