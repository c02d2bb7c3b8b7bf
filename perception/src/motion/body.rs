//! The vehicle's body around its camera.

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
}

/// How far the point about which a vehicle turns lies ahead of its rear axle, per squared speed, in s²/m: the rear tyres
/// slip as they carry the lateral force (mass × distance of the front axle ÷ cornering stiffness of the rear axle × wheelbase;
/// 0.006 to 0.012 for passenger cars, 0.010 on the drive that chose it).
const SLIP_S2_PER_M: f64 = 0.01;

impl Body {
    /// The body about the point about which it turns at a speed: the rear axle at walking pace, a point ahead of it at
    /// speed, at most beside the camera.
    #[must_use]
    pub fn at_speed(&self, speed_m_s: f64) -> Self {
        let slip_m = SLIP_S2_PER_M * speed_m_s * speed_m_s;
        Self { rear_axle_m: (self.rear_axle_m - slip_m).max(self.rear_axle_m.min(0.0)), ..*self }
    }
}

impl Default for Body {
    fn default() -> Self {
        Self { width_m: 1.8, front_m: 1.7, camera_right_m: 0.0, rear_axle_m: 1.6 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn at_speed_the_vehicle_turns_about_a_point_ahead_of_its_rear_axle() {
        let body = Body::default();
        assert_eq!(body.at_speed(0.0), body);
        assert!((body.at_speed(10.0).rear_axle_m - 0.6).abs() < 1e-9);
        assert_eq!(body.at_speed(40.0).rear_axle_m, 0.0);
        // A camera behind the rear axle stays there.
        let behind = Body { rear_axle_m: -1.0, ..body };
        assert_eq!(behind.at_speed(20.0), behind);
    }
}
