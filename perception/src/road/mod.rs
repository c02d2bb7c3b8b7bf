//! Road surface estimation from a disparity map (paper, section 3.5).
//!
//! Input: a [`DepthView`], that is a disparity map in 1/256 px with a confidence (0 to 255) for each pixel.
//! Output: a [`RoadModel`] (initial line, roll, camera height in metres), the [`RoadProfile`] (disparity of
//! the road in each image row, in px), the [`RoadSurface`] from which heights in metres are measured, and the
//! road's [`Edges`].
//!
//! Steps:
//!
//! 1. [`histogram`]: v-disparity histogram of a corridor ahead of the vehicle.
//! 2. [`radon`]: initial straight line by the Radon transform.
//! 3. [`path_search`]: the road's path through v-disparity by dynamic programming.
//! 4. [`profile`]: smoothed profile; [`far_road`] stabilises its far part.
//! 5. [`surface`]: lateral tilt and noise; heights above the road.
//! 6. [`edges`]: kerbs and other lateral limits.

pub mod edge_curve;
pub mod edges;
pub mod far_road;
pub mod heights;
pub mod histogram;
pub mod line_fit;
pub mod path_search;
pub mod plane;
pub mod profile;
pub mod radon;
pub mod samples;
pub mod surface;
pub mod tilt;

use crate::depth::DepthView;
use crate::rig::Rig;
use edges::{EdgeFinder, Edges};
use histogram::{Corridor, MIN_CONFIDENCE, VDisparity};
pub use profile::Shape;
use profile::{ProfileFinder, RoadProfile};
use radon::{Radon, RadonRange, RoadLine};
use surface::RoadSurface;

/// Half-width of the corridor in which the road is searched, in metres on each side of the camera.
const CORRIDOR_HALF_WIDTH_M: f64 = 5.0;

/// Parameters of the road model.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RoadParameters {
    /// Smallest and largest height of the camera above the road, in metres.
    pub camera_height_m: (f64, f64),
    /// Largest distance of the horizon from the principal point's row, as a share of the image height.
    pub horizon_share: f64,
    /// A result with less support than this (0 to 1) means that no road is visible.
    pub min_support: f64,
    /// Model that is fitted to the road.
    pub shape: Shape,
}

impl Default for RoadParameters {
    fn default() -> Self {
        Self { camera_height_m: (0.5, 3.0), horizon_share: 0.2, min_support: 0.25, shape: Shape::default() }
    }
}

/// Road model of one frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RoadModel {
    /// Initial straight line from the Radon transform.
    pub line: RoadLine,
    /// Change of the road's disparity per column to the right, caused by camera roll, in px per px.
    pub roll: f64,
    /// Share of rows in which the profile is supported by the histogram, 0 to 1.
    pub confidence: f64,
    /// Height of the camera above the near road, in metres.
    pub camera_height_m: f64,
}

/// Estimates the road surface in disparity maps of one size; memory is allocated once.
#[derive(Debug)]
pub struct RoadEstimator {
    parameters: RoadParameters,
    rig: Rig,
    width: usize,
    height: usize,
    histogram: VDisparity,
    radon: Radon,
    profile: ProfileFinder,
    surface: RoadSurface,
    edges: EdgeFinder,
}

impl RoadEstimator {
    /// An estimator for maps of `width` × `height` with disparities below `disparities` px.
    pub fn new(
        parameters: RoadParameters,
        rig: Rig,
        width: usize,
        height: usize,
        disparities: usize,
    ) -> Self {
        let histogram = VDisparity::new(width, height, disparities);
        Self {
            radon: Radon::new(histogram.bins(), height),
            profile: ProfileFinder::new(histogram.bins(), height).with_shape(parameters.shape),
            surface: RoadSurface::new(rig, width, height, disparities),
            edges: EdgeFinder::default(),
            histogram,
            parameters,
            rig,
            width,
            height,
        }
    }

    /// v-disparity histogram of the last map.
    pub fn v_disparity(&self) -> &VDisparity {
        &self.histogram
    }

    /// Road profile of the last map; empty if no road was visible.
    pub fn profile(&self) -> &RoadProfile {
        self.profile.profile()
    }

    /// RoadSurface of the last map with a visible road; heights are measured relative to it.
    pub fn surface(&self) -> &RoadSurface {
        &self.surface
    }

    /// Left and right edges of the road; all `None` if no road was visible.
    pub fn edges(&self) -> &Edges {
        self.edges.edges()
    }

    /// Estimates the road in a map; `None` if no road is visible.
    ///
    /// # Panics
    /// When the size of the map differs from that of the estimator.
    pub fn estimate(&mut self, depth: DepthView<'_>) -> Option<RoadModel> {
        assert_eq!((depth.width(), depth.height()), (self.width, self.height));
        let corridor = Corridor {
            centre_px: self.rig.cx_px as f32,
            columns_per_px: (CORRIDOR_HALF_WIDTH_M / self.rig.baseline_m) as f32,
        };
        self.histogram.fill(depth, MIN_CONFIDENCE, corridor);
        let cap = (self.width / 24).clamp(4, u16::MAX as usize) as u16;
        let (min_height_m, max_height_m) = self.parameters.camera_height_m;
        let horizon_margin = self.parameters.horizon_share * self.height as f64;
        let range = RadonRange {
            slope: (self.rig.baseline_m / max_height_m, self.rig.baseline_m / min_height_m),
            horizon_px: (self.rig.cy_px - horizon_margin, self.rig.cy_px + horizon_margin),
        };
        let line = self.radon.strongest_line(&self.histogram, range, cap);
        let support =
            line.map_or(0.0, |line| self.profile.find(&self.histogram, depth, line, cap, corridor).support());
        let Some(line) = line.filter(|_| support >= self.parameters.min_support) else {
            self.profile.clear();
            self.edges.clear();
            return None;
        };
        let profile = self.profile.profile();
        self.surface.update(profile, depth, MIN_CONFIDENCE);
        self.edges.update(depth, &self.surface, &self.rig, profile.top(), MIN_CONFIDENCE);
        Some(RoadModel {
            line,
            roll: self.surface.tilt().roll,
            confidence: support,
            camera_height_m: self.rig.baseline_m / line.slope,
        })
    }
}
