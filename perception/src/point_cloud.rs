//! From disparity to metric points (pseudo-LiDAR; paper, section 4.3).
//!
//! A point at column u, row v with disparity d lies at z = f·B/d, x = (u − cx)·z/f, y = (v − cy)·z/f: x to
//! the right, y down, z ahead of the left camera.

use crate::rig::Rig;
use crate::stereo::DisparityView;

/// x, y, z in metres and the grey level (0 to 255): four values in this order, so that a slice of points
/// is also a slice of `f32` as point-cloud formats have it.
pub type Point = [f32; 4];

/// Pixels from the one that is judged to the border of its neighbourhood: 5 × 5 with 24 neighbours.
const REACH: usize = 2;

/// Which points are taken.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PointCloudParameters {
    /// Every how many columns and rows a point is taken; at least 1.
    pub every: usize,
    /// Farther points are left out, in metres.
    pub distance_max_m: f64,
    /// Neighbours of 24 that have to agree in disparity; with fewer a point is an outlier. 8 is what the
    /// corner of a flat thing has, and more than a veil one pixel wide between near and far.
    pub neighbours_min: usize,
    /// How far a neighbour's disparity may differ: this share of it,
    pub tolerance_share: f64,
    /// but at least and at most this much, in px.
    pub tolerance_px: (f64, f64),
}

impl Default for PointCloudParameters {
    fn default() -> Self {
        Self {
            every: 1,
            distance_max_m: 80.0,
            neighbours_min: 8,
            tolerance_share: 0.15,
            tolerance_px: (0.25, 1.0),
        }
    }
}

/// What became of the pixels that were looked at.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Tally {
    /// Points written.
    pub points: usize,
    /// Pixels without disparity.
    pub unknown: usize,
    /// Pixels beyond the greatest distance.
    pub far: usize,
    /// Outliers.
    pub outliers: usize,
}

/// Clears `out` and writes the points of a map into it, row after row; it grows to the largest cloud that
/// it has held and no further. `grey` is the left image; points beyond its end are black.
pub fn fill(
    disparity: DisparityView<'_>,
    grey: &[u8],
    rig: &Rig,
    parameters: &PointCloudParameters,
    out: &mut Vec<Point>,
) -> Tally {
    out.clear();
    let mut tally = Tally::default();
    let every = parameters.every.max(1);
    let width = disparity.width();
    let min_px = rig.disparity_px(parameters.distance_max_m);
    for y in (0..disparity.height()).step_by(every) {
        for (x, &d) in disparity.row(y).iter().enumerate().step_by(every) {
            let px = f64::from(d) / 256.0;
            if d == 0 {
                tally.unknown += 1;
            } else if px < min_px {
                tally.far += 1;
            } else if !agrees(disparity, x, y, parameters) {
                tally.outliers += 1;
            } else {
                let z = rig.distance_m(px);
                let down = (y as f64 - rig.cy_px) * z / rig.focal_px;
                let level = grey.get(y * width + x).copied().unwrap_or(0);
                out.push([rig.lateral_m(x as f64, z) as f32, down as f32, z as f32, f32::from(level)]);
            }
        }
    }
    tally.points = out.len();
    tally
}

