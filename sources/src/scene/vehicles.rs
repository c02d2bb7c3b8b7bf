//! Meshes of vehicles: near side (their rear) at z = 0, wheels on y = 0.

use super::material::{Look, Material};
use super::mesh::{Mesh, Point};

const TYRE: Material = Material::new(Look::Plain, 30.0, 0.25, 0.02);
const HUB: Material = Material::new(Look::Plain, 130.0, 0.5, 0.02);
const GLASS: Material = Material::new(Look::Glass, 34.0, 0.28, 0.05);
const BUMPER: Material = Material::new(Look::Plain, 48.0, 0.2, 0.02);
const PLATE: Material = Material::new(Look::Plain, 190.0, 0.9, 0.012);
const RED_LAMP: Material = Material::new(Look::Plain, 84.0, 0.3, 0.015);
const CLEAR_LAMP: Material = Material::new(Look::Plain, 205.0, 0.5, 0.015);

/// Emission of lit tail lamps, in grey levels.
const TAIL_GLOW: f32 = 190.0;

/// Emission of lit headlamps, in grey levels.
const HEAD_GLOW: f32 = 420.0;

fn paint(grey: f32, seed: f32) -> Material {
    Material::new(Look::Paint, grey, 0.32, 0.022).shifted(seed)
}

/// An eight-sided wheel that faces the side `outwards`.
fn wheel(mesh: &mut Mesh, x: f64, z: f64, radius: f64, outwards: f64) {
    let disc = |radius: f64, x: f64| -> [Point; 8] {
        std::array::from_fn(|k| {
            let turn = std::f64::consts::TAU * (k as f64 + 0.5) / 8.0;
            // An octagon with the circle's area that touches the ground.
            [x, 0.97 * radius + 1.03 * radius * turn.cos(), z + 1.03 * radius * turn.sin()]
        })
    };
    let side = [outwards, 0.0, 0.0];
    mesh.patch(&disc(radius, x), side, TYRE);
    mesh.patch(&disc(radius * 0.62, x + 0.012 * outwards), side, HUB);
    // The tread, visible from behind and in front.
    let (a, b) = (x, x - 0.2 * outwards);
    for (z, outwards_z) in [(z - radius * 0.92, -1.0), (z + radius * 0.92, 1.0)] {
        let corners = [[a, 0.0, z], [b, 0.0, z], [b, 1.5 * radius, z], [a, 1.5 * radius, z]];
        mesh.patch(&corners, [0.0, 0.0, outwards_z], TYRE);
    }
}

