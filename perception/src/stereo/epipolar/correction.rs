//! Which vertical offsets are corrected while the cameras run, and how fast: small offsets, roll and slow drift.

use super::EpipolarCheck;
use super::field::RowField;

/// Remaining typical offset from which on it is corrected, in px: a quarter of a pixel loses 1 % of the matches and
/// changes distances at 30 m by about 1 % ([`super::harm`]). Below it the correction would follow its own noise.
pub const WORTH_PX: f64 = 0.25;

/// Largest correction where none is configured, in px. A mount that turned up or down may have turned aside as much,
/// which no row shows but which changes disparities: 2 px are 16 % of a distance of 30 m with KITTI's cameras. Beyond
/// that, shifting rows would hide distances that are wrong.
pub const DEFAULT_LIMIT_PX: f64 = 2.0;

/// Distance from the target at which a correction has arrived, in px: half a step of the interpolation.
const ARRIVED_PX: f64 = 1.0 / 64.0;

/// Speed of the correction, in px/s: what a map shows moves by less than a quarter of a pixel from frame to frame at
/// 10 pairs a second, and 1.5 px take less than a second.
const SPEED_PX_S: f64 = 2.0;

/// Checks in a row between which the estimate must rest before it counts as settled.
const SETTLED_CHECKS: u32 = 3;

/// Typical change between two checks up to which the estimate rests, in px.
const REST_PX: f64 = 0.1;

/// Typical change since the start from which on the cameras count as moved, in px, and below which no more. The
/// estimate of two pictures of one rig differs by less than 0.2 px on kitti2015.
const MOVED_PX: (f64, f64) = (0.5, 0.35);

/// Correction of a run. Nothing is allocated.
#[derive(Clone, Debug)]
pub struct RowCorrection {
    /// Largest typical correction over the matched area, in px; 0 = none.
    limit_px: f64,
    applied: RowField,
    target: RowField,
    /// The estimate at the last check, and how many checks it has rested.
    last: RowField,
    rested: u32,
    /// The first settled estimate.
    start: Option<RowField>,
    moved_px: f64,
    has_moved: bool,
}

impl RowCorrection {
    /// No correction yet; `limit_px` is the largest typical shift that is permitted, 0 for none at all.
    pub fn new(limit_px: f64) -> Self {
        Self {
            limit_px,
            applied: RowField::ZERO,
            target: RowField::ZERO,
            last: RowField::ZERO,
            rested: 0,
            start: None,
            moved_px: 0.0,
            has_moved: false,
        }
    }

    /// The correction that is applied now.
    pub fn applied(&self) -> RowField {
        self.applied
    }

    /// Typical change of the offset since the start of the run, in pixels; 0 until the estimate has settled.
    pub fn moved_px(&self) -> f64 {
        self.moved_px
    }

    /// Whether the cameras have moved since the start.
    pub fn has_moved(&self) -> bool {
        self.has_moved
    }

    /// Moves the correction towards its target; to be called for every frame, with the time since the previous one in
    /// seconds.
    pub fn advance(&mut self, seconds: f64) {
        let way = self.target - self.applied;
        let length_px = way.largest_px();
        let step_px = SPEED_PX_S * seconds.max(0.0);
        self.applied = if length_px <= step_px.max(ARRIVED_PX) {
            self.target
        } else {
            self.applied + way * (step_px / length_px)
        };
    }

    /// Sets the target after a check whose estimate is known.
    pub fn update(&mut self, check: &EpipolarCheck) {
        let total = check.health().total;
        let rests = check.typical_px(&(total - self.last)) < REST_PX;
        self.rested = if rests { self.rested + 1 } else { 0 };
        self.last = total;
        if self.rested < SETTLED_CHECKS {
            return;
        }
        let start = *self.start.get_or_insert(total);
        self.moved_px = check.typical_px(&(total - start));
        self.has_moved = self.moved_px > if self.has_moved { MOVED_PX.1 } else { MOVED_PX.0 };
        let is_under_way = self.applied != self.target;
        if is_under_way || check.typical_px(&(total - self.applied)) >= WORTH_PX {
            let scale = (self.limit_px / check.typical_px(&total).max(f64::MIN_POSITIVE)).min(1.0);
            self.target = total * scale;
        }
    }
}
