//! `obstacles`: recognition → vehicle, scheduler, recorder, viewer. The alarm, the road in brief
//! and up to [`MAX_COUNT`] tracked obstacles.

use crate::alarm::{LEVELS, RULES};
use crate::header::{Header, Kind, MessageError};
use crate::typed::{Message, Output, Written};
use bytemuck::{Pod, Zeroable};

/// The most obstacles of a message.
pub const MAX_COUNT: usize = 128;

/// The alarm and the road of a frame.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct AlarmRecord {
    /// 0 = off (cannot judge), 1 = standby, 2 = warning, 3 = alarm: [`crate::alarm::LEVELS`].
    pub level: u32,
    /// The rule that raised it: [`crate::alarm::RULES`].
    pub rule: u32,
    /// The track that caused it; 0 = none.
    pub track: u32,
    /// Self-checks that failed: [`crate::alarm::Faults`]; not 0 while the level is off.
    pub faults: u32,
    /// 1 when the level is another than in the frame before.
    pub changed: u32,
    /// Unused.
    pub reserved: u32,
    /// Nearest obstacle in the path, in metres; infinite when there is none.
    pub nearest_m: f64,
    /// The track's time to collision, in seconds; infinite when it does not close in, or is gone.
    pub time_to_collision_s: f64,
    /// Braking that would stop the vehicle before the track, in m/s²; 0 when none is needed.
    pub required_deceleration_m_s2: f64,
    /// 1 when a road was seen.
    pub road_seen: u32,
    /// Obstacles that follow.
    pub obstacles: u32,
    /// Slope of the road in v-disparity, px per row.
    pub slope: f64,
    /// Row of the horizon, in px.
    pub horizon_px: f64,
    /// Share of rows in which the road is supported, 0 to 1.
    pub confidence: f64,
    /// Height of the camera above the road, in metres.
    pub camera_height_m: f64,
}

/// One tracked obstacle. The box is in pixels of the left image.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct ObstacleRecord {
    /// Its track, from 1.
    pub track: u32,
    /// 1 when it was seen often enough to count.
    pub confirmed: u32,
    /// Frames in which it was seen.
    pub seen: u32,
    /// Frames in a row in which it was not.
    pub missed: u32,
    /// The box: left, top, width, height.
    pub bounds: [u32; 4],
    /// Distance along z, filtered, in metres.
    pub distance_m: f64,
    /// One standard deviation of that.
    pub distance_sigma_m: f64,
    /// Metres right of the camera axis.
    pub lateral_m: f64,
    /// Width in metres.
    pub width_m: f64,
    /// Height in metres.
    pub height_m: f64,
    /// Speed to the right of the camera axis, in m/s.
    pub across_m_s: f64,
    /// Closing speed in m/s, above zero while it comes nearer.
    pub closing_m_s: f64,
    /// One standard deviation of that.
    pub closing_sigma_m_s: f64,
    /// Time to collision in seconds; infinite when it does not close in.
    pub time_to_collision_s: f64,
    /// One standard deviation of that; 0 when it does not close in.
    pub time_to_collision_sigma_s: f64,
    /// 1 when the vehicle would meet it in its path.
    pub in_path: u32,
    /// Unused.
    pub reserved: u32,
    /// Score of the recognised class; 0 when none was.
    pub score: f64,
    /// Name of the class, padded with zeros.
    pub class: [u8; 16],
}

/// The parts of a message.
#[derive(Clone, Copy, Debug)]
pub struct Obstacles<'a> {
    /// The alarm and the road.
    pub alarm: AlarmRecord,
    /// The obstacles, oldest track first.
    pub obstacles: &'a [ObstacleRecord],
}

/// Bytes of the payload with `count` obstacles.
pub fn payload_bytes(count: usize) -> usize {
    size_of::<AlarmRecord>() + count * size_of::<ObstacleRecord>()
}

/// Writes the message to the start of a payload. Gives how many bytes it takes:
/// [`payload_bytes`]`(obstacles.len())`.
///
/// # Errors
/// When the payload is too short, or there are too many obstacles.
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

