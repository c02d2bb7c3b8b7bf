//! Meshes of everything but vehicles: near side at z = 0, foot at y = 0.

use super::material::{Look, Material};
use super::mesh::{Mesh, ring};
use super::texture::unit;

/// A pedestrian seen from behind, `size` (width, height, depth).
pub fn pedestrian(size: [f64; 3], grey: f32, seed: f32) -> Mesh {
    let mut mesh = Mesh::default();
    let coat = Material::new(Look::Plain, grey, 0.55, 0.018).shifted(seed);
    let trousers = Material::new(Look::Plain, grey * 0.55, 0.4, 0.018).shifted(seed + 2.0);
    let skin = Material::new(Look::Plain, 150.0, 0.35, 0.015).shifted(seed);
    let (w, h, d) = (size[0] / 0.55, size[1] / 1.75, size[2] / 0.4);
    let z = |z: f64| 0.2 * d + z * d;
    // One leg in front of the other.
    for (side, step) in [(-1.0, -0.1), (1.0, 0.1)] {
        let x = side * 0.1 * w;
        let foot = (z(step - 0.08), z(step + 0.1));
        let hip = (z(-0.09), z(0.09));
        mesh.frustum(
            [(x - 0.06 * w, x + 0.06 * w), (x - 0.09 * w, x + 0.09 * w)],
            (0.0, 0.85 * h),
            [foot, hip],
            trousers,
        );
        let arm = side * 0.235 * w;
        let hand = (z(-step - 0.05), z(-step + 0.05));
        mesh.frustum(
            [(arm - 0.04 * w, arm + 0.04 * w), (arm - 0.05 * w, arm + 0.03 * w)],
            (0.75 * h, 1.42 * h),
            [hand, (z(-0.06), z(0.06))],
            coat,
        );
    }
    mesh.frustum(
        [(-0.19 * w, 0.19 * w), (-0.22 * w, 0.22 * w)],
        (0.8 * h, 1.45 * h),
        [(z(-0.12), z(0.12)), (z(-0.11), z(0.11))],
        coat,
    );
    mesh.round((0.0, z(0.0)), (1.44 * h, 1.53 * h), (0.055 * w, 0.055 * w), skin);
    mesh.ball(
        [0.0, 1.63 * h, z(0.0)],
        [0.09 * w, 0.12 * h, 0.1 * d],
        0,
        Material::new(Look::Plain, 70.0, 0.4, 0.012).shifted(seed),
    );
    mesh
}

/// A traffic cone with two white bands, `size` (width of its base, height).
pub fn cone(size: [f64; 3], grey: f32, seed: f32) -> Mesh {
    let mut mesh = Mesh::default();
    let (w, h) = (size[0], size[1]);
    let orange = Material::new(Look::Plain, grey, 0.3, 0.012).shifted(seed);
    let white = Material::new(Look::Plain, 215.0, 0.3, 0.012).shifted(seed);
    let foot = Material::new(Look::Plain, 55.0, 0.3, 0.015).shifted(seed);
    let middle = w / 2.0;
    mesh.block((-w / 2.0, w / 2.0), (0.0, 0.035), (0.0, w), foot);
    let radius = |y: f64| 0.38 * w * (1.0 - y / h) + 0.035 * (y / h);
    let bands = [
        (0.035, 0.3, orange),
        (0.3, 0.48, white),
        (0.48, 0.62, orange),
        (0.62, 0.76, white),
        (0.76, 1.0, orange),
    ];
    for (from, to, material) in bands {
        let (a, b) = (if from < 0.04 { 0.035 } else { from * h }, to * h);
        mesh.loft(&ring(0.0, middle, a, radius(a)), &ring(0.0, middle, b, radius(b)), material);
    }
    mesh
}

/// A cardboard box, `size` (width, height, depth).
pub fn debris(size: [f64; 3], grey: f32, seed: f32) -> Mesh {
    let mut mesh = Mesh::default();
    let [w, h, d] = size;
    mesh.block(
        (-w / 2.0, w / 2.0),
        (0.0, h),
        (0.0, d),
        Material::new(Look::Plain, grey, 0.8, 0.01).shifted(seed),
    );
    // Packing tape.
    let tape = Material::new(Look::Plain, grey * 0.6, 0.3, 0.01);
    mesh.rear_patch((-w * 0.06, w * 0.06), (0.0, h), -0.001, tape);
    mesh
}