/// A sedan, scaled to `size` (width, height, length).
pub fn car(size: [f64; 3], grey: f32, seed: f32) -> Mesh {
    let mut mesh = Mesh::default();
    let body = paint(grey, seed);
    let (w, h, l) = (size[0] / 2.0, size[1] / 1.45, size[2] / 4.4);
    let z = |z: f64| 0.01 + (size[2] - 0.02) * z / 4.4;
    let y = |y: f64| y * h;
    // The body below the windows; its rear is vertical between bumper and boot lid.
    let profile = [
        (0.04, 0.24),
        (0.0, 0.36),
        (0.0, 0.88),
        (0.07, 0.96),
        (3.3, 0.95),
        (4.22, 0.78),
        (4.4, 0.55),
        (4.34, 0.22),
    ];
    mesh.extrude(&profile.map(|(a, b)| (z(a), y(b))), (-w, w), body);
    // The cabin, narrower at the top.
    let (wb, wt) = (w * 0.9, w * 0.72);
    let lower =
        [[-wb, y(0.95), z(0.35)], [wb, y(0.95), z(0.35)], [wb, y(0.95), z(3.3)], [-wb, y(0.95), z(3.3)]];
    let upper =
        [[-wt, y(1.45), z(0.95)], [wt, y(1.45), z(0.95)], [wt, y(1.45), z(2.45)], [-wt, y(1.45), z(2.45)]];
    mesh.loft(&lower, &upper, body);
    // Glass lies slightly outside the cabin's faces.
    let mix = |a: Point, b: Point, k: f64| std::array::from_fn(|i| a[i] + (b[i] - a[i]) * k);
    let glass = |mesh: &mut Mesh, a: [Point; 4], out: Point, left: f64, right: f64| {
        // Corners: lower left, lower right, upper right, upper left.
        let side = |k: f64, t: f64| -> Point {
            let low: Point = mix(a[0], a[1], k);
            let high: Point = mix(a[3], a[2], k);
            let p: Point = mix(low, high, t);
            [p[0] + out[0], p[1] + out[1], p[2] + out[2]]
        };
        mesh.patch(
            &[side(left, 0.1), side(right, 0.1), side(right, 0.86), side(left, 0.86)],
            out,
            GLASS.shifted(seed + left as f32),
        );
    };
    glass(&mut mesh, [lower[0], lower[1], upper[1], upper[0]], [0.0, 0.008, -0.008], 0.09, 0.91);
    glass(&mut mesh, [lower[2], lower[3], upper[3], upper[2]], [0.0, 0.008, 0.008], 0.07, 0.93);
    for (a, out) in
        [([lower[0], lower[3], upper[3], upper[0]], -0.01), ([lower[1], lower[2], upper[2], upper[1]], 0.01)]
    {
        glass(&mut mesh, a, [out, 0.003, 0.0], 0.14, 0.44);
        glass(&mut mesh, a, [out, 0.003, 0.0], 0.49, 0.86);
    }
    // The rear: lamps, number plate, bumper, shadow of the boot lid.
    for side in [-1.0, 1.0] {
        let (a, b) = (side * w * 0.98, side * w * 0.66);
        let x = if a < b { (a, b) } else { (b, a) };
        mesh.rear_patch(x, (y(0.66), y(0.84)), 0.001, RED_LAMP.glowing(TAIL_GLOW));
        wheel(&mut mesh, side * (w + 0.012), z(0.82), 0.31 * h, side);
        wheel(&mut mesh, side * (w + 0.012), z(3.55), 0.31 * h, side);
        // The headlamps.
        let corners = [
            [x.0, y(0.58), z(4.4) + 0.004],
            [x.1, y(0.58), z(4.4) + 0.004],
            [x.1, y(0.72), z(4.32)],
            [x.0, y(0.72), z(4.32)],
        ];
        mesh.patch(&corners, [0.0, 0.0, 1.0], CLEAR_LAMP.glowing(HEAD_GLOW));
    }
    mesh.rear_patch((-w * 0.98, w * 0.98), (y(0.37), y(0.5)), 0.002, BUMPER);
    mesh.rear_patch((-0.26, 0.26), (y(0.56), y(0.68)), 0.0, PLATE.shifted(seed));
    // Dark underbody.
    mesh.rear_patch((-w * 0.7, w * 0.7), (0.12 * l.min(1.0), y(0.3)), 0.3, TYRE);
    mesh
}

/// A delivery van.
pub fn van(size: [f64; 3], grey: f32, seed: f32) -> Mesh {
    let mut mesh = Mesh::default();
    let body = paint(grey, seed);
    let (w, h) = (size[0] / 2.0, size[1] / 2.3);
    let z = |z: f64| 0.01 + (size[2] - 0.02) * z / 5.4;
    let y = |y: f64| y * h;
    let profile =
        [(0.03, 0.3), (0.0, 0.5), (0.0, 2.2), (0.08, 2.3), (3.9, 2.3), (4.7, 1.25), (5.36, 1.05), (5.4, 0.3)];
    mesh.extrude(&profile.map(|(a, b)| (z(a), y(b))), (-w, w), body);
    for (x0, x1) in [(-0.84, -0.06), (0.06, 0.84)] {
        mesh.rear_patch((x0 * w, x1 * w), (y(1.35), y(1.95)), 0.004, GLASS.shifted(seed));
    }
    for side in [-1.0, 1.0] {
        let (a, b) = (side * w * 0.98, side * w * 0.84);
        let x = if a < b { (a, b) } else { (b, a) };
        mesh.rear_patch(x, (y(0.75), y(1.2)), 0.003, RED_LAMP.glowing(TAIL_GLOW));
        wheel(&mut mesh, side * (w + 0.012), z(1.0), 0.34 * h, side);
        wheel(&mut mesh, side * (w + 0.012), z(4.4), 0.34 * h, side);
        mesh.side_patch(side * (w + 0.006), (y(1.35), y(1.95)), (z(3.5), z(4.1)), side, GLASS);
        let corners = [
            [x.0, y(0.8), z(5.4) + 0.004],
            [x.1, y(0.8), z(5.4) + 0.004],
            [x.1, y(1.0), z(5.37) + 0.004],
            [x.0, y(1.0), z(5.37) + 0.004],
        ];
        mesh.patch(&corners, [0.0, 0.0, 1.0], CLEAR_LAMP.glowing(HEAD_GLOW));
    }
    mesh.rear_patch((-0.012, 0.012), (y(0.55), y(2.15)), 0.005, BUMPER);
    mesh.rear_patch((-w * 0.98, w * 0.98), (y(0.36), y(0.55)), 0.002, BUMPER);
    mesh.rear_patch((0.2, 0.72), (y(0.7), y(0.82)), 0.0, PLATE.shifted(seed));
    mesh.rear_patch((-w * 0.7, w * 0.7), (0.12, y(0.4)), 0.3, TYRE);
    mesh
}

