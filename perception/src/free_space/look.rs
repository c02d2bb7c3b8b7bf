//! What the disparities of a frame tell of a place where a boundary is known: a wall does not go away, but what moved on does.

use super::boundary::{Boundary, BoundaryPoint};
use super::limits::{
    GATE_SIGMAS, LOOK_HIDDEN_SHARE, LOOK_ROWS, LOOK_SEEN_SHARE, MAX_GATE_M, ROUGHNESS_M, STIXEL_SIGMA_PX,
};
use crate::detection::stixels::{STRIP_COLUMNS, Stixels};
use crate::rig::Rig;
use crate::road::surface::RoadSurface;

/// What is seen where a boundary is known.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Look {
    /// The boundary.
    Seen,
    /// Something nearer.
    Hidden,
    /// What is behind it: it is not there.
    Through,
    /// Nothing that tells: it is out of the picture, or has no texture.
    Unknown,
}

/// A frame to look at.
#[derive(Clone, Copy, Debug)]
pub struct Sight<'a> {
    /// Its stixels.
    pub stixels: &'a Stixels,
    /// Its road.
    pub surface: &'a RoadSurface,
    /// The cameras.
    pub rig: Rig,
}

impl Sight<'_> {
    /// What is seen at a point of a boundary, in the strip of columns in which it stands.
    pub fn look(&self, boundary: &Boundary, point: &BoundaryPoint) -> Look {
        let rig = &self.rig;
        let slope = point.lateral_m / point.distance_m;
        let column = rig.cx_px + rig.focal_px * slope;
        let disparity_px = rig.disparity_px(point.distance_m);
        // Left of that the right camera sees nothing.
        let strip = (column / STRIP_COLUMNS as f64) as usize;
        if column < disparity_px || strip >= self.stixels.strips() {
            return Look::Unknown;
        }
        let depths = self.stixels.depths(strip);
        let foot = f64::from(self.surface.row_at(column, disparity_px));
        let high = point.height_m * disparity_px / rig.baseline_m;
        let row = |share: f64| (foot - share * high).clamp(0.0, depths.len() as f64) as usize;
        let rows = row(LOOK_ROWS.end)..row(LOOK_ROWS.start);
        let Some(line_m) = boundary.meet(slope).map(|meeting| meeting.line_m) else { return Look::Unknown };
        let noise_px = STIXEL_SIGMA_PX.hypot(self.surface.noise_px());
        // Where noise does not tell a boundary from what is before or behind it, nothing is known.
        if GATE_SIGMAS * noise_px * line_m > MAX_GATE_M * disparity_px {
            return Look::Unknown;
        }
        let across_m = point.sigma_m.hypot(ROUGHNESS_M);
        let shape_px = disparity_px * across_m / line_m.max(across_m);
        let gate_px = GATE_SIGMAS * noise_px.hypot(shape_px);
        let [mut before, mut at, mut behind] = [0_u32; 3];
        let wanted = rows.len() as u32;
        for depth in depths[rows].iter().filter(|depth| **depth > 0) {
            let off_px = f64::from(*depth) / 256.0 - disparity_px;
            let count = if off_px > gate_px {
                &mut before
            } else if off_px < -gate_px {
                &mut behind
            } else {
                &mut at
            };
            *count += 1;
        }
        let known = before + at + behind;
        let is_share = |count: u32, share: f64| f64::from(count) >= share * f64::from(known);
        if known < MIN_ROWS || 4 * known < wanted {
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
}

/// Fewest rows that tell.
const MIN_ROWS: u32 = 3;
