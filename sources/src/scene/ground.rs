//! Course of the road and the ground surfaces along it.

use super::file::RoadFile;
use super::material::{Line, Look, Material, Style};
use super::mesh::{Axis, Face};
use super::motion::Waypoints;
use super::truth::{ROAD, VERGE};

/// Distance up to which the course is integrated, in metres; the road continues straight beyond.
const FOLLOWED_M: f64 = 240.0;

/// Distance at which the ground ends, in metres.
const END_M: f64 = 3000.0;

/// Lateral extent of the ground, in metres.
const SIDE_M: f64 = 400.0;

/// Horizontal and vertical course of the road.
#[derive(Clone, Debug)]
pub struct Course {
    grade_percent: Waypoints,
    bend_per_km: Waypoints,
    straight: bool,
}

/// A point of the road's reference line, in the road frame below the vehicle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Spot {
    /// Metres to the right of the vehicle.
    pub x_m: f64,
    /// Metres above the plane on which the vehicle stands.
    pub up_m: f64,
    /// Metres to the right per metre ahead.
    pub heading: f64,
    /// Metres of rise per metre ahead.
    pub slope: f64,
}

impl Course {
    /// The course described by a file.
    pub fn new(road: &RoadFile) -> Self {
        let (grade_percent, bend_per_km) = (road.grade_percent.clone(), road.bend_per_km.clone());
        let even = |line: &Waypoints| line.is_always(line.value(0.0));
        let straight = even(&grade_percent) && bend_per_km.is_always(0.0);
        Self { grade_percent, bend_per_km, straight }
    }

    /// The reference line `ahead_m` metres ahead of a vehicle at `along_m`. The vehicle stands level on the road
    /// and is aligned with it.
    pub fn spot(&self, along_m: f64, ahead_m: f64) -> Spot {
        if self.straight {
            return Spot { x_m: 0.0, up_m: 0.0, heading: 0.0, slope: 0.0 };
        }
        let near = ahead_m.min(FOLLOWED_M);
        let there = along_m + near;
        let grade = |at: f64| self.grade_percent.value(at) / 100.0;
        let rise = |at: f64| self.grade_percent.integral(at) / 100.0;
        let turn = |at: f64| self.bend_per_km.integral(at) / 1000.0;
        let offset = |at: f64| self.bend_per_km.double_integral(at) / 1000.0;
        let slope = grade(there) - grade(along_m);
        let heading = turn(there) - turn(along_m);
        let beyond = ahead_m - near;
        Spot {
            x_m: offset(there) - offset(along_m) - turn(along_m) * near + heading * beyond,
            up_m: rise(there) - rise(along_m) - grade(along_m) * near + slope * beyond,
            heading,
            slope,
        }
    }

    /// Boundaries of the ground's strips, nearest first.
    fn knots(&self) -> impl Iterator<Item = f64> {
        let (straight, mut at) = (self.straight, -1.0_f64);
        std::iter::from_fn(move || {
            let now = at;
            if now >= END_M {
                return None;
            }
            at += match now {
                _ if straight => 2.0 * END_M,
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
struct Piece {
    from: (f64, f64),
    to: (f64, f64),
    material: Material,
    owner: u16,
}

/// Ground along the road: asphalt, kerbs, pavements, grass.
#[derive(Clone, Debug)]
pub struct Ground {
    pieces: Vec<Piece>,
}

impl Ground {
    /// The ground described by a file.
    pub fn new(road: &RoadFile) -> Self {
        let (left, right) = road.edges_m;
        let (kerb, pavement) = (road.kerb_m, road.pavement_m);
        let asphalt = Material::new(Look::Road, 96.0, 1.0, 0.012);
        let stone = Material::new(Look::Plain, 158.0, 0.5, 0.02);
        let slabs = Material::new(Look::Paving, 138.0, 0.6, 0.015);
        let grass = Material::new(Look::Grass, 82.0, 0.55, 0.02);
        let mut pieces = Vec::new();
        let mut add = |from, to, material, owner| {
            if from != to {
                pieces.push(Piece { from, to, material, owner });
            }
        };
        let beyond = kerb - if kerb > 0.0 { 0.02 } else { 0.0 };
        add((-SIDE_M, beyond), (left - pavement, beyond), grass, VERGE);
        add((left - pavement, kerb), (left, kerb), slabs, VERGE);
        add((left, kerb), (left, 0.0), stone, VERGE);
        add((left, 0.0), (right, 0.0), asphalt, ROAD);
        add((right, 0.0), (right, kerb), stone, VERGE);
        add((right, kerb), (right + pavement, kerb), slabs, VERGE);
        add((right + pavement, beyond), (SIDE_M, beyond), grass, VERGE);
        Self { pieces }
    }

    /// Calls `each` with the ground's faces and their owners, for a vehicle at `along_m`, `lateral_m`.
    pub fn faces(&self, course: &Course, along_m: f64, lateral_m: f64, mut each: impl FnMut(&Face, u16)) {
        let mut before: Option<(f64, Spot)> = None;
        for z in course.knots() {
            let spot = course.spot(along_m, z);
            if let Some((z0, spot0)) = before {
                let (heading, slope) =
                    ((spot.x_m - spot0.x_m) / (z - z0), (spot.up_m - spot0.up_m) / (z - z0));
                for piece in &self.pieces {
                    let corner = |(lateral, up): (f64, f64), z: f64, spot: Spot| {
                        [lateral + spot.x_m - lateral_m, up + spot.up_m, z]
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
                        let gradient = [1.0, 0.0, -heading];
                        face.u = Axis { gradient, start: lateral_m - spot0.x_m + heading * z0 };
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

/// Surface style of the road described by a file.
pub fn style(road: &RoadFile, wet: f64, snow: f64) -> Style {
    let line = |dashed: bool| move |&lateral: &f64| Line { lateral_m: lateral as f32, dashed };
    Style {
        lines: road.solid_m.iter().map(line(false)).chain(road.dashed_m.iter().map(line(true))).collect(),
        asphalt: road.texture as f32,
        snow: snow as f32,
        wet: road.wet.max(wet) as f32,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn road(grade: Vec<(f64, f64)>, bend: Vec<(f64, f64)>) -> RoadFile {
        RoadFile {
            grade_percent: Waypoints::new(grade).unwrap(),
            bend_per_km: Waypoints::new(bend).unwrap(),
            ..RoadFile::default()
        }
    }

    #[test]
    fn a_constant_grade_is_a_plane_and_a_bend_is_a_parabola() {
        let slope = Course::new(&road(vec![(0.0, 7.0)], vec![(0.0, 0.0)]));
        assert_eq!(slope.spot(30.0, 50.0).up_m, 0.0);
        let bend = Course::new(&road(vec![(0.0, 0.0)], vec![(0.0, 10.0)]));
        // A radius of 100 m: 30 m ahead the road is 4.5 m to the right (z² ÷ 2r).
        let spot = bend.spot(200.0, 30.0);
        assert!((spot.x_m - 4.5).abs() < 1e-9 && (spot.heading - 0.3).abs() < 1e-12, "{spot:?}");
    }

    #[test]
    fn behind_a_crest_the_road_falls_away() {
        let crest = Course::new(&road(vec![(20.0, 5.0), (60.0, -5.0)], vec![(0.0, 0.0)]));
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
