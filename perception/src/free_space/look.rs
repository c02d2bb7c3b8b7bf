//! What the disparities of a frame tell of a place where a boundary is known: a wall does not go away, but what moved on does.

use super::boundary::Boundary;
use super::limits::{
    GATE_SIGMAS, LOOK_HIDDEN_SHARE, LOOK_KNOWN_SHARE, LOOK_MIN_ROWS, LOOK_ROWS, LOOK_SEEN_SHARE, MAX_GATE_M,
    ROUGHNESS_M, STIXEL_SIGMA_PX,
};
use crate::detection::stixels::{STRIP_COLUMNS, Stixels};
use crate::rig::Rig;
use crate::road::surface::RoadSurface;

/// What is seen where a boundary is known.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Look {
    /// The boundary.
    Seen,
    /// Something nearer.
    Hidden,
    /// What is behind it: it is not there.
    Through,
    /// Nothing that tells: it is out of the picture, or has no texture.
    Unknown,
}

/// What a frame shows.
#[derive(Clone, Copy, Debug)]
pub(super) struct FrameView<'a> {
    /// Its stixels, with the disparities of their strips.
    pub stixels: &'a Stixels,
    /// Its road.
    pub surface: &'a RoadSurface,
    /// The cameras.
    pub rig: Rig,
}

impl FrameView<'_> {
    /// What is seen at a point of a boundary, by its index, in the strip of columns in which it stands.
    pub(super) fn look(&self, boundary: &Boundary, index: usize) -> Look {
        let (rig, point) = (&self.rig, &boundary.points()[index]);
        let column = rig.cx_px + rig.focal_px * point.lateral_m / point.distance_m;
        let disparity_px = rig.disparity_px(point.distance_m);
        // Left of that the right camera sees nothing.
        let strip = (column / STRIP_COLUMNS as f64) as usize;
        if column < disparity_px || strip >= self.stixels.strips() {
            return Look::Unknown;
        }
        // Where errors do not tell a boundary from what is before or behind it, nothing is known.
        let noise_px = STIXEL_SIGMA_PX.hypot(self.surface.noise_px());
        let line_m = line_m(boundary, index);
        let noise_m = noise_px * line_m / disparity_px;
        if GATE_SIGMAS * noise_m.hypot(point.sigma_m) > MAX_GATE_M {
            return Look::Unknown;
        }
        let across_m = point.sigma_m.hypot(ROUGHNESS_M);
        let gate_px = GATE_SIGMAS * noise_px.hypot(disparity_px * across_m / line_m.max(across_m));
        let depths = self.stixels.depths(strip);
        let foot = f64::from(self.surface.row_at(column, disparity_px));
        let high = point.height_m.max(0.0) * disparity_px / rig.baseline_m;
        let row = |share: f64| (foot - share * high).clamp(0.0, depths.len() as f64) as usize;
        verdict(&depths[row(LOOK_ROWS.end)..row(LOOK_ROWS.start)], disparity_px, gate_px)
    }
}

/// What disparities of some rows (1/256 px, 0: unknown) show, where one of `disparity_px` is expected within `gate_px`.
fn verdict(depths: &[u16], disparity_px: f64, gate_px: f64) -> Look {
    let [mut before, mut at, mut behind] = [0_u32; 3];
    for depth in depths.iter().filter(|depth| **depth > 0) {
        let off_px = f64::from(*depth) / 256.0 - disparity_px;
        if off_px > gate_px {
            before += 1;
        } else if off_px < -gate_px {
            behind += 1;
        } else {
            at += 1;
        }
    }
    let known = before + at + behind;
    let is_share = |count: u32, share: f64| f64::from(count) >= share * f64::from(known);
    if known < LOOK_MIN_ROWS || f64::from(known) < LOOK_KNOWN_SHARE * depths.len() as f64 {
        Look::Unknown
    } else if is_share(at, LOOK_SEEN_SHARE) {
        Look::Seen
    } else if is_share(before, LOOK_HIDDEN_SHARE) {
        Look::Hidden
    } else if is_share(behind, LOOK_HIDDEN_SHARE) {
        Look::Through
    } else {
        Look::Unknown
    }
}

/// Distance of the camera from the line through the points around one of a boundary, in metres.
fn line_m(boundary: &Boundary, index: usize) -> f64 {
    let points = boundary.points();
    let (a, b) = (&points[index.saturating_sub(1)], &points[(index + 1).min(points.len() - 1)]);
    let [right, ahead] = [b.lateral_m - a.lateral_m, b.distance_m - a.distance_m];
    (a.lateral_m * ahead - a.distance_m * right).abs() / right.hypot(ahead).max(1e-9)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What so many rows show that are before, at and behind a boundary at 10 px, and unknown.
    fn rows([before, at, behind, unknown]: [usize; 4]) -> Look {
        let of = |px: f64, count: usize| vec![(256.0 * px) as u16; count];
        verdict(&[of(14.0, before), of(10.2, at), of(4.0, behind), of(0.0, unknown)].concat(), 10.0, 0.5)
    }

    #[test]
    fn a_fence_is_seen_though_one_sees_through_it() {
        assert_eq!(rows([0, 20, 0, 0]), Look::Seen);
        assert_eq!(rows([0, 7, 13, 0]), Look::Seen);
        assert_eq!(rows([0, 5, 15, 0]), Look::Through);
        assert_eq!(rows([15, 5, 0, 0]), Look::Hidden);
        assert_eq!(rows([9, 5, 9, 0]), Look::Unknown);
    }

    #[test]
    fn few_rows_tell_nothing() {
        assert_eq!(rows([0, 2, 0, 0]), Look::Unknown);
        assert_eq!(rows([0, 4, 0, 16]), Look::Unknown);
        assert_eq!(rows([0, 5, 0, 15]), Look::Seen);
    }

    #[test]
    fn the_line_is_that_of_the_points_around() {
        let mut wall = Boundary::default();
        for distance_m in [5.0, 10.0, 15.0] {
            wall.push(super::super::boundary::BoundaryPoint {
                lateral_m: 3.0,
                distance_m,
                ..Default::default()
            });
        }
        assert!((0..3).all(|i| (line_m(&wall, i) - 3.0).abs() < 1e-9));
    }
}
