//! Meshes of fences, walls of stone, banks, barriers, signs and bushes: near side at z = 0, foot at y = 0.

use super::material::{Look, Material};
use super::mesh::Mesh;
use super::texture::unit;

/// Pitch of the boards of a fence, and the width of one, in metres.
const BOARD_M: (f64, f64) = (0.2, 0.13);

/// A piece of wooden fence: boards with gaps between them, on two rails: (length, height).
pub fn fence(length_m: f64, height_m: f64, grey: f32, seed: f32) -> Mesh {
    let mut mesh = Mesh::default();
    let wood = Material::new(Look::Plain, grey, 0.6, 0.015).shifted(seed);
    let boards = (length_m / BOARD_M.0).floor().max(1.0);
    let pitch = length_m / boards;
    for k in 0..boards as usize {
        let from = k as f64 * pitch + 0.5 * (pitch - BOARD_M.1);
        let own = wood.shifted(seed + 0.37 * k as f32);
        mesh.block((-0.02, 0.01), (0.06, height_m), (from, from + BOARD_M.1), own);
    }
    let dark = Material::new(Look::Plain, grey * 0.8, 0.5, 0.02).shifted(seed);
    for up in [0.25, 0.78] {
        mesh.block((0.01, 0.05), (up * height_m, up * height_m + 0.08), (0.0, length_m), dark);
    }
    for at in [0.25, 0.75] {
        let z = at * length_m;
        mesh.block((0.01, 0.1), (0.0, height_m), (z - 0.05, z + 0.05), dark);
    }
    mesh
}

/// A piece of wall of natural stone, of uneven height: (length, height).
pub fn stone_wall(length_m: f64, height_m: f64, grey: f32, seed: u64) -> Mesh {
    let mut mesh = Mesh::default();
    let parts = (length_m / 0.8).ceil().max(1.0) as u64;
    for k in 0..parts {
        let own = |n: u64| unit(seed << 20 ^ k << 4 ^ n) - 0.5;
        let stone =
            Material::new(Look::Plain, grey + 24.0 * own(0) as f32, 0.95, 0.03).shifted(5.3 * k as f32);
        let z = |k: u64| length_m * k as f64 / parts as f64;
        let top = height_m * (1.0 + 0.12 * own(1));
        let lean = 0.04 + 0.03 * own(2);
        mesh.frustum(
            [(-0.2, 0.2), (-0.2 + lean, 0.2 - lean)],
            (0.0, top),
            [(z(k), z(k + 1)), (z(k), z(k + 1))],
            stone,
        );
    }
    mesh
}

/// A piece of concrete barrier, wider at its foot: (length, height).
pub fn barrier(length_m: f64, height_m: f64, grey: f32) -> Mesh {
    let mut mesh = Mesh::default();
    let concrete = Material::new(Look::Plain, grey, 0.45, 0.025);
    let z = [(0.0, length_m); 2];
    let (low, high) = (0.1 * height_m, 0.4 * height_m);
    mesh.block((-0.3, 0.3), (0.0, low), (0.0, length_m), concrete);
    mesh.frustum([(-0.3, 0.3), (-0.14, 0.14)], (low, high), z, concrete);
    mesh.frustum([(-0.14, 0.14), (-0.08, 0.08)], (high, height_m), z, concrete);
    mesh
}

/// A piece of a bank of earth, `size` (depth across the road, height, length), steep on the side that `towards` points to.
pub fn bank(size: [f64; 3], towards: f64, grey: f32) -> Mesh {
    let mut mesh = Mesh::default();
    let [w, h, d] = size;
    let earth = Material::new(Look::Grass, grey, 0.75, 0.022);
    // One to one; the far side ends in the ground that lies behind it.
    let lower = (-w / 2.0, w / 2.0);
    let steep = h.min(0.6 * w);
    let upper = if towards > 0.0 { (lower.0, lower.1 - steep) } else { (lower.0 + steep, lower.1) };
    mesh.frustum([lower, upper], (0.0, h), [(0.0, d), (0.0, d)], earth);
    mesh
}

/// A traffic sign on a post, seen from the front: (height).
pub fn sign(height_m: f64, seed: f32) -> Mesh {
    let mut mesh = Mesh::default();
    let metal = Material::new(Look::Plain, 120.0, 0.3, 0.02).shifted(seed);
    mesh.round((0.0, 0.08), (0.0, height_m), (0.035, 0.035), metal);
    let half = 0.3;
    let face = Material::new(Look::Plain, 185.0, 0.7, 0.02).shifted(seed);
    mesh.block((-half, half), (height_m - 2.0 * half, height_m), (0.02, 0.04), face);
    let rim = Material::new(Look::Plain, 70.0, 0.3, 0.02);
    let (low, high) = (height_m - 2.0 * half, height_m);
    for x in [(-half, -half + 0.06), (half - 0.06, half)] {
        mesh.rear_patch(x, (low, high), 0.018, rim);
    }
    for y in [(low, low + 0.06), (high - 0.06, high)] {
        mesh.rear_patch((-half, half), y, 0.018, rim);
    }
    mesh
}

/// A bush; the shape depends on the seed.
pub fn bush(height_m: f64, seed: u64) -> Mesh {
    let mut mesh = Mesh::default();
    let h = height_m;
    for k in 0..2_u64 {
        let own = |n: u64| unit(seed << 16 ^ k << 4 ^ n) - 0.5;
        let leaves =
            Material::new(Look::Leaves, 68.0 + 20.0 * own(0) as f32, 0.8, 0.02).shifted(9.0 * k as f32);
        let radius = h * (0.5 - 0.08 * k as f64);
        let middle = [0.3 * h * own(1), h * (0.42 + 0.1 * k as f64), 0.3 * h * own(2)];
        mesh.ball(middle, [radius, 0.5 * h, radius], seed << 8 ^ k, leaves);
    }
    mesh
}
