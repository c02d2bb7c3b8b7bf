//! Flat textured faces and meshes of solids.

use super::material::Material;

/// x right, y up, z ahead, in metres. The origin of the road frame lies on the road below the left camera.
pub type Point = [f64; 3];

/// Maximum number of corners of a face, including after clipping.
pub const CORNERS: usize = 10;

/// a + b·k.
pub fn add(a: Point, b: Point, k: f64) -> Point {
    [a[0] + b[0] * k, a[1] + b[1] * k, a[2] + b[2] * k]
}

/// Dot product.
pub fn dot(a: Point, b: Point) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// Cross product.
pub fn cross(a: Point, b: Point) -> Point {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

/// The unit vector of this direction; zero stays zero.
pub fn unit(a: Point) -> Point {
    let length = dot(a, a).sqrt();
    if length > 0.0 { [a[0] / length, a[1] / length, a[2] / length] } else { a }
}

/// A texture coordinate in metres: gradient · point + start.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Axis {
    /// Gradient of the coordinate.
    pub gradient: Point,
    /// Value at the origin.
    pub start: f64,
}

/// A convex face.
#[derive(Clone, Copy, Debug)]
pub struct Face {
    corners: [Point; CORNERS],
    count: usize,
    /// Texture coordinate across, in metres.
    pub u: Axis,
    /// Texture coordinate up, or along a road, in metres.
    pub v: Axis,
    /// Material of the face.
    pub material: Material,
    /// Outward unit normal; the back of a closed solid is never visible.
    pub normal: Point,
    /// Whether it belongs to a closed solid.
    pub closed: bool,
}

impl Face {
    /// A face with 3 to [`CORNERS`] corners in order. u is horizontal and v vertical, or right and ahead where
    /// the face is horizontal.
    pub fn new(corners: &[Point], material: Material) -> Self {
        let mut own = [[0.0; 3]; CORNERS];
        own[..corners.len()].copy_from_slice(corners);
        let [a, b, c] = [own[0], own[1], own[2]];
        let normal = unit(cross(add(b, a, -1.0), add(c, a, -1.0)));
        let axis = |gradient| Axis { gradient, start: 0.0 };
        let (u, v) = if normal[1].abs() > 0.75 {
            (axis([1.0, 0.0, 0.0]), axis([0.0, 0.0, 1.0]))
        } else {
            (axis(unit(cross([0.0, 1.0, 0.0], normal))), axis([0.0, 1.0, 0.0]))
        };
        Self { corners: own, count: corners.len(), u, v, material, normal, closed: false }
    }

    /// Its corners, in order.
    pub fn corners(&self) -> &[Point] {
        &self.corners[..self.count]
    }

    /// Its corners, mutable.
    pub fn corners_mut(&mut self) -> &mut [Point] {
        &mut self.corners[..self.count]
    }

    /// The face mirrored at y = 0.
    pub fn mirrored(&self) -> Self {
        let flip = |p: Point| [p[0], -p[1], p[2]];
        let axis = |axis: Axis| Axis { gradient: flip(axis.gradient), ..axis };
        let mut out = *self;
        out.corners_mut().iter_mut().for_each(|corner| *corner = flip(*corner));
        out.normal = flip(self.normal);
        (out.u, out.v) = (axis(self.u), axis(self.v));
        out
    }

    /// Orients the normal away from `middle`.
    fn turned_from(mut self, middle: Point) -> Self {
        let centre = self.corners().iter().fold([0.0; 3], |sum, &c| add(sum, c, 1.0 / self.count as f64));
        if dot(self.normal, add(centre, middle, -1.0)) < 0.0 {
            self.normal = self.normal.map(|v| -v);
        }
        self.closed = true;
        self
    }
}

/// The faces of an object in its own frame: x right, y up, z ahead, near side at z = 0.
#[derive(Clone, Debug, Default)]
pub struct Mesh {
    /// The faces.
    pub faces: Vec<Face>,
}

impl Mesh {
    /// A closed box without its lower side.
    pub fn block(&mut self, x: (f64, f64), y: (f64, f64), z: (f64, f64), material: Material) {
        self.frustum([x, x], y, [z, z], material);
    }

    /// A box with a different upper side: `x` and `z` below and above.
    pub fn frustum(&mut self, x: [(f64, f64); 2], y: (f64, f64), z: [(f64, f64); 2], material: Material) {
        let ring = |k: usize| {
            let (x, z, y) = (x[k], z[k], if k == 0 { y.0 } else { y.1 });
            [[x.0, y, z.0], [x.1, y, z.0], [x.1, y, z.1], [x.0, y, z.1]]
        };
        self.loft(&ring(0), &ring(1), material);
    }