/// A plain block.
pub fn block(size: [f64; 3], grey: f32, seed: f32) -> Mesh {
    let mut mesh = Mesh::default();
    let [w, h, d] = size;
    mesh.block(
        (-w / 2.0, w / 2.0),
        (0.0, h),
        (0.0, d),
        Material::new(Look::Plain, grey, 0.7, 0.015).shifted(seed),
    );
    mesh
}

/// A pole, `size` (diameter, height).
pub fn pole(size: [f64; 3], grey: f32, seed: f32) -> Mesh {
    let mut mesh = Mesh::default();
    let r = size[0] / 2.0;
    let metal = Material::new(Look::Plain, grey, 0.5, 0.02).shifted(seed);
    mesh.round((0.0, r), (0.0, size[1] * 0.72), (r, r), metal);
    mesh.round(
        (0.0, r),
        (size[1] * 0.72, size[1]),
        (r, r),
        Material::new(Look::Plain, 200.0, 0.4, 0.02).shifted(seed),
    );
    mesh
}

/// A street lamp whose arm extends to the side of `towards` (−1 or 1).
pub fn lamp(height_m: f64, towards: f64) -> Mesh {
    let mut mesh = Mesh::default();
    let metal = Material::new(Look::Plain, 95.0, 0.4, 0.03);
    mesh.round((0.0, 0.08), (0.0, height_m), (0.09, 0.05), metal);
    let reach = 1.6 * towards;
    let x = if reach < 0.0 { (reach, 0.0) } else { (0.0, reach) };
    mesh.block(x, (height_m - 0.08, height_m), (0.05, 0.13), metal);
    let head = (reach - 0.3, reach + 0.3);
    let lit = Material::new(Look::Plain, 225.0, 0.1, 0.03).glowing(900.0);
    mesh.block(head, (height_m - 0.06, height_m + 0.06), (0.0, 0.2), lit);
    // The luminaire, seen from below.
    let (y, z) = (height_m - 0.061, (0.0, 0.2));
    mesh.patch(
        &[[head.0, y, z.0], [head.1, y, z.0], [head.1, y, z.1], [head.0, y, z.1]],
        [0.0, -1.0, 0.0],
        lit,
    );
    mesh
}

/// A piece of hedge, clipped unevenly. `size` (width, height, length).
pub fn hedge(size: [f64; 3], grey: f32, seed: u64) -> Mesh {
    let mut mesh = Mesh::default();
    let [w, h, d] = size;
    // Composed of many bushes along its longer side.
    let across = w > d;
    let (long, step) = (w.max(d), 0.45);
    let bushes = (long / step).ceil().max(1.0) as u64;
    for k in 0..bushes {
        let own = |n: u64| unit(seed << 20 ^ k << 4 ^ n) - 0.5;
        let leaves =
            Material::new(Look::Leaves, grey + 14.0 * own(0) as f32, 0.75, 0.016).shifted(7.3 * k as f32);
        let (a, b) = (long * k as f64 / bushes as f64, long * (k + 1) as f64 / bushes as f64);
        let top = h * (1.0 + 0.14 * own(1));
        let thin = 0.06 * own(2);
        let (x, z) = if across {
            ((a - w / 2.0, b - w / 2.0), (thin.max(0.0), d))
        } else {
            ((-w / 2.0 + thin.abs(), w / 2.0 - thin.abs()), (a, b))
        };
        let inset = 0.08_f64.min((x.1 - x.0) / 4.0);
        let upper = ((x.0 + inset, x.1 - inset), (z.0 + inset.min(d / 4.0), z.1 - inset.min(d / 4.0)));
        mesh.frustum([x, x], (0.0, top * 0.8), [z, z], leaves);
        mesh.frustum([x, upper.0], (top * 0.8, top), [z, upper.1], leaves);
    }
    mesh
}

/// A tree; the shape depends on the seed.
pub fn tree(height_m: f64, seed: u64) -> Mesh {
    let mut mesh = Mesh::default();
    let h = height_m;
    let bark = Material::new(Look::Plain, 62.0, 0.6, 0.02).shifted((seed % 97) as f32);
    mesh.round((0.0, 0.0), (0.0, 0.5 * h), (0.035 * h, 0.022 * h), bark);
    for k in 0..3_u64 {
        let own = |n: u64| unit(seed << 16 ^ k << 4 ^ n) - 0.5;
        let leaves =
            Material::new(Look::Leaves, 66.0 + 18.0 * own(0) as f32, 0.8, 0.03).shifted(11.0 * k as f32);
        let middle = [0.25 * h * own(1), h * (0.55 + 0.13 * k as f64), 0.25 * h * own(2)];
        let radius = h * (0.27 - 0.04 * k as f64);
        mesh.ball(middle, [radius, 0.8 * radius, radius], seed << 8 ^ k, leaves);
    }
    mesh
}

