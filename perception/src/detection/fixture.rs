//! A thing before a background, for tests: what the verifier knows of it.

use super::photometric::Verifier;
use super::residual::RoadGeometry;
use super::stixels::{StixelParameters, Stixels};
use crate::depth::DepthView;
use crate::image::GreyView;
use crate::outline::Outline;
use crate::region::{PixelBox, Region};
use crate::rig::Rig;
use crate::road::surface::RoadSurface;
use crate::road::tilt::Tilt;
use crate::stereo::DisparityView;

const FOCAL_PX: f64 = 500.0;
const BASELINE_M: f64 = 0.2;

/// Calls `of` with a pair of images and a region of it. The disparity map has `thing_px` inside the region's box, and `background_px`
/// elsewhere.
pub fn with_region<T>(
    pair: &[Vec<u8>; 2],
    size: (usize, usize),
    disparities_px: [usize; 2],
    bounds: PixelBox,
    of: impl FnOnce(&Verifier<'_>, &Region) -> T,
) -> T {
    with_left_side(pair, size, disparities_px, bounds, (0, 0), of)
}

/// The same; so many of its left columns are a side that ends so many px behind the rest.
pub fn with_left_side<T>(
    pair: &[Vec<u8>; 2],
    (width, height): (usize, usize),
    [background_px, thing_px]: [usize; 2],
    bounds: PixelBox,
    (side_columns, behind_px): (usize, usize),
    of: impl FnOnce(&Verifier<'_>, &Region) -> T,
) -> T {
    let rig = Rig { focal_px: FOCAL_PX, baseline_m: BASELINE_M, cx_px: width as f64 / 2.0, cy_px: 0.0 };
    let view = |image| GreyView::new(image, width, height, width).unwrap();
    let mut map = vec![(background_px * 256) as u16; width * height];
    for row in map.chunks_exact_mut(width) {
        let row = &mut row[bounds.x as usize..(bounds.x + bounds.width) as usize];
        row.fill((thing_px * 256) as u16);
        row[..side_columns].fill(((thing_px - behind_px) * 256) as u16);
    }
    let confidence = vec![255; width * height];
    let depth = DepthView::new(DisparityView::new(&map, width, height).unwrap(), &confidence).unwrap();
    let mut stixels = Stixels::new(width, height);
    let parameters = StixelParameters {
        min_height_m: 0.1,
        sigmas: 0.0,
        min_rise_px: 0.1,
        max_height_m: 3.0,
        min_disparity_px: 1.0,
        min_confidence: 100,
        max_gradient_px: 1.0,
    };
    stixels.find(depth, &RoadSurface::new(rig, width, height, 32), &parameters);
    let distance_m = rig.distance_m(thing_px as f64);
    let end_depth_m = [rig.distance_m((thing_px - behind_px) as f64) - distance_m, 0.0];
    let region = Region {
        bounds,
        disparity_px: thing_px as f64,
        disparity_sigma_px: 0.1,
        distance_m,
        lateral_m: 0.0,
        width_m: f64::from(bounds.width) * distance_m / FOCAL_PX,
        height_m: 1.0,
        inset_m: [0.0; 2],
        is_hidden: [false; 2],
        goes_on: [false; 2],
        outline: Outline { end_depth_m, ..Outline::default() },
        pixels: bounds.width * bounds.height,
        confidence: 0.9,
        evidence: 4.0,
    };
    let profile_px = vec![1.0; height];
    let road = RoadGeometry { profile_px: &profile_px, tilt: Tilt::default(), rig };
    of(&Verifier { images: [view(&pair[0]), view(&pair[1])], road, stixels: &stixels }, &region)
}
