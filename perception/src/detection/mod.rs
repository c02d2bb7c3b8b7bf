//! Obstacle detection on the road surface (paper, section 3.5).
//!
//! Input: a [`DepthView`] (disparity in 1/256 px, confidence, optionally the rectified images), the
//! [`RoadProfile`] and the [`RoadSurface`] of the same frame. Output: [`Region`]s, nearest first: a pixel box
//! with disparity (px), distance, lateral position and size in metres, and its evidence. These are sightings of one frame:
//! all whose evidence is above a low floor ([`MIN_EVIDENCE`]). [`crate::tracking`] decides what exists.
//!
//! Steps:
//!
//! 1. [`stixels`]: vertical runs of similar disparity above the road, in strips of 4 columns; their disparities are refined in both images
//!    (`refinement`).
//! 2. [`regions`]: neighbouring stixels are grouped into regions; the sides of things that run away from the camera belong to
//!    them (`sides`).
//! 3. [`photometric`]: regions are verified in both images, after their disparity has been refined there, too; the sides of wide ones are
//!    found there (`contour`). What something nearer hides of them is known (`occlusion`).
//! 4. [`small_obstacles`]: obstacles too small for the disparity map, from the [`residual`] of both images.

mod concavity;
mod contour;
mod evidence;
#[cfg(test)]
mod fixture;
mod footprint;
mod occlusion;
pub mod photometric;
mod refinement;
pub mod regions;
pub mod residual;
mod sides;
pub mod small_obstacles;
mod step;
pub mod stixel_use;
pub mod stixels;

use crate::depth::DepthView;
use crate::region::Region;
use crate::rig::Rig;
use crate::road::profile::RoadProfile;
use crate::road::surface::RoadSurface;
use photometric::Verifier;
use refinement::{MAX_PARTS, Part, refine_stixels};
use regions::RegionFinder;
pub use regions::{MIN_EVIDENCE, RegionParameters};
use residual::RoadGeometry;
use small_obstacles::SmallObstacleFinder;
use stixel_use::StixelUse;
use stixels::{StixelParameters, Stixels};

/// Evidence from which a sighting in a single picture, without a history, counts as an obstacle.
pub const SINGLE_PICTURE_EVIDENCE: f64 = 3.5;

/// Pixels with a lower confidence (0 to 255) are not used for obstacle detection.
const MIN_CONFIDENCE: u8 = 100;

/// Smallest lateral distance of an object's side from the camera, in metres. Disparity that changes faster
/// from column to column than on such a side is a discontinuity between two surfaces.
const MIN_SIDE_OFFSET_M: f64 = 0.9;

/// A stixel may be lower than a region, by this share of its minimum height: the rest may be hidden or unknown.
const STIXEL_HEIGHT_SHARE: f64 = 0.4;
/// A stixel rises above the road by at least this number of standard deviations of its disparity, and by this many
/// px of disparity. Both are low: regions are judged by all their stixels together.
const STIXEL_SIGMAS: f64 = 0.3;
const STIXEL_RISE_PX: f64 = 0.2;

/// Finds obstacle regions in disparity maps of one size; memory is allocated once.
#[derive(Debug)]
pub struct ObstacleDetector {
    parameters: RegionParameters,
    rig: Rig,
    size: (usize, usize),
    stixels: Stixels,
    /// Parts of rows of a stixel that are compared in both images.
    compared: Vec<Part>,
    finder: RegionFinder,
    small: SmallObstacleFinder,
    regions: Vec<Region>,
}

impl ObstacleDetector {
    /// A detector for maps of `width` × `height` with disparities below `disparities` px.
    pub fn new(
        parameters: RegionParameters,
        rig: Rig,
        width: usize,
        height: usize,
        disparities: usize,
    ) -> Self {
        let stixels = Stixels::new(width, height);
        Self {
            finder: RegionFinder::new(parameters, &stixels, disparities),
            small: SmallObstacleFinder::new(width, height),
            regions: Vec::with_capacity(regions::CAPACITY + small_obstacles::CAPACITY),
            size: (width, height),
            compared: Vec::with_capacity(MAX_PARTS),
            stixels,
            parameters,
            rig,
        }
    }

    /// Sets the largest reported distance, in metres.
    pub fn set_range_m(&mut self, max_distance_m: f64) {
        self.parameters.max_distance_m = max_distance_m;
        self.finder.set_range_m(max_distance_m);
    }

    /// Sightings of the last map: what may be obstacles on the road, nearest first.
    pub fn regions(&self) -> &[Region] {
        &self.regions
    }

    /// Looks for regions in both pictures of the last map; `None` if it has none.
    pub fn verifier<'a>(
        &'a self,
        depth: DepthView<'a>,
        profile: &'a RoadProfile,
        surface: &RoadSurface,
    ) -> Option<Verifier<'a>> {
        let road = RoadGeometry { profile_px: profile.disparity_px(), tilt: surface.tilt(), rig: self.rig };
        Some(Verifier { images: depth.images()?, road, stixels: &self.stixels })
    }

    /// The stixels of the last map.
    pub fn stixels(&self) -> &Stixels {
        &self.stixels
    }

    /// Extracts the stixels of a map, before [`Self::detect`]; if the map has its images, their disparities are refined in these.
    pub fn find_stixels(&mut self, depth: DepthView<'_>, surface: &RoadSurface) -> &Stixels {
        let p = &self.parameters;
        let stixel_parameters = StixelParameters {
            min_height_m: STIXEL_HEIGHT_SHARE * p.min_height_m,
            sigmas: STIXEL_SIGMAS,
            min_rise_px: STIXEL_RISE_PX,
            max_height_m: p.max_height_m,
            min_disparity_px: self.rig.disparity_px(p.max_distance_m),
            min_confidence: MIN_CONFIDENCE,
            max_gradient_px: self.rig.baseline_m / MIN_SIDE_OFFSET_M,
        };
        self.stixels.find(depth, surface, &stixel_parameters);
        if let Some(images) = depth.images() {
            refine_stixels(&mut self.stixels, &mut self.compared, images);
        }
        &self.stixels
    }

    /// Finds what may be obstacles on the road, from the stixels of [`Self::find_stixels`] for the same map. Of more than
    /// `max_count`, those with most evidence are kept. `uses` says of each stixel what it belongs
    /// to; flat regions of raised ground are left out.
    pub fn detect(
        &mut self,
        depth: DepthView<'_>,
        profile: &RoadProfile,
        surface: &RoadSurface,
        uses: &[StixelUse],
    ) {
        self.regions.clear();
        let road = RoadGeometry { profile_px: profile.disparity_px(), tilt: surface.tilt(), rig: self.rig };
        let verifier = depth.images().map(|images| Verifier { images, road, stixels: &self.stixels });
        let found = self.finder.find(&self.stixels, uses, surface, &self.rig, self.size, verifier.as_ref());
        self.regions.extend_from_slice(found);
        if let Some(images) = depth.images() {
            let small = self.small.find(images, &road, surface, &self.regions);
            self.regions.extend_from_slice(small);
        }
        if self.regions.len() > self.parameters.max_count {
            self.regions.sort_unstable_by(|a, b| {
                b.evidence.total_cmp(&a.evidence).then(b.disparity_px.total_cmp(&a.disparity_px))
            });
            self.regions.truncate(self.parameters.max_count);
        }
        self.regions.sort_unstable_by(|a, b| {
            b.disparity_px.total_cmp(&a.disparity_px).then(a.bounds.x.cmp(&b.bounds.x))
        });
    }
}
