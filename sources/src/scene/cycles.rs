//! Meshes of bicycles: near side (their rear) at z = 0, wheels on y = 0.

use super::material::{Look, Material};
use super::mesh::{Mesh, Point, add, unit};

/// Half the thickness of wheels and tubes, in metres.
const THIN_M: f64 = 0.018;

/// A tube from one point to another, square.
fn tube(mesh: &mut Mesh, from: Point, to: Point, half: f64, material: Material) {
    let along = unit(add(to, from, -1.0));
    // Across it in the bicycle's plane, or along the bicycle for the handlebar.
    let over: Point =
        if along[0].abs() > 0.5 { [0.0, half, 0.0] } else { [0.0, -along[2] * half, along[1] * half] };
    let side: Point = if along[0].abs() > 0.5 { [0.0, 0.0, half] } else { [half, 0.0, 0.0] };
    let ring = |p: Point| -> [Point; 4] {
        [(1.0, 1.0), (1.0, -1.0), (-1.0, -1.0), (-1.0, 1.0)].map(|(a, b)| add(add(p, over, a), side, b))
    };
    mesh.loft(&ring(from), &ring(to), material);
}

/// A wheel: an eight-sided ring.
fn wheel(mesh: &mut Mesh, z: f64, radius: f64, material: Material) {
    let at = |k: usize, r: f64| -> Point {
        let turn = std::f64::consts::TAU * (k as f64 + 0.5) / 8.0;
        [0.0, radius * 0.98 + r * turn.sin(), z + r * turn.cos()]
    };
    for k in 0..8 {
        tube(mesh, at(k, radius), at(k + 1, radius), THIN_M, material);
    }
    // Spokes: two thin bars.
    let spoke = Material::new(Look::Plain, 120.0, 0.3, 0.02);
    for k in 0..2 {
        tube(mesh, at(2 * k, radius), at(2 * k + 4, radius), 0.006, spoke);
    }
}

/// A bicycle on its stand, `size` (width of the handlebar, height, length).
pub fn bicycle(size: [f64; 3], grey: f32, seed: f32) -> Mesh {
    let mut mesh = Mesh::default();
    let (w, h, l) = (size[0] / 2.0, size[1] / 1.05, size[2] / 1.75);
    let radius = 0.34 * h.min(l);
    let (rear, front) = (radius + THIN_M, size[2] - radius - THIN_M);
    let tyre = Material::new(Look::Plain, 34.0, 0.25, 0.02);
    let frame = Material::new(Look::Plain, grey, 0.4, 0.015).shifted(seed);
    wheel(&mut mesh, rear, radius, tyre);
    wheel(&mut mesh, front, radius, tyre);
    let p = |y: f64, z: f64| -> Point { [0.0, y * h, z * l] };
    let (hub, axle) = ([0.0, radius, rear], [0.0, radius, front]);
    let (crank, saddle, head) = (p(0.29, 0.78), p(0.92, 0.62), p(0.86, 1.22));
    for (a, b) in [(hub, crank), (crank, saddle), (crank, head), (p(0.78, 0.66), head), (hub, p(0.75, 0.67))]
    {
        tube(&mut mesh, a, b, THIN_M, frame);
    }
    tube(&mut mesh, axle, p(1.0, 1.17), THIN_M, frame);
    tube(&mut mesh, [-w, size[1] - 0.02, 1.15 * l], [w, size[1] - 0.02, 1.15 * l], THIN_M, tyre);
    mesh.block((-0.07, 0.07), (0.92 * h, 0.97 * h), (0.5 * l, 0.75 * l), tyre);
    mesh
}

/// A person on a bicycle, `size` (width, height, length).
pub fn cyclist(size: [f64; 3], grey: f32, seed: f32) -> Mesh {
    let (h, l) = (size[1] / 1.75, size[2] / 1.75);
    let mut mesh = bicycle([size[0], 1.05 * h, size[2]], 70.0, seed);
    // The rider sits: a walker's upper part, and the legs on the pedals.
    let coat = Material::new(Look::Plain, grey, 0.55, 0.018).shifted(seed);
    let trousers = Material::new(Look::Plain, grey * 0.55, 0.4, 0.018).shifted(seed + 2.0);
    let hair = Material::new(Look::Plain, 70.0, 0.4, 0.012).shifted(seed);
    let half = size[0] / 2.0;
    let (hip, neck) = ((0.52 * l, 0.76 * l), (0.72 * l, 0.92 * l));
    mesh.frustum(
        [(-0.6 * half, 0.6 * half), (-0.75 * half, 0.75 * half)],
        (0.95 * h, 1.48 * h),
        [hip, neck],
        coat,
    );
    for (side, foot, knee) in [(-1.0, (0.12, 0.74), 0.95), (1.0, (0.42, 0.9), 1.05)] {
        let x = side * 0.4 * half;
        let hip = [x, 0.98 * h, 0.68 * l];
        let bend = [x, (foot.0 + 0.42) * h, knee * l];
        tube(&mut mesh, hip, bend, 0.075, trousers);
        tube(&mut mesh, bend, [x, foot.0 * h, foot.1 * l], 0.055, trousers);
        tube(
            &mut mesh,
            [side * 0.8 * half, 1.38 * h, 0.84 * l],
            [side * 0.85 * half, 1.06 * h, 1.15 * l],
            0.045,
            coat,
        );
    }
    mesh.ball([0.0, 1.63 * h, 0.88 * l], [0.1 * h, 0.12 * h, 0.11 * h], 0, hair);
    mesh
}
