//! The one place that turns messages of the daemon into values of frames.

use messages::alarm::OFF;
use messages::header::{Header, get_text};
use messages::motion::{MotionRecord, health};
use messages::obstacles::{AlarmRecord, ObstacleRecord, Obstacles};
use messages::status::StatusRecord;
use tools::can_out::layout::{CLASSES, OTHER};
use tools::can_out::{DaemonState, Existence, Object, Own, PathAhead, ResultValues};

/// Maximum difference between the distance of the nearest obstacle in the path as the alarm tells it and as the obstacle
/// itself does, in metres: rounding.
const SAME_DISTANCE_M: f64 = 0.01;

/// The state that a status tells.
#[cfg(feature = "can")]
pub fn daemon_state(status: &StatusRecord) -> DaemonState {
    match status.state {
        0 => DaemonState::Starting,
        1 => DaemonState::Running,
        2 => DaemonState::Degraded,
        _ => DaemonState::Stopping,
    }
}

/// The values of a result.
pub fn result_values(header: &Header, message: &Obstacles) -> ResultValues {
    let alarm = &message.alarm;
    let objects: Vec<Object> = message.obstacles.iter().map(object).collect();
    ResultValues {
        sequence: header.sequence,
        capture_ns: header.capture_ns,
        level: alarm.level,
        rule: alarm.rule,
        faults: alarm.faults,
        is_road_seen: alarm.road_seen == 1,
        path: path(alarm, &objects),
        own: own(&header.motion),
        nearest: nearest(alarm, &objects),
        objects,
    }
}

/// What the alarm counts as the nearest obstacle in the path; `None` if there is none, or it cannot judge.
fn nearest(alarm: &AlarmRecord, objects: &[Object]) -> Option<Object> {
    if alarm.level == OFF || !alarm.nearest_m.is_finite() {
        return None;
    }
    let away = |o: &Object| (o.distance_m.unwrap_or(f64::INFINITY) - alarm.nearest_m).abs();
    let confirmed = objects.iter().filter(|o| o.existence != Existence::Tentative);
    let same = confirmed.min_by(|a, b| {
        // Of two at one distance the one in the path.
        let key = |o: &Object| (away(o), o.in_path != Some(true));
        key(a).partial_cmp(&key(b)).unwrap_or(std::cmp::Ordering::Equal)
    });
    // An obstacle beyond the capacity of the message is known by its distance only.
    let unknown =
        Object { existence: Existence::Measured, distance_m: Some(alarm.nearest_m), ..Object::default() };
    Some(same.filter(|o| away(o) < SAME_DISTANCE_M).copied().unwrap_or(unknown))
}

fn path(alarm: &AlarmRecord, objects: &[Object]) -> PathAhead {
    let in_path =
        objects.iter().filter(|o| o.in_path == Some(true) && o.existence != Existence::Tentative).count();
    let known = |value: f64| (alarm.path_known == 1).then_some(value);
    PathAhead {
        is_known: alarm.path_known == 1,
        free_m: (alarm.level != OFF).then(|| (alarm.nearest_m - alarm.path_front_m).max(0.0)),
        curvature_per_m: known(alarm.path_curvature_per_m),
        curvature_sigma_per_m: known(alarm.path_curvature_sigma_per_m),
        half_width_m: (alarm.path_half_width_m > 0.0).then_some(alarm.path_half_width_m),
        objects: objects.len() as u32,
        objects_in_path: in_path as u32,
    }
}

fn own(motion: &MotionRecord) -> Own {
    let is_known = motion.is_known();
    let known = |value: f64| is_known.then_some(value);
    Own {
        is_known,
        is_standing: is_known && motion.has(health::STANDSTILL),
        disagrees: is_known && motion.has(health::DISAGREE),
        speed_m_s: known(motion.speed_m_s),
        speed_sigma_m_s: known(motion.speed_sigma_m_s),
        yaw_rate_rad_s: known(motion.yaw_rate_rad_s),
        yaw_rate_sigma_rad_s: known(motion.yaw_rate_sigma_rad_s),
    }
}

fn object(o: &ObstacleRecord) -> Object {
    // As in obstacles.jsonl: a single sighting tells no speed.
    let moved = |value: f64| (o.seen > 1).then_some(value);
    Object {
        existence: match (o.confirmed, o.missed) {
            (0, _) => Existence::Tentative,
            (_, 0) => Existence::Measured,
            _ => Existence::Predicted,
        },
        track: o.track,
        distance_m: Some(o.distance_m),
        distance_sigma_m: Some(o.distance_sigma_m),
        lateral_m: Some(o.lateral_m),
        closing_m_s: moved(o.closing_m_s),
        across_m_s: moved(o.across_m_s),
        time_to_collision_s: Some(o.time_to_collision_s),
        width_m: Some(o.width_m),
        height_m: Some(o.height_m),
        class: Some(class(&get_text(&o.class))),
        in_path: Some(o.in_path == 1),
        moving: Some(o.moving),
    }
}

/// Number of a class by its name; that of `other` for a name that the layout does not have.
fn class(name: &str) -> u32 {
    let number = |name: &str| CLASSES.iter().position(|class| *class == name);
    number(name).or_else(|| number(OTHER)).unwrap_or(0) as u32
}

