//! Straight-line model of the near road that stabilises the estimate of the far road.
//!
//! At long range a row of the road has only a few noisy pixels between obstacles, and a matcher places dark
//! or wet asphalt too near. The near road has many rows, most of which show the road. A line through them
//! predicts the far part of a straight road better than the few pixels observed there. The path is therefore
//! snapped to the line where it departs from it by no more than the noise of the frame explains.

use super::histogram::{BINS_PER_PX, VDisparity};
use super::line_fit::LineFit;
use super::path_search::BLOCK;

/// A row is near if its road disparity is at least this share of the disparity in the lowest row.
const MIN_NEAR_SHARE: f64 = 0.23;
/// Fewest near blocks for a fit.
const MIN_BLOCKS: usize = 6;
/// Iterations of the robust fit: cut-off of Tukey's biweight in each, in px.
const TUKEY_WIDTHS_PX: [f64; 5] = [0.6, 0.6, INLIER_PX, INLIER_PX, INLIER_PX];
/// Blocks closer to the line than this, in px, are inliers.
const INLIER_PX: f64 = 0.25;
/// Departures from the line up to this size, in px, are snapped to it; the limit grows by the second value
/// for each px of noise above the noise of a clear frame (third value).
const SNAP_PX: f64 = 0.4;
const SNAP_PER_NOISE: f64 = 3.0;
const CLEAR_NOISE_PX: f64 = 0.28;
/// Departures this many times as large as the snapping limit are kept unchanged.
const FULL_DEPARTURE_RATIO: f64 = 2.0;
/// Histogram bins of residuals in near rows.
const RESIDUAL_BINS: usize = 16;

/// One block of the path: centre row, disparity in px, weight.
pub type Block = (f64, f64, f64);

/// The line, with a snapping limit that depends on the noise around it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NearLine {
    /// Slope of the line, in px of disparity per row.
    pub slope: f64,
    /// Disparity of the line in row 0, in px.
    offset_px: f64,
    /// Departures up to this size are snapped to the line, in px.
    snap_px: f64,
}

impl NearLine {
    /// Fits a line to the near blocks of a path by iteratively reweighted least squares; `None` if there are
    /// too few. `lowest_px` is the disparity of the road in the lowest row.
    pub fn fit(
        blocks: impl Iterator<Item = Block> + Clone,
        lowest_px: f64,
        histogram: &VDisparity,
    ) -> Option<Self> {
        let near =
            || blocks.clone().filter(|&(_, px, weight)| px >= MIN_NEAR_SHARE * lowest_px && weight > 0.0);
        if near().count() < MIN_BLOCKS {
            return None;
        }
        let mut line = Self::through(near(), |_, _| 1.0)?;
        for width_px in TUKEY_WIDTHS_PX {
            line = Self::through(near(), |row, px| {
                let residual = (px - line.at(row)) / width_px;
                (1.0 - residual * residual).max(0.0).powi(2)
            })?;
        }
        let noise = line.noise_px(near(), histogram);
        line.snap_px = SNAP_PX + SNAP_PER_NOISE * (noise - CLEAR_NOISE_PX).max(0.0);
        Some(line)
    }

    /// Disparity of the line in a row, in px; negative above its horizon.
    pub fn at(&self, row: f64) -> f64 {
        self.offset_px + self.slope * row
    }

    /// Disparity of the road in a row where the path measured `px`: snapped to the line, kept, or
    /// interpolated between both.
    pub fn snap(&self, row: f64, px: f64) -> f64 {
        let straight = self.at(row);
        let residual = px - straight;
        let departure = (residual.abs() / self.snap_px - 1.0) / (FULL_DEPARTURE_RATIO - 1.0);
        if straight > 0.0 { straight + residual * departure.clamp(0.0, 1.0) } else { px }
    }

    /// Whether the departure of a measured disparity from the line is within the noise.
    pub fn is_consistent(&self, row: f64, px: f64) -> bool {
        (px - self.at(row)).abs() <= self.snap_px
    }

    fn through(blocks: impl Iterator<Item = Block>, share: impl Fn(f64, f64) -> f64) -> Option<Self> {
        let mut fit = LineFit::default();
        for (row, px, weight) in blocks {
            fit.add(row, px, weight * share(row, px));
        }
        let (slope, offset_px) = fit.line().filter(|(slope, _)| *slope > 0.0)?;
        Some(Self { slope, offset_px, snap_px: SNAP_PX })
    }

