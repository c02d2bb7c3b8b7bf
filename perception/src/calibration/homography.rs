//! Homographies between a plane and an image, and Zhang's closed form for cameras from homographies.
//!
//! Z. Zhang, "A flexible new technique for camera calibration", IEEE PAMI 22 (11), 2000.

use super::camera::Camera;
use super::pose::Pose;
use nalgebra::{Matrix3, Rotation3, SMatrix, SVector, Vector2, Vector3};

/// The similarity that normalises points to mean zero and mean distance √2.
fn normalisation(points: &[Vector2<f64>]) -> Option<Matrix3<f64>> {
    let n = points.len() as f64;
    let mean = points.iter().sum::<Vector2<f64>>() / n;
    let distance = points.iter().map(|p| (p - mean).norm()).sum::<f64>() / n;
    if !(distance.is_finite() && distance > 0.0) {
        return None;
    }
    let s = std::f64::consts::SQRT_2 / distance;
    Some(Matrix3::new(s, 0.0, -s * mean.x, 0.0, s, -s * mean.y, 0.0, 0.0, 1.0))
}

/// Maps `point` by a homography.
pub fn map(h: &Matrix3<f64>, point: &Vector2<f64>) -> Vector2<f64> {
    let p = h * point.push(1.0);
    Vector2::new(p.x / p.z, p.y / p.z)
}

/// The homography that maps the points `from` to the points `to`, by least squares of the normalised linear
/// equations (DLT); `None` for fewer than four pairs or collinear points.
pub fn fit(from: &[Vector2<f64>], to: &[Vector2<f64>]) -> Option<Matrix3<f64>> {
    if from.len() < 4 || from.len() != to.len() {
        return None;
    }
    let (a, b) = (normalisation(from)?, normalisation(to)?);
    let mut normal = SMatrix::<f64, 9, 9>::zeros();
    for (p, q) in from.iter().zip(to) {
        let (p, q) = (map(&a, p), map(&b, q));
        let rows = [
            SVector::<f64, 9>::from([p.x, p.y, 1.0, 0.0, 0.0, 0.0, -q.x * p.x, -q.x * p.y, -q.x]),
            SVector::<f64, 9>::from([0.0, 0.0, 0.0, p.x, p.y, 1.0, -q.y * p.x, -q.y * p.y, -q.y]),
        ];
        for row in rows {
            normal.ger(1.0, &row, &row, 1.0);
        }
    }
    let eigen = normal.symmetric_eigen();
    let mut order: [usize; 9] = std::array::from_fn(|i| i);
    order.sort_unstable_by(|&i, &j| eigen.eigenvalues[i].total_cmp(&eigen.eigenvalues[j]));
    // Collinear points have more than one solution.
    if eigen.eigenvalues[order[1]] < 1e-9 * eigen.eigenvalues[order[8]] {
        return None;
    }
    let h = eigen.eigenvectors.column(order[0]);
    let h = Matrix3::new(h[0], h[1], h[2], h[3], h[4], h[5], h[6], h[7], h[8]);
    let h = b.try_inverse()? * h * a;
    (h[(2, 2)].abs() > 1e-15).then(|| h / h[(2, 2)]).filter(|h| h.iter().all(|v| v.is_finite()))
}

/// Points from which another one is predicted.
const NEAREST: usize = 12;

/// Where `point` lies in the image, by the homography of the nearest points of the plane that are known there: a wide-angle lens
/// bends what is farther away.
pub fn predict(
    points: &[Vector2<f64>],
    places: &[Option<Vector2<f64>>],
    point: &Vector2<f64>,
) -> Option<Vector2<f64>> {
    let mut known: Vec<_> =
        points.iter().zip(places).filter_map(|(p, place)| Some((*p, (*place)?))).collect();
    known.sort_by(|a, b| (a.0 - point).norm_squared().total_cmp(&(b.0 - point).norm_squared()));
    known.truncate(NEAREST);
    let (from, to): (Vec<_>, Vec<_>) = known.into_iter().unzip();
    Some(map(&fit(&from, &to)?, point))
}