    /// A prism about a horizontal axis: `profile` is (z, y), convex, extruded from `x.0` to `x.1`.
    pub fn extrude(&mut self, profile: &[(f64, f64)], x: (f64, f64), material: Material) {
        let at = |x: f64| profile.iter().map(|&(z, y)| [x, y, z]).collect::<Vec<Point>>();
        let (left, right) = (at(x.0), at(x.1));
        let middle = centre(&[&left[..], &right[..]].concat());
        for k in 0..left.len() {
            let n = (k + 1) % left.len();
            let face = Face::new(&[left[k], right[k], right[n], left[n]], material).turned_from(middle);
            // Downward faces are invisible from above the road.
            if face.normal[1] > -0.95 {
                self.faces.push(face);
            }
        }
        for side in [&left, &right] {
            self.faces.push(Face::new(side, material).turned_from(middle));
        }
    }

    /// The solid between two rings with equal numbers of corners, open below.
    pub fn loft(&mut self, lower: &[Point], upper: &[Point], material: Material) {
        let middle = centre(&[lower, upper].concat());
        for k in 0..lower.len() {
            let n = (k + 1) % lower.len();
            self.faces
                .push(Face::new(&[lower[k], lower[n], upper[n], upper[k]], material).turned_from(middle));
        }
        self.faces.push(Face::new(upper, material).turned_from(middle));
    }

    /// A round post or cone: eight-sided, with its axis at (`x`, `z`).
    pub fn round(&mut self, (x, z): (f64, f64), y: (f64, f64), radius: (f64, f64), material: Material) {
        self.loft(&ring(x, z, y.0, radius.0), &ring(x, z, y.1, radius.1), material);
    }

    /// An irregular ball, such as foliage; the shape depends on the seed.
    pub fn ball(&mut self, middle: Point, radius: Point, seed: u64, material: Material) {
        const AROUND: usize = 8;
        const UP: usize = 5;
        let at = |i: usize, j: usize| {
            let turn = std::f64::consts::TAU * (i % AROUND) as f64 / AROUND as f64;
            let lift = std::f64::consts::PI * (j as f64 / UP as f64 - 0.5);
            let key = seed ^ ((i % AROUND) as u64) << 8 ^ (j as u64) << 16;
            let lump = if j == 0 || j == UP { 1.0 } else { 0.82 + 0.36 * super::texture::unit(key) };
            let flat = lift.cos() * lump;
            [
                middle[0] + radius[0] * flat * turn.cos(),
                middle[1] + radius[1] * lift.sin() * lump,
                middle[2] + radius[2] * flat * turn.sin(),
            ]
        };
        for j in 0..UP {
            for i in 0..AROUND {
                // Triangles, as the bumps are not planar.
                let (a, b, c, d) = (at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1));
                if j > 0 {
                    self.faces.push(Face::new(&[a, b, c], material).turned_from(middle));
                }
                if j + 1 < UP {
                    self.faces.push(Face::new(&[a, c, d], material).turned_from(middle));
                }
            }
        }
    }

    /// A flat decal on an existing surface, visible from the front only.
    pub fn patch(&mut self, corners: &[Point], outwards: Point, material: Material) {
        let mut face = Face::new(corners, material);
        if dot(face.normal, outwards) < 0.0 {
            face.normal = face.normal.map(|v| -v);
        }
        face.closed = true;
        self.faces.push(face);
    }

    /// A vertical decal across the road at `z`, visible from the near side.
    pub fn rear_patch(&mut self, x: (f64, f64), y: (f64, f64), z: f64, material: Material) {
        let corners = [[x.0, y.0, z], [x.1, y.0, z], [x.1, y.1, z], [x.0, y.1, z]];
        self.patch(&corners, [0.0, 0.0, -1.0], material);
    }

    /// A vertical decal along the road at `x`, visible from the side that `outwards` points to.
    pub fn side_patch(&mut self, x: f64, y: (f64, f64), z: (f64, f64), outwards: f64, material: Material) {
        let corners = [[x, y.0, z.0], [x, y.0, z.1], [x, y.1, z.1], [x, y.1, z.0]];
        self.patch(&corners, [outwards, 0.0, 0.0], material);
    }

    /// Axis-aligned bounding box: (minimum, maximum).
    pub fn bounds(&self) -> (Point, Point) {
        let mut least = [f64::MAX; 3];
        let mut greatest = [f64::MIN; 3];
        for corner in self.faces.iter().flat_map(|face| face.corners()) {
            for axis in 0..3 {
                least[axis] = least[axis].min(corner[axis]);
                greatest[axis] = greatest[axis].max(corner[axis]);
            }
        }
        (least, greatest)
    }
}

