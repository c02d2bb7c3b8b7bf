//! Rectification: rotates both cameras so that corresponding points lie in the same row.
//!
//! Each camera is rotated by half of their relative rotation, then both together until the baseline is parallel to
//! the rows (J.-Y. Bouguet's method). This changes both images as little as possible.

use super::camera::Camera;
use super::pose::Pose;
use crate::rig::Rig;
use nalgebra::{Matrix3, Rotation3, Vector2, Vector3};
use thiserror::Error;

/// Choice of the rectified focal length.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Crop {
    /// The smallest focal length at which every rectified pixel shows a camera pixel, but no wider than
    /// [`WIDEST_VALID_DEG`].
    #[default]
    Valid,
    /// The largest focal length at which every pixel of both cameras is kept, up to [`MAX_FIELD_OF_VIEW_DEG`]; the rest is black.
    Full,
    /// The mean focal length of the cameras.
    Same,
    /// The focal length at which the images have this horizontal field of view, in degrees, with the principal point in their
    /// middle: for wide-angle lenses, of which no pinhole camera shows all.
    FieldOfView(f64),
}

/// Why a pair of cameras cannot be rectified.
#[derive(Clone, Copy, Debug, Error, PartialEq)]
pub enum RectificationError {
    /// The right camera is on the left side.
    /// Two cameras that are both upside down have the same geometry; views of a board cannot tell these apart.
    #[error(
        "the right camera is {offset_m:.4} m to the left of the left camera: the cameras, or their folders, are swapped, or both cameras are upside down"
    )]
    Swapped {
        /// Distance in metres.
        offset_m: f64,
    },
    /// One camera is upside down relative to the other. Which one follows from the sides on which they are: seen from an
    /// upright left camera, the right one is on the right.
    #[error(
        "the {side} camera is upside down relative to the other one (rolled by {roll_deg:.0}°): turn the camera, or its pictures, by 180°; if the cameras, or their folders, are swapped as well, it is the other one"
    )]
    UpsideDown {
        /// `left` or `right`.
        side: &'static str,
        /// Angle between the upward directions of both images, in degrees, 90 to 180.
        roll_deg: f64,
    },
    /// The cameras are not mounted side by side.
    #[error(
        "the right camera is {down_m:.4} m below, {forward_m:.4} m in front of and {right_m:.4} m to the right of the left one: mount them side by side"
    )]
    NotBeside {
        /// To the right, in metres.
        right_m: f64,
        /// Down, in metres.
        down_m: f64,
        /// Forward, in metres.
        forward_m: f64,
    },
    /// The fields of view do not overlap.
    #[error("the viewing directions of the cameras differ too much: no part of the images can be rectified")]
    NoOverlap,
}

/// The rectified pair.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rectification {
    /// Rotation from each camera's coordinates to the rectified ones.
    pub turns: [Rotation3<f64>; 2],
    /// Focal length, principal point and baseline of both rectified cameras.
    pub rig: Rig,
    /// Width and height of the images, in pixels.
    pub size: (usize, usize),
    /// x, y, width and height of the rectangle that both cameras cover, in rectified pixels.
    pub valid: [usize; 4],
}

/// Widest horizontal field of view of the rectified images, in degrees: at its border a pixel covers a ninth of the angle of one
/// in the middle.
pub const MAX_FIELD_OF_VIEW_DEG: f64 = 140.0;

/// Widest horizontal field of view of [`Crop::Valid`], in degrees. A fisheye lens sees more, but there its pixels are stretched.
pub const WIDEST_VALID_DEG: f64 = 100.0;

/// Roll between the cameras above which one counts as upside down, in degrees: nearer to 180 than to 0.
const MAX_ROLL_DEG: f64 = 90.0;

/// Samples along a side of the image.
const SAMPLES: usize = 24;

