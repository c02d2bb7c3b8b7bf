//! Rigid transformations: the pose of a board, and the relative pose of two cameras.

use nalgebra::{Matrix3, Rotation3, SVector, UnitQuaternion, Vector3};

/// A rigid transformation: x ↦ R·x + t, in metres.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pose {
    /// R, the rotation.
    pub rotation: Rotation3<f64>,
    /// t, the translation in metres.
    pub translation_m: Vector3<f64>,
}

impl Pose {
    /// The identity.
    pub fn identity() -> Self {
        Self { rotation: Rotation3::identity(), translation_m: Vector3::zeros() }
    }

    /// Transforms a point.
    pub fn apply(&self, point: &Vector3<f64>) -> Vector3<f64> {
        self.rotation * point + self.translation_m
    }

    /// The composition: this transformation first, then `next`.
    pub fn then(&self, next: &Self) -> Self {
        Self { rotation: next.rotation * self.rotation, translation_m: next.apply(&self.translation_m) }
    }

    /// The inverse transformation.
    pub fn inverse(&self) -> Self {
        let rotation = self.rotation.inverse();
        Self { rotation, translation_m: -(rotation * self.translation_m) }
    }

    /// The pose after a small step: a rotation vector, applied after R, and a translation.
    pub fn stepped(&self, step: &SVector<f64, 6>) -> Self {
        let turn = Rotation3::new(Vector3::new(step[0], step[1], step[2]));
        Self {
            rotation: turn * self.rotation,
            translation_m: self.translation_m + Vector3::new(step[3], step[4], step[5]),
        }
    }

    /// The rotation vector, in radians.
    pub fn rotation_vector(&self) -> Vector3<f64> {
        rotation_vector(&self.rotation)
    }
}

/// Axis times angle of a rotation, in radians. Computed from the quaternion, because the trace of the matrix is
/// inaccurate for small angles.
pub fn rotation_vector(rotation: &Rotation3<f64>) -> Vector3<f64> {
    UnitQuaternion::from_rotation_matrix(rotation).scaled_axis()
}

/// The cross-product matrix V of `v`, with V·x = v × x.
pub fn cross(v: &Vector3<f64>) -> Matrix3<f64> {
    Matrix3::new(0.0, -v.z, v.y, v.z, 0.0, -v.x, -v.y, v.x, 0.0)
}

/// The component-wise median of several poses, robust to a few outliers. Rotations are compared as rotation
/// vectors relative to the first pose. `None` for an empty slice.
pub fn median(poses: &[Pose]) -> Option<Pose> {
    let first = poses.first()?;
    let middle = |f: &dyn Fn(&Pose) -> f64| {
        let mut values: Vec<f64> = poses.iter().map(f).collect();
        values.sort_unstable_by(f64::total_cmp);
        values[values.len() / 2]
    };
    let against = |p: &Pose| rotation_vector(&(p.rotation * first.rotation.inverse()));
    let mut turn = Vector3::zeros();
    let mut translation_m = Vector3::zeros();
    for i in 0..3 {
        turn[i] = middle(&|p| against(p)[i]);
        translation_m[i] = middle(&|p| p.translation_m[i]);
    }
    Some(Pose { rotation: Rotation3::new(turn) * first.rotation, translation_m })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn pose(x: f64, y: f64, z: f64) -> Pose {
        Pose { rotation: Rotation3::new(Vector3::new(x, y, z)), translation_m: Vector3::new(z, x, y) }
    }

    #[test]
    fn motions_compose_and_invert() {
        let (a, b) = (pose(0.1, -0.2, 0.3), pose(-0.4, 0.5, 0.1));
        let p = Vector3::new(1.0, 2.0, 3.0);
        assert!((a.then(&b).apply(&p) - b.apply(&a.apply(&p))).norm() < 1e-12);
        assert!((a.inverse().apply(&a.apply(&p)) - p).norm() < 1e-12);
    }

    #[test]
    fn rotation_vectors_are_sound_at_every_size() {
        for size in [0.0, 1e-12, 1e-8, 1e-4, 0.1, 1.0, 3.0] {
            let v = Vector3::new(0.6, 0.0, -0.8) * size;
            assert!((rotation_vector(&Rotation3::new(v)) - v).norm() < 1e-9, "{size}");
        }
    }

    #[test]
    fn a_step_moves_points_as_its_derivative_says() {
        let a = pose(0.3, 0.2, -0.1);
        let p = Vector3::new(0.5, -0.2, 0.8);
        for i in 0..6 {
            let mut step = SVector::<f64, 6>::zeros();
            step[i] = 1e-6;
            let slope = (a.stepped(&step).apply(&p) - a.apply(&p)) / 1e-6;
            let turned = a.rotation * p;
            let expected =
                if i < 3 { -cross(&turned).column(i).into_owned() } else { Vector3::ith(i - 3, 1.0) };
            assert!((slope - expected).norm() < 1e-5, "{i}");
        }
    }

    #[test]
    fn the_median_ignores_a_wrong_one() {
        let wrong = pose(1.0, 1.0, 1.0);
        let poses =
            [pose(0.1, 0.0, 0.0), pose(0.11, 0.0, 0.0), wrong, pose(0.09, 0.0, 0.0), pose(0.1, 0.01, 0.0)];
        let middle = median(&poses).unwrap();
        assert!((middle.rotation_vector() - Vector3::new(0.1, 0.0, 0.0)).norm() < 0.015);
        assert_eq!(median(&[]), None);
    }
}
