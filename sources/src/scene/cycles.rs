//! Meshes of bicycles and motorcycles: near side (their rear) at z = 0, wheels on y = 0.

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

/// A person on a motorcycle, `size` (width of the handlebar, height of the rider, length).
pub fn motorcyclist(size: [f64; 3], grey: f32, seed: f32) -> Mesh {
    let mut mesh = Mesh::default();
    let (w, h, l) = (size[0] / 2.0, size[1] / 1.75, size[2] / 2.08);
    let tyre = Material::new(Look::Plain, 30.0, 0.3, 0.02);
    let body = Material::new(Look::Plain, grey * 1.3, 0.45, 0.015).shifted(seed);
    let leather = Material::new(Look::Plain, grey * 0.7, 0.5, 0.018).shifted(seed + 2.0);
    let helmet = Material::new(Look::Plain, 170.0, 0.3, 0.015).shifted(seed);
    // Wheels: two wide drums.
    for z in [0.32 * l, size[2] - 0.32 * l] {
        let ring = |x: f64| -> [Point; 8] {
            std::array::from_fn(|k| {
                let turn = std::f64::consts::TAU * (k as f64 + 0.5) / 8.0;
                [x, (0.31 + 0.335 * turn.sin()).max(0.0) * h, z + 0.32 * l * turn.cos()]
            })
        };
        mesh.loft(&ring(-0.07), &ring(0.07), tyre);
        for side in [-0.07, 0.07] {
            mesh.patch(&ring(side), [side, 0.0, 0.0], tyre);
        }
    }
    let z = |from: f64, to: f64| (from * l, to * l);
    mesh.block((-0.17, 0.17), (0.28 * h, 0.72 * h), z(0.62, 1.42), body);
    mesh.block((-0.13, 0.13), (0.68 * h, 0.8 * h), z(0.12, 1.0), leather);
    mesh.frustum([(-0.16, 0.16), (-0.12, 0.12)], (0.72 * h, 0.96 * h), [z(0.95, 1.4), z(1.0, 1.3)], body);
    // Mudguard, tail lamp and number plate.
    mesh.block((-0.1, 0.1), (0.5 * h, 0.68 * h), z(0.1, 0.4), tyre);
    let plate = Material::new(Look::Plain, 205.0, 0.8, 0.01).shifted(seed);
    mesh.rear_patch((-0.09, 0.09), (0.5 * h, 0.66 * h), 0.095 * l, plate);
    tube(&mut mesh, [0.0, 0.32 * h, 1.76 * l], [0.0, 1.0 * h, 1.45 * l], 0.05, body);
    tube(&mut mesh, [-w, 1.02 * h, 1.42 * l], [w, 1.02 * h, 1.42 * l], 0.02, tyre);
    // The rider.
    mesh.frustum([(-0.17, 0.17), (-0.23, 0.23)], (0.8 * h, 1.42 * h), [z(0.55, 0.85), z(0.72, 1.0)], leather);
    for side in [-1.0, 1.0] {
        let knee = [side * 0.24, 0.72 * h, 1.12 * l];
        tube(&mut mesh, [side * 0.15, 0.85 * h, 0.72 * l], knee, 0.085, leather);
        tube(&mut mesh, knee, [side * 0.22, 0.33 * h, 0.85 * l], 0.065, leather);
        let shoulder = [side * 0.22, 1.34 * h, 0.88 * l];
        tube(&mut mesh, shoulder, [side * 0.9 * w, 1.05 * h, 1.36 * l], 0.055, leather);
    }
    mesh.ball([0.0, 1.6 * h, 0.94 * l], [0.13 * h, 0.15 * h, 0.15 * h], 0, helmet);
    mesh
}
