//! Things that are parts of a boundary: a drainpipe, a door case, a bay window.
//!
//! What of a house front or a tall hedge is taken for a thing of its own is as high as it and stands flush with it, frame after frame:
//! it tells nothing that the boundary does not, and a row of such boxes hides what matters. What ends below its top, as a person or
//! a car before a wall does, or stands before it is a thing.

use super::parameters::{FLUSH_M, FLUSH_TIME_S, STANDS_BEFORE_M};
use crate::free_space::boundary::BeforeWall;

/// Whether a thing is part of a boundary.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct BoundaryPart {
    /// By how much it reaches out of the boundary, in metres, smoothed; `None` while it cannot be a part of one.
    before_m: Option<f64>,
    is_part: bool,
    /// See [`Self::wall_m`].
    wall_m: Option<f64>,
}

impl BoundaryPart {
    /// Takes in how a thing stands before the boundary of which it may be a part, `elapsed_s` seconds after the last time; `None` where
    /// it cannot be a part of one: it is a thing then at once, as in the own path. The first look decides alone.
    pub fn look(&mut self, wall: Option<BeforeWall>, elapsed_s: f64) {
        let wall = wall.filter(|wall| wall.reach_m.is_finite() && wall.nearest_m.is_finite());
        let wall_m = wall.map(|wall| wall.nearest_m);
        let Some(before_m) = wall.filter(|wall| !wall.is_in_path).map(|wall| wall.reach_m) else {
            *self = Self { wall_m, ..Self::default() };
            return;
        };
        self.wall_m = wall_m;
        let gain = 1.0 - (-elapsed_s / FLUSH_TIME_S).exp();
        let known_m = self.before_m.map_or(before_m, |known_m| known_m + gain * (before_m - known_m));
        self.before_m = Some(known_m);
        self.is_part = known_m < if self.is_part { STANDS_BEFORE_M } else { FLUSH_M };
    }

    /// By how much its nearest point stands before the wall behind it that is as high, in metres; `None` where there is none.
    pub fn wall_m(self) -> Option<f64> {
        self.wall_m
    }

    /// Whether it is.
    pub fn is_part(self) -> bool {
        self.is_part
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn beside(reach_m: f64) -> Option<BeforeWall> {
        Some(BeforeWall { reach_m, nearest_m: reach_m - 0.1, is_in_path: false })
    }

    #[test]
    fn what_is_flush_is_a_part_until_it_stands_before_the_boundary() {
        let mut part = BoundaryPart::default();
        assert!(!part.is_part());
        part.look(beside(0.1), 0.0);
        assert!(part.is_part());
        // A wrong look.
        part.look(beside(0.6), 0.08);
        assert!(part.is_part(), "{part:?}");
        (0..10).for_each(|_| part.look(beside(0.9), 0.08));
        assert!(!part.is_part(), "{part:?}");
        let mut before = BoundaryPart::default();
        for before_m in [0.5, 0.3, 0.4, 0.3] {
            before.look(beside(before_m), 0.08);
            assert!(!before.is_part(), "{before:?}");
        }
    }

    #[test]
    fn where_there_is_no_boundary_it_is_a_thing_again() {
        let mut part = BoundaryPart::default();
        part.look(beside(0.0), 0.0);
        assert!(part.is_part());
        part.look(None, 0.08);
        assert!(!part.is_part());
        part.look(beside(0.0), 0.08);
        part.look(beside(f64::NAN), 0.08);
        assert!(!part.is_part());
    }
}