/// A city bus.
pub fn bus(size: [f64; 3], grey: f32, seed: f32) -> Mesh {
    let mut mesh = Mesh::default();
    let body = Material::new(Look::Paint, grey, 0.32, 0.022).shifted(seed);
    let dark = Material::new(Look::Paint, grey * 0.5, 0.3, 0.022).shifted(seed);
    let (w, h, l) = (size[0] / 2.0, size[1] / 3.0, size[2]);
    let y = |y: f64| y * h;
    mesh.block((-w, w), (y(0.3), y(3.0)), (0.02, l), body);
    // A stripe along the sides, windows above it, wheels below.
    for side in [-1.0, 1.0] {
        mesh.side_patch(side * (w + 0.003), (y(0.32), y(0.62)), (0.05, l - 0.05), side, dark);
        mesh.side_patch(side * (w + 0.003), (y(1.18), y(1.32)), (0.05, l - 0.05), side, dark);
        let panes = (l / 1.6).floor().max(1.0);
        let pitch = (l - 0.6) / panes;
        for k in 0..panes as usize {
            let at = 0.3 + k as f64 * pitch;
            let pane = GLASS.shifted(seed + 3.1 * k as f32);
            mesh.side_patch(
                side * (w + 0.006),
                (y(1.45), y(2.5)),
                (at + 0.08, at + pitch - 0.08),
                side,
                pane,
            );
        }
        // Destination displays and lettering.
        mesh.side_patch(
            side * (w + 0.006),
            (y(2.58), y(2.85)),
            (l * 0.55, l * 0.8),
            side,
            PLATE.shifted(seed),
        );
        mesh.side_patch(
            side * (w + 0.006),
            (y(0.72), y(1.1)),
            (l * 0.2, l * 0.36),
            side,
            PLATE.shifted(seed + 9.0),
        );
        wheel(&mut mesh, side * (w + 0.012), l * 0.22, 0.48 * h, side);
        wheel(&mut mesh, side * (w + 0.012), l * 0.76, 0.48 * h, side);
        let (a, b) = (side * w * 0.97, side * w * 0.82);
        let x = if a < b { (a, b) } else { (b, a) };
        mesh.rear_patch(x, (y(0.7), y(1.25)), 0.006, RED_LAMP.glowing(TAIL_GLOW));
        let corners = [
            [x.0, y(0.6), l + 0.006],
            [x.1, y(0.6), l + 0.006],
            [x.1, y(0.9), l + 0.006],
            [x.0, y(0.9), l + 0.006],
        ];
        mesh.patch(&corners, [0.0, 0.0, 1.0], CLEAR_LAMP.glowing(HEAD_GLOW));
    }
    mesh.rear_patch((-w * 0.86, w * 0.86), (y(1.6), y(2.55)), 0.01, GLASS.shifted(seed));
    mesh.rear_patch((-w * 0.7, w * 0.7), (y(2.62), y(2.88)), 0.008, PLATE.shifted(seed + 5.0));
    mesh.rear_patch((-w * 0.75, w * 0.75), (y(0.65), y(1.4)), 0.008, dark);
    mesh.rear_patch((-w * 0.98, w * 0.98), (y(0.31), y(0.55)), 0.0, BUMPER);
    let front = [
        [-w * 0.92, y(1.3), l + 0.005],
        [w * 0.92, y(1.3), l + 0.005],
        [w * 0.92, y(2.7), l + 0.005],
        [-w * 0.92, y(2.7), l + 0.005],
    ];
    mesh.patch(&front, [0.0, 0.0, 1.0], GLASS.shifted(seed));
    mesh.rear_patch((-w * 0.8, w * 0.8), (0.15, y(0.35)), 0.4, TYRE);
    mesh
}

