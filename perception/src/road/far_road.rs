//! The straight line of the road's near part: where the far road goes unless it plainly leaves it.
//!
//! Far off, a row of the road is a few noisy pixels between things that stand on it, and a matcher draws dark
//! or wet asphalt nearer than it is. Nearby there are many rows, and most of them show road: a line through
//! them tells where a straight road is far off better than what is seen there. So the path is snapped on the line
//! where it departs from it by no more than what the frame's noise explains.

use super::histogram::{BINS_PER_PX, VDisparity};
use super::line_fit::LineFit;
use super::path_search::BLOCK;

/// Share of the road's disparity in the lowest row from which on a row is near.
const MIN_NEAR_SHARE: f64 = 0.23;
/// Fewer near blocks make no line.
const MIN_BLOCKS: usize = 6;
/// Rounds of the fit: what is farther off than so many px counts for nothing.
const TUKEY_WIDTHS_PX: [f64; 5] = [0.6, 0.6, INLIER_PX, INLIER_PX, INLIER_PX];
/// What is within so many px of the line is on it.
const INLIER_PX: f64 = 0.25;
/// Departure that is snapped straight, in px: where the frame is clear, and more for each px of noise above
/// that of a clear frame.
const SNAP_PX: f64 = 0.4;
const SNAP_PER_NOISE: f64 = 3.0;
const CLEAR_NOISE_PX: f64 = 0.28;
/// A departure so many times as great is departure wholly.
const FULL_DEPARTURE_RATIO: f64 = 2.0;
/// Residuals of near rows that are told apart, in bins.
const RESIDUAL_BINS: usize = 16;

/// A block of the path: its middle row, disparity in px and weight.
pub type Block = (f64, f64, f64);

/// The line, with the noise of what is counted around it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NearLine {
    /// Disparity that a row adds, px per row.
    pub slope: f64,
    /// Disparity in row 0, in px.
    offset_px: f64,
    /// Departure that is snapped straight, in px.
    snap_px: f64,
}

impl NearLine {
    /// The line through the near blocks of a path, robustly; `None` where there are too few. `lowest_px` is
    /// the road's disparity in the lowest row.
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
                let off = (px - line.at(row)) / width_px;
                (1.0 - off * off).max(0.0).powi(2)
            })?;
        }
        let noise = line.noise_px(near(), histogram);
        line.snap_px = SNAP_PX + SNAP_PER_NOISE * (noise - CLEAR_NOISE_PX).max(0.0);
        Some(line)
    }

    /// Disparity of the line in a row, in px; below zero above its horizon.
    pub fn at(&self, row: f64) -> f64 {
        self.offset_px + self.slope * row
    }

    /// Where the road of a row is, of which a path says `px`.
    pub fn snap(&self, row: f64, px: f64) -> f64 {
        let straight = self.at(row);
        let off = px - straight;
        let departure = (off.abs() / self.snap_px - 1.0) / (FULL_DEPARTURE_RATIO - 1.0);
        if straight > 0.0 { straight + off * departure.clamp(0.0, 1.0) } else { px }
    }

    /// Whether a place is on the line, as far as the noise tells.
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

    /// The median distance of what is counted around the line, in the rows of the blocks that lie on it, as a
    /// standard deviation: a road that bends is not noise.
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
                    let off = (bin as f64 + 0.5 - centre).abs() as usize;
                    counts[off.min(RESIDUAL_BINS - 1)] += u32::from(count);
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

    /// The v-disparity of a road of 0.1 px a row below row 100, with so much noise to either side.
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

    /// Blocks of eight rows of the same road, whose far part is off.
    fn blocks(off: impl Fn(f64) -> f64 + Clone) -> impl Iterator<Item = Block> + Clone {
        (0..17).map(move |block| {
            let row = 235.5 - 8.0 * f64::from(block);
            (row, 0.1 * (row - 100.0) + off(row), 100.0)
        })
    }

    #[test]
    fn a_far_part_that_is_hardly_off_is_laid_straight() {
        let bend = |row: f64| if row < 130.0 { 0.25 } else { 0.0 };
        let line = NearLine::fit(blocks(bend), 14.0, &histogram(0.1)).unwrap();
        for (row, px, _) in blocks(bend) {
            let straight = 0.1 * (row - 100.0);
            assert!((line.snap(row, px) - straight).abs() < 0.02, "row {row}: {}", line.snap(row, px));
        }
    }

    #[test]
    fn a_far_part_that_plainly_leaves_the_line_is_followed() {
        let line = NearLine::fit(blocks(|_| 0.0), 14.0, &histogram(0.1)).unwrap();
        for off in [-1.0, 1.0] {
            assert!((line.snap(120.0, 2.0 + off) - (2.0 + off)).abs() < 1e-9);
            assert!(!line.is_consistent(120.0, 2.0 + off));
        }
        // In between it goes over smoothly, and never back.
        let snapped: Vec<f64> = (0..100).map(|i| line.snap(120.0, 2.0 + 0.01 * f64::from(i))).collect();
        assert!(snapped.windows(2).all(|w| w[0] <= w[1] + 1e-9 && w[1] - w[0] < 0.05), "{snapped:?}");
    }

    #[test]
    fn noise_asks_for_a_greater_departure() {
        let fit = |noise| NearLine::fit(blocks(|_| 0.0), 14.0, &histogram(noise)).unwrap();
        let (clear, noisy) = (fit(0.1), fit(1.5));
        assert!(noisy.snap_px > 2.0 * clear.snap_px, "{clear:?} {noisy:?}");
        assert!(!clear.is_consistent(120.0, 2.8) && noisy.is_consistent(120.0, 2.8));
    }

    #[test]
    fn things_on_the_near_road_do_not_bend_the_line() {
        let car = |row: f64| if (150.0..175.0).contains(&row) { 2.0 } else { 0.0 };
        let line = NearLine::fit(blocks(car), 14.0, &histogram(0.1)).unwrap();
        assert!((line.at(110.0) - 1.0).abs() < 0.03, "{line:?}");
        assert_eq!(NearLine::fit(blocks(car).take(4), 14.0, &histogram(0.1)), None, "too few");
    }
}
