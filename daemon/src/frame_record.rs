//! Converts an `obstacles` message to the record that is written as JSON and drawn on overlays.

use messages::alarm::{level_name, rule_name};
use messages::header::{Header, get_text};
use messages::motion::{MotionRecord, health};
use messages::obstacles::{AlarmRecord, Obstacles};
use messages::space::{BoundaryRecord, SIDES};
use perception::motion::body::Body;
use perception::motion::path::{EdgesAhead, SweptPath};
use tools::reporting::motion::MotionLine;
use tools::reporting::path::PathLine;
use tools::reporting::record::{
    AlarmLine, AlarmObject, FrameRecord, ObstacleLine, RoadLine, tidy, tidy_finite,
};
use tools::reporting::space::{BoundaryLine, centimetres};

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
        free_space_m: free_space(alarm),
        boundaries: alarm.space.lines().iter().map(boundary_line).collect(),
        alarm: alarm_line(alarm),
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
                clearance_m: tidy_finite(o.clearance_m),
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

/// The line of an alarm.
pub fn alarm_line(alarm: &AlarmRecord) -> AlarmLine {
    AlarmLine {
        level: level_name(alarm.level).into(),
        rule: rule_name(alarm.rule).map(Into::into),
        track: (alarm.track > 0).then_some(alarm.track),
        changed: alarm.changed == 1,
        nearest_m: tidy_finite(alarm.nearest_m),
        time_to_collision_s: tidy_finite(alarm.time_to_collision_s),
        required_deceleration_m_s2: (alarm.track > 0).then(|| tidy(alarm.required_deceleration_m_s2)),
        reason: Some(alarm.reason()),
        object: alarm_object(alarm),
    }
}

/// What an alarm is about.
pub fn alarm_object(alarm: &AlarmRecord) -> Option<AlarmObject> {
    let class = get_text(&alarm.class);
    (alarm.object > 0).then(|| AlarmObject {
        track: alarm.object,
        class: (!class.is_empty()).then_some(class),
        clearance_m: tidy_finite(alarm.clearance_m),
    })
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

/// The polygons of the free space, to centimetres.
fn free_space(alarm: &AlarmRecord) -> Vec<Vec<[f64; 2]>> {
    let mut polygons = alarm.space.polygons();
    for corner in polygons.iter_mut().flatten() {
        *corner = corner.map(centimetres);
    }
    polygons
}

fn boundary_line(record: &BoundaryRecord) -> BoundaryLine {
    let points = record.points();
    BoundaryLine {
        id: record.id,
        side: SIDES.get(record.side as usize).copied().unwrap_or_default().into(),
        points_m: points.iter().map(|p| [p.lateral_m, p.distance_m].map(|m| centimetres(m.into()))).collect(),
        height_m: points.iter().map(|p| centimetres(p.height_m.into())).collect(),
        sigma_m: points.iter().map(|p| centimetres(p.sigma_m.into())).collect(),
    }
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
    fn free_space_and_boundaries_reach_the_line() {
        let mut alarm = AlarmRecord::default();
        let space = &mut alarm.space;
        (space.sectors, space.boundaries, space.left_slope, space.slope_step) = (2, 1, -0.1, 0.1);
        for sector in &mut space.free[..2] {
            (sector.near_m, sector.far_m) = (4.0, 20.004);
        }
        space.lines[0] = BoundaryRecord { id: 7, side: 1, count: 2, ..BoundaryRecord::default() };
        space.lines[0].points[1].lateral_m = 3.5;
        assert_eq!(free_space(&alarm)[0][1..4], [[0.0, 20.0], [2.0, 20.0], [0.4, 4.0]]);
        let line = boundary_line(&alarm.space.lines[0]);
        assert_eq!((line.id, &line.side[..], line.points_m[1][0], line.height_m.len()), (7, "right", 3.5, 2));
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