    /// Standard deviation of the disparities around the line, from the median absolute residual. Only rows of
    /// inlier blocks are counted, so that a bend in the road is not taken for noise.
    fn noise_px(&self, blocks: impl Iterator<Item = Block>, histogram: &VDisparity) -> f64 {
        let mut counts = [0_u32; RESIDUAL_BINS];
        for (row, px, _) in blocks {
            if (px - self.at(row)).abs() > INLIER_PX {
                continue;
            }
            let first = (row - 0.5 * (BLOCK - 1) as f64).max(0.0) as usize;
            for y in first..(first + BLOCK).min(histogram.height()) {
                let centre = self.at(y as f64) * BINS_PER_PX as f64;
                let first = (centre - (RESIDUAL_BINS / 2) as f64).round().max(0.0) as usize;
                for (bin, &count) in histogram.row(y).iter().enumerate().skip(first).take(RESIDUAL_BINS) {
                    let residual = (bin as f64 + 0.5 - centre).abs() as usize;
                    counts[residual.min(RESIDUAL_BINS - 1)] += u32::from(count);
                }
            }
        }
        let half = 0.5 * f64::from(counts.iter().sum::<u32>());
        let mut seen = 0.0;
        for (bin, &count) in counts.iter().enumerate() {
            let count = f64::from(count);
            if count > 0.0 && seen + count >= half {
                return 1.4826 * (bin as f64 + (half - seen) / count) / BINS_PER_PX as f64;
            }
            seen += count;
        }
        0.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::depth::DepthView;
    use crate::road::histogram::Corridor;
    use crate::stereo::DisparityView;

    const HEIGHT: usize = 240;

    /// v-disparity of a road with 0.1 px per row below row 100 and uniform noise of ± `noise_px`.
    fn histogram(noise_px: f64) -> VDisparity {
        let mut random = fastrand::Rng::with_seed(2);
        let mut map = Vec::with_capacity(64 * HEIGHT);
        for y in 0..HEIGHT {
            for _ in 0..64 {
                let off = noise_px * (2.0 * random.f64() - 1.0);
                map.push((256.0 * (0.1 * (y as f64 - 100.0) + off).max(0.0)) as u16);
            }
        }
        let mut histogram = VDisparity::new(64, HEIGHT, 32);
        let confidence = vec![255; map.len()];
        let depth = DepthView::new(DisparityView::new(&map, 64, HEIGHT).unwrap(), &confidence).unwrap();
        histogram.fill(depth, 1, Corridor::UNBOUNDED);
        histogram
    }

    /// Blocks of eight rows of the same road, with an offset that depends on the row.
    fn blocks(off: impl Fn(f64) -> f64 + Clone) -> impl Iterator<Item = Block> + Clone {
        (0..17).map(move |block| {
            let row = 235.5 - 8.0 * f64::from(block);
            (row, 0.1 * (row - 100.0) + off(row), 100.0)
        })
    }

    #[test]
    fn small_far_departures_are_snapped_to_the_line() {
        let bend = |row: f64| if row < 130.0 { 0.25 } else { 0.0 };
        let line = NearLine::fit(blocks(bend), 14.0, &histogram(0.1)).unwrap();
        for (row, px, _) in blocks(bend) {
            let straight = 0.1 * (row - 100.0);
            assert!((line.snap(row, px) - straight).abs() < 0.02, "row {row}: {}", line.snap(row, px));
        }
    }

    #[test]
    fn large_far_departures_are_kept() {
        let line = NearLine::fit(blocks(|_| 0.0), 14.0, &histogram(0.1)).unwrap();
        for off in [-1.0, 1.0] {
            assert!((line.snap(120.0, 2.0 + off) - (2.0 + off)).abs() < 1e-9);
            assert!(!line.is_consistent(120.0, 2.0 + off));
        }
        // Between both limits the result is continuous and monotonic.
        let snapped: Vec<f64> = (0..100).map(|i| line.snap(120.0, 2.0 + 0.01 * f64::from(i))).collect();
        assert!(snapped.windows(2).all(|w| w[0] <= w[1] + 1e-9 && w[1] - w[0] < 0.05), "{snapped:?}");
    }

    #[test]
    fn noise_raises_the_snapping_limit() {
        let fit = |noise| NearLine::fit(blocks(|_| 0.0), 14.0, &histogram(noise)).unwrap();
        let (clear, noisy) = (fit(0.1), fit(1.5));
        assert!(noisy.snap_px > 2.0 * clear.snap_px, "{clear:?} {noisy:?}");
        assert!(!clear.is_consistent(120.0, 2.8) && noisy.is_consistent(120.0, 2.8));
    }

    #[test]
    fn obstacles_on_the_near_road_do_not_bend_the_line() {
        let car = |row: f64| if (150.0..175.0).contains(&row) { 2.0 } else { 0.0 };
        let line = NearLine::fit(blocks(car), 14.0, &histogram(0.1)).unwrap();
        assert!((line.at(110.0) - 1.0).abs() < 0.03, "{line:?}");
        assert_eq!(NearLine::fit(blocks(car).take(4), 14.0, &histogram(0.1)), None, "too few");
    }
}