/// A house of `size` (depth across the road, height, length along it).
pub fn building(size: [f64; 3], grey: f32, seed: f32) -> Mesh {
    let mut mesh = Mesh::default();
    let [w, h, d] = size;
    let facade = Material::new(Look::Facade, grey, 0.6, 0.035).shifted(seed);
    mesh.block((-w / 2.0, w / 2.0), (0.0, h), (0.0, d), facade);
    let roof = Material::new(Look::Plain, grey * 0.55, 0.5, 0.05).shifted(seed);
    let eaves = 0.3;
    mesh.frustum(
        [(-w / 2.0 - eaves, w / 2.0 + eaves), (-w / 4.0, w / 4.0)],
        (h, h + w * 0.22),
        [(-eaves, d + eaves), (0.0, d)],
        roof,
    );
    mesh
}

/// A piece of guard rail, visible from the side that `outwards` points to: (length, height).
pub fn guard_rail(length_m: f64, height_m: f64, outwards: f64) -> Mesh {
    let mut mesh = Mesh::default();
    let metal = Material::new(Look::Plain, 150.0, 0.32, 0.025);
    let fold = 0.04 * outwards;
    let levels = [(0.0, 0.0), (fold, 0.07), (0.0, 0.155), (fold, 0.24), (0.0, 0.31)];
    for pair in levels.windows(2) {
        let y = |k: usize| height_m - 0.31 + pair[k].1;
        let corners = [
            [pair[0].0, y(0), 0.0],
            [pair[0].0, y(0), length_m],
            [pair[1].0, y(1), length_m],
            [pair[1].0, y(1), 0.0],
        ];
        // Visible from both sides.
        let mut face = super::mesh::Face::new(&corners, metal);
        if face.normal[0] * outwards < 0.0 {
            face.normal = face.normal.map(|v| -v);
        }
        mesh.faces.push(face);
    }
    let post = Material::new(Look::Plain, 105.0, 0.4, 0.02);
    let x = if outwards > 0.0 { (-0.1, -0.02) } else { (0.02, 0.1) };
    for k in 0..2 {
        let z = length_m * (0.25 + 0.5 * f64::from(k));
        mesh.block(x, (0.0, height_m), (z, z + 0.1), post);
    }
    mesh
}

/// A piece of wall: (length, height).
pub fn wall(length_m: f64, height_m: f64, seed: f32) -> Mesh {
    let mut mesh = Mesh::default();
    let brick = Material::new(Look::Brick, 112.0, 0.55, 0.02).shifted(seed);
    mesh.block((-0.15, 0.15), (0.0, height_m), (0.0, length_m), brick);
    let cap = Material::new(Look::Plain, 150.0, 0.5, 0.03);
    mesh.block((-0.2, 0.2), (height_m, height_m + 0.06), (0.0, length_m), cap);
    mesh
}

/// A bridge across the road, `size` (span, clearance, length along the road).
pub fn bridge(size: [f64; 3], grey: f32) -> Mesh {
    let mut mesh = Mesh::default();
    let [w, h, d] = size;
    let concrete = Material::new(Look::Plain, grey, 0.6, 0.03);
    let half = w / 2.0;
    mesh.block((-half - 12.0, half + 12.0), (h, h + 1.3), (0.0, d), concrete);
    mesh.patch(
        &[[-half - 12.0, h, 0.0], [half + 12.0, h, 0.0], [half + 12.0, h, d], [-half - 12.0, h, d]],
        [0.0, -1.0, 0.0],
        Material::new(Look::Plain, grey * 0.45, 0.5, 0.04),
    );
    // A railing on top, abutments beside the road.
    mesh.block(
        (-half - 12.0, half + 12.0),
        (h + 1.3, h + 2.2),
        (0.0, 0.15),
        Material::new(Look::Plain, 120.0, 0.6, 0.02),
    );
    for x in [(-half - 4.0, -half), (half, half + 4.0)] {
        mesh.block(x, (0.0, h), (0.2, d - 0.2), concrete.shifted(x.0 as f32));
    }
    mesh
}
