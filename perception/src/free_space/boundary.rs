//! A boundary beside the path: a wall, a hedge, a fence, a guard rail, the fronts of houses, as a curve on the ground.

use crate::motion::planar::Planar;

/// Maximum number of points of a boundary.
pub const MAX_POINTS: usize = 24;

/// Maximum number of boundaries.
pub const MAX_BOUNDARIES: usize = 8;

/// Largest sine of the angle between the line of sight and what leads obliquely across the path: 60°.
const OBLIQUE_SINE: f64 = 0.87;

/// A point at the foot of a boundary.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct BoundaryPoint {
    /// Lateral position, in metres right of the camera axis.
    pub lateral_m: f64,
    /// Distance along z, in metres.
    pub distance_m: f64,
    /// Height above the road, in metres; at most the largest height of an obstacle.
    pub height_m: f64,
    /// Standard deviation of the position across the boundary, in metres.
    pub sigma_m: f64,
    /// Length of the surface that was seen between the point before it and this one, in metres; 0 for the first point, and across gaps
    /// that somebody may pass.
    pub solid_m: f64,
    /// How long the point has not been seen, as a part of [`super::limits::FORGET_S`], in seconds: slower while something hides it,
    /// faster where what is behind it is seen.
    pub unseen_s: f64,
}

impl BoundaryPoint {
    /// Distance from another one, in metres.
    pub(crate) fn apart_m(&self, other: &Self) -> f64 {
        (self.lateral_m - other.lateral_m).hypot(self.distance_m - other.distance_m)
    }
}

/// Where a boundary stands.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Side {
    /// Left of the own path.
    #[default]
    Left,
    /// Right of it.
    Right,
    /// Across it.
    Across,
}

/// A boundary: a curve on the ground, its points from left to right as the camera sees them.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Boundary {
    /// Number that it keeps as long as it is seen.
    pub id: u32,
    /// Where it stands.
    pub side: Side,
    points: [BoundaryPoint; MAX_POINTS],
    count: usize,
}

impl Boundary {
    /// The points.
    pub fn points(&self) -> &[BoundaryPoint] {
        &self.points[..self.count]
    }

    pub(crate) fn points_mut(&mut self) -> &mut [BoundaryPoint] {
        &mut self.points[..self.count]
    }

    /// Removes all points.
    pub(crate) fn clear(&mut self) {
        self.count = 0;
    }

    /// Removes the fewest points so that the rest are ordered from left to right, of equally many the least certain: where a boundary leads
    /// almost towards the camera, errors, and what is hidden behind a corner, put points behind each other.
    pub(crate) fn put_in_order(&mut self) {
        let before = *self;
        let points = before.points();
        let slope = |i: usize| points[i].lateral_m / points[i].distance_m;
        if (1..points.len()).all(|i| slope(i - 1) < slope(i)) {
            return;
        }
        // The longest increasing subsequence that ends at each point: its length, the sum of its errors, and the point before.
        let mut chains = [(1, 0.0, None); MAX_POINTS];
        let is_better = |a: &(usize, f64, Option<usize>), b: &(usize, f64, Option<usize>)| {
            a.0.cmp(&b.0).then(b.1.total_cmp(&a.1))
        };
        for (i, point) in points.iter().enumerate() {
            let earlier = (0..i).filter(|j| slope(*j) < slope(i));
            let last = earlier.max_by(|a, b| is_better(&chains[*a], &chains[*b]));
            let (count, sigma_m) = last.map_or((0, 0.0), |j| (chains[j].0, chains[j].1));
            chains[i] = (count + 1, sigma_m + point.sigma_m, last);
        }
        let mut is_kept = [false; MAX_POINTS];
        let mut at = (0..points.len()).max_by(|a, b| is_better(&chains[*a], &chains[*b]));
        while let Some(i) = at {
            is_kept[i] = true;
            at = chains[i].2;
        }
        self.clear();
        // Where nothing was seen between two points that stay, nothing is seen now.
        let mut unseen_m = 0.0;
        for (i, (point, is_kept)) in points.iter().zip(is_kept).enumerate() {
            let step_m = i.checked_sub(1).map_or(0.0, |last| points[last].apart_m(point));
            unseen_m += (step_m - point.solid_m).max(0.0);
            if is_kept {
                let apart_m = self.points().last().map_or(0.0, |last| last.apart_m(point));
                self.push(BoundaryPoint { solid_m: (apart_m - unseen_m).max(0.0), ..*point });
                unseen_m = 0.0;
            }
        }
    }

