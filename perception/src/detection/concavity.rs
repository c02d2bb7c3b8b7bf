//! Where the outline of a group of stixels on the ground turns inwards, two things meet.
//!
//! A car, a person, a rider: what stands on the road is about convex, seen from above. A row of stixels whose outline has a
//! corner that turns away from the camera is therefore more than one thing: a person before a wall, a bicycle at the end of one,
//! two parked cars. The outline is compared with its convex hull on the side of the camera; where it lies behind the hull by more than
//! its error, and by more than things are concave, it is split at its deepest point (locally convex connected patches: Stein and
//! others, CVPR 2014, along one line instead of a surface).

use super::stixels::{Stixel, Stixels};
use crate::motion::planar::Planar;
use crate::rig::Rig;

/// Smallest disparity of which a place is computed, in px.
const MIN_PX: f64 = 0.1;
/// A stixel of fewer rows than this share of the longest one of its strip at that place is noise, or something small before it.
const ROWS_SHARE: f64 = 0.5;
/// Fewest strips on both sides of a corner: what is narrower is the blur of the matcher at a depth edge.
const MARGIN: usize = 2;

/// A point of an outline.
#[derive(Clone, Copy, Debug)]
struct Point {
    strip: u32,
    /// To the right and ahead, in metres.
    place_m: Planar,
}

/// The outline of a group on the ground: a point of each strip, from left to right, the median of three. Memory is allocated once.
#[derive(Debug)]
pub(super) struct Profile {
    points: Vec<Point>,
    /// Indices of the points of the hull.
    hull: Vec<usize>,
}

impl Profile {
    /// Memory for outlines of so many strips.
    pub(super) fn with_capacity(strips: usize) -> Self {
        Self { points: Vec::with_capacity(strips), hull: Vec::with_capacity(strips) }
    }

    /// Takes in the outline of stixels, which are sorted by strip, and in a strip the nearest first.
    pub(super) fn trace<'a>(&mut self, stixels: impl Iterator<Item = &'a Stixel> + Clone, rig: &Rig) {
        self.points.clear();
        let mut rest = stixels.peekable();
        while let Some(&first) = rest.peek() {
            let of_strip = rest.clone().take_while(|stixel| stixel.strip == first.strip);
            let longest = of_strip.clone().map(|stixel| stixel.rows).max().unwrap_or(0);
            let is_long = |stixel: &&Stixel| f64::from(stixel.rows) >= ROWS_SHARE * f64::from(longest);
            let nearest = of_strip.clone().find(is_long).unwrap_or(first);
            let distance_m = rig.distance_m(f64::from(nearest.disparity_px).max(MIN_PX));
            let lateral_m = rig.lateral_m(Stixels::column(first.strip as usize), distance_m);
            self.points.push(Point { strip: first.strip, place_m: [lateral_m, distance_m] });
            while rest.next_if(|stixel| stixel.strip == first.strip).is_some() {}
        }
        // One strip by itself is noise: a window, a reflection.
        let mut before_m = self.points.first().map_or(0.0, |point| point.place_m[1]);
        for i in 1..self.points.len().saturating_sub(1) {
            let ([lateral_m, own_m], after_m) = (self.points[i].place_m, self.points[i + 1].place_m[1]);
            let median_m = own_m.clamp(before_m.min(after_m), before_m.max(after_m));
            self.points[i].place_m = [lateral_m * median_m / own_m, median_m];
            before_m = own_m;
        }
    }

    /// The strip at which the outline lies farthest behind its convex hull, relative to what `limit_m` allows at a distance; `None` if it
    /// does nowhere by more. The strip begins the right part.
    pub(super) fn corner(&mut self, limit_m: impl Fn(f64) -> f64) -> Option<u32> {
        let points = &self.points;
        let place_m = |i: usize| points[i].place_m;
        self.hull.clear();
        for i in 0..points.len() {
            while let [.., a, b] = self.hull[..]
                && turn(place_m(a), place_m(b), place_m(i)) <= 0.0
            {
                self.hull.pop();
            }
            self.hull.push(i);
        }
        let inner = MARGIN..points.len().saturating_sub(MARGIN);
        let mut deepest: Option<(f64, u32)> = None;
        for side in self.hull.windows(2) {
            let (from_m, to_m) = (place_m(side[0]), place_m(side[1]));
            let length_m = (to_m[0] - from_m[0]).hypot(to_m[1] - from_m[1]).max(1e-6);
            for i in (side[0] + 1..side[1]).filter(|i| inner.contains(i)) {
                let depth_m = -turn(from_m, place_m(i), to_m) / length_m;
                let share = depth_m / limit_m(place_m(i)[1]);
                if share > 1.0 && deepest.is_none_or(|(most, _)| share > most) {
                    deepest = Some((share, points[i].strip));
                }
            }
        }
        deepest.map(|(_, strip)| strip)
    }
}

