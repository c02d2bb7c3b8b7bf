//! A small turn of the right camera against what a calibration says, and the calibration with it.

use super::camera::Camera;
use super::pose::{Pose, rotation_vector};
use super::rectification::{Rectification, RectificationError};
use crate::rig::Rig;
use crate::stereo::epipolar::field::{RowField, place};
use nalgebra::{Rotation3, Vector3};

/// How far the right camera is turned against what its calibration says, about the axes of the rectified pair. The
/// camera's place, and so the baseline, is that of the calibration.
///
/// Which of the two cameras has turned cannot be told: the left one is taken to be where it was.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct RightTurn {
    /// Upwards, in radians.
    pub pitch_rad: f64,
    /// To the right, in radians.
    pub yaw_rad: f64,
    /// Clockwise as seen from behind the camera, in radians.
    pub roll_rad: f64,
}

impl RightTurn {
    /// The turn of which rows tell: pitch and roll. `field` is over images of `size`.
    pub fn of_rows(field: &RowField, rig: &Rig, (width, height): (usize, usize)) -> Self {
        let middle = field.at(place(rig.cx_px, width), place(rig.cy_px, height));
        let half_width_px = 0.5 * (width.max(2) - 1) as f64;
        Self { pitch_rad: middle / rig.focal_px, yaw_rad: 0.0, roll_rad: -field.across_px / half_width_px }
    }

    /// The turn of which disparities tell: yaw. `offset_px` is to be added to all of them.
    pub fn of_disparities(offset_px: f64, rig: &Rig) -> Self {
        Self { yaw_rad: -offset_px / rig.focal_px, ..Self::default() }
    }

    /// By how much a disparity in column `x_px` is too large, in px, because of the yaw.
    pub fn disparity_error_px(&self, x_px: f64, rig: &Rig) -> f64 {
        let x = (x_px - rig.cx_px) / rig.focal_px;
        rig.focal_px * self.yaw_rad * (1.0 + x * x)
    }

    /// The largest angle, in radians.
    pub fn largest_rad(&self) -> f64 {
        self.pitch_rad.abs().max(self.yaw_rad.abs()).max(self.roll_rad.abs())
    }

    /// The turn from one rectification to another that differs in the right camera only.
    pub fn between(from: &Rectification, to: &Rectification) -> Self {
        let turn = rotation_vector(&(to.turns[1] * from.turns[1].inverse()));
        Self { pitch_rad: turn.x, yaw_rad: turn.y, roll_rad: turn.z }
    }

    fn rotation(&self) -> Rotation3<f64> {
        Rotation3::new(Vector3::new(self.pitch_rad, self.yaw_rad, self.roll_rad))
    }

