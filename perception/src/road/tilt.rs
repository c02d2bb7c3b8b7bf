//! How the road lies across the view.

/// How the road lies across: what its disparity adds to the profile.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Tilt {
    /// Disparity that one column to the right adds, px per px.
    pub roll: f64,
    /// Disparity of the road at the principal column, less the profile's, in px.
    pub offset_px: f64,
    /// The principal column.
    pub cx_px: f64,
}

impl Tilt {
    /// The disparity in column `x` as it would be on a level road, where the profile holds.
    pub fn levelled_px(&self, x_px: f64, disparity_px: f64) -> f64 {
        disparity_px - self.roll * (x_px - self.cx_px) - self.offset_px
    }
}
