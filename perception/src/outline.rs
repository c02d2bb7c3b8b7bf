//! What is seen of a thing's outline on the ground: its near face, and both sides that run away from the camera.

use crate::motion::planar::Planar;

/// Length of the body of a thing behind its near side, in metres: that of a car.
pub const BODY_LENGTH_M: f64 = 4.5;

/// Outline of a thing, seen from above: left end, near face, right end. The face of a thing that is seen straight on reaches from
/// side to side; of one that is turned a corner is nearest, and both ends are farther away. In metres, none below 0.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Outline {
    /// How far inside of the thing's left and right side the near face begins.
    pub face_inset_m: [f64; 2],
    /// How far behind the near face the left and the right end are, at most [`BODY_LENGTH_M`].
    pub end_depth_m: [f64; 2],
    /// How far outside of the thing's left and right side they are: the width is that of what is seen at the near distance, and an
    /// end on the same ray behind it is farther from the axis.
    pub end_excess_m: [f64; 2],
}

impl Outline {
    /// The points from left to right of a thing of this width, in metres. `place_m`: the middle between its sides at the near face,
    /// to the right and forward, in metres.
    pub fn points_m(&self, [middle_m, near_m]: Planar, width_m: f64) -> [Planar; 4] {
        let (left_m, right_m) = (middle_m - width_m / 2.0, middle_m + width_m / 2.0);
        [
            [left_m - self.end_excess_m[0], near_m + self.end_depth_m[0]],
            [left_m + self.face_inset_m[0], near_m],
            [right_m - self.face_inset_m[1], near_m],
            [right_m + self.end_excess_m[1], near_m + self.end_depth_m[1]],
        ]
    }

    /// The left or right (1) end is at the near face.
    pub fn flatten(&mut self, side: usize) {
        (self.end_depth_m[side], self.end_excess_m[side]) = (0.0, 0.0);
    }

    /// Limits the near face to the inside of a thing of this width, in metres, and the ends to the length of a body.
    pub fn limit(&mut self, width_m: f64) {
        let sum_m: f64 = self.face_inset_m.iter().sum();
        if sum_m > width_m {
            self.face_inset_m = self.face_inset_m.map(|m| m * width_m.max(0.0) / sum_m);
        }
        let bounded = |m: f64| m.clamp(0.0, BODY_LENGTH_M);
        self.end_depth_m = self.end_depth_m.map(bounded);
        self.end_excess_m = self.end_excess_m.map(bounded);
    }

    /// Moves the left or right (1) side towards that of another outline by this share, 0 to 1.
    pub fn approach(&mut self, other: &Self, side: usize, share: f64) {
        let towards = |mine: &mut f64, other: f64| *mine += share * (other - *mine);
        towards(&mut self.face_inset_m[side], other.face_inset_m[side]);
        towards(&mut self.end_depth_m[side], other.end_depth_m[side]);
        towards(&mut self.end_excess_m[side], other.end_excess_m[side]);
    }

    /// All its measures, in metres.
    pub fn measures_m(&self) -> impl Iterator<Item = f64> {
        [self.face_inset_m, self.end_depth_m, self.end_excess_m].into_iter().flatten()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_face_stays_within_the_thing_and_ends_within_a_body() {
        let mut outline =
            Outline { face_inset_m: [3.0, 1.0], end_depth_m: [9.0, 1.0], end_excess_m: [0.5, 1e9] };
        outline.limit(2.0);
        assert_eq!(outline.face_inset_m, [1.5, 0.5]);
        assert_eq!(outline.end_depth_m, [BODY_LENGTH_M, 1.0]);
        assert_eq!(outline.end_excess_m, [0.5, BODY_LENGTH_M]);
        let points_m = outline.points_m([1.0, 10.0], 2.0);
        assert_eq!(points_m, [[-0.5, 14.5], [1.5, 10.0], [1.5, 10.0], [6.5, 11.0]]);
        outline.flatten(0);
        outline.limit(-1.0);
        assert_eq!(outline.points_m([0.0, 10.0], 0.0)[..3], [[0.0, 10.0]; 3]);
    }

    #[test]
    fn each_side_moves_by_itself() {
        let to = Outline { face_inset_m: [1.0; 2], end_depth_m: [2.0; 2], end_excess_m: [3.0; 2] };
        let mut outline = Outline::default();
        outline.approach(&to, 1, 0.5);
        assert_eq!(outline.measures_m().collect::<Vec<_>>(), [0.0, 0.5, 0.0, 1.0, 0.0, 1.5]);
    }
}