/// Positions of the left, right, upper and lower border of each image at focal length 1, sampled along its sides.
fn borders(
    cameras: &[Camera; 2],
    turns: &[Rotation3<f64>; 2],
    (width, height): (f64, f64),
) -> Result<[Vec<[Vector2<f64>; 4]>; 2], RectificationError> {
    let mut borders: [Vec<[Vector2<f64>; 4]>; 2] = [Vec::new(), Vec::new()];
    for (c, camera) in cameras.iter().enumerate() {
        for i in 0..=SAMPLES {
            let share = i as f64 / SAMPLES as f64;
            let (x, y) = (share * (width - 1.0), share * (height - 1.0));
            let ray = |x: f64, y: f64| -> Option<Vector2<f64>> {
                let ray = turns[c] * camera.undistort(Vector2::new(x, y))?.push(1.0);
                (ray.z > 0.05).then(|| Vector2::new(ray.x / ray.z, ray.y / ray.z))
            };
            // Where the lens model is not invertible at the border, the image is cut off before.
            let (mx, my) = (0.5 * (width - 1.0), 0.5 * (height - 1.0));
            let seen = |x: f64, y: f64| {
                (0..12).find_map(|k| {
                    let near = 1.0 - 0.05 * f64::from(k);
                    ray(mx + (x - mx) * near, my + (y - my) * near)
                })
            };
            let side = [seen(0.0, y), seen(width - 1.0, y), seen(x, 0.0), seen(x, height - 1.0)];
            let [Some(left), Some(right), Some(top), Some(bottom)] = side else {
                return Err(RectificationError::NoOverlap);
            };
            borders[c].push([left, right, top, bottom]);
        }
    }
    Ok(borders)
}

/// Left, right, top and bottom of the area that both images cover, at focal length 1.
fn common_area(borders: &[Vec<[Vector2<f64>; 4]>; 2]) -> [f64; 4] {
    let all = || borders.iter().flatten();
    [
        all().map(|s| s[0].x).fold(f64::MIN, f64::max),
        all().map(|s| s[1].x).fold(f64::MAX, f64::min),
        all().map(|s| s[2].y).fold(f64::MIN, f64::max),
        all().map(|s| s[3].y).fold(f64::MAX, f64::min),
    ]
}

/// The rectangle of pixels within an area at focal length 1: x, y, width and height.
fn valid_area(
    area: [f64; 4],
    rig: &Rig,
    (width, height): (usize, usize),
) -> Result<[usize; 4], RectificationError> {
    // A small tolerance against rounding: the focal length may have been chosen to make these bounds exact.
    let low = |v: f64, c: f64| (rig.focal_px * v + c - 1e-6).ceil().max(0.0);
    let high = |v: f64, c: f64, most: usize| (rig.focal_px * v + c + 1e-6).floor().min(most as f64 - 1.0);
    let (x0, x1) = (low(area[0], rig.cx_px), high(area[1], rig.cx_px, width));
    let (y0, y1) = (low(area[2], rig.cy_px), high(area[3], rig.cy_px, height));
    if x1 <= x0 || y1 <= y0 {
        return Err(RectificationError::NoOverlap);
    }
    Ok([x0 as usize, y0 as usize, (x1 - x0) as usize + 1, (y1 - y0) as usize + 1])
}

