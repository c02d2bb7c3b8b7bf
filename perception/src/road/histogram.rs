//! v-disparity histogram: number of pixels for each disparity in each image row (H_x in the paper, section
//! 3.5).

use crate::depth::DepthView;
use crate::simd::{Level, Simd, kernel};

/// Pixels with a lower confidence (0 to 255) are not used for the road model.
pub(super) const MIN_CONFIDENCE: u8 = 100;

/// Bins per pixel of disparity.
pub const BINS_PER_PX: usize = 4;

/// Width of a bin, in 1/256 px.
const BIN_STEP: u16 = (256 / BINS_PER_PX) as u16;
/// Neighbouring pixels mostly fall into the same bin. Counting them in this many separate histograms avoids a
/// dependency between consecutive increments.
const PARTIAL_COUNTS: usize = 4;

/// The columns that are counted: a number of columns on each side of a centre, proportional to disparity.
/// This is a corridor of constant metric width at any distance.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Corridor {
    /// Centre column.
    pub centre_px: f32,
    /// Half-width, in columns per px of disparity.
    pub columns_per_px: f32,
}

impl Corridor {
    /// No restriction: all columns are counted.
    pub const UNBOUNDED: Corridor = Corridor { centre_px: 0.0, columns_per_px: f32::INFINITY };
}

/// v-disparity histogram with `height` rows of bins of 1/4 px.
#[derive(Clone, Debug)]
pub struct VDisparity {
    counts: Vec<u16>,
    /// Smallest disparity that is counted in each column, in 1/256 px.
    min_disparity: Vec<u16>,
    /// Bin of each pixel of a row.
    bin_of_pixel: Vec<u16>,
    /// Partial histograms of a row; the last entry of each counts pixels without a bin.
    partial_counts: Vec<u16>,
    bins: usize,
    height: usize,
    level: Level,
}

impl VDisparity {
    /// An empty histogram for maps of `width` × `height` with disparities below `disparities` px.
    pub fn new(width: usize, height: usize, disparities: usize) -> Self {
        let bins = disparities * BINS_PER_PX;
        Self {
            counts: vec![0; bins * height],
            min_disparity: vec![0; width],
            bin_of_pixel: vec![bins as u16; width.next_multiple_of(PARTIAL_COUNTS)],
            partial_counts: vec![0; PARTIAL_COUNTS * (bins + 1)],
            bins,
            height,
            level: Level::best(),
        }
    }

    /// Recomputes the histogram from a map. Pixels of unknown disparity, with a disparity beyond the last bin
    /// or with less than `min_confidence` are not counted.
    ///
    /// # Panics
    /// When the size of the map differs from that of the histogram.
    pub fn fill(&mut self, depth: DepthView<'_>, min_confidence: u8, corridor: Corridor) {
        let size = (self.min_disparity.len(), self.height);
        assert_eq!((depth.width(), depth.height()), size, "the map size differs from the histogram size");
        for (x, min_disparity) in self.min_disparity.iter_mut().enumerate() {
            let columns = (x as f32 - corridor.centre_px).abs();
            *min_disparity = (256.0 * columns / corridor.columns_per_px).ceil().max(1.0) as u16;
        }
        for (y, counts) in self.counts.chunks_exact_mut(self.bins.max(1)).enumerate() {
            let (row, confidence) = (depth.disparity(y), depth.confidence(y));
            assign_bins(
                self.level,
                row,
                confidence,
                &self.min_disparity,
                min_confidence,
                self.bins as u16,
                &mut self.bin_of_pixel,
            );
            self.partial_counts.fill(0);
            let (a, rest) = self.partial_counts.split_at_mut(self.bins + 1);
            let (b, rest) = rest.split_at_mut(self.bins + 1);
            let (c, d) = rest.split_at_mut(self.bins + 1);
            let add = |counts: &mut [u16], bin: u16| {
                let count = &mut counts[usize::from(bin)];
                *count = count.saturating_add(1);
            };
            for [i, j, k, l] in self.bin_of_pixel.as_chunks::<PARTIAL_COUNTS>().0 {
                add(a, *i);
                add(b, *j);
                add(c, *k);
                add(d, *l);
            }
            for ((((count, a), b), c), d) in counts.iter_mut().zip(a).zip(b).zip(c).zip(d) {
                *count = a.saturating_add(*b).saturating_add(c.saturating_add(*d));
            }
        }
    }

