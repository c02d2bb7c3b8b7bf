//! The path ahead: the strip that the vehicle's body will sweep.
//!
//! The centre of the rear axle moves along an arc; farther ahead the path may follow another arc, that of the road's
//! edges. About the turning centre the body sweeps a ring: on the inner side half its width, on the outer side as far as
//! its front corner swings out. A place is described along the path: arc length from the rear axle, and offset from the
//! arc, to the right positive. Lengths in metres, curvature in 1/m and to the left positive, places in the camera's axes.

use super::body::Body;
use super::planar::Planar;

/// Largest curvature of a path, in 1/m: the turning circle of a car.
pub const MAX_CURVATURE_PER_M: f64 = 0.2;

/// A driver's steering as a random walk of the lateral acceleration, in m/s² per √s: 0.15 m of path after 1.5 s.
pub const STEERING_M_S2: f64 = 0.25;

/// What a driver in a bend changes beyond that, as a share of the lateral acceleration: bends begin and end.
const BEND_STEERING_SHARE: f64 = 0.5;

/// Speed below which the time to a place is counted as at this speed, in m/s.
const MIN_SPEED_M_S: f64 = 2.0;

/// Speed below which the vehicle stands, in m/s: less than a car creeps.
const MAX_REST_SPEED_M_S: f64 = 0.3;

/// The path from a length on follows the edges of the road.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EdgesAhead {
    /// Arc length from the rear axle, in metres.
    pub from_m: f64,
    /// Curvature from there on, in 1/m.
    pub curvature_per_m: f64,
}

/// The strip that the body sweeps.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SweptPath {
    /// Curvature of the rear axle's path, in 1/m, within ±[`MAX_CURVATURE_PER_M`].
    pub curvature_per_m: f64,
    /// Its standard deviation, in 1/m.
    pub curvature_sigma_per_m: f64,
    /// Own speed, in m/s.
    pub speed_m_s: f64,
    /// Its standard deviation, in m/s.
    pub speed_sigma_m_s: f64,
    /// The vehicle.
    pub body: Body,
    /// The path farther ahead; `None` if the arc goes on.
    pub edges: Option<EdgesAhead>,
    /// Whether a turn begins: the arc still tightens, so what lies seconds ahead on it is not yet known to be in the way.
    pub is_turning_in: bool,
}

/// A place along a path.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct AlongPath {
    /// Arc length from the rear axle, in metres: along less than half a turn, negative behind.
    pub arc_m: f64,
    /// Distance from the arc to the right, in metres.
    pub offset_m: f64,
    /// Heading of the path there, relative to the camera, in rad, to the left positive.
    pub heading_rad: f64,
}

/// A place in vehicle axes along an arc from the origin.
fn along_arc(curvature: f64, [x, z]: Planar) -> AlongPath {
    let (across, ahead) = (1.0 + curvature * x, curvature * z);
    let root = across.hypot(ahead);
    let heading_rad = ahead.atan2(across);
    AlongPath {
        // Beside the turning centre the angle is exact; on a straight line its limit.
        arc_m: if curvature.abs() > 1e-9 { heading_rad / curvature } else { z },
        offset_m: (2.0 * x + curvature * (x * x + z * z)) / (root + 1.0),
        heading_rad,
    }
}

/// End of an arc of this length from the origin, in vehicle axes.
fn arc_end(curvature: f64, length: f64) -> Planar {
    let half = curvature * length / 2.0;
    let chord = length * if half.abs() < 1e-6 { 1.0 } else { half.sin() / half };
    [-chord * half.sin(), chord * half.cos()]
}

/// The place `p` seen from `origin` with the axes turned to the left by `heading`.
fn seen_from(p: Planar, origin: Planar, heading: f64) -> Planar {
    let (sine, cosine) = heading.sin_cos();
    let (x, z) = (p[0] - origin[0], p[1] - origin[1]);
    [cosine * x + sine * z, cosine * z - sine * x]
}

impl SweptPath {
    /// A place in the camera's axes in those of the vehicle, about its rear axle.
    fn in_vehicle(&self, place: Planar) -> Planar {
        let [right, ahead] = self.body.turn_to_vehicle(place);
        [right + self.body.camera_right_m, ahead + self.body.rear_axle_m]
    }

