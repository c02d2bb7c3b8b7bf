//! Cameras with lens distortion: projection, undistortion and their derivatives.
//!
//! All models distort the point at which a ray meets the plane z = 1, so a camera sees less than 180 degrees.

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
    /// k1 to k4 of the equidistant model: for fisheye lenses, up to about 160 degrees.
    Fisheye,
}

impl Lens {
    /// Number of parameters of a camera with this lens: pinhole and distortion.
    pub fn parameters(self) -> usize {
        match self {
            Self::Radial2 | Self::Fisheye => 8,
            Self::Radial3 => 9,
            Self::Rational => 12,
        }
    }
}

/// Distortion of a lens. Order and meaning of the coefficients are those of OpenCV.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Distortion {
    /// Brown (1966) and Conrady (1919), with the denominator of the rational model: k1, k2, p1, p2, k3, k4, k5, k6.
    BrownConrady([f64; 8]),
    /// Kannala and Brandt (2006), the equidistant model of ROS and Kalibr and the fisheye model of OpenCV: k1, k2, k3, k4. A ray
    /// at the angle θ to the optical axis has the distance θ·(1 + k1·θ² + k2·θ⁴ + k3·θ⁶ + k4·θ⁸) from the principal
    /// point, in focal lengths.
    Equidistant([f64; 4]),
}

impl Distortion {
    /// No distortion: a pinhole camera.
    pub const NONE: Self = Self::BrownConrady([0.0; 8]);

    /// The coefficients, 8 or 4.
    pub fn coefficients(&self) -> &[f64] {
        match self {
            Self::BrownConrady(k) => k,
            Self::Equidistant(k) => k,
        }
    }
}

/// The equidistant model at the angle θ: distance from the principal point in focal lengths, and its derivative.
fn equidistant(k: &[f64; 4], theta: f64) -> (f64, f64) {
    let t2 = theta * theta;
    let [k1, k2, k3, k4] = *k;
    let distance = theta * (1.0 + t2 * (k1 + t2 * (k2 + t2 * (k3 + t2 * k4))));
    let slope = 1.0 + t2 * (3.0 * k1 + t2 * (5.0 * k2 + t2 * (7.0 * k3 + t2 * 9.0 * k4)));
    (distance, slope)
}

