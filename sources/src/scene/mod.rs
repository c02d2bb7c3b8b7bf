//! Synthetic scenes with exact ground truth, for the demo, evaluations and tests.
//!
//! A scene is a small TOML file ([`file::SceneFile`]); the built-in ones are in [`library`]. Both images are
//! rendered from the same textured surfaces, each through its own camera. Each pixel has four samples and
//! textures are filtered to its footprint, so that the two images agree to a fraction of a pixel.
//!
//! Objects have a position along the road's reference line and one across. The line's course on the ground plane is its
//! curvature, integrated twice ([`plan::Plan`]); its height is the integral of the grade ([`ground::Course`]). The world is
//! rigid: every frame shows the same one, from where the vehicle stands ([`route::Route`]).

mod bay;
mod boundary;
pub mod conditions;
mod counts;
mod course;
mod cross_section;
pub mod cycles;
mod drive;
mod error;
pub mod file;
mod footprint;
mod free_ground;
pub mod ground;
pub mod lens;
pub mod library;
pub mod light;
pub mod material;
pub mod mesh;
mod model;
pub mod motion;
pub mod paint;
pub mod plan;
pub mod precipitation;
pub mod props;
pub mod random;
#[cfg(test)]
mod rigid_world;
pub mod roadside;
pub mod route;
pub mod sensor;
pub mod streets;
pub mod strip;
mod survey;
pub mod texture;
pub mod truth;
pub mod vehicles;
pub mod view;
pub mod world;

pub use drive::Drive;
pub use truth::{BoundaryTruth, FreeGround, ObjectClass, ObjectTruth, OwnMotion, RoadTruth, SceneTruth};

use crate::{Geometry, PairSource, SourceError};
use file::{SceneError, SceneFile};
use lens::Coarse;
use paint::{Mirror, Painter, Row, Shade};
use perception::rig::Rig;
use sensor::Normal;
use texture::{Texture, hash};
use view::{Camera, MIDDLE, SAMPLES, View};
use world::World;

/// A pair with its ground truth.
#[derive(Clone, Debug)]
pub struct SceneFrame {
    /// Left image, row-major.
    pub left: Vec<u8>,
    /// Right image, row-major.
    pub right: Vec<u8>,
    /// Ground truth of the left image.
    pub truth: SceneTruth,
}

/// A scene as a source of pairs. The same file and seed give the same bytes.
#[derive(Debug)]
pub struct Scene {
    world: World,
    painter: Painter,
    normal: Normal,
    view: View,
    shades: View,
    shade: Shade,
    mirror: View,
    mirror_depth: [Vec<f32>; 1],
    mirror_seen: [Vec<u32>; 1],
    depth: [Vec<f32>; 4],
    seen: [Vec<u32>; 4],
    light: Vec<f32>,
    /// 1/z of each pixel, while precipitation falls.
    near: Vec<f32>,
    coarse: Coarse,
    period_ns: u64,
}

impl Scene {
    /// Opens a scene by name or path, with settings: `street`, `street?weather=night&seed=7`,
    /// `my/scene.toml`.
    ///
    /// # Errors
    /// When there is no such scene, or it is invalid.
    pub fn open(name: &str) -> Result<Self, SceneError> {
        Self::new(library::load(name)?)
    }

    /// The scene described by a file.
    ///
    /// # Errors
    /// When its cameras do not form a valid rig.
    pub fn new(file: SceneFile) -> Result<Self, SceneError> {
        let (rig, size, height_m) = file.camera.values().map_err(|error| SceneError::File {
            file: file.title.clone(),
            line: None,
            reason: format!("camera: {error}"),
        })?;
        Ok(Self::seen_by(file, rig, size, height_m))
    }

    /// The scene described by a file, with another rig.
    fn seen_by(file: SceneFile, rig: Rig, size: (usize, usize), height_m: f64) -> Self {
        let period_ns = (1e9 / file.fps) as u64;
        let world = World::new(file, rig, size, height_m);
        let style = ground::style(&world.file.road, world.conditions.wet, world.conditions.snow);
        let light = world.conditions.light;
        let row = || vec![0.0; size.0];
        Self {
            painter: Painter { texture: Texture::new(world.file.seed), style, light, to_world: None },
            normal: Normal::default(),
            view: View::default(),
            shades: View::default(),
            shade: Shade::new(size.0),
            mirror: View::default(),
            mirror_depth: [row()],
            mirror_seen: [vec![0; size.0]],
            near: vec![0.0; size.0 * size.1],
            coarse: Coarse::default(),
            depth: std::array::from_fn(|_| row()),
            seen: std::array::from_fn(|_| vec![0; size.0]),
            light: vec![0.0; size.0 * size.1],
            world,
            period_ns,
        }
    }

