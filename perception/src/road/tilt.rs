//! Lateral tilt of the road.

/// Lateral tilt of the road: the difference of its disparity from the profile, as a function of the column.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Tilt {
    /// Disparity per column to the right, in px per px.
    pub roll: f64,
    /// Difference to the profile at the principal column, in px.
    pub offset_px: f64,
    /// The principal column.
    pub cx_px: f64,
}

impl Tilt {
    /// Disparity with the tilt removed: comparable with the profile at any column.
    pub fn levelled_px(&self, x_px: f64, disparity_px: f64) -> f64 {
        disparity_px - self.roll * (x_px - self.cx_px) - self.offset_px
    }
}
