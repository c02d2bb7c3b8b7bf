//! The vehicle's body around its camera.

use super::Motion;

/// A place or a velocity in the plane of the road: to the right and forward, in metres or m/s.
pub type Planar = [f64; 2];

/// Where the camera is in the vehicle, and how large the body is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Body {
    /// Width with mirrors, in metres.
    pub width_m: f64,
    /// Distance from the left camera forward to the front, in metres.
    pub front_m: f64,
    /// Position of the left camera to the right of the vehicle's centre line, in metres.
    pub camera_right_m: f64,
    /// Distance from the left camera back to the rear axle, about which the vehicle turns, in metres.
    pub rear_axle_m: f64,
    /// Yaw of the camera in the vehicle, in rad, to the left positive.
    pub camera_yaw_rad: f64,
}

/// How far the point about which a vehicle turns lies ahead of its rear axle, per squared speed, in s²/m: the rear tyres
/// slip as they carry the lateral force (mass × distance of the front axle ÷ cornering stiffness of the rear axle × wheelbase;
/// 0.006 to 0.012 for passenger cars, 0.010 on the drive that chose it).
const SLIP_S2_PER_M: f64 = 0.01;

impl Body {
    /// The body during a motion: about the point about which it turns, which is the rear axle at walking pace, a point ahead
    /// of it at speed, at most beside the camera; with the yaw of the camera that the motion has shown.
    #[must_use]
    pub fn during(&self, motion: &Motion) -> Self {
        let slip_m = SLIP_S2_PER_M * motion.speed_m_s * motion.speed_m_s;
        let rear_axle_m = (self.rear_axle_m - slip_m).max(self.rear_axle_m.min(0.0));
        Self { rear_axle_m, camera_yaw_rad: motion.camera_yaw_rad, ..*self }
    }

    /// A place or a direction in the camera's axes in those of the vehicle, both with the same origin.
    pub fn turn_to_vehicle(&self, [right, ahead]: Planar) -> Planar {
        let (sine, cosine) = self.camera_yaw_rad.sin_cos();
        [cosine * right - sine * ahead, sine * right + cosine * ahead]
    }

    /// A place or a direction in the vehicle's axes in those of the camera, both with the same origin.
    pub fn turn_to_camera(&self, [right, ahead]: Planar) -> Planar {
        let (sine, cosine) = self.camera_yaw_rad.sin_cos();
        [cosine * right + sine * ahead, cosine * ahead - sine * right]
    }
}

impl Default for Body {
    fn default() -> Self {
        Self { width_m: 1.8, front_m: 1.7, camera_right_m: 0.0, rear_axle_m: 1.6, camera_yaw_rad: 0.0 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn at_speed_the_vehicle_turns_about_a_point_ahead_of_its_rear_axle() {
        let body = Body::default();
        let at = |speed_m_s| Motion { speed_m_s, ..Motion::default() };
        assert_eq!(body.during(&at(0.0)), body);
        assert!((body.during(&at(10.0)).rear_axle_m - 0.6).abs() < 1e-9);
        assert_eq!(body.during(&at(40.0)).rear_axle_m, 0.0);
        // A camera behind the rear axle stays there.
        let behind = Body { rear_axle_m: -1.0, ..body };
        assert_eq!(behind.during(&at(20.0)), behind);
    }

    #[test]
    fn a_camera_that_looks_to_the_left_sees_the_way_ahead_on_its_right() {
        let body = Body { camera_yaw_rad: 0.1, ..Body::default() };
        let seen = body.turn_to_camera([0.0, 10.0]);
        assert!((seen[0] - 0.998).abs() < 1e-3, "{seen:?}");
        let back = body.turn_to_vehicle(seen);
        assert!(back[0].abs() < 1e-12 && (back[1] - 10.0).abs() < 1e-12, "{back:?}");
    }
}
