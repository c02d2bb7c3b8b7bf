//! A synthetic drive with exact truth: it feeds the demo and the tests.

pub mod render;
pub mod texture;

use crate::{PairSource, SourceError};
use perception::rig::Rig;
use perception::road::PixelBox;
use render::{Block, Camera, Look, render};
use texture::Texture;

/// What an object of the scene is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ObjectClass {
    /// A car.
    Vehicle,
    /// A thin upright object.
    Post,
    /// A small box on the road.
    Box,
    /// Beside the road.
    Building,
}

/// An object as it is in one frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ObjectTruth {
    /// What it is.
    pub class: ObjectClass,
    /// Distance of its near side along z, in metres.
    pub distance_m: f64,
    /// Its middle, metres right of the left camera's axis.
    pub lateral_m: f64,
    /// Width in metres.
    pub width_m: f64,
    /// Height in metres.
    pub height_m: f64,
    /// Its near side in the left image.
    pub bounds: PixelBox,
}

/// One pair with its truth.
#[derive(Clone, Debug)]
pub struct SceneFrame {
    /// The left image.
    pub left: Vec<u8>,
    /// The right image.
    pub right: Vec<u8>,
    /// Exact disparity of each left pixel, in px; 0 at infinity.
    pub disparity_px: Vec<f32>,
    /// Objects whose near side lies in the picture and within 60 m, nearest first, hidden ones too;
    /// buildings left out.
    pub objects: Vec<ObjectTruth>,
}

/// The built-in drive: a street with houses, parked cars, posts and a small box, and a car ahead
/// that is caught up with and then pulls away. Its objects repeat every [`Drive::CYCLE_S`] seconds;
/// the same seed gives the same pictures.
#[derive(Debug)]
pub struct Drive {
    seed: u64,
    size: (usize, usize),
    rig: Rig,
    texture: Texture,
    depth: Vec<f32>,
    blocks: Vec<(Block, ObjectClass)>,
    visible: Vec<Block>,
    period_ns: u64,
}

impl Drive {
    /// Seconds after which the drive repeats.
    pub const CYCLE_S: f64 = 12.0;

    /// Height of the camera above the road, in metres.
    pub const CAMERA_HEIGHT_M: f64 = 1.25;

    /// The vehicle's own speed, in m/s.
    const SPEED_M_S: f64 = 8.0;

    /// Distance of the car ahead (s, m), linear in between.
    const LEAD: [(f64, f64); 5] = [(0.0, 28.0), (1.0, 28.0), (6.5, 6.0), (8.0, 6.0), (12.0, 28.0)];

    /// The drive as the paper's rig sees it: 640 × 480 px, 120 mm, 879 px of focal length.
    pub fn paper(seed: u64) -> Self {
        let rig = Rig { focal_px: 879.0, baseline_m: 0.12, cx_px: 320.0, cy_px: 220.0 };
        Self::new(seed, rig, (640, 480), 12.5)
    }

    /// The drive as seen by another rig, `fps` pairs a second.
    ///
    /// # Panics
    /// When the size is zero or `fps` is not above zero.
    pub fn new(seed: u64, rig: Rig, size: (usize, usize), fps: f64) -> Self {
        assert!(size.0 > 0 && size.1 > 0 && fps > 0.0);
        Self {
            seed,
            size,
            rig,
            texture: Texture::new(seed),
            depth: vec![0.0; size.0 * size.1],
            blocks: Vec::new(),
            visible: Vec::new(),
            period_ns: (1e9 / fps) as u64,
        }
    }

    /// The same drive, seen `fps` times a second.
    ///
    /// # Panics
    /// When `fps` is not above zero.
    pub fn at_rate(self, fps: f64) -> Self {
        assert!(fps > 0.0);
        Self { period_ns: (1e9 / fps) as u64, ..self }
    }