    /// Counts of row `y`, one for each bin.
    pub fn row(&self, y: usize) -> &[u16] {
        &self.counts[y * self.bins..(y + 1) * self.bins]
    }

    /// Number of bins per row.
    pub fn bins(&self) -> usize {
        self.bins
    }

    /// Number of rows.
    pub fn height(&self) -> usize {
        self.height
    }
}

kernel! {
    /// Computes the bin of each pixel of a row; `bins` for pixels that are not counted.
    fn assign_bins(
        row: &[u16],
        confidence: &[u8],
        min_disparity: &[u16],
        min_confidence: u8,
        bins: u16,
        out: &mut [u16],
    ) = assign_bins_each
}

#[inline(always)]
fn assign_bins_each<S: Simd>(
    _: S,
    row: &[u16],
    confidence: &[u8],
    min_disparity: &[u16],
    min_confidence: u8,
    bins: u16,
    out: &mut [u16],
) {
    let min_confidence = u16::from(min_confidence);
    for (((&d, &confidence), &min_disparity), out) in row.iter().zip(confidence).zip(min_disparity).zip(out) {
        let counts = (d >= min_disparity) & (u16::from(confidence) >= min_confidence);
        *out = if counts { (d / BIN_STEP).min(bins) } else { bins };
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::stereo::DisparityView;

    #[test]
    fn known_pixels_are_counted_in_their_row() {
        let map = [0, 256, 300, 320, 64 * 256, u16::MAX, 1, 63];
        let mut histogram = VDisparity::new(4, 2, 8);
        let confidence = [255; 8];
        let depth =
            |map, confidence| DepthView::new(DisparityView::new(map, 4, 2).unwrap(), confidence).unwrap();
        histogram.fill(depth(&map, &confidence), 1, Corridor::UNBOUNDED);
        assert_eq!(histogram.row(0)[4], 2);
        assert_eq!(histogram.row(0)[5], 1);
        assert_eq!(histogram.row(0).iter().map(|&c| u32::from(c)).sum::<u32>(), 3);
        assert_eq!(histogram.row(1)[0], 2, "disparities beyond the last bin are not counted");
        histogram.fill(depth(&[0; 8], &confidence), 1, Corridor::UNBOUNDED);
        assert!(histogram.row(1).iter().all(|&c| c == 0));
        histogram.fill(depth(&map, &[99, 99, 100, 100, 100, 100, 100, 100]), 100, Corridor::UNBOUNDED);
        assert_eq!(histogram.row(0)[4], 1, "pixels with low confidence are not counted");
    }

    #[test]
    fn all_levels_assign_pixels_to_the_bins_of_the_reference() {
        let mut random = fastrand::Rng::with_seed(1);
        let row: Vec<u16> = (0..77).map(|_| random.u16(..9000)).collect();
        let min_disparity: Vec<u16> = (0..77).map(|_| random.u16(1..4000)).collect();
        let confidence: Vec<u8> = (0..77).map(|_| random.u8(..)).collect();
        for level in Level::available() {
            let mut bin_of_pixel = vec![0; 77];
            assign_bins(level, &row, &confidence, &min_disparity, 100, 128, &mut bin_of_pixel);
            for (x, place) in bin_of_pixel.iter().enumerate() {
                let counts = row[x] >= min_disparity[x] && confidence[x] >= 100 && row[x] / BIN_STEP < 128;
                assert_eq!(*place, if counts { row[x] / BIN_STEP } else { 128 }, "{} {x}", level.name());
            }
        }
    }
}