impl Rectification {
    /// Rectifies two cameras with images of `size`; `between` transforms the first camera's coordinates to the
    /// second's.
    ///
    /// # Errors
    /// If the cameras are swapped, one is upside down, they are not side by side, or their fields of view do not overlap.
    pub fn new(
        cameras: &[Camera; 2],
        between: &Pose,
        size: (usize, usize),
        crop: Crop,
    ) -> Result<Self, RectificationError> {
        let t = between.translation_m;
        // Centre of the second camera in the first camera's coordinates.
        let centre = -(between.rotation.inverse() * t);
        if centre.y.abs().max(centre.z.abs()) > centre.x.abs() {
            return Err(RectificationError::NotBeside {
                right_m: centre.x,
                down_m: centre.y,
                forward_m: centre.z,
            });
        }
        // Angle between the cameras' downward directions, in the first image.
        let down = between.rotation.inverse() * Vector3::y();
        let roll_deg = down.x.atan2(down.y).abs().to_degrees();
        if roll_deg > MAX_ROLL_DEG {
            let side = if centre.x < 0.0 { "left" } else { "right" };
            return Err(RectificationError::UpsideDown { side, roll_deg });
        }
        if centre.x < 0.0 {
            return Err(RectificationError::Swapped { offset_m: -centre.x });
        }
        let half = Rotation3::new(between.rotation_vector() * 0.5);
        // Both cameras now have the same orientation; the baseline in their coordinates:
        let along = -(half.inverse() * t);
        let level =
            Rotation3::rotation_between(&along, &Vector3::x()).ok_or(RectificationError::NoOverlap)?;
        let turns = [level * half, level * half.inverse()];
        let baseline_m = t.norm();
        let (width, height) = (size.0 as f64, size.1 as f64);
        let borders = borders(cameras, &turns, (width, height))?;
        let all = || borders.iter().flatten();
        let lowest = |f: &dyn Fn(&[Vector2<f64>; 4]) -> f64| all().map(f).fold(f64::MAX, f64::min);
        let highest = |f: &dyn Fn(&[Vector2<f64>; 4]) -> f64| all().map(f).fold(f64::MIN, f64::max);
        // Left, right, top, bottom of the area that both images cover (inner) and that either covers (outer).
        let inner = common_area(&borders);
        let outer = [lowest(&|s| s[0].x), highest(&|s| s[1].x), lowest(&|s| s[2].y), highest(&|s| s[3].y)];
        if inner[0] >= inner[1] || inner[2] >= inner[3] {
            return Err(RectificationError::NoOverlap);
        }
        let own = cameras.iter().map(|c| (c.fx_px * c.fy_px).sqrt()).sum::<f64>() / 2.0;
        let (box_, focal_px) = match crop {
            Crop::Valid => {
                let limit = (0.5 * WIDEST_VALID_DEG).to_radians().tan();
                let shown = [inner[0].max(-limit), inner[1].min(limit), inner[2], inner[3]];
                let focal =
                    ((width - 1.0) / (shown[1] - shown[0])).max((height - 1.0) / (shown[3] - shown[2]));
                (shown, focal)
            }
            Crop::Full => {
                let limit = (0.5 * MAX_FIELD_OF_VIEW_DEG).to_radians().tan();
                let shown = outer.map(|v| v.clamp(-limit, limit));
                let focal =
                    ((width - 1.0) / (shown[1] - shown[0])).min((height - 1.0) / (shown[3] - shown[2]));
                (shown, focal)
            }
            Crop::Same => (inner, own),
            Crop::FieldOfView(degrees) => {
                let half = (0.5 * degrees.clamp(1.0, MAX_FIELD_OF_VIEW_DEG)).to_radians().tan();
                ([-half, half, -half, half], 0.5 * (width - 1.0) / half)
            }
        };
        let cx_px = 0.5 * (width - 1.0) - focal_px * 0.5 * (box_[0] + box_[1]);
        let cy_px = 0.5 * (height - 1.0) - focal_px * 0.5 * (box_[2] + box_[3]);
        let rig = Rig { focal_px, baseline_m, cx_px, cy_px };
        Ok(Self { turns, rig, size, valid: valid_area(inner, &rig, size)? })
    }

    /// The rectification with other rotations of the cameras, and the same focal length and principal point.
    ///
    /// # Errors
    /// If no part of the image is seen by both cameras.
    pub fn with_turns(
        &self,
        cameras: &[Camera; 2],
        turns: [Rotation3<f64>; 2],
    ) -> Result<Self, RectificationError> {
        let size = (self.size.0 as f64, self.size.1 as f64);
        let inner = common_area(&borders(cameras, &turns, size)?);
        Ok(Self { turns, valid: valid_area(inner, &self.rig, self.size)?, ..*self })
    }

    /// The rectified position of a pixel of camera `side` (0 left, 1 right); `None` where the lens model is not
    /// invertible.
    pub fn rectified(&self, cameras: &[Camera; 2], side: usize, pixel: Vector2<f64>) -> Option<Vector2<f64>> {
        let ray = self.turns[side] * cameras[side].undistort(pixel)?.push(1.0);
        let rig = &self.rig;
        (ray.z > 1e-6).then(|| {
            Vector2::new(rig.focal_px * ray.x / ray.z + rig.cx_px, rig.focal_px * ray.y / ray.z + rig.cy_px)
        })
    }

    /// The pixel of camera `side` (0 left, 1 right) that a rectified pixel shows; `None` behind the camera.
    pub fn source(&self, cameras: &[Camera; 2], side: usize, pixel: Vector2<f64>) -> Option<Vector2<f64>> {
        let rig = &self.rig;
        let ray =
            Vector3::new((pixel.x - rig.cx_px) / rig.focal_px, (pixel.y - rig.cy_px) / rig.focal_px, 1.0);
        cameras[side].project(&(self.turns[side].inverse() * ray))
    }

