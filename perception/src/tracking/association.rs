//! Which sightings show which track.
//!
//! Each track gets at most one sighting of its own by minimum total cost ([`super::assign`]). A thing may come apart into
//! several sightings: one that nobody owns and that lies within the body of a track is a part of that thing.

use super::extent::{contained_share, edges_of};
use super::parameters::{
    BODY_SHARE, CONTAINMENT_WEIGHT, GATE_PX, GATE_SHARE, GATE_SIGMAS, OUTLIER_SIGMAS, OVERLAP_COST,
    SIZE_COST, SYSTEMATIC_PX, TYPICAL_AGREEMENT,
};
use super::track::Track;
use crate::outline::BODY_LENGTH_M;
use crate::region::{PixelBox, Region};
use crate::rig::Rig;

/// Standard deviation of the difference between the disparities of a track and of a sighting of it, in px: the part of the errors
/// that is the same in each frame is in neither filter nor sighting, and another part of the thing has another one.
fn spread_px(track: &Track, region: &Region) -> f64 {
    track.filter.disparity_sigma_px().hypot(region.disparity_sigma_px).hypot(SYSTEMATIC_PX)
}

/// Largest difference of the disparity, in px, at which a sighting may show a track.
fn gate_px(track: &Track, region: &Region) -> f64 {
    GATE_SIGMAS * spread_px(track, region) + GATE_PX + GATE_SHARE * track.filter.disparity_px()
}

/// Cost of taking a sighting for that of a track, whose box is expected at `body`; `None` if that is impossible.
pub(super) fn cost(track: &Track, body: &[f64; 4], region: &Region, min_overlap: f64) -> Option<f64> {
    let innovation = (region.disparity_px - track.filter.disparity_px()).abs();
    if innovation > gate_px(track, region) {
        return None;
    }
    let overlap = overlap(body, &region.bounds);
    if overlap < min_overlap {
        return None;
    }
    let sigmas = (innovation / spread_px(track, region)).min(GATE_SIGMAS);
    let size = (region.width_m / track.extent.width_m.max(0.05)).max(0.05).ln().abs();
    Some(sigmas * sigmas + OVERLAP_COST * (1.0 - overlap) + SIZE_COST * size.min(1.0))
}

/// Log-likelihood ratio of the place of a sighting, at most 0: how well it agrees with the prediction.
pub(super) fn agreement(track: &Track, body: &[f64; 4], region: &Region) -> f64 {
    let sigmas = (region.disparity_px - track.filter.disparity_px()) / spread_px(track, region);
    let agreement =
        overlap(body, &region.bounds).clamp(0.05, 1.0).ln() - 0.5 * (sigmas * sigmas).min(OUTLIER_SIGMAS);
    (agreement + TYPICAL_AGREEMENT).min(0.0)
}

/// Whether a disparity, in px, is one of the thing of a track, whose body reaches back from the near side.
fn is_in_depth(track: &Track, disparity_px: f64, gate_px: f64, rig: &Rig) -> bool {
    let nearest_px = track.filter.disparity_px() + gate_px;
    let farthest_px = rig.disparity_px(track.distance_m() + BODY_LENGTH_M);
    (farthest_px..=nearest_px).contains(&disparity_px)
}

/// Whether a sighting is a part of the thing whose box is expected at `body`.
pub(super) fn is_part(track: &Track, body: &[f64; 4], region: &Region, rig: &Rig) -> bool {
    contained_share(&edges_of(&region.bounds), body) >= BODY_SHARE
        && is_in_depth(track, region.disparity_px, gate_px(track, region), rig)
}

/// Whether a sighting contains a thing, whose box is expected at `body`, and has its distance: the thing merged with what is
/// beside it, or the whole thing of which the track follows a part.
pub(super) fn contains(track: &Track, body: &[f64; 4], region: &Region) -> bool {
    contained_share(body, &edges_of(&region.bounds)) >= BODY_SHARE
        && (region.disparity_px - track.filter.disparity_px()).abs() <= gate_px(track, region)
}

/// Whether a track follows a part of another one's thing. Both with their boxes.
pub(super) fn is_within(part: (&Track, &[f64; 4]), whole: (&Track, &[f64; 4]), rig: &Rig) -> bool {
    let disparity_px = part.0.filter.disparity_px();
    contained_share(part.1, whole.1) >= BODY_SHARE
        && is_in_depth(whole.0, disparity_px, gate_px(whole.0, &part.0.region), rig)
}

/// Intersection over union, or the weighted share of the smaller box that lies in the larger one, if that is
/// greater.
fn overlap(expected: &[f64; 4], bounds: &PixelBox) -> f64 {
    let [left, top, right, bottom] = *expected;
    let [x, y, x_end, y_end] = edges_of(bounds);
    let wide = (right.min(x_end) - left.max(x)).max(0.0);
    let high = (bottom.min(y_end) - top.max(y)).max(0.0);
    let shared = wide * high;
    let areas = ((right - left) * (bottom - top), (x_end - x) * (y_end - y));
    let (joint, smaller) = (areas.0 + areas.1 - shared, areas.0.min(areas.1));
    if smaller <= 0.0 { 0.0 } else { (shared / joint).max(CONTAINMENT_WEIGHT * shared / smaller) }
}
