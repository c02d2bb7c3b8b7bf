//! Class and mesh of the objects that a scene file names.

use super::file::{BesideFile, BesideKind, ObjectFile, ObjectKind};
use super::mesh::Mesh;
use super::texture::unit;
use super::truth::ObjectClass;
use super::{cycles, props, roadside, vehicles};

/// Class, mesh and depth across the road, in metres, of a piece of a row on the side `side` (-1 or 1), `long` metres long;
/// `key` chooses its appearance.
pub fn of_row(row: &BesideFile, side: f64, long: f64, key: u64) -> (ObjectClass, Mesh, f64) {
    let own = |i: u64| unit(key ^ i);
    let shift = own(0) as f32 * 3.0;
    let height = |usual: f64| row.height_m.unwrap_or(usual);
    let grey = |usual: f64| row.grey.unwrap_or(usual) as f32;
    match row.kind {
        BesideKind::Buildings => {
            let long = row.length_m.unwrap_or((long - 1.0 - own(2)).max(1.0));
            let size = [9.0, height(5.0 + 5.0 * own(1)), long];
            (ObjectClass::Building, props::building(size, 95.0 + 75.0 * own(3) as f32, shift), size[0])
        }
        BesideKind::Trees => (ObjectClass::Tree, props::tree(height(5.5 + 2.5 * own(1)), key), 0.0),
        BesideKind::Hedge => {
            let size = [0.9, height(1.1), long];
            (ObjectClass::Hedge, props::hedge(size, grey(70.0), key), size[0])
        }
        BesideKind::GuardRail => (ObjectClass::GuardRail, props::guard_rail(long, height(0.75), -side), 0.1),
        BesideKind::Wall => (ObjectClass::Wall, props::wall(long, height(1.8), shift), 0.3),
        BesideKind::StoneWall => {
            (ObjectClass::Wall, roadside::stone_wall(long, height(0.9), grey(118.0), key), 0.4)
        }
        BesideKind::Barrier => (ObjectClass::Wall, roadside::barrier(long, height(0.85), grey(150.0)), 0.6),
        BesideKind::Fence => {
            (ObjectClass::Fence, roadside::fence(long, height(1.1), grey(120.0), shift), 0.1)
        }
        BesideKind::Bank => {
            let size = [6.0, height(1.5), long];
            (ObjectClass::Bank, roadside::bank(size, -side, grey(82.0)), size[0])
        }
        BesideKind::Poles => (ObjectClass::Pole, props::pole([0.16, height(1.1), 0.16], 70.0, shift), 0.16),
        BesideKind::Signs => (ObjectClass::Pole, roadside::sign(height(2.6), shift), 0.6),
        BesideKind::Bushes => (ObjectClass::Bush, roadside::bush(height(1.0 + 0.8 * own(1)), key), 1.0),
        BesideKind::Lamps => (ObjectClass::Pole, props::lamp(height(6.0), -side), 0.0),
        BesideKind::ParkedCars => {
            let grey = 55.0 + 130.0 * own(1) as f32;
            let mesh = if own(2) < 0.25 {
                vehicles::van([1.95, height(2.2), 5.2], grey, shift)
            } else {
                vehicles::car([1.78, height(1.46), 4.3], grey, shift)
            };
            (ObjectClass::Car, mesh, 1.8)
        }
    }
}

/// Class and mesh of a single object; `key` chooses its appearance.
pub fn of_object(object: &ObjectFile, key: u64) -> (ObjectClass, Mesh) {
    let shift = unit(key) as f32 * 3.0;
    let grey = |usual: f64| object.grey.unwrap_or(usual) as f32;
    let size = object.size_m.unwrap_or(object.kind.size_m());
    match object.kind {
        ObjectKind::Car => (ObjectClass::Car, vehicles::car(size, grey(95.0), shift)),
        ObjectKind::Van => (ObjectClass::Car, vehicles::van(size, grey(160.0), shift)),
        ObjectKind::Bus => (ObjectClass::Bus, vehicles::bus(size, grey(150.0), shift)),
        ObjectKind::Lorry => (ObjectClass::Lorry, vehicles::lorry(size, grey(165.0), shift)),
        ObjectKind::Pedestrian => (ObjectClass::Pedestrian, props::pedestrian(size, grey(75.0), shift)),
        ObjectKind::Cyclist => (ObjectClass::Bicycle, cycles::cyclist(size, grey(80.0), shift)),
        ObjectKind::Bicycle => (ObjectClass::Bicycle, cycles::bicycle(size, grey(60.0), shift)),
        ObjectKind::Cone => (ObjectClass::Cone, props::cone(size, grey(118.0), shift)),
        ObjectKind::Debris => (ObjectClass::Debris, props::debris(size, grey(165.0), shift)),
        ObjectKind::Pole => (ObjectClass::Pole, props::pole(size, grey(70.0), shift)),
        ObjectKind::Hedge => (ObjectClass::Hedge, props::hedge(size, grey(70.0), key)),
        ObjectKind::Bridge => (ObjectClass::Bridge, props::bridge(size, grey(125.0))),
        ObjectKind::Block => (ObjectClass::Block, props::block(size, grey(150.0), shift)),
    }
}

impl ObjectKind {
    /// Width, height and length by default, in metres.
    pub fn size_m(self) -> [f64; 3] {
        match self {
            Self::Car => [1.8, 1.46, 4.4],
            Self::Van => [1.98, 2.3, 5.4],
            Self::Bus => [2.5, 3.05, 11.5],
            Self::Lorry => [2.5, 3.8, 12.0],
            Self::Pedestrian => [0.55, 1.75, 0.4],
            Self::Cyclist => [0.6, 1.75, 1.75],
            Self::Bicycle => [0.5, 1.05, 1.75],
            Self::Cone => [0.38, 0.75, 0.38],
            Self::Debris => [0.1, 0.1, 0.1],
            Self::Pole => [0.16, 1.1, 0.16],
            Self::Hedge => [5.0, 0.9, 1.2],
            Self::Bridge => [14.0, 5.0, 9.0],
            Self::Block => [0.7, 0.6, 0.5],
        }
    }
}
