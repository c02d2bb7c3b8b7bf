//! Scene detection: road, obstacle regions and free space from one disparity map ([`crate::road`],
//! [`crate::detection`], [`crate::free_space`]; paper, section 3.5).
//!
//! Input: a [`DepthView`] (disparity in 1/256 px, confidence, optionally the rectified images). Output: a
//! [`Scene`] with the road model, the road's disparity in each row (px), obstacle [`Region`]s (px and
//! metres), free space, boundaries and road edges (metres).
//!
//! ```
//! use lookout_perception::depth::DepthView;
//! use lookout_perception::rig::Rig;
//! use lookout_perception::scene::{SceneDetector, SceneParameters};
//! use lookout_perception::stereo::DisparityView;
//!
//! let (width, height) = (320, 240);
//! let rig = Rig { focal_px: 500.0, baseline_m: 0.3, cx_px: 160.0, cy_px: 100.0 };
//! let camera_height_m = 1.5;
//!
//! // Disparity map in 1/256 px: a flat road and a box, 1.8 m wide and 1.5 m high, at 12 m.
//! let mut map = vec![0_u16; width * height];
//! for (i, disparity) in map.iter_mut().enumerate() {
//!     let (x, y) = ((i % width) as f64, (i / width) as f64);
//!     let road_px = rig.baseline_m / camera_height_m * (y - rig.cy_px);
//!     let height_m = camera_height_m - (y - rig.cy_px) * 12.0 / rig.focal_px;
//!     let in_box = rig.lateral_m(x, 12.0).abs() <= 0.9 && (0.0..=1.5).contains(&height_m);
//!     let disparity_px = if in_box { rig.disparity_px(12.0) } else { road_px.max(0.0) };
//!     *disparity = (256.0 * disparity_px) as u16;
//! }
//! let confidence = vec![255; map.len()];
//! let disparity = DisparityView::new(&map, width, height).expect("one disparity per pixel");
//! let depth = DepthView::new(disparity, &confidence).expect("one confidence per pixel");
//!
//! let mut detector = SceneDetector::new(SceneParameters::default(), rig, width, height, 64);
//! let scene = detector.detect(depth);
//!
//! let road = scene.road.expect("a visible road");
//! assert!((road.camera_height_m - camera_height_m).abs() < 0.15);
//! assert_eq!(scene.regions.len(), 1);
//! assert!((scene.regions[0].distance_m - 12.0).abs() < 0.4);
//! ```

use crate::alarm::AlarmParameters;
use crate::depth::DepthView;
use crate::detection::photometric::Verifier;
use crate::detection::stixel_use::StixelUse;
use crate::detection::stixels::Stixels;
use crate::detection::{ObstacleDetector, RegionParameters};
use crate::free_space::FreeSpaceFinder;
use crate::free_space::boundary::{BeforeWall, Boundary, Side};
use crate::free_space::corridor::Corridor;
use crate::free_space::limits::{LOW_HEIGHT_M, MAX_BEHIND_M, TOP_STEP_M};
use crate::free_space::road_view::RoadView;
use crate::free_space::sectors::FreeSector;
use crate::motion::planar::{Planar, PlanarStep};
use crate::region::Region;
use crate::rig::Rig;
use crate::road::edges::Edges;
use crate::road::histogram::VDisparity;
use crate::road::surface::RoadSurface;
use crate::road::{RoadEstimator, RoadModel, RoadParameters};

/// Places on each stretch of an outline that are compared with the own path: a thing of 12 m does not reach across it unseen.
const PATH_STEPS: u8 = 8;

/// Parameters of the road model and of obstacle detection.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SceneParameters {
    /// Road model.
    pub road: RoadParameters,
    /// Obstacle regions.
    pub regions: RegionParameters,
    /// Width of the own path, in metres: what stands in it is an obstacle even where it is part of a boundary.
    pub path_width_m: f64,
}

impl Default for SceneParameters {
    fn default() -> Self {
        Self {
            road: RoadParameters::default(),
            regions: RegionParameters::default(),
            path_width_m: AlarmParameters::default().path_width_m,
        }
    }
}

