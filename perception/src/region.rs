//! Pixel boxes and obstacle regions: the output of detection and the input of tracking.

use crate::outline::Outline;
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
    /// Whether something nearer hides what is beyond its left and its right side.
    pub is_hidden: [bool; 2],
    /// Whether the surface goes on beyond its left and its right side, as that of a hedge or a wall that was divided.
    pub goes_on: [bool; 2],
    /// Its outline between these ends.
    pub outline: Outline,
    /// Number of obstacle pixels.
    pub pixels: u32,
    /// Mean confidence of these pixels, 0 to 1.
    pub confidence: f64,
    /// Evidence that this sighting is a real obstacle: natural logarithm of the likelihood ratio. 0 tells nothing.
    pub evidence: f64,
}

/// Blur of the matcher: a disparity that differs from the near side by less is as near, in px.
pub(crate) const DEPTH_BLUR_PX: f64 = 0.36;
/// What may protrude in front of the face that is found as the near side, in metres: the foot of a cone, a bumper.
pub(crate) const SHAPE_M: f64 = 0.075;

/// Maximum magnitude of a measure of a valid region, in its unit: far above all that cameras see, and so small that no
/// arithmetic of the tracker overflows.
const MAX_MEASURE: f64 = 1e6;

/// What is seen of a thing on the ground, in metres: laterally right of the camera axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Footprint {
    /// Where it ends to the left and to the right, at whatever depth.
    pub ends_m: [f64; 2],
    /// How far behind the near side both ends are.
    pub depth_m: [f64; 2],
    /// Where its near face ends to the left and to the right.
    pub face_m: [f64; 2],
}

