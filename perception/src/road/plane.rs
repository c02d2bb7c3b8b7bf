//! Single-plane road model: a straight line in v-disparity. The alternative to the path, for comparison.

use super::histogram::{BINS_PER_PX, VDisparity};
use super::line_fit::LineFit;
use super::radon::RoadLine;

/// Width of the window around a line, in bins.
const WINDOW_BINS: usize = 5;
/// Iterations of the fit; each uses the window around the previous line.
const ITERATIONS: usize = 2;

/// Histogram cells near a line in row `y`: disparity in px and count, limited to `cap`.
pub fn counts_near_line(
    histogram: &VDisparity,
    line: RoadLine,
    cap: u16,
    y: usize,
) -> impl Iterator<Item = (f64, f64)> + '_ {
    let first = (line.at(y as f64) * BINS_PER_PX as f64).floor() as usize;
    let row =
        histogram.row(y).iter().enumerate().skip(first.saturating_sub(WINDOW_BINS / 2)).take(WINDOW_BINS);
    row.map(move |(bin, &count)| ((bin as f64 + 0.5) / BINS_PER_PX as f64, f64::from(count.min(cap))))
}

/// Line fitted by least squares to the cells near an initial line; the initial line is kept if there are too
/// few.
pub fn fit_plane(histogram: &VDisparity, line: RoadLine, cap: u16) -> RoadLine {
    let height = histogram.height();
    let mut plane = line;
    for _ in 0..ITERATIONS {
        let mut fit = LineFit::default();
        for y in plane.horizon_px.clamp(0.0, height as f64) as usize..height {
            for (px, weight) in counts_near_line(histogram, plane, cap, y) {
                fit.add(y as f64 - line.horizon_px, px, weight);
            }
        }
        match fit.line() {
            Some((slope, at_horizon)) if (0.5 * line.slope..2.0 * line.slope).contains(&slope) => {
                plane = RoadLine { slope, horizon_px: line.horizon_px - at_horizon / slope, ..line };
            }
            _ => break,
        }
    }
    plane
}
