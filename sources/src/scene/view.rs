//! Projection of surfaces into a camera, and visibility of each sample of a pixel row.

use super::light::Light;
use super::material::Material;
use super::mesh::{Axis, CORNERS, Face, Point, add, dot};
use perception::rig::Rig;

/// Near clipping distance, in metres.
const NEAR_CLIP_M: f64 = 0.3;

/// Pose of the left camera.
#[derive(Clone, Copy, Debug)]
pub struct Pose {
    height_m: f64,
    /// Camera axes (right, down, ahead) in the road frame.
    axes: [Point; 3],
}

impl Pose {
    /// A camera above the road, pitched down by `pitch_rad`, rolled clockwise by `roll_rad`.
    pub fn new(height_m: f64, pitch_rad: f64, roll_rad: f64) -> Self {
        let ((sp, cp), (sr, cr)) = (pitch_rad.sin_cos(), roll_rad.sin_cos());
        let (right, down, ahead) = ([1.0, 0.0, 0.0], [0.0, -cp, -sp], [0.0, -sp, cp]);
        let mix = |a: Point, ka: f64, b: Point, kb: f64| add(add([0.0; 3], a, ka), b, kb);
        Self { height_m, axes: [mix(right, cr, down, sr), mix(right, -sr, down, cr), ahead] }
    }

    /// Height of the camera above the road, in metres.
    pub fn height_m(&self) -> f64 {
        self.height_m
    }

    /// Camera axes (right, down, ahead) in the road frame.
    pub fn axes(&self) -> &[Point; 3] {
        &self.axes
    }

    /// Transforms a direction from the road to the camera frame: x right, y down, z along the optical axis.
    pub fn turn(&self, p: Point) -> Point {
        [dot(self.axes[0], p), dot(self.axes[1], p), dot(self.axes[2], p)]
    }

    /// Transforms a point from the road to the camera frame.
    pub fn see(&self, p: Point) -> Point {
        self.turn([p[0], p[1] - self.height_m, p[2]])
    }

    fn axis(&self, axis: Axis) -> Axis {
        Axis { gradient: self.turn(axis.gradient), start: axis.start + axis.gradient[1] * self.height_m }
    }
}

/// A face in the left camera's frame, clipped.
#[derive(Clone, Copy, Debug)]
pub struct Surface {
    corners: [Point; CORNERS],
    count: usize,
    /// The plane: normal · point = distance.
    normal: Point,
    distance: f64,
    u: Axis,
    v: Axis,
    /// Material of the face.
    pub material: Material,
    /// Share of the sunlight that it receives.
    pub sunlit: f32,
    /// Owner, as in [`super::truth::SceneTruth::owner`].
    pub owner: u16,
}

impl Surface {
    /// A face of the road frame; `None` when neither camera can see it.
    pub fn new(face: &Face, owner: u16, pose: &Pose, rig: &Rig, light: &Light) -> Option<Self> {
        let normal = pose.turn(face.normal);
        let first = pose.see(face.corners()[0]);
        let distance = dot(normal, first);
        // Back-face culling, for both cameras.
        if face.closed && distance >= 0.0 && distance - normal[0] * rig.baseline_m >= 0.0 {
            return None;
        }
        let (corners, count) = clip(face.corners().iter().map(|&p| pose.see(p)));
        if count < 3 {
            return None;
        }
        let facing = dot(face.normal, light.towards_sun);
        // Open faces are lit from both sides.
        let facing = if face.closed { facing.max(0.0) } else { facing.abs() };
        Some(Self {
            corners,
            count,
            normal,
            distance,
            u: pose.axis(face.u),
            v: pose.axis(face.v),
            material: face.material,
            sunlit: facing as f32,
            owner,
        })
    }
}

/// Clips a polygon at the near plane.
fn clip(corners: impl Iterator<Item = Point> + Clone) -> ([Point; CORNERS], usize) {
    let (mut out, mut count) = ([[0.0; 3]; CORNERS], 0);
    let mut push = |p: Point| {
        if count < CORNERS {
            out[count] = p;
            count += 1;
        }
    };
    let mut before = corners.clone().last();
    for now in corners {
        if let Some(before) = before
            && (before[2] >= NEAR_CLIP_M) != (now[2] >= NEAR_CLIP_M)
        {
            let share = (NEAR_CLIP_M - before[2]) / (now[2] - before[2]);
            push(add(before, add(now, before, -1.0), share));
        }
        if now[2] >= NEAR_CLIP_M {
            push(now);
        }
        before = Some(now);
    }
    (out, count)
}

/// An edge of a polygon in the image.
#[derive(Clone, Copy, Debug, Default)]
struct Edge {
    top: f32,
    bottom: f32,
    /// Column at row 0, and its change per row.
    start: f64,
    slope: f64,
}