/// Road and obstacles of one disparity map.
#[derive(Debug)]
pub struct Scene<'a> {
    /// Road model; `None` if no road is visible, in which case there are no regions either.
    pub road: Option<RoadModel>,
    /// Disparity of the road in each row, in px; 0 above the road.
    pub profile_px: &'a [f32],
    /// Sightings of obstacles in this map, nearest first; see [`crate::detection`].
    pub regions: &'a [Region],
    /// How far the ground is known to be free, by direction from left to right.
    pub free: &'a [FreeSector],
    /// Left and right edges of the road.
    pub edges: &'a Edges,
    /// Looks for a region in both pictures of this map; `None` without pictures or road.
    pub verifier: Option<Verifier<'a>>,
    /// Boundaries beside the path, nearest first.
    pub boundaries: &'a [Boundary],
    /// The own path.
    pub corridor: Corridor,
}

impl Scene<'_> {
    /// How a thing of this height, with this outline on the ground in metres right and ahead, stands before the wall beside the
    /// path of which it may be a part, or before one that leads obliquely across it. `None` where there is none that is higher than
    /// vehicles and people and goes on behind all of the thing, where the thing ends below its top, and behind it.
    pub fn before_wall(&self, outline_m: &[Planar], height_m: f64) -> Option<BeforeWall> {
        let is_in_path = |pair: &[Planar]| {
            let between = |share: f64| [0, 1].map(|i| pair[0][i] + share * (pair[1][i] - pair[0][i]));
            (0..=PATH_STEPS).any(|k| self.corridor.contains(between(f64::from(k) / f64::from(PATH_STEPS))))
        };
        if height_m < LOW_HEIGHT_M {
            return None;
        }
        let is_in_path = outline_m.windows(2).any(is_in_path);
        let walls = self.boundaries.iter().filter_map(|boundary| {
            let is_across = boundary.side == Side::Across;
            let first = boundary.before_m(*outline_m.first()?)?;
            let [nearest, farthest] =
                outline_m.iter().try_fold([first; 2], |[nearest, farthest], place| {
                    let here = boundary.before_m(*place)?;
                    Some([
                        if here.0 < nearest.0 { here } else { nearest },
                        if here.0 > farthest.0 { here } else { farthest },
                    ])
                })?;
            let wall_m = farthest.1.height_m;
            let is_as_high = wall_m >= LOW_HEIGHT_M && height_m >= wall_m - TOP_STEP_M;
            let goes_on = !is_across || nearest.1.is_oblique;
            (is_as_high && goes_on && farthest.0 >= -MAX_BEHIND_M).then_some(BeforeWall {
                reach_m: farthest.0,
                nearest_m: nearest.0,
                is_in_path: is_in_path || is_across,
            })
        });
        walls.min_by(|a, b| a.reach_m.total_cmp(&b.reach_m))
    }
}

/// Detects road and obstacle regions in disparity maps of one size; memory is allocated once.
#[derive(Debug)]
pub struct SceneDetector {
    road: RoadEstimator,
    obstacles: ObstacleDetector,
    free_space: FreeSpaceFinder,
    /// Own motion and seconds since the last map.
    step: Option<PlanarStep>,
    elapsed_s: f64,
}

impl SceneDetector {
    /// A detector for maps of `width` × `height` with disparities below `disparities` px.
    pub fn new(
        parameters: SceneParameters,
        rig: Rig,
        width: usize,
        height: usize,
        disparities: usize,
    ) -> Self {
        let obstacles = ObstacleDetector::new(parameters.regions, rig, width, height, disparities);
        let path_width_m = parameters.path_width_m;
        let (regions, stixels) = (&parameters.regions, obstacles.stixels());
        Self {
            free_space: FreeSpaceFinder::new(rig, path_width_m, regions, stixels),
            step: None,
            elapsed_s: 0.0,
            road: RoadEstimator::new(parameters.road, rig, width, height, disparities),
            obstacles,
        }
    }

    /// v-disparity histogram of the last map.
    pub fn v_disparity(&self) -> &VDisparity {
        self.road.v_disparity()
    }

    /// The stixels of the last map, and what each of them was used for.
    pub fn stixels(&self) -> &Stixels {
        self.obstacles.stixels()
    }

    /// What each stixel of the last map was used for; empty if no road was visible.
    pub fn uses(&self) -> &[StixelUse] {
        self.free_space.uses()
    }

    /// The road surface of the last map with a visible road.
    pub fn surface(&self) -> &RoadSurface {
        self.road.surface()
    }

    /// Forgets what was seen before, as after a gap or a step back in time ([`crate::frame_clock`]): boundaries and ground. The
    /// road is estimated, and obstacles are sighted, in each map anew.
    pub fn reset(&mut self) {
        self.free_space.reset();
    }