    /// The rectification and the pose between the cameras after this turn of the right one.
    ///
    /// # Errors
    /// If no part of the image would be seen by both cameras.
    pub fn applied(
        &self,
        cameras: &[Camera; 2],
        rectification: &Rectification,
        between: &Pose,
    ) -> Result<(Rectification, Pose), RectificationError> {
        let [left, right] = rectification.turns;
        let turned = self.rotation() * right;
        let rectified = rectification.with_turns(cameras, [left, turned])?;
        // The centre of the right camera stays: its coordinates are turned about it.
        let own = turned.inverse() * right;
        let between = Pose { rotation: own * between.rotation, translation_m: own * between.translation_m };
        Ok((rectified, between))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::calibration::{Crop, Distortion};
    use nalgebra::Vector2;

    const SIZE: (usize, usize) = (640, 480);

    fn rig() -> ([Camera; 2], Pose, Rectification) {
        let camera = Camera {
            distortion: Distortion::BrownConrady([-0.2, 0.05, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]),
            ..Camera::pinhole(520.0, 521.0, 322.0, 238.0)
        };
        let between = Pose {
            rotation: Rotation3::new(Vector3::new(0.004, -0.003, 0.002)),
            translation_m: Vector3::new(-0.3, 0.002, 0.001),
        };
        let cameras = [camera, camera];
        let rectification = Rectification::new(&cameras, &between, SIZE, Crop::Same).unwrap();
        (cameras, between, rectification)
    }

    /// Row and disparity errors of points at several places when the right camera has turned by `turn`, but the
    /// calibration does not know: right row minus left row, and disparity beyond the true one, in px, with the place.
    fn errors(turn: &RightTurn) -> Vec<([f64; 2], f64, f64)> {
        let (cameras, between, rectification) = rig();
        let (_, true_between) = turn.applied(&cameras, &rectification, &between).unwrap();
        let mut found = Vec::new();
        for (x, y, z) in
            [(-3.0, -1.0, 8.0), (4.0, 1.2, 9.0), (0.1, 0.1, 20.0), (-2.0, 1.0, 6.0), (9.0, -3.0, 30.0)]
        {
            let point = Vector3::new(x, y, z);
            let seen = [
                cameras[0].project(&point).unwrap(),
                cameras[1].project(&true_between.apply(&point)).unwrap(),
            ];
            let [l, r]: [Vector2<f64>; 2] =
                std::array::from_fn(|side| rectification.rectified(&cameras, side, seen[side]).unwrap());
            let depth_m = (rectification.turns[0] * point).z;
            found.push(([r.x, r.y], r.y - l.y, (l.x - r.x) - rectification.rig.disparity_px(depth_m)));
        }
        found
    }

    #[test]
    fn rows_and_disparities_tell_the_turn() {
        let (_, _, rectification) = rig();
        let rig = rectification.rig;
        let pitch = errors(&RightTurn { pitch_rad: 1e-3, ..RightTurn::default() });
        for (_, row, _) in &pitch {
            assert!((row / rig.focal_px - 1e-3).abs() < 3e-4, "{pitch:?}");
        }
        let roll = errors(&RightTurn { roll_rad: 1e-3, ..RightTurn::default() });
        for (at, row, _) in &roll {
            assert!((row + 1e-3 * (at[0] - rig.cx_px)).abs() < 0.02, "{roll:?}");
        }
        let turn = RightTurn { yaw_rad: 1e-3, ..RightTurn::default() };
        for (at, _, disparity) in errors(&turn) {
            assert!((disparity - turn.disparity_error_px(at[0], &rig)).abs() < 0.02, "{at:?}: {disparity}");
        }
        // The same the other way round.
        let place_of = |field: RowField| RightTurn::of_rows(&field, &rig, SIZE);
        let middle = place(rig.cx_px, SIZE.0);
        let field = RowField { offset_px: 0.5 * middle, across_px: -0.5, down_px: 0.0 };
        let found = place_of(field);
        assert!(found.pitch_rad.abs() < 1e-9 && (found.roll_rad - 0.5 / 319.5).abs() < 1e-9, "{found:?}");
        assert_eq!(RightTurn::of_disparities(0.5, &rig).yaw_rad, -0.5 / rig.focal_px);
    }

    #[test]
    fn a_turn_that_is_applied_leaves_no_error_and_keeps_the_place() {
        let (cameras, between, rectification) = rig();
        let turn = RightTurn { pitch_rad: 4e-3, yaw_rad: -5e-3, roll_rad: 3e-3 };
        let (turned, pose) = turn.applied(&cameras, &rectification, &between).unwrap();
        for point in [Vector3::new(-2.0, 1.0, 7.0), Vector3::new(3.0, -1.0, 12.0)] {
            let left = turned.rectified(&cameras, 0, cameras[0].project(&point).unwrap()).unwrap();
            let right =
                turned.rectified(&cameras, 1, cameras[1].project(&pose.apply(&point)).unwrap()).unwrap();
            assert!((left.y - right.y).abs() < 1e-6);
            let depth_m = (turned.turns[0] * point).z;
            assert!((left.x - right.x - turned.rig.disparity_px(depth_m)).abs() < 1e-6);
        }
        let centre = |pose: &Pose| pose.inverse().translation_m;
        assert!((centre(&pose) - centre(&between)).norm() < 1e-12);
        let found = RightTurn::between(&rectification, &turned);
        assert!(
            (found.pitch_rad - 4e-3).abs() + (found.yaw_rad + 5e-3).abs() + (found.roll_rad - 3e-3).abs()
                < 1e-9
        );
        assert!((turned.rig, turned.turns[0]) == (rectification.rig, rectification.turns[0]));
        assert!((found.largest_rad() - 5e-3).abs() < 1e-9);
    }
}
