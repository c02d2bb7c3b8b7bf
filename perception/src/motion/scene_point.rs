//! A point of the scene that odometry has found again.

/// A point that was found again in a frame whose motion is known.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ScenePoint {
    /// Column and row in the left image, in px.
    pub at_px: [f64; 2],
    /// Distance along the camera's axis if it is static, in metres.
    pub distance_m: f64,
    /// Whether it is static: an inlier of the own motion. Else it moves, or was matched wrongly.
    pub is_static: bool,
}
