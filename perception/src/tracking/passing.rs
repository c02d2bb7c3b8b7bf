//! Things that the vehicle passes.
//!
//! Of a parked car that is passed the near side leaves the picture, or comes nearer than disparities are searched, while its side and
//! its far end are still seen: slivers some metres behind where it begins. They are no new things. The ground that it covers is
//! remembered until the vehicle has passed that, too.

use super::filter::ground::Movement;
use super::parameters::{
    MAX_PASSED_CURVATURE_PER_M, MAX_PASSED_S, PASSED_DEPTH_M, PASSED_MARGIN_M, PASSED_SHARE, PASSING_M,
    PASSING_WIDTH_M,
};
use super::track::Track;
use crate::motion::body::Body;
use crate::motion::planar::PlanarStep;
use crate::region::Region;

/// Largest number of things that are remembered.
const MAX_THINGS: usize = 16;

/// Ground that a thing covers, in metres right and ahead of the camera.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Ground {
    /// Number of its track.
    id: u32,
    ends_m: [f64; 2],
    near_m: f64,
    /// Time since its track was last passed, in seconds.
    since_s: f64,
}

/// The ground that things beside the vehicle cover.
#[derive(Debug)]
pub struct Passing {
    things: Vec<Ground>,
    /// Whether the own way is so bent that what is beside it straight on may lie in it.
    is_turning: bool,
}

impl Passing {
    /// Without things; memory is allocated once.
    pub fn new() -> Self {
        Self { things: Vec::with_capacity(MAX_THINGS), is_turning: false }
    }

    /// Forgets all things.
    pub fn clear(&mut self) {
        self.things.clear();
    }

    /// Moves what is remembered to this frame, `elapsed_s` seconds after the last one; forgets it where the own motion is unknown.
    pub fn advance(&mut self, step: Option<&PlanarStep>, elapsed_s: f64) {
        let Some(step) = step else { return self.clear() };
        let [right_m, ahead_m] = step.place([0.0, 0.0]);
        self.is_turning = step.yaw_rad().abs() > MAX_PASSED_CURVATURE_PER_M * right_m.hypot(ahead_m);
        self.things.retain_mut(|ground| {
            let ends = ground.ends_m.map(|right_m| step.place([right_m, ground.near_m]));
            ground.ends_m = ends.map(|[right_m, _]| right_m);
            ground.near_m = (ends[0][1] + ends[1][1]) / 2.0;
            ground.since_s += elapsed_s;
            ground.since_s <= MAX_PASSED_S && ground.near_m + PASSED_DEPTH_M[1] > 0.0
        });
    }

    /// Remembers the tracks of this frame that are passed, and forgets those that move, or are ahead.
    pub fn remember(&mut self, tracks: &[Track], body: &Body) {
        self.things.retain(|ground| {
            let track = tracks.iter().find(|track| track.id == ground.id);
            track.is_none_or(|track| track.movement != Movement::Moving && is_beside(ends_m(track), body))
        });
        for track in tracks.iter().filter(|track| is_passed(track, body)) {
            let ground =
                Ground { id: track.id, ends_m: ends_m(track), near_m: track.distance_m(), since_s: 0.0 };
            let known = self.things.iter().position(|known| known.id == track.id);
            match known {
                Some(i) => self.things[i] = ground,
                None if self.things.len() < MAX_THINGS => self.things.push(ground),
                None => {}
            }
        }
    }

    /// Whether a sighting shows the side or the far end of a thing that is passed, and not something in the own way.
    pub fn covers(&self, region: &Region, body: &Body) -> bool {
        let ends_m = region.ends_m();
        !self.is_turning
            && is_beside(ends_m, body)
            && self.things.iter().any(|ground| {
                let [from_m, to_m] = [ground.ends_m[0] - PASSED_MARGIN_M, ground.ends_m[1] + PASSED_MARGIN_M];
                let inside_m = ends_m[1].min(to_m) - ends_m[0].max(from_m);
                let behind_m = region.distance_m - ground.near_m;
                (PASSED_DEPTH_M[0]..=PASSED_DEPTH_M[1]).contains(&behind_m)
                    && inside_m > 0.0
                    && inside_m >= PASSED_SHARE * (ends_m[1] - ends_m[0])
            })
    }
}

/// Where a track ends to the left and to the right, in metres.
fn ends_m(track: &Track) -> [f64; 2] {
    let half_m = track.front_m() / 2.0;
    [track.lateral_m() - half_m, track.lateral_m() + half_m]
}

/// Whether what ends here, in metres right of the camera, is beside the strip that the own body sweeps straight on.
fn is_beside([left_m, right_m]: [f64; 2], body: &Body) -> bool {
    let half_m = body.width_m / 2.0;
    left_m + body.camera_right_m >= half_m || right_m + body.camera_right_m <= -half_m
}

/// Whether a thing of a vehicle's size stands beside the own vehicle, which passes it.
fn is_passed(track: &Track, body: &Body) -> bool {
    track.is_confirmed
        && track.movement == Movement::Standing
        && !track.is_part_of_boundary()
        && track.front_m() >= PASSING_WIDTH_M
        && track.distance_m() <= PASSING_M
        && is_beside(ends_m(track), body)
}
