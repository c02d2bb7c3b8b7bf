//! Conversion of a disparity map to a metric point cloud (pseudo-LiDAR; paper, section 4.3).
//!
//! A point at column u, row v with disparity d lies at z = f·B/d, x = (u − cx)·z/f, y = (v − cy)·z/f: x to
//! the right, y down, z ahead of the left camera. Outliers are removed by the number of neighbours with a
//! similar disparity.

use crate::rig::Rig;
use crate::stereo::DisparityView;

/// x, y, z in metres and the grey level (0 to 255), in this order: a slice of points can be cast to a slice
/// of `f32`, the layout of point-cloud formats.
pub type Point = [f32; 4];

/// Radius of the neighbourhood in px: 5 × 5 with 24 neighbours.
const NEIGHBOUR_RADIUS: usize = 2;

/// Selection of points.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PointCloudParameters {
    /// Sampling step in columns and rows; at least 1.
    pub step: usize,
    /// Largest distance, in metres.
    pub max_distance_m: f64,
    /// Smallest number of the 24 neighbours with a similar disparity; a point with fewer is an outlier. The
    /// corner of a flat object has 8; a one-pixel wide bridge between near and far surfaces has fewer.
    pub min_neighbours: usize,
    /// Largest disparity difference of a similar neighbour, as a share of the disparity,
    pub tolerance_share: f64,
    /// with these lower and upper bounds, in px.
    pub tolerance_px: (f64, f64),
}

impl Default for PointCloudParameters {
    fn default() -> Self {
        Self {
            step: 1,
            max_distance_m: 80.0,
            min_neighbours: 8,
            tolerance_share: 0.15,
            tolerance_px: (0.25, 1.0),
        }
    }
}

/// Numbers of pixels by result.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct PointCounts {
    /// Points written.
    pub points: usize,
    /// Pixels without disparity.
    pub unknown: usize,
    /// Pixels beyond the largest distance.
    pub far: usize,
    /// Outliers.
    pub outliers: usize,
}

/// Replaces the content of `out` by the points of a map, row by row. `grey` is the left image; points beyond
/// its end are black.
pub fn fill(
    disparity: DisparityView<'_>,
    grey: &[u8],
    rig: &Rig,
    parameters: &PointCloudParameters,
    out: &mut Vec<Point>,
) -> PointCounts {
    out.clear();
    let mut counts = PointCounts::default();
    let step = parameters.step.max(1);
    let width = disparity.width();
    let min_px = rig.disparity_px(parameters.max_distance_m);
    for y in (0..disparity.height()).step_by(step) {
        for (x, &d) in disparity.row(y).iter().enumerate().step_by(step) {
            let px = f64::from(d) / 256.0;
            if d == 0 {
                counts.unknown += 1;
            } else if px < min_px {
                counts.far += 1;
            } else if !is_supported(disparity, x, y, parameters) {
                counts.outliers += 1;
            } else {
                let z = rig.distance_m(px);
                let down = (y as f64 - rig.cy_px) * z / rig.focal_px;
                let level = grey.get(y * width + x).copied().unwrap_or(0);
                out.push([rig.lateral_m(x as f64, z) as f32, down as f32, z as f32, f32::from(level)]);
            }
        }
    }
    counts.points = out.len();
    counts
}

