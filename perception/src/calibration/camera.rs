//! Pinhole cameras with lens distortion: projection, undistortion and their derivatives.

use nalgebra::{Matrix2, Matrix2x3, SMatrix, Vector2, Vector3};

/// Maximum number of parameters of a camera: 4 of the pinhole, 8 of the lens.
pub const MAX_PARAMETERS: usize = 12;

/// Derivatives of a pixel with respect to all parameters, in the order of [`Camera::parameters`].
pub type ByParameters = SMatrix<f64, 2, MAX_PARAMETERS>;

/// The distortion coefficients that are estimated; the others are zero.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Lens {
    /// k1, k2, p1, p2: enough for most lenses below 90 degrees.
    #[default]
    Radial2,
    /// k1, k2, p1, p2, k3.
    Radial3,
    /// k1, k2, p1, p2, k3 and the denominator k4, k5, k6: for wide-angle lenses; needs many good views.
    Rational,
}

impl Lens {
    /// Number of parameters of a camera with this lens: pinhole and distortion.
    pub fn parameters(self) -> usize {
        match self {
            Self::Radial2 => 8,
            Self::Radial3 => 9,
            Self::Rational => 12,
        }
    }
}

/// A pinhole camera with lens distortion (Brown–Conrady, optionally rational; order and meaning of the
/// coefficients as in OpenCV). Camera coordinates: x right, y down, z forward.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Camera {
    /// Focal length along x, in pixels.
    pub fx_px: f64,
    /// Focal length along y, in pixels.
    pub fy_px: f64,
    /// Column of the principal point, in pixels; the centre of the first pixel is 0.
    pub cx_px: f64,
    /// Row of the principal point, in pixels.
    pub cy_px: f64,
    /// k1, k2, p1, p2, k3, k4, k5, k6.
    pub distortion: [f64; 8],
}

/// A projected pixel with its derivatives.
#[derive(Clone, Copy, Debug)]
pub struct Projection {
    /// Column and row, in pixels.
    pub pixel: Vector2<f64>,
    /// With respect to the parameters of the camera.
    pub by_parameters: ByParameters,
    /// With respect to the point.
    pub by_point: Matrix2x3<f64>,
}

impl Camera {
    /// A camera without distortion.
    pub fn pinhole(fx_px: f64, fy_px: f64, cx_px: f64, cy_px: f64) -> Self {
        Self { fx_px, fy_px, cx_px, cy_px, distortion: [0.0; 8] }
    }

    /// fx, fy, cx, cy, k1, k2, p1, p2, k3, k4, k5, k6.
    pub fn parameters(&self) -> [f64; MAX_PARAMETERS] {
        let d = &self.distortion;
        [self.fx_px, self.fy_px, self.cx_px, self.cy_px, d[0], d[1], d[2], d[3], d[4], d[5], d[6], d[7]]
    }

    /// The camera with these parameters, in the order of [`Camera::parameters`].
    pub fn from_parameters(p: &[f64; MAX_PARAMETERS]) -> Self {
        Self {
            fx_px: p[0],
            fy_px: p[1],
            cx_px: p[2],
            cy_px: p[3],
            distortion: [p[4], p[5], p[6], p[7], p[8], p[9], p[10], p[11]],
        }
    }

