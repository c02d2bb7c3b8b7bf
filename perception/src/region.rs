//! A box in the image, and an obstacle region: what detection gives and tracking takes.

use crate::rig::Rig;

/// A box in the image, in pixels.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct PixelBox {
    /// Left column.
    pub x: u32,
    /// Top row.
    pub y: u32,
    /// Width.
    pub width: u32,
    /// Height.
    pub height: u32,
}

impl PixelBox {
    /// Shared area ÷ joint area, 0 to 1.
    pub fn overlap(&self, other: &PixelBox) -> f64 {
        let span =
            |a: u32, al: u32, b: u32, bl: u32| f64::from((a + al).min(b + bl).saturating_sub(a.max(b)));
        let shared =
            span(self.x, self.width, other.x, other.width) * span(self.y, self.height, other.y, other.height);
        let area = |b: &PixelBox| f64::from(b.width) * f64::from(b.height);
        let joint = area(self) + area(other) - shared;
        if joint > 0.0 { shared / joint } else { 0.0 }
    }
}

/// Something that stands on the road, or beside it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Region {
    /// Where it is in the left image.
    pub bounds: PixelBox,
    /// Disparity of its near side, in pixels.
    pub disparity_px: f64,
    /// One standard deviation of that, in pixels.
    pub disparity_sigma_px: f64,
    /// Distance of its near side along z, in metres.
    pub distance_m: f64,
    /// Middle of the box, metres right of the camera axis.
    pub lateral_m: f64,
    /// Width of the box at that distance, in metres.
    pub width_m: f64,
    /// Height of its top above the road, in metres.
    pub height_m: f64,
    /// Obstacle pixels.
    pub pixels: u32,
    /// Mean confidence of these, 0 to 1.
    pub confidence: f64,
}

impl Region {
    /// Moves the sides of its box to column `first` and the one before `end`.
    pub(crate) fn set_sides(&mut self, (first, end): (u32, u32), rig: &Rig) {
        (self.bounds.x, self.bounds.width) = (first, end - first);
        self.width_m = f64::from(self.bounds.width) * self.distance_m / rig.focal_px;
        self.lateral_m = rig.lateral_m(0.5 * f64::from(first + end), self.distance_m);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn boxes_overlap_by_their_shared_part() {
        let a = PixelBox { x: 0, y: 0, width: 10, height: 10 };
        let b = PixelBox { x: 5, y: 0, width: 10, height: 10 };
        assert!((a.overlap(&b) - 50.0 / 150.0).abs() < 1e-12);
        assert_eq!(a.overlap(&PixelBox { x: 20, ..a }), 0.0);
        assert_eq!(PixelBox::default().overlap(&PixelBox::default()), 0.0);
    }
}
