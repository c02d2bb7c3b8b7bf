//! Rigid motion of the camera.

/// A rigid transform from one camera frame to another: p' = R p + t, in metres. Axes: x right, y down, z forward.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pose {
    /// Rotation matrix, row by row.
    pub rotation: [[f64; 3]; 3],
    /// Translation, in metres.
    pub translation_m: [f64; 3],
}

impl Default for Pose {
    fn default() -> Self {
        Self::IDENTITY
    }
}

impl Pose {
    /// No motion.
    pub const IDENTITY: Self =
        Self { rotation: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]], translation_m: [0.0; 3] };

    /// The point `p` transformed.
    #[must_use]
    pub fn apply(&self, p: [f64; 3]) -> [f64; 3] {
        let rotated = self.rotate(p);
        std::array::from_fn(|i| rotated[i] + self.translation_m[i])
    }

    /// The direction `p` rotated.
    #[must_use]
    pub fn rotate(&self, p: [f64; 3]) -> [f64; 3] {
        self.rotation.map(|row| row[0] * p[0] + row[1] * p[1] + row[2] * p[2])
    }

    /// First `other`, then `self`.
    #[must_use]
    pub fn after(&self, other: &Self) -> Self {
        let (a, b) = (&self.rotation, &other.rotation);
        let rotation = std::array::from_fn(|i| {
            std::array::from_fn(|j| a[i][0] * b[0][j] + a[i][1] * b[1][j] + a[i][2] * b[2][j])
        });
        Self { rotation, translation_m: self.apply(other.translation_m) }
    }

    /// The transform back.
    #[must_use]
    pub fn inverse(&self) -> Self {
        let r = &self.rotation;
        let rotation: [[f64; 3]; 3] = std::array::from_fn(|i| std::array::from_fn(|j| r[j][i]));
        let back = Self { rotation, translation_m: [0.0; 3] };
        Self { translation_m: back.rotate(self.translation_m).map(|v| -v), ..back }
    }

    /// The rotation by a vector: its direction is the axis, its length the angle in rad (Rodrigues).
    #[must_use]
    pub fn from_rotation_vector(w: [f64; 3]) -> Self {
        let angle_rad = w.iter().map(|v| v * v).sum::<f64>().sqrt();
        // sin(a)/a and (1 − cos(a))/a², by their series near 0.
        let (s, c) = if angle_rad < 1e-4 {
            let a2 = angle_rad * angle_rad;
            (1.0 - a2 / 6.0, 0.5 - a2 / 24.0)
        } else {
            (angle_rad.sin() / angle_rad, (1.0 - angle_rad.cos()) / (angle_rad * angle_rad))
        };
        let cross = [[0.0, -w[2], w[1]], [w[2], 0.0, -w[0]], [-w[1], w[0], 0.0]];
        let rotation = std::array::from_fn(|i| {
            std::array::from_fn(|j| {
                let square: f64 = (0..3).map(|k| cross[i][k] * cross[k][j]).sum();
                f64::from(u8::from(i == j)) + s * cross[i][j] + c * square
            })
        });
        Self { rotation, translation_m: [0.0; 3] }
    }

    /// The rotation as a vector: its direction is the axis, its length the angle in rad.
    pub fn rotation_vector(&self) -> [f64; 3] {
        let r = &self.rotation;
        let sine = [r[2][1] - r[1][2], r[0][2] - r[2][0], r[1][0] - r[0][1]];
        let length = sine.iter().map(|v| v * v).sum::<f64>().sqrt() / 2.0;
        // angle ÷ (2 sin), which is 1/2 for small angles.
        let scale = if length < 1e-9 { 0.5 } else { self.angle_rad() / (2.0 * length) };
        sine.map(|v| v * scale)
    }

    /// The rotation as a unit quaternion: x, y, z, w, with w ≥ 0.
    pub fn quaternion(&self) -> [f64; 4] {
        let half_rad = self.angle_rad() / 2.0;
        let v = self.rotation_vector();
        let length = v.iter().map(|v| v * v).sum::<f64>().sqrt();
        let scale = if length < 1e-9 { 0.5 } else { half_rad.sin() / length };
        let [x, y, z] = v.map(|v| v * scale);
        [x, y, z, (1.0 - x * x - y * y - z * z).max(0.0).sqrt()]
    }

    /// Angle of the rotation, in rad, 0 to π.
    pub fn angle_rad(&self) -> f64 {
        let r = &self.rotation;
        // More accurate than the trace for small angles.
        let sine = [r[2][1] - r[1][2], r[0][2] - r[2][0], r[1][0] - r[0][1]];
        let sine = sine.iter().map(|v| v * v).sum::<f64>().sqrt() / 2.0;
        let cosine = (r[0][0] + r[1][1] + r[2][2] - 1.0) / 2.0;
        sine.atan2(cosine)
    }

    /// Yaw of the camera, in rad, to the left positive: the heading of its z axis in the x-z plane.
    pub fn yaw_rad(&self) -> f64 {
        (-self.rotation[0][2]).atan2(self.rotation[2][2])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn near(a: &Pose, b: &Pose) -> bool {
        let pairs = a.rotation.iter().flatten().zip(b.rotation.iter().flatten());
        let mut pairs = pairs.chain(a.translation_m.iter().zip(&b.translation_m));
        pairs.all(|(a, b)| (a - b).abs() < 1e-12)
    }

    #[test]
    fn transforms_compose_and_invert() {
        let turn = Pose { translation_m: [1.0, -2.0, 3.0], ..Pose::from_rotation_vector([0.1, -0.4, 0.2]) };
        assert!(near(&turn.after(&turn.inverse()), &Pose::IDENTITY));
        assert!(near(&turn.inverse().after(&turn), &Pose::IDENTITY));
        let p = [4.0, 5.0, 6.0];
        let twice = turn.apply(turn.apply(p));
        let composed = turn.after(&turn).apply(p);
        assert!(twice.iter().zip(composed).all(|(a, b)| (a - b).abs() < 1e-12));
        let length = 0.21_f64.sqrt();
        assert!((turn.angle_rad() - length).abs() < 1e-12);
        let small = Pose::from_rotation_vector([1e-6, 0.0, 0.0]);
        assert!((small.angle_rad() - 1e-6).abs() < 1e-15);
    }

    #[test]
    fn a_turn_to_the_left_has_positive_yaw() {
        // Camera to world: y points down, so a positive rotation about it turns z towards x, to the right.
        let left = Pose::from_rotation_vector([0.0, -0.3, 0.0]);
        assert!((left.yaw_rad() - 0.3).abs() < 1e-12);
        assert!(left.rotate([0.0, 0.0, 1.0])[0] < 0.0);
    }
}
