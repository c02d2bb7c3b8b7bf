//! Ground of a road with bends and of the roads that branch off it: the same surfaces, at the same places of the world, in
//! every frame.

use super::file::RoadFile;
use super::ground::{Ground, Piece, SIDE_M};
use super::material::{Look, Material};
use super::mesh::{Axis, Face, Point};
use super::motion::Waypoints;
use super::plan::PlanPose;
use super::route::{Route, Standpoint};
use super::truth::VERGE;

/// Greatest distance of a strip of road from the vehicle, in metres.
const DRAWN_M: f64 = 260.0;

/// Half the side of the grass plane, in metres.
const PLANE_M: f64 = 3000.0;

/// Depth of the grass plane below the road, in metres.
const PLANE_DEPTH_M: f64 = 0.03;

/// Depth of the pavements below the asphalt where roads branch off: asphalt covers them. In metres.
const PAVEMENT_DEPTH_M: f64 = 0.012;

/// Depth of each branch below the one before it, in metres: of two surfaces at the same height each camera would see now
/// the one and now the other.
const BRANCH_DEPTH_M: f64 = 0.0005;

/// Width of the bank between the road and the grass plane of level roads, in metres.
const BANK_M: f64 = 1.0;

/// Greatest distance of a strip's chord from the reference line, in metres.
const SAGITTA_M: f64 = 0.004;

/// Length of a strip, in metres: least, greatest, and greatest where the grade changes.
const STRIP_M: (f64, f64, f64) = (0.25, 20.0, 1.0);

/// A position along a road where two strips meet.
#[derive(Clone, Copy, Debug)]
struct Knot {
    along_m: f64,
    at: PlanPose,
    rise_m: f64,
}

/// The ground of a road with bends and of its branches.
#[derive(Clone, Debug)]
pub struct Streets {
    /// The knots and the cross-section of each road.
    roads: Vec<(Vec<Knot>, Vec<Piece>)>,
    grass: Material,
    /// Height of the grass plane, in metres.
    plane_m: f64,
}

impl Streets {
    /// The ground of a route.
    pub fn new(road: &RoadFile, route: &Route) -> Self {
        let ground = Ground::new(road);
        let mut roads = vec![knots(road, route, route.plan.span_m())];
        let along_branch = |(k, branch): (usize, &super::file::BranchFile)| {
            let ends = [branch.from_m, branch.to_m];
            let knot = |along_m| Knot { along_m, at: route.plan.at(k + 1, along_m), rise_m: 0.0 };
            ends.map(knot).to_vec()
        };
        roads.extend(road.branch.iter().enumerate().map(along_branch));
        let is_level = road.grade_percent.is_always(0.0);
        let lowest = roads[0].iter().fold(f64::MAX, |least, knot| least.min(knot.rise_m));
        let pieces = ground.pieces();
        // Ditches lie above the plane.
        let depth_m = pieces.iter().fold(0.0_f64, |least, piece| least.min(piece.from.1).min(piece.to.1));
        let foot_m = depth_m - PLANE_DEPTH_M;
        let plane_m = lowest + foot_m;
        let sides = (pieces[0].to.0, pieces[pieces.len() - 1].from.0);
        // The bank of a level road ends on the plane; that of a hilly one reaches as far as the bends allow.
        let radius_m = 1000.0 / road.bend_per_km.max_abs().max(1e-9);
        let farthest = if is_level { BANK_M } else { SIDE_M.min(0.9 * radius_m) };
        let reach =
            |side: f64| if is_level { side.abs() + BANK_M } else { farthest.max(side.abs() + BANK_M) };
        let ends = (-reach(sides.0), reach(sides.1));
        let section = |k: usize| -> Vec<Piece> {
            let depth = if road.branch.is_empty() { 0.0 } else { PAVEMENT_DEPTH_M };
            let own = k as f64 * BRANCH_DEPTH_M;
            let lower = |piece: &Piece| {
                let mut piece = *piece;
                let down = own + if piece.owner == VERGE { depth } else { 0.0 };
                (piece.from.1, piece.to.1) = (piece.from.1 - down, piece.to.1 - down);
                let foot = |up: f64| if is_level { foot_m } else { up };
                if piece.from.0 <= -SIDE_M {
                    piece.from = (ends.0, foot(piece.from.1));
                }
                if piece.to.0 >= SIDE_M {
                    piece.to = (ends.1, foot(piece.to.1));
                }
                piece
            };
            ground.pieces().iter().map(lower).collect()
        };
        let grass = ground.pieces()[0].material;
        debug_assert_eq!(grass.look, Look::Grass);
        let roads = roads.into_iter().enumerate().map(|(k, knots)| (knots, section(k))).collect();
        Self { roads, grass, plane_m }
    }

    /// Calls `each` with the ground's faces and their owners, for a vehicle that stands there.
    pub fn faces(&self, stand: &Standpoint, mut each: impl FnMut(&Face, u16)) {
        each(&self.plane(stand), VERGE);
        for (knots, pieces) in &self.roads {
            for pair in knots.windows(2) {
                let strip = Strip::new(stand, &pair[0], &pair[1]);
                if strip.is_near() {
                    pieces.iter().for_each(|piece| each(&strip.face(piece), piece.owner));
                }
            }
        }
    }