    /// Adds a point; returns whether there was room.
    pub(crate) fn push(&mut self, point: BoundaryPoint) -> bool {
        let has_room = self.count < MAX_POINTS;
        if has_room {
            let solid_m = if self.count == 0 { 0.0 } else { point.solid_m };
            self.points[self.count] = BoundaryPoint { solid_m, ..point };
            self.count += 1;
        }
        has_room
    }

    /// Length of what was seen of it, in metres.
    pub(crate) fn solid_m(&self) -> f64 {
        self.points().iter().map(|point| point.solid_m).sum()
    }

    /// Length in metres.
    pub fn length_m(&self) -> f64 {
        let step = |pair: &[BoundaryPoint]| {
            (pair[1].lateral_m - pair[0].lateral_m).hypot(pair[1].distance_m - pair[0].distance_m)
        };
        self.points().windows(2).map(step).sum()
    }

    /// Where the ray with this slope (metres right a metre ahead) meets it: distance, height and standard deviation
    /// there, and the distance of the camera from its line, all in metres.
    pub fn meet(&self, slope: f64) -> Option<Meeting> {
        let across = |p: &BoundaryPoint| p.lateral_m - slope * p.distance_m;
        self.points().windows(2).find_map(|pair| {
            let [a, b] = [&pair[0], &pair[1]];
            let [from, to] = [across(a), across(b)];
            if from > 0.0 || to < 0.0 || to - from < 1e-9 {
                return None;
            }
            let share = -from / (to - from);
            let mix = |value: fn(&BoundaryPoint) -> f64| value(a) + share * (value(b) - value(a));
            let [right, ahead] = [b.lateral_m - a.lateral_m, b.distance_m - a.distance_m];
            let line_m = (a.lateral_m * ahead - a.distance_m * right).abs() / right.hypot(ahead).max(1e-9);
            let distance_m = mix(|p| p.distance_m);
            Some(Meeting {
                distance_m,
                is_oblique: line_m < OBLIQUE_SINE * distance_m,
                height_m: mix(|p| p.height_m),
                sigma_m: mix(|p| p.sigma_m),
                line_m,
            })
        })
    }

    /// By how much a place, in metres right and ahead of the camera, stands before it on the camera's side, measured across it, in
    /// metres, and where the ray to it meets the boundary; negative behind it. `None` where it does not.
    pub fn before_m(&self, [right_m, ahead_m]: Planar) -> Option<(f64, Meeting)> {
        let meeting = self.meet(right_m / ahead_m.max(1e-3))?;
        Some((meeting.line_m * (1.0 - ahead_m / meeting.distance_m.max(1e-3)), meeting))
    }
}

/// How a thing stands before a wall that is as high.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BeforeWall {
    /// By how much its farthest point reaches out of the wall, in metres; negative behind its face.
    pub reach_m: f64,
    /// The same of its nearest point.
    pub nearest_m: f64,
    /// Whether it stands in the own path, or the wall across it: it is a thing then, even if it is flush with the wall.
    pub is_in_path: bool,
}

/// Where a ray meets a boundary.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Meeting {
    /// Distance along z, in metres.
    pub distance_m: f64,
    /// Height of the boundary there, in metres.
    pub height_m: f64,
    /// Standard deviation across the boundary, in metres.
    pub sigma_m: f64,
    /// Distance of the camera from the line of the boundary there, in metres.
    pub line_m: f64,
    /// Whether it goes on obliquely there, by at most 60°: the road may bend along it, and does not end there.
    pub is_oblique: bool,
}