/// The row of Zhang's equations for columns i and j of a homography, without skew: coefficients of
/// B11, B22, B13, B23 and B33.
fn equation(h: &Matrix3<f64>, i: usize, j: usize) -> SVector<f64, 5> {
    let (a, b) = (h.column(i), h.column(j));
    SVector::<f64, 5>::from([
        a[0] * b[0],
        a[1] * b[1],
        a[0] * b[2] + a[2] * b[0],
        a[1] * b[2] + a[2] * b[1],
        a[2] * b[2],
    ])
}

/// Whether the focal lengths and the principal point of a start value are plausible for the image size.
fn plausible(camera: &Camera, width: f64, height: f64) -> bool {
    let size = width.max(height);
    let focal = 0.2 * size..20.0 * size;
    focal.contains(&camera.fx_px)
        && focal.contains(&camera.fy_px)
        && (0.5..2.0).contains(&(camera.fx_px / camera.fy_px))
        && (camera.cx_px - width / 2.0).abs() < 0.3 * width
        && (camera.cy_px - height / 2.0).abs() < 0.3 * height
}

/// Start values for cameras with images of `width` × `height` pixels: from the equations for focal lengths and
/// principal point, and from those for focal lengths alone with the principal point at the centre, which are
/// robust to few or similar views. Implausible ones are dropped; typical focal lengths follow at the end.
pub fn starts(homographies: &[Matrix3<f64>], width: usize, height: usize) -> Vec<Camera> {
    let (width, height) = (width as f64, height as f64);
    let (middle_x, middle_y) = (0.5 * (width - 1.0), 0.5 * (height - 1.0));
    let scale = 0.5 * width.max(height);
    // Pixels relative to the centre, in units of half the image size.
    let small =
        Matrix3::new(1.0 / scale, 0.0, -middle_x / scale, 0.0, 1.0 / scale, -middle_y / scale, 0.0, 0.0, 1.0);
    let mut all = SMatrix::<f64, 5, 5>::zeros();
    let (mut focal, mut focal_right) = (SMatrix::<f64, 2, 2>::zeros(), Vector2::zeros());
    for h in homographies {
        let mut h = small * h;
        // Equal weight for all views.
        h /= (h.column(0).norm() * h.column(1).norm()).sqrt().max(1e-12);
        for row in [equation(&h, 0, 1), equation(&h, 0, 0) - equation(&h, 1, 1)] {
            all.ger(1.0, &row, &row, 1.0);
            let f = Vector2::new(row[0], row[1]);
            focal.ger(1.0, &f, &f, 1.0);
            focal_right -= f * row[4];
        }
    }
    let mut found = Vec::new();
    if homographies.len() >= 3 {
        let eigen = all.symmetric_eigen();
        let b = eigen.eigenvectors.column(eigen.eigenvalues.imin()).into_owned();
        let b = if b[0] < 0.0 { -b } else { b };
        let (cx, cy) = (-b[2] / b[0], -b[3] / b[1]);
        let lambda = b[4] - b[0] * cx * cx - b[1] * cy * cy;
        let (fx, fy) = ((lambda / b[0]).sqrt(), (lambda / b[1]).sqrt());
        found.push(Camera::pinhole(fx * scale, fy * scale, cx * scale + middle_x, cy * scale + middle_y));
    }
    if let Some(inverse) = focal.try_inverse() {
        let f = inverse * focal_right;
        found.push(Camera::pinhole(scale / f[0].sqrt(), scale / f[1].sqrt(), middle_x, middle_y));
        // A single focal length, which even a few tilted views determine.
        let ones = Vector2::new(1.0, 1.0);
        let joint = ones.dot(&focal_right) / (ones.transpose() * focal * ones)[0];
        let f = scale / joint.sqrt();
        found.push(Camera::pinhole(f, f, middle_x, middle_y));
    }
    found.retain(|camera| plausible(camera, width, height));
    // Strong distortion breaks the linear equations; least squares also converges from typical focal lengths.
    for f in [1.0, 0.6, 2.0] {
        let f = f * width.max(height);
        found.push(Camera::pinhole(f, f, middle_x, middle_y));
    }
    found
}