    /// The plane of grass below everything.
    fn plane(&self, stand: &Standpoint) -> Face {
        let corner = |right: f64, ahead: f64| stand.see(stand.at.point(right, ahead), self.plane_m);
        let corners = [
            corner(-PLANE_M, -1.0),
            corner(PLANE_M, -1.0),
            corner(PLANE_M, PLANE_M),
            corner(-PLANE_M, PLANE_M),
        ];
        let mut face = Face::new(&corners, self.grass);
        // Its texture lies still in the world.
        let PlanPose { x_m, z_m, heading_rad } = stand.at;
        let (sin, cos) = heading_rad.sin_cos();
        face.u = Axis { gradient: [cos, 0.0, sin], start: x_m };
        face.v = Axis { gradient: [-sin, 0.0, cos], start: z_m };
        upwards(face)
    }
}

/// The knots of the road itself, dense in bends.
fn knots(road: &RoadFile, route: &Route, (from_m, to_m): (f64, f64)) -> Vec<Knot> {
    let is_bent = |line: &Waypoints| !line.is_always(line.value(0.0));
    let longest = if is_bent(&road.grade_percent) { STRIP_M.2 } else { STRIP_M.1 };
    let bend = |along_m: f64| route.plan.curvature_per_m(along_m).abs();
    let mut knots = Vec::new();
    let mut along_m = from_m;
    loop {
        let at = route.plan.road(along_m);
        knots.push(Knot { along_m, at, rise_m: route.course.rise_m(along_m) });
        if along_m >= to_m {
            return knots;
        }
        let mut length = longest;
        // The sharpest bend within the strip decides.
        while length > STRIP_M.0 {
            let sharpest = (0..=8).map(|k| bend(along_m + length * f64::from(k) / 8.0)).fold(0.0, f64::max);
            if sharpest * length * length / 8.0 <= SAGITTA_M {
                break;
            }
            length *= 0.8;
        }
        along_m = (along_m + length).min(to_m);
    }
}

/// A piece of road between two knots, in the vehicle's frame.
struct Strip {
    ends: [Point; 2],
    /// Direction to the right at either end, (x, z).
    right: [[f64; 2]; 2],
    /// Direction of the chord, (x, z).
    along: [f64; 2],
    /// Metres of the road for each metre of the chord.
    stretch: f64,
    slope: f64,
    along_m: f64,
    /// Rise of what is level for each metre ahead.
    tilt: f64,
}

impl Strip {
    fn new(stand: &Standpoint, a: &Knot, b: &Knot) -> Self {
        let ends = [a, b].map(|knot| stand.see([knot.at.x_m, knot.at.z_m], knot.rise_m));
        let right = [a, b].map(|knot| {
            let (sin, cos) = (knot.at.heading_rad - stand.at.heading_rad).sin_cos();
            [cos, -sin]
        });
        let (dx, dz) = (ends[1][0] - ends[0][0], ends[1][2] - ends[0][2]);
        let length = dx.hypot(dz).max(1e-9);
        let slope = (ends[1][1] - ends[0][1]) / length;
        let along = [dx / length, dz / length];
        Self {
            ends,
            right,
            along,
            stretch: (b.along_m - a.along_m) / length,
            slope,
            along_m: a.along_m,
            tilt: stand.tilt(),
        }
    }

    /// Whether it may be seen.
    fn is_near(&self) -> bool {
        let [a, b] = self.ends;
        let length = (b[0] - a[0]).hypot(b[2] - a[2]);
        let is_ahead = a[2].max(b[2]) > -SIDE_M;
        is_ahead && a[0].hypot(a[2]).min(b[0].hypot(b[2])) < DRAWN_M + length
    }

    fn corner(&self, end: usize, (lateral, up): (f64, f64)) -> Point {
        let ([x, y, z], [right_x, right_z]) = (self.ends[end], self.right[end]);
        let (dx, dz) = (lateral * right_x, lateral * right_z);
        [x + dx, y + up + self.tilt * dz, z + dz]
    }

    fn face(&self, piece: &Piece) -> Face {
        let corners = [
            self.corner(0, piece.from),
            self.corner(0, piece.to),
            self.corner(1, piece.to),
            self.corner(1, piece.from),
        ];
        let mut face = Face::new(&corners, piece.material);
        let [x, y, z] = self.ends[0];
        let [ax, az] = self.along;
        let gradient = [ax * self.stretch, 0.0, az * self.stretch];
        let along = Axis { gradient, start: self.along_m - gradient[0] * x - gradient[2] * z };
        if piece.from.0 == piece.to.0 {
            face.u = along;
            let gradient = [-self.slope * ax, 1.0, -self.slope * az];
            face.v = Axis { gradient, start: -y - gradient[0] * x - gradient[2] * z };
            face
        } else {
            face.u = Axis { gradient: [az, 0.0, -ax], start: ax * z - az * x };
            face.v = along;
            upwards(face)
        }
    }
}

/// The face, visible from above only.
fn upwards(mut face: Face) -> Face {
    if face.normal[1] < 0.0 {
        face.normal = face.normal.map(|v| -v);
    }
    face.closed = true;
    face
}