    /// Places everything at time `t` seconds of the cycle.
    fn place(&mut self, t: f64) {
        self.blocks.clear();
        let travelled = t * Self::SPEED_M_S;
        let mut add =
            |class, x: (f64, f64), tall: f64, near: f64, long: f64, grey: f32, look, pattern: f32| {
                let z_m = (near, near + long);
                if z_m.1 > 0.5 && near < 150.0 {
                    self.blocks.push((Block { x_m: x, up_m: (0.0, tall), z_m, grey, look, pattern }, class));
                }
            };
        // The street repeats with the cycle, so that the drive can.
        let length = Self::CYCLE_S * Self::SPEED_M_S;
        for repeat in -1..3 {
            let start = f64::from(repeat) * length - travelled;
            for house in 0..8 {
                let near = start + 12.0 * f64::from(house);
                for (side, sign) in [(0, -1.0), (1, 1.0)] {
                    let key = texture::hash(self.seed ^ (house * 2 + side) as u64);
                    let tall = 4.0 + (key % 50) as f64 / 10.0;
                    let front = 9.0 + (key / 64 % 20) as f64 / 10.0;
                    let (a, b) = (sign * front, sign * (front + 8.0));
                    let grey = 95.0 + (key / 4096 % 70) as f32;
                    let x = (a.min(b), a.max(b));
                    add(ObjectClass::Building, x, tall, near, 11.0, grey, Look::Building, (key % 251) as f32);
                }
            }
            for (at, x, grey) in
                [(14.0, 4.4, 150.0), (38.0, -4.4, 70.0), (61.0, 4.4, 105.0), (83.0, -4.4, 135.0)]
            {
                let x = (x - 0.88, x + 0.88);
                add(ObjectClass::Vehicle, x, 1.45, start + at, 4.2, grey, Look::Vehicle, grey);
            }
            for (at, x) in [(26.0, 6.4), (50.0, -6.4), (74.0, 6.4)] {
                add(
                    ObjectClass::Post,
                    (x - 0.15, x + 0.15),
                    2.6,
                    start + at,
                    0.3,
                    60.0,
                    Look::Plain,
                    at as f32,
                );
            }
            add(ObjectClass::Box, (-3.2, -2.5), 0.6, start + 45.0, 0.5, 175.0, Look::Plain, 90.0);
        }
        let lead = Self::lead_distance_m(t);
        add(ObjectClass::Vehicle, (-0.9, 0.9), 1.5, lead, 4.3, 85.0, Look::Vehicle, 140.0);
    }

    /// Distance of the rear of the car ahead, `t` seconds into the drive.
    pub fn lead_distance_m(t: f64) -> f64 {
        let t = t.rem_euclid(Self::CYCLE_S);
        Self::LEAD
            .windows(2)
            .find(|w| t <= w[1].0)
            .map_or(Self::LEAD[0].1, |w| w[0].1 + (w[1].1 - w[0].1) * (t - w[0].0) / (w[1].0 - w[0].0))
    }

    /// Seconds into the drive of pair `index`.
    pub fn time_s(&self, index: u64) -> f64 {
        (index as f64 * self.period_ns as f64 * 1e-9).rem_euclid(Self::CYCLE_S)
    }

    fn draw(&mut self, index: u64, right: bool, grey: &mut [u8]) {
        let camera = Camera {
            rig: &self.rig,
            size: self.size,
            x_m: if right { self.rig.baseline_m } else { 0.0 },
            height_m: Self::CAMERA_HEIGHT_M,
            travelled_m: self.time_s(index) * Self::SPEED_M_S,
            noise_seed: texture::hash(self.seed ^ index << 1 ^ u64::from(right)),
        };
        self.visible.clear();
        self.visible.extend(self.blocks.iter().map(|(block, _)| *block));
        render(&camera, &self.texture, &self.visible, grey, &mut self.depth);
    }

