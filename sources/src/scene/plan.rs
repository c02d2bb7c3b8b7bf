//! Horizontal course of the roads: positions and directions on the ground plane.

use super::file::BranchFile;
use super::motion::Waypoints;

/// Distance of the tabulated points of the reference line, in metres.
const STEP_M: f64 = 0.5;

/// Nodes and weights of Gauss-Legendre quadrature on [0, 1]. With steps of 0.5 m and the sharpest bend allowed the
/// error of a position is below a micrometre on 20 km.
const GAUSS: [(f64, f64); 3] =
    [(0.112_701_665_379_258_3, 5.0 / 18.0), (0.5, 4.0 / 9.0), (0.887_298_334_620_741_7, 5.0 / 18.0)];

/// A position on the ground plane and a direction.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PlanPose {
    /// Position to the right, in metres.
    pub x_m: f64,
    /// Position ahead, in metres.
    pub z_m: f64,
    /// Direction, in rad, to the right of the z axis.
    pub heading_rad: f64,
}

impl PlanPose {
    /// The point `right_m` to the right and `ahead_m` ahead of it, as (x, z).
    pub fn point(&self, right_m: f64, ahead_m: f64) -> [f64; 2] {
        let (sin, cos) = self.heading_rad.sin_cos();
        [self.x_m + right_m * cos + ahead_m * sin, self.z_m - right_m * sin + ahead_m * cos]
    }

    /// The point (x, z) as metres to the right of it and ahead of it.
    pub fn local(&self, [x, z]: [f64; 2]) -> [f64; 2] {
        let (sin, cos) = self.heading_rad.sin_cos();
        let (dx, dz) = (x - self.x_m, z - self.z_m);
        [dx * cos - dz * sin, dx * sin + dz * cos]
    }
}

/// The road's reference line on the ground plane, its curvature integrated twice, and the straight roads that branch off
/// it. Roads are numbered: 0 is the road itself, the branches follow.
#[derive(Clone, Debug)]
pub struct Plan {
    bend_per_km: Waypoints,
    is_straight: bool,
    from_m: f64,
    to_m: f64,
    nodes: Vec<PlanPose>,
    branches: Vec<PlanPose>,
}

impl Plan {
    /// The course with these bends, followed between two positions along the road; it is straight beyond them.
    pub fn new(bend_per_km: &Waypoints, branches: &[BranchFile], (from_m, to_m): (f64, f64)) -> Self {
        let mut plan = Self {
            bend_per_km: bend_per_km.clone(),
            is_straight: bend_per_km.is_always(0.0),
            from_m,
            to_m,
            nodes: Vec::new(),
            branches: Vec::new(),
        };
        if !plan.is_straight {
            let count = ((to_m - from_m) / STEP_M).ceil().max(1.0) as usize;
            let mut node = PlanPose { x_m: 0.0, z_m: from_m, heading_rad: plan.heading_rad(from_m) };
            plan.nodes.reserve(count + 1);
            for k in 0..count {
                plan.nodes.push(node);
                node = plan.onwards(node, from_m + k as f64 * STEP_M, STEP_M);
            }
            plan.nodes.push(node);
        }
        for branch in branches {
            let at = plan.road(branch.at_m);
            let heading_rad = at.heading_rad + branch.angle_deg.to_radians();
            plan.branches.push(PlanPose { heading_rad, ..at });
        }
        plan
    }

    /// Whether the reference line is straight.
    pub fn is_straight(&self) -> bool {
        self.is_straight
    }

    /// The part of the road that is followed, from and to, in metres along it.
    pub fn span_m(&self) -> (f64, f64) {
        (self.from_m, self.to_m)
    }

    /// Direction of the reference line within the table, in rad to the right.
    fn heading_rad(&self, along_m: f64) -> f64 {
        (self.bend_per_km.integral(along_m) - self.bend_per_km.integral(0.0)) / 1000.0
    }

    /// The pose `way_m` metres farther along the reference line, exact for bends that change linearly.
    fn onwards(&self, from: PlanPose, along_m: f64, way_m: f64) -> PlanPose {
        let (mut x_m, mut z_m) = (from.x_m, from.z_m);
        for (share, weight) in GAUSS {
            let (sin, cos) = self.heading_rad(along_m + share * way_m).sin_cos();
            x_m += weight * way_m * sin;
            z_m += weight * way_m * cos;
        }
        PlanPose { x_m, z_m, heading_rad: self.heading_rad(along_m + way_m) }
    }

    /// The reference line at a position along it.
    pub fn road(&self, along_m: f64) -> PlanPose {
        if self.is_straight {
            return PlanPose { x_m: 0.0, z_m: along_m, heading_rad: 0.0 };
        }
        let last = (self.nodes.len() - 1) as f64 * STEP_M;
        let way = (along_m - self.from_m).clamp(0.0, last);
        let k = ((way / STEP_M) as usize).min(self.nodes.len() - 1);
        let start = self.from_m + k as f64 * STEP_M;
        let pose = self.onwards(self.nodes[k], start, way - k as f64 * STEP_M);
        let [x_m, z_m] = pose.point(0.0, along_m - self.from_m - way);
        PlanPose { x_m, z_m, ..pose }
    }

