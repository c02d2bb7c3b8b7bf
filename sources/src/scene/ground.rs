//! Vertical course of the road, and the ground surfaces along a straight one.

use super::bay::BayFile;
use super::file::RoadFile;
use super::material::{Line, Look, Material, Style};
use super::mesh::{Axis, Face};
use super::motion::Waypoints;
use super::strip::{Cover, Side};
use super::truth::{ROAD, VERGE};

/// Distance up to which the course is integrated, in metres; the road continues straight beyond.
const FOLLOWED_M: f64 = 240.0;

/// Distance at which the ground ends, in metres.
const END_M: f64 = 3000.0;

/// Lateral extent of the ground, in metres.
pub const SIDE_M: f64 = 400.0;

/// Vertical course of the road.
#[derive(Clone, Debug)]
pub struct Course {
    grade_percent: Waypoints,
    even: bool,
}

/// Height of the road relative to the plane on which the vehicle stands.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Spot {
    /// Metres above the plane.
    pub up_m: f64,
    /// Metres of rise per metre ahead.
    pub slope: f64,
}

impl Course {
    /// The course described by a file.
    pub fn new(road: &RoadFile) -> Self {
        let grade_percent = road.grade_percent.clone();
        let even = grade_percent.is_always(grade_percent.value(0.0));
        Self { grade_percent, even }
    }

    /// Whether the grade never changes.
    pub fn is_even(&self) -> bool {
        self.even
    }

    /// Grade at a position along the road: metres of rise per metre.
    pub fn grade(&self, along_m: f64) -> f64 {
        self.grade_percent.value(along_m) / 100.0
    }

    /// Height of the road at a position along it, in metres; only differences have a meaning.
    pub fn rise_m(&self, along_m: f64) -> f64 {
        self.grade_percent.integral(along_m) / 100.0
    }

    /// The road `ahead_m` metres ahead of a vehicle at `along_m`, on a straight road. The vehicle stands level on the
    /// road.
    pub fn spot(&self, along_m: f64, ahead_m: f64) -> Spot {
        if self.even {
            return Spot { up_m: 0.0, slope: 0.0 };
        }
        let near = ahead_m.min(FOLLOWED_M);
        let there = along_m + near;
        let slope = self.grade(there) - self.grade(along_m);
        let beyond = ahead_m - near;
        Spot {
            up_m: self.rise_m(there) - self.rise_m(along_m) - self.grade(along_m) * near + slope * beyond,
            slope,
        }
    }

    /// Boundaries of the ground's strips, nearest first.
    fn knots(&self) -> impl Iterator<Item = f64> {
        let (even, mut at) = (self.even, -1.0_f64);
        std::iter::from_fn(move || {
            let now = at;
            if now >= END_M {
                return None;
            }
            at += match now {
                _ if even => 2.0 * END_M,
                z if z < 40.0 => 1.0,
                z if z < 100.0 => 2.0,
                z if z < FOLLOWED_M => 5.0,
                _ => 2.0 * END_M,
            };
            at = if at > END_M { END_M + 1.0 } else { at };
            Some(now)
        })
        .chain(std::iter::once(END_M))
    }
}

/// A strip of the road's cross-section, from one (lateral, up) to the next.
#[derive(Clone, Copy, Debug)]
pub struct Piece {
    /// Left side: metres right of the reference line, metres above it.
    pub from: (f64, f64),
    /// Right side.
    pub to: (f64, f64),
    /// Material.
    pub material: Material,
    /// [`ROAD`] or [`VERGE`].
    pub owner: u16,
}

/// Ground along the road: asphalt, kerbs, pavements, grass.
#[derive(Clone, Debug)]
pub struct Ground {
    pieces: Vec<Piece>,
    /// Whether objects stand on the ground of their place; else all stand at the height of the asphalt.
    carries: bool,
}

impl Ground {
    /// The ground described by a file.
    pub fn new(road: &RoadFile) -> Self {
        let (left, right) = road.edges_m;
        let asphalt = Material::new(Look::Road, 96.0, 1.0, 0.012);
        let mut pieces: Vec<Piece> = beside(road, Side::Left, left).into_iter().map(mirrored).collect();
        pieces.reverse();
        pieces.push(Piece { from: (left, 0.0), to: (right, 0.0), material: asphalt, owner: ROAD });
        pieces.extend(beside(road, Side::Right, right));
        pieces.retain(|piece| piece.from != piece.to);
        Self { pieces, carries: !road.strip.is_empty() }
    }

    /// Height of the lowest ground between two lateral positions, above the asphalt, where objects stand on the ground of
    /// their place; else 0. In metres.
    pub fn lowest_m(&self, from_m: f64, to_m: f64) -> f64 {
        if !self.carries {
            return 0.0;
        }
        let reached = self.pieces.iter().filter(|piece| piece.to.0 > from_m && piece.from.0 < to_m);
        reached.fold(f64::INFINITY, |least, piece| {
            let (a, b) = (piece.from, piece.to);
            let up =
                |lateral: f64| a.1 + (b.1 - a.1) * ((lateral - a.0) / (b.0 - a.0).max(1e-9)).clamp(0.0, 1.0);
            least.min(up(from_m.max(a.0))).min(up(to_m.min(b.0)))
        })
    }

    /// The pieces of its cross-section, from left to right; the outermost are grass.
    pub fn pieces(&self) -> &[Piece] {
        &self.pieces
    }

