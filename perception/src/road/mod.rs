//! From disparity to the road, and to what stands on it (paper, section 3.5).

pub mod confirm;
pub mod consistency;
pub mod depth;
pub mod edges;
pub mod free_space;
pub mod heights;
pub mod histogram;
pub mod line_fit;
pub mod plane;
pub mod profile;
pub mod radon;
pub mod regions;
pub mod residual;
pub mod samples;
pub mod small;
pub mod stixels;
pub mod straight;
pub mod surface;
pub mod viterbi;

use crate::rig::Rig;
use consistency::Witness;
pub use depth::DepthView;
use edges::{EdgeFinder, Edges};
use free_space::FreeSpace;
use histogram::{Corridor, VDisparity};
use profile::ProfileFinder;
pub use profile::Shape;
use radon::{Radon, RadonRange, RoadLine};
use regions::RegionFinder;
pub use regions::{PixelBox, Region, RegionParameters};
use residual::Ground;
use small::SmallFinder;
use stixels::{StixelParameters, Stixels};
use surface::Surface;

/// Pixels of less confidence (0 to 255) tell nothing of the road, and nothing of what stands on it.
const ROAD_CONFIDENCE: u8 = 100;
const REGION_CONFIDENCE: u8 = 100;

/// The road is sought within so many metres to either side of the camera.
const CORRIDOR_M: f64 = 5.0;

/// No side of a thing passes the camera nearer than this, in metres: what changes faster from column to column
/// than such a side does is a seam between two surfaces.
const SIDE_M: f64 = 0.9;

/// What shapes the road model.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RoadParameters {
    /// Least and greatest height of the camera above the road, in metres.
    pub camera_height_m: (f64, f64),
    /// How far the horizon may lie from the principal row, as a share of the image height.
    pub horizon_share: f64,
    /// A road with less support (0 to 1) is "no road seen".
    pub least_support: f64,
    /// What the road is fitted by.
    pub shape: Shape,
    /// What makes a region.
    pub regions: RegionParameters,
}

impl Default for RoadParameters {
    fn default() -> Self {
        Self {
            camera_height_m: (0.5, 3.0),
            horizon_share: 0.2,
            least_support: 0.25,
            shape: Shape::default(),
            regions: RegionParameters::default(),
        }
    }
}

/// The road as it was seen in one frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RoadModel {
    /// Its straight start.
    pub line: RoadLine,
    /// Disparity that one column to the right adds: roll of the camera, in px per px.
    pub roll: f64,
    /// Share of rows in which the profile is supported, 0 to 1.
    pub confidence: f64,
    /// Height of the camera above the near road, in metres.
    pub camera_height_m: f64,
}

/// What one disparity map shows.
#[derive(Debug)]
pub struct Scene<'a> {
    /// The road; `None` when no road was seen (then there are no regions either).
    pub road: Option<RoadModel>,
    /// Disparity of the road in each row, in pixels, 0 above it.
    pub profile_px: &'a [f32],
    /// What stands on it, nearest first.
    pub regions: &'a [Region],
    /// Metres that are free ahead, for each [`free_space::COLUMNS`] columns; 0 without a road.
    pub free_m: &'a [f32],
    /// Where the road ends to the left and to the right.
    pub edges: &'a Edges,
}

/// Finds the road and the regions in disparity maps of one size, with memory allocated once.
#[derive(Debug)]
pub struct RoadDetector {
    parameters: RoadParameters,
    rig: Rig,
    width: usize,
    height: usize,
    histogram: VDisparity,
    radon: Radon,
    profile: ProfileFinder,
    surface: Surface,
    stixels: Stixels,
    finder: RegionFinder,
    small: SmallFinder,
    regions: Vec<Region>,
    edges: EdgeFinder,
    free_space: FreeSpace,
}

impl RoadDetector {
    /// A detector for maps of `width` × `height` with disparities below `disparities` px.
    pub fn new(
        parameters: RoadParameters,
        rig: Rig,
        width: usize,
        height: usize,
        disparities: usize,
    ) -> Self {
        let histogram = VDisparity::new(width, height, disparities);
        let stixels = Stixels::new(width, height);
        Self {
            radon: Radon::new(histogram.bins(), height),
            profile: ProfileFinder::new(histogram.bins(), height).fitting(parameters.shape),
            finder: RegionFinder::new(parameters.regions, &stixels, disparities),
            small: SmallFinder::new(width, height, parameters.regions.confirm),
            regions: Vec::with_capacity(regions::CAPACITY + small::CAPACITY),
            surface: Surface::new(rig, width, height, disparities),
            edges: EdgeFinder::default(),
            free_space: FreeSpace::new(width),
            histogram,
            stixels,
            parameters,
            rig,
            width,
            height,
        }
    }