    /// The same scene at `fps` pairs per second.
    ///
    /// # Panics
    /// When `fps` is not above zero.
    pub fn at_rate(self, fps: f64) -> Self {
        assert!(fps > 0.0);
        Self { period_ns: (1e9 / fps) as u64, ..self }
    }

    /// One-line description of the scene.
    pub fn title(&self) -> &str {
        &self.world.file.title
    }

    /// Time of pair `index`, in seconds from the start.
    pub fn time_s(&self, index: u64) -> f64 {
        let time = index as f64 * self.period_ns as f64 * 1e-9;
        if self.world.file.repeats { time.rem_euclid(self.world.file.seconds) } else { time }
    }

    fn camera(&self, right: bool) -> Camera {
        let rig = self.world.rig;
        Camera { rig, size: self.world.size, x_m: if right { rig.baseline_m } else { 0.0 }, pitch_rad: 0.0 }
    }

    /// Renders one image of the current state of the world.
    fn draw(&mut self, index: u64, right: bool, grey: &mut [u8]) {
        let turned = self.world.file.camera.right_pitch_deg.as_ref().filter(|_| right);
        // The ground truth stays that of the rectified pair.
        let pitch_rad = turned.map_or(0.0, |line| line.value(self.time_s(index)).to_radians());
        let camera = Camera { pitch_rad, ..self.camera(right) };
        let (width, height) = camera.size;
        let world = &self.world;
        self.painter.light = world.light;
        self.painter.to_world =
            world.to_world(self.time_s(index)).map(|axes| axes.map(|axis| axis.map(|v| v as f32)));
        self.view.project(&camera, &world.surfaces);
        self.shades.project(&camera, &world.shades);
        let wet = world.is_wet();
        if wet {
            self.mirror.project(&camera, &world.mirrors);
        }
        for y in 0..height {
            self.view.row(&camera, y, &SAMPLES, &mut self.depth, &mut self.seen);
            self.shade.row(&camera, &mut self.shades, &world.shades, y, &self.depth[0]);
            if wet {
                self.mirror.row(&camera, y, &MIDDLE, &mut self.mirror_depth, &mut self.mirror_seen);
            }
            let mirror = wet.then_some(Mirror {
                view: &self.mirror,
                surfaces: &world.mirrors,
                seen: &self.mirror_seen[0],
            });
            let row = Row {
                camera: &camera,
                view: &self.view,
                surfaces: &world.surfaces,
                shade: &self.shade,
                mirror,
                y,
            };
            self.painter.row(&row, &self.seen, &mut self.light[y * width..(y + 1) * width]);
            self.near[y * width..(y + 1) * width].copy_from_slice(&self.depth[0]);
        }
        let conditions = &world.conditions;
        let scene_seed = hash(world.file.seed ^ 0x5eed);
        if let Some(falls) = conditions.precipitation {
            // Both cameras see the same drops.
            let speed = world.file.ego.speed_m_s.value(self.time_s(index));
            falls.draw(&camera, hash(scene_seed ^ index << 8), speed, &mut self.light, &self.near);
        }
        // Each camera has a lens of its own.
        let lens_seed = hash(scene_seed ^ 0x1e45 ^ u64::from(right));
        let lens = lens::Lens { glare: world.glare, ..conditions.lens };
        lens.apply(&camera, lens_seed, index, &mut self.light, &mut self.coarse);
        let seed = hash(world.file.seed ^ index << 1 ^ u64::from(right));
        let sensor = conditions.sensors[usize::from(right)];
        sensor.expose(&self.normal, seed, &self.light, grey);
    }

    /// Pair `index` with its ground truth.
    pub fn frame(&mut self, index: u64) -> SceneFrame {
        let pixels = self.world.size.0 * self.world.size.1;
        let (mut left, mut right) = (vec![0; pixels], vec![0; pixels]);
        self.draw_pair(index, &mut left, &mut right);
        SceneFrame { left, right, truth: self.survey(index) }
    }

