//! Free space against the ground truth of a scene: how much of the truly free ground is found, and how many metres are
//! wrongly called free.
//!
//! Free space is a set of polygons in metres: right of the left camera and ahead of it. Along the direction of each column of the
//! left image it is compared with what the column shows ([`FreeGround`]), from [`FROM_M`] to [`TO_M`] ahead. **Found** is
//! the part of the truly free ground within the polygon. **Wrongly free** is what the polygon reaches beyond the nearest
//! thing on the ground. Ground beside the asphalt before that thing counts for neither.

use perception::rig::Rig;
use serde::Serialize;
use sources::scene::FreeGround;

/// Start of the compared ground, in metres ahead: the cameras see none that is much nearer.
pub const FROM_M: f64 = 5.0;

/// End of the compared ground, in metres ahead: as far as objects are evaluated.
pub const TO_M: f64 = 40.0;

/// A polygon may reach this far beyond an obstacle without being wrong, in shares of the distance and at least in metres:
/// half the tolerance of an object's distance.
const TOLERANCE: (f64, f64) = (0.075, 0.5);

/// Sums over columns and frames.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct FreeGroundCounts {
    columns: usize,
    free_m: f64,
    found_m: f64,
    wrong_columns: usize,
    wrong_m: f64,
}

/// The score of free space.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct FreeGroundScore {
    /// Share of the truly free ground that is found.
    pub found: Option<f64>,
    /// Metres wrongly called free, mean over the columns.
    pub wrong_m: Option<f64>,
    /// Share of the columns in which the polygon reaches beyond an obstacle.
    pub wrong_columns: Option<f64>,
}

impl FreeGroundCounts {
    /// Adds a frame: polygons with their corners as (right, ahead), in metres.
    pub fn add(&mut self, truth: &FreeGround, rig: &Rig, polygons: &[Vec<[f64; 2]>]) {
        for (x, (&free, &blocked)) in truth.free_m.iter().zip(&truth.blocked_m).enumerate() {
            let slope = (x as f64 - rig.cx_px) / rig.focal_px;
            let reach =
                polygons.iter().map(|polygon| reach_m(polygon, slope)).fold(FROM_M, f64::max).min(TO_M);
            let free = f64::from(free).clamp(FROM_M, TO_M);
            let blocked = f64::from(blocked);
            self.columns += 1;
            self.free_m += free - FROM_M;
            self.found_m += free.min(reach) - FROM_M;
            let allowed = blocked + (TOLERANCE.0 * blocked).max(TOLERANCE.1);
            if reach > allowed && reach > FROM_M {
                self.wrong_columns += 1;
                self.wrong_m += reach - blocked.max(FROM_M);
            }
        }
    }

    /// Adds the sums of other frames.
    pub fn merge(&mut self, other: &Self) {
        self.columns += other.columns;
        self.free_m += other.free_m;
        self.found_m += other.found_m;
        self.wrong_columns += other.wrong_columns;
        self.wrong_m += other.wrong_m;
    }

    /// The score so far.
    pub fn score(&self) -> FreeGroundScore {
        let share = |part: f64, whole: f64| (whole > 0.0).then(|| part / whole);
        FreeGroundScore {
            found: share(self.found_m, self.free_m),
            wrong_m: share(self.wrong_m, self.columns as f64),
            wrong_columns: share(self.wrong_columns as f64, self.columns as f64),
        }
    }
}

/// How far ahead the polygon reaches along a direction, in metres right for each metre ahead: where the ray from the camera
/// leaves it for the first time after [`FROM_M`]; 0 if it does not contain the ray there.
fn reach_m(polygon: &[[f64; 2]], slope: f64) -> f64 {
    let off = |p: [f64; 2]| p[0] - slope * p[1];
    let mut crossings: Vec<f64> = Vec::new();
    for (k, &a) in polygon.iter().enumerate() {
        let b = polygon[(k + 1) % polygon.len()];
        let (da, db) = (off(a), off(b));
        if (da > 0.0) != (db > 0.0) {
            crossings.push(a[1] + (b[1] - a[1]) * da / (da - db));
        }
    }
    crossings.sort_unstable_by(f64::total_cmp);
    // Behind each pair of crossings the ray is outside again.
    let inside = crossings.chunks_exact(2).find(|pair| pair[0] <= FROM_M && pair[1] > FROM_M);
    inside.map_or(0.0, |pair| pair[1])
}

#[cfg(test)]
mod tests {
    use super::*;

    const RIG: Rig = Rig { focal_px: 100.0, baseline_m: 0.12, cx_px: 10.0, cy_px: 0.0 };

    fn truth(free: f32, blocked: f32) -> FreeGround {
        FreeGround { free_m: vec![free; 21], blocked_m: vec![blocked; 21] }
    }

    fn square(to: f64) -> Vec<[f64; 2]> {
        vec![[-5.0, 1.0], [5.0, 1.0], [5.0, to], [-5.0, to]]
    }

    #[test]
    fn free_ground_is_found_and_what_lies_behind_an_obstacle_is_wrong() {
        let score = |free, blocked, to| {
            let mut counts = FreeGroundCounts::default();
            counts.add(&truth(free, blocked), &RIG, &[square(to)]);
            counts.score()
        };
        let right = score(20.0, 20.0, 20.0);
        assert_eq!((right.found, right.wrong_m, right.wrong_columns), (Some(1.0), Some(0.0), Some(0.0)));
        let short = score(25.0, f32::INFINITY, 15.0);
        assert_eq!((short.found, short.wrong_m), (Some(0.5), Some(0.0)));
        let wrong = score(20.0, 20.0, 26.0);
        assert_eq!((wrong.found, wrong.wrong_m, wrong.wrong_columns), (Some(1.0), Some(6.0), Some(1.0)));
        // A lawn behind a kerb, then a hedge: free up to the hedge is no fault.
        assert_eq!(score(10.0, 30.0, 29.0).wrong_m, Some(0.0));
        assert_eq!(score(20.0, 20.0, 0.5).found, Some(0.0));
        let mut none = FreeGroundCounts::default();
        none.add(&truth(20.0, 30.0), &RIG, &[]);
        assert_eq!((none.score().found, none.score().wrong_m), (Some(0.0), Some(0.0)));
        assert_eq!(FreeGroundCounts::default().score(), FreeGroundScore::default());
    }

    #[test]
    fn a_ray_leaves_the_polygon_at_its_first_notch() {
        let notched = [
            [-5.0, 1.0],
            [5.0, 1.0],
            [5.0, 30.0],
            [0.5, 30.0],
            [0.5, 12.0],
            [-0.5, 12.0],
            [-0.5, 30.0],
            [-5.0, 30.0],
        ];
        assert!((reach_m(&notched, 0.0) - 12.0).abs() < 1e-9);
        assert!((reach_m(&notched, 0.1) - 30.0).abs() < 1e-9);
        assert_eq!(reach_m(&notched, 2.0), 0.0);
    }
}
