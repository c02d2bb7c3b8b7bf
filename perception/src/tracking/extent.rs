//! Size and place of a thing in the picture, filtered over time.
//!
//! A sighting may be a part of the thing, or the thing and what stands behind it: its box jumps. The box of a track is that of
//! the thing: its sides are filtered in metres at the near side, and clipped where the picture ends. A side that the border of
//! the picture cuts is not seen; the thing is then at least as wide as before, or as wide if it was seen as a whole.

use super::parameters::{BORDER_PX, EXTENT_TIME_S, MAX_RATIO};
use crate::outline::{BODY_LENGTH_M, Outline};
use crate::region::{PixelBox, Region};
use crate::rig::Rig;

/// Smallest width and height of a thing, in metres: less than anything that is detected.
const MIN_SIZE_M: f64 = 0.05;
/// After this many sightings of both of its sides, a thing has been seen as a whole; the first one of a track does not count.
const WHOLE_SIGHTINGS: u32 = 3;

/// Extent of a thing.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Extent {
    /// Width of its box at the near side, in metres.
    pub width_m: f64,
    /// Height above its foot, in metres.
    pub height_m: f64,
    /// By how much the thing itself ends inside of the left and of the right side of the box, in metres
    /// ([`Region::inset_m`]).
    pub inset_m: [f64; 2],
    /// Its outline.
    pub outline: Outline,
    /// Top and foot below the camera's axis, in metres.
    rows_m: [f64; 2],
    /// Sightings so far: the first ones are averaged.
    sightings: u32,
    /// Those of them that show both sides.
    whole_sightings: u32,
}

/// Which sides of a box the border of the picture cuts.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct CutSides {
    /// Left.
    pub left: bool,
    /// Right.
    pub right: bool,
    /// Bottom.
    pub foot: bool,
}

impl CutSides {
    /// Of a region in pictures of `size` (width, height), in px. On the left, the right camera misses as many columns of the left picture
    /// as the disparity.
    pub fn of(region: &Region, (width, height): (u32, u32)) -> Self {
        let b = &region.bounds;
        let (left, right, bottom) = (f64::from(b.x), b.x + b.width, b.y + b.height);
        Self {
            left: left <= region.disparity_px + BORDER_PX,
            right: f64::from(right) >= f64::from(width) - BORDER_PX,
            foot: bottom + 1 >= height,
        }
    }

    /// The same, and the other sides that tell no end of the thing: something nearer hides what is beyond them, or the picture cuts one
    /// side of a surface that was divided at the other one.
    pub fn or_open(self, region: &Region) -> Self {
        let ([hidden_left, hidden_right], [left_goes_on, right_goes_on]) = (region.is_hidden, region.goes_on);
        Self {
            left: self.left || hidden_left || self.right && left_goes_on,
            right: self.right || hidden_right || self.left && right_goes_on,
            ..self
        }
    }

    /// Whether left or right is cut.
    pub fn any(self) -> bool {
        self.left || self.right
    }
}

impl Extent {
    /// After the first sighting.
    pub fn new(region: &Region, rig: &Rig) -> Self {
        let mut extent = Self {
            width_m: region.width_m.max(MIN_SIZE_M),
            height_m: region.height_m.max(MIN_SIZE_M),
            inset_m: region.inset_m,
            outline: region.outline,
            rows_m: rows_m(region, rig),
            sightings: 1,
            whole_sightings: 0,
        };
        extent.limit();
        extent
    }

    /// Takes in a sighting, `elapsed_s` after the last one. `cut`: the sides that the picture cuts; `open`: these, and the others
    /// that tell no end ([`CutSides::or_open`]); `enters`: what the picture cuts comes into view.
    pub fn update(
        &mut self,
        region: &Region,
        rig: &Rig,
        (cut, open, enters): (CutSides, CutSides, bool),
        elapsed_s: f64,
    ) {
        self.sightings = self.sightings.saturating_add(1);
        let settled = 1.0 - (-elapsed_s / EXTENT_TIME_S).exp();
        let gain = settled.max(1.0 / f64::from(self.sightings)).min(0.5);
        let bounded = |new: f64, old: f64| new.clamp(old / MAX_RATIO, old * MAX_RATIO);
        let width_m = bounded(region.width_m, self.width_m);
        let wider_m = width_m - self.width_m;
        let front_m = self.front_m();
        let is_known = self.whole_sightings >= WHOLE_SIGHTINGS;
        if cut.any() && !(enters && (wider_m < 0.0 || is_known)) {
            // What comes into view at the border is part of the thing. One that comes in and is narrower than before was
            // seen together with something else; and what was seen as a whole does not come in at a jump.
            self.width_m = self.width_m.max(region.width_m);
        } else {
            self.width_m += gain * wider_m;
        }
        self.height_m += gain * (bounded(region.height_m, self.height_m) - self.height_m);
        for (smoothed, inset_m) in self.inset_m.iter_mut().zip(region.inset_m) {
            *smoothed += gain * (inset_m - *smoothed);
        }
        if is_known && cut.any() && !enters {
            // Nothing more of it comes into view: what the box gains is behind it or beside it.
            self.width_m = front_m + self.inset_m.iter().sum::<f64>();
        }
        if !open.any() {
            self.whole_sightings = self.whole_sightings.saturating_add(1);
        }
        // Of an open side the end is not seen.
        for side in (0..2).filter(|&side| ![open.left, open.right][side]) {
            self.outline.approach(&region.outline, side, gain);
        }
        let [top_m, foot_m] = rows_m(region, rig);
        self.rows_m[0] += gain * (top_m - self.rows_m[0]);
        // A foot below the picture is not seen.
        if foot_m > self.rows_m[1] || !cut.foot {
            self.rows_m[1] += gain * (foot_m - self.rows_m[1]);
        }
        self.limit();
    }