    fn draw_pair(&mut self, index: u64, left: &mut [u8], right: &mut [u8]) {
        self.world.place(self.time_s(index));
        self.draw(index, false, left);
        self.draw(index, true, right);
    }

    /// The object that the scene approaches: the nearest named one that is in the vehicle's path at the start, seen or not,
    /// other than a bridge.
    pub fn target(&mut self) -> Option<u16> {
        self.world.place(0.0);
        self.world.target(0.0)
    }

    /// Ground truth of pair `index`, without rendering it.
    pub fn truth(&mut self, index: u64) -> SceneTruth {
        self.world.place(self.time_s(index));
        self.survey(index)
    }
}

impl PairSource for Scene {
    fn size(&self) -> (usize, usize) {
        self.world.size
    }

    fn rig(&self) -> Option<Rig> {
        Some(self.world.rig)
    }

    fn geometry(&self) -> Geometry {
        Geometry::Rectified
    }

    fn count(&self) -> Option<u64> {
        let frames = (self.world.file.seconds * 1e9 / self.period_ns as f64).round() as u64;
        (!self.world.file.repeats).then_some(frames.max(1))
    }

    fn period_ns(&self) -> u64 {
        self.period_ns
    }

    fn read(&mut self, index: u64, left: &mut [u8], right: &mut [u8]) -> Result<(), SourceError> {
        if let Some(count) = self.count().filter(|&count| index >= count) {
            return Err(SourceError::End { index, count });
        }
        self.draw_pair(index, left, right);
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use truth::{FIRST_OBJECT, ROAD};

    /// Mean grey error, and share of errors above 12 levels, of the right image warped to the left one by the
    /// true disparity, over pixels visible in both images.
    pub fn warp_error(frame: &SceneFrame, gain: f64, offset: f64) -> (f64, f64, usize) {
        let truth = &frame.truth;
        let (mut sum, mut large, mut count) = (0.0, 0, 0);
        for y in 0..truth.height {
            for x in 0..truth.width {
                let i = y * truth.width + x;
                let at = x as f64 - f64::from(truth.disparity_px[i]);
                if !truth.in_both[i] || at < 1.0 || at + 3.0 > truth.width as f64 {
                    continue;
                }
                // Cubic interpolation: linear interpolation would blur sharp detail.
                let (k, t) = (at.floor() as usize, at - at.floor());
                let value = |n: usize| f64::from(frame.right[y * truth.width + k + n - 1]);
                let (a, b, c, d) = (value(0), value(1), value(2), value(3));
                let right = b + 0.5
                    * t
                    * (c - a + t * (2.0 * a - 5.0 * b + 4.0 * c - d + t * (3.0 * (b - c) + d - a)));
                let error = ((right - offset) / gain - f64::from(frame.left[i])).abs();
                sum += error;
                large += usize::from(error > 12.0);
                count += 1;
            }
        }
        (sum / count as f64, large as f64 / count as f64, count)
    }

    #[test]
    fn the_true_disparity_brings_the_right_image_to_the_left() {
        for (name, index) in [("street", 60), ("bend", 30), ("crest", 25), ("roll", 13), ("car-rear", 50)] {
            let mut scene = Scene::open(name).unwrap();
            let quiet = sensor::Sensor { gain: 1.0, offset: 0.0, noise: 0.0, shot_noise: 0.0 };
            scene.world.conditions.sensors = [quiet; 2];
            let frame = scene.frame(index);
            let (mean, large, count) = warp_error(&frame, 1.0, 0.0);
            println!("{name}: {mean:.3} levels, {:.2} % above 12, of {count}", 100.0 * large);
            assert!(count > 200_000, "{name}: {count}");
            assert!(mean < 1.2, "{name}: {mean}");
            assert!(large < 0.015, "{name}: {large}");
            // The comparison is sensitive: half a pixel off is much worse.
            let mut wrong = frame.clone();
            wrong.truth.disparity_px.iter_mut().for_each(|d| *d += 0.5);
            assert!(warp_error(&wrong, 1.0, 0.0).0 > 1.6 * mean, "{name}");
        }
    }

    #[test]
    fn a_turned_right_camera_shows_the_same_scene_in_other_rows() {
        let open = |pitch_deg: f64| {
            let mut file = library::load("street?weather=overcast").unwrap();
            file.camera.right_pitch_deg = motion::Waypoints::new(vec![(0.0, 0.0), (1.0, pitch_deg)]);
            Scene::new(file).unwrap()
        };
        let (mut still, mut turned) = (open(0.0), open(0.2));
        let (first, moved) = (still.frame(0), turned.frame(0));
        assert!(first.left == moved.left && first.right == moved.right && first.truth == moved.truth);
        let (still, turned) = (still.frame(60), turned.frame(60));
        assert!(still.left == turned.left && still.truth == turned.truth);
        // 879 px · tan 0.2° = 3.07 px: pitching down moves the image up.
        let difference = |rows: usize| {
            let (mut sum, mut count) = (0.0, 0);
            for y in 120..320 {
                for x in 200..440 {
                    sum += f64::from(still.right[y * 640 + x].abs_diff(turned.right[(y - rows) * 640 + x]));
                    count += 1;
                }
            }
            sum / f64::from(count)
        };
        let found = (0..8).min_by(|a, b| difference(*a).total_cmp(&difference(*b))).unwrap();
        println!("{} levels, unmoved {}", difference(found), difference(0));
        assert_eq!(found, 3);
        assert!(difference(3) < 0.5 * difference(0), "{} {}", difference(3), difference(0));
    }

    #[test]
    fn boxes_and_distances_are_those_of_the_pin_hole() {
        let mut scene = Scene::open("car-rear").unwrap();
        let rig = scene.rig().unwrap();
        for index in [0, 20, 40, 60] {
            let truth = scene.truth(index);
            let z = 30.0 - 5.0 * truth.time_s;
            let car = truth.objects.iter().find(|o| o.subject).expect("the car");
            assert!((car.distance_m - z).abs() < 0.01, "{} {z}", car.distance_m);
            assert!((car.closing_m_s - 5.0).abs() < 1e-6 && car.in_path && car.visible > 0.999);
            let width_px = rig.focal_px * car.width_m / z;
            assert!(
                (f64::from(car.bounds.width) - width_px).abs() < 2.5 + 0.02 * width_px,
                "{car:?} {width_px}"
            );
            // Its tyres stand on the road.
            let foot = rig.cy_px + rig.focal_px * 1.25 / (z + 0.55);
            let bottom = f64::from(car.bounds.y + car.bounds.height);
            assert!((bottom - foot).abs() < 3.0 + 0.03 * (foot - rig.cy_px), "{bottom} {foot}");
            let middle = (car.bounds.y + car.bounds.height / 2) as usize * truth.width + 320;
            assert_eq!(truth.owner[middle], car.id);
            assert!((f64::from(truth.disparity_px[middle]) - rig.disparity_px(z)).abs() < 0.03);
        }
    }

    #[test]
    fn the_road_in_the_picture_has_the_height_of_its_profile() {
        for name in ["crest", "dip", "slope", "car-rear"] {
            let mut scene = Scene::open(name).unwrap();
            let (rig, truth) = (scene.rig().unwrap(), scene.truth(25));
            let mut compared = 0;
            for (y, &d) in truth.road.rows_px.iter().enumerate() {
                if d <= 0.0 || rig.distance_m(d.into()) > 100.0 {
                    continue;
                }
                let z = rig.distance_m(d.into());
                let height = 1.25 - (y as f64 - rig.cy_px) * z / rig.focal_px;
                let expected = truth.road.height_m(z);
                assert!((height - expected).abs() < 0.005, "{name}: {z} m: {height} {expected}");
                compared += 1;
            }
            assert!(compared > 150, "{name}: {compared}");
            let roads = truth.owner.iter().filter(|&&o| o == ROAD).count();
            assert!(roads > 50_000, "{name}: {roads}");
        }
    }

    #[test]
    fn every_scene_is_drawn_and_the_same_twice() {
        for (name, _) in library::SCENES {
            let (mut a, mut b) = (Scene::open(name).unwrap(), Scene::open(name).unwrap());
            let last = a.count().unwrap_or(100) - 1;
            let first = a.frame(0);
            let frame = a.frame(last);
            let again = b.frame(last);
            assert!(
                frame.left == again.left && frame.right == again.right && frame.truth == again.truth,
                "{name}"
            );
            assert!(first.left != frame.left, "{name} is static");
            let mean = frame.left.iter().map(|&v| f64::from(v)).sum::<f64>() / frame.left.len() as f64;
            assert!((15.0..235.0).contains(&mean), "{name}: mean grey {mean}");
            let subjects = frame.truth.objects.iter().filter(|o| o.subject);
            assert!(subjects.clone().all(|o| o.id >= FIRST_OBJECT && o.pixels > 0), "{name}");
            if a.count().is_some() {
                let (mut left, mut right) = (frame.left, frame.right);
                assert!(a.read(last + 1, &mut left, &mut right).is_err(), "{name} has an end");
            }
        }
    }

    #[test]
    fn weather_changes_the_pictures_and_not_the_truth() {
        let open = |weather: &str| Scene::open(&format!("street?weather={weather}")).unwrap();
        let sunny = open("sunny").frame(60);
        for weather in file::Weather::ALL.iter().skip(1).map(|weather| weather.name()) {
            let frame = open(weather).frame(60);
            assert!(frame.truth == sunny.truth, "{weather}");
            let again = open(weather).frame(60);
            assert!(frame.left == again.left && frame.right == again.right, "{weather}");
            let off = |a: &[u8], b: &[u8]| {
                a.iter().zip(b).map(|(a, b)| f64::from(a.abs_diff(*b))).sum::<f64>() / a.len() as f64
            };
            assert!(off(&frame.left, &sunny.left) > 8.0, "{weather}");
            // Larger errors than in sunlight, but still the same street in both images.
            let (mean, large, _) = warp_error(&frame, 1.04, 1.5);
            println!("{weather}: {mean:.2} levels, {:.1} % above 12", 100.0 * large);
            assert!(mean > warp_error(&sunny, 1.04, 1.5).0 && mean < 9.0, "{weather}: {mean}");
        }
    }

    #[test]
    fn a_wet_road_mirrors_with_the_disparity_of_what_is_mirrored() {
        let quiet = sensor::Sensor { gain: 1.0, offset: 0.0, noise: 0.0, shot_noise: 0.0 };
        let frames = [0.0, 1.0].map(|wet| {
            let mut file = library::load("car-rear?weather=overcast").unwrap();
            file.road.wet = wet;
            file.road.texture = 0.0;
            let mut scene = Scene::new(file).unwrap();
            scene.world.conditions.sensors = [quiet; 2];
            scene.frame(40)
        });
        // The reflection of the number plate below the car: what the wet road adds there must match at the car's
        // disparity, not at the road's.
        let rig = file::NamedRig::Paper.values().0;
        let truth = &frames[1].truth;
        let car = truth.objects.iter().find(|o| o.subject).unwrap();
        let d = rig.disparity_px(car.distance_m).round() as usize;
        let added = |wet: &[u8], dry: &[u8]| -> Vec<f64> {
            wet.iter().zip(dry).map(|(wet, dry)| f64::from(*wet) - f64::from(*dry)).collect()
        };
        let left = added(&frames[1].left, &frames[0].left);
        let right = added(&frames[1].right, &frames[0].right);
        let foot = (car.bounds.y + car.bounds.height) as usize;
        let difference = |shift: usize| -> f64 {
            let mut sum = 0.0;
            for y in foot + 30..foot + 70 {
                for x in 285..355 {
                    sum += (left[y * truth.width + x] - right[y * truth.width + x - shift]).abs();
                }
            }
            sum
        };
        let best = (2..30).min_by(|a, b| difference(*a).total_cmp(&difference(*b))).unwrap();
        let road = truth.disparity_px[(foot + 50) * truth.width + 320];
        println!("mirror at {best} px, car at {d} px, road at {road} px");
        assert!(best.abs_diff(d) <= 1, "{best} {d}");
        assert!(f64::from(road) > d as f64 + 2.0, "{road}");
    }

    #[test]
    fn the_kitti_rig_sees_the_same_street() {
        let mut scene = Scene::open("street?rig=kitti").unwrap();
        assert_eq!(scene.size(), (1242, 375));
        let truth = scene.truth(60);
        let mut near = Scene::open("street").unwrap();
        let distances =
            |t: &SceneTruth| t.objects.iter().filter(|o| o.subject && o.in_path).map(|o| o.distance_m).next();
        let (a, b) = (distances(&truth).unwrap(), distances(&near.truth(60)).unwrap());
        assert!((a - b).abs() < 0.02, "{a} {b}");
    }
}
