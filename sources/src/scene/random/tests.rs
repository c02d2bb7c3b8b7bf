//! Tests of generated scenes.

use super::{Kind, text};
use crate::scene::file::{SceneFile, Weather};
use crate::scene::mesh::Point;
use crate::scene::truth::ObjectClass;
use crate::scene::world::{Present, World};
use crate::scene::{Scene, library};

/// Seeds of the geometric tests: those that train.
const SEEDS: std::ops::RangeInclusive<u64> = 1..=60;

/// Time between compared positions, in seconds.
const STEP_S: f64 = 0.4;

fn world(seed: u64) -> World {
    let file =
        SceneFile::parse(&text(seed), &format!("random?seed={seed}")).unwrap_or_else(|e| panic!("{e}"));
    let (rig, size, height_m) = file.camera.values().unwrap();
    World::new(file, rig, size, height_m)
}

/// A box on the ground: its middle, its axes and half its sides; from and to above the plane.
#[derive(Clone, Copy, Debug)]
struct Footprint {
    middle: [f64; 2],
    axes: [[f64; 2]; 2],
    half: [f64; 2],
    up: (f64, f64),
}

impl Footprint {
    /// The part of an object between two shares of its width and its length, `up` metres above its foot.
    fn part(present: &Present, across: (f64, f64), along: (f64, f64), up: (f64, f64)) -> Self {
        let placement = &present.placement;
        let flat = |p: Point| [p[0], p[2]];
        let (x, z) = (0.5 * (across.0 + across.1), 0.5 * (along.0 + along.1));
        let foot = placement.at[1];
        Self {
            middle: flat(placement.place([x, 0.0, z])),
            axes: [flat(placement.axes[0]), flat(placement.axes[2])],
            half: [0.5 * (across.1 - across.0), 0.5 * (along.1 - along.0)],
            up: (foot + up.0, foot + up.1),
        }
    }

    /// How far both overlap, at least, in metres; negative apart. Separating axes.
    fn overlap(&self, other: &Self) -> f64 {
        let d = [other.middle[0] - self.middle[0], other.middle[1] - self.middle[1]];
        let dot = |a: [f64; 2], b: [f64; 2]| a[0] * b[0] + a[1] * b[1];
        let reach = |box_: &Self, axis: [f64; 2]| {
            (0..2).map(|k| box_.half[k] * dot(box_.axes[k], axis).abs()).sum::<f64>()
        };
        let flat = self.axes.iter().chain(&other.axes);
        let flat = flat.map(|&axis| reach(self, axis) + reach(other, axis) - dot(d, axis).abs());
        let up = self.up.1.min(other.up.1) - self.up.0.max(other.up.0);
        flat.fold(up, f64::min)
    }
}

/// The solid parts of an object: boxes within its bounds.
fn parts(world: &World, present: &Present) -> Vec<Footprint> {
    let [width, height, length] = present.size_m;
    let half = 0.5 * width;
    let whole = |up: (f64, f64)| Footprint::part(present, (-half, half), (0.0, length), up);
    match world.instances()[present.instance].class {
        // The crown is round; its box has corners that it does not fill.
        ObjectClass::Tree => {
            let (x, z) = ((-0.7 * half, 0.7 * half), (0.15 * length, 0.85 * length));
            vec![Footprint::part(present, x, z, (0.45 * height, 0.9 * height))]
        }
        ObjectClass::Bush => {
            vec![Footprint::part(
                present,
                (-0.7 * half, 0.7 * half),
                (0.15 * length, 0.85 * length),
                (0.0, height),
            )]
        }
        // A street lamp: the post is at one end of its arm.
        ObjectClass::Pole if height > 5.0 => vec![whole((height - 0.2, height))],
        ObjectClass::Bridge => {
            let part = |x: (f64, f64), up: (f64, f64)| Footprint::part(present, x, (0.2, length - 0.2), up);
            let clear = height - 2.2;
            vec![
                part((-half, half), (clear, height)),
                part((-half + 8.0, -half + 12.0), (0.0, clear)),
                part((half - 12.0, half - 8.0), (0.0, clear)),
            ]
        }
        _ => vec![whole((0.0, height))],
    }
}

#[test]
fn nothing_intersects_and_our_vehicle_hits_nothing() {
    for seed in SEEDS {
        let mut world = world(seed);
        let mut time_s = 0.0;
        while time_s <= world.file.seconds {
            world.place(time_s);
            let own = Footprint {
                middle: [0.0, -0.25],
                axes: [[1.0, 0.0], [0.0, 1.0]],
                half: [0.95, 2.25],
                up: (0.05, 1.9),
            };
            let all: Vec<(usize, Vec<Footprint>)> =
                (0..world.present.len()).map(|k| (k, parts(&world, &world.present[k]))).collect();
            let name = |k: usize| {
                let present = &world.present[k];
                let [x, _, z] = present.placement.at;
                format!("{} at {x:.2} {z:.2}", world.instances()[present.instance].class.name())
            };
            for (k, boxes) in &all {
                for part in boxes {
                    assert!(part.overlap(&own) < 0.0, "seed {seed}, {time_s:.1} s: we hit {}", name(*k));
                }
            }
            for (n, (k, boxes)) in all.iter().enumerate() {
                let row = world.instances()[world.present[*k].instance].row;
                for (other, others) in &all[n + 1..] {
                    // Pieces of one row join.
                    if row.is_some() && world.instances()[world.present[*other].instance].row == row {
                        continue;
                    }
                    for (a, b) in boxes.iter().flat_map(|a| others.iter().map(move |b| (a, b))) {
                        let deep = a.overlap(b);
                        assert!(
                            deep < 0.02,
                            "seed {seed}, {time_s:.1} s: {} and {} by {deep:.2} m",
                            name(*k),
                            name(*other)
                        );
                    }
                }
            }
            time_s += STEP_S;
        }
    }
}