    /// Keeps all sizes above 0.
    fn limit(&mut self) {
        self.width_m = self.width_m.max(MIN_SIZE_M);
        self.height_m = self.height_m.max(MIN_SIZE_M);
        let room_m = (self.width_m - MIN_SIZE_M).max(0.0);
        let sum_m: f64 = self.inset_m.iter().sum();
        if sum_m > room_m {
            self.inset_m = self.inset_m.map(|m| m * room_m / sum_m);
        }
        self.outline.limit(self.front_m());
    }

    /// Width of the thing itself, without the insets, in metres.
    pub fn front_m(&self) -> f64 {
        self.width_m - self.inset_m[0] - self.inset_m[1]
    }

    /// From the middle of the box to that of the thing itself, in metres.
    pub fn shift_m(&self) -> f64 {
        shift_m(self.inset_m)
    }

    /// The whole box of the thing, also outside of the picture: left, top, right, bottom, in px. `middle_m`: middle of the box
    /// to the right of the camera's axis.
    pub fn edges(&self, rig: &Rig, middle_m: f64, distance_m: f64) -> [f64; 4] {
        let px = rig.focal_px / distance_m;
        let centre = rig.cx_px + px * middle_m;
        let half = px * self.width_m / 2.0;
        let [top, bottom] = self.rows_m.map(|m| rig.cy_px + px * m);
        [centre - half, top, centre + half, bottom.max(top)]
    }
}

/// From the middle of a box to that of the thing itself, in metres.
pub fn shift_m([left, right]: [f64; 2]) -> f64 {
    (left - right) / 2.0
}

/// Top and foot of a region below the camera's axis, in metres.
fn rows_m(region: &Region, rig: &Rig) -> [f64; 2] {
    let top = f64::from(region.bounds.y);
    [top, top + f64::from(region.bounds.height)]
        .map(|row| (row - rig.cy_px) * region.distance_m / rig.focal_px)
}

/// Intersection of a box with a picture of `width` × `height`; `None` if none of it is visible. At least one pixel.
pub fn clip(edges: [f64; 4], (width, height): (u32, u32)) -> Option<PixelBox> {
    let span = |from: f64, to: f64, size: u32| {
        if !(to > 0.0 && from < f64::from(size)) {
            return None;
        }
        let from = (from.round().max(0.0) as u32).min(size - 1);
        let to = (to.round().max(0.0) as u32).clamp(from + 1, size);
        Some((from, to - from))
    };
    let ((x, width), (y, height)) = (span(edges[0], edges[2], width)?, span(edges[1], edges[3], height)?);
    Some(PixelBox { x, y, width, height })
}

/// Share of the first box that lies within the second, 0 to 1.
pub fn contained_share(inner: &[f64; 4], outer: &[f64; 4]) -> f64 {
    let area = (inner[2] - inner[0]) * (inner[3] - inner[1]);
    let wide = (inner[2].min(outer[2]) - inner[0].max(outer[0])).max(0.0);
    let high = (inner[3].min(outer[3]) - inner[1].max(outer[1])).max(0.0);
    if area > 0.0 { wide * high / area } else { 0.0 }
}

/// The edges of a box: left, top, right, bottom, in px.
pub fn edges_of(bounds: &PixelBox) -> [f64; 4] {
    let [x, y, width, height] = [bounds.x, bounds.y, bounds.width, bounds.height].map(f64::from);
    [x, y, x + width, y + height]
}

/// The part of a box of a thing at this distance that both pictures of `size` (width, height) show: the right camera does not see as many
/// of the leftmost columns as the disparity of what is farthest back in it.
pub(super) fn in_view(
    [left, top, right, bottom]: [f64; 4],
    distance_m: f64,
    (width, height): (u32, u32),
    rig: &Rig,
) -> [f64; 4] {
    let [width, height] = [width, height].map(f64::from);
    // No `clamp`, which panics where a bound is no number.
    let first = rig.disparity_px(distance_m + BODY_LENGTH_M).max(0.0).min(width);
    let columns = [left, right].map(|x| x.max(first).min(width));
    let rows = [top, bottom].map(|y| y.max(0.0).min(height));
    [columns[0], rows[0], columns[1], rows[1]]
}