/// Checks a message and sees its parts.
///
/// # Errors
/// When anything is out of range.
pub fn view<'a>(header: &Header, payload: &'a [u8]) -> Result<Obstacles<'a>, MessageError> {
    header.check(Kind::Obstacles)?;
    let short = MessageError::Length { given: payload.len(), needed: size_of::<AlarmRecord>() };
    let (start, rest) = payload.split_at_checked(size_of::<AlarmRecord>()).ok_or(short)?;
    let alarm: AlarmRecord = bytemuck::pod_read_unaligned(start);
    let count = alarm.obstacles as usize;
    if count > MAX_COUNT {
        return Err(MessageError::Value { what: "count of obstacles", value: count as u64 });
    }
    let known = (alarm.level as usize) < LEVELS.len() && (alarm.rule as usize) < RULES.len();
    if alarm.nearest_m.is_nan() {
        return Err(MessageError::Value { what: "nearest distance", value: alarm.nearest_m.to_bits() });
    }
    if !known || alarm.road_seen > 1 {
        return Err(MessageError::Value { what: "level of the alarm", value: alarm.level.into() });
    }
    if rest.len() != count * size_of::<ObstacleRecord>() {
        return Err(MessageError::Length { given: payload.len(), needed: payload_bytes(count) });
    }
    let obstacles: &[ObstacleRecord] = bytemuck::try_cast_slice(rest)
        .map_err(|_| MessageError::Value { what: "alignment", value: payload.as_ptr() as u64 })?;
    for obstacle in obstacles {
        let [x, y, width, height] = obstacle.bounds.map(u64::from);
        if x + width > u64::from(header.width) || y + height > u64::from(header.height) {
            return Err(MessageError::Value { what: "box of an obstacle", value: x });
        }
        // Times may be infinite; where a thing is may not, and nothing may be no number.
        let places = [obstacle.distance_m, obstacle.lateral_m, obstacle.width_m, obstacle.height_m];
        let rest =
            [obstacle.distance_sigma_m, obstacle.closing_m_s, obstacle.time_to_collision_s, obstacle.score];
        if places.iter().any(|v| !v.is_finite()) || rest.iter().any(|v| v.is_nan()) {
            return Err(MessageError::Value {
                what: "measure of an obstacle",
                value: obstacle.distance_m.to_bits(),
            });
        }
    }
    Ok(Obstacles { alarm, obstacles })
}

/// Keeps a reader of `obstacles` to what holds: messages of two senders may reach it in any order,
/// and a late comer gets the last one of each.
#[derive(Clone, Copy, Debug, Default)]
pub struct Newest {
    issued_ns: u64,
}

impl Newest {
    /// Whether a message was issued after all that were accepted so far. One that was not is out of
    /// date and to be passed over.
    pub fn accepts(&mut self, header: &Header) -> bool {
        let newer = header.issued_ns >= self.issued_ns;
        if newer {
            self.issued_ns = header.issued_ns;
        }
        newer
    }
}

/// The message in types.
#[derive(Clone, Copy, Debug)]
pub struct ObstaclesMessage;

impl Message for ObstaclesMessage {
    const KIND: Kind = Kind::Obstacles;
    type View<'a> = Obstacles<'a>;

    fn view<'a>(header: &Header, payload: &'a [u8]) -> Result<Self::View<'a>, MessageError> {
        view(header, payload)
    }

    fn max_payload_bytes(_: usize, _: usize) -> usize {
        payload_bytes(MAX_COUNT)
    }
}

impl Output<'_, ObstaclesMessage> {
    /// Writes the message.
    ///
    /// # Errors
    /// When the payload is too short, or there are too many obstacles.
    pub fn write(self, alarm: AlarmRecord, obstacles: &[ObstacleRecord]) -> Result<Written, MessageError> {
        write(self.payload, alarm, obstacles).map(Written)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_was_issued_last_holds_in_whatever_order_it_comes() {
        let at = |issued_ns| Header { issued_ns, ..Header::new(Kind::Obstacles) };
        let mut newest = Newest::default();
        let accepted = [5, 9, 7, 9, 10].map(|ns| newest.accepts(&at(ns)));
        assert_eq!(accepted, [true, true, false, true, true]);
    }

    #[test]
    fn what_is_written_is_read_and_anything_else_refused() {
        let header = Header { width: 100, height: 80, ..Header::new(Kind::Obstacles) };
        let obstacle = ObstacleRecord { track: 3, bounds: [10, 10, 20, 20], ..ObstacleRecord::default() };
        let mut memory = vec![0_u64; payload_bytes(2) / 8];
        let payload: &mut [u8] = bytemuck::cast_slice_mut(&mut memory);
        write(payload, AlarmRecord { level: 2, ..AlarmRecord::default() }, &[obstacle, obstacle]).unwrap();
        let got = view(&header, payload).unwrap();
        assert_eq!((got.alarm.level, got.obstacles), (2, &[obstacle, obstacle][..]));
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