    /// Pair `index` with its truth.
    pub fn frame(&mut self, index: u64) -> SceneFrame {
        let pixels = self.size.0 * self.size.1;
        let (mut left, mut right) = (vec![0; pixels], vec![0; pixels]);
        self.place(self.time_s(index));
        self.draw(index, true, &mut right);
        self.draw(index, false, &mut left);
        let disparity_px = self
            .depth
            .iter()
            .map(|&z| if z.is_finite() { self.rig.disparity_px(z.into()) as f32 } else { 0.0 })
            .collect();
        let mut objects: Vec<ObjectTruth> = self
            .blocks
            .iter()
            .filter(|(block, class)| *class != ObjectClass::Building && (0.5..60.0).contains(&block.z_m.0))
            .filter_map(|(block, class)| {
                let z = block.z_m.0;
                let u = |x: f64| self.rig.cx_px + x * self.rig.focal_px / z;
                let v = |up: f64| self.rig.cy_px + (Self::CAMERA_HEIGHT_M - up) * self.rig.focal_px / z;
                let clip = |value: f64, side: usize| value.clamp(0.0, side as f64) as u32;
                let (x0, x1) = (clip(u(block.x_m.0), self.size.0), clip(u(block.x_m.1), self.size.0));
                let (y0, y1) = (clip(v(block.up_m.1), self.size.1), clip(v(block.up_m.0), self.size.1));
                (x1 > x0 && y1 > y0).then_some(ObjectTruth {
                    class: *class,
                    distance_m: z,
                    lateral_m: (block.x_m.0 + block.x_m.1) / 2.0,
                    width_m: block.x_m.1 - block.x_m.0,
                    height_m: block.up_m.1,
                    bounds: PixelBox { x: x0, y: y0, width: x1 - x0, height: y1 - y0 },
                })
            })
            .collect();
        objects.sort_by(|a, b| a.distance_m.total_cmp(&b.distance_m));
        SceneFrame { left, right, disparity_px, objects }
    }
}

impl PairSource for Drive {
    fn size(&self) -> (usize, usize) {
        self.size
    }

    fn rig(&self) -> Option<Rig> {
        Some(self.rig)
    }

    fn count(&self) -> Option<u64> {
        None
    }

    fn period_ns(&self) -> u64 {
        self.period_ns
    }

    fn read(&mut self, index: u64, left: &mut [u8], right: &mut [u8]) -> Result<(), SourceError> {
        self.place(self.time_s(index));
        self.draw(index, false, left);
        self.draw(index, true, right);
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_drive_is_the_same_every_time_and_moves() {
        let (mut a, mut b) = (Drive::paper(1), Drive::paper(1));
        let pixels = 640 * 480;
        let (mut left, mut right) = (vec![0; pixels], vec![0; pixels]);
        b.read(7, &mut left, &mut right).unwrap();
        b.read(20, &mut left, &mut right).unwrap();
        let frame = a.frame(20);
        assert_eq!((frame.left, frame.right), (left.clone(), right.clone()));
        a.read(21, &mut left, &mut right).unwrap();
        assert_ne!(a.frame(20).left, left);
        assert_ne!(Drive::paper(2).frame(20).left, a.frame(20).left);
    }

    #[test]
    fn truth_and_picture_belong_together() {
        let mut drive = Drive::paper(3);
        let rig = drive.rig().unwrap();
        for index in [0, 40, 85] {
            let frame = drive.frame(index);
            let lead = Drive::lead_distance_m(drive.time_s(index));
            let object = frame.objects.iter().find(|o| o.lateral_m == 0.0).expect("the car ahead");
            assert!((object.distance_m - lead).abs() < 1e-9);
            let middle = (object.bounds.y + object.bounds.height / 2) as usize * 640
                + (object.bounds.x + object.bounds.width / 2) as usize;
            let expected = rig.disparity_px(lead) as f32;
            assert!((frame.disparity_px[middle] - expected).abs() < 1e-3, "frame {index}");
            // The lowest row sees the road.
            let road = rig.baseline_m / Drive::CAMERA_HEIGHT_M * (479.0 - rig.cy_px);
            assert!((f64::from(frame.disparity_px[479 * 640 + 320]) - road).abs() < 1e-3);
            assert!(frame.objects.windows(2).all(|w| w[0].distance_m <= w[1].distance_m));
        }
    }

    #[test]
    fn the_lead_car_comes_and_goes() {
        assert_eq!(Drive::lead_distance_m(0.5), 28.0);
        assert_eq!(Drive::lead_distance_m(7.0), 6.0);
        assert_eq!(Drive::lead_distance_m(12.0), Drive::lead_distance_m(0.0));
        assert!(Drive::lead_distance_m(4.0) < 20.0);
    }
}