/// Whether enough neighbours lie at the depth of a pixel.
fn agrees(disparity: DisparityView<'_>, x: usize, y: usize, parameters: &PointCloudParameters) -> bool {
    let middle = disparity.row(y)[x];
    let (least, most) = parameters.tolerance_px;
    let tolerance_px = (f64::from(middle) / 256.0 * parameters.tolerance_share).clamp(least, most.max(least));
    let tolerance = (tolerance_px * 256.0) as u16;
    let columns = x.saturating_sub(REACH)..(x + REACH + 1).min(disparity.width());
    // The pixel agrees with itself.
    let needed = parameters.neighbours_min + 1;
    let mut found = 0;
    for row in y.saturating_sub(REACH)..(y + REACH + 1).min(disparity.height()) {
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

    /// A flat road with a plate 12 m ahead, with a little noise.
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

    fn cloud(map: &[u16], parameters: &PointCloudParameters) -> (Vec<Point>, Tally) {
        let grey: Vec<u8> = (0..map.len()).map(|i| (i % 251) as u8).collect();
        let mut out = Vec::new();
        let view = DisparityView::new(map, SIZE.0, SIZE.1).unwrap();
        let tally = fill(view, &grey, &RIG, parameters, &mut out);
        (out, tally)
    }

    #[test]
    fn the_road_is_a_plane_at_the_height_of_the_camera() {
        let map = road_and_plate();
        let (points, tally) = cloud(&map, &PointCloudParameters::default());
        assert_eq!(tally.points, points.len());
        let all = tally.points + tally.unknown + tally.far + tally.outliers;
        assert_eq!(all, SIZE.0 * SIZE.1);
        let known = map.iter().filter(|&&d| d > 0).count();
        assert!(tally.points as f64 > 0.99 * (known - tally.far) as f64, "{tally:?}");
        // Least squares: y = a + b·x + c·z over the road.
        let (mut normal, mut right) = (Matrix3::<f64>::zeros(), Vector3::zeros());
        for &[x, y, z, _] in points.iter().filter(|p| p[1] > 1.2 && p[2] < 30.0) {
            let row = Vector3::new(1.0, f64::from(x), f64::from(z));
            normal += row * row.transpose();
            right += row * f64::from(y);
        }
        let plane = normal.cholesky().expect("points enough").solve(&right);
        assert!((plane[0] - CAMERA_HEIGHT_M).abs() < 0.01, "{plane}");
        assert!(plane[1].abs() < 0.001 && plane[2].abs() < 0.001, "{plane}");
        // The plate stands at its distance, as wide as it is.
        let plate: Vec<&Point> = points.iter().filter(|p| p[1] < 1.0 && (p[2] - 12.0).abs() < 0.5).collect();
        let left = plate.iter().map(|p| p[0]).fold(f32::MAX, f32::min);
        let wide = plate.iter().map(|p| p[0]).fold(f32::MIN, f32::max) - left;
        assert!(plate.len() > 2000 && (wide - 69.0 * 12.0 / 500.0).abs() < 0.05, "{} {wide}", plate.len());
    }

    #[test]
    fn single_errors_and_veils_are_left_out() {
        let clean = road_and_plate();
        let mut map = clean.clone();
        let mut random = fastrand::Rng::with_seed(9);
        let mut wrong = Vec::new();
        for _ in 0..60 {
            let at = random.usize(120..230) * SIZE.0 + random.usize(210..310);
            // Never beside one another.
            if wrong.iter().all(|&other: &usize| at.abs_diff(other) > 6 * SIZE.0) {
                map[at] = 40 * 256;
                wrong.push(at);
            }
        }
        // A veil: a column half way between the plate and the road behind it.
        for y in 112..150 {
            let (near, far) = (map[y * SIZE.0 + 199], map[y * SIZE.0 + 201]);
            map[y * SIZE.0 + 200] = near / 2 + far / 2;
        }
        let (points, tally) = cloud(&map, &PointCloudParameters::default());
        assert!(wrong.len() > 5 && tally.outliers >= wrong.len(), "{tally:?}");
        assert!(points.iter().all(|p| (p[2] - RIG.distance_m(40.0) as f32).abs() > 0.01), "an error is left");
        let column = 200.0_f32;
        let veil = |p: &&Point| {
            let u = p[0] * RIG.focal_px as f32 / p[2] + RIG.cx_px as f32;
            (u - column).abs() < 0.01 && p[1] < 1.4 && p[2] > 13.0 && p[2] < 25.0
        };
        let kept = points.iter().filter(veil).count();
        let all = PointCloudParameters { neighbours_min: 0, ..PointCloudParameters::default() };
        let (everything, tally) = cloud(&map, &all);
        assert_eq!(tally.outliers, 0);
        assert!(everything.iter().filter(veil).count() > 20 && kept < 4, "{kept} of the veil are left");
    }

    #[test]
    fn thinning_limits_and_grey_levels() {
        let map = road_and_plate();
        let sparse = PointCloudParameters { every: 4, distance_max_m: 20.0, ..Default::default() };
        let (points, tally) = cloud(&map, &sparse);
        assert!(points.iter().all(|p| p[2] <= 20.0) && tally.far > 0);
        let (dense, _) = cloud(&map, &PointCloudParameters { distance_max_m: 20.0, ..Default::default() });
        let share = dense.len() as f64 / points.len() as f64;
        assert!((14.0..18.0).contains(&share), "{share}");
        let [x, y, z, grey] = points[0];
        let column = (f64::from(x) * RIG.focal_px / f64::from(z) + RIG.cx_px).round() as usize;
        let row = (f64::from(y) * RIG.focal_px / f64::from(z) + RIG.cy_px).round() as usize;
        assert_eq!(grey, ((row * SIZE.0 + column) % 251) as f32);
        // Nothing known, and nothing but errors.
        assert_eq!(cloud(&[0; 320 * 240], &sparse).1.unknown, 60 * 80);
        let (none, _) = cloud(&[u16::MAX; 320 * 240], &PointCloudParameters { every: 0, ..sparse });
        assert_eq!(none.len(), 320 * 240, "a wall in front of the lens is a wall");
    }
}