    /// Sets the displacement of the camera from the last map to the next one, by which what is remembered is moved; `None` if
    /// it is unknown. Call it before each [`Self::detect`]: it holds for one map.
    pub fn set_own_motion(&mut self, step: Option<PlanarStep>) {
        self.step = step;
    }

    /// Sets the time since the last map, in seconds, by which what is remembered ages. Call it before each
    /// [`Self::detect`]; it holds until it is set anew.
    pub fn set_elapsed_s(&mut self, elapsed_s: f64) {
        self.elapsed_s = elapsed_s;
    }

    /// Sets the distance up to which obstacles are sighted, in metres ([`crate::range`]).
    pub fn set_range_m(&mut self, range_m: f64) {
        self.obstacles.set_range_m(range_m);
    }

    /// Detects the road in a map, then the obstacles on it.
    ///
    /// # Panics
    /// When the size of the map differs from that of the detector.
    pub fn detect<'a>(&'a mut self, depth: DepthView<'a>) -> Scene<'a> {
        let step = self.step.take();
        let Some(model) = self.road.estimate(depth) else {
            self.free_space.reset();
            let profile_px = self.road.profile().disparity_px();
            let (free, edges) = (self.free_space.sectors(), self.road.edges());
            return Scene {
                road: None,
                profile_px,
                regions: &[],
                free,
                edges,
                boundaries: &[],
                corridor: self.free_space.corridor(),
                verifier: None,
            };
        };
        let (profile, surface, edges) = (self.road.profile(), self.road.surface(), self.road.edges());
        let road = RoadView { surface, profile_px: profile.disparity_px(), top: profile.top(), edges };
        self.free_space.classify(self.obstacles.find_stixels(depth, surface), road, step, self.elapsed_s);
        self.obstacles.detect(depth, profile, surface, self.free_space.uses());
        let (regions, verifier) =
            (self.obstacles.regions(), self.obstacles.verifier(depth, profile, surface));
        self.free_space.update(self.obstacles.stixels(), road, regions);
        let (free, boundaries) = (self.free_space.sectors(), self.free_space.boundaries());
        let profile_px = profile.disparity_px();
        let corridor = self.free_space.corridor();
        Scene { road: Some(model), profile_px, regions, free, edges, boundaries, corridor, verifier }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::stereo::DisparityView;

    const RIG: Rig = Rig { focal_px: 500.0, baseline_m: 0.3, cx_px: 160.0, cy_px: 100.0 };
    const CAMERA_HEIGHT_M: f64 = 1.5;

    /// Disparity map of a flat road with boxes: left and right side, height and distance in metres.
    fn map(boxes: &[(f64, f64, f64, f64)], roll: f64) -> Vec<u16> {
        let (width, height) = (320, 240);
        let mut random = fastrand::Rng::with_seed(8);
        let mut out = vec![0_u16; width * height];
        for y in 0..height {
            for x in 0..width {
                let road = RIG.baseline_m / CAMERA_HEIGHT_M * (y as f64 - RIG.cy_px);
                let mut d = road + roll * (x as f64 - RIG.cx_px);
                for &(left, right, tall, distance) in boxes {
                    let across = RIG.lateral_m(x as f64, distance);
                    let up = CAMERA_HEIGHT_M - (y as f64 - RIG.cy_px) * distance / RIG.focal_px;
                    if across >= left && across <= right && (0.0..=tall).contains(&up) {
                        d = d.max(RIG.disparity_px(distance));
                    }
                }
                let noise = f64::from(random.f32()) * 0.3 - 0.15;
                if d > 0.3 {
                    out[y * width + x] = ((d + noise) * 256.0) as u16;
                }
            }
        }
        out
    }

    /// A map with full confidence.
    fn full_confidence(map: &[u16]) -> DepthView<'_> {
        DepthView::new(DisparityView::new(map, 320, 240).unwrap(), &[255; 320 * 240]).unwrap()
    }

    fn detector() -> SceneDetector {
        SceneDetector::new(SceneParameters::default(), RIG, 320, 240, 64)
    }

    #[test]
    fn a_car_and_a_post_are_detected_at_their_distance() {
        let boxes = [(-0.9, 0.9, 1.5, 12.0), (2.0, 2.4, 1.2, 8.0)];
        let map = map(&boxes, 0.0);
        let mut detector = detector();
        let scene = detector.detect(full_confidence(&map));
        let road = scene.road.expect("the road is visible");
        assert!((road.camera_height_m - CAMERA_HEIGHT_M).abs() < 0.15, "{road:?}");
        assert!(road.confidence > 0.8, "{road:?}");
        assert_eq!(scene.regions.len(), 2, "{:?}", scene.regions);
        // Nearest first.
        for (region, (left, right, tall, distance)) in scene.regions.iter().zip([boxes[1], boxes[0]]) {
            assert!((region.distance_m - distance).abs() < 0.03 * distance, "{region:?}");
            assert!((region.lateral_m - (left + right) / 2.0).abs() < 0.2, "{region:?}");
            assert!((region.width_m - (right - left)).abs() < 0.3, "{region:?}");
            assert!((region.height_m - tall).abs() < 0.3, "{region:?}");
        }
    }