/// The pose of a homography's plane (z = 0) relative to a camera without distortion, in the unit of the
/// homography's points.
pub fn pose(h: &Matrix3<f64>, camera: &Camera) -> Option<Pose> {
    let inverse = Matrix3::new(
        1.0 / camera.fx_px,
        0.0,
        -camera.cx_px / camera.fx_px,
        0.0,
        1.0 / camera.fy_px,
        -camera.cy_px / camera.fy_px,
        0.0,
        0.0,
        1.0,
    );
    let m = inverse * h;
    let mut scale = 2.0 / (m.column(0).norm() + m.column(1).norm());
    // The plane lies in front of the camera.
    if m[(2, 2)] < 0.0 {
        scale = -scale;
    }
    let (x, y): (Vector3<f64>, Vector3<f64>) = (m.column(0) * scale, m.column(1) * scale);
    let near = Matrix3::from_columns(&[x, y, x.cross(&y)]);
    let svd = near.svd(true, true);
    let (u, v) = (svd.u?, svd.v_t?);
    let turn = u * Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, (u * v).determinant().signum())) * v;
    let pose = Pose {
        rotation: Rotation3::from_matrix_unchecked(turn),
        translation_m: (m.column(2) * scale).into_owned(),
    };
    (pose.translation_m.iter().all(|v| v.is_finite()) && turn.iter().all(|v| v.is_finite())).then_some(pose)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Points of a board, and how a camera sees it under some tilts.
    fn views(camera: &Camera) -> Vec<(Pose, Matrix3<f64>)> {
        let board: Vec<Vector2<f64>> =
            (0..54).map(|i| Vector2::new(f64::from(i % 9) * 0.025, f64::from(i / 9) * 0.025)).collect();
        [(0.4, 0.1, 0.0), (-0.3, 0.4, 0.2), (0.1, -0.5, -0.1), (0.3, 0.3, 1.2), (-0.5, -0.2, 0.5)]
            .map(|(x, y, z)| {
                let pose = Pose {
                    rotation: Rotation3::new(Vector3::new(x, y, z)),
                    translation_m: Vector3::new(-0.1, -0.05, 0.5),
                };
                let seen: Vec<_> =
                    board.iter().map(|p| camera.project(&pose.apply(&p.push(0.0))).unwrap()).collect();
                (pose, fit(&board, &seen).unwrap())
            })
            .to_vec()
    }

    #[test]
    fn exact_views_give_camera_and_poses() {
        let camera = Camera::pinhole(463.0, 458.0, 330.0, 170.0);
        let views = views(&camera);
        let homographies: Vec<_> = views.iter().map(|v| v.1).collect();
        let start = starts(&homographies, 640, 360)[0];
        for (a, b) in start.parameters().iter().zip(camera.parameters()) {
            assert!((a - b).abs() < 1e-4, "{start:?}");
        }
        for (expected, h) in &views {
            let pose = pose(h, &camera).unwrap();
            assert!((pose.rotation_vector() - expected.rotation_vector()).norm() < 1e-6);
            assert!((pose.translation_m - expected.translation_m).norm() < 1e-6);
        }
        // Two views give focal lengths, with the principal point in the middle.
        let few = starts(&homographies[..2], 640, 360)[0];
        assert!((few.fx_px - 463.0).abs() < 60.0, "{few:?}");
    }

    #[test]
    fn degenerate_points_give_nothing() {
        let line: Vec<_> = (0..9).map(|i| Vector2::new(f64::from(i), 2.0 * f64::from(i))).collect();
        assert_eq!(fit(&line, &line), None);
        assert_eq!(fit(&line[..3], &line[..3]), None);
        let same = vec![Vector2::new(1.0, 1.0); 9];
        assert_eq!(fit(&same, &same), None);
        assert_eq!(starts(&[], 640, 360).len(), 3);
    }
}
