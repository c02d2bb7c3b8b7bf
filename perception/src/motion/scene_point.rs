//! A point of the scene that odometry has found again.

/// A point that was found again in a frame whose motion is known.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ScenePoint {
    /// Column and row in the left image, in px.
    pub at_px: [f64; 2],
    /// Distance along the camera's axis if it stands, in metres.
    pub distance_m: f64,
    /// Whether its place agrees with the own motion: it stands. Else it moves, or was mistaken for another one.
    pub stands: bool,
}