    #[test]
    fn what_noise_does_not_tell_apart_is_one_region_and_nothing_beyond_the_range_is_one() {
        // Both halves of a car's rear, a quarter of a px apart: that is more than a car is deep there.
        let map = map(&[(-0.9, 0.0, 1.5, 48.0), (0.0, 0.9, 1.5, 52.8)], 0.0);
        let mut detector = detector();
        let [car] = detector.detect(full_confidence(&map)).regions else { panic!("not one region") };
        assert!((car.width_m - 1.8).abs() < 0.5, "{car:?}");
        detector.set_range_m(45.0);
        assert_eq!(detector.detect(full_confidence(&map)).regions, []);
        detector.set_range_m(60.0);
        assert_eq!(detector.detect(full_confidence(&map)).regions.len(), 1);
    }

    #[test]
    fn front_and_side_of_a_near_car_are_one_region() {
        // The front of a car at 5.5 m and its side along the road up to 7.4 m.
        let mut map = map(&[(-1.9, -1.6, 1.4, 5.5)], 0.0);
        for x in 0..320 {
            // Intersection of the ray with the plane 1.6 m left of the camera.
            let distance = -1.6 * RIG.focal_px / (x as f64 - RIG.cx_px);
            if !(5.5..7.4).contains(&distance) {
                continue;
            }
            for y in 0..240 {
                let up = CAMERA_HEIGHT_M - (y as f64 - RIG.cy_px) * distance / RIG.focal_px;
                if (0.0..=1.4).contains(&up) {
                    map[y * 320 + x] = (RIG.disparity_px(distance) * 256.0) as u16;
                }
            }
        }
        let mut detector = detector();
        let scene = detector.detect(full_confidence(&map));
        let [car] = scene.regions else { panic!("{:?}", scene.regions) };
        let side_end = RIG.cx_px - 1.6 * RIG.focal_px / 7.4;
        assert!(f64::from(car.bounds.x + car.bounds.width) > side_end - 8.0, "{car:?}");
        assert!((car.distance_m - 5.5).abs() < 0.3, "{car:?}");
    }

    #[test]
    fn an_empty_road_has_no_regions_under_camera_roll() {
        for roll in [0.0, 0.006, -0.006, 0.012, -0.012] {
            let map = map(&[], roll);
            let mut detector = detector();
            let scene = detector.detect(full_confidence(&map));
            let road = scene.road.expect("the road is visible");
            assert!((road.roll - roll).abs() < 0.001, "{road:?}");
            assert!(scene.regions.is_empty(), "roll {roll}: {:?}", scene.regions);
        }
    }

    #[test]
    fn heights_at_both_edges_are_correct_under_camera_roll() {
        let boxes = [(-2.6, -1.6, 1.5, 10.0), (1.6, 2.6, 1.5, 10.0)];
        for roll in [0.01, -0.01] {
            let map = map(&boxes, roll);
            let mut detector = detector();
            let scene = detector.detect(full_confidence(&map));
            assert_eq!(scene.regions.len(), 2, "roll {roll}: {:?}", scene.regions);
            for region in scene.regions {
                assert!((region.height_m - 1.5).abs() < 0.35, "roll {roll}: {region:?}");
                assert!((region.distance_m - 10.0).abs() < 0.5, "roll {roll}: {region:?}");
            }
        }
    }

    #[test]
    fn an_unknown_or_implausible_map_has_no_road() {
        let mut detector = detector();
        let scene = detector.detect(full_confidence(&[0; 320 * 240]));
        assert!(scene.road.is_none() && scene.regions.is_empty());
        // A wall that fills the view is no road either, and must not cause a panic.
        let scene = detector.detect(full_confidence(&[10 * 256; 320 * 240]));
        assert!(scene.road.is_none_or(|road| road.confidence < 0.6));
        let scene = detector.detect(full_confidence(&[u16::MAX; 320 * 240]));
        assert!(scene.regions.is_empty());
    }
}