    /// The reprojection matrix (OpenCV's Q), which maps (column, row, disparity, 1) to homogeneous coordinates in
    /// metres.
    pub fn reprojection(&self) -> [[f64; 4]; 4] {
        let rig = &self.rig;
        [
            [1.0, 0.0, 0.0, -rig.cx_px],
            [0.0, 1.0, 0.0, -rig.cy_px],
            [0.0, 0.0, 0.0, rig.focal_px],
            [0.0, 0.0, 1.0 / rig.baseline_m, 0.0],
        ]
    }

    /// Rotation matrix of a side.
    pub fn matrix(&self, side: usize) -> Matrix3<f64> {
        *self.turns[side].matrix()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::calibration::Distortion;

    fn cameras() -> ([Camera; 2], Pose) {
        let left = Camera {
            distortion: Distortion::BrownConrady([0.115, -0.21, -0.0006, -0.0027, 0.0, 0.0, 0.0, 0.0]),
            ..Camera::pinhole(463.1, 462.8, 314.8, 187.3)
        };
        let right = Camera { cx_px: 326.9, cy_px: 179.4, ..left };
        let between = Pose {
            rotation: Rotation3::new(Vector3::new(0.0074, 0.0222, 0.0096)),
            translation_m: Vector3::new(-0.09405, -0.00092, 0.00255),
        };
        ([left, right], between)
    }

    #[test]
    fn rows_match_and_disparity_gives_distance() {
        let (cameras, between) = cameras();
        for crop in [Crop::Valid, Crop::Full, Crop::Same] {
            let r = Rectification::new(&cameras, &between, (640, 360), crop).unwrap();
            for point in
                [Vector3::new(0.1, -0.05, 0.6), Vector3::new(-0.2, 0.1, 1.5), Vector3::new(1.0, 0.5, 4.0)]
            {
                let left = cameras[0].project(&point).unwrap();
                let right = cameras[1].project(&between.apply(&point)).unwrap();
                let (l, rr) =
                    (r.rectified(&cameras, 0, left).unwrap(), r.rectified(&cameras, 1, right).unwrap());
                assert!((l.y - rr.y).abs() < 1e-6, "{crop:?}");
                let turned = r.turns[0] * point;
                assert!((r.rig.distance_m(l.x - rr.x) - turned.z).abs() < 1e-6);
                assert!((r.source(&cameras, 0, l).unwrap() - left).norm() < 1e-6);
            }
            assert!((r.rig.baseline_m - between.translation_m.norm()).abs() < 1e-12);
            let inside = |p: Vector2<f64>| p.x > -0.6 && p.y > -0.6 && p.x < 639.6 && p.y < 359.6;
            let [x, y, w, h] = r.valid;
            for (x, y) in [(x, y), (x + w - 1, y), (x, y + h - 1), (x + w - 1, y + h - 1), (x + w / 2, y)] {
                for side in 0..2 {
                    let source = r.source(&cameras, side, Vector2::new(x as f64, y as f64)).unwrap();
                    assert!(inside(source), "{crop:?} {x} {y}: {source}");
                }
            }
            if crop == Crop::Valid {
                assert_eq!(r.valid[2].max(r.valid[3] * 640 / 360), 640);
            }
        }
    }

    #[test]
    fn cameras_in_the_wrong_place_are_refused() {
        let (cameras, between) = cameras();
        let swapped =
            Rectification::new(&[cameras[1], cameras[0]], &between.inverse(), (640, 360), Crop::Valid);
        assert!(matches!(swapped, Err(RectificationError::Swapped { .. })), "{swapped:?}");
        let above = Pose { translation_m: Vector3::new(0.0, 0.1, 0.0), ..between };
        let above = Rectification::new(&cameras, &above, (640, 360), Crop::Valid);
        assert!(matches!(above, Err(RectificationError::NotBeside { .. })));
        let away = Pose { rotation: Rotation3::new(Vector3::new(0.0, 2.0, 0.0)), ..between };
        assert!(Rectification::new(&cameras, &away, (640, 360), Crop::Valid).is_err());
    }
}
