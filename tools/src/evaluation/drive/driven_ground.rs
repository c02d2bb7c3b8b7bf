//! Whether the ground that the vehicle then drove over was called free.

use super::strip::{STRIP_WIDTH_M, Strip};
use crate::reporting::record::FrameRecord;

/// The driven strip is compared up to this distance ahead, in metres.
pub const TO_M: f64 = 15.0;

/// Where the comparison starts if no ground is free, in metres ahead: where cameras begin to see it.
const START_M: f64 = 6.0;

/// Distance between two places that are looked up, in metres.
const STEP_M: f64 = 0.5;

/// Metres of the driven strip.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct DrivenGround {
    /// Compared, along the strip.
    pub driven_m: f64,
    /// Of them not free over the whole width of the strip.
    pub not_free_m: f64,
}

impl DrivenGround {
    /// Adds a frame, and where the vehicle then drove.
    pub fn add_frame(&mut self, record: &FrameRecord, strip: &Strip) {
        let polygons = &record.free_space_m;
        let start_m = polygons.iter().flatten().map(|[_, z]| *z).reduce(f64::min).unwrap_or(START_M);
        // The corners of the near side lie at that distance.
        let mut distance_m = start_m + 0.5 * STEP_M;
        while distance_m < TO_M.min(strip.end_m()) {
            let centre_m = strip.centre_m(distance_m);
            let is_free = |side: f64| {
                let place = [centre_m + side * STRIP_WIDTH_M / 2.0, distance_m];
                polygons.iter().any(|polygon| contains(polygon, place))
            };
            self.driven_m += STEP_M;
            if ![-1.0, -0.5, 0.0, 0.5, 1.0].into_iter().all(is_free) {
                self.not_free_m += STEP_M;
            }
            distance_m += STEP_M;
        }
    }

    /// Adds the metres of another drive.
    pub fn add(&mut self, other: &Self) {
        self.driven_m += other.driven_m;
        self.not_free_m += other.not_free_m;
    }

    /// Share that was not free, in percent; `None` if nothing was driven.
    pub fn not_free_percent(&self) -> Option<f64> {
        (self.driven_m > 0.0).then(|| 100.0 * self.not_free_m / self.driven_m)
    }
}

/// Whether a polygon (right, ahead) contains a place, by the rule of even and odd crossings.
fn contains(polygon: &[[f64; 2]], [right, ahead]: [f64; 2]) -> bool {
    let mut inside = false;
    for (i, &[x0, z0]) in polygon.iter().enumerate() {
        let [x1, z1] = polygon[(i + 1) % polygon.len()];
        if (z0 > ahead) != (z1 > ahead) && right < x0 + (ahead - z0) / (z1 - z0) * (x1 - x0) {
            inside = !inside;
        }
    }
    inside
}

#[cfg(test)]
mod tests {
    use super::super::strip::tests::straight;
    use super::*;

    #[test]
    fn driven_ground_that_was_not_free_is_counted() {
        let strip = straight(60, 10.0).strip(0).expect("it is known");
        let judged = |free_space_m: Vec<Vec<[f64; 2]>>| {
            let mut ground = DrivenGround::default();
            ground.add_frame(&FrameRecord { free_space_m, ..FrameRecord::default() }, &strip);
            ground
        };
        let area = |right: f64, to: f64| vec![[-2.0, to], [right, to], [right, 5.0], [-2.0, 5.0]];
        let all = judged(vec![area(2.0, 30.0)]);
        assert_eq!((all.driven_m, all.not_free_m), (10.0, 0.0));
        assert_eq!(judged(vec![area(2.0, 11.0)]).not_free_m, 4.0);
        assert_eq!(judged(vec![area(0.5, 30.0)]).not_free_m, 10.0, "the right wheels were not free");
        let none = judged(Vec::new());
        assert_eq!((none.driven_m, none.not_free_percent()), (9.0, Some(100.0)));
        let mut both = none;
        both.add(&all);
        assert_eq!((both.driven_m, both.not_free_m), (19.0, 9.0));
        assert_eq!(DrivenGround::default().not_free_percent(), None);
    }
}