/// Twice the area of a triangle, in m²: above 0 if the way over `b` turns to the left as seen from above, as it does around a convex thing
/// from left to right on the side of the camera.
fn turn(a: Planar, b: Planar, c: Planar) -> f64 {
    (b[0] - a[0]) * (c[1] - b[1]) - (b[1] - a[1]) * (c[0] - b[0])
}

#[cfg(test)]
mod tests {
    use super::*;

    const RIG: Rig = Rig { focal_px: 1000.0, baseline_m: 0.3, cx_px: 640.0, cy_px: 360.0 };

    /// Stixels of an outline with these corners, in metres right and ahead, one in each strip.
    fn stixels(corners_m: &[Planar]) -> Vec<Stixel> {
        let strips = (0..320).filter_map(|strip| {
            let slope = (Stixels::column(strip) - RIG.cx_px) / RIG.focal_px;
            let ahead_m = corners_m.windows(2).find_map(|side| {
                let [from, to] = [side[0], side[1]].map(|[x, z]| x - slope * z);
                let share = from / (from - to);
                (from <= 0.0 && to > 0.0).then(|| side[0][1] + share * (side[1][1] - side[0][1]))
            })?;
            let disparity_px = RIG.disparity_px(ahead_m) as f32;
            Some(Stixel { strip: strip as u32, rows: 50, disparity_px, ..Stixel::default() })
        });
        strips.collect()
    }

    /// Lateral position of the corner that is found, in metres; `None` if there is none.
    fn corner_m(corners_m: &[Planar], limit_m: f64) -> Option<f64> {
        let stixels = stixels(corners_m);
        let mut profile = Profile::with_capacity(320);
        profile.trace(stixels.iter(), &RIG);
        let strip = profile.corner(|_| limit_m)?;
        let at = stixels.iter().find(|stixel| stixel.strip == strip).expect("a strip of the outline");
        Some(RIG.lateral_m(Stixels::column(strip as usize), RIG.distance_m(at.disparity_px.into())))
    }

    #[test]
    fn a_bicycle_at_the_end_of_a_wall_is_not_part_of_it() {
        // It stands across, 7 m ahead, from 1.6 m on; the wall runs towards the camera.
        let found_m = corner_m(&[[1.6, 7.0], [2.5, 7.0], [2.5, 4.3]], 0.4).expect("a corner");
        assert!((found_m - 2.5).abs() < 0.1, "{found_m}");
    }

    #[test]
    fn who_stands_before_a_wall_is_not_part_of_it() {
        let before_m = |depth_m: f64| {
            [[-3.0, 9.0], [0.2, 9.0], [0.2, 9.0 - depth_m], [0.7, 9.0 - depth_m], [0.7, 9.0], [3.0, 9.0]]
        };
        let found_m = corner_m(&before_m(0.8), 0.4).expect("a corner");
        assert!((found_m - 0.2).abs() < 0.15 || (found_m - 0.7).abs() < 0.15, "{found_m}");
        assert_eq!(corner_m(&before_m(0.3), 0.4), None, "as flat as a door case");
    }

    #[test]
    fn a_car_is_one_thing_from_all_sides() {
        for corners_m in [
            [[1.0, 9.0], [1.0, 5.0], [2.8, 5.0]],
            [[-2.8, 5.0], [-1.0, 5.0], [-1.0, 9.0]],
            [[-1.0, 8.0], [0.4, 6.0], [2.5, 8.5]],
        ] {
            assert_eq!(corner_m(&corners_m, 0.05), None, "{corners_m:?}");
        }
    }

    #[test]
    fn few_strips_and_single_ones_are_no_corner() {
        let corner = |count: u32, far: std::ops::Range<u32>| {
            let of = |strip: u32| Stixel {
                strip,
                rows: 9,
                disparity_px: if far.contains(&strip) { 20.0 } else { 60.0 },
                ..Stixel::default()
            };
            let stixels: Vec<_> = (0..count).map(of).collect();
            let mut profile = Profile::with_capacity(8);
            profile.trace(stixels.iter(), &RIG);
            profile.corner(|_| 0.4)
        };
        for count in 0..=4 {
            assert_eq!(corner(count, 1..3), None, "{count}");
        }
        assert_eq!(corner(8, 3..4), None, "a window");
        assert!(corner(8, 3..5).is_some());
    }
}