    /// Calls `each` with the ground's faces and their owners, for a vehicle at `along_m`, `lateral_m` on a straight road.
    pub fn faces(&self, course: &Course, along_m: f64, lateral_m: f64, mut each: impl FnMut(&Face, u16)) {
        let mut before: Option<(f64, Spot)> = None;
        for z in course.knots() {
            let spot = course.spot(along_m, z);
            if let Some((z0, spot0)) = before {
                let slope = (spot.up_m - spot0.up_m) / (z - z0);
                for piece in &self.pieces {
                    let corner = |(lateral, up): (f64, f64), z: f64, spot: Spot| {
                        [lateral - lateral_m, up + spot.up_m, z]
                    };
                    let corners = [
                        corner(piece.from, z0, spot0),
                        corner(piece.to, z0, spot0),
                        corner(piece.to, z, spot),
                        corner(piece.from, z, spot),
                    ];
                    let mut face = Face::new(&corners, piece.material);
                    let along = Axis { gradient: [0.0, 0.0, 1.0], start: along_m };
                    if piece.from.0 == piece.to.0 {
                        face.u = along;
                        let gradient = [0.0, 1.0, -slope];
                        face.v = Axis { gradient, start: slope * z0 - spot0.up_m };
                    } else {
                        face.u = Axis { gradient: [1.0, 0.0, 0.0], start: lateral_m };
                        face.v = along;
                        if face.normal[1] < 0.0 {
                            face.normal = face.normal.map(|v| -v);
                        }
                        // Invisible from below.
                        face.closed = true;
                    }
                    each(&face, piece.owner);
                }
            }
            before = Some((z, spot));
        }
    }
}

/// The ground on one side of the asphalt, whose edge is at `edge_m`, from there outwards: on the left side as in a mirror,
/// with laterals that increase outwards.
fn beside(road: &RoadFile, side: Side, edge_m: f64) -> Vec<Piece> {
    let mut at = (if side == Side::Left { -edge_m } else { edge_m }, 0.0);
    let mut pieces = Vec::new();
    let mut add = |across: f64, up: f64, (material, owner): (Material, u16)| {
        let to = (at.0 + across, at.1 + up);
        pieces.push(Piece { from: at, to, material, owner });
        at = to;
    };
    let mut below = 0.0;
    if road.strip.iter().any(|strip| strip.side == side) {
        for strip in road.strip.iter().filter(|strip| strip.side == side) {
            add(0.0, strip.step_m, Cover::Stone.surface());
            add(strip.width_m, strip.rise_m, strip.surface());
        }
    } else {
        add(0.0, road.kerb_m, Cover::Stone.surface());
        add(road.pavement_m, 0.0, Cover::Pavement.surface());
        // Grass begins a little below the slabs.
        below = if road.kerb_m > 0.0 { 0.02 } else { 0.0 };
    }
    let (outer, up) = (at.0, at.1 - below);
    let grass = Material::new(Look::Grass, 82.0, 0.55, 0.02);
    pieces.push(Piece { from: (outer, up), to: (SIDE_M, up), material: grass, owner: VERGE });
    pieces
}

/// A piece of the right side, on the left.
fn mirrored(piece: Piece) -> Piece {
    let over = |(lateral, up): (f64, f64)| (-lateral, up);
    Piece { from: over(piece.to), to: over(piece.from), ..piece }
}

/// Surface style of the road described by a file.
pub fn style(road: &RoadFile, wet: f64, snow: f64) -> Style {
    let line = |dashed: bool| move |&lateral: &f64| Line { lateral_m: lateral as f32, dashed };
    Style {
        lines: road.solid_m.iter().map(line(false)).chain(road.dashed_m.iter().map(line(true))).collect(),
        bays: road.bays.iter().map(BayFile::paint).collect(),
        asphalt: road.texture as f32,
        snow: snow as f32,
        wet: road.wet.max(wet) as f32,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn road(grade: Vec<(f64, f64)>) -> RoadFile {
        RoadFile { grade_percent: Waypoints::new(grade).unwrap(), ..RoadFile::default() }
    }

    #[test]
    fn a_constant_grade_is_a_plane() {
        let slope = Course::new(&road(vec![(0.0, 7.0)]));
        assert_eq!(slope.spot(30.0, 50.0).up_m, 0.0);
        assert_eq!((slope.grade(9.0), slope.rise_m(100.0)), (0.07, 7.0));
    }

    #[test]
    fn behind_a_crest_the_road_falls_away() {
        let crest = Course::new(&road(vec![(20.0, 5.0), (60.0, -5.0)]));
        let spot = crest.spot(20.0, 40.0);
        // The grade falls by 10 percent in 40 m: −0.1 · 40 ÷ 2.
        assert!((spot.up_m + 2.0).abs() < 1e-9, "{spot:?}");
        assert!((spot.slope + 0.1).abs() < 1e-12);
        let mut faces = 0;
        Ground::new(&RoadFile::default()).faces(&crest, 20.0, 0.0, |face, _| {
            faces += 1;
            // Strips are flat: the fourth corner lies in the plane of the others.
            let c = face.corners();
            let off = super::super::mesh::dot(face.normal, super::super::mesh::add(c[3], c[0], -1.0));
            assert!(off.abs() < 1e-9);
        });
        assert!(faces > 300, "{faces}");
    }
}