/// Eight points around an axis.
pub fn ring(x: f64, z: f64, y: f64, radius: f64) -> [Point; 8] {
    std::array::from_fn(|k| {
        let turn = std::f64::consts::TAU * (k as f64 + 0.5) / 8.0;
        [x + radius * turn.sin(), y, z + radius * turn.cos()]
    })
}

fn centre(points: &[Point]) -> Point {
    points.iter().fold([0.0; 3], |sum, &p| add(sum, p, 1.0 / points.len() as f64))
}

/// Pose of an object: yaw about the vertical, tilt with the road, translation.
#[derive(Clone, Copy, Debug)]
pub struct Placement {
    /// Position of its origin in the road frame.
    pub at: Point,
    /// Directions of its axes.
    pub axes: [Point; 3],
}

impl Placement {
    /// An object at `at`, turned to the right by `yaw_rad`, on a road with this slope (rise ÷ run).
    pub fn new(at: Point, yaw_rad: f64, slope: f64) -> Self {
        let (s, c) = yaw_rad.sin_cos();
        // The forward axis lies on the road, the up axis is perpendicular to it.
        let (up, ahead) = (unit([0.0, 1.0, -slope]), unit([s, c * slope, c]));
        Self { at, axes: [cross(up, ahead), up, ahead] }
    }

    /// Transforms a direction from the object to the road frame.
    pub fn turn(&self, p: Point) -> Point {
        add(add(add([0.0; 3], self.axes[0], p[0]), self.axes[1], p[1]), self.axes[2], p[2])
    }

    /// Transforms a point from the object to the road frame.
    pub fn place(&self, p: Point) -> Point {
        add(self.turn(p), self.at, 1.0)
    }

    /// Transforms a face from the object to the road frame.
    pub fn face(&self, face: &Face) -> Face {
        let axis = |axis: Axis| {
            let gradient = self.turn(axis.gradient);
            Axis { gradient, start: axis.start - dot(gradient, self.at) }
        };
        let mut out = *face;
        out.corners_mut().iter_mut().for_each(|corner| *corner = self.place(*corner));
        out.normal = self.turn(face.normal);
        (out.u, out.v) = (axis(face.u), axis(face.v));
        out
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::material::{Look, Material};

    fn plain() -> Material {
        Material::new(Look::Plain, 100.0, 0.5, 0.02)
    }

    #[test]
    fn normals_of_solids_point_outwards() {
        let mut solids = [Mesh::default(), Mesh::default(), Mesh::default()];
        solids[0].block((-1.0, 1.0), (0.0, 2.0), (0.0, 3.0), plain());
        solids[1].round((0.0, 1.5), (0.0, 1.0), (0.5, 0.1), plain());
        solids[2].extrude(&[(0.0, 0.0), (0.0, 1.0), (2.0, 2.0), (2.0, 0.0)], (-1.0, 1.0), plain());
        for (mesh, middle) in solids.iter().zip([[0.0, 1.0, 1.5], [0.0, 0.4, 1.5], [0.0, 0.7, 1.1]]) {
            for face in &mesh.faces {
                assert!(dot(face.normal, add(face.corners()[0], middle, -1.0)) > 0.0, "{face:?}");
            }
        }
        assert_eq!(solids[0].bounds(), ([-1.0, 0.0, 0.0], [1.0, 2.0, 3.0]));
    }

    #[test]
    fn a_placed_face_keeps_its_texture() {
        let mut mesh = Mesh::default();
        mesh.block((-1.0, 1.0), (0.0, 2.0), (0.0, 3.0), plain());
        let placement = Placement::new([3.0, 0.5, 20.0], 0.4, 0.05);
        for face in &mesh.faces {
            let placed = placement.face(face);
            for (a, b) in face.corners().iter().zip(placed.corners()) {
                let value = |axis: Axis, p: Point| dot(axis.gradient, p) + axis.start;
                assert!((value(face.u, *a) - value(placed.u, *b)).abs() < 1e-9);
                assert!((value(face.v, *a) - value(placed.v, *b)).abs() < 1e-9);
            }
            assert!((dot(placed.normal, placed.normal) - 1.0).abs() < 1e-9);
        }
        // Turned by 90 degrees to the right, ahead is right.
        let turned = Placement::new([0.0; 3], std::f64::consts::FRAC_PI_2, 0.0).turn([0.0, 0.0, 1.0]);
        assert!((turned[0] - 1.0).abs() < 1e-12 && turned[2].abs() < 1e-12);
    }
}
