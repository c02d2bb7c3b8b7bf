//! The third state of a filter, an acceleration, and what it does to the time in which a distance is closed.

/// The third state. Without a manoeuvre everything is 0, and the filter is one of constant speed.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Acceleration {
    /// In m/s², along the axis of the filter.
    pub value: f64,
    /// Covariance with position and speed, and variance.
    pub p: [f64; 3],
    /// Time since it was found, in seconds.
    pub seconds: f64,
}

impl Acceleration {
    pub fn is_estimated(&self) -> bool {
        self.p[2] > 0.0
    }

    pub fn sigma(&self) -> f64 {
        self.p[2].max(0.0).sqrt()
    }
}

/// Seconds in which a distance is closed at this speed, which grows by `braking` m/s².
pub fn braking_seconds(distance_m: f64, closing_m_s: f64, braking_m_s2: f64) -> f64 {
    let root = (closing_m_s * closing_m_s + 2.0 * braking_m_s2.max(0.0) * distance_m).sqrt();
    // The form without the difference of two large numbers.
    2.0 * distance_m / (closing_m_s + root).max(1e-6)
}
