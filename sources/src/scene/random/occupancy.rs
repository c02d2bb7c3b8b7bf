//! Which space of a scene is taken, in positions along and across the road, so that nothing intersects.

/// Least distance between two objects along the road and across it, in metres: more than what bends shift.
const CLEAR_M: (f64, f64) = (0.6, 0.25);

/// Time between the compared positions of moving objects, in seconds: none passes another in between.
pub const STEP_S: f64 = 0.1;

/// A cuboid: from and to along the road, across it to the right, and up, in metres.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Solid {
    /// Along the road.
    pub along: (f64, f64),
    /// Across it.
    pub across: (f64, f64),
    /// Above it.
    pub up: (f64, f64),
}

impl Solid {
    fn hits(&self, other: &Self) -> bool {
        let meets = |a: (f64, f64), b: (f64, f64), clear: f64| a.0 < b.1 + clear && b.0 < a.1 + clear;
        meets(self.along, other.along, CLEAR_M.0)
            && meets(self.across, other.across, CLEAR_M.1)
            && meets(self.up, other.up, 0.0)
    }

    fn with(&self, other: &Self) -> Self {
        let both = |a: (f64, f64), b: (f64, f64)| (a.0.min(b.0), a.1.max(b.1));
        Self {
            along: both(self.along, other.along),
            across: both(self.across, other.across),
            up: both(self.up, other.up),
        }
    }
}

/// The space that is taken.
#[derive(Debug, Default)]
pub struct Occupancy {
    still: Vec<Solid>,
    /// For each moving object the space that it ever takes, and where it is at each step.
    moving: Vec<(Solid, Vec<Solid>)>,
}

impl Occupancy {
    /// Takes the space of a static object, of all its parts, unless any of it is taken.
    pub fn add_still(&mut self, parts: &[Solid]) -> bool {
        let is_taken = |part: &Solid| {
            let still = self.still.iter().any(|other| other.hits(part));
            still
                || self.moving.iter().any(|(all, steps)| all.hits(part) && steps.iter().any(|s| s.hits(part)))
        };
        if parts.iter().any(is_taken) {
            return false;
        }
        self.still.extend(parts);
        true
    }

    /// Takes the space of a moving object, given at each step, unless any of it is taken at that time.
    pub fn add_moving(&mut self, steps: Vec<Solid>) -> bool {
        let Some(all) = steps.iter().copied().reduce(|a, b| a.with(&b)) else { return false };
        let mut near = self.still.iter().filter(|other| other.hits(&all));
        let hits_still = near.any(|other| steps.iter().any(|step| step.hits(other)));
        let hits_moving = self
            .moving
            .iter()
            .any(|(others, other)| others.hits(&all) && steps.iter().zip(other).any(|(a, b)| a.hits(b)));
        if hits_still || hits_moving {
            return false;
        }
        self.moving.push((all, steps));
        true
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn solid(along: f64, across: f64) -> Solid {
        Solid { along: (along, along + 4.0), across: (across - 1.0, across + 1.0), up: (0.0, 1.5) }
    }

    #[test]
    fn taken_space_is_refused() {
        let mut space = Occupancy::default();
        assert!(space.add_still(&[solid(10.0, 0.0)]));
        assert!(!space.add_still(&[solid(13.0, 0.0)]) && !space.add_still(&[solid(14.3, 1.5)]));
        assert!(space.add_still(&[Solid { up: (2.0, 3.0), ..solid(10.0, 0.0) }]), "above it");
        assert!(space.add_still(&[solid(15.0, 0.0)]) && space.add_still(&[solid(10.0, 2.5)]));
        // Two vehicles on crossing ways at different times, and at the same time.
        let way = |t: usize, late: f64| solid(30.0 + t as f64 - late, 0.0);
        assert!(space.add_moving((0..40).map(|t| way(t, 0.0)).collect()));
        assert!(space.add_moving((0..40).map(|t| way(t, 6.0)).collect()));
        assert!(!space.add_moving((0..40).map(|t| way(t, 3.0)).collect()));
        assert!(!space.add_still(&[solid(50.0, 0.0)]));
        assert!(!space.add_moving((0..40).map(|t| solid(9.0, 0.5 * t as f64 - 6.0)).collect()));
    }
}