    /// The distorted position of a point of the plane z = 1, and its derivative with respect to the point.
    pub fn distort(&self, point: Vector2<f64>) -> (Vector2<f64>, Matrix2<f64>) {
        let (x, y) = (point.x, point.y);
        let [k1, k2, p1, p2, k3, k4, k5, k6] = self.distortion;
        let r2 = x * x + y * y;
        let above = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3));
        let below = 1.0 + r2 * (k4 + r2 * (k5 + r2 * k6));
        let radial = above / below;
        // Derivatives with respect to r².
        let above_slope = k1 + r2 * (2.0 * k2 + r2 * 3.0 * k3);
        let below_slope = k4 + r2 * (2.0 * k5 + r2 * 3.0 * k6);
        let slope = (above_slope - radial * below_slope) / below;
        let distorted = Vector2::new(
            x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x),
            y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y,
        );
        let cross = 2.0 * (x * y * slope + p1 * x + p2 * y);
        let by_point = Matrix2::new(
            radial + 2.0 * x * x * slope + 2.0 * p1 * y + 6.0 * p2 * x,
            cross,
            cross,
            radial + 2.0 * y * y * slope + 6.0 * p1 * y + 2.0 * p2 * x,
        );
        (distorted, by_point)
    }

    /// Projects a point in camera coordinates; `None` if it is not in front of the camera.
    pub fn project(&self, point: &Vector3<f64>) -> Option<Vector2<f64>> {
        if point.z <= 1e-9 {
            return None;
        }
        let (d, _) = self.distort(Vector2::new(point.x / point.z, point.y / point.z));
        Some(Vector2::new(self.fx_px * d.x + self.cx_px, self.fy_px * d.y + self.cy_px))
    }

    /// Projects a point and computes the derivatives; `None` if it is not in front of the camera.
    pub fn project_with_derivatives(&self, point: &Vector3<f64>) -> Option<Projection> {
        if point.z <= 1e-9 {
            return None;
        }
        let inverse = 1.0 / point.z;
        let (x, y) = (point.x * inverse, point.y * inverse);
        let (d, by_plane) = self.distort(Vector2::new(x, y));
        let (fx, fy) = (self.fx_px, self.fy_px);
        let pixel = Vector2::new(fx * d.x + self.cx_px, fy * d.y + self.cy_px);
        let plane_by_point = Matrix2x3::new(inverse, 0.0, -x * inverse, 0.0, inverse, -y * inverse);
        let mut by_point = by_plane * plane_by_point;
        by_point.row_mut(0).scale_mut(fx);
        by_point.row_mut(1).scale_mut(fy);

        let [k1, k2, _, _, k3, k4, k5, k6] = self.distortion;
        let r2 = x * x + y * y;
        let (r4, r6) = (r2 * r2, r2 * r2 * r2);
        let below = 1.0 + k4 * r2 + k5 * r4 + k6 * r6;
        let radial = (1.0 + k1 * r2 + k2 * r4 + k3 * r6) / below;
        let mut by_parameters = ByParameters::zeros();
        by_parameters[(0, 0)] = d.x;
        by_parameters[(1, 1)] = d.y;
        by_parameters[(0, 2)] = 1.0;
        by_parameters[(1, 3)] = 1.0;
        for (row, f, along) in [(0, fx, x), (1, fy, y)] {
            let numerator = f * along / below;
            let denominator = -numerator * radial;
            by_parameters[(row, 4)] = numerator * r2;
            by_parameters[(row, 5)] = numerator * r4;
            by_parameters[(row, 8)] = numerator * r6;
            by_parameters[(row, 9)] = denominator * r2;
            by_parameters[(row, 10)] = denominator * r4;
            by_parameters[(row, 11)] = denominator * r6;
        }
        by_parameters[(0, 6)] = fx * 2.0 * x * y;
        by_parameters[(1, 6)] = fy * (r2 + 2.0 * y * y);
        by_parameters[(0, 7)] = fx * (r2 + 2.0 * x * x);
        by_parameters[(1, 7)] = fy * 2.0 * x * y;
        Some(Projection { pixel, by_parameters, by_point })
    }

    /// The point of the plane z = 1 that a pixel shows, by Newton's method on [`Camera::distort`]. `None` where
    /// the lens model is not invertible (folds over).
    pub fn undistort(&self, pixel: Vector2<f64>) -> Option<Vector2<f64>> {
        let wanted = Vector2::new((pixel.x - self.cx_px) / self.fx_px, (pixel.y - self.cy_px) / self.fy_px);
        let mut point = wanted;
        for _ in 0..30 {
            let (seen, slope) = self.distort(point);
            if slope.determinant() <= 0.05 {
                return None;
            }
            let mut step = slope.try_inverse()? * (wanted - seen);
            // Limit the step, so that it does not jump over the fold.
            let longest = 0.3 * (1.0 + point.norm());
            if step.norm() > longest {
                step *= longest / step.norm();
            }
            point += step;
            if step.norm() < 1e-12 {
                break;
            }
        }
        ((self.distort(point).0 - wanted).norm() < 1e-8).then_some(point)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const CAMERA: Camera = Camera {
        fx_px: 463.1,
        fy_px: 462.7,
        cx_px: 314.8,
        cy_px: 187.3,
        distortion: [-0.28, 0.09, 0.0012, -0.0016, 0.01, 0.02, -0.01, 0.003],
    };

    #[test]
    fn derivatives_agree_with_differences() {
        for point in [Vector3::new(0.2, -0.1, 0.5), Vector3::new(-0.3, 0.2, 0.7), Vector3::new(0.0, 0.0, 1.0)]
        {
            let exact = CAMERA.project_with_derivatives(&point).unwrap();
            assert!((exact.pixel - CAMERA.project(&point).unwrap()).norm() < 1e-12);
            for i in 0..MAX_PARAMETERS {
                let at = |step: f64| {
                    let mut p = CAMERA.parameters();
                    p[i] += step;
                    Camera::from_parameters(&p).project(&point).unwrap()
                };
                let slope = (at(1e-5) - at(-1e-5)) / 2e-5;
                assert!((slope - exact.by_parameters.column(i)).norm() < 1e-5, "parameter {i}");
            }
            for i in 0..3 {
                let at = |step: f64| {
                    let mut p = point;
                    p[i] += step;
                    CAMERA.project(&p).unwrap()
                };
                let slope = (at(1e-6) - at(-1e-6)) / 2e-6;
                assert!((slope - exact.by_point.column(i)).norm() < 1e-4, "coordinate {i}");
            }
        }
    }

    #[test]
    fn undistorting_inverts_the_lens() {
        for y in [0.0, 100.0, 359.0] {
            for x in [0.0, 250.0, 639.0] {
                let pixel = Vector2::new(x, y);
                let ray = CAMERA.undistort(pixel).unwrap();
                let back = CAMERA.project(&Vector3::new(ray.x, ray.y, 1.0)).unwrap();
                assert!((back - pixel).norm() < 1e-6, "{pixel} {back}");
            }
        }
        // Strong barrel distortion ends somewhere: beyond it nothing is seen.
        let barrel = Camera { distortion: [-0.5, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0], ..CAMERA };
        assert_eq!(barrel.undistort(Vector2::new(5000.0, 187.0)), None);
        assert_eq!(CAMERA.project(&Vector3::new(0.0, 0.0, -1.0)), None);
    }
}