#[cfg(test)]
mod tests {
    use super::*;
    use messages::alarm::{self, Faults, LEVELS, MOVING, RULES};
    use messages::header::{Kind, put_text};
    use messages::obstacles;
    use tools::can_out::layout;

    /// The layout has names of its own, because it has a version of its own.
    #[test]
    fn the_numbers_of_the_layout_are_those_of_the_messages() {
        assert_eq!((layout::LEVELS, layout::RULES), (&LEVELS[..], &RULES[..]));
        assert_eq!((layout::MOVING, layout::SOURCES), (&MOVING[..], &StatusRecord::SOURCES[..]));
        assert_eq!(layout::DAEMON_STATES[..4], StatusRecord::STATES);
        assert_eq!((layout::DAEMON_STATES.len(), DaemonState::NotRunning as usize), (5, 4));
        assert_eq!(layout::EXISTENCE[Existence::Predicted as usize], "predicted");
        // The frame is full: what was added since is told by `FaultOther`.
        assert_eq!(Faults::ALL.0 >> layout::FAULTS.len(), Faults::FROZEN.0 >> layout::FAULTS.len());
        for (fault, name) in [
            (Faults::NO_ROAD, "NoRoad"),
            (Faults::OLD, "Old"),
            (Faults::TIME, "SourceTime"),
            (Faults::PAIRING, "Pairing"),
        ] {
            assert_eq!(layout::FAULTS[fault.0.trailing_zeros() as usize], name);
        }
        let own = [tools::can_out::STAGE_FAULT, tools::can_out::STALE_FAULT];
        assert_eq!(own, [Faults::STAGE.0, Faults::STALE.0]);
    }

    fn record(track: u32, distance_m: f64) -> ObstacleRecord {
        let mut class = [0; 16];
        put_text(&mut class, "vehicle");
        ObstacleRecord {
            track,
            confirmed: 1,
            seen: 5,
            distance_m,
            lateral_m: 0.5,
            closing_m_s: 3.0,
            time_to_collision_s: distance_m / 3.0,
            in_path: 1,
            bounds: [1, 1, 2, 2],
            class,
            ..ObstacleRecord::default()
        }
    }

    fn values(alarm: AlarmRecord, records: &[ObstacleRecord]) -> ResultValues {
        let mut memory = vec![0_u64; obstacles::payload_bytes(records.len()) / 8];
        let payload: &mut [u8] = bytemuck::cast_slice_mut(&mut memory);
        obstacles::write(payload, alarm, records).unwrap();
        let mut header = Header::new(Kind::Obstacles);
        (header.width, header.height, header.sequence) = (64, 48, 5);
        result_values(&header, &obstacles::view(&header, payload).unwrap())
    }

    #[test]
    fn the_nearest_obstacle_is_the_one_that_the_alarm_counts() {
        let alarm = AlarmRecord {
            level: alarm::ALARM,
            rule: 1,
            nearest_m: 12.0,
            time_to_collision_s: f64::INFINITY,
            path_front_m: 1.7,
            path_half_width_m: 0.9,
            ..AlarmRecord::default()
        };
        let beside = ObstacleRecord { in_path: 0, ..record(1, 12.0) };
        let tentative = ObstacleRecord { confirmed: 0, ..record(2, 12.0) };
        let all = [beside, tentative, record(3, 12.0), record(4, 30.0)];
        let got = values(alarm, &all);
        assert_eq!(got.nearest.unwrap().track, 3);
        assert_eq!((got.path.free_m, got.path.objects, got.path.objects_in_path), (Some(10.3), 4, 2));
        assert_eq!((got.nearest.unwrap().class, got.objects.len()), (Some(1), 4));
        // The one that raised the alarm is held in the path a little beyond its edge.
        assert_eq!(values(alarm, &[beside, record(4, 30.0)]).nearest.unwrap().track, 1);
        let unknown = values(alarm, &[record(4, 30.0)]).nearest.unwrap();
        assert_eq!((unknown.track, unknown.distance_m), (0, Some(12.0)));
        let free = AlarmRecord { nearest_m: f64::INFINITY, ..alarm };
        let got = values(free, &all);
        assert_eq!((got.nearest, got.path.free_m), (None, Some(f64::INFINITY)));
        // The front of a long bonnet touches what is still before the camera.
        let touching = AlarmRecord { nearest_m: 1.0, ..alarm };
        assert_eq!(values(touching, &[]).path.free_m, Some(0.0));
        let off = AlarmRecord { level: OFF, faults: 1, ..alarm };
        let got = values(off, &all);
        assert_eq!((got.nearest, got.path.free_m, got.objects.len()), (None, None, 4));
    }

    #[test]
    fn unknown_values_are_absent() {
        let alarm = AlarmRecord { nearest_m: f64::INFINITY, ..AlarmRecord::default() };
        let mut person = [0; 16];
        put_text(&mut person, "unicorn");
        let new = ObstacleRecord { seen: 1, class: person, missed: 1, ..record(1, 9.0) };
        let got = values(alarm, &[new]);
        let object = got.objects[0];
        assert_eq!((object.closing_m_s, object.across_m_s), (None, None));
        assert_eq!((object.existence, object.class), (Existence::Predicted, Some(3)));
        assert_eq!((got.own, got.path.curvature_per_m, got.path.half_width_m), (Own::default(), None, None));
    }
}