    /// The road with this number at a position along it; the road itself if there is no such branch.
    pub fn at(&self, road: usize, along_m: f64) -> PlanPose {
        match road.checked_sub(1).and_then(|k| self.branches.get(k)) {
            Some(branch) => {
                let [x_m, z_m] = branch.point(0.0, along_m);
                PlanPose { x_m, z_m, ..*branch }
            }
            None => self.road(along_m),
        }
    }

    /// Curvature of the reference line, in 1/m, to the right positive.
    pub fn curvature_per_m(&self, along_m: f64) -> f64 {
        let last = self.nodes.len().saturating_sub(1) as f64 * STEP_M;
        let is_inside = (0.0..=last).contains(&(along_m - self.from_m));
        if is_inside && !self.is_straight { self.bend_per_km.value(along_m) / 1000.0 } else { 0.0 }
    }

    /// Position along the reference line, within a range, and distance to the right of it, of the point nearest to (x, z).
    pub fn project(&self, point: [f64; 2], (from_m, to_m): (f64, f64)) -> (f64, f64) {
        if self.is_straight {
            return (point[1].clamp(from_m, to_m), point[0]);
        }
        let off = |along_m: f64| self.road(along_m).local(point);
        let square = |pose: &PlanPose| (pose.x_m - point[0]).powi(2) + (pose.z_m - point[1]).powi(2);
        let last = self.nodes.len() - 1;
        let node = |along_m: f64| (((along_m - self.from_m) / STEP_M).max(0.0) as usize).min(last);
        let nodes = (node(from_m)..=node(to_m)).map(|k| (k, square(&self.nodes[k])));
        let nearest = nodes.min_by(|a, b| a.1.total_cmp(&b.1));
        let mut along_m = nearest.map_or(from_m, |(k, _)| self.from_m + k as f64 * STEP_M);
        for _ in 0..4 {
            let [right, ahead] = off(along_m);
            // Towards the centre of the bend the line's own length is reached sooner.
            let scale = (1.0 - right * self.curvature_per_m(along_m)).max(0.2);
            along_m = (along_m + ahead / scale).clamp(from_m, to_m);
        }
        (along_m, off(along_m)[0])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn plan(points: Vec<(f64, f64)>, branches: &[BranchFile]) -> Plan {
        Plan::new(&Waypoints::new(points).unwrap(), branches, (-100.0, 600.0))
    }

    #[test]
    fn a_constant_bend_is_a_circle() {
        let circle = plan(vec![(0.0, 100.0)], &[]);
        let centre = circle.road(0.0).point(10.0, 0.0);
        for k in 0..200 {
            let along = -20.0 + 0.37 * f64::from(k);
            let [right, ahead] = circle.road(along).local(centre);
            assert!((right - 10.0).abs() < 1e-8 && ahead.abs() < 1e-8, "{along}: {right} {ahead}");
            assert!((circle.road(along).heading_rad - along / 10.0).abs() < 1e-12);
        }
        // A quarter of the circle is 10 m to the right and 10 m ahead.
        let end = circle.road(5.0 * std::f64::consts::PI);
        let quarter = circle.road(0.0).local([end.x_m, end.z_m]);
        assert!((quarter[0] - 10.0).abs() < 1e-8 && (quarter[1] - 10.0).abs() < 1e-8, "{quarter:?}");
    }

    #[test]
    fn a_clothoid_is_that_of_fine_steps_and_the_line_goes_on_straight() {
        let road = plan(vec![(10.0, 0.0), (30.0, -40.0), (50.0, -40.0), (60.0, 10.0)], &[]);
        let (mut x, mut z, mut heading) = (0.0, 0.0, 0.0_f64);
        let step = 1e-4;
        let start = road.road(0.0);
        for k in 0..800_000 {
            let at = (f64::from(k) + 0.5) * step;
            let bend = road.curvature_per_m(at);
            heading += 0.5 * step * bend;
            (x, z) = (x + step * heading.sin(), z + step * heading.cos());
            heading += 0.5 * step * bend;
            if k % 99_999 == 0 {
                let there = road.road(at + 0.5 * step);
                let [right, ahead] = start.local([there.x_m, there.z_m]);
                assert!((right - x).abs() < 1e-5 && (ahead - z).abs() < 1e-5, "{at}");
            }
        }
        let (last, beyond) = (road.road(600.0), road.road(700.0));
        let [right, ahead] = last.local([beyond.x_m, beyond.z_m]);
        assert!(right.abs() < 1e-6 && (ahead - 100.0).abs() < 1e-6 && road.curvature_per_m(650.0) == 0.0);
    }

    #[test]
    fn a_point_is_projected_back_and_a_branch_is_straight() {
        let branch = BranchFile { at_m: 40.0, angle_deg: 90.0, from_m: -50.0, to_m: 50.0 };
        let road = plan(vec![(10.0, 0.0), (30.0, 100.0), (36.0, 100.0), (40.0, 0.0)], &[branch]);
        for (along, lateral) in [(0.0, 2.0), (25.0, -6.0), (33.0, 4.0), (38.0, -3.5), (80.0, 1.0)] {
            let point = road.road(along).point(lateral, 0.0);
            let (found, right) = road.project(point, (-20.0, 120.0));
            assert!(
                (found - along).abs() < 1e-6 && (right - lateral).abs() < 1e-6,
                "{along}: {found} {right}"
            );
        }
        let right = road.road(40.0).point(7.0, 0.0);
        let there = road.at(1, 7.0);
        assert!((there.x_m - right[0]).abs() < 1e-9 && (there.z_m - right[1]).abs() < 1e-9);
    }
}