/// A lorry with a box body.
pub fn lorry(size: [f64; 3], grey: f32, seed: f32) -> Mesh {
    let mut mesh = Mesh::default();
    let (w, h, l) = (size[0] / 2.0, size[1], size[2]);
    let body = Material::new(Look::Paint, grey, 0.28, 0.03).shifted(seed);
    let cab = paint(grey * 0.7, seed + 1.0);
    let chassis = Material::new(Look::Plain, 45.0, 0.3, 0.02).shifted(seed);
    // Box, chassis and cab; the cab is a little lower, with a gap behind it.
    let (box_end, cab_start) = (l - 2.4, l - 2.1);
    mesh.block((-w, w), (1.15, h), (0.02, box_end), body);
    mesh.block((-0.55 * w, 0.55 * w), (0.55, 1.15), (0.1, l - 0.2), chassis);
    mesh.extrude(
        &[(cab_start, 0.5), (cab_start, 0.78 * h), (l - 0.35, 0.78 * h), (l, 0.5 * h), (l, 0.45)],
        (-0.97 * w, 0.97 * w),
        cab,
    );
    for side in [-1.0, 1.0] {
        for z in [1.3, 2.5, l - 1.4] {
            wheel(&mut mesh, side * (w - 0.05), z, 0.5, side);
        }
        // The side guard between the wheels.
        mesh.side_patch(side * (w - 0.1), (0.55, 0.95), (3.3, l - 2.6), side, chassis);
        let glass = GLASS.shifted(seed);
        mesh.side_patch(side * (0.97 * w + 0.006), (0.5 * h, 0.7 * h), (l - 1.5, l - 0.6), side, glass);
        let (a, b) = (side * w * 0.97, side * w * 0.75);
        let x = if a < b { (a, b) } else { (b, a) };
        mesh.rear_patch(x, (0.8, 1.02), 0.006, RED_LAMP.glowing(TAIL_GLOW));
        let lamp =
            [[x.0, 0.65, l + 0.006], [x.1, 0.65, l + 0.006], [x.1, 0.9, l + 0.006], [x.0, 0.9, l + 0.006]];
        mesh.patch(&lamp, [0.0, 0.0, 1.0], CLEAR_LAMP.glowing(HEAD_GLOW));
    }
    // Doors at the rear, the underrun bar, the number plate.
    mesh.rear_patch((-0.015, 0.015), (1.25, h - 0.1), 0.01, BUMPER);
    for x in [-0.45, 0.45] {
        mesh.rear_patch((x * w - 0.02, x * w + 0.02), (1.25, h - 0.1), 0.008, BUMPER);
    }
    mesh.rear_patch((-w * 0.98, w * 0.98), (0.45, 0.7), 0.0, BUMPER);
    mesh.rear_patch((-0.26, 0.26), (0.85, 0.97), 0.004, PLATE.shifted(seed));
    let front = [
        [-0.88 * w, 0.52 * h, l - 0.035],
        [0.88 * w, 0.52 * h, l - 0.035],
        [0.88 * w, 0.72 * h, l - 0.25],
        [-0.88 * w, 0.72 * h, l - 0.25],
    ];
    mesh.patch(&front, [0.0, 0.1, 1.0], GLASS.shifted(seed));
    mesh
}
