//! Converts an `obstacles` message to the record that is written as JSON and drawn on overlays.

use messages::alarm::{Faults, level_name, rule_name};
use messages::header::{Header, get_text};
use messages::motion::{MotionRecord, health};
use messages::obstacles::{AlarmRecord, Obstacles};
use perception::motion::body::Body;
use perception::motion::path::{EdgesAhead, SweptPath};
use tools::reporting::motion::MotionLine;
use tools::reporting::path::PathLine;
use tools::reporting::record::{AlarmLine, FrameRecord, ObstacleLine, RoadLine, tidy, tidy_finite};

/// The record of a frame. Values that the message marks as absent become `None`.
pub fn frame_record(header: &Header, message: &Obstacles) -> FrameRecord {
    let alarm = &message.alarm;
    FrameRecord {
        sequence: header.sequence,
        time_s: tidy(header.source_ns as f64 * 1e-9),
        road: (alarm.road_seen == 1).then(|| RoadLine {
            camera_height_m: tidy(alarm.camera_height_m),
            horizon_px: tidy(alarm.horizon_px),
            confidence: tidy(alarm.confidence),
        }),
        motion: motion_line(&header.motion),
        path: path_line(&header.motion, alarm),
        alarm: AlarmLine {
            level: level_name(alarm.level).into(),
            rule: rule_name(alarm.rule).map(Into::into),
            track: (alarm.track > 0).then_some(alarm.track),
            changed: alarm.changed == 1,
            nearest_m: tidy_finite(alarm.nearest_m),
            time_to_collision_s: tidy_finite(alarm.time_to_collision_s),
            required_deceleration_m_s2: (alarm.track > 0).then(|| tidy(alarm.required_deceleration_m_s2)),
            reason: (alarm.level == messages::alarm::OFF).then(|| Faults(alarm.faults).to_string()),
        },
        obstacles: message
            .obstacles
            .iter()
            .map(|o| ObstacleLine {
                track: o.track,
                class: get_text(&o.class),
                score: (o.score > 0.0).then(|| tidy(o.score)),
                confirmed: o.confirmed == 1,
                missed: o.missed,
                predicted: o.missed > 0,
                probability: tidy(o.probability),
                x_px: o.bounds[0],
                y_px: o.bounds[1],
                width_px: o.bounds[2],
                height_px: o.bounds[3],
                distance_m: tidy(o.distance_m),
                distance_sigma_m: tidy(o.distance_sigma_m),
                lateral_m: tidy(o.lateral_m),
                width_m: tidy(o.width_m),
                height_m: tidy(o.height_m),
                across_m_s: (o.seen > 1).then(|| tidy(o.across_m_s)),
                closing_m_s: (o.seen > 1).then(|| tidy(o.closing_m_s)),
                closing_sigma_m_s: (o.seen > 1).then(|| tidy(o.closing_sigma_m_s)),
                time_to_collision_s: tidy_finite(o.time_to_collision_s),
                time_to_collision_sigma_s: (o.time_to_collision_sigma_s > 0.0)
                    .then(|| tidy(o.time_to_collision_sigma_s)),
                in_path: o.in_path == 1,
            })
            .collect(),
    }
}

/// The path of an alarm; without edges if the message tells no width.
fn path_line(motion: &MotionRecord, alarm: &AlarmRecord) -> PathLine {
    let known = alarm.path_known == 1;
    if alarm.path_half_width_m <= 0.0 {
        return PathLine { known, ..PathLine::default() };
    }
    let edges =
        EdgesAhead { from_m: alarm.path_edges_from_m, curvature_per_m: alarm.path_edges_curvature_per_m };
    let path = SweptPath {
        curvature_per_m: alarm.path_curvature_per_m,
        curvature_sigma_per_m: alarm.path_curvature_sigma_per_m,
        speed_m_s: motion.speed_m_s,
        speed_sigma_m_s: motion.speed_sigma_m_s,
        body: Body {
            width_m: 2.0 * alarm.path_half_width_m,
            front_m: alarm.path_front_m,
            camera_right_m: alarm.path_camera_right_m,
            rear_axle_m: alarm.path_rear_axle_m,
            camera_yaw_rad: alarm.path_camera_yaw_rad,
        },
        edges: (edges.from_m > 0.0).then_some(edges),
        is_turning_in: false,
    };
    PathLine::new(&path, known)
}

/// The motion of a header; without values while it is unknown.
pub fn motion_line(motion: &MotionRecord) -> MotionLine {
    let known = motion.is_known();
    let some = |value: f64| known.then(|| tidy(value));
    MotionLine {
        known,
        sources: motion.sources().map(Into::into).collect(),
        standstill: known && motion.has(health::STANDSTILL),
        disagree: known && motion.has(health::DISAGREE),
        speed_m_s: some(motion.speed_m_s),
        speed_sigma_m_s: some(motion.speed_sigma_m_s),
        acceleration_m_s2: some(motion.acceleration_m_s2),
        acceleration_sigma_m_s2: some(motion.acceleration_sigma_m_s2),
        yaw_rate_rad_s: some(motion.yaw_rate_rad_s),
        yaw_rate_sigma_rad_s: some(motion.yaw_rate_sigma_rad_s),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use messages::header::Kind;
    use messages::obstacles;

    #[test]
    fn the_motion_of_the_header_reaches_the_line() {
        let mut memory = vec![0_u64; 4096];
        let payload: &mut [u8] = bytemuck::cast_slice_mut(&mut memory);
        let alarm = AlarmRecord {
            nearest_m: f64::INFINITY,
            time_to_collision_s: f64::INFINITY,
            ..AlarmRecord::default()
        };
        let bytes = obstacles::write(payload, alarm, &[]).unwrap();
        let mut header = Header::new(Kind::Obstacles);
        (header.width, header.height) = (64, 48);
        header.motion = MotionRecord { speed_m_s: 8.25, yaw_rate_rad_s: -0.1, ..MotionRecord::default() };
        let line = |header: &Header| {
            let message = obstacles::view(header, &payload[..bytes]).unwrap();
            serde_json::to_value(frame_record(header, &message)).unwrap()["motion"].clone()
        };
        let unknown = line(&header);
        assert_eq!((&unknown["known"], &unknown["speed_m_s"]), (&false.into(), &serde_json::Value::Null));
        header.motion.health = health::KNOWN | health::BUS_SPEED | health::STANDSTILL;
        let known = line(&header);
        assert_eq!((&known["speed_m_s"], &known["yaw_rate_rad_s"]), (&8.25.into(), &(-0.1).into()));
        assert_eq!((&known["sources"][0], &known["standstill"]), (&"bus_speed".into(), &true.into()));
    }

    #[test]
    fn the_path_of_the_alarm_has_edges_where_it_has_a_width() {
        let mut alarm = AlarmRecord { path_known: 1, path_curvature_per_m: -0.02, ..AlarmRecord::default() };
        let motion = MotionRecord { speed_m_s: 8.0, ..MotionRecord::default() };
        assert_eq!(path_line(&motion, &alarm), PathLine { known: true, ..PathLine::default() });
        (alarm.path_half_width_m, alarm.path_front_m, alarm.path_rear_axle_m) = (0.9, 1.7, 1.6);
        let bend = path_line(&motion, &alarm);
        assert_eq!((bend.known, bend.curvature_per_m), (true, Some(-0.02)));
        assert!(bend.left_m[8][0] > 5.0, "to the right: {bend:?}");
        // The road's edges lead straight on.
        alarm.path_edges_from_m = 10.0;
        assert!(path_line(&motion, &alarm).left_m[8][0] < bend.left_m[8][0]);
    }
}