    /// A place along the path.
    pub fn along(&self, place: Planar) -> AlongPath {
        let place = self.in_vehicle(place);
        let mut first = along_arc(self.curvature_per_m, place);
        first.heading_rad -= self.body.camera_yaw_rad;
        let Some(edges) = self.edges.filter(|edges| first.arc_m > edges.from_m) else { return first };
        let heading = self.curvature_per_m * edges.from_m;
        let from = arc_end(self.curvature_per_m, edges.from_m);
        let second = along_arc(edges.curvature_per_m, seen_from(place, from, heading));
        let heading_rad = heading + second.heading_rad - self.body.camera_yaw_rad;
        AlongPath { arc_m: edges.from_m + second.arc_m, heading_rad, ..second }
    }

    /// The place at this arc length from the rear axle and this offset to the right, in the camera's axes.
    pub fn place(&self, arc_m: f64, offset_m: f64) -> Planar {
        let first_m = self.edges.map_or(arc_m, |edges| arc_m.min(edges.from_m));
        let mut place = arc_end(self.curvature_per_m, first_m);
        let mut heading = self.curvature_per_m * first_m;
        if let Some(edges) = self.edges.filter(|edges| arc_m > edges.from_m) {
            let (sine, cosine) = heading.sin_cos();
            let [x, z] = arc_end(edges.curvature_per_m, arc_m - edges.from_m);
            place = [place[0] + cosine * x - sine * z, place[1] + sine * x + cosine * z];
            heading += edges.curvature_per_m * (arc_m - edges.from_m);
        }
        let (sine, cosine) = heading.sin_cos();
        self.body.turn_to_camera([
            place[0] + cosine * offset_m - self.body.camera_right_m,
            place[1] + sine * offset_m - self.body.rear_axle_m,
        ])
    }

    /// Whether the vehicle stands.
    pub fn is_at_rest(&self) -> bool {
        self.speed_m_s.abs() < MAX_REST_SPEED_M_S.max(2.0 * self.speed_sigma_m_s)
    }

    /// Curvature at this arc length.
    pub fn curvature_at(&self, arc_m: f64) -> f64 {
        self.edges.filter(|edges| arc_m > edges.from_m).map_or(self.curvature_per_m, |e| e.curvature_per_m)
    }

    /// How far the body reaches to the left and to the right of its rear axle's arc at this arc length, in metres, both
    /// positive: on the outer side the front swings out.
    pub fn reach_m(&self, arc_m: f64) -> [f64; 2] {
        let half_m = self.body.width_m / 2.0;
        let curvature = self.curvature_at(arc_m).abs();
        let front_m = self.body.front_m + self.body.rear_axle_m;
        let corner = (1.0 + curvature * half_m).hypot(curvature * front_m);
        let outer_m = (2.0 * half_m + curvature * (half_m * half_m + front_m * front_m)) / (corner + 1.0);
        if self.curvature_at(arc_m) > 0.0 { [half_m, outer_m] } else { [outer_m, half_m] }
    }

    /// Standard deviation of the path across at this arc length, in metres: of the curvature, and what the driver may
    /// change until then.
    pub fn sigma_m(&self, arc_m: f64) -> f64 {
        self.sigma_after_m(arc_m, arc_m.max(0.0) / self.speed_m_s.abs().max(MIN_SPEED_M_S))
    }

    /// The same of what follows the path over this arc length in so many seconds.
    pub fn sigma_after_m(&self, arc_m: f64, seconds: f64) -> f64 {
        if self.is_at_rest() {
            return 0.0;
        }
        let arc_m = arc_m.max(0.0);
        let lateral_m_s2 = self.speed_m_s * self.speed_m_s * self.curvature_per_m.abs();
        let steering_m_s2 = STEERING_M_S2 + BEND_STEERING_SHARE * lateral_m_s2;
        let steering_m = steering_m_s2 * (seconds.powi(5) / 20.0).sqrt();
        let (edges_per_m, from_m) = self.edges_sigma_per_m();
        let edges_m = edges_per_m * (arc_m - from_m).max(0.0).powi(2) / 2.0;
        (self.curvature_sigma_per_m * arc_m * arc_m / 2.0).hypot(steering_m).hypot(edges_m)
    }

    /// Standard deviation of the path's heading at this arc length, in rad, as far as its curvature there is in doubt.
    pub fn heading_sigma_rad(&self, arc_m: f64) -> f64 {
        let (edges_per_m, from_m) = self.edges_sigma_per_m();
        edges_per_m * (arc_m - from_m).max(0.0)
    }

