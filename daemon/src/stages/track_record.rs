//! A tracked obstacle between its record in the message `regions` and the type of the algorithms.

use messages::track::TrackRecord;
use perception::outline::Outline;
use perception::region::PixelBox;
use perception::rig::Rig;
use perception::tracking::Obstacle;
use perception::tracking::filter::TimeToCollision;
use perception::tracking::filter::ground::{GroundMotion, Movement};

/// The record of an obstacle, without crop.
pub fn record(obstacle: &Obstacle, rig: &Rig) -> TrackRecord {
    let PixelBox { x, y, width, height } = obstacle.bounds;
    let ground = obstacle.ground;
    TrackRecord {
        track: obstacle.track,
        confirmed: u32::from(obstacle.is_confirmed),
        seen: obstacle.seen,
        missed: obstacle.missed,
        consecutive_frames: obstacle.consecutive_frames,
        over_ground: u32::from(ground.is_some()),
        moving: ground.map_or(Movement::Unknown, |g| g.movement) as u32,
        crop_offset: 0,
        bounds: [x, y, width, height],
        crop: [0; 4],
        probability: obstacle.probability,
        unseen_s: obstacle.unseen_s,
        width_jitter: obstacle.width_jitter,
        disparity_px: rig.disparity_px(obstacle.distance_m),
        distance_m: obstacle.distance_m,
        distance_sigma_m: obstacle.distance_sigma_m,
        lateral_m: obstacle.lateral_m,
        lateral_sigma_m: ground.map_or(0.0, |g| g.place_sigma_m[0]),
        width_m: obstacle.width_m,
        face_inset_m: obstacle.outline.face_inset_m,
        end_depth_m: obstacle.outline.end_depth_m,
        end_excess_m: obstacle.outline.end_excess_m,
        height_m: obstacle.height_m,
        before_wall_m: obstacle.before_wall_m.unwrap_or(f64::INFINITY),
        across_m_s: obstacle.lateral_speed_m_s,
        across_sigma_m_s: obstacle.lateral_speed_sigma_m_s,
        along_m_s: ground.map_or(0.0, |g| g.speed_m_s[1]),
        along_sigma_m_s: ground.map_or(0.0, |g| g.speed_sigma_m_s[1]),
        correlations: ground.map_or([0.0; 6], |g| g.correlations),
        closing_m_s: obstacle.closing_m_s,
        closing_sigma_m_s: obstacle.closing_sigma_m_s,
        time_to_collision_s: obstacle.time_to_collision.map_or(f64::INFINITY, |t| t.seconds),
        time_to_collision_sigma_s: obstacle.time_to_collision.map_or(0.0, |t| t.sigma_s),
    }
    .limited()
}

/// The obstacle of a record.
pub fn obstacle(record: &TrackRecord) -> Obstacle {
    let [x, y, width, height] = record.bounds;
    let movement = match record.moving {
        1 => Movement::Standing,
        2 => Movement::Moving,
        _ => Movement::Unknown,
    };
    let across_m_s = if movement == Movement::Standing { 0.0 } else { record.across_m_s };
    let (seconds, sigma_s) = (record.time_to_collision_s, record.time_to_collision_sigma_s);
    let (face_inset_m, end_depth_m, end_excess_m) =
        (record.face_inset_m, record.end_depth_m, record.end_excess_m);
    let mut outline = Outline { face_inset_m, end_depth_m, end_excess_m };
    outline.limit(record.width_m);
    Obstacle {
        track: record.track,
        probability: record.probability,
        is_confirmed: record.confirmed == 1,
        seen: record.seen,
        missed: record.missed,
        consecutive_frames: record.consecutive_frames,
        unseen_s: record.unseen_s,
        width_jitter: record.width_jitter,
        bounds: PixelBox { x, y, width, height },
        distance_m: record.distance_m,
        distance_sigma_m: record.distance_sigma_m,
        lateral_m: record.lateral_m,
        lateral_speed_m_s: record.across_m_s,
        lateral_speed_sigma_m_s: record.across_sigma_m_s,
        width_m: record.width_m,
        outline,
        height_m: record.height_m,
        before_wall_m: Some(record.before_wall_m).filter(|m| m.is_finite()),
        closing_m_s: record.closing_m_s,
        closing_sigma_m_s: record.closing_sigma_m_s,
        time_to_collision: seconds.is_finite().then_some(TimeToCollision { seconds, sigma_s }),
        ground: (record.over_ground == 1).then_some(GroundMotion {
            speed_m_s: [across_m_s, record.along_m_s],
            speed_sigma_m_s: [record.across_sigma_m_s, record.along_sigma_m_s],
            place_sigma_m: [record.lateral_sigma_m, record.distance_sigma_m],
            correlations: record.correlations,
            movement,
        }),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_the_road_stage_writes_the_alarm_reads() {
        let rig = Rig { focal_px: 879.0, baseline_m: 0.12, cx_px: 320.0, cy_px: 240.0 };
        let relative = Obstacle {
            track: 7,
            probability: 0.93,
            is_confirmed: true,
            seen: 12,
            missed: 2,
            consecutive_frames: 0,
            unseen_s: 0.16,
            width_jitter: 0.1,
            bounds: PixelBox { x: 3, y: 4, width: 5, height: 6 },
            distance_m: 20.5,
            distance_sigma_m: 0.4,
            lateral_m: -1.5,
            lateral_speed_m_s: 0.7,
            lateral_speed_sigma_m_s: 0.2,
            width_m: 1.8,
            outline: Outline { face_inset_m: [0.2, 0.4], end_depth_m: [1.5, 2.5], end_excess_m: [0.0, 0.3] },
            height_m: 1.4,
            before_wall_m: Some(1.5),
            closing_m_s: 9.0,
            closing_sigma_m_s: 0.6,
            time_to_collision: Some(TimeToCollision { seconds: 2.3, sigma_s: 0.2 }),
            ground: None,
        };
        let ground = |movement, speed_m_s| {
            let correlations = [0.9, -0.2, 0.0, 0.3, 1.0, -0.8];
            let (speed_sigma_m_s, place_sigma_m) = ([0.2, 0.5], [0.1, 0.4]);
            Some(GroundMotion { speed_m_s, speed_sigma_m_s, place_sigma_m, correlations, movement })
        };
        for obstacle_before in [
            relative,
            Obstacle { time_to_collision: None, before_wall_m: None, ..relative },
            Obstacle { ground: ground(Movement::Moving, [0.7, -2.0]), ..relative },
            Obstacle { ground: ground(Movement::Standing, [0.0, 0.0]), ..relative },
        ] {
            let record = record(&obstacle_before, &rig);
            assert_eq!(obstacle(&record), obstacle_before);
            assert!((record.disparity_px - rig.disparity_px(20.5)).abs() < 1e-9);
        }
    }
}
