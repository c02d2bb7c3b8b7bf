//! Initial straight road model: the Radon transform of v-disparity (R{U} in the paper).

use super::histogram::{BINS_PER_PX, VDisparity};
use crate::simd::rounding::nearest_f64;
use crate::simd::{Level, Simd, kernel};

/// A straight road in v-disparity: disparity = `slope` · (row − `horizon_px`).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RoadLine {
    /// Slope in px of disparity per row; equals baseline / camera height.
    pub slope: f64,
    /// Row of the horizon, where the disparity of the road is 0.
    pub horizon_px: f64,
    /// Mean capped count per row below the horizon as a share of the cap, 0 to 1.
    pub support: f64,
}

impl RoadLine {
    /// Disparity of the road in row `y`, in px; negative above the horizon.
    pub fn at(&self, y: f64) -> f64 {
        self.slope * (y - self.horizon_px)
    }
}

/// Search range of lines.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RadonRange {
    /// Smallest and largest slope, in px per row.
    pub slope: (f64, f64),
    /// First and last row of the horizon.
    pub horizon_px: (f64, f64),
}

const ANGLES: usize = 64;
/// Cells that are processed as one group.
const GROUP: usize = 32;
/// Neighbouring cells mostly lie on the same line. Adding them to this many separate sums avoids a dependency
/// between consecutive additions.
const PARTIAL_SUMS: usize = 4;
/// Rows above the first horizon that are also used, for cells that a line touches by rounding.
const HORIZON_MARGIN_ROWS: f64 = 4.0;

/// Radon transform of v-disparity; memory is allocated once.
#[derive(Debug)]
pub struct Radon {
    /// Sums along each line of the current angle, indexed by offset.
    sums: [Vec<u32>; PARTIAL_SUMS],
    /// Non-empty cells of the histogram (bin, row, capped count), padded to whole groups.
    cells: [Vec<u16>; 3],
    level: Level,
}

impl Radon {
    /// A workspace for histograms of `bins` × `height` cells.
    pub fn new(bins: usize, height: usize) -> Self {
        let lines = 2 * (bins + height) + 2;
        Self {
            sums: std::array::from_fn(|_| vec![0; lines]),
            cells: std::array::from_fn(|_| Vec::with_capacity((bins * height).next_multiple_of(GROUP))),
            level: Level::best(),
        }
    }

    /// The line with the largest integral. A single cell counts at most `cap`, so that a near wall (many
    /// pixels at one disparity) does not outweigh a road (a few pixels in every row). `None` if no line in
    /// the range has any support.
    pub fn strongest_line(
        &mut self,
        histogram: &VDisparity,
        range: RadonRange,
        cap: u16,
    ) -> Option<RoadLine> {
        let [bins, rows, capped] = &mut self.cells;
        bins.clear();
        rows.clear();
        capped.clear();
        let min_count = (cap / 8).max(1);
        // A line has no cells above its horizon except those that it touches by rounding.
        let first = (range.horizon_px.0 - HORIZON_MARGIN_ROWS).clamp(0.0, histogram.height() as f64) as usize;
        for y in first..histogram.height() {
            for (group, counts) in histogram.row(y).chunks(GROUP).enumerate() {
                // Most groups are empty and are skipped as a whole.
                if counts.iter().fold(0, |most, &count| most.max(count)) < min_count {
                    continue;
                }
                for (i, &count) in counts.iter().enumerate().filter(|(_, count)| **count >= min_count) {
                    bins.push((GROUP * group + i) as u16);
                    rows.push(y as u16);
                    capped.push(count.min(cap));
                }
            }
        }
        // Empty cells pad the last group.
        let whole = bins.len().next_multiple_of(GROUP);
        bins.resize(whole, 0);
        rows.resize(whole, first as u16);
        capped.resize(whole, 0);
        let lines = self.sums[0].len();
        let mut best: Option<(u32, f64, f64)> = None;
        let (low, high) = range.slope;
        for angle in 0..ANGLES {
            // Slopes form a geometric series; φ is the angle between the line's normal and the disparity
            // axis.
            let slope = low * (high / low).powf(angle as f64 / (ANGLES - 1) as f64);
            let bins_per_row = slope * BINS_PER_PX as f64;
            let phi = -bins_per_row.atan();
            let (sin, cos) = phi.sin_cos();
            // Offset d = i·cosφ + j·sinφ of each cell (i bin, j row), shifted to be positive.
            let shift = histogram.height() as f64 + 1.0;
            // The line crosses the centre of bin 0 (1/8 px) half a bin below the horizon.
            let centre = -0.5 / bins_per_row;
            // Offsets decrease as the horizon moves down; a margin on both sides allows for rounding.
            let line_index = |horizon_px: f64| ((horizon_px - centre) * sin + shift - 0.5).max(0.0);
            let from = (line_index(range.horizon_px.1) as usize).saturating_sub(1).min(lines - 2);
            let to = (line_index(range.horizon_px.0) as usize + 3).clamp(from + 1, lines - 1);
            for sums in &mut self.sums {
                sums[from..=to].fill(0);
            }
            project(self.level, [bins, rows, capped], [cos, sin, shift], &mut self.sums);
            let [a, b, c, d] = &mut self.sums;
            for i in from..=to {
                a[i] += b[i] + c[i] + d[i];
            }
            // Sum over two neighbouring offsets: a line one bin wide, which tolerates rounding.
            for (i, window) in a.windows(2).enumerate().take(to).skip(from) {
                let sum = window[0] + window[1];
                if best.is_some_and(|(greatest, ..)| sum <= greatest) || sum == 0 {
                    continue;
                }
                let offset = i as f64 + 0.5 - shift;
                let horizon_px = offset / sin + centre;
                if horizon_px >= range.horizon_px.0 && horizon_px <= range.horizon_px.1 {
                    best = Some((sum, slope, horizon_px));
                }
            }
        }
        best.map(|(sum, slope, horizon_px)| {
            let rows = (histogram.height() as f64 - horizon_px).max(1.0);
            let support = (f64::from(sum) / (rows * f64::from(cap.max(1)))).min(1.0);
            RoadLine { slope, horizon_px, support }
        })
    }
}