/// Whether enough neighbours have a disparity similar to that of the pixel.
fn is_supported(disparity: DisparityView<'_>, x: usize, y: usize, parameters: &PointCloudParameters) -> bool {
    let middle = disparity.row(y)[x];
    let (least, most) = parameters.tolerance_px;
    let tolerance_px = (f64::from(middle) / 256.0 * parameters.tolerance_share).clamp(least, most.max(least));
    let tolerance = (tolerance_px * 256.0) as u16;
    let columns = x.saturating_sub(NEIGHBOUR_RADIUS)..(x + NEIGHBOUR_RADIUS + 1).min(disparity.width());
    // The pixel itself is counted as well.
    let needed = parameters.min_neighbours + 1;
    let mut found = 0;
    for row in y.saturating_sub(NEIGHBOUR_RADIUS)..(y + NEIGHBOUR_RADIUS + 1).min(disparity.height()) {
        let neighbours = &disparity.row(row)[columns.clone()];
        found += neighbours.iter().filter(|&&d| d > 0 && d.abs_diff(middle) <= tolerance).count();
        if found >= needed {
            return true;
        }
    }
    false
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Matrix3, Vector3};

    const RIG: Rig = Rig { focal_px: 500.0, baseline_m: 0.3, cx_px: 160.0, cy_px: 100.0 };
    const SIZE: (usize, usize) = (320, 240);
    const CAMERA_HEIGHT_M: f64 = 1.5;

    /// A flat road with a plate 12 m ahead, and a little noise.
    fn road_and_plate() -> Vec<u16> {
        let mut random = fastrand::Rng::with_seed(3);
        let plate = RIG.disparity_px(12.0);
        (0..SIZE.0 * SIZE.1)
            .map(|i| {
                let (x, y) = ((i % SIZE.0) as f64, (i / SIZE.0) as f64);
                let road = RIG.baseline_m / CAMERA_HEIGHT_M * (y - RIG.cy_px);
                let on_plate = (130.0..200.0).contains(&x) && (110.0..162.0).contains(&y);
                let d = if on_plate { plate } else { road };
                let noise = f64::from(random.f32()) * 0.1 - 0.05;
                if d > 1.0 { ((d + noise) * 256.0) as u16 } else { 0 }
            })
            .collect()
    }

    fn cloud(map: &[u16], parameters: &PointCloudParameters) -> (Vec<Point>, PointCounts) {
        let grey: Vec<u8> = (0..map.len()).map(|i| (i % 251) as u8).collect();
        let mut out = Vec::new();
        let view = DisparityView::new(map, SIZE.0, SIZE.1).unwrap();
        let counts = fill(view, &grey, &RIG, parameters, &mut out);
        (out, counts)
    }

    #[test]
    fn the_road_is_a_plane_at_the_height_of_the_camera() {
        let map = road_and_plate();
        let (points, counts) = cloud(&map, &PointCloudParameters::default());
        assert_eq!(counts.points, points.len());
        let all = counts.points + counts.unknown + counts.far + counts.outliers;
        assert_eq!(all, SIZE.0 * SIZE.1);
        let known = map.iter().filter(|&&d| d > 0).count();
        assert!(counts.points as f64 > 0.99 * (known - counts.far) as f64, "{counts:?}");
        // Least squares: y = a + b·x + c·z over the road.
        let (mut normal, mut right) = (Matrix3::<f64>::zeros(), Vector3::zeros());
        for &[x, y, z, _] in points.iter().filter(|p| p[1] > 1.2 && p[2] < 30.0) {
            let row = Vector3::new(1.0, f64::from(x), f64::from(z));
            normal += row * row.transpose();
            right += row * f64::from(y);
        }
        let plane = normal.cholesky().expect("enough points").solve(&right);
        assert!((plane[0] - CAMERA_HEIGHT_M).abs() < 0.01, "{plane}");
        assert!(plane[1].abs() < 0.001 && plane[2].abs() < 0.001, "{plane}");
        // The plate has its true distance and width.
        let plate: Vec<&Point> = points.iter().filter(|p| p[1] < 1.0 && (p[2] - 12.0).abs() < 0.5).collect();
        let left = plate.iter().map(|p| p[0]).fold(f32::MAX, f32::min);
        let wide = plate.iter().map(|p| p[0]).fold(f32::MIN, f32::max) - left;
        assert!(plate.len() > 2000 && (wide - 69.0 * 12.0 / 500.0).abs() < 0.05, "{} {wide}", plate.len());
    }

    #[test]
    fn outliers_and_bridges_are_removed() {
        let clean = road_and_plate();
        let mut map = clean.clone();
        let mut random = fastrand::Rng::with_seed(9);
        let mut wrong = Vec::new();
        for _ in 0..60 {
            let at = random.usize(120..230) * SIZE.0 + random.usize(210..310);
            // Outliers are not adjacent.
            if wrong.iter().all(|&other: &usize| at.abs_diff(other) > 6 * SIZE.0) {
                map[at] = 40 * 256;
                wrong.push(at);
            }
        }
        // A bridge: a column with disparities half-way between the plate and the road behind it.
        for y in 112..150 {
            let (near, far) = (map[y * SIZE.0 + 199], map[y * SIZE.0 + 201]);
            map[y * SIZE.0 + 200] = near / 2 + far / 2;
        }
        let (points, counts) = cloud(&map, &PointCloudParameters::default());
        assert!(wrong.len() > 5 && counts.outliers >= wrong.len(), "{counts:?}");
        assert!(
            points.iter().all(|p| (p[2] - RIG.distance_m(40.0) as f32).abs() > 0.01),
            "an outlier is left"
        );
        let column = 200.0_f32;
        let bridge = |p: &&Point| {
            let u = p[0] * RIG.focal_px as f32 / p[2] + RIG.cx_px as f32;
            (u - column).abs() < 0.01 && p[1] < 1.4 && p[2] > 13.0 && p[2] < 25.0
        };
        let kept = points.iter().filter(bridge).count();
        let all = PointCloudParameters { min_neighbours: 0, ..PointCloudParameters::default() };
        let (everything, counts) = cloud(&map, &all);
        assert_eq!(counts.outliers, 0);
        assert!(everything.iter().filter(bridge).count() > 20 && kept < 4, "{kept} of the bridge are left");
    }

    #[test]
    fn step_distance_limit_and_grey_levels_are_applied() {
        let map = road_and_plate();
        let sparse = PointCloudParameters { step: 4, max_distance_m: 20.0, ..Default::default() };
        let (points, counts) = cloud(&map, &sparse);
        assert!(points.iter().all(|p| p[2] <= 20.0) && counts.far > 0);
        let (dense, _) = cloud(&map, &PointCloudParameters { max_distance_m: 20.0, ..Default::default() });
        let share = dense.len() as f64 / points.len() as f64;
        assert!((14.0..18.0).contains(&share), "{share}");
        let [x, y, z, grey] = points[0];
        let column = (f64::from(x) * RIG.focal_px / f64::from(z) + RIG.cx_px).round() as usize;
        let row = (f64::from(y) * RIG.focal_px / f64::from(z) + RIG.cy_px).round() as usize;
        assert_eq!(grey, ((row * SIZE.0 + column) % 251) as f32);
        // No disparity at all, and only the largest one.
        assert_eq!(cloud(&[0; 320 * 240], &sparse).1.unknown, 60 * 80);
        let (none, _) = cloud(&[u16::MAX; 320 * 240], &PointCloudParameters { step: 0, ..sparse });
        assert_eq!(none.len(), 320 * 240, "a wall in front of the lens is a wall");
    }
}