    /// The v-disparity histogram of the last map.
    pub fn v_disparity(&self) -> &VDisparity {
        &self.histogram
    }

    /// Finds the road in a map, then what stands on it.
    ///
    /// # Panics
    /// When the map has another size than the detector was made for.
    pub fn detect(&mut self, depth: DepthView<'_>) -> Scene<'_> {
        assert_eq!((depth.width(), depth.height()), (self.width, self.height));
        let corridor = Corridor {
            centre_px: self.rig.cx_px as f32,
            columns_per_px: (CORRIDOR_M / self.rig.baseline_m) as f32,
        };
        self.histogram.fill(depth, ROAD_CONFIDENCE, corridor);
        let cap = (self.width / 24).clamp(4, u16::MAX as usize) as u16;
        let (lowest, highest) = self.parameters.camera_height_m;
        let slack = self.parameters.horizon_share * self.height as f64;
        let range = RadonRange {
            slope: (self.rig.baseline_m / highest, self.rig.baseline_m / lowest),
            horizon_px: (self.rig.cy_px - slack, self.rig.cy_px + slack),
        };
        let line = self.radon.strongest(&self.histogram, range, cap);
        let support =
            line.map_or(0.0, |line| self.profile.find(&self.histogram, depth, line, cap, corridor).support());
        let Some(line) = line.filter(|_| support >= self.parameters.least_support) else {
            self.profile.clear();
            self.free_space.clear();
            self.edges.clear();
            let profile_px = self.profile.profile().disparity_px();
            let (free_m, edges) = (self.free_space.free_m(), self.edges.edges());
            return Scene { road: None, profile_px, regions: &[], free_m, edges };
        };
        let profile = self.profile.profile();
        self.surface.take(profile, depth, ROAD_CONFIDENCE);
        self.edges.take(depth, &self.surface, &self.rig, profile.top(), ROAD_CONFIDENCE);
        let p = &self.parameters.regions;
        let standing = StixelParameters {
            least_height_m: 0.4 * p.least_height_m,
            sigmas: 0.3,
            least_rise_px: 0.2,
            greatest_height_m: p.greatest_height_m,
            least_disparity_px: self.rig.disparity_px(p.greatest_distance_m),
            least_confidence: REGION_CONFIDENCE,
            steepest_px: self.rig.baseline_m / SIDE_M,
        };
        self.stixels.find(depth, &self.surface, &standing);
        let size = (self.width, self.height);
        self.regions.clear();
        let ground = Ground { profile_px: profile.disparity_px(), tilt: self.surface.tilt(), rig: self.rig };
        let witness = depth.pictures().map(|pictures| Witness { pictures, ground, stixels: &self.stixels });
        let found = self.finder.find(&self.stixels, &self.surface, &self.rig, size, witness.as_ref());
        self.regions.extend_from_slice(found);
        if let Some(pictures) = depth.pictures() {
            let small = self.small.find(pictures, &ground, &self.surface, &self.regions);
            self.regions.extend_from_slice(small);
            self.regions.sort_unstable_by(|a, b| b.disparity_px.total_cmp(&a.disparity_px));
            self.regions.truncate(p.greatest_count);
        }
        let regions = &self.regions;
        let road = RoadModel {
            line,
            roll: self.surface.tilt().roll,
            confidence: support,
            camera_height_m: self.rig.baseline_m / line.slope,
        };
        let farthest_px = profile.disparity_px().get(profile.top()).copied().unwrap_or(0.0);
        let least_px = self.rig.disparity_px(p.greatest_distance_m);
        let seen_m = self.rig.distance_m(f64::from(farthest_px).max(least_px));
        self.free_space.take(regions, seen_m);
        let free_m = self.free_space.free_m();
        let edges = self.edges.edges();
        Scene { road: Some(road), profile_px: profile.disparity_px(), regions, free_m, edges }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::stereo::DisparityView;

    const RIG: Rig = Rig { focal_px: 500.0, baseline_m: 0.3, cx_px: 160.0, cy_px: 100.0 };
    const CAMERA_HEIGHT_M: f64 = 1.5;

    /// A map of a flat road with boxes: (left, right) and height in metres, at a distance.
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

    /// A map that is believed everywhere.
    fn certain(map: &[u16]) -> DepthView<'_> {
        DepthView::new(DisparityView::new(map, 320, 240).unwrap(), &[255; 320 * 240]).unwrap()
    }

    /// What is found once a map has been seen a few times.
    fn settled<'a>(detector: &'a mut RoadDetector, map: &[u16]) -> Scene<'a> {
        for _ in 0..3 {
            detector.detect(certain(map));
        }
        detector.detect(certain(map))
    }

    fn detector() -> RoadDetector {
        RoadDetector::new(RoadParameters::default(), RIG, 320, 240, 64)
    }

    #[test]
    fn a_car_and_a_post_are_found_at_their_distance() {
        let boxes = [(-0.9, 0.9, 1.5, 12.0), (2.0, 2.4, 1.2, 8.0)];
        let map = map(&boxes, 0.0);
        let mut detector = detector();
        let scene = settled(&mut detector, &map);
        let road = scene.road.expect("the road is in plain sight");
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
    fn the_side_of_a_near_car_is_one_with_its_front() {
        // A front at 5.5 m, then a side along the road to 7.4 m.
        let mut map = map(&[(-1.9, -1.6, 1.4, 5.5)], 0.0);
        for x in 0..320 {
            // Where a line of sight meets the plane 1.6 m left of the camera.
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
        let scene = settled(&mut detector, &map);
        let [car] = scene.regions else { panic!("{:?}", scene.regions) };
        let side_end = RIG.cx_px - 1.6 * RIG.focal_px / 7.4;
        assert!(f64::from(car.bounds.x + car.bounds.width) > side_end - 8.0, "{car:?}");
        assert!((car.distance_m - 5.5).abs() < 0.3, "{car:?}");
    }

    #[test]
    fn an_empty_road_stays_empty_even_when_rolled() {
        for roll in [0.0, 0.006, -0.006, 0.012, -0.012] {
            let map = map(&[], roll);
            let mut detector = detector();
            let scene = settled(&mut detector, &map);
            let road = scene.road.expect("the road is in plain sight");
            assert!((road.roll - roll).abs() < 0.001, "{road:?}");
            assert!(scene.regions.is_empty(), "roll {roll}: {:?}", scene.regions);
        }
    }

    #[test]
    fn boxes_at_both_edges_of_a_rolled_road_keep_their_height() {
        let boxes = [(-2.6, -1.6, 1.5, 10.0), (1.6, 2.6, 1.5, 10.0)];
        for roll in [0.01, -0.01] {
            let map = map(&boxes, roll);
            let mut detector = detector();
            let scene = settled(&mut detector, &map);
            assert_eq!(scene.regions.len(), 2, "roll {roll}: {:?}", scene.regions);
            for region in scene.regions {
                assert!((region.height_m - 1.5).abs() < 0.35, "roll {roll}: {region:?}");
                assert!((region.distance_m - 10.0).abs() < 0.5, "roll {roll}: {region:?}");
            }
        }
    }

    #[test]
    fn nothing_known_is_no_road() {
        let mut detector = detector();
        let scene = detector.detect(certain(&[0; 320 * 240]));
        assert!(scene.road.is_none() && scene.regions.is_empty());
        // A wall that fills the view is no road either, and is no reason to panic.
        let scene = detector.detect(certain(&[10 * 256; 320 * 240]));
        assert!(scene.road.is_none_or(|road| road.confidence < 0.6));
        let scene = detector.detect(certain(&[u16::MAX; 320 * 240]));
        assert!(scene.regions.is_empty());
    }

    #[test]
    fn boxes_overlap_by_their_shared_part() {
        let a = PixelBox { x: 0, y: 0, width: 10, height: 10 };
        let b = PixelBox { x: 5, y: 0, width: 10, height: 10 };
        assert!((a.overlap(&b) - 50.0 / 150.0).abs() < 1e-12);
        assert_eq!(a.overlap(&PixelBox { x: 20, ..a }), 0.0);
        assert_eq!(PixelBox::default().overlap(&PixelBox::default()), 0.0);
    }
}