/// Fewest columns that are cut off as a part of what was seen, in px: stixels are as wide, so fewer are an error of their side.
const MIN_CUT_PX: u32 = 4;

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
            && self.outline.measures_m().all(|v| (0.0..=MAX_MEASURE).contains(&v))
            && self.evidence.abs() <= MAX_MEASURE
            && x.checked_add(width).is_some()
            && y.checked_add(height).is_some()
    }

    /// Sets the first column of the box and the column after its last one; updates width and lateral
    /// position.
    pub(crate) fn set_sides(&mut self, (first, end): (u32, u32), rig: &Rig) {
        let mut seen = self.footprint();
        // What is cut off tells nothing of the outline.
        let is_cut =
            [first >= self.bounds.x + MIN_CUT_PX, end + MIN_CUT_PX <= self.bounds.x + self.bounds.width];
        (self.bounds.x, self.bounds.width) = (first, end - first);
        self.width_m = f64::from(self.bounds.width) * self.distance_m / rig.focal_px;
        self.lateral_m = rig.lateral_m(0.5 * f64::from(first + end), self.distance_m);
        let half_m = self.width_m / 2.0;
        let sides_m = [self.lateral_m - half_m, self.lateral_m + half_m];
        for side in (0..2).filter(|&side| is_cut[side]) {
            seen.depth_m[side] = 0.0;
            seen.ends_m[side] = seen.ends_m[side].clamp(sides_m[0], sides_m[1]);
        }
        self.set_footprint(&seen);
    }

    /// Where the thing itself ends to the left and to the right, in metres right of the camera axis.
    pub fn ends_m(&self) -> [f64; 2] {
        let half_m = self.width_m / 2.0;
        [self.lateral_m - half_m + self.inset_m[0], self.lateral_m + half_m - self.inset_m[1]]
    }

    /// Distance at which a sector of rays, given by their lateral position at 1 m, meets the thing: its near side, or the side that
    /// runs away from the camera; `None` where it passes both.
    pub(crate) fn meets_m(&self, [left_slope, right_slope]: [f64; 2]) -> Option<f64> {
        let ([left_m, right_m], near_m) = (self.ends_m(), self.distance_m);
        if left_slope * near_m > right_m {
            (right_m < 0.0 && left_slope < 0.0).then(|| right_m / left_slope)
        } else if right_slope * near_m < left_m {
            (left_m > 0.0 && right_slope > 0.0).then(|| left_m / right_slope)
        } else {
            Some(near_m)
        }
    }

    /// Joins a part of the same thing. The near side remains what it is.
    pub(crate) fn join(&mut self, part: &Region, rig: &Rig) {
        let (mut seen, of_part) = (self.footprint(), part.footprint());
        let behind_m = (part.distance_m - self.distance_m).max(0.0);
        for (side, is_outside) in [|a, b| a < b, |a: f64, b: f64| a > b].into_iter().enumerate() {
            if is_outside(of_part.ends_m[side], seen.ends_m[side]) {
                seen.ends_m[side] = of_part.ends_m[side];
                seen.depth_m[side] = of_part.depth_m[side] + behind_m;
            }
        }
        if self.disparity_px - part.disparity_px <= DEPTH_BLUR_PX {
            let ([left_m, right_m], [part_left_m, part_right_m]) = (seen.face_m, of_part.face_m);
            seen.face_m = [left_m.min(part_left_m), right_m.max(part_right_m)];
        }
        let columns = |bounds: &PixelBox| [bounds.x, bounds.x + bounds.width];
        let ([left, right], [part_left, part_right]) = (columns(&self.bounds), columns(&part.bounds));
        for (side, is_outermost) in [part_left < left, part_right > right].into_iter().enumerate() {
            if is_outermost {
                self.is_hidden[side] = part.is_hidden[side];
                self.goes_on[side] = part.goes_on[side];
            }
        }
        self.bounds = self.bounds.joined(&part.bounds);
        self.width_m = f64::from(self.bounds.width) * self.distance_m / rig.focal_px;
        let middle = f64::from(self.bounds.x) + f64::from(self.bounds.width) / 2.0;
        self.lateral_m = rig.lateral_m(middle, self.distance_m);
        self.set_footprint(&seen);
        self.height_m = self.height_m.max(part.height_m);
        let pixels = [self.pixels, part.pixels].map(f64::from);
        self.confidence =
            (self.confidence * pixels[0] + part.confidence * pixels[1]) / (pixels[0] + pixels[1]).max(1.0);
        self.pixels = self.pixels.saturating_add(part.pixels);
        self.evidence = self.evidence.max(part.evidence);
    }

    /// What is seen of it on the ground.
    fn footprint(&self) -> Footprint {
        let (Outline { face_inset_m, end_depth_m, end_excess_m }, [left_m, right_m]) =
            (self.outline, self.ends_m());
        Footprint {
            ends_m: [left_m - end_excess_m[0], right_m + end_excess_m[1]],
            depth_m: end_depth_m,
            face_m: [left_m + face_inset_m[0], right_m - face_inset_m[1]],
        }
    }

    /// Sets its ends, as far as they are within the box, and its outline.
    pub(crate) fn set_footprint(&mut self, seen: &Footprint) {
        self.set_ends(seen.ends_m);
        let [left_m, right_m] = self.ends_m();
        self.outline = Outline {
            face_inset_m: [(seen.face_m[0] - left_m).max(0.0), (right_m - seen.face_m[1]).max(0.0)],
            end_depth_m: seen.depth_m,
            end_excess_m: [(left_m - seen.ends_m[0]).max(0.0), (seen.ends_m[1] - right_m).max(0.0)],
        };
        self.outline.limit(self.thing_m());
    }

    /// Width of the thing itself, in metres.
    fn thing_m(&self) -> f64 {
        self.width_m - self.inset_m[0] - self.inset_m[1]
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
    fn rays_meet_the_near_side_or_the_side_behind_it() {
        // 2 to 4 m to the left, 5 m away; its right side is seen.
        let region = Region {
            bounds: PixelBox::default(),
            disparity_px: 20.0,
            disparity_sigma_px: 0.1,
            distance_m: 5.0,
            lateral_m: -2.5,
            width_m: 3.0,
            height_m: 1.5,
            inset_m: [0.0, 1.0],
            is_hidden: [false; 2],
            goes_on: [false; 2],
            outline: Outline::default(),
            pixels: 100,
            confidence: 0.9,
            evidence: 5.0,
        };
        assert_eq!(region.ends_m(), [-4.0, -2.0]);
        let meets = |left_m: f64, right_m: f64| region.meets_m([left_m / 5.0, right_m / 5.0]);
        assert_eq!(meets(-3.0, -2.9), Some(5.0));
        assert_eq!(meets(-2.1, -1.9), Some(5.0));
        // A ray that is 1.25 m to the left at 5 m has come to 2 m at 8 m.
        assert!((meets(-1.25, -1.0).unwrap() - 8.0).abs() < 1e-9);
        assert_eq!(meets(0.1, 0.2), None);
        let mirrored = Region { lateral_m: 2.5, inset_m: [1.0, 0.0], ..region };
        assert!((mirrored.meets_m([0.2, 0.25]).unwrap() - 8.0).abs() < 1e-9);
    }

    #[test]
    fn overlap_is_intersection_over_union() {
        let a = PixelBox { x: 0, y: 0, width: 10, height: 10 };
        let b = PixelBox { x: 5, y: 0, width: 10, height: 10 };
        assert!((a.overlap(&b) - 50.0 / 150.0).abs() < 1e-12);
        assert_eq!(a.overlap(&PixelBox { x: 20, ..a }), 0.0);
        assert_eq!(PixelBox::default().overlap(&PixelBox::default()), 0.0);
    }

    const RIG: Rig = Rig { focal_px: 1000.0, baseline_m: 0.3, cx_px: 640.0, cy_px: 360.0 };

    /// A region at 10 m with a box of these columns, in px, and what is seen of it.
    fn seen(columns: [u32; 2], seen: Footprint) -> Region {
        let mut region = Region {
            bounds: PixelBox { x: columns[0], y: 300, width: columns[1] - columns[0], height: 100 },
            disparity_px: 30.0,
            disparity_sigma_px: 0.1,
            distance_m: 10.0,
            lateral_m: (f64::from(columns[0] + columns[1]) / 2.0 - RIG.cx_px) / 100.0,
            width_m: f64::from(columns[1] - columns[0]) / 100.0,
            height_m: 1.5,
            inset_m: [0.0; 2],
            is_hidden: [false; 2],
            goes_on: [false; 2],
            outline: Outline::default(),
            pixels: 1000,
            confidence: 0.9,
            evidence: 5.0,
        };
        region.set_footprint(&seen);
        region
    }

    fn is_near(a: [f64; 2], b: [f64; 2]) -> bool {
        (a[0] - b[0]).abs() < 1e-9 && (a[1] - b[1]).abs() < 1e-9
    }

    #[test]
    fn an_end_beside_the_box_keeps_its_place() {
        // A corner 1 m to the right; the right end at 4.2 m, 14 m away, is seen at 3 m at the near distance.
        let what = Footprint { ends_m: [1.0, 4.2], depth_m: [0.0, 4.0], face_m: [1.0, 1.2] };
        let region = seen([740, 940], what);
        assert!(is_near(region.ends_m(), [1.0, 3.0]), "{region:?}");
        assert!(is_near(region.outline.end_excess_m, [0.0, 1.2]) && region.is_valid(), "{region:?}");
        let points_m = region.outline.points_m([2.0, 10.0], 2.0);
        assert!(is_near(points_m[3], [4.2, 14.0]) && is_near(points_m[2], [1.2, 10.0]), "{points_m:?}");
    }

    #[test]
    fn a_side_that_is_cut_off_has_no_depth() {
        let what = Footprint { ends_m: [1.0, 2.8], depth_m: [0.0, 4.0], face_m: [1.0, 1.2] };
        let mut region = seen([740, 940], what);
        region.set_sides((740, 840), &RIG);
        assert!(is_near(region.ends_m(), [1.0, 2.0]), "{region:?}");
        assert_eq!(region.outline.end_depth_m, [0.0; 2]);
        assert!(is_near(region.outline.face_inset_m, [0.0, 0.8]), "{region:?}");
        // A few columns are an error of the side.
        let mut region = seen([740, 940], what);
        region.set_sides((740, 940 - MIN_CUT_PX + 1), &RIG);
        assert_eq!(region.outline.end_depth_m, [0.0, 4.0]);
        // What the box gains beside it changes nothing.
        let mut region = seen([740, 940], what);
        region.set_sides((640, 1040), &RIG);
        assert!(
            is_near(region.ends_m(), [1.0, 2.8]) && region.outline.end_depth_m == [0.0, 4.0],
            "{region:?}"
        );
    }

    #[test]
    fn a_part_that_is_as_near_belongs_to_the_face_and_one_behind_it_is_a_side() {
        let whole = Footprint { ends_m: [1.0, 2.0], depth_m: [0.0; 2], face_m: [1.0, 2.0] };
        let beside = Footprint { ends_m: [2.0, 3.0], depth_m: [0.0; 2], face_m: [2.0, 3.0] };
        let mut region = seen([740, 840], whole);
        region.join(&seen([840, 940], beside), &RIG);
        assert_eq!(region.outline, Outline::default());
        let mut region = seen([740, 840], whole);
        let side = Region {
            disparity_px: 25.0,
            distance_m: 12.0,
            ..seen([700, 740], Footprint { ends_m: [0.8, 1.0], ..beside })
        };
        region.join(&side, &RIG);
        assert!(is_near(region.outline.end_depth_m, [2.0, 0.0]), "{region:?}");
        assert!((region.ends_m()[0] + region.outline.face_inset_m[0] - 1.0).abs() < 1e-9, "{region:?}");
    }
}