/// A surface projected into one camera's image.
#[derive(Clone, Copy, Debug)]
pub struct Patch {
    edges: [Edge; CORNERS],
    count: usize,
    first_row: i32,
    last_row: i32,
    /// 1/z = inverse · (dx, dy, 1) for the ray (dx, dy, 1).
    inverse: [f64; 3],
    /// u = u · ray · z + u_start, in metres.
    pub u: [f32; 3],
    /// See [`Self::u`].
    pub u_start: f32,
    /// The same for v.
    pub v: [f32; 3],
    /// See [`Self::v`].
    pub v_start: f32,
    /// Distance of its plane from the camera, in metres.
    pub plane_m: f32,
    /// Index of the surface.
    pub surface: u32,
}

impl Patch {
    /// 1/z along the ray (`dx`, `dy`, 1).
    #[inline]
    pub fn inverse_z(&self, dx: f64, dy: f64) -> f64 {
        self.inverse[0] * dx + self.inverse[1] * dy + self.inverse[2]
    }

    /// Coefficients of 1/z: per unit of dx, per unit of dy, and the value on the axis.
    pub fn inverse(&self) -> [f64; 3] {
        self.inverse
    }

    /// Range of columns (exclusive end, unrounded) covered at row `y`.
    #[inline]
    fn span(&self, y: f32) -> Option<(f64, f64)> {
        let (mut left, mut right) = (f64::MAX, f64::MIN);
        for edge in &self.edges[..self.count] {
            if edge.top <= y && y < edge.bottom {
                let x = edge.start + edge.slope * f64::from(y);
                left = left.min(x);
                right = right.max(x);
            }
        }
        (left < right).then_some((left, right))
    }
}

/// One of the two cameras.
#[derive(Clone, Copy, Debug)]
pub struct Camera {
    /// Intrinsics and baseline.
    pub rig: Rig,
    /// Image size in pixels.
    pub size: (usize, usize),
    /// Metres right of the left camera.
    pub x_m: f64,
    /// Pitch, nose down, relative to the left camera; 0 in a rectified pair.
    pub pitch_rad: f64,
}

impl Camera {
    /// Rotates a direction or position from the left camera's frame into this one's; `x_m` is not applied. Both
    /// cameras lie on the rotation axis.
    pub fn turn(&self, p: Point) -> Point {
        let (sin, cos) = self.pitch_rad.sin_cos();
        [p[0], cos * p[1] - sin * p[2], sin * p[1] + cos * p[2]]
    }

    /// Intrinsics of an unrotated camera that images distant points near the middle column where this one
    /// does.
    pub fn level(&self) -> Rig {
        Rig { cy_px: self.rig.cy_px - self.rig.focal_px * self.pitch_rad.tan(), ..self.rig }
    }

    /// Projects a surface; `None` when it lies outside the image.
    fn patch(&self, surface: &Surface, index: u32) -> Option<Patch> {
        if self.pitch_rad == 0.0 {
            return self.patch_of(surface, index);
        }
        let axis = |axis: Axis| Axis { gradient: self.turn(axis.gradient), ..axis };
        let (corners, count) = clip(surface.corners[..surface.count].iter().map(|&p| self.turn(p)));
        let turned = Surface {
            corners,
            count,
            normal: self.turn(surface.normal),
            u: axis(surface.u),
            v: axis(surface.v),
            ..*surface
        };
        if count < 3 { None } else { self.patch_of(&turned, index) }
    }

    /// Projects a surface given in this camera's own orientation.
    fn patch_of(&self, surface: &Surface, index: u32) -> Option<Patch> {
        let Rig { focal_px, cx_px, cy_px, .. } = self.rig;
        let shift = surface.distance - surface.normal[0] * self.x_m;
        // Edge-on surfaces are invisible.
        if shift.abs() < 1e-9 {
            return None;
        }
        let mut image = [[0.0; 2]; CORNERS];
        let (mut least, mut greatest) = ([f64::MAX; 2], [f64::MIN; 2]);
        for (place, corner) in image.iter_mut().zip(&surface.corners[..surface.count]) {
            let [x, y, z] = *corner;
            *place = [cx_px + (x - self.x_m) * focal_px / z, cy_px + y * focal_px / z];
            for axis in 0..2 {
                least[axis] = least[axis].min(place[axis]);
                greatest[axis] = greatest[axis].max(place[axis]);
            }
        }
        let (width, height) = (self.size.0 as f64, self.size.1 as f64);
        if least[0] > width || greatest[0] < -1.0 || least[1] > height || greatest[1] < -1.0 {
            return None;
        }
        let mut edges = [Edge::default(); CORNERS];
        let mut count = 0;
        for k in 0..surface.count {
            let (a, b) = (image[k], image[(k + 1) % surface.count]);
            let (a, b) = if a[1] <= b[1] { (a, b) } else { (b, a) };
            let (top, bottom) = (a[1] as f32, b[1] as f32);
            if top < bottom {
                let slope = (b[0] - a[0]) / (b[1] - a[1]);
                edges[count] = Edge { top, bottom, start: a[0] - slope * a[1], slope };
                count += 1;
            }
        }
        let single =
            |axis: Axis| (axis.gradient.map(|v| v as f32), (axis.start + axis.gradient[0] * self.x_m) as f32);
        let ((u, u_start), (v, v_start)) = (single(surface.u), single(surface.v));
        Some(Patch {
            edges,
            count,
            first_row: (least[1] - 1.0).floor().max(0.0) as i32,
            last_row: (greatest[1] + 1.0).ceil().min(height - 1.0) as i32,
            inverse: surface.normal.map(|n| n / shift),
            u,
            u_start,
            v,
            v_start,
            plane_m: shift.abs() as f32,
            surface: index,
        })
    }
}

