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

impl Default for Body {
    fn default() -> Self {
        Self { width_m: 1.8, front_m: 1.7, camera_right_m: 0.0, rear_axle_m: 1.6 }
    }
}
