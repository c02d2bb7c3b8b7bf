//! Evidence of the disparity map that a region is an obstacle.

use crate::region::Region;
use crate::road::surface::RoadSurface;

/// A smaller difference to the road, in px of disparity, is doubtful: the steps of a matcher on the road are
/// as large.
const DOUBTFUL_RISE_PX: f64 = 1.0;
/// Weights of the evidence: constant, log-odds of the confidence, logarithms of fill, height (m) and pixels.
const EVIDENCE: [f64; 5] = [-4.0, 1.85, 3.6, 2.1, 1.1];

/// Log-odds that a region of one frame is an obstacle; it grows with confidence, fill of the box, height and
/// size. The weights are a logistic regression over regions of the synthetic scenes in six weathers.
pub(super) fn evidence(region: &Region, surface: &RoadSurface) -> f64 {
    let confidence = region.confidence.clamp(0.3, 0.98);
    let area = f64::from(region.bounds.width) * f64::from(region.bounds.height);
    let fill = (f64::from(region.pixels) / area.max(1.0)).clamp(0.05, 1.0);
    let rise_px = prominence(region, surface) * surface.noise_px();
    EVIDENCE[0]
        + 3.0 * (rise_px / DOUBTFUL_RISE_PX).min(1.0).ln()
        + EVIDENCE[1] * (confidence / (1.0 - confidence)).ln()
        + EVIDENCE[2] * fill.ln()
        + EVIDENCE[3] * region.height_m.max(0.05).ln()
        + EVIDENCE[4] * f64::from(region.pixels.max(1)).ln()
}

/// Height of a region's top above the road, in standard deviations of the height noise.
pub(super) fn prominence(region: &Region, surface: &RoadSurface) -> f64 {
    region.height_m / surface.height_noise_m(region.disparity_px)
}
