//! The vehicle's own motion between its record in the header and the type of the algorithms.

use config::Config;
use messages::motion::{MotionRecord, health};
use perception::motion::Motion;
use perception::motion::body::Body;

/// The vehicle's body.
pub fn body(config: &Config) -> Body {
    let c = &config.vehicle;
    Body {
        width_m: c.width_m,
        front_m: c.front_m,
        camera_right_m: c.camera_right_m,
        rear_axle_m: c.rear_axle_m,
        // Learned from the motion.
        camera_yaw_rad: 0.0,
    }
}

/// The motion of a header; `None` if it is unknown.
pub fn motion(record: &MotionRecord) -> Option<Motion> {
    record.is_known().then_some(Motion {
        speed_m_s: record.speed_m_s,
        speed_sigma_m_s: record.speed_sigma_m_s,
        acceleration_m_s2: record.acceleration_m_s2,
        acceleration_sigma_m_s2: record.acceleration_sigma_m_s2,
        yaw_rate_rad_s: record.yaw_rate_rad_s,
        yaw_rate_sigma_rad_s: record.yaw_rate_sigma_rad_s,
        yaw_acceleration_rad_s2: record.yaw_acceleration_rad_s2,
        camera_yaw_rad: record.camera_yaw_rad,
    })
}

/// The record of a known motion, without pose.
pub fn motion_record(motion: &Motion) -> MotionRecord {
    MotionRecord {
        speed_m_s: motion.speed_m_s,
        speed_sigma_m_s: motion.speed_sigma_m_s,
        acceleration_m_s2: motion.acceleration_m_s2,
        acceleration_sigma_m_s2: motion.acceleration_sigma_m_s2,
        yaw_rate_rad_s: motion.yaw_rate_rad_s,
        yaw_rate_sigma_rad_s: motion.yaw_rate_sigma_rad_s,
        yaw_acceleration_rad_s2: motion.yaw_acceleration_rad_s2,
        camera_yaw_rad: motion.camera_yaw_rad,
        health: health::KNOWN,
        ..MotionRecord::default()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_default_configuration_matches_the_default_body() {
        assert_eq!(body(&Config::default()), Body::default());
    }

    #[test]
    fn a_known_motion_returns_from_its_record_and_an_unknown_one_does_not() {
        let known = Motion {
            speed_m_s: 8.0,
            speed_sigma_m_s: 0.1,
            acceleration_m_s2: -1.0,
            acceleration_sigma_m_s2: 0.3,
            yaw_rate_rad_s: 0.2,
            yaw_rate_sigma_rad_s: 0.005,
            yaw_acceleration_rad_s2: 0.3,
            camera_yaw_rad: 0.01,
        };
        assert_eq!(motion(&motion_record(&known)), Some(known));
        assert_eq!(motion(&MotionRecord { health: health::ODOMETRY, ..motion_record(&known) }), None);
        assert_eq!(motion(&MotionRecord::default()), None);
    }
}
