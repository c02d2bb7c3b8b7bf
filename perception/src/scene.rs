//! Scene detection: road and obstacle regions from one disparity map ([`crate::road`], then
//! [`crate::detection`]; paper, section 3.5).
//!
//! Input: a [`DepthView`] (disparity in 1/256 px, confidence, optionally the rectified images). Output: a
//! [`Scene`] with the road model, the road's disparity in each row (px), obstacle [`Region`]s (px and
//! metres), free distances (metres) and road edges (metres).
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

use crate::depth::DepthView;
use crate::detection::photometric::Verifier;
use crate::detection::{ObstacleDetector, RegionParameters};
use crate::region::Region;
use crate::rig::Rig;
use crate::road::edges::Edges;
use crate::road::free_space::FreeSpace;
use crate::road::histogram::VDisparity;
use crate::road::{RoadEstimator, RoadModel, RoadParameters};

/// Parameters of the road model and of obstacle detection.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SceneParameters {
    /// Road model.
    pub road: RoadParameters,
    /// Obstacle regions.
    pub regions: RegionParameters,
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
    /// Free distance ahead in metres for each group of [`crate::road::free_space::COLUMNS`] columns; 0
    /// without a road.
    pub free_m: &'a [f32],
    /// Left and right edges of the road.
    pub edges: &'a Edges,
    /// Looks for a region in both pictures of this map; `None` without pictures or road.
    pub verifier: Option<Verifier<'a>>,
}

/// Detects road and obstacle regions in disparity maps of one size; memory is allocated once.
#[derive(Debug)]
pub struct SceneDetector {
    rig: Rig,
    max_distance_m: f64,
    road: RoadEstimator,
    obstacles: ObstacleDetector,
    free_space: FreeSpace,
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
        Self {
            max_distance_m: parameters.regions.max_distance_m,
            road: RoadEstimator::new(parameters.road, rig, width, height, disparities),
            obstacles: ObstacleDetector::new(parameters.regions, rig, width, height, disparities),
            free_space: FreeSpace::new(width),
            rig,
        }
    }

    /// v-disparity histogram of the last map.
    pub fn v_disparity(&self) -> &VDisparity {
        self.road.v_disparity()
    }

    /// Detects the road in a map, then the obstacles on it.
    ///
    /// # Panics
    /// When the size of the map differs from that of the detector.
    pub fn detect<'a>(&'a mut self, depth: DepthView<'a>) -> Scene<'a> {
        let Some(model) = self.road.estimate(depth) else {
            self.free_space.clear();
            let profile_px = self.road.profile().disparity_px();
            let (free_m, edges) = (self.free_space.free_m(), self.road.edges());
            return Scene { road: None, profile_px, regions: &[], free_m, edges, verifier: None };
        };
        let profile = self.road.profile();
        let surface = self.road.surface();
        self.obstacles.detect(depth, profile, surface);
        let (regions, verifier) =
            (self.obstacles.regions(), self.obstacles.verifier(depth, profile, surface));
        let profile_px = profile.disparity_px();
        let farthest_px = profile_px.get(profile.top()).copied().unwrap_or(0.0);
        let min_px = self.rig.disparity_px(self.max_distance_m);
        let visible_m = self.rig.distance_m(f64::from(farthest_px).max(min_px));
        let likely = regions.iter().filter(|region| region.evidence > 0.0);
        self.free_space.update(likely, visible_m);
        let (free_m, edges) = (self.free_space.free_m(), self.road.edges());
        Scene { road: Some(model), profile_px, regions, free_m, edges, verifier }
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
