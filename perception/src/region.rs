//! Pixel boxes and obstacle regions: the output of detection and the input of tracking.

use crate::rig::Rig;

/// An axis-aligned box in an image, in pixels.
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
    /// Area that both cover, in px².
    pub fn shared_area(&self, other: &PixelBox) -> f64 {
        let span =
            |a: u32, al: u32, b: u32, bl: u32| f64::from((a + al).min(b + bl).saturating_sub(a.max(b)));
        span(self.x, self.width, other.x, other.width) * span(self.y, self.height, other.y, other.height)
    }

    /// The smallest box that contains both.
    pub fn joined(&self, other: &PixelBox) -> PixelBox {
        let (x, y) = (self.x.min(other.x), self.y.min(other.y));
        let right = (self.x + self.width).max(other.x + other.width);
        let bottom = (self.y + self.height).max(other.y + other.height);
        PixelBox { x, y, width: right - x, height: bottom - y }
    }

    /// Intersection over union, 0 to 1.
    pub fn overlap(&self, other: &PixelBox) -> f64 {
        let shared = self.shared_area(other);
        let area = |b: &PixelBox| f64::from(b.width) * f64::from(b.height);
        let joint = area(self) + area(other) - shared;
        if joint > 0.0 { shared / joint } else { 0.0 }
    }
}

/// An obstacle region: an object on or beside the road.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Region {
    /// Bounding box in the left image.
    pub bounds: PixelBox,
    /// Disparity of the near side, in px.
    pub disparity_px: f64,
    /// Standard deviation of the disparity, in px.
    pub disparity_sigma_px: f64,
    /// Distance of the near side along z, in metres.
    pub distance_m: f64,
    /// Lateral position of the box centre, in metres right of the camera axis.
    pub lateral_m: f64,
    /// Width of the box at that distance, in metres.
    pub width_m: f64,
    /// Height of the top above the road, in metres.
    pub height_m: f64,
    /// By how much the thing itself ends inside of the left and of the right side of the box, in metres: where a side that
    /// runs away from the camera is seen, the box at the near distance reaches farther towards the image centre than it.
    pub inset_m: [f64; 2],
    /// Number of obstacle pixels.
    pub pixels: u32,
    /// Mean confidence of these pixels, 0 to 1.
    pub confidence: f64,
    /// Evidence that this sighting is a real obstacle: natural logarithm of the likelihood ratio. 0 tells nothing.
    pub evidence: f64,
}

/// Maximum magnitude of a measure of a valid region, in its unit: far above all that cameras see, and so small that no
/// arithmetic of the tracker overflows.
const MAX_MEASURE: f64 = 1e6;

impl Region {
    /// Whether all numbers are such as a detection may have: finite, not extreme, sizes and standard deviation not
    /// negative, disparity above 0, and a box whose sides are numbers.
    pub fn is_valid(&self) -> bool {
        let sizes = [self.disparity_sigma_px, self.distance_m, self.width_m, self.height_m];
        let PixelBox { x, y, width, height } = self.bounds;
        self.disparity_px > 1.0 / MAX_MEASURE
            && self.disparity_px <= MAX_MEASURE
            && self.lateral_m.abs() <= MAX_MEASURE
            && sizes.iter().chain(&self.inset_m).all(|v| (0.0..=MAX_MEASURE).contains(v))
            && self.evidence.abs() <= MAX_MEASURE
            && x.checked_add(width).is_some()
            && y.checked_add(height).is_some()
    }

    /// Sets the first column of the box and the column after its last one; updates width and lateral
    /// position.
    pub(crate) fn set_sides(&mut self, (first, end): (u32, u32), rig: &Rig) {
        let ends_m = self.ends_m();
        (self.bounds.x, self.bounds.width) = (first, end - first);
        self.width_m = f64::from(self.bounds.width) * self.distance_m / rig.focal_px;
        self.lateral_m = rig.lateral_m(0.5 * f64::from(first + end), self.distance_m);
        self.set_ends(ends_m);
    }

    /// Where the thing itself ends to the left and to the right, in metres right of the camera axis.
    pub fn ends_m(&self) -> [f64; 2] {
        let half_m = self.width_m / 2.0;
        [self.lateral_m - half_m + self.inset_m[0], self.lateral_m + half_m - self.inset_m[1]]
    }

    /// Sets where the thing itself ends, as far as that is within the box.
    pub(crate) fn set_ends(&mut self, [left_m, right_m]: [f64; 2]) {
        let half_m = self.width_m / 2.0;
        let left = (left_m - (self.lateral_m - half_m)).clamp(0.0, self.width_m);
        let right = (self.lateral_m + half_m - right_m).clamp(0.0, self.width_m - left);
        self.inset_m = [left, right];
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn overlap_is_intersection_over_union() {
        let a = PixelBox { x: 0, y: 0, width: 10, height: 10 };
        let b = PixelBox { x: 5, y: 0, width: 10, height: 10 };
        assert!((a.overlap(&b) - 50.0 / 150.0).abs() < 1e-12);
        assert_eq!(a.overlap(&PixelBox { x: 20, ..a }), 0.0);
        assert_eq!(PixelBox::default().overlap(&PixelBox::default()), 0.0);
    }
}
