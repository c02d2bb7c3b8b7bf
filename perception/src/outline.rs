//! What is seen of a thing's outline on the ground: its near face, and both sides that run away from the camera.

use crate::motion::planar::Planar;

/// Outline of a thing between its left and its right end, seen from above: left end, near face, right end. The face of a thing that is
/// seen straight on reaches from end to end; of one that is turned a corner is nearest, and both ends are farther away.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Outline {
    /// How far inside of the left and of the right end the near face begins, in metres.
    pub inset_m: [f64; 2],
    /// How far behind the near face the left and the right end are, in metres.
    pub depth_m: [f64; 2],
}

impl Outline {
    /// The points from left to right of a thing of this width, in metres. `place_m`: the middle between its ends at the near face,
    /// to the right and forward, in metres.
    pub fn points_m(&self, [middle_m, near_m]: Planar, width_m: f64) -> [Planar; 4] {
        let (left_m, right_m) = (middle_m - width_m / 2.0, middle_m + width_m / 2.0);
        [
            [left_m, near_m + self.depth_m[0]],
            [left_m + self.inset_m[0], near_m],
            [right_m - self.inset_m[1], near_m],
            [right_m, near_m + self.depth_m[1]],
        ]
    }

    /// Limits the near face to the inside of a thing of this width, in metres.
    pub fn limit(&mut self, width_m: f64) {
        let sum_m: f64 = self.inset_m.iter().sum();
        if sum_m > width_m {
            self.inset_m = self.inset_m.map(|m| m * width_m.max(0.0) / sum_m);
        }
    }

    /// Moves towards another outline by this share, 0 to 1.
    pub fn approach(&mut self, other: &Self, share: f64) {
        let (mine, others) = ([&mut self.inset_m, &mut self.depth_m], [other.inset_m, other.depth_m]);
        for (mine, other) in mine.into_iter().zip(others) {
            mine.iter_mut().zip(other).for_each(|(mine, other)| *mine += share * (other - *mine));
        }
    }
}