    /// Standard deviation of the curvature ahead where the road bends otherwise than the vehicle does, in 1/m, and from which
    /// arc length on. The curvature ahead is about the middle of both, so it is as far from either.
    fn edges_sigma_per_m(&self) -> (f64, f64) {
        let doubt = |edges: EdgesAhead| (edges.curvature_per_m - self.curvature_per_m).abs();
        self.edges.map_or((0.0, 0.0), |edges| (doubt(edges), edges.from_m))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn path(curvature_per_m: f64, edges: Option<EdgesAhead>) -> SweptPath {
        SweptPath {
            curvature_per_m,
            curvature_sigma_per_m: 0.001,
            speed_m_s: 10.0,
            speed_sigma_m_s: 0.1,
            body: Body { camera_right_m: 0.2, camera_yaw_rad: 0.03, ..Body::default() },
            edges,
            is_turning_in: false,
        }
    }

    #[test]
    fn places_and_lengths_along_the_path_are_inverse() {
        let ahead = EdgesAhead { from_m: 15.0, curvature_per_m: -0.02 };
        for curvature in [-0.18, -0.02, -1e-7, 0.0, 1e-12, 0.003, 0.1] {
            for edges in [None, Some(ahead)] {
                let path = path(curvature, edges);
                for arc_m in [0.0, 3.0, 14.0, 14.99, 15.01, 16.0] {
                    for offset_m in [-3.0, 0.0, 2.5] {
                        let found = path.along(path.place(arc_m, offset_m));
                        let near =
                            (found.arc_m - arc_m).abs() < 1e-6 && (found.offset_m - offset_m).abs() < 1e-6;
                        assert!(near, "{curvature} {edges:?}: {arc_m}, {offset_m} is {found:?}");
                    }
                }
            }
        }
    }

    #[test]
    fn a_left_bend_leads_to_the_left() {
        let path = path(0.02, None);
        assert!(path.place(30.0, 0.0)[0] < -5.0);
        // What is straight ahead is right of the path.
        let ahead = path.along([0.0, 30.0]);
        assert!(ahead.offset_m > 5.0 && ahead.heading_rad > 0.5, "{ahead:?}");
        let from_edges = SweptPath { edges: Some(EdgesAhead { from_m: 10.0, curvature_per_m: 0.0 }), ..path };
        let [wide, straight] = [path, from_edges].map(|path| path.place(30.0, 0.0)[0]);
        assert!(wide < straight && straight < -2.0, "{wide} {straight}");
    }

    #[test]
    fn the_reach_is_what_the_corners_of_the_body_sweep() {
        for curvature in [-0.15_f64, -0.05, 0.01, 0.1, 0.2] {
            let path = path(curvature, None);
            let body = path.body;
            // The corners of the body and its sides at the rear axle, in the camera's axes at the start.
            let corner = |right: f64, ahead: f64| {
                path.along(body.turn_to_camera([right - body.camera_right_m, ahead])).offset_m
            };
            let sides = [-body.width_m / 2.0, body.width_m / 2.0];
            let offsets = sides.map(|x| [corner(x, body.front_m), corner(x, -body.rear_axle_m)]);
            let (least, most) = offsets
                .as_flattened()
                .iter()
                .fold((f64::INFINITY, f64::NEG_INFINITY), |(least, most), &o| (least.min(o), most.max(o)));
            let [left, right] = path.reach_m(5.0);
            assert!((left + least).abs() < 1e-9 && (right - most).abs() < 1e-9, "{curvature}");
        }
        let straight = path(0.0, None);
        assert_eq!(straight.reach_m(20.0), [straight.body.width_m / 2.0; 2]);
    }

    #[test]
    fn the_uncertainty_grows_with_the_distance() {
        let path = path(0.01, None);
        let sigmas = [0.0, 5.0, 10.0, 15.0, 30.0].map(|arc_m| path.sigma_m(arc_m));
        assert!(sigmas.windows(2).all(|pair| pair[0] < pair[1]), "{sigmas:?}");
        // 1.5 s ahead: 0.11 m of the curvature, and of the driver 0.15 m, in this bend 0.31 m more.
        assert!((sigmas[3] - 0.47).abs() < 0.03, "{sigmas:?}");
        assert!(path.sigma_m(-3.0) == 0.0);
    }
}
