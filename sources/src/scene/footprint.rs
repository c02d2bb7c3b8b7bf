//! Where objects stand relative to the vehicle's path.

use super::truth::{FIRST_OBJECT, ObjectClass};
use super::world::{HALF_PATH_M, Present, World};

/// Length of the path that is looked at, in metres.
const PATH_M: f64 = 220.0;

/// Greatest distance of two compared points of an outline, in metres.
const OUTLINE_STEP_M: f64 = 0.5;

/// An object relative to the path.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Footprint {
    /// Whether any part of it is in the strip that the vehicle will drive through.
    pub in_path: bool,
    /// Way of the vehicle to its nearest part, in metres; `None` on a straight road, where it is the distance.
    pub along_m: Option<f64>,
}

impl World {
    /// The nearest named object in the vehicle's path, other than a bridge, of those that are placed for this time.
    pub fn target(&self, time_s: f64) -> Option<u16> {
        let named = self.present.iter().filter(|present| {
            let instance = &self.instances()[present.instance];
            instance.subject && instance.class != ObjectClass::Bridge
        });
        let ahead = named.filter_map(|present| {
            let footprint = self.footprint(present, time_s);
            let along_m = footprint.along_m.unwrap_or(present.placement.at[2]);
            (footprint.in_path && along_m > 0.0).then_some((present.instance, along_m))
        });
        ahead.min_by(|a, b| a.1.total_cmp(&b.1)).map(|(k, _)| FIRST_OBJECT + k as u16)
    }

    /// Where an object stands relative to the vehicle's path.
    pub fn footprint(&self, present: &Present, time_s: f64) -> Footprint {
        let half = present.size_m[0] / 2.0;
        if !self.route.turns() {
            return Footprint { in_path: present.from_path_m.abs() - half < HALF_PATH_M, along_m: None };
        }
        let stand = self.route.stand(time_s);
        let plan = &self.route.plan;
        let long = present.size_m[2];
        let point = |right: f64, ahead: f64| {
            let [x, _, z] = present.placement.place([right, 0.0, ahead]);
            stand.at.point(x, z)
        };
        let way_m = |along_m: f64| self.route.way_m(stand.along_m, along_m, stand.lateral_m);
        let whole = (stand.along_m, stand.along_m + PATH_M);
        let (middle, off) = plan.project(point(0.0, long / 2.0), whole);
        let radius = half.hypot(long / 2.0);
        if (off - stand.lateral_m).abs() > HALF_PATH_M + radius {
            return Footprint { in_path: false, along_m: Some(way_m(middle) - long / 2.0) };
        }
        let radius = radius + 2.0;
        let part = ((middle - radius).max(whole.0), (middle + radius).min(whole.1));
        let steps = |length: f64| (length / OUTLINE_STEP_M).ceil().max(1.0);
        let mut nearest = f64::INFINITY;
        let (mut leftmost, mut rightmost) = (f64::INFINITY, f64::NEG_INFINITY);
        let (columns, rows) = (steps(2.0 * half), steps(long));
        for row in 0..=rows as usize {
            for column in 0..=columns as usize {
                let right = half * (2.0 * column as f64 / columns - 1.0);
                let (along, off) = plan.project(point(right, long * row as f64 / rows), part);
                nearest = nearest.min(along);
                // What is beside or behind the vehicle is no longer in its path.
                if along > stand.along_m {
                    leftmost = leftmost.min(off - stand.lateral_m);
                    rightmost = rightmost.max(off - stand.lateral_m);
                }
            }
        }
        Footprint {
            in_path: leftmost < HALF_PATH_M && rightmost > -HALF_PATH_M,
            along_m: Some(way_m(nearest)),
        }
    }
}
