//! Own motion of the vehicle: how it is measured, and what is known of it.
//!
//! Axes of the vehicle are those of ISO 8855: speed forwards, yaw to the left positive. Axes of the camera are those of
//! the image: x right, y down, z forward.

pub mod body;
pub mod camera_motion;
pub mod corners;
pub mod curvature;
pub mod filter;
pub mod odometry;
pub mod patch;
pub mod path;
pub mod planar;
pub mod pose;
pub mod pyramid;
pub mod scene_point;
pub mod vehicle;

/// The vehicle's own motion at the time of a frame, in the plane of the road.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Motion {
    /// Speed, in m/s, forwards positive.
    pub speed_m_s: f64,
    /// Standard deviation of the speed, in m/s.
    pub speed_sigma_m_s: f64,
    /// Acceleration, in m/s², positive when the speed increases.
    pub acceleration_m_s2: f64,
    /// Standard deviation of the acceleration, in m/s².
    pub acceleration_sigma_m_s2: f64,
    /// Yaw rate, in rad/s, to the left positive.
    pub yaw_rate_rad_s: f64,
    /// Standard deviation of the yaw rate, in rad/s.
    pub yaw_rate_sigma_rad_s: f64,
    /// Yaw acceleration, in rad/s², to the left positive.
    pub yaw_acceleration_rad_s2: f64,
    /// Yaw of the camera in the vehicle, in rad, to the left positive, as odometry has found it; 0 until then.
    pub camera_yaw_rad: f64,
}

impl Motion {
    /// Whether all its numbers are finite: with another one nothing can be predicted.
    pub fn is_finite(&self) -> bool {
        [
            self.speed_m_s,
            self.speed_sigma_m_s,
            self.acceleration_m_s2,
            self.acceleration_sigma_m_s2,
            self.yaw_rate_rad_s,
            self.yaw_rate_sigma_rad_s,
            self.yaw_acceleration_rad_s2,
            self.camera_yaw_rad,
        ]
        .iter()
        .all(|v| v.is_finite())
    }
}