kernel! {
    /// Adds the counts of cells (bins, rows, counts, in whole groups) to the lines through them, at the
    /// rounded offset bin·cosφ + row·sinφ + shift; `line` holds the three coefficients.
    fn project(cells: [&[u16]; 3], line: [f64; 3], sums: &mut [Vec<u32>; PARTIAL_SUMS]) = project_each
}

#[inline(always)]
fn project_each<S: Simd>(_: S, cells: [&[u16]; 3], line: [f64; 3], sums: &mut [Vec<u32>; PARTIAL_SUMS]) {
    let [bins, rows, counts] = cells.map(|cells| cells.as_chunks::<GROUP>().0);
    let [a, b, c, d] = sums.each_mut().map(|sums| &mut sums[..]);
    let mut offsets = [0_u32; GROUP];
    for ((bins, rows), counts) in bins.iter().zip(rows).zip(counts) {
        for i in 0..GROUP {
            let offset = f64::from(bins[i]) * line[0] + f64::from(rows[i]) * line[1] + line[2];
            offsets[i] = nearest_f64(offset);
        }
        for (offsets, counts) in
            offsets.as_chunks::<PARTIAL_SUMS>().0.iter().zip(counts.as_chunks::<PARTIAL_SUMS>().0)
        {
            let [i, j, k, l] = offsets.map(|line_index| line_index as usize);
            let [p, q, r, s] = counts.map(u32::from);
            // Sums outside the searched range are not reset, so they may wrap.
            a[i] = a[i].wrapping_add(p);
            b[j] = b[j].wrapping_add(q);
            c[k] = c[k].wrapping_add(r);
            d[l] = d[l].wrapping_add(s);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::depth::DepthView;
    use crate::road::histogram::Corridor;
    use crate::stereo::DisparityView;

    #[test]
    fn the_line_of_a_plane_is_found_beside_a_wall() {
        let (width, height) = (200, 240);
        for (slope, horizon) in [(0.1, 100.0), (0.33, 80.0), (0.2, 130.5)] {
            let mut map = vec![0_u16; width * height];
            for y in 0..height {
                for x in 0..width {
                    let road = slope * (y as f64 - horizon);
                    // The right half is a wall at 12 px.
                    let d = if x > width / 2 { road.max(12.0) } else { road };
                    map[y * width + x] = (d.max(0.0) * 256.0) as u16;
                }
            }
            let mut histogram = VDisparity::new(width, height, 64);
            let confidence = vec![255; width * height];
            let map = DisparityView::new(&map, width, height).unwrap();
            histogram.fill(DepthView::new(map, &confidence).unwrap(), 1, Corridor::UNBOUNDED);
            let range = RadonRange { slope: (0.04, 1.0), horizon_px: (60.0, 160.0) };
            let line = Radon::new(histogram.bins(), height).strongest_line(&histogram, range, 20).unwrap();
            for y in [150.0, 200.0, 239.0] {
                let truth = slope * (y - horizon);
                assert!((line.at(y) - truth).abs() < 0.6, "{line:?} at {y}, truth {truth}");
            }
            assert!(line.support > 0.5, "{line:?}");
        }
    }

    #[test]
    fn an_empty_map_has_no_line() {
        let mut histogram = VDisparity::new(50, 50, 16);
        let map = DisparityView::new(&[0; 2500], 50, 50).unwrap();
        histogram.fill(DepthView::new(map, &[255; 2500]).unwrap(), 1, Corridor::UNBOUNDED);
        let range = RadonRange { slope: (0.04, 1.0), horizon_px: (0.0, 40.0) };
        assert_eq!(Radon::new(histogram.bins(), 50).strongest_line(&histogram, range, 5), None);
    }

    #[test]
    fn all_levels_project_cells_like_the_reference() {
        let mut random = fastrand::Rng::with_seed(1);
        let mut cells = |most| -> Vec<u16> { (0..4 * GROUP).map(|_| random.u16(..most)).collect() };
        let (bins, rows, counts) = (cells(256), cells(480), cells(40));
        let (sin, cos) = (-0.4_f64).sin_cos();
        let mut expected = vec![0_u32; 2000];
        for ((bin, row), count) in bins.iter().zip(&rows).zip(&counts) {
            let offset = f64::from(*bin) * cos + f64::from(*row) * sin + 481.0;
            expected[offset.round() as usize] += u32::from(*count);
        }
        for level in Level::available() {
            let mut sums: [Vec<u32>; PARTIAL_SUMS] = std::array::from_fn(|_| vec![0; 2000]);
            project(level, [&bins, &rows, &counts], [cos, sin, 481.0], &mut sums);
            let all: Vec<u32> = (0..2000).map(|i| sums.iter().map(|sums| sums[i]).sum()).collect();
            assert_eq!(all, expected, "{}", level.name());
        }
    }
}