/// Sample positions within a pixel: four, no two in one column or row.
pub const SAMPLES: [(f32, f32); 4] = [(-0.375, -0.125), (-0.125, 0.375), (0.125, -0.375), (0.375, 0.125)];

/// The pixel centre only.
pub const MIDDLE: [(f32, f32); 1] = [(0.0, 0.0)];

/// All patches of one camera's image, and the rows that they cover.
#[derive(Debug, Default)]
pub struct View {
    /// The patches; sample numbers refer to them, starting at 1.
    pub patches: Vec<Patch>,
    order: Vec<u16>,
    next: usize,
    active: Vec<u16>,
}

impl View {
    /// Projects the surfaces into `camera`.
    pub fn project(&mut self, camera: &Camera, surfaces: &[Surface]) {
        self.patches.clear();
        // Patch indices have 16 bits, far more than any scene needs.
        let patches = surfaces.iter().zip(0..).filter_map(|(surface, index)| camera.patch(surface, index));
        self.patches.extend(patches.take(usize::from(u16::MAX) - 1));
        self.order.clear();
        self.order.extend(0..self.patches.len() as u16);
        let patches = &self.patches;
        self.order.sort_unstable_by_key(|&k| (patches[usize::from(k)].first_row, k));
        self.restart();
    }

    /// Rows that any patch covers.
    pub fn rows(&self) -> std::ops::Range<usize> {
        let first = self.patches.iter().map(|patch| patch.first_row).min().unwrap_or(0);
        let last = self.patches.iter().map(|patch| patch.last_row).max().unwrap_or(-1);
        first.max(0) as usize..(last + 1).max(first).max(0) as usize
    }

    /// Returns to the first row.
    pub fn restart(&mut self) {
        self.next = 0;
        self.active.clear();
    }

    /// Determines which patch each sample of row `y` sees; rows must be visited in order. Writes one row per
    /// sample: 1/z to `z` (0 for nothing), and the patch number from 1 to `seen`.
    pub fn row(
        &mut self,
        camera: &Camera,
        y: usize,
        samples: &[(f32, f32)],
        z: &mut [Vec<f32>],
        seen: &mut [Vec<u32>],
    ) {
        while let Some(&k) = self.order.get(self.next)
            && self.patches[usize::from(k)].first_row <= y as i32
        {
            self.active.push(k);
            self.next += 1;
        }
        let patches = &self.patches;
        self.active.retain(|&k| patches[usize::from(k)].last_row >= y as i32);
        let Rig { focal_px, cx_px, cy_px, .. } = camera.rig;
        for ((&(right, down), z), seen) in samples.iter().zip(z).zip(seen) {
            z.fill(0.0);
            seen.fill(0);
            let row = y as f32 + down;
            let dy = (f64::from(row) - cy_px) / focal_px;
            let dx = (f64::from(right) - cx_px) / focal_px;
            for &k in &self.active {
                let patch = &self.patches[usize::from(k)];
                let Some((from, to)) = patch.span(row) else { continue };
                // Ceiling without a call into the math library.
                let column = |x: f64| {
                    let x = (x - f64::from(right)).clamp(0.0, camera.size.0 as f64);
                    let whole = x as usize;
                    whole + usize::from((whole as f64) < x)
                };
                let (from, to) = (column(from), column(to));
                if from >= to {
                    continue;
                }
                let step = (patch.inverse[0] / focal_px) as f32;
                let start = (patch.inverse_z(dx, dy) + patch.inverse[0] * from as f64 / focal_px) as f32;
                let number = u32::from(k) + 1;
                // Branch-free, so that the compiler vectorises it.
                let (z, seen) = (&mut z[from..to], &mut seen[from..to]);
                for (i, (z, seen)) in z.iter_mut().zip(seen).enumerate() {
                    let value = start + step * i as i32 as f32;
                    let nearer = value > *z;
                    *z = if nearer { value } else { *z };
                    *seen = if nearer { number } else { *seen };
                }
            }
        }
    }
}

impl View {
    /// Columns that each patch covers at row `y`, after [`Self::row`] was called for this row, or instead of
    /// calling it.
    pub fn spans(&mut self, y: usize, mut each: impl FnMut(&Patch, f64, f64)) {
        while let Some(&k) = self.order.get(self.next)
            && self.patches[usize::from(k)].first_row <= y as i32
        {
            self.active.push(k);
            self.next += 1;
        }
        let patches = &self.patches;
        self.active.retain(|&k| patches[usize::from(k)].last_row >= y as i32);
        for &k in &self.active {
            let patch = &patches[usize::from(k)];
            if let Some((from, to)) = patch.span(y as f32) {
                each(patch, from, to);
            }
        }
    }
}