/// A camera with lens distortion. Camera coordinates: x right, y down, z forward.
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
    /// Distortion of its lens.
    pub distortion: Distortion,
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
        Self { fx_px, fy_px, cx_px, cy_px, distortion: Distortion::NONE }
    }

    /// fx, fy, cx, cy and the coefficients of the distortion; the rest is 0.
    pub fn parameters(&self) -> [f64; MAX_PARAMETERS] {
        let mut all = [0.0; MAX_PARAMETERS];
        all[..4].copy_from_slice(&[self.fx_px, self.fy_px, self.cx_px, self.cy_px]);
        let coefficients = self.distortion.coefficients();
        all[4..4 + coefficients.len()].copy_from_slice(coefficients);
        all
    }

    /// A camera with the distortion model of this one and other parameters, in the order of [`Camera::parameters`].
    pub fn with_parameters(&self, p: &[f64; MAX_PARAMETERS]) -> Self {
        let distortion = match self.distortion {
            Distortion::BrownConrady(_) => {
                Distortion::BrownConrady([p[4], p[5], p[6], p[7], p[8], p[9], p[10], p[11]])
            }
            Distortion::Equidistant(_) => Distortion::Equidistant([p[4], p[5], p[6], p[7]]),
        };
        Self { fx_px: p[0], fy_px: p[1], cx_px: p[2], cy_px: p[3], distortion }
    }

    /// The distorted position of a point of the plane z = 1, and its derivative with respect to the point.
    pub fn distort(&self, point: Vector2<f64>) -> (Vector2<f64>, Matrix2<f64>) {
        match &self.distortion {
            Distortion::BrownConrady(k) => Self::distort_brown_conrady(k, point),
            Distortion::Equidistant(k) => Self::distort_equidistant(k, point),
        }
    }

    fn distort_equidistant(k: &[f64; 4], point: Vector2<f64>) -> (Vector2<f64>, Matrix2<f64>) {
        let r = point.norm();
        // Ratio of the distorted to the undistorted distance from the axis, and its derivative over r.
        let (ratio, slope_over_r) = if r < 1e-4 {
            let cubic = k[0] - 1.0 / 3.0;
            (1.0 + cubic * r * r, 2.0 * cubic)
        } else {
            let (distance, slope) = equidistant(k, r.atan());
            (distance / r, (slope / (1.0 + r * r) - distance / r) / (r * r))
        };
        (point * ratio, Matrix2::identity() * ratio + point * point.transpose() * slope_over_r)
    }

    fn distort_brown_conrady(k: &[f64; 8], point: Vector2<f64>) -> (Vector2<f64>, Matrix2<f64>) {
        let (x, y) = (point.x, point.y);
        let [k1, k2, p1, p2, k3, k4, k5, k6] = *k;
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

        let mut by_parameters = ByParameters::zeros();
        by_parameters[(0, 0)] = d.x;
        by_parameters[(1, 1)] = d.y;
        by_parameters[(0, 2)] = 1.0;
        by_parameters[(1, 3)] = 1.0;
        match &self.distortion {
            Distortion::BrownConrady(k) => self.by_brown_conrady(k, (x, y), &mut by_parameters),
            Distortion::Equidistant(_) => {
                let r = x.hypot(y);
                let theta = r.atan();
                // Of the term θ³: x/r is bounded, and the whole vanishes on the axis.
                let mut term = if r > 0.0 { theta.powi(3) / r } else { 0.0 };
                for k in 0..4 {
                    by_parameters[(0, 4 + k)] = fx * x * term;
                    by_parameters[(1, 4 + k)] = fy * y * term;
                    term *= theta * theta;
                }
            }
        }
        Some(Projection { pixel, by_parameters, by_point })
    }

    /// Fills in the derivatives of a pixel with respect to the coefficients, for a point of the plane z = 1.
    fn by_brown_conrady(&self, k: &[f64; 8], (x, y): (f64, f64), by_parameters: &mut ByParameters) {
        let (fx, fy) = (self.fx_px, self.fy_px);
        let [k1, k2, _, _, k3, k4, k5, k6] = *k;
        let r2 = x * x + y * y;
        let (r4, r6) = (r2 * r2, r2 * r2 * r2);
        let below = 1.0 + k4 * r2 + k5 * r4 + k6 * r6;
        let radial = (1.0 + k1 * r2 + k2 * r4 + k3 * r6) / below;
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
    }

    /// The point of the plane z = 1 that a pixel shows, by Newton's method on [`Camera::distort`]. `None` where
    /// the lens model is not invertible (folds over).
    pub fn undistort(&self, pixel: Vector2<f64>) -> Option<Vector2<f64>> {
        let wanted = Vector2::new((pixel.x - self.cx_px) / self.fx_px, (pixel.y - self.cy_px) / self.fy_px);
        if let Distortion::Equidistant(k) = &self.distortion {
            return undistort_equidistant(k, wanted);
        }
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

/// Largest angle to the optical axis that the plane z = 1 represents well, in radians: 89 degrees.
const MAX_ANGLE_RAD: f64 = 1.553;

/// The inverse of the equidistant model; `None` beyond its largest angle, or where it folds over before.
fn undistort_equidistant(k: &[f64; 4], wanted: Vector2<f64>) -> Option<Vector2<f64>> {
    let distance = wanted.norm();
    let mut theta = distance.min(MAX_ANGLE_RAD);
    for _ in 0..30 {
        let (here, slope) = equidistant(k, theta);
        if slope <= 0.05 {
            return None;
        }
        let step = ((distance - here) / slope).clamp(-0.3, 0.3);
        theta += step;
        if step.abs() < 1e-13 {
            break;
        }
    }
    let found = (0.0..=MAX_ANGLE_RAD).contains(&theta) && (equidistant(k, theta).0 - distance).abs() < 1e-9;
    let ratio = if distance > 1e-9 { theta.tan() / distance } else { 1.0 };
    found.then(|| wanted * ratio)
}

#[cfg(test)]
mod tests {
    use super::*;

    const CAMERA: Camera = Camera {
        fx_px: 463.1,
        fy_px: 462.7,
        cx_px: 314.8,
        cy_px: 187.3,
        distortion: Distortion::BrownConrady([-0.28, 0.09, 0.0012, -0.0016, 0.01, 0.02, -0.01, 0.003]),
    };

    const FISHEYE: Camera =
        Camera { distortion: Distortion::Equidistant([-0.02, 0.012, -0.009, 0.002]), ..CAMERA };

    #[test]
    fn derivatives_agree_with_differences() {
        let points =
            [[0.2, -0.1, 0.5], [-0.3, 0.2, 0.7], [0.0, 0.0, 1.0], [3e-5, 4e-5, 1.0]].map(Vector3::from);
        let wide = [CAMERA, FISHEYE].map(|camera| points.map(|point| (camera, point)));
        let wide = wide.concat().into_iter().chain([(FISHEYE, Vector3::new(2.5, -1.5, 1.0))]);
        for (camera, point) in wide {
            let exact = camera.project_with_derivatives(&point).unwrap();
            assert!((exact.pixel - camera.project(&point).unwrap()).norm() < 1e-12);
            for i in 0..MAX_PARAMETERS {
                let at = |step: f64| {
                    let mut p = camera.parameters();
                    p[i] += step;
                    camera.with_parameters(&p).project(&point).unwrap()
                };
                let slope = (at(1e-5) - at(-1e-5)) / 2e-5;
                assert!((slope - exact.by_parameters.column(i)).norm() < 1e-5, "parameter {i}");
            }
            for i in 0..3 {
                let at = |step: f64| {
                    let mut p = point;
                    p[i] += step;
                    camera.project(&p).unwrap()
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
        // A fisheye of 463 px sees 640 px under some 80 degrees; twice as far out nothing folds.
        for pixel in [[314.8, 187.3], [0.0, 0.0], [639.0, 359.0], [-300.0, 187.0]].map(Vector2::from) {
            let ray = FISHEYE.undistort(pixel).unwrap();
            let back = FISHEYE.project(&ray.push(1.0)).unwrap();
            assert!((back - pixel).norm() < 1e-6, "{pixel} {back}");
        }
        assert_eq!(FISHEYE.undistort(Vector2::new(5000.0, 187.0)), None);
        // Strong barrel distortion ends somewhere: beyond it nothing is seen.
        let barrel = Camera {
            distortion: Distortion::BrownConrady([-0.5, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]),
            ..CAMERA
        };
        assert_eq!(barrel.undistort(Vector2::new(5000.0, 187.0)), None);
        assert_eq!(CAMERA.project(&Vector3::new(0.0, 0.0, -1.0)), None);
    }
}
